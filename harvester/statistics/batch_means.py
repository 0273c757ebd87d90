"""Standard errors of means and ratios from correlated batches.

Batches in time, pooled over realizations, are merged in pairs until neighbours are nearly
uncorrelated, and the remaining correlation is added to the variance (Flyvbjerg and Petersen, J.
Chem. Phys. 91, 461 (1989), stopped early). Ratios are linearised batch by batch (delta method). If
too few batches remain, there is no error bar.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from harvester.statistics.estimate import Estimate, why_no_error

if TYPE_CHECKING:
    from harvester.statistics.moments import Moments

# Minimum number of batches for a standard error, whose relative error is then 1/√(2·16) = 18 %.
FEWEST_BATCHES = 16
# The first-order correction is used up to this correlation of neighbouring batches.
LARGEST_CORRELATION = 0.25
# Minimum number of batches for merging that is due to negative correlation of neighbours.
FEWEST_TO_JOIN = 64
# Minimum effective number of batches. At seven, which correspond to ten correlation times, a mean
# of squares is within 1.96 standard errors in 94 % of runs.
FEWEST_EFFECTIVE = 7.0
# Standard errors are increased by this number over the effective number of batches. The scatter of
# few batches is uncertain, and a low mean of squares has a low scatter. From ten correlation times
# on, intervals then cover means of squares of Gaussian noise in 93 to 96 % of runs; without the
# increase, in 88 to 92 %.
RAISED = 2.5
# Neighbours of correlation c become nearly uncorrelated if batches are longer by the factor
# (first number)/(−ln c). For sequences that decorrelate within 3 and 8 batches, 94 and 87 % of runs
# of the advised length have an error bar. A correlation above the second number gives no time.
LENGTHS_TO_FORGET, LARGEST_LEFT = 2.5, 0.98
# Minimum number of batches, and maximum number of histogram groups, of all realizations together.
TOTAL_BATCHES = 256
TOTAL_GROUPS = 32
# Minimum number of batches per realization: their halves show whether the mean drifts. If all
# realizations have the same aperiodic path, it is larger, since batches are averaged over
# realizations before they are merged.
FEWEST_TO_DRIFT, FEWEST_ON_ONE_PATH = 4, 64
# Minimum number of knots of the noise in a batch.
KNOTS_PER_BATCH = 8
# A standard error of at most this share of its ratio is round-off, and is set to zero.
ROUNDING_SHARE = 1e-12
# A quantity whose batches or standard error deviate by less than this share, ten times the
# tolerance of a circuit solver, is constant: it is regulated and does not follow the motion.
CONSTANT_SHARE = 1e-5
# A single block of batches counts for at most this share of a ratio's denominator.
LARGEST_SHARE = 0.5
# Knots of the noise between two samples of a histogram, about ten samples per period of the motion.
KNOTS_PER_HISTOGRAM_SAMPLE = 4


def batch_counts(realizations: int, knots: float, one_path: bool = False) -> tuple[int, int]:
    """Batches and histogram groups per realization.

    `knots`: knots of the noise per realization, of which a batch contains several. `one_path`:
    whether all realizations have the same aperiodic path.
    """
    most = max(1, int(knots / KNOTS_PER_BATCH))
    fewest = FEWEST_ON_ONE_PATH if one_path else FEWEST_TO_DRIFT
    batches = min(max(-(-TOTAL_BATCHES // realizations), fewest), most)
    return batches, min(-(-TOTAL_GROUPS // realizations), batches)


def standard_error(series: np.ndarray, memory: float = 0.0) -> float | None:
    """Standard error of the mean of correlated batch means.

    Parameters
    ----------
    series : ndarray, shape (realizations, batches)
        Batches of equal duration; rows are independent of each other.
    memory : float
        Minimum correlation time in batches, ∫ of the autocorrelation from 0 on, since short runs
        underestimate it. It applies to the share of the scatter that may be common to neighbours.
        This share is small for the ratio of two powers that rise and fall together.

    Returns
    -------
    float or None
        None if fewer than `FEWEST_BATCHES` batches remain before they are uncorrelated, or if their
        effective number is below `FEWEST_EFFECTIVE`.
    """
    series = np.asarray(series, dtype=float)
    mean, error = series.mean(), None
    while series.size >= FEWEST_BATCHES:
        total, neighbours = _scatter(series, mean)
        if total == 0.0:
            return 0.0
        factor, expected = _implied(memory, series.shape[1])
        long_enough = memory <= 1.0 or series.shape[1] == 1
        if long_enough and neighbours <= _largest_correlation(expected, series.size):
            chance = 1.0 / math.sqrt(series.size)
            share = _share_in_common(neighbours, chance, expected)
            factor = max(1.0 + share * (factor - 1.0), 1.0 + 2.0 * neighbours)
            if neighbours < -chance:  # the part beyond chance, at least −1/2
                factor = 1.0 + 2.0 * (max(neighbours, -0.5) + chance)
            variance = min(factor, 1.0) * total / series.size
            error = _raised(variance, series.size / max(factor, 1.0))
            # If neighbours are anticorrelated, as rates of change are, longer batches scatter less.
            if neighbours >= -LARGEST_CORRELATION or series.size < FEWEST_TO_JOIN:
                return error
        series, memory = _joined(series), 0.5 * memory
    return error


def _implied(memory, batches):
    """Variance of the mean relative to independent batches, and correlation of neighbours.

    Both follow from an exponential autocorrelation with the time `memory`, in batches.
    """
    if memory <= 0.0 or batches == 1:
        return 1.0, 0.0

    def variance(length):
        return (length + math.expm1(-length)) / length**2

    batch = 1.0 / memory
    neighbours = 0.5 * math.expm1(-batch) ** 2 / (batch + math.expm1(-batch))
    share = (batches - 1.0) / batches
    return batches * variance(batches * batch) / variance(batch), share * neighbours


def _scatter(series, mean):
    """Sum of the squared deviations of batches, and the correlation of neighbours."""
    deviations = series - mean
    total = float(np.sum(deviations**2))
    return total, float(np.sum(deviations[:, 1:] * deviations[:, :-1])) / (total or 1.0)


def duration_for_error(series: np.ndarray, duration: float, memory: float) -> float:
    """Duration (s) per realization at which `standard_error` would roughly have an error bar.

    `series`: batches of a run that was too short, shape (realizations, batches); `duration`: its
    duration (s); `memory`: minimum correlation time (s).
    """
    correlation, length, mean = LARGEST_CORRELATION, duration / series.shape[1], series.mean()
    while series.size >= FEWEST_BATCHES:
        length, correlation = duration / series.shape[1], _scatter(series, mean)[1]
        # Deviations from a short run's mean underestimate the correlation by about this amount.
        correlation = min(correlation + (1.0 + 3.0 * correlation) / series.size, LARGEST_LEFT)
        series = _joined(series)
    lengths = LENGTHS_TO_FORGET / -math.log(max(correlation, LARGEST_CORRELATION))
    longest = max(FEWEST_BATCHES * lengths * length, FEWEST_EFFECTIVE * memory)
    return 2.0 * longest / len(series)


def student_factor(freedom: int) -> float:
    """Ratio of Student's 95 % interval for these degrees of freedom to the normal one."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, 0.975)) / 1.96


