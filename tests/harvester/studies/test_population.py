"""Distribution and yield of devices whose quantity is normal, measured with noise."""

import numpy as np
import pytest
from scipy.special import ndtr, ndtri
from scipy.stats import binomtest

from harvester.studies.sensitivity.population import population, share_above
from harvester.studies.sensitivity.sobol import design, indices


def measured(rows, seed, noise):
    """The sum of two normal parameters, variance 1; shape (replicates, rows, 4)."""
    values = ndtri(design(rows, 2, seed)).sum(axis=2) / np.sqrt(2.0)
    if not noise:
        return values[None]
    return values + noise * np.random.default_rng(seed).standard_normal((2, *values.shape))


@pytest.mark.parametrize("noise", [0.0, 0.6])
@pytest.mark.parametrize("limit", [0.0, 1.0, 2.0])
def test_the_yield_is_the_exact_one(noise, limit):
    """95 % intervals of 60 studies: fewer than 50 inside is one false alarm in 5000."""
    exact = 1.0 - ndtr(limit)
    found = [share_above(measured(64, seed, noise)[:, :, :2], limit) for seed in range(60)]
    assert sum(each.share.low <= exact <= each.share.high for each in found) >= 50
    shares = np.array([each.share.estimate for each in found])
    # The mean of all, to four of its errors; what extrapolation leaves is below 0.005.
    assert abs(shares.mean() - exact) < 4.0 * shares.std(ddof=1) / np.sqrt(60) + 0.005
    if noise and limit == 1.0:
        # As counted it is 0.02 higher, nine errors of this difference.
        more = np.array([each.counted for each in found]) - shares
        assert more.mean() > 4.0 * more.std(ddof=1) / np.sqrt(60)


def test_without_noise_the_interval_is_wilson_s():
    values = np.zeros((1, 20, 2))
    values[0, :7, 0] = 1.0
    found = share_above(values, 0.5)
    theirs = binomtest(7, 40).proportion_ci(0.95, method="wilson")
    # Devices differ within rows here, so that rows scatter less than single devices would.
    assert found.share.low == pytest.approx(theirs.low, abs=1e-12)
    assert found.share.high == pytest.approx(theirs.high, abs=1e-12)
    none = share_above(values, 2.0).share
    assert (none.low, none.estimate) == (0.0, 0.0)
    assert none.high == pytest.approx(binomtest(0, 40).proportion_ci(0.95, method="wilson").high)


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_the_distribution_is_without_the_noise(noise):
    """Deviation and quantiles within twice the half of their 95 % intervals: one in 10 000 each."""
    values = measured(512, 4, noise)
    found = population(values[:, :, :2], indices(values, 4).variance, 4)
    truths = [(found.mean, 0.0), (found.deviation, 1.0)]
    truths += [(each, ndtri(share)) for share, each in found.quantiles.items()]
    for each, truth in truths:
        assert abs(each.estimate - truth) < each.high - each.low
    assert found.values.size == 1024
    assert found.values.std() == pytest.approx(found.deviation.estimate, rel=0.01)
