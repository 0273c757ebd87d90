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
from circuits.kernel.linear import (
    Factors,
    backward,
    decompose,
    empty_factors,
    forward,
    solve,
)
from circuits.kernel.tables import Tables
from harvester.compilation import compiled, inlined
from harvester.device import spring as springs
from harvester.device import system as systems

MOST_ITERATIONS = 40
# A junction's step, against its swing, after which the next would change its current by less than
# 1e-6; of the other unknowns, against their size so far.
JUNCTION_STEP, RELATIVE_STEP = 1e-3, 1e-5
# Of a displacement and a velocity, for slopes of the force.
DIFFERENCE = 1e-6


class Work(NamedTuple):
    """Room for a stage; arrays of n unknowns, m junctions, k operations.

    Attributes
    ----------
    right, ordered : (n,) right-hand side and the same in the order of elimination.
    core : (n + 1, n + 1), `core_right`, `core_solution` (n + 1,), `order` (n,).
    voltages : (m,) of the junctions, as iterated; `charges` (m,) at the step's beginning.
    values, shares : (k,) of the tape.
    begin, latest : (n + 1,) y and y + u of the last iteration, ground last.
    sizes : (n,) greatest size of each unknown so far.
    """

    right: np.ndarray
    ordered: np.ndarray
    core: np.ndarray
    core_right: np.ndarray
    core_solution: np.ndarray
    order: np.ndarray
    voltages: np.ndarray
    charges: np.ndarray
    values: np.ndarray
    shares: np.ndarray
    begin: np.ndarray
    latest: np.ndarray
    sizes: np.ndarray


def room(tables: Tables) -> tuple[Work, Factors]:
    """Work and Factors for a circuit."""
    n, m = tables.steady.size, len(tables.junctions)
    k = len(tables.tape)
    work = Work(
        np.zeros(n), np.zeros(n), np.zeros((n + 1, n + 1)), np.zeros(n + 1), np.zeros(n + 1),
        np.zeros(n, dtype=np.int64), np.zeros(m), np.zeros(m), tables.tape_values.copy(),
        np.zeros(k), np.zeros(n + 1), np.zeros(n + 1), np.full(n, 1e-9),
    )  # fmt: skip
    return work, empty_factors(n)


@inlined
def force(s: Any, touching: bool, low: float, high: float, held: float, x: float, v: float) -> Any:
    """Spring, damper and the contacts that act, against the motion."""
    total = springs.force(s.spring, x) + systems.part_force(s.damper, v)
    if touching:
        total += systems.contact_force(s, x, v, held, low, high)
    return total


@compiled
def add_sources(tables: Tables, right: np.ndarray, time: float, delta: float) -> None:
    """δ s onto a right-hand side."""
    for i in range(right.size):
        right[i] += delta * tables.steady[i]
    for k in range(tables.sources.shape[0]):
        kind = tables.sources[k, 1]
        size = waveform.value(kind, tables.waves[k], tables.corners, time)
        right[tables.sources[k, 0]] += delta * size


@compiled
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


@compiled
def add_stored(tables: Tables, u: np.ndarray, out: np.ndarray) -> None:
    """C u onto a vector."""
    entries = tables.entries
    for k in range(entries.shape[0]):
        if tables.capacity[k] != 0.0:
            out[entries[k, 0]] += tables.capacity[k] * u[entries[k, 1]]


@compiled
def add_junction_charge(tables: Tables, work: Work, out: np.ndarray) -> None:
    """Change of the junctions' charges since the step's beginning onto a vector."""
    n = out.size
    for k in range(work.voltages.size):
        row = tables.junction_values[k]
        if row[junction.TRANSIT] == 0.0 and row[junction.CAPACITANCE] == 0.0:
            continue
        v = work.voltages[k]
        through, slope = junction.current(row, v)
        change = junction.charge(row, v, through, slope)[0] - work.charges[k]
        a, z = tables.junctions[k, 0], tables.junctions[k, 1]
        if a < n:
            out[a] += change
        if z < n:
            out[z] -= change


@compiled
def _add_junctions(tables, work, row_places, column_places, delta):
    """The junctions' slopes and currents at their voltages into core and right-hand side."""
    core, right = work.core, work.core_right
    for k in range(work.voltages.size):
        row = tables.junction_values[k]
        v = work.voltages[k]
        through, slope = junction.current(row, v)
        a, z = tables.junctions[k, 0], tables.junctions[k, 1]
        resistance = row[junction.RESISTANCE]
        share = 1.0 / (1.0 + slope * resistance)
        g = delta * slope * share
        i = delta * through * share
        if row[junction.TRANSIT] != 0.0 or row[junction.CAPACITANCE] != 0.0:
            stored, capacitance = junction.charge(row, v, through, slope)
            g += capacitance
            i += stored - work.charges[k]
        # Both in terms of the change u: at u = 0 the voltage is that of the step's beginning.
        i += g * (work.begin[a] - work.begin[z] - v)
        ra, rz = row_places[a], row_places[z]
        ca, cz = column_places[a], column_places[z]
        core[ra, ca] += g
        core[rz, cz] += g
        core[ra, cz] -= g
        core[rz, ca] -= g
        right[ra] -= i
        right[rz] += i


