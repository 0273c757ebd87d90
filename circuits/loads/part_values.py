"""Values of a load's parts: which can deliver energy, and what lies across the output."""

from __future__ import annotations

from typing import TYPE_CHECKING

from circuits.loads.expression import leaves
from circuits.loads.kinds import OUTPUT
from circuits.loads.own_motion import own_notes
from harvester.device.terminals import GROUND

if TYPE_CHECKING:
    from collections.abc import Iterable

    from circuits.loads.elements import Element
    from circuits.loads.subcircuits import LoadCircuit

# Smallest storage (F) and resistance (Ω) across an output. Smaller values are probably a misread
# suffix.
LEAST_STORAGE, LEAST_LOAD = 1e-12, 1.0
# Advice for a source that turns on and off without end.
SOURCE_CURE = (
    "its value jumps to and fro at one threshold, as its own effect reverses each jump at once; "
    "use a switch with a hysteresis (S, vt= and vh=), or let it change smoothly over some "
    "millivolts, as 0.5*(1+tanh((v-vt)/5m)) does"
)
# Operations whose value jumps.
_JUMPS = {"if", "<", "<=", "==", "and", "or", "not", "sgn", "floor", "ceil", "u", "nint"}


def sources_of(load: LoadCircuit) -> tuple[str, ...]:
    """Names of a load's independent sources that are not 0."""
    names = (each.name.rpartition(".")[2] for each in load.elements if _gives(each))
    return tuple(dict.fromkeys(names))


def negative_parts(load: LoadCircuit) -> tuple[str, ...]:
    """Resistors, capacitors and coils of a load whose value is below 0, as "name (file:line)"."""
    return tuple(
        f"{each.name} ({each.where})"
        for each in load.elements
        if each.letter in "rcl" and (each.size or 0.0) < 0.0
    )


def conductance(parts: Iterable[Element]) -> float:
    """The conductance (S) of resistors in parallel. Negative resistances are left out."""
    return sum(max(1.0 / each.size, 0.0) for each in parts if each.letter == "r" and each.size)


def capacitance(parts: Iterable[Element]) -> float:
    """The capacitance (F) of capacitors in parallel."""
    return sum(each.size or 0.0 for each in parts if each.letter == "c")


def suspicion(load: LoadCircuit | None) -> str:
    """The negative parts that may have ended a run early: text to append to the reason."""
    if load is None or not load.negative_parts:
        return ""
    names = ", ".join(load.negative_parts[:3])
    return f"; a value below 0 feeds energy in, so that voltages may grow without bound: {names}"


def jumping_sources(load: LoadCircuit) -> tuple[Element, ...]:
    """Behavioural sources whose value may jump."""
    return tuple(
        each
        for each in load.elements
        if each.expression is not None
        and any(leaf[0] in _JUMPS for leaf in leaves(each.expression))
    )


def reading_notes(load: LoadCircuit) -> tuple[str, ...]:
    """Notes on values that the reader may have understood otherwise than their writer."""
    notes = [
        f"{each.name} ({each.where}) is read as a smooth switch of LTspice or PSpice: its "
        "conductance changes over the whole hysteresis"
        for each in load.elements
        if each.is_smooth_switch
    ]
    notes += [load.ambiguity] if load.ambiguity else []
    outputs = [each for each in load.across_output if each.letter == "r"]
    if load.has_output and not outputs and all(each.kind != OUTPUT for each in load.measures):
        notes.append(
            "no resistor lies across out and ref and no measure is an output: its power is 0"
        )
    for each in load.across_output:
        small = LEAST_STORAGE if each.letter == "c" else LEAST_LOAD
        if 0.0 < (each.size or 0.0) < small:
            unit = "F" if each.letter == "c" else "Ω"
            notes.append(
                f"{each.name} ({each.where}) across the output is {each.size:g} {unit}: in SPICE F "
                "behind a number is femto and M is milli; a farad has no letter, a million is meg"
            )
    notes += [
        f"{each.name} ({each.where}) depends on its own output by way of the node {node}: a "
        "comparator with such a hysteresis may turn too late or too early at default steps; "
        "compare with --step finest, or use a switch (S, vt= and vh=)"
        for each in load.elements
        for node in _fed_back(load, each)[:1]
    ]
    return (*notes, *own_notes(load))


def _fed_back(load, source):
    """Nodes that a voltage by expression depends on and drives through resistors or coils."""
    if source.expression is None or not source.voltage:
        return []
    reached, size = {*source.nodes[:2]}, 0
    outside = {*load.pins, GROUND} - {"out"}
    wires = [{*each.nodes[:2]} for each in load.elements if each.letter in "rl"]
    while len(reached) != size:
        size = len(reached)
        reached = reached.union(*(ends for ends in wires if ends & reached - outside))
    named = (leaf[1:] for leaf in leaves(source.expression) if leaf[0] == "v")
    driven = reached - {*source.nodes[:2]} - outside
    return [node for pair in named for node in pair if node in driven]


def _gives(each):
    return each.letter in "vi" and (each.wave is not None or each.value != 0.0)
