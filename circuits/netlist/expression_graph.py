"""An expression as a list of operations in compiled code: values, and slopes in reverse mode."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from circuits.netlist import functions
from circuits.netlist.expression import ExpressionError, Tree, rebuilt
from circuits.netlist.functions import CODES, slope, value
from harvester.base.compilation import compiled, merged
from harvester.device.terminals import GROUND

for function in functions.COMPILED:
    merged(function)

# Codes of entries other than operations: an unknown, a constant, the time. Codes of operations
# follow.
UNKNOWN, CONSTANT, TIME = range(3)
FIRST = 3
CHOICE = FIRST + CODES["if"]


class ExpressionGraph:
    """Operations in order of evaluation, as rows (code, a, b, c), and constants."""

    def __init__(self) -> None:
        self.rows: list[tuple[int, int, int, int]] = []
        self.values: list[float] = []

    def add(self, tree: Tree, unknown_of: Callable) -> int:
        """Append a tree; returns the index of its value.

        `unknown_of` gives the index of ("v", node) or ("i", source) among the unknowns; −1: ground.

        Raises
        ------
        ExpressionError
            The tree contains a function that only ngspice has.
        """

        def made(node: Tree, parts: list[int]) -> int:
            kind = node[0]
            if kind == "number":
                return self._row(CONSTANT, value=node[1])
            if kind == "time":
                return self._row(TIME)
            if kind == "i":
                return self._row(UNKNOWN, unknown_of(node))
            if kind == "v":
                return self._voltage(node, unknown_of)
            if kind not in CODES:
                raise ExpressionError(f"the function {node[1]}()")
            return self._row(FIRST + CODES[kind], *parts)

        return rebuilt(tree, made)

    def _voltage(self, tree, unknown_of):
        places = [unknown_of(("v", node)) if node != GROUND else -1 for node in tree[1:]]
        first, second = (self._row(UNKNOWN, p) if p >= 0 else -1 for p in places)
        if second < 0:
            return first if first >= 0 else self._row(CONSTANT, value=0.0)
        if first < 0:
            return self._row(FIRST + CODES["negative"], second)
        return self._row(FIRST + CODES["-"], first, second)

    def _row(self, code, a=0, b=0, c=0, value=0.0):
        self.rows.append((code, a, b, c))
        self.values.append(value)
        return len(self.rows) - 1


class Values:
    """Evaluates expressions of some unknowns at many points.

    Parameters
    ----------
    trees : sequence of tuple
    watched : sequence of str
        Names of the unknowns, a node's or "i(source)".
    """

    def __init__(self, trees: Sequence[Tree], watched: Sequence[str]) -> None:
        graph = ExpressionGraph()
        places = {name: index for index, name in enumerate(watched)}

        def unknown_of(tree: Tree) -> int:
            return places[tree[1] if tree[0] == "v" else f"i({tree[1]})"]

        self._ends = np.array([graph.add(tree, unknown_of) for tree in trees], dtype=np.int64)
        self._rows = np.array(graph.rows, dtype=np.int64).reshape(-1, 4)
        self._constants = np.array(graph.values, dtype=float)

    def __call__(self, time: np.ndarray, unknowns: np.ndarray) -> np.ndarray:
        """Evaluate; shape (trees, points), from unknowns of shape (watched, points)."""
        results = np.empty((self._ends.size, time.size))
        points = np.ascontiguousarray(np.asarray(unknowns, dtype=float).T)
        _at_points(self._rows, self._constants.copy(), self._ends, time, points, results)
        return results


@compiled
def _at_points(rows: Any, values: Any, ends: Any, time: Any, points: Any, results: Any) -> None:
    for k in range(time.size):
        evaluate(rows, values, points[k], time[k])
        for index in range(ends.size):
            results[index, k] = values[ends[index]]


@compiled
def evaluate(rows: np.ndarray, values: np.ndarray, y: np.ndarray, time: float) -> None:
    """Fill `values` of a graph; `y` are the unknowns."""
    for k in range(rows.shape[0]):
        code = rows[k, 0]
        if code == CONSTANT:
            continue
        if code == UNKNOWN:
            values[k] = y[rows[k, 1]]
            continue
        if code == TIME:
            values[k] = time
            continue
        a, b = values[rows[k, 1]], values[rows[k, 2]]
        if code == CHOICE:
            chosen = b if a != 0.0 else values[rows[k, 3]]
            values[k] = a if np.isnan(a) else chosen
        else:
            values[k] = value(code - FIRST, a, b)


@compiled
def slopes(rows: np.ndarray, values: np.ndarray, share: np.ndarray, first: int, last: int) -> None:
    """Fill `share` from `first` to `last` with the derivatives of the last value (reverse mode)."""
    share[first : last + 1] = 0.0
    share[last] = 1.0
    for k in range(last, first - 1, -1):
        code = rows[k, 0]
        if share[k] == 0.0 or code <= TIME:
            continue
        i, j = rows[k, 1], rows[k, 2]
        if code == CHOICE:
            share[j if values[i] != 0.0 else rows[k, 3]] += share[k]
            continue
        left, right = slope(code - FIRST, values[i], values[j], values[k])
        share[i] += share[k] * left
        if right != 0.0:
            share[j] += share[k] * right
