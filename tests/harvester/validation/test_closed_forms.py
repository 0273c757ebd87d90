"""Closed forms, against formulas and quadratures written out here."""

import math

import pytest
from scipy.integrate import quad

from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.validation.closed_forms import closed_forms, gibbs, small_motion

ZETA, COUPLING, RATIO = 0.01, 0.1, 1.0


def linear_system(correlation_time):
    overrides = [
        f"oscillator.damping={2 * ZETA}",
        "oscillator.linear_stiffness=1",
        f"piezo.coupling={COUPLING}",
        f"load.decay_rate={1 / RATIO}",
        "excitation.intensity=1",
        f"excitation.correlation_time={correlation_time}",
    ]
    return prepared(Scene.read("linear", overrides)).system


@pytest.mark.parametrize(("time", "power"), [(0.1, 0.694558), (1.0, 0.342642), (10.0, 0.007002)])
def test_a_linear_device_has_the_power_of_the_closed_form(time, power):
    """E[P]/D of a linear harvester under Ornstein–Uhlenbeck noise, by partial fractions."""
    means = small_motion(linear_system(time), 1e-3 * time, 1)
    square, error = means["mean_square_voltage"]
    assert error == 0.0
    assert COUPLING / RATIO * square == pytest.approx(power, rel=2e-4)


def test_it_holds_for_small_motion_only():
    for intensity, holds in ((1e-6, True), (1e-4, True), (1e-2, False)):
        scene = Scene.read("paper", [f"excitation.intensity={intensity}"])
        assert bool(closed_forms(prepared(scene), 4).get("small motion")) == holds
    # Stoppers that the motion reaches; an open piezo, whose charge settles nowhere.
    near = Scene.read("paper", ["excitation.intensity=1e-4", "stoppers.gap=1.013"])
    assert closed_forms(prepared(near), 4) == {}


def test_gibbs_is_the_quadrature_over_the_potential():
    scene = Scene.read(
        "duffing",
        [
            "oscillator.damping=1",
            "piezo.coupling=0",
            "excitation.intensity=0.5",
            "excitation.correlation_time=1e-3",
        ],
    )
    means = gibbs(prepared(scene).system)
    cubic = scene.oscillator.cubic_stiffness
    temperature = 0.5 / 1.001

    def weight(x):
        return math.exp(-(-2.0 * x * x + 0.25 * cubic * x**4) / temperature)

    square = quad(lambda x: x * x * weight(x), -4, 4)[0] / quad(weight, -4, 4)[0]
    assert means["mean_square_velocity"][0] == pytest.approx(temperature)
    assert means["mean_square_displacement"][0] == pytest.approx(square, rel=1e-6)
    assert gibbs(prepared(Scene.read("paper")).system) == {}
