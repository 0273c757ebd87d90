"""One implicit stage of a step: Newton's iterations on the circuit and the motion together.

Every stage asks for the change u of the unknowns y since the step's beginning in

    C u + q(y + u) − q(y) + δ [G (y + u) + i(y + u) − s] = r,

and for X = X₀ + δ X'. In changes, because a storage capacitor's charge would round a diode's
current away.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from circuits.kernel import junction, tape, waveform
from circuits.kernel.linear import SLOTS, Order, backward, eliminate, forward
from circuits.kernel.tables import Tables
from harvester.compilation import compiled, inlined
from harvester.device import spring as springs
from harvester.device import system as systems

MOST_ITERATIONS = 40
# Newton's step at which the iterations end; the next would be about its square. Of a junction,
# against its swing: its current is then known to 5e-5. Of the velocity out of contact, where the
# force is smooth, against its greatest so far; of other unknowns, and in contact.
JUNCTION_STEP, SMOOTH_STEP, RELATIVE_STEP = 1e-2, 1e-2, 1e-5
# Of a displacement and a velocity, for slopes of the force.
DIFFERENCE = 1e-6


class Work(NamedTuple):
    """Room for a stage; arrays of n unknowns, m junctions, k operations.

    Attributes
    ----------
    right : (n,) right-hand side.
    ordered, solution : (n + 1,) the same in the order of pivots, the linear ones eliminated; and
        what becomes of it. Ground last.
    matrix : (SLOTS + 1, places + 1) numbers of the matrix by `circuits.kernel.linear.Order`, the
        core of the iteration at hand last; `keys` (SLOTS, 2) what the others are for.
    voltages : (m,) of the junctions, as iterated, `currents` and `slopes` (m,) there; `charges`
        (m,) at the step's beginning.
    values, shares : (k,) of the tape.
    begin, latest : (n + 1,) y and y + u of the last iteration, ground last.
    sizes : (n,) greatest size of each unknown so far.
    """

    right: np.ndarray
    ordered: np.ndarray
    solution: np.ndarray
    matrix: np.ndarray
    keys: np.ndarray
    voltages: np.ndarray
    currents: np.ndarray
    slopes: np.ndarray
    charges: np.ndarray
    values: np.ndarray
    shares: np.ndarray
    begin: np.ndarray
    latest: np.ndarray
    sizes: np.ndarray


def room(tables: Tables, order: Order) -> Work:
    """Work for a circuit."""
    n, m = tables.steady.size, len(tables.junctions)
    k = len(tables.tape)
    return Work(
        np.zeros(n), np.zeros(n + 1), np.zeros(n + 1), np.zeros((SLOTS + 1, order.linear[2] + 1)),
        np.zeros((SLOTS + 1, 2)), np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m),
        tables.tape_values.copy(), np.zeros(k), np.zeros(n + 1), np.zeros(n + 1), np.full(n, 1e-9),
    )  # fmt: skip


@inlined
def force(s: Any, touching: bool, low: float, high: float, held: float, x: float, v: float) -> Any:
    """Spring, damper and the contacts that act, against the motion."""
    total = springs.force(s.spring, x) + systems.part_force(s.damper, v)
    if touching:
        total += systems.contact_force(s, x, v, held, low, high)
    return total


@inlined
def add_sources(tables: Tables, right: np.ndarray, time: float, delta: float) -> None:
    """δ s onto a right-hand side."""
    for i in range(right.size):
        right[i] += delta * tables.steady[i]
    for k in range(tables.sources.shape[0]):
        kind = tables.sources[k, 1]
        size = waveform.value(kind, tables.waves[k], tables.corners, time)
        right[tables.sources[k, 0]] += delta * size


@inlined
def add_conducted(
    tables: Tables, closed: np.ndarray, y: np.ndarray, out: np.ndarray, factor: float
) -> None:
    """Times a factor, G y onto a vector; the switches as they are."""
    entries, n = tables.entries, y.size
    for k in range(entries.shape[0]):
        if tables.conductance[k] != 0.0:
            out[entries[k, 0]] += factor * tables.conductance[k] * y[entries[k, 1]]
    for k in range(closed.size):
        a, z = tables.switches[k, 0], tables.switches[k, 1]
        across = (y[a] if a < n else 0.0) - (y[z] if z < n else 0.0)
        through = factor * tables.switch_values[k, closed[k]] * across
        if a < n:
            out[a] += through
        if z < n:
            out[z] -= through


@inlined
def add_stored(tables: Tables, u: np.ndarray, out: np.ndarray) -> None:
    """C u onto a vector."""
    entries = tables.entries
    for k in range(entries.shape[0]):
        if tables.capacity[k] != 0.0:
            out[entries[k, 0]] += tables.capacity[k] * u[entries[k, 1]]


@inlined
def add_junction_charge(tables: Tables, work: Work, out: np.ndarray) -> None:
    """Change of the junctions' charges since the step's beginning onto a vector."""
    n = out.size
    for k in range(work.voltages.size):
        if not junction.holds_charge(tables.junction_values, k):
            continue
        v = work.voltages[k]
        through, slope = junction.current(tables.junction_values, k, v)
        stored = junction.charge(tables.junction_values, k, v, through, slope)[0]
        a, z = tables.junctions[k, 0], tables.junctions[k, 1]
        if a < n:
            out[a] += stored - work.charges[k]
        if z < n:
            out[z] -= stored - work.charges[k]


@inlined
def _add_junctions(tables, order, work, delta):
    """The junctions' slopes and currents at their voltages into core and right-hand side."""
    matrix, right, places = work.matrix, work.solution, order.junction_places
    for k in range(work.voltages.size):
        v = work.voltages[k]
        through, slope = junction.current(tables.junction_values, k, v)
        work.currents[k], work.slopes[k] = through, slope
        a, z = tables.junctions[k, 0], tables.junctions[k, 1]
        share = 1.0 / (1.0 + slope * tables.junction_values[k, junction.RESISTANCE])
        g = delta * slope * share
        i = delta * through * share
        if junction.holds_charge(tables.junction_values, k):
            stored, capacitance = junction.charge(tables.junction_values, k, v, through, slope)
            g += capacitance
            i += stored - work.charges[k]
        # Both in terms of the change u: at u = 0 the voltage is that of the step's beginning.
        i += g * (work.begin[a] - work.begin[z] - v)
        matrix[SLOTS, places[k, 0]] += g
        matrix[SLOTS, places[k, 1]] += g
        matrix[SLOTS, places[k, 2]] -= g
        matrix[SLOTS, places[k, 3]] -= g
        right[order.row_position[a]] -= i
        right[order.row_position[z]] += i


