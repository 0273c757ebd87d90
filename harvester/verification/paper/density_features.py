"""Numbers that the paper's statements read off a density p(X), each with its error.

Bins that are summed count as fully correlated, which is cautious.
"""

import numpy as np

from harvester.estimates.estimate import Density

# The peak of a density is its mean over this width of X.
PEAK_WIDTH = 0.1
# |X| is beyond the reach of the motion with this probability.
BEYOND = 0.01


def peak_of(density: Density) -> tuple[float, float]:
    """(highest average of p(X) over a width of X, its error), whatever the grid."""
    centre, values, errors = _smooth(density)
    top = int(np.argmax(np.where(centre >= 0.0, values, 0.0)))
    return values[top], errors[top]


def middle_of(density: Density) -> tuple[float, float]:
    """(average of p(X) about X = 0, its error)."""
    centre, values, errors = _smooth(density)
    middle = int(np.argmin(np.abs(centre)))
    return values[middle], errors[middle]


def _smooth(density):
    """Averages over `PEAK_WIDTH`."""
    reach, step = max(np.abs(density.centre).max(), 2.0 * PEAK_WIDTH), PEAK_WIDTH / 16
    centre = np.arange(-reach, reach + step, step)
    errors = density.standard_error
    errors = np.zeros_like(density.density) if errors is None else errors
    window = np.full(16, 1.0 / 16)
    return centre, *(
        np.convolve(np.interp(centre, density.centre, column, 0.0, 0.0), window, "same")
        for column in (density.density, errors)
    )


def reach_of(density: Density) -> tuple[float, float]:
    """(distance from X = 0 that the motion exceeds for `BEYOND` of the time, its error)."""
    centre = density.centre
    order = np.argsort(-np.abs(centre))
    width = np.gradient(centre)[order]
    beyond = np.cumsum(density.density[order] * width)
    last = int(np.searchsorted(beyond, BEYOND))
    distance = np.interp(BEYOND, beyond, np.abs(centre[order]))
    if density.standard_error is None:
        return distance, 0.0
    error = (density.standard_error[order] * width)[: last + 1].sum()
    # The two sides together give the slope of the tail's probability.
    return distance, error / (2.0 * density.density[order][last])


FEATURES = {"peak": peak_of, "reach": reach_of}
