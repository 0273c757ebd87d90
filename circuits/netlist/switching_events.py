"""Comparisons of a load whose change makes a current or voltage jump."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator

import numpy as np

from circuits.netlist.bounds import of_time_alone
from circuits.netlist.expression import ExpressionError, Tree, leaves, unknowns_in
from harvester.device.terminals import GROUND

# Number of random lines in the space of voltages and currents on which an expression is examined,
# powers of ten of their range, and halvings to locate a sign change on a line.
LINES, SMALLEST, GREATEST, HALVINGS = 64, -2.0, 2.0, 60
# Values on both sides of a sign change form a jump if they differ by more than this share of the
# values at the line's ends.
CONTINUOUS = 1e-6
# A slope of a comparison below this share is a rounding error.
ROUNDING = 1e-9


@functools.lru_cache(maxsize=4096)
def zero_crossings(tree: Tree) -> tuple[Tree, ...]:
    """Expressions that cross 0 where this one jumps, without functions of time alone."""
    differences = dict.fromkeys(passed for passed in _passed(tree) if not of_time_alone(passed))
    return tuple(difference for difference in differences if _jumps(tree, difference))


def _passed(tree: Tree) -> Iterator[Tree]:
    """Expressions that cross 0 where a part of this one jumps (comparison, step, rounding)."""
    half_turn = ("number", math.pi)
    for leaf in leaves(tree):
        if leaf[0] in ("<", "<="):
            yield ("-", leaf[1], leaf[2])
        elif leaf[0] in ("sgn", "u"):
            yield leaf[1]
        elif leaf[0] in ("floor", "ceil"):
            yield ("sin", ("*", half_turn, leaf[1]))
        elif leaf[0] == "nint":
            yield ("cos", ("*", half_turn, leaf[1]))


def _jumps(tree, passed):
    """Whether an expression jumps where another crosses 0; also True if no crossing was found."""
    names = unknowns_in(tree)
    try:
        from circuits.netlist.expression_graph import Values

        values = Values([passed, tree], names)
    except ExpressionError:
        return True
    random = np.random.default_rng(1)
    shape = (len(names), LINES)
    ends = [
        random.choice([-1.0, 1.0], shape) * 10.0 ** random.uniform(SMALLEST, GREATEST, shape)
        for _ in range(2)
    ]
    time = random.uniform(0.0, 1.0, LINES)
    low, high = np.zeros(LINES), np.ones(LINES)

    def at(share):
        return values(time, ends[0] + share * (ends[1] - ends[0]))

    begin, end = at(low), at(high)
    first, size = np.sign(begin[0]), np.maximum(np.abs(begin[1]), np.abs(end[1]))
    met = first * end[0] < 0.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        before = np.sign(at(middle)[0]) == first
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    leap = np.abs(at(low)[1] - at(high)[1])
    return not met.any() or bool(np.any((leap > CONTINUOUS * size)[met]))


def passing(passed: Tree) -> tuple[tuple[str, str], float] | None:
    """Two unknowns, and the level (V or A) of their difference at which an expression crosses 0.

    Each is a node, "i(source)" or ground. None if the expression has another form.
    """
    names = unknowns_in(passed)
    try:
        from circuits.netlist.expression_graph import Values

        values = Values([passed], names)
    except ExpressionError:
        return None
    points = np.eye(len(names), len(names) + 3)
    points[:, -2] = np.random.default_rng(2).uniform(-10.0, 10.0, len(names))
    points[:, -1] = 2.0 * points[:, -2]
    results = values(np.array([*np.zeros(len(names) + 2), 1.0]), points)[0]
    start, slopes = results[len(names)], results[: len(names)] - results[len(names)]
    straight = start + slopes @ points
    if not np.allclose(results, straight, rtol=ROUNDING, atol=ROUNDING * np.abs(slopes).max()):
        return None
    counts = [k for k in range(len(names)) if abs(slopes[k]) > ROUNDING * np.abs(slopes).max()]
    counts.sort(key=lambda k: -slopes[k])
    if len(counts) == 1:
        (k,) = counts
        return (names[k], GROUND), float(-start / slopes[k])
    if len(counts) == 2 and abs(slopes[counts].sum()) <= ROUNDING * np.abs(slopes).max():
        return (names[counts[0]], names[counts[1]]), float(-start / slopes[counts[0]])
    return None
