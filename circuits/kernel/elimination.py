"""Elimination as straight-line code, number by number, for `circuits.kernel.code`.

A matrix is a dictionary of its nonzero numbers, by row and column in the order of pivots.
"""

from __future__ import annotations

from circuits.kernel.emitter import Number

Matrix = dict[tuple[int, int], Number]


def add(matrix: Matrix, where: tuple[int, int], value: Number) -> None:
    """Add to one of the matrix's numbers."""
    matrix[where] = matrix[where] + value if where in matrix else value


def eliminate(matrix: Matrix, start: int, stop: int) -> None:
    """LU elimination in place: pivots become their inverses, entries below them the multipliers."""
    for k in range(start, stop):
        inverse = 1.0 / matrix[k, k]
        matrix[k, k] = inverse
        below = [i for i, j in matrix if j == k and i > k]
        beside = [j for i, j in matrix if i == k and j > k]
        for i in below:
            share = matrix[i, k] * inverse
            matrix[i, k] = share
            for j in beside:
                add(matrix, (i, j), -(share * matrix[k, j]))


def forward(matrix: Matrix, values: list[Number], start: int, stop: int) -> None:
    """Eliminate from a right-hand side in the order of pivots."""
    for k in range(start, stop):
        for i, j in matrix:
            if j == k and i > k:
                values[i] = values[i] - matrix[i, k] * values[k]


def backward(matrix: Matrix, values: list[Number], start: int, stop: int) -> None:
    """Back substitution from `stop` to `start`: the right-hand side becomes the unknowns."""
    for k in range(stop - 1, start - 1, -1):
        for i, j in matrix:
            if i == k and j > k:
                values[k] = values[k] - matrix[k, j] * values[j]
        values[k] = values[k] * matrix[k, k]
