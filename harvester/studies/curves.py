"""What a study is asked: the optimum of each load's curve, and by how much one load beats another.

Both from differences on common noise, whose errors are paired.
"""

import math
from dataclasses import dataclass

import numpy as np

from harvester.estimators import standard_error

# Standard errors to either side that make an interval.
INTERVAL = 2.0
EDGE = "at the edge of the sweep: no interval"


@dataclass(frozen=True)
class CurveOptimum:
    """Where a curve is highest.

    Attributes
    ----------
    best : int or None
        Place of the highest point; None where no point has a value.
    place : float
        Of the maximum between the points; nan at an edge.
    low, high : float
        Its interval; nan where there is none.
    note : str
    """

    best: int | None
    place: float = math.nan
    low: float = math.nan
    high: float = math.nan
    note: str = ""


@dataclass(frozen=True)
class Difference:
    """By how much the better of two loads is ahead at their optima, P_better/P_worse − 1."""

    better: str
    worse: str
    estimate: float
    standard_error: float


def optimum_of(places, powers, series):
    """The maximum of a curve, from the parabola through ln P at its highest point and neighbours.

    The interval is two paired standard errors to either side, widened by how far the parabola
    through P itself lies off (the curve is neither), and by the points that are no lower than the
    highest within two paired standard errors.

    Parameters
    ----------
    places : sequence of float
        Increasing; the fit is in their logarithm where all are > 0.
    powers : sequence of float
        nan where there is none.
    series : sequence of (ndarray of shape (realizations, batches), or None)
        Powers batch by batch on common noise; None: without statistical error.

    Returns
    -------
    CurveOptimum
    """
    powers = np.asarray(powers, dtype=float)
    if not np.isfinite(powers).any():
        return CurveOptimum(None, note="no point has a value")
    best = int(np.nanargmax(powers))
    if len(places) < 3:
        return CurveOptimum(best, note="" if len(places) == 1 else EDGE)
    if best in (0, len(places) - 1):
        return CurveOptimum(best, note=EDGE)
    near = [best - 1, best, best + 1]
    if not (powers[near] > 0.0).all():
        return CurveOptimum(best, note="a neighbour has no value: no interval")
    logarithmic = min(places) > 0.0
    axis = np.log(places) if logarithmic else np.asarray(places, dtype=float)
    vertex, gradient = _vertex(axis[near], np.log(powers[near]))
    shape = abs(vertex - _vertex(axis[near], powers[near])[0])
    error = _error_of(gradient, [series[k] for k in near])
    if error is None:
        return CurveOptimum(best, note="too few realizations for an interval")
    low, high = vertex - INTERVAL * error - shape, vertex + INTERVAL * error + shape
    note = ""
    rivals = [k for k in range(len(places)) if k != best and _no_lower(series, k, best)]
    if rivals:
        low, high = min(low, axis[min(rivals)]), max(high, axis[max(rivals)])
        note = "flat within the noise"
    if low <= axis[0] or high >= axis[-1]:
        note = "flat within the noise to the edge of the sweep"
    low, high = max(low, axis[0]), min(high, axis[-1])
    convert = np.exp if logarithmic else float
    return CurveOptimum(best, *(float(convert(v)) for v in (vertex, low, high)), note=note)


def rank(powers, series):
    """Loads from the best to the worst, with every difference between two of them.

    Parameters
    ----------
    powers : dict of str to float
        At each load's optimum; nan where there is none.
    series : dict of str to (ndarray or None)

    Returns
    -------
    list of str
    list of Difference
    """
    order = sorted((k for k in powers if math.isfinite(powers[k])), key=lambda k: -powers[k])
    differences = []
    for place, better in enumerate(order):
        for worse in order[place + 1 :]:
            ratio, error = _ratio(series[better], series[worse], powers[better], powers[worse])
            differences.append(Difference(better, worse, ratio - 1.0, error))
    return order, differences


def _ratio(upper, lower, mean_upper, mean_lower):
    """Ratio of two means on common noise and its error; of the realizations both have."""
    if upper is None:
        return mean_upper / mean_lower, 0.0
    count = min(len(upper), len(lower))
    upper, lower = upper[:count], lower[:count]
    ratio = float(upper.mean() / lower.mean())
    error = standard_error((upper - ratio * lower) / lower.mean())
    return ratio, math.nan if error is None else error


def _vertex(x, y):
    """Place of a parabola's extremum through three points, and its derivative by their values."""
    # Rows: curvature, slope and value at the middle point, each linear in y.
    rows = np.linalg.inv(np.vander(x - x[1], 3))
    curvature, slope = rows[0] @ y, rows[1] @ y
    place = x[1] - 0.5 * slope / curvature
    return place, 0.5 * (slope * rows[0] / curvature - rows[1]) / curvature


def _error_of(gradient, series):
    """Standard error of a function of means by the gradient over their logarithms."""
    if series[0] is None:
        return 0.0
    count = min(len(each) for each in series)
    shares = [each[:count] / each[:count].mean() - 1.0 for each in series]
    return standard_error(sum(g * share for g, share in zip(gradient, shares, strict=True)))


def _no_lower(series, place, best):
    """Whether a point lies within two paired standard errors of the highest."""
    if series[place] is None or series[best] is None:
        return False
    count = min(len(series[place]), len(series[best]))
    difference = series[best][:count] - series[place][:count]
    error = standard_error(difference)
    return error is None or difference.mean() < INTERVAL * error
