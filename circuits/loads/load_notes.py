"""Notes on a load for results and messages: misread values, the cost of following it, causes."""

from __future__ import annotations

import math
import re

from circuits.loads.kinds import OUTPUT
from circuits.loads.load_circuit import LoadCircuit
from harvester.errors import LoadError

# Smallest storage (F) and resistance (Ω) across an output. Smaller values are probably a misread
# suffix.
LEAST_STORAGE, LEAST_LOAD = 1e-12, 1.0
# Shortest time constant of a switch's control that a run can follow, in steps of the grid. It is a
# hundred times Monte Carlo's shortest step; ngspice's clock is no finer.
LEAST_TURN = 1e-8
# Time (s) on one core that a period of a load's own clock takes in each engine: a buck converter of
# one switch behind a bridge, at 50 kHz, took 14 steps of Monte Carlo a period and 140 of ngspice.
PERIOD_COST = {"Monte Carlo": 8.6e-6, "the circuit": 2.6e-3}
# A note states the cost of a realization if it takes either engine more than so many seconds.
LONG = 60.0
# Matches ngspice's flat names: letters and calls, as in "d.xload.d.xbridge.dupper". The name of a
# model follows a colon, as in "xload:ideal".
_FLAT = re.compile(r"(?<![\w.])(?:[a-z]\.)*(?:xcopy\d+[.:])?xload([.:])([^\s,;()]*[^\s,;:.()])")


def reading_notes(load: LoadCircuit) -> tuple[str, ...]:
    """Notes on values that the reader may have understood otherwise than their writer."""
    notes = [
        f"{element.place} is read as a smooth switch of LTspice or PSpice: its "
        "conductance changes over the whole hysteresis"
        for element in load.elements
        if element.is_smooth_switch
    ]
    notes += [load.ambiguity] if load.ambiguity else []
    outputs = [part for part in load.across_output if part.letter == "r"]
    if load.has_output and not outputs and all(measure.kind != OUTPUT for measure in load.measures):
        notes.append(
            "no resistor lies across out and ref and no measure is an output: its power is 0"
        )
    for element in load.across_output:
        small = LEAST_STORAGE if element.letter == "c" else LEAST_LOAD
        if 0.0 < (element.size or 0.0) < small:
            unit = "F" if element.letter == "c" else "Ω"
            notes.append(
                f"{element.place} across the output is {element.size:g} {unit}: "
                "in SPICE F behind a number is femto and M is milli; a farad has no letter, "
                "a million is meg"
            )
    if load.own_motion.unknown:
        notes.append(
            "whether the load oscillates by itself is not known "
            f"({load.own_motion.unknown}): compare with shorter steps"
        )
    return tuple(notes)


def following_notes(load: LoadCircuit, duration: float) -> tuple[str, ...]:
    """A note on the cost of following a load's fastest source through a run (s), if over `LONG`."""
    period = min(load.periods, default=math.inf)
    costs = {engine: duration / period * cost for engine, cost in PERIOD_COST.items()}
    if any(element.letter in "jmq" for element in load.elements):
        # Monte Carlo does not run transistors.
        del costs["Monte Carlo"]
    if max(costs.values()) < LONG:
        return ()
    name = next(e.name for e in load.elements if e.wave and e.wave.period == period)
    estimates = ", ".join(f"{_spoken(cost)} by {engine}" for engine, cost in costs.items())
    return (
        f"{name} repeats itself every {1e6 * period:.3g} µs: {duration:.4g} s take about "
        f"{estimates}, for each realization on one core; put an averaged converter in "
        "its place, as nano_buck of `.include buck_converters.lib`",
    )


def _spoken(seconds):
    if seconds < 90.0:
        return f"{seconds:.2g} s"
    return f"{seconds / 60.0:.2g} min" if seconds < 5400.0 else f"{seconds / 3600.0:.2g} h"


def check_turn(load: LoadCircuit, step: float) -> None:
    """Refuse switches that turn by themselves faster than a run on a grid of this step (s) follows.

    Raises
    ------
    LoadError
    """
    motion = load.own_motion
    if motion.turn < LEAST_TURN * step:
        raise LoadError(
            f"{motion.switch} turns by itself, and its control follows within {motion.turn:.2g} s: "
            f"steps of {step:.2g} s cannot follow that; raise ron or the capacitance at its control"
        )


def suspicion(load: LoadCircuit | None) -> str:
    """The negative parts that may have ended a run early: text to append to the reason."""
    if load is None or not load.negative_parts:
        return ""
    names = ", ".join(load.negative_parts[:3])
    return f"; a value below 0 feeds energy in, so that voltages may grow without bound: {names}"


def with_places(message: str, load: LoadCircuit | None) -> str:
    """A message of ngspice's with the names of a load's elements as its files give them."""
    if load is None:
        return message
    placed = _FLAT.sub(lambda match: _named(match.group(2), load), message)
    if any(element.where in placed for element in load.elements):
        return placed
    return f"{placed} (the load is {load.file})"


def _named(flat, load):
    """ "dupper (bridge.lib:24)", or the bare name of what is no element, as a node."""
    path = re.split("[.:]", flat.removesuffix("#branch"))
    # The element's letter is repeated between the calls.
    full = ".".join(part for k, part in enumerate(path) if len(part) > 1 or k == len(path) - 1)
    places = {element.name: element.where for element in load.elements}
    return f"{path[-1]} ({places[full]})" if full in places else f"{path[-1]} of the load"
