"""Orbit integrals against closed forms and adaptive quadrature."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import ellipk
from truths import flat, well

from harvester.averaging.orbits import Edge, OrbitFamily
from harvester.device.contact import loss_rate
from harvester.scene.model import Scene

NODES = 32
PAPER = flat(Scene.read("paper"))
LINEAR = flat(Scene.read("linear"))
DUFFING = flat(Scene.read("duffing"))


def outer_orbits(parameters, excess, added=0.0):
    """With this ½X'² at X = 0; their integrals are over a quarter of the phase plane."""
    level = np.log(np.asarray(excess, dtype=float))
    return OrbitFamily(Edge(parameters.system), level, np.full_like(level, added), NODES)


def test_harmonic_orbits():
    orbits = outer_orbits(LINEAR, [1e-6, 1.0, 50.0], added=0.5)
    frequency = math.sqrt(LINEAR.linear_stiffness + 0.5)
    energy = np.array([1e-6, 1.0, 50.0])
    assert orbits.frequency == pytest.approx(frequency, rel=1e-12)
    assert 4.0 * orbits.time == pytest.approx(2.0 * math.pi / frequency, rel=1e-12)
    moments = {name: 4.0 * quarter for name, quarter in orbits.enclosed.items()}
    assert moments["1"] == pytest.approx(2.0 * math.pi * energy / frequency, rel=1e-12)
    # Enclosed ∬v² of an ellipse of semi-axes a, b (of v): π a b³/4.
    assert moments["X'²"] == pytest.approx(math.pi * energy**2 / frequency, rel=1e-12)
    assert moments["X²"] == pytest.approx(math.pi * energy**2 / frequency**3, rel=1e-12)


def test_outer_period_of_the_double_well():
    """T = 4 K(m)/Ω, Ω² = κA² − ω0², m = κA²/(2Ω²)."""
    amplitude = np.array([1.5, 2.0, 5.0])
    stiff, cubic = DUFFING.linear_stiffness, DUFFING.cubic_stiffness
    energy = 0.5 * stiff * amplitude**2 + 0.25 * cubic * amplitude**4
    orbits = outer_orbits(DUFFING, energy)
    rate = stiff + cubic * amplitude**2
    expected = 4.0 * ellipk(0.5 * cubic * amplitude**2 / rate) / np.sqrt(rate)
    assert orbits.right == pytest.approx(amplitude, rel=1e-12)
    assert 4.0 * orbits.time == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("level", [-12.0, -3.0, 0.0, 4.0, 10.0])
def test_well_period_of_the_double_well(level):
    """T = 2 K(1 − b²/a²)/(a √(κ/2)) between turning points b < a, near the saddle too."""
    level = np.array([level])
    orbits = OrbitFamily(Edge(DUFFING.system, inside=True), level, np.zeros(1), NODES)
    inner, outer = orbits.left[0], orbits.right[0]
    twice = 2.0 * well(DUFFING) ** 2
    assert inner**2 + outer**2 == pytest.approx(twice, rel=1e-10)
    # From the level itself: r = 1 − b/well, so that no digits are lost next to the saddle.
    ratio = well(DUFFING) / (1.0 + math.exp(level[0])) / math.sqrt(twice - inner**2)
    expected = 2.0 * ellipk(1.0 - ratio**2) / (outer * math.sqrt(0.5 * DUFFING.cubic_stiffness))
    assert 2.0 * orbits.time[0] == pytest.approx(expected, rel=1e-7)


def test_bounce_between_stoppers_lasts_the_contact_time():
    p = LINEAR._replace(linear_stiffness=0.0, gap=1.0, contact_stiffness=10.0, restitution=1.0)
    speed = np.array([0.1, 1.0, 10.0])
    orbits = outer_orbits(p, 0.5 * speed**2)
    expected = 4.0 * p.gap / speed + 2.0 * p.system.contacts[0].law.duration(speed)
    assert 4.0 * orbits.time == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("gap", [0.9, 1.0126, 1.1, 1.3])
