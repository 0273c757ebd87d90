"""Figs. 2 and 3 against closed forms and independent quadrature."""

import json
import math

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq
from truths import flat

from harvester.results import figures
from harvester.scene.model import Scene
from harvester.validation import orbit_maps

SCENE = Scene.read("paper")
P = flat(SCENE)


@pytest.fixture(scope="module")
def maps():
    return orbit_maps.surfaces(SCENE), orbit_maps.orbit_voltages(SCENE)


def added_stiffness(frequency):
    return P.coupling * frequency**2 / (P.decay_rate**2 + frequency**2)


def nearest(values, value):
    return int(np.argmin(np.abs(values - value)))


def test_frequency_at_the_bottom_of_a_well_is_that_of_small_oscillations(maps):
    """ω² = U'' = 2 (ω0² − N2(ω)) at the well of Eq. 15, clear of the stopper."""
    exact = brentq(lambda w: w**2 - 2 * (-P.linear_stiffness - added_stiffness(w)), 1.0, 3.0)
    assert np.nanmax(maps[0].frequency) == pytest.approx(exact, rel=2e-3)


@pytest.mark.parametrize(("x", "v"), [(0.0, 1.5), (1.2, 1.0), (0.3, 1.9)])
def test_frequency_of_an_outer_orbit_is_that_of_eq_16(maps, x, v):
    surfaces = maps[0]
    row, column = nearest(surfaces.velocity, v), nearest(surfaces.displacement, x)
    x, v = surfaces.displacement[column], surfaces.velocity[row]

    def potential(place, n2):
        value = 0.5 * (P.linear_stiffness + n2) * place**2 + 0.25 * P.cubic_stiffness * place**4
        return value + 0.4 * P.contact_stiffness * max(abs(place) - P.gap, 0.0) ** 2.5

    def mismatch(frequency):
        n2 = added_stiffness(frequency)
        energy = 0.5 * v * v + potential(x, n2)
        end = brentq(lambda place: potential(place, n2) - energy, 1.0, 3.0, xtol=1e-14)
        # x = end · sin a takes the turning point's singularity away.
        quarter = quad(
            lambda a: (
                end
                * math.cos(a)
                / math.sqrt(2 * max(energy - potential(end * math.sin(a), n2), 1e-300))
            ),
            0.0,
            math.pi / 2,
            points=[math.asin(P.gap / end)],
            limit=200,
        )[0]
        return frequency - math.pi / (2 * quarter)

    assert surfaces.frequency[row, column] == pytest.approx(brentq(mismatch, 0.8, 3.0), rel=1e-4)


def test_energy_is_zero_in_the_wells_and_symmetric(maps):
    energy = maps[0].energy
    assert 0.0 < energy.min() < 2e-3
    np.testing.assert_allclose(energy, energy[::-1, ::-1], rtol=1e-9)


def test_the_checked_voltage_is_the_periodic_solution_of_eq_4b(maps):
    """V' + λV = X' integrated in time until it repeats, on one orbit inside a well."""
    response = maps[1].responses["with stoppers"]["wells"]
    frequency, lowest, highest = response.checked[2]
    n2 = added_stiffness(frequency)
    bottom = math.sqrt((-P.linear_stiffness - n2) / P.cubic_stiffness)

    def motion(t, y):
        x, v, voltage = y
        contact = P.contact_stiffness * max(abs(x) - P.gap, 0.0) ** 1.5 * math.copysign(1.0, x)
        force = (P.linear_stiffness + n2) * x + P.cubic_stiffness * x**3 + contact
        return [v, -force, v - P.decay_rate * voltage]

    def period(right):
        def back(t, y):
            return y[1] if t > 0.5 else -1.0

        back.terminal, back.direction = True, -1.0
        path = solve_ivp(motion, (0.0, 60.0), [right, 0.0, 0.0], events=back, rtol=1e-9)
        return path.t_events[0][0]

    right = brentq(
        lambda x: period(x) - 2 * math.pi / frequency, bottom + 0.02, bottom + 0.32, xtol=1e-6
    )
    path = solve_ivp(motion, (0.0, 200.0), [right, 0.0, 0.0], rtol=1e-8, max_step=0.05)
    late = path.y[2][path.t > 190.0]
    assert late.min() == pytest.approx(lowest, rel=0.01)
    assert late.max() == pytest.approx(highest, rel=0.01)


def test_eq_10_has_the_swing_but_inside_a_well_not_the_middle(maps):
    edges = maps[1].responses["with stoppers"]
    for response in edges.values():
        assert abs(response.worst()[0]) < 0.05
    assert abs(edges["outer"].worst()[1]) < 0.01
    assert edges["wells"].worst()[1] < -0.3


def test_stoppers_widen_the_band_of_the_outer_orbits(maps):
    reach = {d: edges["outer"].frequency.max() for d, edges in maps[1].responses.items()}
    assert reach["with stoppers"] > 1.02 * reach["without"]


def test_json_and_figures(maps, tmp_path):
    for content in maps:
        json.dumps(content.to_dict(), allow_nan=False)
        header, rows = content.table()
        assert {len(row) for row in rows} == {len(header)}
        assert content.sentences()
        figures.write(content.figure(), tmp_path / "figure.png")
        assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")