def deterministic_error(series: np.ndarray, drawn: bool = False) -> float | None:
    """Error of a mean over whole periods of a deterministic excitation.

    It includes the remaining transient: the change from the first to the second half. For another
    period or an aperiodic motion it includes the scatter of batches, as if they were random.
    Realizations differ only by their starts, so these are errors of the mean over realizations.

    Parameters
    ----------
    series : ndarray, shape (realizations, batches)
        Each batch contains whole periods.
    drawn : bool
        Whether starts are drawn randomly: see `error_of_starts`.

    Returns
    -------
    float or None
        None for a single batch or no batch.
    """
    series = np.asarray(series, dtype=float)
    mean = series.mean(axis=0, keepdims=True)
    chance = error_of_starts(series) if drawn else 0.0
    middle = mean.size // 2
    if middle == 0:
        return chance if drawn and series.size > 1 else None
    transient = abs(float(mean[:, -middle:].mean() - mean[:, :middle].mean()))
    scatter = standard_error(mean)
    if scatter is None:
        # Two or three batches rarely show their full scatter.
        factor = student_factor(mean.size - 1)
        scatter = factor * float(mean.std(ddof=1)) / math.sqrt(mean.size)
    # The scatter among aperiodic realizations has the same random cause, so the larger one counts.
    return math.hypot(transient, max(scatter, chance))


