"""Paths of devices put together from parts, against scipy with the equations written out."""

import numpy as np
import pytest
from device_scenes import DEVICES, FOLLOWED, device
from device_truths import written_path
from truths import Keep

from harvester.engines.methods import MonteCarlo
from harvester.scene.paths import noise_path, start_state
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing, stop_time


def deviation(scene, states, reference):
    """Greatest distance of the displacement from scipy's, in length units of the scene."""
    scales = prepared(scene).scales
    return float(np.abs(states[:, 0] - reference[1:, 0] / scales.displacement).max())


def states_of(scene, step):
    """States of Monte Carlo at the knots."""
    keep = Keep()
    ready = prepared(scene)
    paths, starts = [noise_path(ready, 0)], [start_state(ready, 0)]
    MonteCarlo(step).run_realizations(prepared(scene), paths, starts, [[keep]])
    return keep.at_knots(knot_spacing(ready))


EACH = [
    pytest.param(name, marks=() if name in FOLLOWED else pytest.mark.exhaustive, id=name)
    for name in DEVICES
]


@pytest.mark.parametrize("name", EACH)
def test_monte_carlo_follows_scipys_path(name):
    scene = device(name)
    ready = prepared(scene)
    knots = round(stop_time(ready) / knot_spacing(ready))
    reference = written_path(scene, knots)
    assert deviation(scene, states_of(scene, "finest"), reference) < 2e-6
    assert deviation(scene, states_of(scene, "default"), reference) < 6e-3


def test_the_order_of_convergence_is_runge_kuttas():
    scene = device("coil with inductance")
    ready = prepared(scene)
    reference = written_path(scene, round(stop_time(ready) / knot_spacing(ready)))
    steps = knot_spacing(ready) / np.array([16.0, 32.0, 64.0])
    errors = [deviation(scene, states_of(scene, float(step)), reference) for step in steps]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(4.0, abs=0.3)
