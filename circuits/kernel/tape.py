"""An expression of voltages and currents as a list of operations, and its slopes backwards."""

from __future__ import annotations

from typing import Any

import numpy as np

from circuits.kernel.formula import OPERATIONS, NotTaken
from harvester.compilation import compiled

# Operations before those of `OPERATIONS`: an unknown, a constant, the time.
UNKNOWN, CONSTANT, TIME = range(3)
CODES = {name: 3 + place for place, name in enumerate(OPERATIONS)}
(
    ADD, SUBTRACT, MULTIPLY, DIVIDE, POWER, SIGNED_POWER, NEGATIVE, ABSOLUTE, EXPONENTIAL,
    LOGARITHM, ROOT, SINE, COSINE, TANGENT, ARC_TANGENT, HYPERBOLIC_SINE, HYPERBOLIC_COSINE,
    HYPERBOLIC_TANGENT, GREATER, LESSER, CHOICE, BELOW, NOT_ABOVE, EQUAL, AND, OR, NOT, SIGN,
    FLOOR, CEILING, STEP, RAMP, AREA_SINE, ARC_SINE, ARC_COSINE,
) = range(3, 3 + len(OPERATIONS))  # fmt: skip
# An exponential goes on as its tangent beyond this exponent, as a junction does.
LARGEST_EXPONENT = 60.0


class Tape:
    """Operations in order, each of earlier ones; rows (code, a, b, c) and their constants."""

    def __init__(self) -> None:
        self.rows: list[tuple[int, int, int, int]] = []
        self.values: list[float] = []

    def add(self, tree: Any, unknown_of: Any) -> int:
        """Append a tree; returns the place of its value.

        `unknown_of` gives the place of ("v", node) or ("i", source) among the unknowns; −1: ground.

        Raises
        ------
        NotTaken
        """
        kind = tree[0]
        if kind == "number":
            return self._row(CONSTANT, value=tree[1])
        if kind == "time":
            return self._row(TIME)
        if kind == "i":
            return self._row(UNKNOWN, unknown_of(tree))
        if kind == "v":
            places = [unknown_of(("v", node)) for node in tree[1:]]
            first, second = (self._row(UNKNOWN, p) if p >= 0 else -1 for p in places)
            if second < 0:
                return first if first >= 0 else self._row(CONSTANT, value=0.0)
            if first < 0:
                return self._row(NEGATIVE, second)
            return self._row(SUBTRACT, first, second)
        if kind not in CODES:
            raise NotTaken(f"the function {kind}()")
        return self._row(CODES[kind], *(self.add(part, unknown_of) for part in tree[1:]))

    def _row(self, code, a=0, b=0, c=0, value=0.0):
        self.rows.append((code, a, b, c))
        self.values.append(value)
        return len(self.rows) - 1


@compiled
def evaluate(rows: np.ndarray, values: np.ndarray, y: np.ndarray, time: float) -> None:
    """Fill `values` of a tape; `y` are the unknowns."""
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
            values[k] = b if a != 0.0 else values[rows[k, 3]]
        else:
            values[k] = _value(code, a, b)