def error_of_starts(series: np.ndarray) -> float:
    """Standard error of a mean over independently drawn starts; 0 for a single start.

    The variance among the starts' means contains both parts: the multinomial variance among
    motions, and the variance within each motion. `series` has the shape (realizations, batches).
    """
    means = np.asarray(series, dtype=float).mean(axis=1)
    return float(means.std(ddof=1)) / math.sqrt(means.size) if means.size > 1 else 0.0


def standard_error_of_drift(series: np.ndarray, memory: float = 0.0) -> float | None:
    """Standard error of the mean if the strength of the excitation drifts, as in a single record.

    It uses differences of neighbouring batches (von Neumann, Ann. Math. Stat. 12, 367 (1941)), in
    which a slow drift cancels: the scatter of the mean among records with the same drift. Batches
    are merged until they are as long as `memory` and the correlation ρ between neighbours is small;
    ρ follows from the correlation (2ρ − 1)/(2 − 2ρ) of successive differences. See
    `standard_error`. A motion as slow as the drift counts as drift.
    """
    series = np.asarray(series, dtype=float)
    while series.size >= FEWEST_BATCHES and series.shape[1] > 2:
        steps = np.diff(series, axis=1)
        total = float(np.mean(steps**2))
        if total == 0.0:
            return 0.0
        successive = float(np.mean(steps[:, 1:] * steps[:, :-1])) / total
        neighbours = (1.0 + 2.0 * successive) / (2.0 + 2.0 * successive)
        factor, expected = _implied(memory, series.shape[1])
        if memory <= 1.0 and neighbours <= _largest_correlation(expected, series.size):
            if series.size < FEWEST_EFFECTIVE * factor:
                return None
            # A correlation from differences has √2 times the standard error of one from deviations.
            share = _share_in_common(neighbours, math.sqrt(2.0 / series.size), expected)
            neighbours = max(neighbours, share * expected, 0.0)
            factor = max(1.0 + 2.0 * neighbours, 1.0 + share * (factor - 1.0))
            return _raised(0.5 * total / (1.0 - neighbours), series.size / factor)
        series, memory = _joined(series), 0.5 * memory
    return None


def _share_in_common(neighbours, chance, expected):
    """Share of the scatter that may be common to neighbours, from their correlation.

    `chance`: standard error of that correlation; `expected`: the correlation if all scatter were
    common.
    """
    return min(max((neighbours + 2.0 * chance) / (expected or 1.0), 0.0), 1.0)


def _largest_correlation(expected, size):
    """Largest correlation of neighbours at which the correction factors are valid for `size`
    batches.
    """
    return max(LARGEST_CORRELATION, expected + 1.0 / math.sqrt(size))


def _raised(variance, effective):
    """Standard error of a mean for an effective number of batches; None if there are too few."""
    if effective < FEWEST_EFFECTIVE:
        return None
    return math.sqrt(variance / (effective - 1.0)) * (1.0 + RAISED / effective)


def _joined(series):
    """Merge batches in pairs; drop the first batch if their number is odd."""
    odd = series.shape[1] % 2
    return 0.5 * (series[:, odd::2] + series[:, odd + 1 :: 2])


def measured_time(moments: Sequence[Moments]) -> float:
    """Time that the integrals of all realizations cover (s); 0 before the first complete step."""
    return float(sum(realization.integrals[:, 0].sum() for realization in moments))


