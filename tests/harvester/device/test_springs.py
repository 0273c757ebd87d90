"""Springs by a table and within a range, against scipy's own interpolation."""

from itertools import pairwise

import numpy as np
import pytest
from device_scenes import MAGNETS
from device_truths import Tabulated
from scipy.integrate import quad

from harvester.device import timescales
from harvester.device.force_table import force_table
from harvester.device.polynomial import polynomial
from harvester.device.spring import ranged
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared

REACH = np.linspace(-2.5, 2.5, 401)
TABLES = [(MAGNETS, "monotone"), (MAGNETS, "smooth")]


@pytest.mark.parametrize(("points", "interpolation"), TABLES)
def test_a_table_is_scipys_and_its_energy_the_integral(points, interpolation):
    made = force_table(points, interpolation)
    truth = Tabulated(*np.array(points).T, smooth=interpolation == "smooth")
    close = {"rtol": 1e-12, "atol": 1e-12}
    np.testing.assert_allclose(made.force(REACH), [truth.force(x) for x in REACH], **close)
    np.testing.assert_allclose(made.energy(REACH), [truth.energy(x) for x in REACH], **close)
    inside = REACH[np.abs(REACH) < 1.5]
    np.testing.assert_allclose(made.slope(inside), truth.slope(inside), rtol=1e-10, atol=1e-10)
    assert made.force(float(REACH[7])) == pytest.approx(made.force(REACH)[7], rel=1e-14)


def test_a_monotone_table_passes_no_point():
    made = force_table(MAGNETS)
    for (x0, f0), (x1, f1) in pairwise(MAGNETS):
        between = made.force(np.linspace(x0, x1, 50))
        assert min(f0, f1) - 1e-12 <= between.min()
        assert between.max() <= max(f0, f1) + 1e-12


def test_taylors_coefficients_are_those_of_the_piece():
    made = force_table(MAGNETS)
    for x in (-2.0, -1.1, 0.17, 0.9, 1.9):
        about = np.polynomial.Polynomial([float(made.force(x)), *made.taylor(x)])
        for way in (-0.02, 0.03):
            assert made.force(x + way) == pytest.approx(about(way), rel=1e-11, abs=1e-12)


def test_roots_and_turning_points_are_where_force_and_energy_say():
    made = force_table(MAGNETS)
    roots = made.roots()
    assert roots.size == 3
    np.testing.assert_allclose(made.force(roots), 0.0, atol=1e-12)
    bottom = made.energy(roots).min()
    for energy in (0.01, 0.3, 5.0, 60.0):
        ends = made.turning_points(energy)
        np.testing.assert_allclose(made.energy(np.array(ends)), bottom + energy, rtol=1e-9)
        assert ends[0] < roots[np.argmin(made.energy(roots))] < ends[1]


def test_a_sampled_cubic_has_the_cubics_wells_barrier_and_frequency():
    scene = Scene.read("duffing")
    linear, cubic = scene.oscillator.linear_stiffness, scene.oscillator.cubic_stiffness
    x = np.linspace(-1.6, 1.6, 33)
    points = [[float(each), float(linear * each + cubic * each**3)] for each in x]
    well, barrier = (-linear / cubic) ** 0.5, linear**2 / (4.0 * cubic)
    for interpolation, share in (("monotone", 2e-3), ("smooth", 1e-10)):
        made = scene.replace(
            {
                "oscillator.force_table": points,
                "oscillator.force_interpolation": interpolation,
            }
        )
        system = prepared(made).system
        assert system.symmetric
        assert timescales.wells(system) == pytest.approx((well, -well), rel=share)
        assert timescales.saddles(system) == pytest.approx((0.0,), abs=1e-12)
        assert timescales.barrier(system, well) == pytest.approx(barrier, rel=share)
        # The slope of PCHIP is of second order between points.
        square = timescales.stiffness(system, timescales.wells(system)[0])
        assert square == pytest.approx(-2.0 * linear, rel=20.0 * share)


def test_a_root_at_zero_is_zero():
    """Else a monostable device would have its rest position's rounding as length unit."""
    x = np.linspace(-4e-3, 4e-3, 33)
    made = force_table([[float(each), float(157.9 * each + 1.6e7 * each**3)] for each in x])
    assert made.roots().tolist() == [0.0]


def test_a_straight_table_is_a_linear_spring():
    made = force_table([[-1.0, -3.0], [2.0, 6.0]])
    assert made.straight
    assert made.linear == pytest.approx(3.0)
    np.testing.assert_allclose(made.force(REACH), 3.0 * REACH, rtol=1e-14)


@pytest.mark.parametrize(
    "inner", [polynomial([0.1, 2.0, 0.3, -0.7]), force_table(MAGNETS)], ids=["powers", "table"]
)
def test_a_spring_within_a_range_leads_back_from_beyond(inner):
    made = ranged(inner, -0.9, 1.1)
    inside = REACH[(REACH > -0.9) & (REACH < 1.1)]
    np.testing.assert_array_equal(made.force(inside), inner.force(inside))
    assert made.force(-50.0) < 0.0 < made.force(50.0)
    assert np.all((made.roots() > -0.9) & (made.roots() < 1.1))
    for x in (-2.0, -0.5, 0.8, 2.4):
        integral = quad(lambda y: float(made.force(y)), 0.0, x, points=[-0.9, 1.1], limit=200)[0]
        assert made.energy(x) == pytest.approx(integral, rel=1e-7)
