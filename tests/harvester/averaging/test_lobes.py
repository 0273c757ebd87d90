"""Orbits at a frozen charge: the minimum, and stoppers on either side."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq, minimize_scalar
from truths import flat

from harvester.averaging.lobes import HalfOrbits, Lobe
from harvester.averaging.symmetric import contact_damping, potential
from harvester.scene.model import Scene

PAPER = flat(Scene.load("paper"))
STIFF = PAPER._replace(gap=0.95, contact_stiffness=1000.0, restitution=0.3)
STIFFNESS = 6.0  # above ω0²: one minimum at every charge


def energy(p, charge, x):
    return potential(p, x) + 0.5 * STIFFNESS * (x - charge) ** 2


def lowest(p, charge):
    options = {"xatol": 1e-12}
    found = minimize_scalar(
        lambda x: energy(p, charge, x), bounds=(-1.5, 1.5), method="bounded", options=options
    )
    return found.x


@pytest.mark.parametrize("p", [PAPER, STIFF], ids=["free", "preloaded"])
@pytest.mark.parametrize("charge", [-0.9, 0.0, 0.5, 1.0])
def test_orbits_begin_at_the_only_minimum(p, charge):
    assert Lobe(p, STIFFNESS, charge).junction == pytest.approx(lowest(p, charge), abs=1e-6)


@pytest.mark.parametrize("height", [1e-3, 0.05, 3.0])
def test_orbits_on_the_left_stopper(height):
    """Area and contact loss by adaptive quadrature: pressed, leaving it, from side to side."""
    p, charge = STIFF, -STIFF.rest
    lobe, mirrored = (Lobe(p, STIFFNESS, z) for z in (charge, -charge))
    excess = np.array([height])
    half = HalfOrbits.of(lobe, lobe.outer_path(excess, 10)).after_mirrored(
        HalfOrbits.of(mirrored, mirrored.outer_path(excess, 10))
    )
    bottom = lowest(p, charge)
    top = energy(p, charge, bottom) + height
    ends = [brentq(lambda x: energy(p, charge, x) - top, bottom, far) for far in (-4.0, 4.0)]
    corners = [x for x in (-p.gap, p.gap) if ends[0] < x < ends[1]]

    def speed(x):
        return np.sqrt(2.0 * max(top - energy(p, charge, x), 0.0))

    def lost(x):
        return speed(x) * contact_damping(p, x, speed(x), 0.0)

    for integrand, found in (
        (speed, half.area[0]),
        (lost, half.integral(half.speed * half.damping)[0]),
    ):
        expected = 2.0 * quad(integrand, *ends, points=[bottom, *corners], limit=400)[0]
        assert found == pytest.approx(expected, rel=1e-4)
