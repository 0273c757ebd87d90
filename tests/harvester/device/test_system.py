import math

import numpy as np
import pytest
from scipy.integrate import quad
from truths import contact_force, flat

from harvester.device import contact as contacts
from harvester.device import spring as springs
from harvester.device import system, timescales
from harvester.device.contact import Contact
from harvester.device.hertz import hertz_damp
from harvester.device.polynomial import polynomial as polynomial_spring
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared

FREE = (-math.inf, math.inf)
UNEVEN = [0.3, -1.0, 0.2, 0.7, -0.1, 0.05, 0.01, 0.02]


def device(*overrides):
    return prepared(Scene.read("paper", overrides)).system


def zone(s, x):
    """The zone in which a displacement lies."""
    edges = contacts.edges(s.contacts)
    place = int(np.searchsorted(edges, x))
    return edges[place - 1], edges[place]


def derivative(function, x, step=1e-6):
    return (function(x + step) - function(x - step)) / (2.0 * step)


@pytest.mark.parametrize("coefficients", [UNEVEN, UNEVEN[:2], [0, 2.0], [0, -4, 0, 3.9], [1.0], []])
def test_a_spring_is_its_polynomial_and_its_energy_the_integral(coefficients):
    part = polynomial_spring(coefficients)
    x = np.linspace(-1.7, 1.8, 36)
    polynomial = np.polynomial.Polynomial(coefficients or [0.0])
    close = {"rtol": 1e-12, "atol": 1e-12}
    np.testing.assert_allclose(springs.force(part, x), polynomial(x), **close)
    np.testing.assert_allclose(springs.energy(part, x), polynomial.integ()(x), **close)
    slope = polynomial.deriv()(x)
    np.testing.assert_allclose(part.slope(x), slope, **close)
    assert np.all(springs.greatest_stiffness(part, x) >= np.abs(slope) - 1e-12)


def test_the_roots_of_a_spring_are_those_of_its_factors():
    expected = np.array([-1.3, -0.4, 0.1, 0.8, 2.0])
    part = polynomial_spring(np.polynomial.polynomial.polyfromroots(expected))
    np.testing.assert_allclose(part.roots(), expected, rtol=1e-9)


@pytest.mark.parametrize(
    "overrides",
    [
        [],
        ["stoppers=none"],
        ["stoppers=[{side='left', gap=0.6, stiffness=20, restitution=0.5, exponent=2.0}]"],
    ],
)
def test_the_force_is_the_potentials_derivative_on_both_sides(overrides):
    s = device(*overrides)
    x = np.array([-1.6, -1.2, -1.05, -0.3, 0.0, 0.7, 1.0, 1.15, 1.7])
    slope = derivative(lambda x: system.potential(s, x), x)
    np.testing.assert_allclose(system.elastic_force(s, x), slope, rtol=1e-7, atol=1e-8)


def test_both_stoppers_push_inwards():
    push = contacts.elastic_push(device().contacts, np.array([-1.3, 0.0, 1.3]))
    assert push[0] < 0.0 == push[1] < push[2]


@pytest.mark.parametrize("gap", ["1.1", "0.95", "0.5"])
@pytest.mark.parametrize("mode", ["energy", "event"])
def test_the_contact_force_is_that_of_eq_5_on_either_side(gap, mode):
    scene = Scene.read("paper", [f"stoppers.gap={gap}", f"stoppers.impact_velocity={mode}"])
    p, s = flat(scene), prepared(scene).system
    random = np.random.default_rng(2)
    for side in (-1.0, 1.0):
        for depth, v in zip(10.0 ** random.uniform(-6, 0, 50), random.normal(size=50), strict=True):
            x = side * (p.gap + depth)
            held = abs(v) + random.uniform(0.0, 2.0)
            expected = contact_force(p, x, v, held if mode == "event" else None)
            found = system.contact_force(s, x, v, held, *zone(s, x))
            assert found == pytest.approx(expected, rel=1e-9)


