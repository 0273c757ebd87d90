"""Monte Carlo of a device with a netlist as load."""

from __future__ import annotations

import functools
import time
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from circuits.kernel import stepping
from circuits.kernel.assembly import build
from circuits.kernel.emitter import call_once
from circuits.kernel.mechanics import device_of
from circuits.kernel.memory import SLOTS
from circuits.kernel.stage import fresh_state
from circuits.kernel.stepping import CHATTER, FINE, SOURCE_CHATTER, advance
from circuits.kernel.tables import Circuit
from circuits.netlist.expression import leaves
from circuits.netlist.functions import LIMITED
from circuits.netlist.load_notes import check_turn, suspicion
from circuits.netlist.part_values import SOURCE_CURE, conductance, jumping_sources
from circuits.netlist.source_schedule import AHEAD, NO_BREAKPOINTS
from harvester.base import compilation
from harvester.base.errors import LoadChatters, LoadError, SimulatorAborted, SolutionDiverged
from harvester.device import contact, system, timescales
from harvester.device.record import Record, empty_record, part
from harvester.scene.lines import exact_frequencies
from harvester.scene.steps import (
    CRAWL,
    LARGEST_VOLTAGE,
    PATIENCE,
    RUNAWAY,
    STALLED,
    STEP_LEVELS,
    STEPS_PER_CONTACT,
    knot_blocks,
    knot_spacing,
    steps_per_contact,
    steps_per_sample,
    stop_time,
)

if TYPE_CHECKING:
    from harvester.device.system import System
    from harvester.excitation.base import ExcitationPath
    from harvester.scene.prepared import Prepared

CHUNK = 16384
# Finer steps than these do not reduce the error tolerance.
FINEST = STEP_LEVELS["finest"]
# Reasons for the end of a run, in addition to `advance`'s: no progress, unbounded voltages.
CRAWLING, UNBOUNDED = -1, -2
SCHEME = "TR-BDF2"


def prepare(ready: Prepared) -> None:
    """Load the compiled code for a scene's parts, so that it does not count as simulation."""
    s = ready.system
    circuit = circuit_of(ready)
    state = _beginning(s, circuit, (0.0, 0.0, 0.0))
    edges = np.array(contact.edges(s.contacts))
    advance(
        device_of(s), circuit.tables, circuit.probes, state, edges, np.zeros(2), 0, 0, 0, 1.0, 1, 1,
        NO_BREAKPOINTS, empty_record(2), np.zeros((1, 2)),
    )  # fmt: skip


@functools.lru_cache(maxsize=16)
def circuit_of(ready: Prepared) -> Circuit:
    """The tables of a scene's load, see `circuits.kernel.assembly.build`."""
    return build(ready)


def run_realizations(
    engine: Any,
    ready: Prepared,
    paths: list[ExcitationPath],
    starts: list[tuple[float, float, float]],
    observers: list[Any],
    outputs: Any = None,
) -> dict[str, str | None]:
    """Integrate realizations one by one; see `harvester.engines.methods.Engine`.

    Netlists have a single scheme.

    Returns
    -------
    dict
        engine_version, netlist_sha256 (of the load with its values).

    Raises
    ------
    LoadError
        The load contains an unsupported element, or another scheme is requested.
    SimulatorAborted, SolutionDiverged
    """
    scene, s, scales = ready.scene, ready.system, ready.scales
    if engine.scheme != "runge-kutta":
        raise LoadError(
            f"{scene.name}: scheme {engine.scheme} is for a resistor as load; leave it out"
        )
    circuit = circuit_of(ready)
    fixed = steps_per_sample(ready, engine.step, "monte-carlo")
    check_turn(scene.load.circuit, knot_spacing(ready) / fixed)
    in_contact = steps_per_contact(ready, engine.step, "monte-carlo")
    refinement = fixed / steps_per_sample(ready, engine="monte-carlo")
    stop, lines = stop_time(ready), exact_frequencies(ready)
    for k, (path, start, watching) in enumerate(zip(paths, starts, observers, strict=True)):
        for record, output in integrate(
            s, circuit, path, start, stop, fixed, in_contact, refinement, lines
        ):
            if not all(np.isfinite(column[-1]) for column in record):
                raise SolutionDiverged(
                    "Monte Carlo diverged (values that are not finite) before t = "
                    f"{record.time[-1]:g}; choose a shorter step"
                )
            for observer in watching:
                observer.add(record)
            if outputs is not None:
                unit = circuit.probes.units[3]
                values = circuit.measurement.values(record.time, output[1:], unit)
                levels = circuit.measurement.levels(output[1:])
                energy = unit * circuit.measurement.energy
                outputs[k].add(record.time, output[0], values, levels, energy)
        if outputs is not None:
            unit = circuit.probes.units[3] * scales.voltage**2
            outputs[k].conductance = unit * conductance(circuit.load.across_output)
    return {
        "engine_version": f"{SCHEME}, numba {compilation.numba.__version__}",
        "netlist_sha256": scene.load.circuit.sha256,
    }


