"""Intervals of a linear model, whose covariance is a closed form."""

from itertools import pairwise
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import norm

from harvester.identification import intervals
from harvester.identification.intervals import HALF_INTERVAL, covariance, normal_equations
from harvester.identification.response import Experiment
from harvester.identification.sensors import without_states

SAMPLES, WINDOWS, UNKNOWNS = 6000, 3, 8
EDGES = np.linspace(0, SAMPLES, WINDOWS + 1).astype(int)


def fitted(effects, starts, residuals, edges=EDGES, base=None, solve=covariance):
    """What `covariance` asks for, of a model that is linear in unknowns and windows' starts.

    Shapes (samples, outputs, unknowns), (samples, outputs, 3) and (samples, outputs).
    """
    table = np.concatenate([effects, starts, residuals[..., None]], axis=2)
    with_base = base is not None
    base = base if with_base else np.zeros(len(residuals))
    shown = SimpleNamespace(acceleration=base, sampling_rate=1.0)
    shooting = SimpleNamespace(
        unknowns=[None] * effects.shape[2],
        experiments=[Experiment(shown, None, 2)],
        sizes=np.ones(effects.shape[2]),
        jacobian=lambda fit, number: (table, None),
        moved_by_noise=lambda fit, number, noise: np.repeat(
            resonant(noise)[:, None], residuals.shape[1], axis=1
        ),
    )
    fit = SimpleNamespace(
        edges=[edges], values=None, starts=[None], noise=[np.ones(residuals.shape[1])]
    )
    if with_base:
        return solve(shooting, fit)
    # Without the noise of a base the residuals' own spectrum has to give the covariance.
    nothing = np.zeros((effects.shape[2], effects.shape[2]))
    with mock.patch.object(intervals, "_covariance_of_scores", return_value=nothing):
        return solve(shooting, fit)


def test_an_interval_holds_95_percent_of_a_normal():
    assert pytest.approx(norm.ppf(0.975), rel=1e-3) == HALF_INTERVAL


