"""Whether what a load's file says is a circuit: its needs, couplings, resistances, nodes named."""

from __future__ import annotations

import contextlib
import re
from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from circuits.kernel.flattening import calls
from circuits.kernel.formula import NotTaken
from circuits.loads.places import lines_of
from circuits.loads.reader import NEEDS
from circuits.part_values import number_of, places_of
from harvester.device.terminals import GROUND
from harvester.errors import LoadError, NetlistError
from harvester.files.plain_text import nearest

if TYPE_CHECKING:
    from circuits.kernel.flattening import Place
    from circuits.loads.subcircuits import LoadCircuit

# Coils that are coupled fully hold no energy in some of their currents, to within rounding.
ROUNDING = 1e-9
# Ω: of less, rounding of the voltages at its ends hides the current of a harvester.
LEAST_RESISTANCE = 1e-6
_VOLTAGE = re.compile(r"(?<![\w.])v\(([^()]*)\)")
# Letters of elements whose second pair of nodes controls them and carries no current.
_CONTROLLED = "seg"


def check_load(load: LoadCircuit) -> None:
    """Refuse what is no circuit.

    Raises
    ------
    NetlistError
        One line with file, line and fault.
    """
    _check_needs(load)
    places = places_of(load)
    _check_resistances(places)
    _check_couplings(places)
    _check_nodes(places, load.pins)


def loose_nodes(load: LoadCircuit) -> tuple[str, ...]:
    """Nodes with one element's end, that nothing asks for, as "node of name (file:line)"."""
    places = places_of(load)
    ends = Counter(node for place in places for node in _connected(place))
    known = {GROUND, *load.pins, *(node for place in places for node in _controlling(place))}
    return tuple(
        f"{node} of {place.name} ({place.where})"
        for place in places
        for node in _connected(place)
        if ends[node] == 1 and node not in known
    )


def _check_needs(load):
    """Refuse values that a sub-circuit says it is not made for."""
    lines = lines_of(load)
    try:
        scopes = list(calls(load, {pin: pin for pin in load.pins}))
    except LoadError:
        # A call is given what has no value here.
        return
    for scope in scopes:
        name = scope.circuit.name
        for condition in (card.text for card in scope.circuit.needs):
            needs = f"{lines[name, f'{NEEDS} {condition}']}: {name} needs {condition}"
            try:
                holds = scope.value("{" + condition + "}") > 0.0
            except NotTaken as reason:
                raise NetlistError(f"{needs}: that cannot be told of {reason}") from None
            if not holds:
                raise NetlistError(f"{needs} here, with {_values(scope, condition)}")


def _values(scope, condition):
    """ "name = value" of each parameter of a condition."""
    told = []
    for name in dict.fromkeys(re.findall(r"(?<![\w.])[a-z_]\w*", condition)):
        # A function's name has no value.
        with contextlib.suppress(NotTaken):
            told.append(f"{name} = {scope.value(name):g}")
    return ", ".join(told) or "no parameter in it"


def _check_resistances(places):
    for place in places:
        size = number_of(place) if place.letter == "r" else None
        if size is not None and abs(size) < LEAST_RESISTANCE:
            raise NetlistError(
                f"{place.where}: {place.name}: {abs(size):g} Ω: below {LEAST_RESISTANCE:g} Ω "
                "currents are lost to rounding; 1m, a thousandth of an ohm, does the same"
            )


def _check_nodes(places, pins):
    """Refuse a voltage that controls something where nothing is connected."""
    known = {GROUND, *pins, *(node for place in places for node in _connected(place))}
    for place in places:
        for node in _controlling(place):
            if node not in known:
                raise NetlistError(
                    f"{place.where}: {place.name}: nothing is connected to the node "
                    f"{node[:60]}{nearest(node, known)}"
                )


def _controlling(place: Place) -> list[str]:
    """Nodes whose voltage an element asks for, without those within a call, named with a dot."""
    pairs = (pair for word in place.words for pair in _VOLTAGE.findall(word))
    named = {name.strip() for pair in pairs for name in pair.split(",")}
    inner = [place.scope.node(name) for name in sorted(named) if "." not in name]
    return [*place.nodes[2:], *inner] if place.letter in _CONTROLLED else inner


def _connected(place: Place) -> tuple[str, ...]:
    """Nodes that an element's current flows through."""
    return place.nodes[:2] if place.letter in _CONTROLLED else place.nodes


def _check_couplings(places):
    """Refuse coils whose couplings contradict: some currents would hold less than 0 J."""
    couplings = [place for place in places if place.letter == "k"]
    names = list(dict.fromkeys(name for place in couplings for name in _coils(place)))
    energy = np.eye(len(names))
    for place in couplings:
        size = number_of(place) or 0.0
        if abs(size) > 1.0:
            raise NetlistError(
                f"{place.where}: {place.name}: a coupling of {size:g}; it lies between -1 and 1"
            )
        ends = [names.index(name) for name in _coils(place)]
        energy[np.ix_(ends, ends)] += size * (1.0 - np.eye(len(ends)))
    if names:
        levels, currents = np.linalg.eigh(energy)
        if levels[0] < -ROUNDING:
            flowing = np.abs(currents[:, 0]) > ROUNDING
            coils = [name for name, flows in zip(names, flowing, strict=True) if flows]
            last = [place for place in couplings if not set(coils).isdisjoint(_coils(place))][-1]
            raise NetlistError(
                f"{last.where}: {last.name}: no coils are coupled so: some currents in "
                f"{', '.join(coils[:5])} would hold less than no energy; lower the couplings, or "
                "give one the other sign"
            )


def _coils(place):
    return [place.scope.path + name for name in place.plain()[:-1]]
