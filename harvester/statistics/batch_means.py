"""Standard errors of means and ratios from correlated batches.

Batches in time, pooled over realizations, are joined in pairs until neighbours are nearly
uncorrelated, and the remaining correlation is added to the variance (Flyvbjerg and Petersen,
J. Chem. Phys. 91, 461 (1989), stopped early). Ratios are linearised batch by batch (delta method).
If too few batches are left, there is no error bar.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from harvester.statistics.estimate import Estimate, why_no_error

if TYPE_CHECKING:
    from harvester.statistics.moments import Moments

# Fewest batches that give a standard error. It is then good to about 1/√(2·16) = 18 % of itself.
FEWEST_BATCHES = 16
# Up to this correlation between neighbouring batches the first-order correction is trusted.
LARGEST_CORRELATION = 0.25
# Fewest batches that are joined further because neighbours are correlated negatively.
FEWEST_TO_JOIN = 64
# A standard error of fewer effective batches covers too little: at seven, which ten correlation
# times give, a mean of squares lies within 1.96 standard errors in 94 % of runs.
FEWEST_EFFECTIVE = 7.0
# Standard errors are raised by this over the effective batches: few batches estimate their scatter
# badly, and a mean of squares that is too low comes with too low a scatter. Means of squares of
# Gaussian noise are then covered in 93 to 96 % from ten correlation times on, 88 to 92 % without.
RAISED = 2.5
# Neighbours correlated by c become nearly uncorrelated if they are the first over −ln c times as
# long: of sequences that forget within 3 and 8 batches, 94 and 87 % then have an error bar. A
# correlation above the second determines no time.
LENGTHS_TO_FORGET, LARGEST_LEFT = 2.5, 0.98
# Least number of batches, and largest number of groups of the histograms, of all realizations.
TOTAL_BATCHES = 256
TOTAL_GROUPS = 32
# Fewest batches of each of many realizations: their halves show whether the mean drifts.
# Realizations under one path without a period have more: their batches are averaged over them
# before they are joined.
FEWEST_TO_DRIFT, FEWEST_ON_ONE_PATH = 4, 64
# Fewest knots of the noise in a batch.
KNOTS_PER_BATCH = 8
# A standard error of at most this share of its ratio is rounding in the sums, and taken for zero.
ROUNDING_SHARE = 1e-12
# A quantity whose batches or standard error deviate by less than this share of it, ten times the
# tolerance of a circuit's solver, does not follow the motion: a regulator holds it.
CONSTANT_SHARE = 1e-5
# Knots of the noise between two samples of a histogram, about ten samples per period of the motion.
KNOTS_PER_HISTOGRAM_SAMPLE = 4


def batch_counts(realizations: int, knots: float, one_path: bool = False) -> tuple[int, int]:
    """Batches and histogram groups per realization.

    A batch spans several of a realization's `knots` of the noise. `one_path` is true if all
    realizations meet the same path, without a period.
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
        Equal batches in time; rows are independent of each other.
    memory : float
        Least correlation time in batches: ∫ of the autocorrelation from 0 on. Short runs do not
        show their own. It counts for the share of the scatter that neighbours may have in common:
        little of the ratio of two powers that rise and fall together.

    Returns
    -------
    float or None
        None if fewer than `FEWEST_BATCHES` batches are left before they are uncorrelated, or if
        they count as fewer than `FEWEST_EFFECTIVE`.
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
            if neighbours < -chance:  # of a correlation down to −1/2 what is beyond chance
                factor = 1.0 + 2.0 * (max(neighbours, -0.5) + chance)
            variance = min(factor, 1.0) * total / series.size
            error = _raised(variance, series.size / max(factor, 1.0))
            # Neighbours that cancel their predecessors, as rates of change do, scatter less in
            # longer batches.
            if neighbours >= -LARGEST_CORRELATION or series.size < FEWEST_TO_JOIN:
                return error
        series, memory = _joined(series), 0.5 * memory
    return error


def _implied(memory, batches):
    """Variance of the mean relative to independent batches, and correlation of neighbours.

    For an exponential autocorrelation with this time, in batches.
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
    """Duration (s) of each realization that would about give `standard_error` an error bar.

    `series` is of a run that was too short, of the given `duration` (s); shape (realizations,
    batches). `memory` is the least correlation time (s).
    """
    left, length, mean = LARGEST_CORRELATION, duration / series.shape[1], series.mean()
    while series.size >= FEWEST_BATCHES:
        length, left = duration / series.shape[1], _scatter(series, mean)[1]
        # Deviations from a short run's own mean are correlated by so much less.
        left = min(left + (1.0 + 3.0 * left) / series.size, LARGEST_LEFT)
        series = _joined(series)
    lengths = LENGTHS_TO_FORGET / -math.log(max(left, LARGEST_CORRELATION))
    longest = max(FEWEST_BATCHES * lengths * length, FEWEST_EFFECTIVE * memory)
    return 2.0 * longest / len(series)


def student_factor(freedom: int) -> float:
    """Half of Student's 95 % interval over a normal one's, at these degrees of freedom."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, 0.975)) / 1.96


