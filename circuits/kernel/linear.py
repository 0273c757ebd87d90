"""The order in which the equations are eliminated, found once for a circuit, and elimination by it.

Only what is not zero is touched: the order of pivots and the places of all numbers are a list that
one compiled loop works through. Rows and columns in which nothing but linear elements stand come
first and are eliminated once for a step size and a state of the switches; what is left, the core,
takes the junctions' slopes and is eliminated anew in every iteration of Newton's.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from harvester.compilation import inlined

if TYPE_CHECKING:
    from circuits.kernel.tables import Tables

# Factors kept at a time.
SLOTS = 24
# A pivot against the greatest number of its column, in every trial; what a column without one
# makes do with.
PIVOT_SHARES = (1e-3, 1e-6, 1e-12, 0.0)
# Steps (s) and conductances of junctions (S) at which pivots are tried.
TRIAL_STEPS = (1e-3, 1e-5, 1e-8)
TRIAL_CONDUCTANCES = (1e-12, 1e-6, 1e-2, 10.0)
TRIALS = 16


class Order(NamedTuple):
    """The list of an elimination; places are those of numbers that are not zero, int64.

    Attributes
    ----------
    rows, columns : (n,) which row and which unknown stands at each position.
    row_position, column_position : (n + 1,) their positions; of ground, n.
    linear : pivots before the core, and the place at which its numbers begin.
    entry_places : (k,) of the tables' entries; `switch_places`, `junction_places` (k, 4), each
        (a, a), (z, z), (a, z), (z, a); `input_places` (k, 2); `motion_place`.
    pivots : (n, 3) place of each pivot, first of its rows in `lower`, first of `upper`.
    lower : (k, 3) position of a row, place of its number below the pivot, first of `updates`.
    upper : (k, 2) position of an unknown, place of its number beside the pivot.
    updates : places of what each row below loses, in the order of `upper`.
    """

    rows: np.ndarray
    columns: np.ndarray
    row_position: np.ndarray
    column_position: np.ndarray
    linear: tuple[int, int, int]
    entry_places: np.ndarray
    switch_places: np.ndarray
    junction_places: np.ndarray
    input_places: np.ndarray
    motion_place: int
    pivots: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    updates: np.ndarray


def order_of(tables: Tables) -> Order:
    """The order of elimination of a circuit."""
    pattern, trials = _trials(tables)
    rows, columns, linear, filled = _pivots(tables, pattern, trials)
    n = len(rows)
    row_position, column_position = (_inverse(each) for each in (rows, columns))
    there = np.zeros((n + 1, n + 1), dtype=bool)
    there[:n, :n] = filled[np.ix_(rows, columns)]
    core = np.zeros_like(there)
    core[linear:, linear:] = True
    places = np.full((n + 1, n + 1), -1, dtype=np.int64)
    outside = there & ~core
    places[outside] = np.arange(outside.sum())
    inside = there & core
    places[inside] = outside.sum() + np.arange(inside.sum())
    count = int(there.sum())
    # Where ground's numbers go.
    places[n, :] = places[:, n] = count

    def place(row, column):
        return places[row_position[row], column_position[column]]

    def four(a, z):
        return [place(a, a), place(z, z), place(a, z), place(z, a)]

    inputs = [
        [place(tables.behavioural[k, 0], unknown), place(tables.behavioural[k, 1], unknown)]
        for k, _, unknown in tables.inputs
    ]
    return Order(
        rows,
        columns,
        row_position,
        column_position,
        (linear, int(outside.sum()), count),
        np.array([place(*entry) for entry in tables.entries], dtype=np.int64),
        _table([four(*each[:2]) for each in tables.switches], 4),
        _table([four(*each) for each in tables.junctions], 4),
        _table(inputs, 2),
        int(place(n - 1, n - 1)),
        *_list(there[:n, :n], places, n),
    )


def _table(rows, width):
    return np.array(rows, dtype=np.int64).reshape(-1, width)


def _inverse(order):
    found = np.empty(len(order) + 1, dtype=np.int64)
    found[order] = np.arange(len(order))
    found[-1] = len(order)
    return found


def _trials(tables):
    """Where the matrix may not be zero, and equilibrated matrices of several states."""
    n = tables.steady.size
    random = np.random.default_rng(1)
    pattern = np.zeros((n + 1, n + 1), dtype=bool)
    matrices = np.zeros((TRIALS, n + 1, n + 1))
    for trial in range(TRIALS):
        matrix = matrices[trial]
        delta = TRIAL_STEPS[trial % len(TRIAL_STEPS)]
        values = tables.capacity + delta * tables.conductance
        np.add.at(matrix, tuple(tables.entries.T), values)
        pattern[tuple(tables.entries.T)] = True
        closed = random.integers(0, 2, len(tables.switches)) if trial > 1 else trial
        closed = np.broadcast_to(closed, len(tables.switches))
        for k, each in enumerate(tables.switches):
            _stamp(matrix, pattern, each[:2], delta * tables.switch_values[k, closed[k]])
        for each in tables.junctions:
            _stamp(matrix, pattern, each, delta * random.choice(TRIAL_CONDUCTANCES))
        for k, _, unknown in tables.inputs:
            slope = delta * random.choice([-1.0, 1.0]) * 10.0 ** random.uniform(-6.0, 0.0)
            for row, sign in zip(tables.behavioural[k, :2], (1.0, -1.0), strict=True):
                matrix[row, unknown] += sign * slope
                pattern[row, unknown] = True
    pattern[n - 1, n - 1] = True
    matrices = matrices[:, :n, :n]
    for _ in range(3):
        for axis in (2, 1):
            size = np.abs(matrices).max(axis=axis, keepdims=True)
            matrices = matrices / np.where(size > 0.0, size, 1.0)
    return pattern[:n, :n], matrices


def _stamp(matrix, pattern, ends, value):
    a, z = ends
    for row, column, sign in ((a, a, 1.0), (z, z, 1.0), (a, z, -1.0), (z, a, -1.0)):
        matrix[row, column] += sign * value
        pattern[row, column] = True


def _pivots(tables, pattern, trials):
    """Rows and unknowns in order, how many are linear, and where numbers then stand."""
    n = len(pattern)
    filled, work = pattern.copy(), trials.copy()
    free_rows, free_columns = np.ones(n, dtype=bool), np.ones(n, dtype=bool)
    rows, columns = [], []
    linear = None
    while len(rows) < n:
        chosen = None
        if linear is None:
            allowed = np.outer(
                free_rows & ~tables.nonlinear_rows, free_columns & ~tables.nonlinear_columns
            )
            chosen = _best(filled, work, allowed, free_rows, free_columns, PIVOT_SHARES[:1])
            if chosen is None:
                linear = len(rows)
        if chosen is None:
            allowed = np.outer(free_rows, free_columns)
            chosen = _best(filled, work, allowed, free_rows, free_columns, PIVOT_SHARES)
        if chosen is None:
            # Singular in every trial: elimination will tell.
            chosen = int(np.flatnonzero(free_rows)[0]), int(np.flatnonzero(free_columns)[0])
            filled[chosen] = True
        i, j = chosen
        free_rows[i] = free_columns[j] = False
        rows.append(i)
        columns.append(j)
        below = free_rows & filled[:, j]
        beside = free_columns & filled[i]
        filled |= np.outer(below, beside)
        pivot = work[:, i, j]
        share = np.where(below, work[:, :, j], 0.0) / np.where(pivot == 0.0, 1.0, pivot)[:, None]
        work -= share[:, :, None] * np.where(beside, work[:, i, :], 0.0)[:, None, :]
    return (
        np.array(rows, dtype=np.int64),
        np.array(columns, dtype=np.int64),
        n if linear is None else linear,
        filled,
    )


def _best(filled, work, allowed, free_rows, free_columns, shares):
    """The pivot with the least fill-in among those great enough in every trial, or None."""
    allowed = allowed & filled
    if not allowed.any():
        return None
    active = np.abs(work) * free_rows[None, :, None]
    greatest = active.max(axis=1, keepdims=True)
    size = (active / np.where(greatest > 0.0, greatest, np.inf)).min(axis=0)
    live = filled & np.outer(free_rows, free_columns)
    fill = np.outer(live.sum(axis=1) - 1, live.sum(axis=0) - 1)
    for least in shares:
        good = allowed & (size >= least)
        if good.any():
            cost = np.where(good, fill + 1e-3 * (1.0 - size), np.inf)
            return tuple(int(k) for k in np.unravel_index(np.argmin(cost), cost.shape))
    return None


def _list(there, places, n):
    """pivots, lower, upper and updates of an `Order`."""
    pivots, lower, upper, updates = [], [], [], []
    for k in range(n):
        pivots.append((places[k, k], len(lower), len(upper)))
        beside = [j for j in range(k + 1, n) if there[k, j]]
        for i in range(k + 1, n):
            if there[i, k]:
                lower.append((i, places[i, k], len(updates)))
                updates += [places[i, j] for j in beside]
        upper += [(j, places[k, j]) for j in beside]
    pivots.append((0, len(lower), len(upper)))
    return _table(pivots, 3), _table(lower, 3), _table(upper, 2), np.array(updates, dtype=np.int64)


@inlined
def slot_of(
    tables: Tables, order: Order, matrix: np.ndarray, keys: np.ndarray, closed: np.ndarray,
    delta: float,
) -> int:  # fmt: skip
    """The row of `matrix` with the factors for a step's δ, filled if need be.

    `keys`, shape (SLOTS + 1, 2), say what the rows are for, and last which is next; `matrix`, shape
    (SLOTS + 1, places + 1), has one more for the core.
    """
    key = 0.0
    for k in range(closed.size):
        key = 2.0 * key + closed[k]
    slot = 0
    # In a ring: the steps of late are near.
    while slot < SLOTS and not (keys[slot, 0] == delta and keys[slot, 1] == key):
        slot += 1
    if slot == SLOTS:
        slot = int(keys[SLOTS, 0])
        keys[SLOTS, 0] = (slot + 1) % SLOTS
        keys[slot, 0], keys[slot, 1] = delta, key
        for k in range(matrix.shape[1]):
            matrix[slot, k] = 0.0
        for k in range(order.entry_places.size):
            change = tables.capacity[k] + delta * tables.conductance[k]
            matrix[slot, order.entry_places[k]] += change
        for k in range(closed.size):
            change = delta * tables.switch_values[k, closed[k]]
            matrix[slot, order.switch_places[k, 0]] += change
            matrix[slot, order.switch_places[k, 1]] += change
            matrix[slot, order.switch_places[k, 2]] -= change
            matrix[slot, order.switch_places[k, 3]] -= change
        linear = order.linear[0]
        eliminate(order.pivots, order.lower, order.upper, order.updates, 0, linear, matrix, slot)
    return slot


@inlined
def eliminate(
    pivots: np.ndarray, lower: np.ndarray, upper: np.ndarray, updates: np.ndarray, start: int,
    stop: int, matrix: np.ndarray, slot: int,
) -> None:  # fmt: skip
    """Eliminate the pivots from `start` to `stop` in one row of `matrix`; pivots get inverted."""
    for k in range(start, stop):
        place = pivots[k, 0]
        inverse = 1.0 / matrix[slot, place]
        matrix[slot, place] = inverse
        begin, end = pivots[k, 2], pivots[k + 1, 2]
        for r in range(pivots[k, 1], pivots[k + 1, 1]):
            share = matrix[slot, lower[r, 1]] * inverse
            matrix[slot, lower[r, 1]] = share
            update = lower[r, 2] - begin
            for c in range(begin, end):
                matrix[slot, updates[update + c]] -= share * matrix[slot, upper[c, 1]]


@inlined
def forward(
    pivots: np.ndarray, lower: np.ndarray, start: int, stop: int, matrix: np.ndarray, slot: int,
    right: np.ndarray,
) -> None:  # fmt: skip
    """Eliminate from a right-hand side in the order of pivots."""
    for k in range(start, stop):
        value = right[k]
        for r in range(pivots[k, 1], pivots[k + 1, 1]):
            right[lower[r, 0]] -= matrix[slot, lower[r, 1]] * value


@inlined
def backward(
    pivots: np.ndarray, upper: np.ndarray, start: int, stop: int, matrix: np.ndarray, slot: int,
    right: np.ndarray,
) -> None:  # fmt: skip
    """The unknowns from `stop` back to `start` in place of the right-hand side."""
    for k in range(stop - 1, start - 1, -1):
        total = right[k]
        for c in range(pivots[k, 2], pivots[k + 1, 2]):
            total -= matrix[slot, upper[c, 1]] * right[upper[c, 0]]
        right[k] = total * matrix[slot, pivots[k, 0]]