@inlined
def _move_junctions(tables, order, work):
    """Junction voltages after an iteration; whether all moved by little."""
    settled = True
    position, solution = order.column_position, work.solution
    for k in range(work.voltages.size):
        a, z = tables.junctions[k, 0], tables.junctions[k, 1]
        across = work.begin[a] - work.begin[z] + solution[position[a]] - solution[position[z]]
        old = work.voltages[k]
        through, slope = work.currents[k], work.slopes[k]
        resistance = tables.junction_values[k, junction.RESISTANCE]
        predicted = (through + slope * (across - old)) / (1.0 + slope * resistance)
        new = across - resistance * predicted
        chosen = junction.limited(tables.junction_values, k, old, new, predicted)
        # Deep in its blocked state a junction's current hardly knows its voltage.
        free = JUNCTION_STEP * (
            tables.junction_values[k, junction.SWING] + 1e-2 * max(-chosen, 0.0)
        )
        if not (abs(chosen - old) <= free and abs(chosen - new) <= free):
            settled = False
        work.voltages[k] = chosen
    return settled


@compiled
def _add_behavioural(tables, order, work, delta, time):
    """Behavioural sources at the latest iterate into core and right-hand side."""
    matrix, right = work.matrix, work.solution
    tape.evaluate(tables.tape, work.values, work.latest, time)
    taken = 0
    for k in range(tables.behavioural.shape[0]):
        first, last = tables.behavioural[k, 2], tables.behavioural[k, 3]
        tape.slopes(tables.tape, work.values, work.shares, first, last)
        size = work.values[last]
        while taken < tables.inputs.shape[0] and tables.inputs[taken, 0] == k:
            slope, unknown = work.shares[tables.inputs[taken, 1]], tables.inputs[taken, 2]
            size += slope * (work.begin[unknown] - work.latest[unknown])
            matrix[SLOTS, order.input_places[taken, 0]] += delta * slope
            matrix[SLOTS, order.input_places[taken, 1]] -= delta * slope
            taken += 1
        right[order.row_position[tables.behavioural[k, 0]]] -= delta * size
        right[order.row_position[tables.behavioural[k, 1]]] += delta * size