@compiled
def _value(code, a, b):
    if code == ADD:
        return a + b
    if code == SUBTRACT:
        return a - b
    if code == MULTIPLY:
        return a * b
    if code == DIVIDE:
        return a / b if b != 0.0 else a * 1e99
    if code == POWER:
        return abs(a) ** b
    if code == SIGNED_POWER:
        return np.sign(a) * abs(a) ** b
    if code == NEGATIVE:
        return -a
    if code == ABSOLUTE:
        return abs(a)
    if code == EXPONENTIAL:
        if a > LARGEST_EXPONENT:
            return np.exp(LARGEST_EXPONENT) * (1.0 + a - LARGEST_EXPONENT)
        return np.exp(a)
    if code == LOGARITHM:
        return np.log(max(a, 1e-99))
    if code == ROOT:
        return np.sqrt(max(a, 0.0))
    if code == SINE:
        return np.sin(a)
    if code == COSINE:
        return np.cos(a)
    if code == TANGENT:
        return np.tan(a)
    if code == ARC_TANGENT:
        return np.arctan(a)
    if code == HYPERBOLIC_SINE:
        return np.sinh(a)
    if code == HYPERBOLIC_COSINE:
        return np.cosh(a)
    if code == HYPERBOLIC_TANGENT:
        return np.tanh(a)
    if code == GREATER:
        return max(a, b)
    if code == LESSER:
        return min(a, b)
    if code == BELOW:
        return 1.0 if a < b else 0.0
    if code == NOT_ABOVE:
        return 1.0 if a <= b else 0.0
    if code == EQUAL:
        return 1.0 if a == b else 0.0
    if code == AND:
        return 1.0 if a != 0.0 and b != 0.0 else 0.0
    if code == OR:
        return 1.0 if a != 0.0 or b != 0.0 else 0.0
    if code == NOT:
        return 1.0 if a == 0.0 else 0.0
    if code == SIGN:
        return np.sign(a)
    if code == FLOOR:
        return np.floor(a)
    if code == CEILING:
        return np.ceil(a)
    if code == STEP:
        return 1.0 if a > 0.0 else 0.0
    if code == RAMP:
        return max(a, 0.0)
    if code == AREA_SINE:
        return np.arcsinh(a)
    if code == ARC_SINE:
        return np.arcsin(min(max(a, -1.0), 1.0))
    return np.arccos(min(max(a, -1.0), 1.0))


@compiled
def slopes(rows: np.ndarray, values: np.ndarray, share: np.ndarray, first: int, last: int) -> None:
    """Fill `share` from `first` to `last`: the slope of the last value in each, backwards."""
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
        left, right = _slope(code, values[i], values[j], values[k])
        share[i] += share[k] * left
        if right != 0.0:
            share[j] += share[k] * right


@compiled
def _slope(code, a, b, value):
    """Slopes of an operation in its first and second argument."""
    if code == ADD:
        return 1.0, 1.0
    if code == SUBTRACT:
        return 1.0, -1.0
    if code == MULTIPLY:
        return b, a
    if code == DIVIDE:
        return (1.0 / b, -value / b) if b != 0.0 else (1e99, 0.0)
    if code in (POWER, SIGNED_POWER):
        size = max(abs(a), 1e-30)
        along = b * size ** (b - 1.0)
        across = value * np.log(size)
        return (along * np.sign(a), across) if code == POWER else (along, across)
    if code == NEGATIVE:
        return -1.0, 0.0
    if code == ABSOLUTE:
        return np.sign(a), 0.0
    if code == EXPONENTIAL:
        return (np.exp(LARGEST_EXPONENT) if a > LARGEST_EXPONENT else value), 0.0
    if code == LOGARITHM:
        return 1.0 / max(a, 1e-99), 0.0
    if code == ROOT:
        return 0.5 / max(value, 1e-15), 0.0
    if code == SINE:
        return np.cos(a), 0.0
    if code == COSINE:
        return -np.sin(a), 0.0
    if code == TANGENT:
        return 1.0 + value * value, 0.0
    if code == ARC_TANGENT:
        return 1.0 / (1.0 + a * a), 0.0
    if code == HYPERBOLIC_SINE:
        return np.cosh(a), 0.0
    if code == HYPERBOLIC_COSINE:
        return np.sinh(a), 0.0
    if code == HYPERBOLIC_TANGENT:
        return 1.0 - value * value, 0.0
    if code == GREATER:
        return (1.0, 0.0) if a >= b else (0.0, 1.0)
    if code == LESSER:
        return (1.0, 0.0) if a <= b else (0.0, 1.0)
    if code == RAMP:
        return (1.0 if a > 0.0 else 0.0), 0.0
    if code == AREA_SINE:
        return 1.0 / np.sqrt(1.0 + a * a), 0.0
    if code == ARC_SINE:
        return 1.0 / np.sqrt(max(1.0 - a * a, 1e-15)), 0.0
    if code == ARC_COSINE:
        return -1.0 / np.sqrt(max(1.0 - a * a, 1e-15)), 0.0
    # What jumps has no slope.
    return 0.0, 0.0
