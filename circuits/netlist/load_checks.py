"""Checks that a load is a valid circuit: conditions, couplings, resistances, nodes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from circuits.netlist.elements import AMMETER
from circuits.netlist.expression import ExpressionError, leaves, parse
from circuits.netlist.flattening import calls
from circuits.netlist.part_models import LEAST_RESISTANCE
from harvester.base.errors import NetlistError
from harvester.base.plain_text import nearest
from harvester.device.terminals import GROUND

if TYPE_CHECKING:
    from circuits.netlist.elements import Element
    from circuits.netlist.scope import Scope

# Largest value of a part: powers of larger values overflow.
LARGEST_VALUE = 1e30
# Largest energy (J) of a store at 1 V or 1 A, or at its ic: rounding of a larger energy hides what
# a harvester adds.
LARGEST_ENERGY = 1e9
# Relative tolerance of the smallest energy of coupled coils, which is 0 if they are fully coupled.
ROUNDING = 1e-9


def check_load(elements: Sequence[Element], pins: Sequence[str]) -> None:
    """Raise if the elements do not form a valid circuit.

    Raises
    ------
    NetlistError
        One line with file, line and error.
    """
    _check_sizes(elements)
    _check_sources(elements)
    _check_couplings(elements)
    _check_nodes(elements, pins)
    _check_currents(elements)


def loose_nodes(elements: Sequence[Element], pins: Sequence[str]) -> tuple[str, ...]:
    """Nodes with one connection that no expression uses, as "node of name (file:line)"."""
    ends = Counter(node for element in elements for node in element.ends)
    known_nodes = {GROUND, *pins, *(node for element in elements for node in element.controlling)}
    return tuple(
        f"{node} of {element.place}"
        for element in elements
        for node in element.ends
        if ends[node] == 1 and node not in known_nodes
    )


def check_needs(scope: Scope) -> None:
    """Raise for values that violate the conditions (`* needs:`) of a sub-circuit.

    Raises
    ------
    NetlistError
    """
    for call in calls(scope):
        for card in call.circuit.needs:
            needs = f"{card.where}: {call.circuit.name} needs {card.text}"
            try:
                holds = call.value("{" + card.text + "}") > 0.0
            except ExpressionError as reason:
                raise NetlistError(f"{needs}: cannot be checked: {reason}") from None
            if not holds:
                raise NetlistError(f"{needs} here, with {_values(call, card.text)}")


def _values(scope, condition):
    """ "name = value" of each parameter in a condition."""
    leaf_names = (leaf[1] for leaf in leaves(parse(condition)) if leaf[0] == "name")
    names = sorted({*leaf_names}, key=condition.index)
    assignments = [f"{name} = {scope.parameter(name):g}" for name in names]
    return ", ".join(assignments) or "no parameters"


def _refuse(part: Element, fault: str) -> NoReturn:
    raise NetlistError(f"{part.where}: {part.name}: {fault}")


def _check_sizes(parts):
    """Raise for values whose currents or powers would be lost by rounding or overflow."""
    for part in parts:
        for key, value in (("", part.value or 0.0), *part.numbers):
            if abs(value) > LARGEST_VALUE:
                written = f"{key}={value:g}" if key else f"{value:g}"
                cure = "remove the part if it should have no effect"
                _refuse(part, f"{written}: must be at most {LARGEST_VALUE:g}; {cure}")
        energy = 0.5 * abs(part.size or 0.0) * max(abs(part.get("ic")), 1.0) ** 2
        if part.letter in "cl" and energy > LARGEST_ENERGY:
            _refuse(
                part,
                f"{energy:.2g} J: above {LARGEST_ENERGY:g} J rounding hides the energy that the "
                "harvester adds; use a voltage or current source",
            )
        size = part.size if part.letter == "r" else None
        if size is not None and abs(size) < LEAST_RESISTANCE:
            _refuse(
                part,
                f"{abs(size):g} Ω: below {LEAST_RESISTANCE:g} Ω currents are lost by rounding; 1m, "
                "1e-3 ohms, has the same effect",
            )


def _check_sources(parts):
    """Raise for a loop of voltage sources: contradictory voltages or an undetermined current."""
    joined: dict[str, set[str]] = {}
    for part in parts:
        if part.letter != "v" and not part.voltage:
            continue
        a, z = (GROUND if node == "n" else node for node in part.nodes[:2])
        if part.currents and a != z:
            # The voltage of an expression may depend on the loop's current.
            continue
        one, other = (joined.setdefault(node, {node}) for node in (a, z))
        if one is other:
            _refuse(
                part,
                "it closes a loop of voltage sources, whose voltages contradict each other or "
                "leave their current undetermined: remove it, or put a resistor in series",
            )
        one |= other
        joined.update(dict.fromkeys(other, one))


def _check_nodes(parts, pins):
    """Raise if a controlling voltage is at a node without connections."""
    known_nodes = {GROUND, *pins, *(node for part in parts for node in part.ends)}
    for part in parts:
        for node in sorted({*part.controlling}):
            if node not in known_nodes:
                hint = nearest(node, known_nodes)
                _refuse(part, f"nothing is connected to the node {node[:60]}{hint}")


def _check_currents(parts):
    """Raise if an expression contains a current that does not exist."""
    currents = {part.name for part in parts if part.has_current}
    for part in parts:
        for name in sorted({*part.currents}):
            if name not in currents:
                _refuse(
                    part,
                    f"i({name[:60]}) is no current in the load{nearest(name, currents)}: {AMMETER}",
                )


def _check_couplings(parts):
    """Raise for contradictory couplings of coils: some currents would store negative energy."""
    couplings = [part for part in parts if part.letter == "k"]
    many = {part.name: part.many for part in parts if part.letter == "l"}
    names = list(dict.fromkeys(name for coupling in couplings for name in coupling.controls))
    energy = np.eye(len(names))
    for coupling in couplings:
        size = coupling.value
        if several := [name for name in coupling.controls if many[name] != 1.0]:
            _refuse(
                coupling,
                f"m= of the coupled coil {several[0]} does not affect its coupling: write one "
                "coil with the total inductance",
            )
        if abs(size) > 1.0:
            _refuse(coupling, f"coupling {size:g}: must be between -1 and 1")
        ends = [names.index(name) for name in coupling.controls]
        energy[np.ix_(ends, ends)] += size * (1.0 - np.eye(len(ends)))
    if names:
        levels, currents = np.linalg.eigh(energy)
        if levels[0] < -ROUNDING:
            flowing = np.abs(currents[:, 0]) > ROUNDING
            coils = [name for name, flows in zip(names, flowing, strict=True) if flows]
            last = [part for part in couplings if not {*coils}.isdisjoint(part.controls)][-1]
            _refuse(
                last,
                f"impossible couplings: currents in {', '.join(coils[:5])} would store negative "
                "energy; lower the couplings, or change a sign",
            )
