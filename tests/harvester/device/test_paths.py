"""Paths of devices put together from parts, against scipy with the equations written out."""

import numpy as np
import pytest
from device_truths import written_path
from truths import Keep

from harvester.monte_carlo import run_realizations
from harvester.parameters import knot_spacing, scale, stop_time
from harvester.realization import noise_path, start_state
from harvester.scene import Scene

SCALED = {
    "units": "scaled",
    "piezo": {"coupling": 0.4},
    "load": {"decay_rate": 0.3},
    "excitation": {"kind": "ornstein-uhlenbeck", "intensity": 0.15, "correlation_time": 0.4},
    "run": {"duration": 60.0, "seed": 3},
}
SKEW = {"damping": 0.1, "restoring_force": [-0.15, -2.0, 0.5, 2.2]}
STIFF = {"gap": 0.7, "stiffness": 40.0, "restitution": 0.6}


def stopper(**changes):
    return {**STIFF, **changes}


MONOSTABLE = {"damping": 0.1, "restoring_force": [0.0, 2.0]}
COIL = {
    "units": "SI",
    "length_scale": 1e-3,
    "oscillator": {"mass": 0.01, "damping": 0.02, "restoring_force": [0.05, 16.0, 900.0, 4e6]},
    "piezo": None,
    "load": {"resistance": 300.0},
    "excitation": {"kind": "ornstein-uhlenbeck", "intensity": 0.3, "correlation_time": 0.01},
    "run": {"duration": 3.9, "seed": 3},
}
LEAKY = {
    "units": "SI",
    "oscillator": {"mass": 0.02, "damping": 0.03, "restoring_force": [-0.13, -63.0, 1900.0, 6e5]},
    "piezo": {"coupling": 4e-4, "capacitance": 4e-8, "leakage_resistance": 5e5},
    "load": {"resistance": 3e5},
    "excitation": {"kind": "ornstein-uhlenbeck", "intensity": 0.4, "correlation_time": 0.01},
    "run": {"duration": 2.5, "seed": 3},
}
DEVICES = {
    "bias and quadratic term": {"oscillator": SKEW},
    "tristable, degree 5": {
        "oscillator": {"damping": 0.1, "restoring_force": [0.05, 2.0, 0.0, -4.9, 0.1, 2.2]}
    },
    "degree 7": {
        "oscillator": {
            "damping": 0.1,
            "restoring_force": [0.0, 1.5, 0.0, -5.0, 0.0, 2.5, 0.0, 0.3],
        }
    },
    "one-sided stopper": {"oscillator": MONOSTABLE, "stoppers": [stopper(side="right", gap=0.3)]},
    "uneven stoppers": {
        "oscillator": MONOSTABLE,
        "stoppers": [
            stopper(side="right", gap=0.4),
            stopper(side="left", gap=0.6, stiffness=90.0, restitution=0.3),
        ],
    },
    "two on one side": {
        "oscillator": SKEW,
        "stoppers": [
            stopper(side="right", gap=0.8),
            stopper(side="right", gap=1.05, stiffness=300.0),
        ],
    },
    "a pair on an asymmetric spring": {"oscillator": SKEW, "stoppers": stopper(gap=1.0)},
    "a gap inside the well": {"oscillator": SKEW, "stoppers": [stopper(side="left", gap=0.5)]},
    "other exponents": {
        "oscillator": MONOSTABLE,
        "stoppers": [
            stopper(side="right", gap=0.3, exponent=1.0),
            stopper(side="left", gap=0.5, exponent=2.2),
        ],
    },
    "quadratic damping": {"oscillator": {**SKEW, "quadratic_damping": 0.3}},
    "held speed": {
        "oscillator": SKEW,
        "stoppers": [
            stopper(side="right", gap=1.0, impact_velocity="event"),
            stopper(side="left", gap=0.6, impact_velocity="event"),
        ],
    },
    "leak": LEAKY,
    "leak, scaled": {
        "oscillator": SKEW,
        "piezo": {"coupling": 0.4, "leakage_rate": 0.5},
    },
    "coil without inductance": {**COIL, "coil": {"coupling": 3.0, "resistance": 200.0}},
    "coil with inductance": {
        **COIL,
        "coil": {"coupling": 3.0, "resistance": 200.0, "inductance": 4.0},
    },
}


def device(name, knots_per_period=10, **run):
    """A scene with knots that far apart; its steps stay those of the device."""
    tables = {**SCALED, **DEVICES[name]}
    tables = {key: table for key, table in tables.items() if table is not None}
    scene = Scene.from_tables({**tables, "run": {**tables["run"], **run}}, name=name)
    apart = 40.0 / knots_per_period * knot_spacing(scene)
    apart = min(apart, scene.excitation.correlation_time)
    return scene.replace({"excitation.knot_spacing": apart})


def deviation(scene, states, reference):
    """Greatest distance of the displacement from scipy's, in length units of the scene."""
    _, scales = scale(scene)
    return float(np.abs(states[:, 0] - reference[1:, 0] / scales.displacement).max())


def states_of(scene, step):
    """States of Monte Carlo at the knots."""
    keep = Keep()
    paths, starts = [noise_path(scene, 0)], [start_state(scene, 0)]
    run_realizations(scene, paths, starts, [[keep]], step, "external")
    return keep.at_knots(knot_spacing(scene))


@pytest.mark.parametrize("name", DEVICES)
def test_monte_carlo_follows_scipys_path(name):
    scene = device(name)
    knots = round(stop_time(scene) / knot_spacing(scene))
    reference = written_path(scene, knots)
    assert deviation(scene, states_of(scene, "finest"), reference) < 2e-6
    assert deviation(scene, states_of(scene, "default"), reference) < 5e-3
