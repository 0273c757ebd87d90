"""Means of `paper` and `consistent`: references, limits, edge cases, errors."""

import math

import numpy as np
import pytest
from truths import averaged, flat, well

from harvester.base.errors import AveragingError
from harvester.scene.model import Scene

CLOSURES = ("paper", "consistent")
PAPER = flat(Scene.read("paper"))
LINEAR = flat(Scene.read("linear"))
MEANS = (
    "mean_square_voltage",
    "mean_power",
    "mechanical_loss",
    "power_conversion_efficiency",
    "mean_square_velocity",
    "mean_square_displacement",
    "share_in_wells",
)


@pytest.mark.parametrize(
    ("intensity", "correlation_time", "voltage", "efficiency", "deviation"),
    [
        (0.005, 0.4, 0.00782, 0.1512, 0.012),
        (0.02, 0.4, 0.02733, 0.1281, 0.012),
        (0.02, 1.0, 0.00786, 0.1526, -0.005),
    ],
)
def test_in_well_simulation(intensity, correlation_time, voltage, efficiency, deviation):
    """Deviations of E[V²] from Monte Carlo as the page `theory` tells them, to 0.1 %."""
    p = PAPER._replace(intensity=intensity, correlation_time=correlation_time)
    result = averaged(p, "consistent")
    assert result.mean_square_voltage == pytest.approx((1.0 + deviation) * voltage, rel=1e-3)
    assert result.power_conversion_efficiency == pytest.approx(efficiency, abs=0.004)
    assert result.share_in_wells > 0.99


@pytest.mark.parametrize("closure", CLOSURES)
def test_linear_device_at_small_damping(closure):
    """Closed form for white and coloured noise, to first order in damping and coupling."""
    damping, coupling, rate, memory = 1e-4, 1e-4, 1.5, 0.3
    p = LINEAR._replace(
        damping=damping, coupling=coupling, decay_rate=rate, correlation_time=memory
    )
    frequency, ratio = math.sqrt(p.linear_stiffness), 0.5 * damping / 2.0
    alpha, t, square = frequency / rate, frequency * memory, coupling / p.linear_stiffness
    common = alpha * (1 + square) * t**2 + 2 * ratio * alpha * t + alpha + t**3
    common += 2 * ratio * t**2 + t
    white = (
        square
        * alpha
        / (2 * ratio + (4 * ratio**2 + square) * alpha + 2 * ratio * (1 + square) * alpha**2)
    )
    expected = p.intensity * white * (t + alpha + 2 * ratio * alpha * t) / common
    assert averaged(p, closure).mean_power == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("closure", CLOSURES)
@pytest.mark.parametrize(
    ("changes", "excess", "tolerance"),
    [
        ({"coupling": 0.0, "intensity": 0.1}, {}, 1e-5),
        # N1 takes out what Eq. 10 delivers as ω² V² + X'² of a sine: the orbits are not quite.
        ({"linear_stiffness": 3.0}, {}, 1e-3),
        # In a well they are far from one.
        ({}, {"paper": -0.0624, "consistent": 0.0937}, 1e-3),
    ],
    ids=str,
)
def test_white_noise_power(changes, excess, tolerance, closure):
    """Whatever spring, stoppers and load: D per unit mass goes in, so much comes out.

    As far as Eq. 10 holds: `excess` is what it makes of the paper's device.
    """
    p = PAPER._replace(correlation_time=1e-6, **changes)
    result = averaged(p, closure)
    out = result.mechanical_loss + result.mean_power
    assert out == pytest.approx((1.0 + excess.get(closure, 0.0)) * p.intensity, rel=tolerance)


@pytest.mark.parametrize("closure", CLOSURES)
def test_numerical_error_covers_a_finer_grid(closure, monkeypatch):
    result = averaged(PAPER, closure)
    monkeypatch.setattr("harvester.averaging.over_orbits.LEVELS", 900)
    monkeypatch.setattr("harvester.averaging.over_orbits.NODES", 48)
    finer = averaged(PAPER, closure)
    for name in MEANS:
        error = result.numerical_error[name]
        assert error < 1e-4 * getattr(result, name)
        assert abs(getattr(finer, name) - getattr(result, name)) <= 1.1 * error


