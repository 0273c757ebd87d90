"""Windows of multiple shooting: what may be joined, and windows that are left out."""

import numpy as np
import pytest
from measured_records import scene_of

from harvester.engines.monte_carlo.sampled import states_at_samples
from harvester.identification.measurement import Measurement
from harvester.identification.response import experiment
from harvester.identification.search import lengthened
from harvester.identification.shooting import Shooting, ShootingFit
from harvester.scene.prepared import prepared

WINDOWS, SAMPLES = 9, 20


def in_windows(factors):
    """Equal windows in which errors grow by these factors."""
    edges = SAMPLES * np.arange(WINDOWS + 1)
    return ShootingFit(
        np.zeros(0),
        [edges],
        [np.zeros((WINDOWS, 3))],
        [np.ones(1)],
        grams=[np.zeros((WINDOWS, 4, 4))],
        transitions=[np.array([factor * np.eye(3) for factor in factors])],
        growth=[np.maximum(factors, 1.0)],
    )


def joined_at(factors, most=WINDOWS * SAMPLES):
    short = in_windows(factors)
    found = lengthened(short, short, [most])
    return None if found is None else list(found.edges[0] // SAMPLES)


def test_windows_are_joined_where_errors_shrink():
    assert joined_at([0.5] * WINDOWS) == [0, WINDOWS]
    assert joined_at([0.5] * WINDOWS, 3 * SAMPLES) == [0, 3, 6, 9]


def test_a_window_ends_where_an_error_of_its_start_has_grown():
    # 2 and 4 are allowed, 8 is not.
    assert joined_at([2.0] * WINDOWS) == [0, 2, 4, 6, 8, 9]
    assert joined_at([8.0] * WINDOWS) is None


def test_a_window_whose_motion_diverges_is_joined_to_none():
    assert joined_at([1.0] * 4 + [np.nan] + [1.0] * 4) == [0, 4, 5, 9]


def test_an_error_that_arises_within_a_window_limits_it_as_well():
    # The start is forgotten by 1e-4; an error from between grows by 9⁴, or by 5⁴.
    assert joined_at([0.1] * 4 + [9.0] * 4 + [0.1]) == [0, 7, 8, 9]
    assert joined_at([0.1] * 4 + [5.0] * 4 + [0.1]) == [0, 9]


@pytest.mark.slow
def test_a_window_without_a_start_is_left_out():
    piezo = {"piezo": {"coupling": 1e-3, "capacitance": 5e-8}}
    device = scene_of(0.01, 0.03, [0.0, 150.0], piezo, 2e5)
    system = prepared(device).system
    rng = np.random.default_rng(1)
    eta, edges = rng.standard_normal(121), np.array([0, 20, 40, 60])
    starts = rng.standard_normal((3, 3))
    states, ends = states_at_samples(system, eta, 0.01, 2, edges, starts)
    starts[1, 0] = np.nan
    some, some_ends = states_at_samples(system, eta, 0.01, 2, edges, starts)
    assert np.isnan(some[20:40]).all()
    assert np.isnan(some_ends[1]).all()
    kept = np.r_[0:20, 40:60]
    assert np.array_equal(some[kept], states[kept])
    assert np.array_equal(some_ends[[0, 2]], ends[[0, 2]])


@pytest.mark.slow
def test_a_linear_device_follows_a_sine_as_its_closed_form_says():
    """Of twelve samples a period, with errors of steps and path far below any interval."""
    mass, damping, stiffness, coupling, capacitance, load = 0.01, 0.06, 57.0, 1e-3, 5e-8, 2e5
    piezo = {"piezo": {"coupling": coupling, "capacitance": capacitance}}
    scene = scene_of(mass, damping, [0.0, stiffness], piezo, load)
    frequency, rate = 11.0, 132.0
    turn = 2.0j * np.pi * frequency
    electrical = turn * coupling / (turn * capacitance + 1.0 / load)
    mechanical = stiffness + mass * turn**2 + turn * damping + coupling * electrical
    response = -mass / mechanical * electrical
    wave = np.exp(turn * np.arange(1200) / rate)
    record = Measurement(wave.imag, rate, voltage=(response * wave).imag)
    problem = Shooting([experiment(scene, record)], [], 1e-3, "smooth")
    # From rest: what the start leaves dies within the first half.
    _, _, shown = problem.at(0, []).states(np.array([0, 1200]), np.zeros((1, 3)))
    late = slice(600, 1190)
    assert shown[late, 0] == pytest.approx(record.voltage[late], abs=1e-5 * abs(response))
