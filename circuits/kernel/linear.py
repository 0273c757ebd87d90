"""The order in which the equations are eliminated, found once for a circuit, and elimination by it.

Only what is not zero is touched. Rows and columns in which nothing but linear elements stand come
first and are eliminated once for a step size and a state of the switches; what is left, the core,
takes the junctions' slopes and is eliminated anew in every iteration of Newton's.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from circuits.kernel.tables import Tables

# A pivot must exceed the first share of the greatest number in its column, in every trial. Columns
# without such a pivot take the next share.
PIVOT_SHARES = (1e-3, 1e-6, 1e-12, 0.0)
# Steps (s) and conductances of junctions (S) at which pivots are tried.
TRIAL_STEPS = (1e-3, 1e-5, 1e-8)
TRIAL_CONDUCTANCES = (1e-12, 1e-6, 1e-2, 10.0)
TRIALS = 16


class Order(NamedTuple):
    """The order of an elimination.

    Attributes
    ----------
    rows, columns : (n,) which row and which unknown stands at each position, int64.
    linear : pivots before the core.
    places : place of each number that is not zero, by (row, column) position; fill-in included.
    """

    rows: np.ndarray
    columns: np.ndarray
    linear: int
    places: dict[tuple[int, int], int]


def order_of(tables: Tables) -> Order:
    """The order of elimination of a circuit."""
    pattern, trials = _trials(tables)
    rows, columns, linear, filled = _pivots(tables, pattern, trials)
    there = np.argwhere(filled[np.ix_(rows, columns)])
    places = {(int(i), int(j)): place for place, (i, j) in enumerate(there)}
    return Order(rows, columns, linear, places)


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
    rows: list[int] = []
    columns: list[int] = []
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
            # The matrix is singular in every trial; the elimination reports it.
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
