"""One step of the Fokker–Planck equation on a grid: shares, moments and precision."""

import math

import numpy as np
import pytest
from truths import flat

from harvester.averaging.flow import PhaseGrid, lagrange
from harvester.averaging.propagator import Propagator, mirrored
from harvester.scene.model import Scene

PAPER = flat(Scene.read("paper"))
LINEAR = flat(Scene.read("linear"))


def test_shares_keep_moments():
    """Lagrange weights share a mass such that moments up to the fifth stay."""
    nodes, place = np.arange(6.0), np.array([1.3, 2.71])
    weights = lagrange(place, nodes)
    for power in range(6):
        assert weights @ nodes**power == pytest.approx(place**power)


@pytest.mark.parametrize("memory", [1e-6, 0.3])
def test_steps_of_a_free_mass(memory):
    """Without forces, exactly: variances of X' under white and coloured noise, whatever the step.

    The propagator starts with X' = 0 and η stationary; X'(t) has variance
    2Dτ1 (t/τ1 − 1 + exp(−t/τ1)).
    """
    p = LINEAR._replace(
        damping=0.0, linear_stiffness=1e-12, coupling=0.0, intensity=0.05, correlation_time=memory
    )
    x, v = np.linspace(-40.0, 40.0, 401), np.linspace(-4.0, 4.0, 160)
    propagator = Propagator(p.system, PhaseGrid(x, v, np.array([-0.5, 0.5]), True, 8, 0.5))
    state = np.zeros(propagator.grid.shape)
    width = 0.3
    state[:, 0, 0] = np.exp(-0.5 * (x[:, None] / 4.0) ** 2 - 0.5 * (v / width) ** 2)
    state /= state[:, :, 0].sum()
    for _ in range(4):
        state = propagator.step(state)
    time = 2.0 / memory
    gained = 2.0 * p.intensity * memory * (time - 1.0 + math.exp(-time))
    assert state[:, :, 0].sum() == pytest.approx(1.0, abs=1e-9)
    assert np.sum(state[:, :, 0] * v**2) == pytest.approx(width**2 + gained, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("columns", [8, 9, 46])
def test_steps_in_single_precision(columns):
    """The same as in double precision but for rounding; all mass is kept, whatever fills a row."""
    x, v = np.linspace(-1.6, 1.6, 40), np.linspace(-1.2, 1.2, columns)
    grid = PhaseGrid(x, v, np.linspace(-1.5, 1.5, 6), True, 3, 0.7)
    start = np.random.default_rng(5).normal(size=grid.shape)
    propagator = Propagator(PAPER.system, grid)
    exact, single = (each.repeated(start, 4) for each in (propagator, propagator.single()))
    assert single.dtype == np.float32
    assert np.abs(single - exact).max() < 1e-5 * np.abs(exact).max()
    once = propagator.single().step(start)
    assert once == pytest.approx(propagator.step(start), abs=1e-5 * np.abs(exact).max())
    assert exact[:, :, 0].sum() == pytest.approx(start[:, :, 0].sum(), abs=1e-10)


def test_mirrored_twice_is_the_same():
    state = np.random.default_rng(1).normal(size=(3, 4, 6, 5))
    assert np.array_equal(mirrored(mirrored(state)), state)
