"""The linear part of the equations, eliminated once for a step size and a state of the switches.

Rows and columns in which nothing but linear elements stand are eliminated first; what is left, the
core, takes the junctions' slopes in every iteration of Newton's and is solved anew.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from circuits.kernel.tables import Tables
from harvester.compilation import compiled

# Factors kept at a time, and a pivot's size, against its row, that is too small for one.
SLOTS = 32
SMALL_PIVOT = 1e-12
# A row that is all zeros up to rounding: nothing determines its unknown.
NO_PIVOT = 1e-30


class Factors(NamedTuple):
    """Eliminated matrices of up to `SLOTS` step sizes and states of the switches.

    Attributes
    ----------
    matrix : (SLOTS, n, n) multipliers and what is left, in the order of elimination.
    rows, columns : (SLOTS, n) which row and column stands at each place.
    row_places, column_places : (SLOTS, n + 1) the place of each row and column; of the one behind
        the last, which stands for ground, the place behind the core's last.
    weights : (SLOTS, n) one over the greatest number of each row, by place.
    eliminated : (SLOTS,) rows eliminated; the core are the others.
    keys : (SLOTS, 2) step and switches that a slot is for; a step of 0: empty.
    """

    matrix: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    row_places: np.ndarray
    column_places: np.ndarray
    weights: np.ndarray
    eliminated: np.ndarray
    keys: np.ndarray


def empty_factors(n: int) -> Factors:
    """Factors of nothing yet for n unknowns."""
    return Factors(
        np.zeros((SLOTS, n, n)),
        np.zeros((SLOTS, n), dtype=np.int64),
        np.zeros((SLOTS, n), dtype=np.int64),
        np.zeros((SLOTS, n + 1), dtype=np.int64),
        np.zeros((SLOTS, n + 1), dtype=np.int64),
        np.zeros((SLOTS, n)),
        np.zeros(SLOTS, dtype=np.int64),
        np.zeros((SLOTS, 2)),
    )


@compiled
def slot_of(tables: Tables, factors: Factors, closed: np.ndarray, delta: float) -> int:
    """The slot that holds the factors for a step's δ, filled if need be."""
    key = 0.0
    for k in range(closed.size):
        key = 2.0 * key + closed[k]
    place = int((np.abs(np.log2(delta)) * 5.0 + 7.0 * key) % SLOTS)
    if factors.keys[place, 0] != delta or factors.keys[place, 1] != key:
        factors.keys[place, 0], factors.keys[place, 1] = delta, key
        _eliminate(tables, factors, closed, delta, place)
    return place


@compiled
def _eliminate(tables, factors, closed, delta, slot):
    n = tables.steady.size
    matrix = factors.matrix[slot]
    matrix[:] = 0.0
    entries = tables.entries
    for k in range(entries.shape[0]):
        change = tables.capacity[k] + delta * tables.conductance[k]
        matrix[entries[k, 0], entries[k, 1]] += change
    for k in range(closed.size):
        a, z = tables.switches[k, 0], tables.switches[k, 1]
        change = delta * tables.switch_values[k, closed[k]]
        if a < n:
            matrix[a, a] += change
        if z < n:
            matrix[z, z] += change
        if a < n and z < n:
            matrix[a, z] -= change
            matrix[z, a] -= change
    rows, columns = factors.rows[slot], factors.columns[slot]
    weights = factors.weights[slot]
    for i in range(n):
        rows[i] = columns[i] = i
        size = 0.0
        for j in range(n):
            size = max(size, abs(matrix[i, j]))
        weights[i] = 1.0 / max(size, NO_PIVOT)
    done = 0
    # Columns in order; one without a row of its own waits for the core.
    for candidate in range(n):
        if tables.nonlinear_columns[candidate]:
            continue
        place = done
        while columns[place] != candidate:
            place += 1
        best, found = SMALL_PIVOT, -1
        for i in range(done, n):
            if not tables.nonlinear_rows[rows[i]]:
                size = abs(matrix[i, place]) * weights[i]
                if size > best:
                    best, found = size, i
        if found < 0:
            continue
        _swap(matrix, rows, columns, weights, done, found, place)
        pivot = matrix[done, done]
        for i in range(done + 1, n):
            if matrix[i, done] != 0.0:
                share = matrix[i, done] / pivot
                matrix[i, done] = share
                for j in range(done + 1, n):
                    matrix[i, j] -= share * matrix[done, j]
        done += 1
    factors.eliminated[slot] = done
    for i in range(n):
        factors.row_places[slot, rows[i]] = i - done
        factors.column_places[slot, columns[i]] = i - done
    factors.row_places[slot, n] = factors.column_places[slot, n] = n - done


@compiled
def _swap(matrix, rows, columns, weights, done, row, column):
    n = rows.size
    if row != done:
        for j in range(n):
            matrix[done, j], matrix[row, j] = matrix[row, j], matrix[done, j]
        rows[done], rows[row] = rows[row], rows[done]
        weights[done], weights[row] = weights[row], weights[done]
    if column != done:
        for i in range(n):
            matrix[i, done], matrix[i, column] = matrix[i, column], matrix[i, done]
        columns[done], columns[column] = columns[column], columns[done]


@compiled
def forward(
    matrix: np.ndarray, rows: np.ndarray, eliminated: int, right: np.ndarray, out: np.ndarray
) -> None:
    """Right-hand side in the order of elimination, the linear rows eliminated from it."""
    n = rows.size
    for i in range(n):
        out[i] = right[rows[i]]
    for k in range(eliminated):
        value = out[k]
        if value != 0.0:
            for i in range(k + 1, n):
                out[i] -= matrix[i, k] * value


@compiled
def backward(
    matrix: np.ndarray, columns: np.ndarray, eliminated: int, out: np.ndarray, solution: np.ndarray
) -> None:
    """Linear unknowns from those of the core, which stand in `out` behind the eliminated rows."""
    n = columns.size
    for k in range(eliminated - 1, -1, -1):
        total = out[k]
        for j in range(k + 1, n):
            total -= matrix[k, j] * out[j]
        out[k] = total / matrix[k, k]
    for k in range(n):
        solution[columns[k]] = out[k]


@compiled
def decompose(core: np.ndarray, size: int, weights: np.ndarray, order: np.ndarray) -> bool:
    """L and U of the core in place, rows by `order`; whether there are any."""
    for k in range(size):
        order[k] = k
    for k in range(size):
        best, found = -1.0, k
        for i in range(k, size):
            pivot = abs(core[order[i], k]) * weights[order[i]]
            if pivot > best:
                best, found = pivot, i
        order[k], order[found] = order[found], order[k]
        row = order[k]
        pivot = core[row, k]
        if not abs(pivot) > 0.0:
            return False
        for i in range(k + 1, size):
            other = order[i]
            if core[other, k] != 0.0:
                share = core[other, k] / pivot
                core[other, k] = share
                for j in range(k + 1, size):
                    core[other, j] -= share * core[row, j]
    return True


@compiled
def solve(
    core: np.ndarray, size: int, order: np.ndarray, right: np.ndarray, solution: np.ndarray
) -> None:
    """The core's unknowns."""
    for i in range(size):
        total = right[order[i]]
        for j in range(i):
            total -= core[order[i], j] * solution[j]
        solution[i] = total
    for i in range(size - 1, -1, -1):
        row = order[i]
        total = solution[i]
        for j in range(i + 1, size):
            total -= core[row, j] * solution[j]
        solution[i] = total / core[row, i]
