"""Sobol indices of a noisy quantity, with intervals.

Every row of the design contains two independent devices a, b and, for each parameter i, the device
c_i: a with b's value of i. First-order index (Saltelli et al., Comput. Phys. Commun. 181, 259
(2010)) and total index (Jansen, Comput. Phys. Commun. 117, 35 (1999)) are

    S_i = ⟨y(b) [y(c_i) − y(a)]⟩ / Var,    T_i = ½⟨[y(a) − y(c_i)]²⟩ / Var.

A simulation gives Y = y + e with an error e of mean 0. If it is used unchanged, Y² and [Y(a) −
Y(c_i)]² contain ⟨e²⟩: total indices and the variance are too large, first-order indices too small.
Therefore every device is simulated twice, with independent noise in the two replicates, and each
product takes one factor from each: ⟨Y' Y''⟩ = y² + y⟨e'⟩ + y⟨e''⟩ + ⟨e' e''⟩ = y², and likewise for
the other two. This is exact for any length of run and for errors that differ between devices. The
devices of a row have common noise, which cancels in the differences as long as their paths agree;
the estimates do not depend on this. Rows are independent of each other, so that the bootstrap over
rows gives intervals that include the noise. The intervals ignore the uniform coverage by Sobol's
sequence, and are therefore wide rather than narrow.
"""

from dataclasses import dataclass

import numpy as np

RESAMPLES = 2000
# Probability content of an interval.
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Interval:
    """An estimate with its 95 % interval."""

    estimate: float
    interval: tuple[float, float]

    @property
    def low(self) -> float:
        """Lower end."""
        return self.interval[0]

    @property
    def high(self) -> float:
        """Upper end."""
        return self.interval[1]

    def __str__(self) -> str:
        return f"{self.estimate:.3f} ({self.low:.3f} … {self.high:.3f})"


@dataclass(frozen=True)
class Indices:
    """Sobol indices of a design, with their intervals.

    Attributes
    ----------
    first, total : list of Interval, or None
        One per parameter; None if the parameters' variance does not significantly exceed the noise.
    variance
        Variance of the quantity among devices, without the noise.
    noise_variance
        Variance of the mean of a device's replicates.
    """

    first: list[Interval] | None
    total: list[Interval] | None
    variance: Interval
    noise_variance: float


def design(rows: int, parameters: int, seed: int) -> np.ndarray:
    """Shares in (0, 1) of a design: devices a, b, c_1, c_2, … in each row.

    Parameters
    ----------
    rows
        A power of two.
    seed
        Seed of the scrambling of Sobol's sequence.

    Returns
    -------
    ndarray, shape (rows, parameters + 2, parameters)
    """
    from scipy.stats import qmc

    generator = np.random.default_rng(np.random.SeedSequence(seed))
    both = qmc.Sobol(2 * parameters, seed=generator).random(rows)
    a, b = both[:, :parameters], both[:, parameters:]
    exchanged = [np.where(np.arange(parameters) == i, b, a) for i in range(parameters)]
    return np.stack([a, b, *exchanged], axis=1)


def indices(values: np.ndarray, seed: int) -> Indices:
    """Sobol indices from the values of a design.

    Parameters
    ----------
    values : ndarray, shape (replicates, rows, parameters + 2)
        Values: of one replicate if there is no noise, else of two or more.
    seed
        Seed of the resampling.
    """
    y = values - values[:, :, :2].mean()
    a, b, exchanged = y[:, :, 0], y[:, :, 1], np.moveaxis(y[:, :, 2:], 2, 0)
    spread = 0.5 * (product(a, a) + product(b, b))
    first = np.array([product(b, c - a) for c in exchanged])
    total = np.array([0.5 * product(a - c, a - c) for c in exchanged])
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
    # Share of each row in each resample, shape (RESAMPLES, rows).
    size = spread.size
    weights = generator.multinomial(size, np.full(size, 1.0 / size), RESAMPLES) / size
    variances = weights @ spread
    variance = interval(float(spread.mean()), variances)
    noise = 0.0
    if len(values) > 1:
        noise = float(values[:, :, :2].var(axis=0, ddof=1).mean()) / len(values)
    if not variance.low > 0.0:
        return Indices(None, None, variance, noise)
    of_first, of_total = (
        [interval(float(row.mean() / spread.mean()), weights @ row / variances) for row in rows]
        for rows in (first, total)
    )
    return Indices(of_first, of_total, variance, noise)


def product(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Mean product, shape (rows,), of two quantities of shape (replicates, rows).

    The factors are always from different replicates.
    """
    count = len(left)
    if count == 1:
        return left[0] * right[0]
    same = np.sum(left * right, axis=0)
    return (left.sum(axis=0) * right.sum(axis=0) - same) / (count * (count - 1))


def interval(estimate: float, resampled: np.ndarray) -> Interval:
    """An estimate with the interval spanned by its resamples."""
    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = np.quantile(resampled, [tail, 1.0 - tail])
    return Interval(estimate, (float(low), float(high)))
