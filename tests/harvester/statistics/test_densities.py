"""Errors of densities, from numbers of samples that are drawn."""

import numpy as np
import pytest

from harvester.engines.realization import empty_moments
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.statistics.densities import densities
from harvester.statistics.joint import JointHistogram
from harvester.statistics.joint_density import joint_density

RUNS, SAMPLES = 40, 500
SHARES = np.array([0.1, 0.4, 0.3, 0.2])


def test_the_error_of_a_density_is_that_of_its_number_of_samples():
    """A fifth of it is the chance of the scatter of forty groups."""
    draws, moments = np.random.default_rng(1), []
    for _ in range(RUNS):
        one = empty_moments(prepared(Scene.read("linear", [f"run.realizations={RUNS}"])))
        middle = one.histograms.shape[2] // 2
        for group in one.histograms[:, 0]:
            group[middle - 2 : middle + 2] = draws.multinomial(SAMPLES, SHARES)
        moments.append(one)
    groups = RUNS * len(moments[0].histograms)
    found = densities(moments, symmetric=False)["displacement"]
    width = found.centre[1] - found.centre[0]
    exact = np.sqrt(SHARES * (1.0 - SHARES) / (groups * SAMPLES))
    assert found.standard_error * width == pytest.approx(exact, rel=0.4)
    assert np.abs(found.density * width - SHARES).max() < 4.0 * exact.max()


def test_the_error_of_a_joint_density_is_that_of_its_number_of_samples():
    draws, histograms = np.random.default_rng(1), []
    for _ in range(RUNS):
        one = JointHistogram.empty(0.0, 1.0)
        middle = np.array(one.counts.shape) // 2
        four = draws.multinomial(SAMPLES, SHARES).reshape(2, 2)
        one.counts[middle[0] - 1 : middle[0] + 1, middle[1] - 1 : middle[1] + 1] = four
        one.bin_widths[:] = 1.0
        histograms.append(one)
    found = joint_density(histograms, symmetric=False)
    area = np.prod([each[1] - each[0] for each in (found.displacement, found.velocity)])
    exact = np.sqrt(SHARES * (1.0 - SHARES) / (RUNS * SAMPLES)).reshape(2, 2)
    assert found.standard_error * area == pytest.approx(exact, rel=0.4)
