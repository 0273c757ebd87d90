"""What both checkouts are asked, in words that either understands: short runs of everything.

Numbers of a case are computed once, by the current checkout, so that both are asked the same.
"""

from pathlib import Path
from typing import Any

import every_command
from every_command import DEVICES, EXCITATIONS, LOADS
from maintenance import identified

ENGINES = ("circuit", "monte-carlo")
OTHER_LOADS = (
    "bridge_buck",
    "bridge_ideal",
    "doubler",
    "node_boost",
    "node_buck",
    "sshi_series",
)
# Some of each are refused by a closure.
AVERAGED = {
    "paper": ("paper", "consistent", "fokker_planck"),
    "linear": ("consistent",),
    "device": ("paper", "consistent"),
    "leak and drag": ("consistent", "fokker_planck"),
    "one_sided": ("fokker_planck",),
    "electromagnetic": ("fokker_planck",),
    "tristable": ("fokker_planck",),
}
TOLERANCE = 0.3
# Options of `simulate`.
WAYS = {
    "circuit, pwl": {"method": "circuit", "source": "pwl"},
    "circuit, behavioural": {"method": "circuit", "device": "behavioural"},
    "circuit, fine": {"method": "circuit", "step": "fine"},
    "circuit, one copy": {"method": "circuit", "copies": 1},
    "monte-carlo, heun": {"method": "monte-carlo", "scheme": "heun"},
    "monte-carlo, joint density": {"method": "monte-carlo", "joint_density": True},
}
JSON, FOLDER = ("--json", "answer.json"), ("--output", "study")
PICTURE = ("--output", "schematic.svg")
OPTIMUM = ("--over", "load.decay_rate", "--maximise", "mean_power")
# What is asked by a command, and more words for it: of options given twice the last one holds.
STUDIES = {
    ("validate", "paper", "own resistor", "ornstein-uhlenbeck"): JSON,
    ("validate", "device", "bridge", "white"): JSON,
    ("frequency-response monte-carlo", "duffing", "own resistor", "sine"): JSON,
    ("frequency-response circuit", "device", "bridge", "sine"): JSON,
    ("load-study", "device", "bridge", "white"): FOLDER,
    ("optimum", "linear", "own resistor", "ornstein-uhlenbeck"): (*OPTIMUM, *JSON),
    ("sensitivity", "device", "own resistor", "white"): ("--rows", "16", *FOLDER),
    ("schematic", "device", "sece", "white"): PICTURE,
    ("schematic", "coil with inductance", "bridge", "sine"): PICTURE,
    ("schematic", "uneven stoppers", "own resistor", "sum"): PICTURE,
}
# Without a scene of `every_command`.
OTHERS = (
    ("new", "beam.toml"),
    ("engine",),
    ("simulate", "paper", "--method", "circuits"),
    ("simulate", "paper", "--set", "oscillator.mass=-1"),
    ("netlist", "device", "--set", "load.netlist=bridges", "--output", "-"),
)


def all_cases(folder: Path) -> dict[str, dict[str, Any]]:
    """Name of each case → a function with scene and options, or a command; files go to `folder`."""
    every_command.write_files(folder)
    return {
        **_grid(folder),
        **_ways(folder),
        **_closures(folder),
        **_studies(folder),
        **identified.cases(folder),
    }


def _grid(folder):
    """Every two of device, load and excitation, as netlists and by each engine."""
    cases = {}
    for i, device in enumerate(DEVICES):
        for j, load in enumerate(LOADS):
            excitation = list(EXCITATIONS)[(i + j) % len(EXCITATIONS)]
            scene = every_command.changed(device, load, excitation, folder)
            cases |= _everywhere(f"{device}, {load}, {excitation}", *scene)
    for load in OTHER_LOADS:
        name, overrides = every_command.changed("device", "own resistor", "white", folder)
        cases |= _everywhere(f"device, {load}, white", name, [*overrides, f"load.netlist={load}"])
    return cases


def _everywhere(title, scene, overrides):
    sets = [word for text in overrides for word in ("--set", text)]
    netlists = {
        f"netlist {dialect}: {title}": {
            "arguments": ["netlist", scene, *sets, "--dialect", dialect, "--output", "scene.cir"]
        }
        for dialect in ("ngspice", "ltspice")
    }
    return netlists | {
        f"simulate {engine}: {title}": _function("simulate", scene, overrides, method=engine)
        for engine in ENGINES
    }


def _function(function, scene, overrides, **options):
    return {"function": function, "scene": scene, "overrides": overrides, "options": options}


def _ways(folder):
    name, overrides = every_command.changed("paper", "own resistor", "ornstein-uhlenbeck", folder)
    return {
        f"simulate {way}: paper": _function("simulate", name, overrides, **options)
        for way, options in WAYS.items()
    }


def _closures(folder):
    cases = {}
    for device, closures in AVERAGED.items():
        scene = every_command.changed(device, "own resistor", "ornstein-uhlenbeck", folder)
        for closure in closures:
            cases[f"average {closure}: {device}"] = _function(
                "average", *scene, method=closure, tolerance=TOLERANCE
            )
    return cases


def _studies(folder):
    cases = {
        f"{case[0]}: {', '.join(case[1:])}": {
            "arguments": [*every_command.call(case, folder), *more]
        }
        for case, more in STUDIES.items()
    }
    return cases | {" ".join(words): {"arguments": list(words)} for words in OTHERS}
