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
        """Whether the lead is significant; not if its error is unknown."""
        known = not math.isnan(self.standard_error)
        return known and differ(self.estimate, self.standard_error, negligible=RESOLVED_SHARE)


def optimum_of(
    positions: Sequence[float], powers: Sequence[float], series: Sequence[np.ndarray | None]
) -> CurveOptimum:
    """The maximum of a curve, from a parabola through ln P at its highest point and neighbours.

    The interval is ± two paired standard errors. It is widened by the distance to the maximum of a
    parabola through P itself, as an estimate of the model error. It also includes all points that
    are not lower than the highest by two paired standard errors.

    Parameters
    ----------
    places
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
        return CurveOptimum(best, note="a neighbour is not ranked: no interval")
    logarithmic = min(positions) > 0.0
    axis = np.log(positions) if logarithmic else np.asarray(positions, dtype=float)
    vertex, gradient = _vertex(axis[near], np.log(heights[near]))
    shape = abs(vertex - _vertex(axis[near], heights[near])[0])
    runs_near: list[Any] = [series[k] for k in near]
    error: float | None = 0.0
    if runs_near[0] is not None:
        error = error_of_sum(gradient, [runs / runs.mean() for runs in runs_near])
    if error is None:
        return CurveOptimum(best, note="too few realizations for an interval")
    low, high = vertex - INTERVAL * error - shape, vertex + INTERVAL * error + shape
    note = ""
    rivals = [k for k in range(len(positions)) if k != best and _no_lower(series, k, best)]
    if rivals:
        rivals.append(best)
        low, high = min(low, axis[min(rivals)]), max(high, axis[max(rivals)])
        note = "flat within the noise"
    if low <= axis[0] or high >= axis[-1]:
        note = "flat within the noise to the edge of the sweep"
    low, high = max(low, axis[0]), min(high, axis[-1])
    convert = np.exp if logarithmic else float
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

    The first realizations of all series have the same noise. If their numbers differ, only the
    noise of the common ones cancels.

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
    # The estimated parts of the variance may add up to too little. This is the minimum for these
    # numbers of realizations.
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


def _no_lower(series, index, best):
    """Whether a point is within two paired standard errors of the highest."""
    if series[index] is None or series[best] is None:
        return False
    error = error_of_sum((1.0, -1.0), (series[best], series[index]))
    return error is None or series[best].mean() - series[index].mean() < INTERVAL * error
