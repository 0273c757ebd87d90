"""Bounds of an expression of time over time intervals, by interval arithmetic.

All values within an interval lie between the bounds, so that no pulse between two samples is
missed. Narrower intervals give tighter bounds.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from circuits.netlist.expression import Tree, leaves, rebuilt
from circuits.netlist.functions import LARGEST_EXPONENT, LARGEST_EXPONENTIAL, divisor

Pair = tuple[np.ndarray, np.ndarray]


def of_time_alone(tree: Tree) -> bool:
    """Whether an expression depends on time but not on voltages or currents."""
    kinds = {leaf[0] for leaf in leaves(tree)}
    return "time" in kinds and not kinds & {"v", "i"}


def bounds(tree: Tree, low: np.ndarray, high: np.ndarray) -> Pair:
    """Bounds of a tree that depends only on time, over intervals; infinite if unknown.

    Parameters
    ----------
    tree : tuple
        See `circuits.netlist.expression`.
    low, high : ndarray, shape (n,)
        Ends of the intervals (s).
    """

    def made(node: Tree, parts: list[Pair]) -> Any:
        kind = node[0]
        if kind == "number":
            value = np.full(low.size, node[1])
            return value, value
        if kind == "time":
            return low, high
        if kind == "call":
            return _lines(parts) if node[1] == "pwl" else parts[0]
        least, most = _RULES[kind](*parts)
        return np.where(np.isnan(least), -np.inf, least), np.where(np.isnan(most), np.inf, most)

    with np.errstate(all="ignore"):
        return rebuilt(tree, made)


def _lines(parts):
    """The function pwl(x, x1, y1, x2, y2, …) of constant points."""
    (low, high), points = parts[0], np.array([part[0][0] for part in parts[1:]])
    x, y = points[::2], points[1::2]
    ends = np.array([np.interp(low, x, y), np.interp(high, x, y)])
    least, most = ends.min(axis=0), ends.max(axis=0)
    first, last = np.searchsorted(x, low, "right"), np.searchsorted(x, high, "left")
    for k in np.flatnonzero(last > first):
        inside = y[first[k] : last[k]]
        least[k], most[k] = min(least[k], inside.min()), max(most[k], inside.max())
    return least, most


def _growing(function: Callable) -> Callable:
    return lambda a: (function(a[0]), function(a[1]))


def _falling(function: Callable) -> Callable:
    return lambda a: (function(a[1]), function(a[0]))


def _exponential(x):
    within = np.exp(np.minimum(x, LARGEST_EXPONENT))
    return np.where(x > LARGEST_EXPONENT, LARGEST_EXPONENTIAL, within)


def _size(a):
    ends = np.abs(a)
    least = np.where((a[0] <= 0.0) & (a[1] >= 0.0), 0.0, np.minimum(*ends))
    return least, np.maximum(*ends)


def _product(a, b):
    corners = np.array([one * other for one in a for other in b])
    # 0 times an infinite end is 0 here, not NaN.
    corners = np.where(np.isnan(corners), 0.0, corners)
    return corners.min(axis=0), corners.max(axis=0)


def _quotient(a, b):
    passes = (b[0] <= 0.0) & (b[1] >= 0.0) & (b[0] < b[1])
    inverse = 1.0 / _divisors(b[1]), 1.0 / _divisors(b[0])
    low, high = _product(a, inverse)
    return np.where(passes, -np.inf, low), np.where(passes, np.inf, high)


_divisors = np.vectorize(divisor, otypes=[float])


def _power(a, b):
    """Bounds of |a|^b."""
    sizes = _size(a)
    corners = np.array([one**other for one in sizes for other in b])
    return corners.min(axis=0), corners.max(axis=0)


def _signed_power(a, b):
    low, high = _power(a, b)
    up = np.where(a[1] > 0.0, high, -low), np.where(a[0] < 0.0, -high, low)
    return up[1], up[0]


def _sine(a):
    low, high = a
    least, most = np.minimum(np.sin(low), np.sin(high)), np.maximum(np.sin(low), np.sin(high))
    return np.where(_meets(a, -0.5 * math.pi), -1.0, least), np.where(
        _meets(a, 0.5 * math.pi), 1.0, most
    )


def _meets(a, angle):
    """Whether an interval contains an angle, modulo 2π."""
    turns = (a[0] - angle) / (2.0 * math.pi), (a[1] - angle) / (2.0 * math.pi)
    return np.floor(turns[1]) > np.floor(turns[0])


def _tangent(a):
    pole = np.floor(a[0] / math.pi + 0.5) < np.floor(a[1] / math.pi + 0.5)
    return np.where(pole, -np.inf, np.tan(a[0])), np.where(pole, np.inf, np.tan(a[1]))


def _truths(a):
    """Whether a condition may be false, and whether it may be true, over an interval."""
    return (a[0] <= 0.0) & (a[1] >= 0.0), (a[0] != 0.0) | (a[1] != 0.0)


def _condition(surely, perhaps):
    return np.where(surely, 1.0, 0.0), np.where(perhaps, 1.0, 0.0)


def _chosen(a, b, c):
    false, true = _truths(a)
    low = np.minimum(np.where(true, b[0], np.inf), np.where(false, c[0], np.inf))
    high = np.maximum(np.where(true, b[1], -np.inf), np.where(false, c[1], -np.inf))
    return low, high


def _and(a, b):
    one, other = _truths(a), _truths(b)
    return _condition(~one[0] & ~other[0], one[1] & other[1])


def _or(a, b):
    one, other = _truths(a), _truths(b)
    return _condition(~one[0] | ~other[0], one[1] | other[1])


def _equal(a, b):
    points = (a[0] == a[1]) & (b[0] == b[1]) & (a[0] == b[0])
    return _condition(points, (a[0] <= b[1]) & (b[0] <= a[1]))


def _not(a):
    false, true = _truths(a)
    return _condition(~true, false)


_RULES: dict[str, Any] = {
    "+": lambda a, b: (a[0] + b[0], a[1] + b[1]), "-": lambda a, b: (a[0] - b[1], a[1] - b[0]),
    "*": _product, "/": _quotient, "^": _power, "pwr": _signed_power,
    "negative": _falling(np.negative), "abs": _size, "exp": _growing(_exponential),
    "ln": _growing(lambda x: np.log(np.maximum(x, 1e-99))),
    "sqrt": _growing(lambda x: np.sqrt(np.maximum(x, 0.0))), "sin": _sine,
    "cos": lambda a: _sine((a[0] + 0.5 * math.pi, a[1] + 0.5 * math.pi)),
    "tan": _tangent, "atan": _growing(np.arctan), "sinh": _growing(np.sinh),
    "cosh": lambda a: _growing(np.cosh)(_size(a)), "tanh": _growing(np.tanh),
    "max": lambda a, b: (np.maximum(a[0], b[0]), np.maximum(a[1], b[1])),
    "min": lambda a, b: (np.minimum(a[0], b[0]), np.minimum(a[1], b[1])), "if": _chosen,
    "<": lambda a, b: _condition(a[1] < b[0], a[0] < b[1]),
    "<=": lambda a, b: _condition(a[1] <= b[0], a[0] <= b[1]), "==": _equal, "and": _and,
    "or": _or, "not": _not, "sgn": _growing(np.sign), "floor": _growing(np.floor),
    "ceil": _growing(np.ceil), "u": _growing(lambda x: np.heaviside(x, 0.5)),
    "uramp": _growing(lambda x: np.maximum(x, 0.0)), "asinh": _growing(np.arcsinh),
    "asin": _growing(np.arcsin), "acos": _falling(np.arccos), "acosh": _growing(np.arccosh),
    "atanh": _growing(np.arctanh), "nint": _growing(np.rint),
}  # fmt: skip