def complete_batches(moments: Sequence[Moments]) -> np.ndarray | None:
    """Batches that every realization completed, shape (realizations, batches, quantities)."""
    complete = min(
        int((m.time_reached - m.start) / m.batch_length + 1e-6) if m.time_reached > m.start else -1
        for m in moments
    )
    if complete < 0:
        return None
    if complete == 0:
        return np.stack([m.integrals[:1] for m in moments])
    return np.stack([m.integrals[:complete] for m in moments])


def ratio_of_sums(
    upper: np.ndarray, lower: np.ndarray, error_of: Callable = standard_error
) -> tuple[float, float | None]:
    """Ratio of two sums over batches and its standard error (None if the run is too short)."""
    ratio, deviations = float(upper.sum() / lower.sum()), ratio_deviations(upper, lower)
    error = error_of(deviations)
    # A value that is the same in all batches needs no independent batches.
    if error is None and deviations.size >= FEWEST_BATCHES and constant(ratio, deviations):
        error = float(np.ptp(deviations))
    # If the ratio is the same in all batches, its scatter is round-off.
    return ratio, 0.0 if error is not None and error <= ROUNDING_SHARE * abs(ratio) else error


def ratio_deviations(upper: np.ndarray, lower: np.ndarray) -> np.ndarray:
    """Deviations of batches from the ratio of their sums, with the mean 0.

    Without a block of batches, the ratio changes by the block's deviation, divided by 1 minus its
    share of the denominator (jackknife). The efficiency of a hardening device, which falls with the
    energy, scattered by 1.12 error bars without this factor, 1.06 with it (20 independent batches).
    """
    deviations: np.ndarray = (upper - upper.sum() / lower.sum() * lower) / lower.mean()
    equal = 1.0 / FEWEST_BATCHES
    if lower.size < FEWEST_BATCHES or np.ptp(lower) <= CONSTANT_SHARE * abs(lower.mean()):
        return deviations
    block = np.arange(lower.size) * FEWEST_BATCHES // lower.size
    share = np.bincount(block, lower.ravel()) / lower.sum()
    factor = (1.0 - equal) / (1.0 - np.clip(share, 0.0, LARGEST_SHARE))
    deviations = deviations * factor[block].reshape(lower.shape)
    return deviations - deviations.mean()


def constant(mean: float, deviations: np.ndarray | float) -> bool:
    """Whether deviations or an error are too small for a quantity that follows the motion."""
    return bool(np.max(np.abs(deviations)) <= CONSTANT_SHARE * abs(mean))


def ratio_estimate(
    upper: np.ndarray,
    lower: np.ndarray,
    dimension: str,
    nothing: str = "the denominator is 0",
    squares: np.ndarray | None = None,
    error_of: Callable = standard_error,
) -> Estimate:
    """Return `ratio_of_sums` as an `Estimate` of this dimension.

    Parameters
    ----------
    upper, lower : ndarray, shape (realizations, batches)
    nothing : str
        Reason for a missing ratio if `lower` is 0.
    squares : ndarray, optional
        Time integrals of the square of the quantity whose integral is `upper`, over the time
        `lower`. Its variance determines the effective sample size.
    error_of : callable
        See `harvester.statistics.run_quantities.estimate_all`.
    """
    if not lower.any():
        return Estimate(math.nan, None, None, dimension, nothing)
    ratio, error = ratio_of_sums(upper, lower, error_of)
    size = None
    if squares is not None:
        size = independent_samples(ratio, float(squares.sum() / lower.sum()), error)
    return Estimate(ratio, error, size, dimension, why_no_error(ratio, error))


def independent_samples(mean: float, mean_square: float, error: float | None) -> float | None:
    """Number of independent samples that would give a mean this standard error.

    None for a constant, whose variance is round-off.
    """
    if not error or constant(mean, error):
        return None
    return max(mean_square - mean**2, 0.0) / error**2


def independent_events(rate: float, error: float | None) -> float | None:
    """Number of independent events that would give a rate this standard error."""
    return (rate / error) ** 2 if error else None