@pytest.mark.parametrize("level", [-0.5, 0.5, 2.0])
def test_integrals_in_a_well_with_stopper(gap, level):
    p = PAPER._replace(gap=gap)
    anchored = Edge(p.system, inside=True, anchor=p.rest)
    added, pivot = 0.7, 0.3
    orbits = OrbitFamily(anchored, np.array([level]), np.array([added]), NODES)
    bottom = anchored.bottom(np.array([added]))[0]
    left, energy = orbits.left[0], orbits.energy[0]

    def kinetic(x):
        return energy - float(anchored.energy(x, added))

    right = brentq(kinetic, bottom, 3.0, xtol=1e-15)
    assert orbits.right[0] == pytest.approx(right, rel=1e-9)

    def loop(weight):
        def integrand(angle):
            x = left + (right - left) * math.sin(angle) ** 2
            speed = math.sqrt(max(2.0 * kinetic(x), 1e-30))
            return weight(x, speed) * (right - left) * math.sin(2.0 * angle)

        touch = math.asin(math.sqrt(min(max((gap - left) / (right - left), 0.0), 1.0)))
        return sum(
            quad(integrand, *ends, epsabs=1e-10, limit=200)[0]
            for ends in ((0.0, touch), (touch, 0.5 * math.pi))
        )

    def work(x, speed):
        return speed * loss_rate(p.system.contacts, p.system.spring, x, speed, 0.0)

    assert orbits.loop(1.0)[0] == pytest.approx(loop(lambda x, speed: speed), rel=1e-6)
    assert orbits.time[0] == pytest.approx(loop(lambda x, speed: 1.0 / speed), rel=1e-5)
    # The bounded impact speed of a preloaded stopper has a kink inside the contact.
    tolerance = 2e-4 if p.rest > gap else 1e-5
    assert orbits.contact_work[0] == pytest.approx(loop(work), rel=tolerance, abs=1e-9)
    moment = loop(lambda x, speed: speed * (x - pivot) ** 2)
    found = orbits.loop((orbits.x - pivot) ** 2)
    assert found[0] == pytest.approx(moment, rel=1e-6)


def test_area_grows_by_the_period():
    """dJ/dE = T while N2 is the same, also of halves."""
    level = np.array([-1e-4, 0.0, 1e-4]) + 0.7
    orbits = OrbitFamily(Edge(PAPER.system, inside=True), level, np.full(3, 0.4), NODES)
    area = orbits.loop(1.0)
    slope = (area[2] - area[0]) / (orbits.energy[2] - orbits.energy[0])
    assert slope == pytest.approx(orbits.time[1], rel=1e-6)


def test_end_of_the_well_is_its_saddle_or_the_weakest_place():
    anchored = Edge(DUFFING.system, inside=True, anchor=well(DUFFING))
    softening = -DUFFING.linear_stiffness
    added = np.array([0.0, 0.1, 0.2]) * softening
    end = anchored.well_end(added)
    assert anchored.slope(end, added) == pytest.approx(np.zeros(3), abs=1e-10)
    assert np.all(anchored.slope(end + 1e-3, added) < 0.0)
    # Beyond ω0²/4 the far well and the saddle have merged: the slope keeps its sign.
    end = anchored.well_end(np.array([0.6 * softening]))
    assert anchored.slope(end, 0.6 * softening)[0] < 0.0
    curvature = 3.0 * DUFFING.cubic_stiffness * end**2 - 0.4 * softening
    assert curvature[0] == pytest.approx(0.0, abs=1e-10)


def test_bottom_of_the_pressed_well():
    p = PAPER._replace(gap=0.8)
    edge = Edge(p.system, inside=True)
    added = np.array([0.0, 0.5, 2.0])
    bottom = edge.bottom(added)
    assert edge.slope(bottom, added) == pytest.approx(np.zeros(3), abs=1e-12)
    assert bottom[0] == pytest.approx(p.rest, rel=1e-12)
    assert bottom[2] < p.gap < bottom[0]
