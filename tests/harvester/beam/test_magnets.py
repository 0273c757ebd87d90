"""Magnets at a beam's tip against vectors of dipoles and integrals of their own."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from harvester.beam.magnets import Magnets, magnetic_force, polynomial_fit
from harvester.beam.table import lumped
from harvester.errors import SceneError
from harvester.scene.model import Scene
from harvester.scene.units import restoring_spring

BISTABLE = {"distance": 8e-3, "reach": 6e-3, "tip_moment": 0.2, "frame_moment": 0.2}
ATTRACTING = {**BISTABLE, "arrangement": "attracting", "spacing": 9e-3}
SLOPE = 29.18


def _field(moment, r):
    """Flux density of a dipole at a place r away from it (T)."""
    size = np.linalg.norm(r)
    return 1e-7 * (3.0 * r * (moment @ r) / size**5 - moment / size**3)


def _direct(magnets, x):
    """Force across and torque on the tip's dipole, by the gradient of the frame's field."""
    tip = magnets.tip_moment * np.array([np.cos(SLOPE * x), np.sin(SLOPE * x)])
    sign = 1.0 if magnets.arrangement == "attracting" else -1.0
    places = (-0.5, 0.5) if magnets.arrangement == "attracting" else (0.0,)
    moment, total = sign * magnets.frame_moment * np.array([1.0, 0.0]), 0.0
    for place in places:
        r = np.array([0.0, x]) - np.array([magnets.distance, place * magnets.spacing])
        size, unit = np.linalg.norm(r), r / np.linalg.norm(r)
        inner = (
            (moment @ unit) * tip + (tip @ unit) * moment + (moment @ tip) * unit
            - 5.0 * (moment @ unit) * (tip @ unit) * unit
        )  # fmt: skip
        force = 3e-7 / size**4 * inner
        field = _field(moment, r)
        total -= force[1] + SLOPE * (tip[0] * field[1] - tip[1] * field[0])
    return total


def _energy(magnets, x):
    """−m·B of the tip's dipole in the frame's field (J)."""
    tip = magnets.tip_moment * np.array([np.cos(SLOPE * x), np.sin(SLOPE * x)])
    attracting = magnets.arrangement == "attracting"
    moment = (1.0 if attracting else -1.0) * magnets.frame_moment * np.array([1.0, 0.0])
    places = (-0.5, 0.5) if attracting else (0.0,)
    away = [np.array([-magnets.distance, x - each * magnets.spacing]) for each in places]
    return -sum(tip @ _field(moment, r) for r in away)


@pytest.mark.parametrize("keys", [BISTABLE, ATTRACTING])
def test_force_of_dipoles(keys):
    magnets = Magnets(**keys)
    for x in np.linspace(-6e-3, 6e-3, 13):
        expected = _direct(magnets, x)
        assert magnetic_force(magnets, SLOPE, x) == pytest.approx(expected, rel=1e-6, abs=1e-9)
    between = quad(lambda x: float(magnetic_force(magnets, SLOPE, x)), 1e-3, 5e-3, epsrel=1e-12)[0]
    ends = [_energy(magnets, x) for x in (1e-3, 5e-3)]
    assert ends[1] - ends[0] == pytest.approx(between, rel=1e-9)


def test_a_volume_is_a_moment():
    keys = {"remanence": 1.2, "tip_volume": 2e-7, "frame_volume": 2e-7}
    magnets = Magnets(distance=0.01, reach=0.005, **keys)
    assert magnets.moment("tip") == pytest.approx(1.2 * 2e-7 / (4e-7 * np.pi), rel=1e-6)


def test_wells_barrier_and_frequency_of_a_bistable_beam():
    scene = Scene.load("bimorph").replace(magnets=BISTABLE)
    made = lumped(scene.beam)
    magnets = Magnets(**BISTABLE)

    def force(x):
        step = np.array([0.0, x])
        return made.stiffness * x + _exact(magnets, made.tip_slope, step)[1]

    well = brentq(force, 1e-4, 6e-3, xtol=1e-16)
    barrier = -quad(force, 0.0, well, epsrel=1e-12)[0]
    slope = (force(well + 1e-7) - force(well - 1e-7)) / 2e-7
    spring = restoring_spring(scene.oscillator)
    found = [float(x) for x in spring.roots() if x > 1e-4]
    assert found == pytest.approx([well], rel=1e-3)
    height = float(spring.energy(0.0) - spring.energy(found[0]))
    assert height == pytest.approx(barrier, rel=1e-3)
    assert float(spring.slope(found[0])) == pytest.approx(slope, rel=2e-3)  # of the frequency 1e-3


def _exact(magnets, slope, x):
    """dU/dx by complex steps of the energy."""
    strength = 1e-7 * magnets.tip_moment * magnets.frame_moment
    z = x + 1e-30j
    r = np.sqrt(magnets.distance**2 + z**2)
    along = magnets.distance * np.cos(slope * z) - z * np.sin(slope * z)
    energy = -strength * (np.cos(slope * z) / r**3 - 3.0 * magnets.distance * along / r**5)
    return energy.imag / 1e-30


def test_a_polynomial_has_its_error():
    coefficients, error = polynomial_fit(Magnets(**BISTABLE), 1157.9, SLOPE)
    assert len(coefficients) == 8
    x = np.linspace(-6e-3, 6e-3, 101)
    exact = 1157.9 * x + magnetic_force(Magnets(**BISTABLE), SLOPE, x)
    assert np.abs(np.polynomial.Polynomial(coefficients)(x) - exact).max() <= error * 1.001


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"reach": 0.05}, "would turn by"),
        ({"spacing": 0.01}, "belongs to attracting"),
        ({"tip_moment": None}, "give either tip_moment"),
        ({"tip_moment": None, "tip_volume": 1e-7}, "needs magnets.remanence"),
    ],
)
def test_refusals(changes, message):
    with pytest.raises(SceneError, match=message):
        Scene.load("bimorph").replace(
            magnets={key: each for key, each in {**BISTABLE, **changes}.items() if each is not None}
        )
