"""A density is drawn in as many bins as its samples fill, and holds as much as before."""

from types import SimpleNamespace

import numpy as np
import pytest

from harvester.results.drawing import FEWEST_BINS, _merged
from harvester.statistics.estimate import Density, Estimate


def result(samples, random=True):
    centre = np.linspace(-5.0, 5.0, 400)
    noise = np.random.default_rng(1).normal(1.0, 0.2, 400)
    values = np.exp(-0.5 * centre**2) / np.sqrt(2.0 * np.pi) * noise
    return SimpleNamespace(
        densities={"voltage": Density(centre, values, 0.2 * values, "voltage")},
        scaled_quantities={"mean_square_voltage": Estimate(1.0, 0.1, samples, "voltage^2")},
        scene=SimpleNamespace(excitation=SimpleNamespace(random=random)),
    )


def test_few_samples_make_few_bins_that_hold_the_same():
    few, fine = _merged(result(50.0), "voltage"), result(50.0).densities["voltage"]
    assert FEWEST_BINS <= few.centre.size < 0.3 * fine.centre.size
    total, before = (np.trapezoid(each.density, each.centre) for each in (few, fine))
    assert total == pytest.approx(before, rel=0.01)
    exact = np.exp(-0.5 * few.centre**2) / np.sqrt(2.0 * np.pi)
    assert np.abs(few.density - exact).max() < 0.1
    assert np.all(few.standard_error >= 0.0)


def test_many_samples_keep_every_bin():
    assert _merged(result(1e8), "voltage").centre.size == 400


def test_a_periodic_motion_has_wide_bins_however_often_it_is_sampled():
    assert _merged(result(None, random=False), "voltage").centre.size < 1.5 * FEWEST_BINS
    assert _merged(result(None), "voltage").centre.size == 400
