import numpy as np
import pytest

from harvester.excitation.base import realization_seed
from harvester.excitation.ornstein_uhlenbeck import OrnsteinUhlenbeck, interpolation_loss


def path(seed=1, spacing=0.05):
    return OrnsteinUhlenbeck(0.02, 0.4).path(spacing, 1.0, np.random.SeedSequence(seed))


def test_blocks_of_any_size_give_the_same_bytes():
    whole = path().read(1000)
    stream = path()
    parts = np.concatenate([stream.read(n) for n in (1, 0, 7, 500, 492)])
    assert whole.tobytes() == parts.tobytes()


def test_the_samples_are_stationary_with_the_papers_autocorrelation():
    """False-alarm rate 1 %: three standard errors of independent paths, four times, fixed seed."""
    seeds = [realization_seed(2026, index) for index in range(4000)]
    noise = OrnsteinUhlenbeck(0.02, 0.4)
    paths = np.array([noise.path(0.05, 1.0, seed).read(41) for seed in seeds])
    for lag in (0, 8, 40):
        products = paths[:, 0] * paths[:, lag]
        expected = 0.02 / 0.4 * np.exp(-lag * 0.05 / 0.4)
        error = products.std() / np.sqrt(len(products))
        assert abs(products.mean() - expected) < 3 * error
    last = paths[:, 40] ** 2
    assert abs(last.mean() - 0.05) < 3 * last.std() / np.sqrt(len(last))


def test_the_interpolation_loss_is_what_linear_interpolation_takes():
    a = np.exp(-0.05 / 0.4)
    u = np.linspace(0, 1, 2001)
    kept = np.trapezoid((1 - u) ** 2 + u**2 + 2 * a * u * (1 - u), u)
    assert interpolation_loss(0.05, 0.4) == pytest.approx(1 - kept, rel=1e-5)


def test_realizations_have_the_seeds_that_spawning_them_all_gives():
    """The noise of earlier versions, byte for byte; never the same twice."""
    for index, seed in enumerate(np.random.SeedSequence(5).spawn(4)):
        own = realization_seed(5, index)
        assert own.spawn_key == seed.spawn_key
        np.testing.assert_array_equal(own.generate_state(8), seed.generate_state(8))
    noise = OrnsteinUhlenbeck(1.0, 1.0)
    paths = [noise.path(1.0, 1.0, realization_seed(5, index)).read(3) for index in range(2)]
    assert not np.array_equal(*paths)
