"""Values of a load's parts: which can deliver energy, and how long the output takes to charge."""

from __future__ import annotations

from typing import TYPE_CHECKING

from circuits.kernel.flattening import Place, elements
from harvester.errors import LoadError

if TYPE_CHECKING:
    from circuits.loads.subcircuits import LoadCircuit


def sources_of(load: LoadCircuit) -> tuple[str, ...]:
    """Names of a load's independent sources that are not 0."""
    names = (place.name.rpartition(".")[2] for place in places_of(load) if _gives(place))
    return tuple(dict.fromkeys(names))


def negative_parts(load: LoadCircuit) -> tuple[str, ...]:
    """Resistors, capacitors and coils of a load whose value is below 0, as "name (file:line)"."""
    return tuple(
        f"{place.name} ({place.where})"
        for place in places_of(load)
        if place.letter in "rcl" and (number_of(place) or 0.0) < 0.0
    )


def charging_time(load: LoadCircuit) -> float:
    """R·C of the resistors and capacitors across a load's output (s); 0 without both."""
    # By ngspice's names, "r.xload.xinner.rload".
    across = {*load.output_resistors, *load.storage}
    sizes = {"r": [0.0], "c": [0.0]}
    for place in places_of(load):
        if f"{place.letter}.xload.{place.name}" in across:
            sizes[place.letter].append(number_of(place) or 0.0)
    conductance = sum(1.0 / size for size in sizes["r"] if size > 0.0)
    return sum(sizes["c"]) / conductance if conductance else 0.0


def suspicion(load: LoadCircuit | None) -> str:
    """What to suspect when a run with a load ended early, to be put behind the reason."""
    if load is None or not load.negative_parts:
        return ""
    names = ", ".join(load.negative_parts[:3])
    return f"; a value below 0 makes what it feeds grow without an end: {names}"


def places_of(load: LoadCircuit) -> list[Place]:
    """The load's elements; none where what one of its calls is given has no value here."""
    try:
        return list(elements(load, {pin: pin for pin in load.pins}))
    except LoadError:
        return []


def number_of(place: Place) -> float | None:
    """The value of an R, C, L or K, None for one of a model or an expression of the solution."""
    text = place.plain()[-1] if place.letter == "k" else place.size()
    try:
        return None if text.isidentifier() else place.value(text)
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
