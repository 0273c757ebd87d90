"""Parts of a load that can deliver energy: sources, values below 0, couplings that contradict."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from circuits.kernel.flattening import Place, elements
from harvester.errors import LoadError, NetlistError

if TYPE_CHECKING:
    from circuits.loads.subcircuits import LoadCircuit

# Coils that are coupled fully hold no energy in some of their currents, to within rounding.
ROUNDING = 1e-9


def sources_of(load: LoadCircuit) -> tuple[str, ...]:
    """Names of a load's independent sources that are not 0."""
    names = (place.name.rpartition(".")[2] for place in _places(load) if _gives(place))
    return tuple(dict.fromkeys(names))


def negative_parts(load: LoadCircuit) -> tuple[str, ...]:
    """Resistors, capacitors and coils of a load whose value is below 0, as "name (file:line)"."""
    return tuple(
        f"{place.name} ({place.where})"
        for place in _places(load)
        if place.letter in "rcl" and (_number(place) or 0.0) < 0.0
    )


def suspicion(load: LoadCircuit | None) -> str:
    """What to suspect when a run with a load ended early, to be put behind the reason."""
    if load is None or not load.negative_parts:
        return ""
    names = ", ".join(load.negative_parts[:3])
    return f"; a value below 0 makes what it feeds grow without an end: {names}"


def check_couplings(load: LoadCircuit) -> None:
    """Refuse coils whose couplings contradict each other: some currents would hold less than 0 J.

    Raises
    ------
    NetlistError
        One line with file and line of the last coupling of such coils.
    """
    couplings = [place for place in _places(load) if place.letter == "k"]
    names = list(dict.fromkeys(name for place in couplings for name in _coils(place)))
    energy = np.eye(len(names))
    for place in couplings:
        size = _number(place) or 0.0
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


def _places(load: LoadCircuit) -> Iterator[Place]:
    """The load's elements, as far as its calls can be followed."""
    try:
        yield from elements(load, {pin: pin for pin in load.pins})
    except LoadError:
        return


def _coils(place: Place) -> Iterable[str]:
    return [place.scope.path + name for name in place.plain()[:-1]]


def _number(place: Place) -> float | None:
    """The value of an element, None for one of a model or an expression of the solution."""
    words = place.plain() or list(place.pairs().values())
    try:
        return place.value(words[-1 if place.letter == "k" else 0])
    except LoadError:
        return None


def _gives(place: Place) -> bool:
    if place.letter not in "vi":
        return False
    for word in place.words:
        text = word.rpartition("=")[2]
        try:
            if place.value(text) != 0.0:
                return True
        except LoadError:
            # A keyword, such as dc, has no value; an expression may have any.
            if text.startswith("{"):
                return True
    return False