def integrate(
    s: System,
    circuit: Circuit,
    path: ExcitationPath,
    start: tuple[float, float, float],
    stop: float,
    steps_per_sample: int = 1,
    steps_per_contact: int = STEPS_PER_CONTACT,
    refinement: float = 1.0,
    lines: Sequence[tuple[float, float]] = ((0.0, 0.0),),
) -> Iterator[tuple[Record, np.ndarray]]:
    """Integrate the device with its load along a noise path.

    Parameters
    ----------
    s : harvester.device.system.System
    circuit : circuits.kernel.tables.Circuit
    path : harvester.excitation.base.ExcitationPath
    start : (float, float, float)
        X, X' and the transducer's state, scaled.
    stop : float
        End time (s), rounded up to a whole number of knots.
    steps_per_sample : int
        Default steps between two knots.
    steps_per_contact : int
        Fewest steps from the beginning of a contact to its end.
    refinement : float
        Divisor of the default step. The error tolerance decreases with its square, down to the
        residual of Newton's iterations; otherwise a finer grid would have no effect where the error
        sets the steps.
    lines : sequence of (float, float)
        Pairs of a time (s) and an angular frequency (rad/s): from that time on, motion at that
        frequency is exact; frequency 0: no correction. The first time is 0.

    Yields
    ------
    Record, ndarray
        Chunks of accepted points, without the initial point, and at these points the output's
        voltage (scaled) and the watched unknowns (V, A), shape (1 + watched, n); the next chunk
        overwrites them.

    Raises
    ------
    SimulatorAborted
        Newton's iterations fail, a switch chatters, or steps become too short for progress.
    """
    edges = np.array(contact.edges(s.contacts))
    device, state = device_of(s), _beginning(s, circuit, start)
    state.scalars[0].strictness = min(max(refinement, 1.0), FINEST) ** 4
    state.scalars[0].proposed = stepping.RESTART * path.spacing / steps_per_sample
    turns = [(round(time / path.spacing), line) for time, line in lines]
    record = empty_record(CHUNK)
    output = np.zeros((1 + len(circuit.measurement.watched), CHUNK + 72))
    spent, reached, plan = time.thread_time(), 0.0, NO_BREAKPOINTS
    moves = circuit.schedule.steps(path.spacing / steps_per_sample) if circuit.schedule else None
    most = max(AHEAD // steps_per_sample, 1) if moves else CHUNK
    for done, block in knot_blocks(path, stop, most):
        segment, count = 0, block.size - 1
        if moves:
            plan = moves.plan(done * steps_per_sample, count * steps_per_sample)
            spent = time.thread_time()
        while segment < count:
            if turns and done + segment >= turns[0][0]:
                _make_exact(state, turns.pop(0)[1])
            end = min(count, turns[0][0] - done) if turns else count
            segment, points, outcome, which = advance(
                device, circuit.tables, circuit.probes, state, edges, block, segment, end, done,
                path.spacing, steps_per_sample, steps_per_contact, plan, record, output,
            )  # fmt: skip
            now = state.scalars[0].time
            if now - reached > CRAWL * path.spacing / steps_per_sample:
                spent, reached = time.thread_time(), now
            elif time.thread_time() - spent > PATIENCE and outcome == FINE:
                outcome = CRAWLING
            if np.abs(state.y).max() > LARGEST_VOLTAGE:
                outcome = UNBOUNDED
            if outcome != FINE:
                raise _trouble(circuit, state, outcome, which)
            yield part(record, 0, points), output[:, :points]


def _make_exact(state, line):
    """Make the steps exact at another angular frequency, and discard cached factorisations."""
    scalars = state.scalars[0]
    scalars.line, scalars.timed_for = line, np.nan
    state.keys[:SLOTS] = np.nan


def _trouble(circuit, state, outcome, which):
    """The exception for a run that ended early, with the reason."""
    stopped = f"Monte Carlo stopped at t = {state.scalars[0].time:g}: "
    limited = [
        element.place
        for element in circuit.load.elements
        if any(leaf[0] in LIMITED for leaf in leaves(element.expression))
    ]
    if limited and not np.isfinite(state.values).all():
        return SimulatorAborted(
            f"{stopped}an expression has no value: a root, logarithm, arc function or power is "
            f"outside its domain: check {', '.join(limited[:3])}"
        )
    if outcome == UNBOUNDED:
        return SimulatorAborted(f"{stopped}{RUNAWAY}{suspicion(circuit.load)}")
    if outcome == CHATTER:
        name, where = circuit.switches[which]
        return LoadChatters(
            f"{stopped}the switch {name} ({where}) chatters: it toggles more than "
            f"{stepping.MOST_SWITCHINGS} times within a step; give it a hysteresis"
        )
    if outcome == SOURCE_CHATTER:
        name, where = circuit.sources[which]
        return LoadChatters(f"{stopped}the source {name} ({where}) chatters: {SOURCE_CURE}")
    trouble = f"{STALLED}; the cause may be a current that jumps or grows without bound"
    if outcome != CRAWLING:
        moved = np.abs(state.change)
        name = circuit.names[int(np.argmax(np.where(np.isfinite(moved), moved, np.inf)))]
        trouble = (
            f"no step is short enough for the load at {name}; the cause may be a current that "
            "jumps, or a floating node: give the node a capacitor, or smooth the expression"
        )
    if jumping := jumping_sources(circuit.load.elements):
        names = ", ".join(source.place for source in jumping[:3])
        return LoadChatters(f"{stopped}{trouble}; {names} may chatter: {SOURCE_CURE}")
    return SimulatorAborted(f"{stopped}{trouble}{suspicion(circuit.load)}")


def _beginning(s, circuit, start):
    """Initial state of a realization."""
    state = fresh_state(circuit)
    scalars, y, tables = state.scalars[0], state.y, circuit.tables
    n = y.size
    x, v, electrical = start
    scalars.displacement = x
    scalars.held_speed = system.held_impact_speed(s, x, v)
    inner = contact.edges(s.contacts)[1:-1]
    scalars.zone = sum(x > edge if edge > 0.0 else x >= edge for edge in inner)
    scalars.proposed = 1.0
    start = circuit.tables.start
    y[:] = start[0] + electrical * (1.0 / circuit.probes.units[1]) * start[1]
    y[n - 1] = v
    state.largest[n - 1] = max(abs(v), timescales.angular_frequency(s))
    voltages = np.append(y, 0.0)
    state.iterated[:] = voltages[tables.junctions[:, 0]] - voltages[tables.junctions[:, 1]]
    state.voltages[:] = state.before[:] = state.iterated
    # Before the first step: computes the charges of the junctions.
    call_once(circuit.code.finish, state.address, state.slots)
    state.charges[:] = state.new_charges
    return state
