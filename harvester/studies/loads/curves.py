"""Evaluation of a study: the optimum of each load's curve, and the differences between loads.

Both are based on differences on common noise, with paired errors.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from harvester.statistics.agreement import differ
from harvester.statistics.batch_means import standard_error
from harvester.statistics.estimate import RESOLVED_SHARE

# Half width of an interval, in standard errors.
INTERVAL = 2.0
EDGE = "at the edge of the sweep: no interval"
NO_ERROR = "no error bar: the interval is not known"


@dataclass(frozen=True)
class CurveOptimum:
    """The maximum of a power curve over the swept value.

    Attributes
    ----------
    best
        Index of the highest point; None if no point has a value.
    place
        Position of the maximum, interpolated between points; NaN at an edge.
    low, high
        Ends of the maximum's interval; NaN if there is none.
    """

    best: int | None
    place: float = math.nan
    low: float = math.nan
    high: float = math.nan
    note: str = ""


@dataclass(frozen=True)
class Difference:
    """Relative difference of two loads at their optima, P_better/P_worse − 1."""

    better: str
    worse: str
    estimate: float
    standard_error: float

    @property
    def differs(self) -> bool:
        """Whether the difference is significant; False if its error is unknown."""
        known = not math.isnan(self.standard_error)
        return known and differ(self.estimate, self.standard_error, negligible=RESOLVED_SHARE)


def optimum_of(
    positions: Sequence[float], powers: Sequence[float], series: Sequence[np.ndarray | None]
) -> CurveOptimum:
    """The maximum of a curve, from a parabola through ln P at its highest point and neighbours.

    The interval is ± two paired standard errors. It is widened by the distance to the maximum of a
    parabola through P itself, as an estimate of the model error, and by the maxima of other curves
    through five points (`_maxima`). It also includes all points that are not lower than the
    highest by two paired standard errors.

    Parameters
    ----------
    positions
        Swept values, increasing; the fit uses their logarithms if all are > 0.
    powers
        NaN for missing values.
    series : sequence of (ndarray of shape (realizations, batches), or None)
        Powers of batches on common noise; None: without statistical error.
    """
    heights = np.asarray(powers, dtype=float)
    if not np.isfinite(heights).any():
        return CurveOptimum(None, note="no point has a value")
    best = int(np.nanargmax(heights))
    if len(positions) < 3:
        return CurveOptimum(best, note="" if len(positions) == 1 else EDGE)
    if best in (0, len(positions) - 1):
        return CurveOptimum(best, note=EDGE)
    near = [best - 1, best, best + 1]
    if not (heights[near] > 0.0).all():
        return CurveOptimum(best, note="a neighbouring point is not ranked: no interval")
    logarithmic = min(positions) > 0.0
    axis = np.log(positions) if logarithmic else np.asarray(positions, dtype=float)
    vertex, gradient = _vertex(axis[near], np.log(heights[near]))
    shape = abs(vertex - _vertex(axis[near], heights[near])[0])
    runs_near: list[Any] = [series[k] for k in near]
    error: float | None = 0.0
    if runs_near[0] is not None:
        error = error_of_sum(gradient, [runs / runs.mean() for runs in runs_near])
    convert = np.exp if logarithmic else float
    falls = {k: _falls(series, k, best) for k in range(len(positions)) if k != best}
    # The curve falls further beyond a significantly lower point, so errors there do not matter.
    sides = (range(best - 1, -1, -1), range(best + 1, len(positions)))
    ends = [next((falls[k] for k in side if falls[k] is not False), False) for side in sides]
    if error is None or None in ends:
        return CurveOptimum(best, float(convert(vertex)), note=NO_ERROR)
    maxima = _maxima(axis, heights, best, vertex)
    low, high = min(maxima) - INTERVAL * error - shape, max(maxima) + INTERVAL * error + shape
    note = ""
    rivals = [k for k, falls_to in falls.items() if falls_to is False]
    if rivals:
        rivals.append(best)
        low, high = min(low, axis[min(rivals)]), max(high, axis[max(rivals)])
        note = "flat within the noise"
    if low <= axis[0] or high >= axis[-1]:
        note = "flat within the noise to the edge of the sweep"
    low, high = max(low, axis[0]), min(high, axis[-1])
    vertex, low, high = (float(convert(coordinate)) for coordinate in (vertex, low, high))
    return CurveOptimum(best, vertex, low, high, note)


def rank(
    powers: Mapping[str, float], series: Mapping[str, np.ndarray | None]
) -> tuple[list[str], list[Difference]]:
    """The loads in descending order of power, and the differences between all pairs.

    `powers`: power at each load's optimum, the mean of its series; NaN if there is none.
    """
    order = sorted((k for k in powers if math.isfinite(powers[k])), key=lambda k: -powers[k])
    differences = []
    for position, better in enumerate(order):
        for worse in order[position + 1 :]:
            ratio = powers[better] / powers[worse]
            error: float | None = 0.0
            shares = [runs / powers[k] for k in (better, worse) if (runs := series[k]) is not None]
            if shares:
                error = error_of_sum((ratio, -ratio), shares)
            known_error = math.nan if error is None else error
            differences.append(Difference(better, worse, ratio - 1.0, known_error))
    return order, differences


def error_of_sum(weights: Sequence[float], series: Sequence[np.ndarray]) -> float | None:
    """Standard error of a weighted sum of means on common noise.

    The first realizations of all series have the same noise. If the numbers of realizations differ,
    only the noise of the common realizations cancels.

    Parameters
    ----------
    series : sequence of ndarray, shape (realizations, batches)
        Series of batches with possibly different numbers of realizations.

    Returns
    -------
    float or None
        None if a series is too short for an error bar.
    """
    counts = [len(runs) for runs in series]
    together = _error_of_prefix(weights, series, min(counts))
    if min(counts) == max(counts) or together is None:
        return together
    errors = [error for runs in series if (error := standard_error(runs)) is not None]
    if len(errors) < len(series):
        return None
    variance = sum((w * error) ** 2 for w, error in zip(weights, errors, strict=True))
    for i, j in itertools.combinations(range(len(series)), 2):
        count = min(counts[i], counts[j])
        pair = [series[i], series[j]]
        terms = [_error_of_prefix(w, pair, count) for w in ((1.0, 0.0), (0.0, 1.0), (1.0, -1.0))]
        parts = [error for error in terms if error is not None]
        if len(parts) < len(terms):
            return None
        covariance = 0.5 * (parts[0] ** 2 + parts[1] ** 2 - parts[2] ** 2)
        shared = count**2 / (counts[i] * counts[j])
        variance += 2.0 * weights[i] * weights[j] * covariance * shared
    # The sum of the estimated parts of the variance may be too small. The second argument is its
    # minimum for these numbers of realizations.
    return math.sqrt(max(variance, together**2 * min(counts) / max(counts)))


def _error_of_prefix(weights, series, count):
    return standard_error(sum(w * runs[:count] for w, runs in zip(weights, series, strict=True)))


def _vertex(x, y):
    """Position of a parabola's extremum through three points, and its derivatives with respect to
    their values.
    """
    # Rows: curvature, slope and value at the middle point, each linear in y.
    rows = np.linalg.inv(np.vander(x - x[1], 3))
    curvature, slope = rows[0] @ y, rows[1] @ y
    extremum = x[1] - 0.5 * slope / curvature
    return extremum, 0.5 * (slope * rows[0] / curvature - rows[1]) / curvature


def _maxima(axis, heights, best, vertex):
    """Positions of the maximum of ln P by the parabola, the quartic and a kink near `best`.

    The quartic and the kink need five points. A kink bends the curve at one point alone: it is
    where the straight lines through the two points on its left and the two on its right meet. If
    a neighbour's curvature is half of that at `best` or more, the curve is smooth; between a
    quarter and a half the kink's position moves to the vertex of the parabola.
    """
    x, y = (values[max(best - 2, 0) : best + 3] for values in (axis, heights))
    if len(x) < 5 or not (y > 0.0).all():
        return [vertex]
    slopes = np.diff(np.log(y)) / np.diff(x)
    bends = np.diff(slopes) / (x[2:] - x[:-2])
    sharp = np.clip(2.0 - 4.0 * max(bends[0], bends[2]) / bends[1], 0.0, 1.0)
    fine = np.linspace(x[1], x[3], 2001)
    maxima = [vertex, fine[np.argmax(np.polynomial.Polynomial.fit(x, np.log(y), 4)(fine))]]
    for k in (1, 2):  # between the points k and k + 1
        left, across, right = slopes[k - 1 : k + 2]
        if left >= across >= right and left > right:
            kink = x[k] + (x[k + 1] - x[k]) * (across - right) / (left - right)
            maxima.append(vertex + sharp * (kink - vertex))
    return maxima


def _falls(series, index, best):
    """Whether a point is lower than the highest by two paired standard errors, or None.

    None: their difference has no standard error.
    """
    if series[index] is None or series[best] is None:
        return True
    error = error_of_sum((1.0, -1.0), (series[best], series[index]))
    if error is None:
        return None
    return bool(series[best].mean() - series[index].mean() >= INTERVAL * error)
