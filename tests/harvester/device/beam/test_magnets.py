"""Magnets at a beam's tip against vectors of dipoles and integrals of their own."""

import itertools

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import j1

from harvester.base.errors import SceneError
from harvester.device.beam.lumped import Beam, lumped
from harvester.device.beam.magnets import (
    VACUUM_PERMEABILITY,
    Magnets,
    magnet_notes,
    magnetic_force,
    polynomial_fit,
    spring_points,
)
from harvester.scene.model import Scene
from harvester.scene.units import restoring_spring

BISTABLE = {"distance": 8e-3, "reach": 6e-3, "tip_moment": 0.2, "frame_moment": 0.2}
ATTRACTING = {**BISTABLE, "arrangement": "attracting", "spacing": 9e-3}
SLOPE = 29.18
VAN = {
    "length": 60e-3, "width": 15e-3, "thickness": 0.25e-3, "piezo_thickness": 0.2e-3,
    "material": "stainless steel", "piezo": "PZT-5H", "piezo_length": 30e-3,
    "connection": "parallel", "tip_material": "steel", "tip_length": 8e-3, "tip_height": 8e-3,
}  # fmt: skip


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
    disc = Magnets(distance=0.01, reach=0.005, remanence=1.2, frame_size=(4e-3, 2e-3))
    assert disc.moment("frame") == pytest.approx(1.2 * 8e-9 * np.pi / (4e-7 * np.pi), rel=1e-6)
    with pytest.raises(SceneError, match="give either tip_moment"):
        Magnets(distance=0.01, reach=0.005, tip_moment=0.1, **keys).moment("tip")


def test_wells_barrier_and_frequency_of_a_bistable_beam():
    scene = Scene.read("bimorph").replace(magnets=BISTABLE)
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


SIZES = {"remanence": 1.3, "tip_size": (10e-3, 3e-3), "frame_size": (10e-3, 3e-3)}


@pytest.mark.parametrize(("distance", "tip"), [(8e-3, (10e-3, 3e-3)), (5e-3, (6e-3, 2e-3))])
def test_force_of_parallel_discs(distance, tip):
    """Without rotation: ∫ J1(ka) J1(kb) J0(ky) exp(−kh)/k² dk of each pair of end faces."""
    magnets = Magnets(distance=distance, reach=6e-3, **{**SIZES, "tip_size": tip})
    (a, b), charge = (tip[0] / 2.0, 5e-3), 1.3 / VACUUM_PERMEABILITY
    k = np.linspace(1e-3, 30.0 / (distance - 3e-3), 20_001)
    for x in (1e-4, 3e-3, 6e-3):
        total = 0.0
        for one, other in itertools.product((1.0, -1.0), repeat=2):
            gap = distance + 1.5e-3 * other - tip[1] / 2.0 * one
            values = j1(k * a) * j1(k * b) * j1(k * x) * np.exp(-k * gap) / k
            total += one * other * np.trapezoid(values, k)
        expected = VACUUM_PERMEABILITY * charge**2 * np.pi * a * b * total
        found = magnetic_force(magnets, 0.0, x)
        assert found == pytest.approx(expected, rel=1e-4)


# dU/dx (N) at 0.1, 3 and 6 mm by magpylib 6.3.0, getFT with 3000 cells, a tip of 35.2 rad/m.
@pytest.mark.parametrize(
    ("distance", "expected"),
    [
        (8e-3, (-0.0453303, -1.195162, -1.614861)),
        (11e-3, (-0.01775038, -0.483525, -0.706676)),
        (20e-3, (-0.002100316, -0.0595710, -0.1001747)),
    ],
)
def test_force_and_torque_of_turned_discs(distance, expected):
    magnets = Magnets(distance=distance, reach=6e-3, **SIZES)
    found = magnetic_force(magnets, 35.19188200771001, [1e-4, 3e-3, 6e-3])
    assert found == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("keys", [{}, {"arrangement": "attracting", "spacing": 30e-3}])
def test_blocks_far_away_are_dipoles(keys):
    """A cube has no quadrupole: its dipole's force holds to the fourth power of size over r."""
    cube, dipole = (
        Magnets(distance=30e-3, reach=3e-3, remanence=1.2, **keys, **more)
        for more in (
            {"tip_size": (3e-3,) * 3, "frame_size": (3e-3,) * 3},
            {"tip_volume": 27e-9, "frame_volume": 27e-9},
        )
    )
    found = [magnetic_force(each, SLOPE, [1e-3, -2e-3], 6e-3) for each in (cube, dipole)]
    assert found[0] == pytest.approx(found[1], rel=1e-3)


