"""Scenes of devices that differ in their parts, small enough for scipy to follow."""

import math

from harvester.device import timescales
from harvester.scene.model import Scene
from harvester.scene.units import scale

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
    "run": {"duration": 2.5, "seed": 6},
}
DEVICES = {
    "bias and quadratic term": {"oscillator": SKEW},
    "tristable, degree 5": {
        "oscillator": {"damping": 0.1, "restoring_force": [0.05, 2.0, 0.0, -4.9, 0.1, 2.2]}
    },
    "degree 7": {
        "excitation": {**SCALED["excitation"], "intensity": 0.08},
        "oscillator": {
            "damping": 0.1,
            "restoring_force": [0.0, 1.5, 0.0, -5.0, 0.0, 2.5, 0.0, 0.3],
        },
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
        "excitation": {**SCALED["excitation"], "intensity": 0.05},
    },
    "coil without inductance": {**COIL, "coil": {"coupling": 3.0, "resistance": 200.0}},
    "coil with inductance": {
        **COIL,
        "coil": {"coupling": 3.0, "resistance": 200.0, "inductance": 4.0},
    },
}


# Seeds whose paths keep off the tops of barriers, where any difference doubles in every period.
SEEDS = {
    "degree 7": 6,
    "leak, scaled": 2,
    "bias and quadratic term": 1,
    "tristable, degree 5": 10,
    "a pair on an asymmetric spring": 16,
    "quadratic damping": 1,
    "held speed": 19,
}


def device(name, knots_per_period=10):
    """A scene with knots that far apart; its steps stay those of the device."""
    tables = {**SCALED, **DEVICES[name]}
    tables = {key: table for key, table in tables.items() if table is not None}
    tables["run"] = {**tables["run"], "seed": SEEDS.get(name, tables["run"]["seed"])}
    scene = Scene.from_tables(tables, name=name)
    period = 2.0 * math.pi / timescales.angular_frequency(scale(scene)[0])
    apart = min(period / knots_per_period, scene.excitation.correlation_time)
    duration = math.ceil(25.0 * period / apart) * apart
    return scene.replace({"excitation.knot_spacing": apart, "run.duration": duration})