@inlined
def _near(order, work, only_motion, smooth):
    """Whether the core's unknowns moved by little; the latest iterate becomes theirs."""
    n = work.sizes.size
    settled = True
    for position in range(order.linear[0], n):
        unknown = order.columns[position]
        if only_motion and unknown != n - 1:
            continue
        new = work.begin[unknown] + work.solution[position]
        moved = abs(new - work.latest[unknown])
        # Not a number is not near.
        free = SMOOTH_STEP if smooth and unknown == n - 1 else RELATIVE_STEP
        settled = settled and moved <= free * max(work.sizes[unknown], abs(new))
        work.latest[unknown] = new
    return settled


@inlined
def solve_stage(
    s: Any,
    tables: Tables,
    order: Order,
    work: Work,
    slot: int,
    delta: float,
    time: float,
    x_base: float,
    zone: Any,
    row_unit: float,
    change: np.ndarray,
) -> bool:
    """Fill `change` with u; whether Newton's iterations came to an end.

    Parameters
    ----------
    s : harvester.device.system.System
    tables, order, work, slot
        `work.right` holds r + δ (s − G y) with the force of the base, `work.latest` a guess of
        y + u, `work.voltages` one of the junctions'.
    delta, time : float
    x_base : float
        X less δ X' of the stage.
    zone : (bool, float, float, float)
        Whether contacts act, between which displacements, and the held speed.
    row_unit : float
        Of the velocity's row.
    change : ndarray, shape (n,)
    """
    n = work.right.size
    touching, low, high, held = zone
    linear, first, last = order.linear
    matrix, ordered, solution = work.matrix, work.ordered, work.solution
    pivots, lower, upper = order.pivots, order.lower, order.upper
    for i in range(n):
        ordered[i] = work.right[order.rows[i]]
    forward(pivots, lower, 0, linear, matrix, slot, ordered)
    position = order.row_position[n - 1]
    v = work.latest[n - 1]
    pull = force(s, touching, low, high, held, x_base + delta * v, v)
    nearby = DIFFERENCE * work.sizes[n - 1]
    slope = force(s, touching, low, high, held, x_base + delta * (v + nearby), v + nearby)
    slope = delta * row_unit * (slope - pull) / nearby
    settled = False
    for _ in range(MOST_ITERATIONS):
        for place in range(first, last):
            matrix[SLOTS, place] = matrix[slot, place]
        for i in range(linear, n):
            solution[i] = ordered[i]
        solution[n] = 0.0
        matrix[SLOTS, order.motion_place] += slope
        solution[position] -= delta * row_unit * pull - slope * (v - work.begin[n - 1])
        _add_junctions(tables, order, work, delta)
        if tables.behavioural.shape[0] > 0:
            _add_behavioural(tables, order, work, delta, time)
        eliminate(pivots, lower, upper, order.updates, linear, n, matrix, SLOTS)
        solution[n] = 0.0
        forward(pivots, lower, linear, n, matrix, SLOTS, solution)
        backward(pivots, upper, linear, n, matrix, SLOTS, solution)
        settled = _move_junctions(tables, order, work)
        settled &= _near(order, work, tables.behavioural.shape[0] == 0, not touching)
        if settled:
            break
        v = work.latest[n - 1]
        pull = force(s, touching, low, high, held, x_base + delta * v, v)
    _finish(order, work, slot, change)
    return settled


@inlined
def _finish(order, work, slot, out):
    """Linear unknowns from those of the core, all in the tables' order."""
    n, linear = work.right.size, order.linear[0]
    for i in range(linear):
        work.solution[i] = work.ordered[i]
    backward(order.pivots, order.upper, 0, linear, work.matrix, slot, work.solution)
    for i in range(n):
        out[order.columns[i]] = work.solution[i]


@inlined
def error_energy(
    order: Order, work: Work, slot: int, error: np.ndarray, filtered: np.ndarray
) -> float:
    """Energy (J) of a step's error in the circuit; `error` is that of C y + q, `filtered` room.

    Through the equations of the last iteration: what decays within the step counts as little as
    it lasts.
    """
    n, linear = error.size, order.linear[0]
    pivots, lower = order.pivots, order.lower
    for i in range(n):
        work.ordered[i] = error[order.rows[i]]
    forward(pivots, lower, 0, linear, work.matrix, slot, work.ordered)
    for i in range(linear, n):
        work.solution[i] = work.ordered[i]
    forward(pivots, lower, linear, n, work.matrix, SLOTS, work.solution)
    backward(pivots, order.upper, linear, n, work.matrix, SLOTS, work.solution)
    _finish(order, work, slot, filtered)
    total = 0.0
    for i in range(n - 1):
        total += abs(error[i] * filtered[i])
    return total
