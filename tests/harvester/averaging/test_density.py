"""Densities: Gibbs's where it holds, normalisation, marginals."""

import numpy as np
import pytest
from truths import averaged, flat, well

from harvester.device.system import potential
from harvester.scene.model import Scene

PAPER = flat(Scene.read("paper"))
LINEAR = flat(Scene.read("linear"))
WHITE = {"correlation_time": 1e-6, "coupling": 0.0, "restitution": 1.0, "damping": 0.1}


def composite_nodes(low, high, pieces, order=4):
    """Gauss–Legendre nodes and weights on equal pieces."""
    points, weights = np.polynomial.legendre.leggauss(order)
    edges = np.linspace(low, high, pieces + 1)
    half = 0.5 * np.diff(edges)[:, None]
    return (edges[:-1, None] + half * (points + 1.0)).ravel(), (half * weights).ravel()


@pytest.mark.slow
@pytest.mark.parametrize("closure", ["paper", "consistent"])
@pytest.mark.parametrize(
    "p",
    [
        PAPER._replace(**WHITE),
        PAPER._replace(**WHITE, intensity=0.2),
        PAPER._replace(**WHITE, gap=0.95),
        LINEAR._replace(**WHITE),
        LINEAR._replace(**WHITE, cubic_stiffness=3.0, gap=0.2, contact_stiffness=10.0),
    ],
    ids=["elastic", "strong", "preloaded", "harmonic", "hardening"],
)
def test_gibbs(p, closure):
    result = averaged(p, closure)
    reach = max(2.5 * well(p), 6.0 * np.sqrt(result.mean_square_displacement))
    x, weights = composite_nodes(-reach, reach, 100)
    rate = p.damping / p.intensity
    shape = np.exp(-rate * (potential(p.system, x) - potential(p.system, p.rest)))
    expected = shape / (weights @ shape)
    likely = expected > 1e-6 * expected.max()
    assert result.density.displacement(x)[likely] == pytest.approx(expected[likely], rel=1e-4)
    v = np.linspace(-4.0, 4.0, 15) / np.sqrt(rate)
    gauss = np.sqrt(rate / (2.0 * np.pi)) * np.exp(-0.5 * rate * v * v)
    assert result.density.velocity(v) == pytest.approx(gauss, rel=1e-4)
    top = (
        np.sqrt(rate / (2.0 * np.pi))
        * np.exp(rate * potential(p.system, p.rest))
        / (weights @ shape)
    )
    assert result.density.joint(0.0, 0.0) == pytest.approx(top, rel=1e-4)
    joint = result.density.joint(x[likely][::10, None], v[None, :])
    product = expected[likely][::10, None] * gauss
    assert joint == pytest.approx(product, rel=1e-4)
    assert result.mean_square_velocity == pytest.approx(p.intensity / p.damping, rel=1e-5)
    assert result.mean_square_displacement == pytest.approx(weights @ (expected * x**2), rel=1e-5)


CASES = [{"gap": 0.95}, {"intensity": 0.1}, {"linear_stiffness": 2.0}]


@pytest.mark.slow
@pytest.mark.parametrize("closure", ["paper", "consistent"])
@pytest.mark.parametrize("changes", CASES, ids=str)
def test_normalisation_and_marginals(changes, closure):
    result = averaged(PAPER._replace(**changes), closure)
    density = result.density
    x, x_weights = composite_nodes(-3.0, 3.0, 150)
    v, v_weights = composite_nodes(0.0, 5.0, 200)
    marginal, speeds = density.displacement(x), density.velocity(v)
    # The sum over edges jumps where one begins, which the independent grid cannot resolve.
    joint = density.joint(x[:, None], v[None, :])
    assert 2.0 * x_weights @ joint @ v_weights == pytest.approx(1.0, abs=2e-4)
    assert x_weights @ marginal == pytest.approx(1.0, abs=1e-4)
    assert 2.0 * v_weights @ speeds == pytest.approx(1.0, abs=1e-4)
    difference = np.abs(2.0 * joint @ v_weights - marginal)
    assert difference.max() < 5e-3 * marginal.max()
    assert x_weights @ difference < 1e-3
    assert x_weights @ (x**2 * marginal) == pytest.approx(result.mean_square_displacement, rel=1e-4)
    assert 2.0 * v_weights @ (v**2 * speeds) == pytest.approx(result.mean_square_velocity, rel=2e-4)
    assert density.joint(-0.7, 0.2) == pytest.approx(density.joint(0.7, -0.2), rel=1e-12)


def test_normalisation_to_six_digits():
    density = averaged(PAPER._replace(intensity=0.005), "consistent").density
    x, x_weights = composite_nodes(-2.0, 2.0, 120)
    v, v_weights = composite_nodes(0.0, 2.5, 80)
    joint = density.joint(x[:, None], v[None, :])
    assert 2.0 * x_weights @ joint @ v_weights == pytest.approx(1.0, abs=1e-6)
    assert 2.0 * joint @ v_weights == pytest.approx(density.displacement(x), abs=1e-6)


def test_shapes():
    density = averaged(LINEAR, "paper").density
    assert density.displacement(0.1).shape == ()
    assert density.velocity(np.zeros((2, 3))).shape == (2, 3)
    assert density.joint(np.zeros((4, 1)), np.zeros(5)).shape == (4, 5)
    assert density.displacement([]).shape == (0,)
    assert density.joint(1e3, 0.0) == 0.0