def test_close_discs_leave_the_beam_monostable():
    """11 mm between discs of 10 × 3 mm: −178 N/m of 197 N/m, where dipoles have −539 N/m."""
    sizes = {**SIZES, "distance": 11e-3, "reach": 8e-3}
    scene = Scene.read("bimorph").replace({"beam": VAN}, magnets=sizes)
    spring = restoring_spring(scene.oscillator)
    made = lumped(scene.beam)
    assert made.stiffness == pytest.approx(196.86, rel=1e-3)
    assert float(spring.slope(0.0)) - made.stiffness == pytest.approx(-177.5, rel=2e-3)
    assert len(spring.roots()) == 1
    assert not magnet_notes(scene.magnets)
    volumes = {"tip_size": None, "frame_size": None, "tip_volume": 2.36e-7, "frame_volume": 2.36e-7}
    dipoles = scene.replace(magnets=volumes)
    assert len(restoring_spring(dipoles.oscillator).roots()) == 3
    (note,) = magnet_notes(dipoles.magnets)
    assert "dipoles are 1.8 magnet widths apart" in note


@pytest.mark.parametrize("place", [-4e-3, 0.0, 10e-3])
def test_a_magnet_lies_in_the_tips_body(place):
    """Energy of dipoles whose own is `place` beyond the beam's end, at x + place sin(turn)."""
    beam = Beam(**{**VAN, "tip_offset": place})
    magnets, slope = Magnets(**BISTABLE), lumped(beam).tip_slope

    def energy(x):
        turn = slope * x
        away = np.array([place * np.cos(turn) - place - 8e-3, x + place * np.sin(turn)])
        tip = 0.2 * np.array([np.cos(turn), np.sin(turn)])
        return 0.5 * lumped(beam).stiffness * x**2 - tip @ _field(np.array([-0.2, 0.0]), away)

    points = np.array(spring_points(magnets, beam))[::64]
    slopes = [(energy(x + 1e-6) - energy(x - 1e-6)) / 2e-6 for x in points[:, 0]]
    assert points[:, 1] == pytest.approx(slopes, rel=1e-5, abs=1e-6)
    own = Magnets(**BISTABLE, offset=0.0)
    same = np.array(spring_points(own, beam))[::64, 1] == pytest.approx(points[:, 1], rel=1e-9)
    assert same == (place == 0.0)


def test_a_polynomial_has_its_error():
    coefficients, error = polynomial_fit(Magnets(**BISTABLE), Scene.read("bimorph").beam)
    assert len(coefficients) == 8
    x = np.linspace(-6e-3, 6e-3, 101)
    made = lumped(Scene.read("bimorph").beam)
    exact = made.stiffness * x + magnetic_force(Magnets(**BISTABLE), made.tip_slope, x)
    assert np.abs(np.polynomial.Polynomial(coefficients)(x) - exact).max() <= error * 1.001


CLOSE = {**SIZES, "tip_moment": None, "frame_moment": None}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"reach": 0.05}, "would rotate by"),
        ({"spacing": 0.01}, "belongs to attracting"),
        ({"tip_moment": None}, "give either tip_moment"),
        ({"tip_moment": None, "tip_size": [5e-3, 3e-3], "remanence": 1.2}, "both tip_size and"),
        ({"distance": 11}, "11 mm is 0.011$"),
        ({**CLOSE, "remanence": 1300}, "1300 mT is 1.3$"),
        ({**CLOSE, "tip_size": [10, 3]}, r"tip_size\[0\] = 10: .*10 mm is 0.01$"),
        ({**CLOSE, "distance": 2.9e-3}, "magnets overlap"),
        ({**CLOSE, "distance": 3.5e-3, "reach": 1e-3}, "come too close"),
        ({**CLOSE, "distance": 3.5e-3}, "hits a magnet on the frame"),
        (
            {**CLOSE, "arrangement": "attracting", "distance": 2e-3, "spacing": 0.02},
            "hits a magnet on the frame: lower magnets.reach",
        ),
        ({"tip_moment": None, "tip_volume": 1e-7}, "needs magnets.remanence"),
    ],
)
def test_refusals(changes, message):
    with pytest.raises(SceneError, match=message):
        Scene.read("bimorph").replace(
            magnets={key: each for key, each in {**BISTABLE, **changes}.items() if each is not None}
        )