def test_a_pair_is_two_stoppers_and_one_side_leaves_the_other_free():
    law = hertz_damp(10.0, 0.6)
    spring = polynomial_spring([0.0, -4.0, 0.0, 3.9])
    pair = (Contact(0.0, 1.1, law),)
    two = (Contact(1.0, 1.1, law), Contact(-1.0, 1.1, law))
    for x in (-1.4, -1.11, -0.5, 0.0, 1.0, 1.2):
        limits = (-math.inf, -1.1) if x < -1.1 else (1.1, math.inf) if x > 1.1 else (-1.1, 1.1)
        forces = [contacts.force(each, spring, x, -0.3, 0.0, *limits) for each in (pair, two)]
        assert forces[0] == pytest.approx(forces[1], rel=1e-12)
        assert contacts.energy(pair, x) == pytest.approx(contacts.energy(two, x), rel=1e-12)
        if x > 0.0:
            assert contacts.energy(two[1:], x) == 0.0


@pytest.mark.parametrize("gap", ["1.1", "0.95", "0.5", "1.0127108949553745"])
@pytest.mark.parametrize("impact_velocity", ["energy", "event"])
def test_the_speed_ratio_never_exceeds_one(gap, impact_velocity):
    s = device(f"stoppers.gap={gap}", f"stoppers.impact_velocity={impact_velocity}")
    (each,) = s.contacts
    random = np.random.default_rng(1)
    x = each.gap + 10.0 ** random.uniform(-9, 0.5, 5000)
    v = random.normal(size=5000) * 10.0 ** random.uniform(-6, 1, 5000)
    held = 10.0 ** random.uniform(-9, 1, 5000)
    depth = x - each.gap
    gain = springs.energy(s.spring, x) - springs.energy(s.spring, each.gap)
    damping = each.law.damping(depth, v, gain, held) * np.abs(v)
    ratio = damping / (each.law.damping_factor * each.law.stiffness * depth**1.5)
    assert np.all(np.isfinite(ratio))
    assert ratio.max() <= 1.0 + 1e-12


def test_the_impact_speed_is_the_speed_at_contact_of_a_free_orbit():
    s = device()
    (each,) = s.contacts
    speed, x = 0.4, each.gap + 0.05
    energy = 0.5 * speed**2 + system.potential(s, each.gap)
    v = np.sqrt(2.0 * (energy - system.potential(s, x)))
    gain = springs.energy(s.spring, x) - springs.energy(s.spring, each.gap)
    assert each.law.impact_speed(0.05, v, gain) == pytest.approx(speed, rel=1e-12)


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.5])
def test_the_contact_time_is_the_integral_over_an_elastic_contact(exponent):
    law = hertz_damp(10.0, 0.7, exponent)
    speed, order = 0.37, exponent + 1.0
    deepest = law.greatest_depth(0.5 * speed**2)
    assert law.elastic_energy(deepest) == pytest.approx(0.5 * speed**2, rel=1e-12)
    duration = 2.0 * quad(lambda u: 2 * u / np.sqrt(1 - (1 - u * u) ** order), 0, 1)[0]
    assert law.duration(speed) == pytest.approx(duration * deepest / speed, rel=1e-7)


def test_the_contact_step_resolves_the_contact_and_keeps_soft_ones():
    soft = device().contacts
    assert contacts.step(soft, 1.1, 0.01, 0.01, 30) == 0.01
    hard = device("stoppers.stiffness=1e6").contacts
    expected = hard[0].law.duration(0.1) / 30
    assert contacts.step(hard, 1.1, 0.01, 0.05, 30) == pytest.approx(expected)


def test_the_contact_step_is_that_of_the_speed_at_which_the_contact_began():
    """Deep in the stopper what is left of the speed would ask for far too long a step."""
    (each,) = hard = device("stoppers.stiffness=1e6").contacts
    for share in (0.0, 0.6, 1.0):
        depth = share * each.law.greatest_depth(0.5 * 0.1**2)
        left = 0.1**2 - 2.0 * each.law.elastic_energy(depth)
        for x in (1.1 + depth, -1.1 - depth):
            step = contacts.step(hard, x, max(left, 0.0), 0.05, 30)
            assert step == pytest.approx(each.law.duration(0.1) / 30)


