"""Devices of any parts by both engines, against scipy with the equations written out."""

import numpy as np
import pytest
from device_scenes import random_device
from device_truths import written_path
from truths import Keep

from harvester.engines.methods import MonteCarlo
from harvester.engines.simulate import simulate
from harvester.scene.paths import noise_path, start_state
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing, stop_time

SEEDS = (1, 8, 9, 11, 12)
SMALL = 1e-6


def by_monte_carlo(scene, displaced=0.0):
    """Displacements at the knots, its start displaced by so much."""
    keep = Keep()
    ready = prepared(scene)
    x, v, state = start_state(ready, 0)
    starts = [(x + displaced, v, state)]
    MonteCarlo("finest").run_realizations(ready, [noise_path(ready, 0)], starts, [[keep]])
    return keep.at_knots(knot_spacing(ready))[:, 0]


def by_circuit(pool, scene):
    """Displacements at the knots."""
    result = simulate(
        scene, step="finest", device="behavioural", window=(0.0, 1e9), workers=1, runner=pool
    )
    waveform, spacing = np.array(result.waveform.record), knot_spacing(prepared(scene))
    knots = np.round(waveform[0] / spacing)
    return waveform[1, np.abs(waveform[0] - knots * spacing) < 1e-6 * spacing]


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", SEEDS)
def test_both_engines_follow_scipys_path(pool, seed):
    scene = random_device(seed)
    ready = prepared(scene)
    truth = written_path(scene, round(stop_time(ready) / knot_spacing(ready)))[1:, 0]
    found = by_monte_carlo(scene)
    # Where paths part, nothing follows any path.
    assert np.abs(by_monte_carlo(scene, SMALL) - found).max() < 10.0 * SMALL
    assert np.abs(found - truth).max() < 2e-6
    assert np.abs(by_circuit(pool, scene) - truth).max() < 2e-4


def test_the_random_devices_have_all_parts():
    tables = [random_device(seed).to_tables() for seed in SEEDS]
    oscillators = [each["oscillator"] for each in tables]
    assert {len(each["restoring_force"]) for each in oscillators} == {4, 6, 8}
    assert any("quadratic_damping" in each for each in oscillators)
    assert any("leakage_resistance" in each.get("piezo", {}) for each in tables)
    assert {each["coil"]["inductance"] > 0.0 for each in tables if "coil" in each} == {True, False}
    sides = [[s.get("side", "both") for s in each.get("stoppers", [])] for each in tables]
    assert {side for each in sides for side in each} == {"left", "right", "both"}
    assert max(map(len, sides)) >= 2
    assert all({"displacement", "velocity"} <= set(each["start"]) for each in tables)
