"""Scenes of devices that differ in their parts, small enough for scipy to follow."""

import math

import numpy as np

from harvester.device import timescales
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared

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
# As of magnets: wells that differ, walls that steepen, points that stand unevenly.
MAGNETS = [
    [-1.5, -9.0], [-1.2, -2.4], [-1.0, -0.2], [-0.7, 1.0], [-0.3, 0.9], [0.0, 0.1],
    [0.4, -1.1], [0.8, -0.8], [1.0, 0.3], [1.3, 3.2], [1.5, 8.0],
]  # fmt: skip
DEVICES = {
    "table": {"oscillator": {"damping": 0.1, "force_table": MAGNETS}},
    "table, stoppers": {
        "oscillator": {"damping": 0.1, "force_table": MAGNETS},
        "stoppers": [stopper(side="right", gap=1.0), stopper(side="left", gap=1.05)],
    },
    "smoothed table": {
        "oscillator": {
            "damping": 0.1,
            "force_table": MAGNETS,
            "force_interpolation": "smooth",
        },
    },
    "softening in a range": {
        "excitation": {**SCALED["excitation"], "intensity": 0.04},
        "oscillator": {
            "damping": 0.1,
            "restoring_force": [0.02, 2.0, 0.0, -0.6],
            "restoring_force_range": [-1.0, 1.0],
        },
    },
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


# Of which `make test` follows the path; the others' are followed by `make test-all`.
FOLLOWED = ("uneven stoppers", "coil with inductance")


# Seeds whose paths keep off the tops of barriers, where any difference doubles in every period.
SEEDS = {
    "table": 7,
    "smoothed table": 18,
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
    return _of_25_periods(Scene.from_tables(tables, name=name), knots_per_period)


def random_device(seed, knots_per_period=10):
    """A device of any parts in SI, of the order of one in every unit, started anywhere."""
    generator = np.random.default_rng(seed)

    def between(low, high):
        return float(generator.uniform(low, high))

    def sometimes(key, low, high):
        return {key: between(low, high)} if generator.random() < 0.5 else {}

    degree = int(generator.choice([3, 5, 7]))
    middle = [between(-0.6, 0.6) for _ in range(2, degree)]
    tables = {
        "units": "SI",
        "length_scale": 1.0,
        "oscillator": {
            "mass": between(0.5, 2.0),
            "damping": between(0.1, 0.3),
            "restoring_force": [
                between(-0.3, 0.3),
                between(-1.5, 2.5),
                *middle,
                between(0.8, 2.0),
            ],
            **sometimes("quadratic_damping", 0.05, 0.3),
        },
        "load": {"resistance": between(0.5, 4.0)},
        "start": {"displacement": between(-0.25, 0.25), "velocity": between(-0.5, 0.5)},
        "excitation": {
            "kind": "ornstein-uhlenbeck",
            "intensity": between(0.1, 0.3),
            "correlation_time": between(0.2, 0.8),
        },
        "run": {"duration": 1.0, "seed": seed},
    }
    stoppers = [_random_stopper(generator, between) for _ in range(generator.integers(0, 4))]
    if stoppers:
        tables["stoppers"] = stoppers
    if generator.random() < 0.5:
        tables["coil"] = {
            "coupling": between(0.3, 1.0),
            "resistance": between(0.5, 2.0),
            **sometimes("inductance", 0.5, 3.0),
        }
    else:
        tables["piezo"] = {
            "coupling": between(0.3, 1.0),
            "capacitance": between(0.5, 2.0),
            **sometimes("leakage_resistance", 1.0, 5.0),
        }
        tables["start"]["voltage"] = between(-0.5, 0.5)
    return _of_25_periods(Scene.from_tables(tables, name=f"random {seed}"), knots_per_period)


def _random_stopper(generator, between):
    """Out of reach of the start."""
    return stopper(
        side=str(generator.choice(["left", "right", "both"])),
        gap=between(0.3, 0.8),
        stiffness=between(10.0, 60.0),
        restitution=between(0.3, 1.0),
        exponent=between(1.0, 3.0),
    )


def _of_25_periods(scene, knots_per_period):
    period = 2.0 * math.pi / timescales.angular_frequency(prepared(scene).system)
    apart = min(period / knots_per_period, scene.excitation.correlation_time)
    duration = math.ceil(25.0 * period / apart) * apart
    return scene.replace({"excitation.knot_spacing": apart, "run.duration": duration})