EDGE_CASES = [
    {"restitution": 0.0},
    {"restitution": 1.0, "contact_stiffness": 0.0},
    {"coupling": 0.0},
    {"coupling": 0.0, "damping": 0.0},
    {"gap": 0.2},
    {"gap": well(PAPER)},
    {"gap": 0.95, "held_impact_velocity": True},
    {"cubic_stiffness": 0.0},
    {"coupling": 3.99, "intensity": 1e-4},
    {"decay_rate": 1e-3, "intensity": 1e-4},
    {"decay_rate": 10.0, "intensity": 1.0},
    {"decay_rate": 0.3, "intensity": 1.0, "gap": 0.8},
    {"linear_stiffness": 0.0, "cubic_stiffness": 0.0},
    {"linear_stiffness": 4.0, "correlation_time": 30.0},
]


@pytest.mark.slow
@pytest.mark.parametrize("closure", CLOSURES)
@pytest.mark.parametrize("changes", EDGE_CASES, ids=str)
def test_edge_cases_are_finite(changes, closure):
    p = PAPER._replace(**changes)
    result = averaged(p, closure)
    values = [getattr(result, name) for name in MEANS]
    assert np.all(np.isfinite(values))
    assert min(values) >= 0.0
    assert 0.0 <= result.share_in_wells <= 1.0
    power = p.coupling * p.decay_rate * result.mean_square_voltage
    assert result.mean_power == pytest.approx(power, rel=1e-12)
    x = np.linspace(-2.0, 2.0, 21)
    for values in (result.density.joint(x[:, None], x), result.density.velocity(x)):
        assert np.all(np.isfinite(values))
        assert values.min() >= 0.0


@pytest.mark.parametrize("closure", CLOSURES)
def test_wells_of_simulation_and_print(closure):
    """The offset left out of the potential moves the wells from 1.013 to about 0.91."""
    x = np.linspace(0.7, 1.2, 501)
    density = averaged(PAPER._replace(intensity=1e-3), closure).density.displacement(x)
    lowest = {"consistent": well(PAPER), "paper": 0.906}[closure]
    assert x[np.argmax(density)] == pytest.approx(lowest, abs=0.01)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"correlation_time": 50.0}, "correlation_time=50 is above the relaxation time of (38|41)"),
        # Pressed against hard stoppers, the mass loses most of its energy at every contact.
        ({"gap": 0.5, "contact_stiffness": 1e6}, "above the relaxation time of 0.02.* contacts"),
        ({"coupling": 4.0}, "piezo's stiffness is 1 times .* leaves no double well"),
        ({"damping": 0.0, "coupling": 0.0, "restitution": 1.0}, "do not bound the energy"),
        ({"cubic_stiffness": 0.0, "contact_stiffness": 0.0}, "does not confine the motion"),
    ],
)
@pytest.mark.parametrize("closure", CLOSURES)
def test_refusals(changes, message, closure):
    with pytest.raises(AveragingError, match=message) as caught:
        averaged(PAPER._replace(**changes), closure)
    assert "\n" not in str(caught.value)


def test_unknown_closure():
    with pytest.raises(AveragingError, match="did you mean paper"):
        averaged(PAPER, "papers")


@pytest.mark.parametrize("closure", CLOSURES)
def test_other_units_of_time_and_length_change_nothing(closure):
    p = flat(Scene.read("paper"))
    rate, length = 30.0, 1e-3
    q = p._replace(
        damping=p.damping * rate,
        linear_stiffness=p.linear_stiffness * rate**2,
        cubic_stiffness=p.cubic_stiffness * (rate / length) ** 2,
        gap=p.gap * length,
        contact_stiffness=p.contact_stiffness * rate**2 / length**0.5,
        coupling=p.coupling * rate**2,
        decay_rate=p.decay_rate * rate,
        intensity=p.intensity * rate**3 * length**2,
        correlation_time=p.correlation_time / rate,
    )
    one, other = averaged(p, closure), averaged(q, closure)
    scaled = other.mean_square_voltage / length**2
    assert scaled == pytest.approx(one.mean_square_voltage, rel=1e-9)
    assert other.power_conversion_efficiency == pytest.approx(
        one.power_conversion_efficiency, rel=1e-9
    )
