"""The order of elimination of a circuit's equations, determined once.

Only nonzero entries are processed. Rows and columns with only linear elements come first and are
eliminated once per step size and switch state. The remaining core contains the junctions' slopes
and is eliminated in every Newton iteration.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from circuits.kernel.tables import Tables

# In every trial a pivot must exceed the first share of the largest number in its column; columns
# without such a pivot use the next share.
PIVOT_SHARES = (1e-3, 1e-6, 1e-12, 0.0)
# Steps (s) and conductances of junctions (S) at which pivots are tried.
TRIAL_STEPS = (1e-3, 1e-5, 1e-8)
TRIAL_CONDUCTANCES = (1e-12, 1e-6, 1e-2, 10.0)
TRIALS = 16


class Order(NamedTuple):
    """The order of an elimination.

    Attributes
    ----------
    rows, columns : (n,) row and unknown at each position, int64.
    linear : pivots before the core.
    places : memory index of each nonzero number, by (row, column) position; fill-in included.
    """

    rows: np.ndarray
    columns: np.ndarray
    linear: int
    places: dict[tuple[int, int], int]


def order_of(tables: Tables) -> Order:
    """The order of elimination of a circuit."""
    pattern, trials = _trials(tables)
    rows, columns, linear, filled = _pivots(tables, pattern, trials)
    nonzeros = np.argwhere(filled[np.ix_(rows, columns)])
    places = {(int(i), int(j)): index for index, (i, j) in enumerate(nonzeros)}
    return Order(rows, columns, linear, places)


def _trials(tables):
    """Nonzero pattern of the matrix, and equilibrated matrices of several states."""
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
        for k, switch in enumerate(tables.switches):
            _stamp(matrix, pattern, switch[:2], delta * tables.switch_values[k, closed[k]])
        for nodes in tables.junctions:
            _stamp(matrix, pattern, nodes, delta * random.choice(TRIAL_CONDUCTANCES))
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
    """Rows and unknowns in order, the number of linear ones, and positions of the numbers."""
    n = len(pattern)
    filled, work = pattern.copy(), trials.copy()
    free_rows, free_columns = np.ones(n, dtype=bool), np.ones(n, dtype=bool)
    linear_rows, linear_columns = ~tables.nonlinear_rows, ~tables.nonlinear_columns
    rows: list[int] = []
    columns: list[int] = []
    linear = None
    # The elimination of a pivot changes only the columns of its row.
    size, changed = np.zeros((n, n)), np.arange(n)
    while len(rows) < n:
        size[:, changed] = _sizes(work[:, :, changed], free_rows)
        chosen, live = None, filled & free_rows[:, None] & free_columns
        if linear is None:
            allowed = live & linear_rows[:, None] & linear_columns
            chosen = _best(live, size, allowed, PIVOT_SHARES[:1])
            if chosen is None:
                linear = len(rows)
        if chosen is None:
            chosen = _best(live, size, live, PIVOT_SHARES)
        if chosen is None:
            # The matrix is singular in every trial; the elimination reports it.
            chosen = int(np.flatnonzero(free_rows)[0]), int(np.flatnonzero(free_columns)[0])
            filled[chosen] = True
        i, j = chosen
        free_rows[i] = free_columns[j] = False
        rows.append(i)
        columns.append(j)
        below = np.flatnonzero(free_rows & filled[:, j])
        changed = np.flatnonzero(free_columns & filled[i])
        filled[np.ix_(below, changed)] = True
        pivot = work[:, i, j]
        share = work[:, below, j] / np.where(pivot == 0.0, 1.0, pivot)[:, None]
        work[:, below[:, None], changed] -= share[:, :, None] * work[:, i, changed][:, None, :]
    return (
        np.array(rows, dtype=np.int64),
        np.array(columns, dtype=np.int64),
        n if linear is None else linear,
        filled,
    )


def _sizes(columns, free_rows):
    """Smallest ratio, over all trials, of each number to the largest in its column."""
    active = np.abs(columns) * free_rows[:, None]
    greatest = active.max(axis=1, keepdims=True)
    return (active / np.where(greatest > 0.0, greatest, np.inf)).min(axis=0)


def _best(live, size, allowed, shares):
    """The pivot with the least fill-in that is large enough in every trial, or None."""
    i, j = np.nonzero(allowed)
    sizes = size[i, j]
    cost = (live.sum(axis=1) - 1)[i] * (live.sum(axis=0) - 1)[j] + 1e-3 * (1.0 - sizes)
    for least in shares:
        good = sizes >= least
        if good.any():
            best = np.argmin(np.where(good, cost, np.inf))
            return int(i[best]), int(j[best])
    return None
