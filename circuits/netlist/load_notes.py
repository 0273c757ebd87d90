"""Notes on a load: misread values, computation time, causes of failures."""

from __future__ import annotations

import math

from circuits.netlist.expression import leaves
from circuits.netlist.kinds import OUTPUT
from circuits.netlist.load_circuit import OUTPUT_PINS, LoadCircuit
from harvester.base.errors import LoadError
from harvester.device.terminals import GROUND

# Smallest plausible capacitance (F) and resistance (Ω) across an output: smaller values are
# probably a misread suffix.
LEAST_STORAGE, LEAST_LOAD = 1e-12, 1.0
# Shortest time constant of a switch's control that a run can resolve, in steps of the grid: a
# hundred times Monte Carlo's shortest step, and about the resolution of ngspice's clock.
LEAST_TURN = 1e-8
# Time (s) on one core per period of a load's clock in each engine, measured on a bridge with a
# one-switch buck converter at 50 kHz: 14 steps of Monte Carlo per period, 140 of ngspice.
PERIOD_COST = {"Monte Carlo": 8.6e-6, "the circuit": 2.6e-3}
# Maximum number of elements that a note names.
MOST_PLACES = 3
# Run time of a realization, in seconds, above which a note states it.
LONG = 60.0


def reading_notes(load: LoadCircuit) -> tuple[str, ...]:
    """Notes on ambiguous values."""
    notes = [
        f"{element.place} is read as a smooth switch of LTspice or PSpice: its "
        "conductance changes over the whole hysteresis"
        for element in load.elements
        if element.is_smooth_switch
    ]
    notes += [load.ambiguity] if load.ambiguity else []
    notes += _ground_notes(load)
    outputs = [part for part in load.across_output if part.letter == "r"]
    if load.has_output and not outputs and all(measure.kind != OUTPUT for measure in load.measures):
        notes.append(
            "no resistor lies across out and ref and no measure is an output: the output power is 0"
        )
    for element in load.across_output:
        small = LEAST_STORAGE if element.letter == "c" else LEAST_LOAD
        if 0.0 < (element.size or 0.0) < small:
            unit = "F" if element.letter == "c" else "Ω"
            notes.append(
                f"{element.place} across the output is {element.size:g} {unit}: "
                "in SPICE F after a number is femto and M is milli; write no letter for farad, "
                "meg for a million"
            )
    notes += [
        f"{source.place} depends on its own output through the node {node}: a "
        "comparator with such a hysteresis may switch too late or too early at default steps; "
        "compare with step = finest, or use a switch (S, vt= and vh=)"
        for source in load.elements
        for node in _fed_back(load, source)[:1]
    ]
    if load.self_oscillation.unknown:
        notes.append(
            "whether the load is self-oscillating is unknown "
            f"({load.self_oscillation.unknown}): compare with shorter steps"
        )
    return tuple(notes)


def _ground_notes(load):
    """A note on elements at node 0, and on voltages of the output against it."""
    to_ground = ("v", OUTPUT_PINS[0], GROUND)
    places = [
        part.place
        for part in load.elements
        if GROUND in part.ends or (load.has_output and to_ground in leaves(part.expression))
    ]
    if not places or load.resistance:
        return []
    remedy = "write ref for the ground of the output, v(out,ref) for its voltage, or n"
    if not load.has_output:
        remedy = "write n, or another name for the ground of an inner DC side"
    more = f" and {len(places) - MOST_PLACES} more" if len(places) > MOST_PLACES else ""
    return [
        f"node 0 in {', '.join(places[:MOST_PLACES])}{more} is the pin n, a terminal of the "
        f"transducer: {remedy}"
    ]


def _fed_back(load, source):
    """Nodes that a voltage expression depends on and also drives through resistors or coils."""
    if source.expression is None or not source.voltage:
        return []
    reached, size = {*source.nodes[:2]}, 0
    outside = {*load.pins, GROUND} - {"out"}
    wires = [{*element.nodes[:2]} for element in load.elements if element.letter in "rl"]
    while len(reached) != size:
        size = len(reached)
        reached = reached.union(*(ends for ends in wires if ends & reached - outside))
    named = (leaf[1:] for leaf in leaves(source.expression) if leaf[0] == "v")
    driven = reached - {*source.nodes[:2]} - outside
    return [node for pair in named for node in pair if node in driven]


def following_notes(load: LoadCircuit, duration: float) -> tuple[str, ...]:
    """A note on the computation time of a run of this duration (s), if it exceeds `LONG`."""
    period = min(load.periods, default=math.inf)
    costs = {engine: duration / period * cost for engine, cost in PERIOD_COST.items()}
    if any(element.letter in "jmq" for element in load.elements):
        # Monte Carlo does not support transistors.
        del costs["Monte Carlo"]
    if max(costs.values()) < LONG:
        return ()
    name = next(e.name for e in load.elements if e.wave and e.wave.period == period)
    estimates = ", ".join(f"{_spoken(cost)} by {engine}" for engine, cost in costs.items())
    return (
        f"{name} has a period of {1e6 * period:.3g} µs: {duration:.4g} s take about "
        f"{estimates}, per realization on one core; use an averaged converter "
        "instead, such as nano_buck of `.include buck_converters.lib`",
    )


def _spoken(seconds):
    if seconds < 90.0:
        return f"{seconds:.2g} s"
    return f"{seconds / 60.0:.2g} min" if seconds < 5400.0 else f"{seconds / 3600.0:.2g} h"


def check_turn(load: LoadCircuit, step: float) -> None:
    """Raise for comparisons that depend on rounding, and for switches too fast for this step (s).

    Raises
    ------
    LoadError
    """
    if load.cancelled:
        raise LoadError(
            f"{load.cancelled} compares two values that are equal up to rounding: compare with "
            "a threshold of some millivolts"
        )
    motion = load.self_oscillation
    if motion.turn < LEAST_TURN * step:
        raise LoadError(
            f"{motion.switch} toggles endlessly with a time constant of {motion.turn:.2g} s: "
            f"steps of {step:.2g} s cannot resolve it; raise ron or the capacitance at its control"
        )


def suspicion(load: LoadCircuit | None) -> str:
    """Text on negative parts that may have caused a failure, to append to its message."""
    if load is None or not load.negative_parts:
        return ""
    names = ", ".join(load.negative_parts[:3])
    return f"; a value below 0 feeds energy in, so that voltages may grow without bound: {names}"
