"""Fewer samples for the same error bar: a cheap simulation on the same noise as control variate.

With a control C on the noise path of Y, whose mean μ is known from elsewhere, Y − b(C − μ) has the
mean of Y for any b that does not depend on this Y and C, and a share 1 − ρ² of its variance for
the best b (Owen, Monte Carlo theory, methods and examples, section 8.9). Each realization gets
the b of all others, so that it is unbiased however few there are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from harvester.estimates.batch_means import standard_error

# A control variate is used when it saves at least this factor in samples: a smaller gain may be
# chance.
LEAST_GAIN = 1.1
# A correlation counts when it exceeds so many of the standard errors that uncorrelated series have.
SIGNIFICANT_SIGMAS = 3.0


@dataclass(frozen=True)
class Controlled:
    """A mean with its control variate, or without it where that is no better.

    Attributes
    ----------
    mean : float
    standard_error : float or None
    coefficient : float
        b, averaged over realizations; 0 where the control is not used.
    correlation : float
        Of the batches of both; nan where there are too few.
    gain : float
        By what factor more samples would be needed without it, ≥ 1.
    """

    mean: float
    standard_error: float | None
    coefficient: float
    correlation: float
    gain: float


def controlled_mean(
    series: np.ndarray,
    control: np.ndarray,
    known_mean: float | None = None,
    known_error: float = 0.0,
) -> Controlled:
    """Mean of a series of batches, with a control variate where that narrows the error bar.

    Parameters
    ----------
    series, control : ndarray, shape (realizations, batches)
        On the same noise; realizations are independent of each other.
    known_mean : float or None
        Of the control, from a run that shares no noise with these; None: not known.
    known_error : float
        Its standard error; part of the result's.

    Returns
    -------
    Controlled
    """
    plain = Controlled(float(series.mean()), standard_error(series), 0.0, math.nan, 1.0)
    correlation = significant_correlation(series, control)
    if correlation is None or known_mean is None or not plain.standard_error:
        return plain
    coefficients = _of_the_others(series, control)
    adjusted = series - coefficients[:, None] * (control - known_mean)
    scatter = standard_error(adjusted)
    coefficient = float(coefficients.mean())
    if scatter is None:
        return plain
    error = math.hypot(scatter, coefficient * known_error)
    gain = (plain.standard_error / error) ** 2 if error > 0.0 else math.inf
    if gain < LEAST_GAIN:
        return plain
    return Controlled(float(adjusted.mean()), error, coefficient, correlation, gain)


def significant_correlation(series: np.ndarray, control: np.ndarray) -> float | None:
    """Correlation of the batches of both, or None where it could be chance or gains too little."""
    if len(series) < 3 or series.shape != control.shape:
        return None
    both = np.std(series) * np.std(control)
    if both == 0.0:
        return None
    deviations = (series - series.mean()) * (control - control.mean())
    correlation = float(deviations.mean() / both)
    if abs(correlation) * math.sqrt(series.size) <= SIGNIFICANT_SIGMAS:
        return None
    return correlation if LEAST_GAIN * (1.0 - correlation**2) <= 1.0 else None


def _of_the_others(series, control):
    """Coefficient for each realization from all others, shape (realizations,)."""
    count = series.shape[1] * (len(series) - 1)

    def others(values):
        rows = values.sum(axis=1)
        return rows.sum() - rows

    mean_series, mean_control = others(series) / count, others(control) / count
    covariance = others(series * control) - count * mean_series * mean_control
    return covariance / (others(control**2) - count * mean_control**2)
