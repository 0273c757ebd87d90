"""Distribution of a quantity among devices, share of them above a limit (yield), and effects.

The measured value of a device contains the noise of its run. The noise widens the distribution and
moves devices across the limit, mostly from the denser side. It is removed in two ways:

- The devices' values are contracted about their mean until their variance equals the variance
  without noise (see `sobol`), so that spread and quantiles describe the devices.
- The share above a limit changes in proportion to the variance of the noise if this is small. The
  mean of two replicates has half the noise variance. Therefore the share without noise is twice the
  share among means minus the share among single replicates (Richardson extrapolation; for
  measurement errors Cook and Stefanski, J. Am. Stat. Assoc. 89, 1314 (1994)).
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from harvester.studies.sensitivity.sobol import CONFIDENCE, Interval, interval, product

QUANTILES = (0.05, 0.5, 0.95)
# Quantiles of the devices at which a parameter counts as low and as high.
ENDS = (0.05, 0.95)
RESAMPLES = 1000


@dataclass(frozen=True)
class Yield:
    """The share of devices above a limit.

    Attributes
    ----------
    share : Interval
        Share corrected for the noise; its interval includes the random choice of devices and the
        noise.
    counted
        The share as counted, including the effect of the noise.
    """

    limit: float
    share: Interval
    counted: float
    devices: int


@dataclass(frozen=True)
class Population:
    """The distribution of a quantity among devices.

    Attributes
    ----------
    values : ndarray, shape (devices,)
        Devices' values, with their spread reduced by the contribution of the noise.
    """

    values: np.ndarray
    mean: Interval
    deviation: Interval
    quantiles: dict


def population(values: np.ndarray, variance: Interval, seed: int) -> Population:
    """The distribution among independent devices.

    Parameters
    ----------
    values : ndarray, shape (replicates, rows, devices in a row)
        Rows are independent of each other.
    variance
        Variance without noise, from `harvester.studies.sensitivity.sobol.indices`.
    seed
        Seed of the resampling.
    """
    means = values.mean(axis=0)
    centred = np.moveaxis(values - values.mean(), 2, 0)
    spread = np.mean([product(deviations, deviations) for deviations in centred], axis=0)
    devices = _contracted(means[None], spread[None])[0]
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(2,)))
    chosen = generator.integers(len(means), size=(RESAMPLES, len(means)))
    resampled = _contracted(means[chosen], spread[chosen]).reshape(RESAMPLES, -1)
    spread_of, *spread_ends = (
        math.sqrt(max(size, 0.0)) for size in (variance.estimate, *variance.interval)
    )
    ends = np.quantile(resampled, QUANTILES, axis=1)
    return Population(
        values=devices.ravel(),
        mean=interval(float(means.mean()), resampled.mean(axis=1)),
        deviation=Interval(spread_of, (spread_ends[0], spread_ends[1])),
        quantiles={
            q: interval(float(np.quantile(devices, q)), row)
            for q, row in zip(QUANTILES, ends, strict=True)
        },
    )


def _contracted(means, spread):
    """Scale devices' values about their mean to the variance without noise.

    `means` has the shape (samples, rows, devices in a row). `spread`, shape (samples, rows),
    contains squared deviations of a row's devices from the mean, without noise.
    """
    centre = means.mean(axis=(1, 2), keepdims=True)
    total = means.var(axis=(1, 2))
    share = np.divide(spread.mean(axis=1), total, out=np.zeros_like(total), where=total > 0.0)
    return centre + np.sqrt(np.clip(share, 0.0, 1.0))[:, None, None] * (means - centre)


def share_above(values: np.ndarray, limit: float) -> Yield:
    """The share of devices above a limit.

    The interval is Wilson's (J. Am. Stat. Assoc. 22, 209 (1927)) for the effective number of
    devices, which follows from the scatter of rows and is at most the actual number.

    Parameters
    ----------
    values : ndarray, shape (replicates, rows, devices in a row)
        Values of one or two replicates.
    """
    counted = values.mean(axis=0) > limit
    scores = counted.astype(float)
    if len(values) > 1:
        scores = 2.0 * scores - (values > limit).mean(axis=0)
    rows = scores.mean(axis=1)
    share, devices = float(min(max(rows.mean(), 0.0), 1.0)), counted.size
    scatter = float(rows.var(ddof=1)) / rows.size
    effective = devices
    if scatter > 0.0:
        effective = min(share * (1.0 - share) / scatter or devices, devices)
    z = float(ndtri(0.5 + 0.5 * CONFIDENCE))
    middle = (share + 0.5 * z * z / effective) / (1.0 + z * z / effective)
    reach = math.sqrt(share * (1.0 - share) / effective + 0.25 * (z / effective) ** 2)
    reach *= z / (1.0 + z * z / effective)
    interval_of_share = Interval(share, (max(middle - reach, 0.0), min(middle + reach, 1.0)))
    return Yield(limit, interval_of_share, float(counted.mean()), devices)


def effects(shares: np.ndarray, values: np.ndarray, seed: int) -> list[tuple[Interval, Interval]]:
    """Change of the quantity's mean if one parameter is low or high, averaged over the others.

    The model is a mean plus, for each parameter, a parabola in the share of devices with lower
    values. It is fitted by least squares. Rows are resampled for the intervals.

    Parameters
    ----------
    shares : ndarray, shape (rows, devices, parameters)
        Shares of the devices below each value, in (0, 1).
    values : ndarray, shape (rows, devices)

    Returns
    -------
    list of (Interval, Interval)
        Changes at low and high values of each parameter.
    """
    rows, _, count = shares.shape
    terms = np.concatenate([np.ones((*values.shape, 1)), *_parabola(shares)], axis=2)
    squares = np.einsum("rdi,rdj->rij", terms, terms)
    products = np.einsum("rdi,rd->ri", terms, values)
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(3,)))
    weights = generator.multinomial(rows, np.full(rows, 1.0 / rows), RESAMPLES)
    weights = np.vstack([np.ones(rows), weights])
    fits = [np.linalg.pinv(np.tensordot(w, squares, 1)) @ (w @ products) for w in weights]
    slopes, bends = np.array(fits)[:, 1 : count + 1], np.array(fits)[:, count + 1 :]
    intervals = []
    for k in range(count):
        low, high = (sum(np.multiply((slopes[:, k], bends[:, k]), _column(end))) for end in ENDS)
        intervals.append((interval(low[0], low[1:]), interval(high[0], high[1:])))
    return intervals


def _parabola(share):
    """Linear and quadratic basis functions, each with mean 0 over all devices."""
    return share - 0.5, (share - 0.5) ** 2 - 1.0 / 12.0


def _column(share):
    return np.array(_parabola(share))[:, None]
