"""Errors of means and densities of a device whose wells differ, from values that are drawn."""

import math

import numpy as np
import pytest

from harvester.statistics.well_balance import WellBalance

REALIZATIONS, BATCHES, GROUPS = 32, 8, 4
JUMPS = 4.0


def balance(draws, change=0.0):
    """Two wells: the first has each batch for a share that is drawn, half of the time on average.

    A jump more out of the second well changes that share by `change`.
    """
    share = draws.uniform(0.0, 1.0, (REALIZATIONS, BATCHES))
    features = np.stack([share, 1.0 - share], axis=2)
    changes = np.zeros((2, 2, 2))
    changes[1, 0] = change, -change
    return WellBalance(
        counts=np.array([[0.0, JUMPS], [JUMPS - 1.0, 0.0]]),
        times=np.ones(2),
        shares=np.array([0.5, 0.5]),
        exchange_time=1.0,
        weights=np.ones((REALIZATIONS, BATCHES)),
        features=features,
        balanced=np.array([0.5, 0.5]),
        innovations=np.zeros_like(features),
        changes=changes,
    )


def groups(series):
    """Means of each realization's groups of batches, shape (realizations × groups, 1)."""
    return series.reshape(REALIZATIONS * GROUPS, -1).mean(axis=1)[:, None]


def drawn(seed, slope=1.0, change=0.0):
    """A balance, and a series of noise of deviation 1 beside what follows the wells."""
    draws = np.random.default_rng(seed)
    found = balance(draws, change)
    series = slope * (found.features[:, :, 0] - 0.5) + draws.normal(size=found.weights.shape)
    return found, series


@pytest.mark.parametrize("slope", [0.0, 5.0])
def test_within_the_wells_the_error_is_that_of_as_many_independent_values(slope):
    """What follows the wells does not count: their shares are known by the jumps."""
    errors = {"batches": [], "groups": []}
    for seed in range(20):
        found, series = drawn(seed, slope)
        errors["batches"].append(found.error(series))
        errors["groups"].append(found.errors_of_groups(groups(series))[0])
    exact = 1.0 / math.sqrt(REALIZATIONS * BATCHES)
    for each in errors.values():
        assert np.mean(each) == pytest.approx(exact, rel=0.05)


def test_few_jumps_are_enough_where_most_of_an_error_lies_within_the_wells():
    # A slope of 1 and 4 jumps: their part of the variance is a third of that within the wells,
    # which has 128 values. Satterthwaite: (4/3)² / (1/128 + 1/36) = 50 samples, 16 are asked for.
    change = math.sqrt(1.0 / (3.0 * REALIZATIONS * BATCHES * JUMPS))
    found, series = drawn(1, change=change)
    assert found.error(series) is not None
    assert found.errors_of_groups(groups(series)) is not None
    # Ten times as much variance by the jumps leaves 4.5 samples.
    found, series = drawn(1, change=math.sqrt(10.0) * change)
    assert found.error(series) is None
    assert found.errors_of_groups(groups(series)) is None