@pytest.mark.parametrize(
    ("x", "v", "acceleration"),
    [(1.0, 4.0, 2.0), (1.0, 4.0, -1.0), (-1.09, 0.0, -5.0), (1.09, -0.05, 5.0), (1.0999, 0.3, 0.0)],
)
def test_a_step_before_a_contact_ends_short_of_it_or_resolves_it(x, v, acceleration):
    hard = device("stoppers.stiffness=1e8")
    step = system.resolving_step(hard, -1.1, 1.1, x, v, acceleration, 0.0, 0.05, 30)
    times = np.linspace(0.0, step, 100)
    furthest = np.abs(x + v * times + 0.5 * acceleration * times**2).max()
    speed = abs(v) + abs(acceleration) * 0.05
    assert furthest < 1.1 or step <= hard.contacts[0].law.duration(speed) / 30.0


def test_a_free_mass_far_from_the_stoppers_keeps_its_step():
    hard, bare = device("stoppers.stiffness=1e8"), device("stoppers=none")
    for s, limits, x, v in (
        (hard, (-1.1, 1.1), 0.5, 1.0),
        (hard, (-1.1, 1.1), 1.0, -1.0),
        (bare, FREE, 0.5, 1.0),
    ):
        assert system.resolving_step(s, *limits, x, v, 4.0, 1.0, 0.05, 30) == 0.05


def test_what_flows_in_is_stored_or_lost():
    """d/dt of the stored energy is ηX' less damper, contacts and resistor, at random states."""
    s = device("oscillator.quadratic_damping=0.3")
    random = np.random.default_rng(4)
    for x, v, voltage, eta in random.normal(size=(50, 4)):
        low, high = zone(s, x)
        a = system.push(s, x, v, voltage, eta) - system.contact_force(s, x, v, 0.0, low, high)
        rate = system.state_rate(s.transducer, v, voltage)

        def stored(t, x=x, v=v, voltage=voltage, a=a, rate=rate):
            return system.stored_energy(s, x + v * t, v + a * t, voltage + rate * t)

        lost = system.loss_power(s, x, v, 0.0, True)
        lost += system.load_power(s.transducer, v, voltage)
        assert derivative(stored, 0.0) == pytest.approx(eta * v - lost, rel=1e-6, abs=1e-6)


def test_wells_and_saddles_alternate_and_lie_where_no_force_is():
    for name in ("paper", "asymmetric", "one_sided", "tristable", "electromagnetic"):
        s = prepared(Scene.read(name)).system
        wells, saddles = timescales.wells(s), timescales.saddles(s)
        assert len(wells) == len(saddles) + 1
        found = sorted((*wells, *saddles))
        assert set(found[::2]) == set(wells)
        np.testing.assert_allclose([system.elastic_force(s, x) for x in found], 0.0, atol=1e-8)
        assert all(timescales.stiffness(s, x) > 0.0 for x in wells)
        assert all(timescales.stiffness(s, x) < 0.0 for x in saddles)


@pytest.mark.parametrize("resistance", [1e3, 3e4, 7e4, 1e7])
def test_the_frequency_with_a_load_is_that_of_the_eigenvalues(resistance):
    mass, rate, coupling, capacitance = 12e-3, 2.0 * np.pi * 48.0, 1.9e-3, 45e-9
    scene = Scene.from_tables(
        {
            "units": "SI",
            "oscillator": {"mass": mass, "frequency": 48.0, "quality_factor": 60.0},
            "piezo": {"coupling": coupling, "capacitance": capacitance},
            "load": {"resistance": resistance},
            "excitation": {"kind": "white", "intensity": 1.0},
            "run": {"duration": 1.0},
        }
    )
    rows = [
        [0.0, 1.0, 0.0],
        [-(rate**2), -rate / 60.0, -coupling / mass],
        [0.0, coupling / capacitance, -1.0 / (resistance * capacitance)],
    ]
    expected = np.linalg.eigvals(np.array(rows)).imag.max()
    assert timescales.loaded_frequency(prepared(scene).system) == pytest.approx(expected, rel=5e-4)