@pytest.mark.parametrize("memory", [0.0, 0.8])
def test_white_and_coloured_residuals_have_their_covariance(memory):
    """σ² (JᵀJ)⁻¹ of white effects, whatever the residuals' own correlation; starts unknown too.

    A variance from twelve blocks is known to 40 % and only ever makes an interval wider, by up to
    half of itself and a tenth in the mean.
    """
    random = np.random.default_rng(8)
    effects = random.standard_normal((SAMPLES, 2, UNKNOWNS))
    # A start's effect decays, and an unknown's looks much like it.
    decay = np.exp(-np.arange(SAMPLES // WINDOWS) / 300.0)
    starts = np.zeros((SAMPLES, 2, 3))
    starts[:, :, 0] = np.tile(decay, WINDOWS)[:, None]
    effects[:, :, 0] = 3.0 * starts[:, :, 0] + 0.3 * effects[:, :, 0]
    noise = random.standard_normal((SAMPLES, 2)) * np.sqrt(1.0 - memory**2)
    residuals = 0.1 * lfilter([1.0], [1.0, -memory], noise, axis=0)
    found = np.sqrt(np.diag(fitted(effects, starts, residuals)))
    every = np.zeros((SAMPLES, 2, UNKNOWNS + WINDOWS))
    every[:, :, :UNKNOWNS] = effects
    for window, (begin, end) in enumerate(pairwise(EDGES)):
        every[begin:end, :, UNKNOWNS + window] = starts[begin:end, :, 0]
    flat = every.reshape(-1, UNKNOWNS + WINDOWS)
    exact = 0.1 * np.sqrt(np.diag(np.linalg.inv(flat.T @ flat)))[:UNKNOWNS]
    assert np.all(found > 0.9 * exact), found / exact
    assert np.mean(found / exact) < 1.25, found / exact
    assert np.all(found < 1.6 * exact), found / exact


def test_a_constant_is_known_less_well_under_residuals_with_a_memory():
    """Variance of the mean: (1 + a)/(1 − a) times that of independent residuals."""
    memory, ones = 0.8, np.ones((SAMPLES, 1, 1))
    ratios = []
    for seed in range(20):
        noise = np.random.default_rng(seed).standard_normal((SAMPLES, 1))
        residuals = lfilter([1.0], [1.0, -memory], noise * np.sqrt(1.0 - memory**2), axis=0)
        found = fitted(ones, np.zeros((SAMPLES, 1, 3)), residuals - residuals.mean())
        ratios.append(np.sqrt(found[0, 0] * SAMPLES * (1.0 - memory) / (1.0 + memory)))
    assert np.median(ratios) == pytest.approx(1.0, rel=0.2)


def test_only_an_error_of_a_value_that_is_not_fitted_is_no_noise():
    """Residuals of 1 ± 1: their mean widens an interval unless the value may still move."""
    residuals = 1.0 + np.random.default_rng(3).standard_normal((SAMPLES, 1))
    table = np.ones((SAMPLES, 1, 1)), np.zeros((SAMPLES, 1, 3)), residuals

    def moved(shooting, fit):
        return normal_equations(shooting, fit, at_minimum=False).covariance

    assert fitted(*table, solve=moved)[0, 0] * SAMPLES == pytest.approx(1.0, rel=0.5)
    assert fitted(*table)[0, 0] * SAMPLES > 10.0


RESONANCE = 2.0 * np.pi / 12.0
POLES = np.poly(np.exp(RESONANCE * np.array([-0.02 + 1j, -0.02 - 1j]))).real
# Samples of a record of 200 periods, and the noise of its base's sensor.
RECORD, BASE_NOISE = 2400, 0.01


def resonant(values):
    """Series through a resonance of twelve samples a period with a damping ratio of 0.02."""
    return lfilter([0.0, 1.0], POLES, values, axis=0)


def width_ratio(seed, output_noise, starts, edges):
    """Interval of a value that acts at the resonance, over its exact width.

    The base is a sine and white noise. var(Jᵀ r)/(JᵀJ)² with r = H n + e is
    σ_a² |Hᵀ J|² + σ_v² |J|², Hᵀ being H backwards in time.
    """
    random = np.random.default_rng(seed)
    sine = np.sin(RESONANCE * np.arange(RECORD))
    effect = resonant(resonant(sine + random.standard_normal(RECORD)))
    base = sine + BASE_NOISE * random.standard_normal(RECORD)
    left = resonant(BASE_NOISE * random.standard_normal(RECORD))
    left += output_noise * random.standard_normal(RECORD)
    left, seen = (
        without_states(values[:, None, None], starts[:, None], edges)[:, 0, 0]
        for values in (left, effect)
    )
    columns = effect[:, None, None], starts[:, None], left[:, None]
    variance = fitted(*columns, edges, base)[0, 0]
    back, square = resonant(seen[::-1]), seen @ seen
    exact = (BASE_NOISE**2 * back @ back + output_noise**2 * square) / square**2
    return np.sqrt(variance / exact)


def starts_of_windows(length):
    """Edges of windows of so many samples, and the effects of a resonance's two states in them."""
    edges = np.arange(0, RECORD + 1, length)
    edges[-1] = RECORD
    free = np.zeros((length * 2, 3))
    free[0, 0], free[1, 1] = 1.0, 1.0
    free = lfilter([1.0], POLES, free, axis=0)
    return np.concatenate([free[:size] for size in np.diff(edges)]), edges


@pytest.mark.parametrize(
    ("output_noise", "starts", "edges", "least"),
    [
        (0.03, np.zeros((RECORD, 3)), np.array([0, RECORD]), 0.9),
        # Of six periods each: their starts take the white noise in the motion's band as well.
        (0.3, *starts_of_windows(72), 0.95),
    ],
    ids=["one window", "short windows absorb most of it"],
)
def test_noise_of_the_base_s_sensor_is_in_the_interval(output_noise, starts, edges, least):
    """Of a value that acts at the resonance."""
    ratios = [width_ratio(seed, output_noise, starts, edges) for seed in range(12)]
    assert np.median(ratios) == pytest.approx(1.0, abs=0.15), ratios
    assert min(ratios) > least, ratios