def error_without_chance(series: np.ndarray, drawn: bool = False) -> float | None:
    """Error of a mean under a deterministic excitation, over whole periods of it.

    It holds the transient that remains: the change from the first to the second half. If the
    motion has another period or none, it holds how far batches scatter about that, as if each were
    by chance. Realizations differ by their starts alone, so that these are errors of their mean.

    Parameters
    ----------
    series : ndarray, shape (realizations, batches)
        Whole periods each.
    drawn : bool
        Whether realizations begin by chance: see `error_of_starts`.

    Returns
    -------
    float or None
        None for a single batch, or without a batch.
    """
    series = np.asarray(series, dtype=float)
    mean = series.mean(axis=0, keepdims=True)
    chance = error_of_starts(series) if drawn else 0.0
    middle = mean.size // 2
    if middle == 0:
        return chance if drawn and series.size > 1 else None
    left = abs(float(mean[:, -middle:].mean() - mean[:, :middle].mean()))
    scatter = standard_error(mean)
    if scatter is None:
        # Two or three batches rarely show how far they scatter.
        few = student_factor(mean.size - 1)
        scatter = few * float(mean.std(ddof=1)) / math.sqrt(mean.size)
    # Realizations that wander without a period scatter about each other by the same chance.
    return math.hypot(left, max(scatter, chance))


def error_of_starts(series: np.ndarray) -> float:
    """Standard error of a mean over independently drawn starts; 0 for a single one.

    The variance among motions, by the multinomial of their shares, and within each motion: both
    are that among the starts' own means. `series` has the shape (realizations, batches).
    """
    means = np.asarray(series, dtype=float).mean(axis=1)
    return float(means.std(ddof=1)) / math.sqrt(means.size) if means.size > 1 else 0.0


def standard_error_of_drift(series: np.ndarray, memory: float = 0.0) -> float | None:
    """Standard error of the mean where the strength of the excitation drifts, as in one record.

    From the differences of neighbouring batches (von Neumann, Ann. Math. Stat. 12, 367 (1941)),
    in which a slow drift cancels: the error of this mean among records that drift alike.
    Batches are joined until they last `memory` and the correlation ρ between neighbours, which
    gives their successive differences the correlation (2ρ − 1)/(2 − 2ρ), is small; see
    `standard_error`. A motion that is as slow as the drift counts as drift.
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
            # A correlation from differences scatters √2 times as far as one from deviations.
            share = _share_in_common(neighbours, math.sqrt(2.0 / series.size), expected)
            neighbours = max(neighbours, share * expected, 0.0)
            factor = max(1.0 + 2.0 * neighbours, 1.0 + share * (factor - 1.0))
            return _raised(0.5 * total / (1.0 - neighbours), series.size / factor)
        series, memory = _joined(series), 0.5 * memory
    return None


def _share_in_common(neighbours, chance, expected):
    """Share of the scatter that neighbours may have in common, from their correlation.

    `chance`: standard error of that correlation; `expected`: what it is of all the scatter.
    """
    return min(max((neighbours + 2.0 * chance) / (expected or 1.0), 0.0), 1.0)


def _largest_correlation(expected, size):
    """The largest correlation of neighbours, for a number of batches, that the factors allow."""
    return max(LARGEST_CORRELATION, expected + 1.0 / math.sqrt(size))


def _raised(variance, effective):
    """Standard error of a mean from its effective number of batches; None if these are few."""
    if effective < FEWEST_EFFECTIVE:
        return None
    return math.sqrt(variance / (effective - 1.0)) * (1.0 + RAISED / effective)


def _joined(series):
    """Batches joined in pairs; an odd one in front is dropped."""
    odd = series.shape[1] % 2
    return 0.5 * (series[:, odd::2] + series[:, odd + 1 :: 2])


def measured_time(moments: Sequence[Moments]) -> float:
    """Time that the integrals of all realizations hold (s); 0 before a first whole step."""
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
    """Ratio of two sums over batches and its standard error (None when too short)."""
    ratio = float(upper.sum() / lower.sum())
    deviations = (upper - ratio * lower) / lower.mean()
    error = error_of(deviations)
    # A value that is the same in every batch needs no number of independent ones.
    if error is None and deviations.size >= FEWEST_BATCHES and constant(ratio, deviations):
        error = float(np.ptp(deviations))
    # If the ratio is the same in every batch, its scatter is rounding.
    return ratio, 0.0 if error is not None and error <= ROUNDING_SHARE * abs(ratio) else error


def constant(mean: float, deviations: np.ndarray | float) -> bool:
    """Whether deviations or an error are too small for a quantity that follows the motion."""
    return bool(np.max(np.abs(deviations)) <= CONSTANT_SHARE * abs(mean))


def ratio_estimate(
    upper: np.ndarray,
    lower: np.ndarray,
    dimension: str,
    nothing: str = "there was none",
    squares: np.ndarray | None = None,
    error_of: Callable = standard_error,
) -> Estimate:
    """`ratio_of_sums` as a quantity of this dimension.

    Parameters
    ----------
    upper, lower : ndarray, shape (realizations, batches)
    nothing : str
        Why there is no ratio where `lower` is 0.
    squares : ndarray, optional
        Time integrals of the square of what `upper` integrates over the time `lower`: its variance
        determines the effective sample size.
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
    """Number of independent samples with this mean and mean square that would give this error.

    None for a constant: its variance is rounding.
    """
    if not error or constant(mean, error):
        return None
    return max(mean_square - mean**2, 0.0) / error**2


def independent_events(rate: float, error: float | None) -> float | None:
    """Number of independent events that would give a rate this error."""
    return (rate / error) ** 2 if error else None
