"""Whether what a load's file says is a circuit: its needs, couplings, resistances, nodes named."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from circuits.loads.expression import ExpressionError, leaves, parse
from circuits.loads.flattening import calls
from circuits.loads.part_models import LEAST_RESISTANCE
from harvester.device.terminals import GROUND
from harvester.errors import NetlistError
from harvester.files.plain_text import nearest

if TYPE_CHECKING:
    from circuits.loads.elements import Element
    from circuits.loads.scope import Scope
    from circuits.loads.subcircuits import LoadCircuit

# Largest value of a part. Powers of larger ones leave the range of numbers.
LARGEST_VALUE = 1e30
# Largest energy (J) of a store at 1 V or 1 A, or at its ic. Rounding of a larger one hides what a
# harvester adds to it.
LARGEST_ENERGY = 1e9
# If coils are fully coupled, some of their currents hold no energy, to within this share.
ROUNDING = 1e-9
# Letters of elements whose second pair of nodes controls them and carries no current.
_CONTROLLED = "seg"


def check_load(load: LoadCircuit) -> None:
    """Refuse a load whose elements form no valid circuit.

    Raises
    ------
    NetlistError
        One line with file, line and fault.
    """
    _check_sizes(load.elements)
    _check_sources(load.elements)
    _check_couplings(load.elements)
    _check_nodes(load.elements, load.pins)
    _check_currents(load.elements)


def loose_nodes(load: LoadCircuit) -> tuple[str, ...]:
    """Nodes with a single connection and no use in an expression, as "node of name (file:line)"."""
    ends = Counter(node for each in load.elements for node in _connected(each))
    known = {GROUND, *load.pins, *(node for each in load.elements for node in _controlling(each))}
    return tuple(
        f"{node} of {each.name} ({each.where})"
        for each in load.elements
        for node in _connected(each)
        if ends[node] == 1 and node not in known
    )


def check_needs(scope: Scope) -> None:
    """Refuse values that a sub-circuit says it is not made for.

    Raises
    ------
    NetlistError
    """
    for each in calls(scope):
        for card in each.circuit.needs:
            needs = f"{card.where}: {each.circuit.name} needs {card.text}"
            try:
                holds = each.value("{" + card.text + "}") > 0.0
            except ExpressionError as reason:
                raise NetlistError(f"{needs}: that cannot be checked: {reason}") from None
            if not holds:
                raise NetlistError(f"{needs} here, with {_values(each, card.text)}")


def _values(scope, condition):
    """ "name = value" of each parameter of a condition."""
    found = (each[1] for each in leaves(parse(condition)) if each[0] == "name")
    names = sorted({*found}, key=condition.index)
    told = [f"{name} = {scope.parameter(name):g}" for name in names]
    return ", ".join(told) or "no parameter in it"


def _check_sizes(parts):
    """Refuse values whose currents or powers rounding or overflow would hide."""
    for each in parts:
        for key, value in (("", each.value or 0.0), *each.numbers):
            if abs(value) > LARGEST_VALUE:
                said = f"{key}={value:g}" if key else f"{value:g}"
                raise NetlistError(
                    f"{each.where}: {each.name}: {said}: no part's value is above {LARGEST_VALUE:g}"
                    "; leave the part out if it is to have no effect"
                )
        energy = 0.5 * abs(each.size or 0.0) * max(abs(each.get("ic")), 1.0) ** 2
        if each.letter in "cl" and energy > LARGEST_ENERGY:
            raise NetlistError(
                f"{each.where}: {each.name}: {energy:.2g} J: rounding hides a harvest: use V, I"
            )
        size = each.size if each.letter == "r" else None
        if size is not None and abs(size) < LEAST_RESISTANCE:
            raise NetlistError(
                f"{each.where}: {each.name}: {abs(size):g} Ω: below {LEAST_RESISTANCE:g} Ω "
                "currents are lost to rounding; 1m, a thousandth of an ohm, does the same"
            )


def _check_sources(parts):
    """Refuse a loop of voltage sources: they contradict each other, or leave its current open."""
    joined: dict[str, set[str]] = {}
    for each in parts:
        if each.letter != "v" and not each.voltage:
            continue
        a, z = (GROUND if node == "n" else node for node in each.nodes[:2])
        asked = each.controls or any(
            leaf[0] == "i" for leaf in leaves(each.expression or ("time",))
        )
        if asked and a != z:
            # Its voltage may depend on the loop's current.
            continue
        one, other = (joined.setdefault(node, {node}) for node in (a, z))
        if one is other:
            raise NetlistError(
                f"{each.where}: {each.name}: it closes a loop of voltage sources, whose voltages "
                "contradict each other or leave their current undetermined: leave it out, or put "
                "a resistor in series"
            )
        one |= other
        joined.update(dict.fromkeys(other, one))


def _check_nodes(parts, pins):
    """Refuse a voltage that controls something where nothing is connected."""
    known = {GROUND, *pins, *(node for each in parts for node in _connected(each))}
    for each in parts:
        for node in _controlling(each):
            if node not in known:
                raise NetlistError(
                    f"{each.where}: {each.name}: nothing is connected to the node "
                    f"{node[:60]}{nearest(node, known)}"
                )


def _check_currents(parts):
    """Refuse an expression with the current of an element that does not exist."""
    known = {each.name for each in parts if each.letter in "vehl" or each.voltage}
    for each in parts:
        asked = {leaf[1] for leaf in leaves(each.expression or ("time",)) if leaf[0] == "i"}
        for name in sorted({*each.controls, *asked}):
            if name not in known:
                raise NetlistError(
                    f"{each.where}: {each.name}: i({name[:60]}) is no current of the load"
                    f"{nearest(name, known)}: only that of a V, E, H, L or of a B with v= is; a "
                    "source of 0 V in series is an ammeter"
                )


def _controlling(each: Element) -> list[str]:
    """Nodes whose voltage controls an element."""
    pairs = (leaf[1:] for leaf in leaves(each.expression or ("time",)) if leaf[0] == "v")
    inner = sorted({node for pair in pairs for node in pair})
    return [*each.nodes[2:], *inner] if each.letter in _CONTROLLED else inner


def _connected(each: Element) -> Iterable[str]:
    """Nodes that an element's current flows through."""
    return each.nodes[:2] if each.letter in _CONTROLLED else each.nodes