@compiled
def _move_junctions(tables, work, column_places):
    """Junction voltages after an iteration; whether all moved by little."""
    settled = True
    for k in range(work.voltages.size):
        row = tables.junction_values[k]
        a, z = tables.junctions[k, 0], tables.junctions[k, 1]
        across = work.begin[a] - work.begin[z]
        across += work.core_solution[column_places[a]] - work.core_solution[column_places[z]]
        old = work.voltages[k]
        through, slope = junction.current(row, old)
        resistance = row[junction.RESISTANCE]
        predicted = (through + slope * (across - old)) / (1.0 + slope * resistance)
        new = across - resistance * predicted
        chosen = junction.limited(row, old, new, predicted)
        # Deep in its blocked state a junction's current hardly knows its voltage.
        free = JUNCTION_STEP * (row[junction.SWING] + 1e-2 * max(-chosen, 0.0))
        if abs(chosen - old) > free or abs(chosen - new) > free:
            settled = False
        work.voltages[k] = chosen
    return settled


@compiled
def _add_behavioural(tables, work, row_places, column_places, delta, time):
    """Behavioural sources at the latest iterate into core and right-hand side."""
    core, right = work.core, work.core_right
    tape.evaluate(tables.tape, work.values, work.latest, time)
    taken = 0
    for k in range(tables.behavioural.shape[0]):
        first, last = tables.behavioural[k, 2], tables.behavioural[k, 3]
        tape.slopes(tables.tape, work.values, work.shares, first, last)
        to, away = row_places[tables.behavioural[k, 0]], row_places[tables.behavioural[k, 1]]
        size = work.values[last]
        while taken < tables.inputs.shape[0] and tables.inputs[taken, 0] == k:
            slope, unknown = work.shares[tables.inputs[taken, 1]], tables.inputs[taken, 2]
            size += slope * (work.begin[unknown] - work.latest[unknown])
            column = column_places[unknown]
            core[to, column] += delta * slope
            core[away, column] -= delta * slope
            taken += 1
        right[to] -= delta * size
        right[away] += delta * size


@compiled
def _near(work, columns, eliminated, only_last):
    """Whether the core's unknowns moved by little; the latest iterate becomes theirs."""
    n = work.sizes.size
    settled = True
    for place in range(n - eliminated):
        unknown = columns[eliminated + place]
        new = work.begin[unknown] + work.core_solution[place]
        if not only_last or unknown == n - 1:
            moved = abs(new - work.latest[unknown])
            size = max(work.sizes[unknown], abs(new))
            # Not a number is not near.
            settled = settled and moved <= RELATIVE_STEP * size
        work.latest[unknown] = new
    return settled


@inlined
def solve_stage(
    s: Any,
    tables: Tables,
    work: Work,
    factors: Factors,
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
    tables, work, factors, slot
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
    eliminated = factors.eliminated[slot]
    size = n - eliminated
    matrix, rows, columns = factors.matrix[slot], factors.rows[slot], factors.columns[slot]
    row_places, column_places = factors.row_places[slot], factors.column_places[slot]
    forward(matrix, rows, eliminated, work.right, work.ordered)
    row, column = row_places[n - 1], column_places[n - 1]
    v = work.latest[n - 1]
    pull = force(s, touching, low, high, held, x_base + delta * v, v)
    nearby = DIFFERENCE * work.sizes[n - 1]
    slope = force(s, touching, low, high, held, x_base + delta * (v + nearby), v + nearby)
    slope = delta * row_unit * (slope - pull) / nearby
    settled = False
    for _ in range(MOST_ITERATIONS):
        for i in range(size):
            for j in range(size):
                work.core[i, j] = matrix[eliminated + i, eliminated + j]
            work.core_right[i] = work.ordered[eliminated + i]
        work.core[row, column] += slope
        work.core_right[row] -= delta * row_unit * pull - slope * (v - work.begin[n - 1])
        _add_junctions(tables, work, row_places, column_places, delta)
        if tables.behavioural.shape[0] > 0:
            _add_behavioural(tables, work, row_places, column_places, delta, time)
        if not decompose(work.core, size, factors.weights[slot, eliminated:], work.order):
            break
        solve(work.core, size, work.order, work.core_right, work.core_solution)
        work.core_solution[size] = 0.0
        settled = _move_junctions(tables, work, column_places)
        settled &= _near(work, columns, eliminated, tables.behavioural.shape[0] == 0)
        if settled:
            break
        v = work.latest[n - 1]
        pull = force(s, touching, low, high, held, x_base + delta * v, v)
    for i in range(size):
        work.ordered[eliminated + i] = work.core_solution[i]
    backward(matrix, columns, eliminated, work.ordered, change)
    return settled


@compiled
def error_energy(
    work: Work, factors: Factors, slot: int, error: np.ndarray, filtered: np.ndarray
) -> float:
    """Energy (J) of a step's error in the circuit; `error` is that of C y + q, `filtered` room.

    Through the equations of the last iteration: what decays within the step counts as little as
    it lasts.
    """
    n = error.size
    eliminated = factors.eliminated[slot]
    size = n - eliminated
    matrix = factors.matrix[slot]
    forward(matrix, factors.rows[slot], eliminated, error, work.ordered)
    solve(work.core, size, work.order, work.ordered[eliminated:], work.core_solution)
    for i in range(size):
        work.ordered[eliminated + i] = work.core_solution[i]
    backward(matrix, factors.columns[slot], eliminated, work.ordered, filtered)
    total = 0.0
    for i in range(n - 1):
        total += abs(error[i] * filtered[i])
    return total
