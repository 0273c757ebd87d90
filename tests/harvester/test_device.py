import numpy as np
import pytest
from scipy.integrate import quad
from truths import contact_force, flat

from harvester import forces
from harvester.scene import Scene


def parameters(*overrides):
    return flat(Scene.load("paper", overrides))


def test_the_force_is_the_potentials_derivative_on_both_sides():
    p = parameters()
    x = np.array([-1.6, -1.2, -1.05, -0.3, 0.0, 0.7, 1.0, 1.15, 1.7])
    step = 1e-6
    slope = (forces.potential(p, x + step) - forces.potential(p, x - step)) / (2 * step)
    np.testing.assert_allclose(forces.restoring_force(p, x), slope, rtol=1e-7, atol=1e-8)


def test_both_stoppers_push_inwards():
    p = parameters()
    bare = p._replace(contact_stiffness=0.0)
    x = np.array([-1.3, 1.3])
    extra = forces.restoring_force(p, x) - forces.restoring_force(bare, x)
    assert extra[0] < 0.0 < extra[1]


@pytest.mark.parametrize("gap", ["1.1", "0.95", "0.5"])
@pytest.mark.parametrize("mode", ["energy", "event"])
def test_the_contact_force_is_that_of_eq_5_on_either_side(gap, mode):
    p = parameters(f"stoppers.gap={gap}", f"stoppers.impact_velocity={mode}")
    random = np.random.default_rng(2)
    for side in (-1.0, 1.0):
        for depth, v in zip(10.0 ** random.uniform(-6, 0, 50), random.normal(size=50), strict=True):
            x = side * (p.gap + depth)
            held = abs(v) + random.uniform(0.0, 2.0)
            expected = contact_force(p, x, v, held if mode == "event" else None)
            assert forces.contact_force(p, x, v, held) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("gap", ["1.1", "0.95", "0.5", "1.0127108949553745"])
@pytest.mark.parametrize("impact_velocity", ["energy", "event"])
def test_the_speed_ratio_never_exceeds_one(gap, impact_velocity):
    p = parameters(f"stoppers.gap={gap}", f"stoppers.impact_velocity={impact_velocity}")
    random = np.random.default_rng(1)
    x = p.gap + 10.0 ** random.uniform(-9, 0.5, 5000)
    v = random.normal(size=5000) * 10.0 ** random.uniform(-6, 1, 5000)
    held = 10.0 ** random.uniform(-9, 1, 5000)
    depth = x - p.gap
    damping = forces.contact_damping(p, x, v, held) * np.abs(v)
    ratio = damping / (p.damping_factor * p.contact_stiffness * depth**1.5)
    assert np.all(np.isfinite(ratio))
    assert ratio.max() <= 1.0 + 1e-12


def test_the_impact_speed_is_the_speed_at_contact_of_a_free_orbit():
    p = parameters()
    speed = 0.4
    energy = 0.5 * speed**2 + forces.potential(p, p.gap)
    x = p.gap + 0.05
    v = np.sqrt(2.0 * (energy - forces.potential(p, x)))
    assert forces.impact_speed(p, x, v) == pytest.approx(speed, rel=1e-12)


def test_the_contact_time_is_the_hertz_integral():
    p = parameters()
    speed = 0.37
    deepest = (1.25 * speed**2 / p.contact_stiffness) ** 0.4
    duration = 2.0 * quad(lambda u: 2 * u / np.sqrt(1 - (1 - u * u) ** 2.5), 0, 1)[0]
    assert forces.contact_time(p, speed) == pytest.approx(duration * deepest / speed, rel=1e-7)


def test_the_contact_step_resolves_the_contact_and_keeps_soft_ones():
    soft = parameters()
    assert forces.contact_step(soft, 1.1, 0.1, 0.01, 30) == 0.01
    hard = parameters("stoppers.stiffness=1e6")
    expected = forces.contact_time(hard, 0.1) / 30
    assert forces.contact_step(hard, 1.1, 0.1, 0.05, 30) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("x", "v", "acceleration"),
    [(1.0, 4.0, 2.0), (1.0, 4.0, -1.0), (-1.09, 0.0, -5.0), (1.09, -0.05, 5.0), (1.0999, 0.3, 0.0)],
)
def test_a_step_before_a_contact_ends_short_of_it_or_resolves_it(x, v, acceleration):
    hard = parameters("stoppers.stiffness=1e8")
    step = forces.resolving_step(hard, x, v, acceleration, 0.0, 0.05, 30)
    times = np.linspace(0.0, step, 100)
    furthest = np.abs(x + v * times + 0.5 * acceleration * times**2).max()
    speed = abs(v) + abs(acceleration) * 0.05
    assert furthest < hard.gap or step <= forces.contact_time(hard, speed) / 30.0


def test_a_free_mass_far_from_the_stoppers_keeps_its_step():
    hard = parameters("stoppers.stiffness=1e8")
    assert forces.resolving_step(hard, 0.5, 1.0, 4.0, 1.0, 0.05, 30) == 0.05
    assert forces.resolving_step(hard, 1.0, -1.0, 4.0, 1.0, 0.05, 30) == 0.05
    assert forces.resolving_step(parameters("stoppers=none"), 0.5, 1.0, 4.0, 1.0, 0.05, 30) == 0.05