def _check_couplings(parts):
    """Refuse coils whose couplings contradict: some currents would hold less than 0 J."""
    couplings = [each for each in parts if each.letter == "k"]
    many = {each.name: each.many for each in parts if each.letter == "l"}
    names = list(dict.fromkeys(name for each in couplings for name in each.controls))
    energy = np.eye(len(names))
    for each in couplings:
        size = each.value
        if several := [name for name in each.controls if many[name] != 1.0]:
            raise NetlistError(
                f"{each.where}: {each.name}: m= of the coupled coil {several[0]} has no effect on "
                "its coupling: write one coil with the inductance of all"
            )
        if abs(size) > 1.0:
            raise NetlistError(
                f"{each.where}: {each.name}: a coupling of {size:g}; it lies between -1 and 1"
            )
        ends = [names.index(name) for name in each.controls]
        energy[np.ix_(ends, ends)] += size * (1.0 - np.eye(len(ends)))
    if names:
        levels, currents = np.linalg.eigh(energy)
        if levels[0] < -ROUNDING:
            flowing = np.abs(currents[:, 0]) > ROUNDING
            coils = [name for name, flows in zip(names, flowing, strict=True) if flows]
            last = [each for each in couplings if not set(coils).isdisjoint(each.controls)][-1]
            raise NetlistError(
                f"{last.where}: {last.name}: impossible couplings: some currents in "
                f"{', '.join(coils[:5])} would hold less than no energy; lower the couplings, or "
                "give one the other sign"
            )
