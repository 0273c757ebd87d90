"""Measured sets that are not ours to ship: a variable of the environment names each one's place."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from harvester.base.errors import ProgramNotFound
from harvester.engines.task import Task
from harvester.scene.model import Scene
from harvester.validation.truth import Truth

SILVERBOX = "Silverbox, a Duffing oscillator of electronics"
SILVERBOX_SOURCE = "nonlinearbenchmark.org; figures of identified models in freq-statespace"
# Published relative rms errors of cubic models on the multisine's test part are 1.1 % and below.
PUBLISHED_CUBIC = 0.011
# Sampling rate (Hz) and the published split (nonlinear_benchmarks), which leaves out the first
# samples of the test.
RATE = 1e7 / 2**14
TRAINED, TESTED, LEFT_OUT = (40_650, 105_712), (105_712, 127_400), 50
GET_SILVERBOX = (
    "SILVERBOX names no file: take data/Silverbox/SNLS80mV.csv from biaslab/nsi-silverbox on "
    "GitHub, and set SILVERBOX=SNLS80mV.csv"
)

BISTABLEX = "BistableX, a bistable piezoelectric beam"
BISTABLEX_SOURCE = (
    "Norenberg, Varoto, da Silva and Cunha 2025, Asymmetry-enhanced performance in bistable energy "
    "harvesters: an experimental study; records of the repository BistableX"
)
GET_BISTABLEX = (
    "BISTABLEX names no folder: clone americocunhajr/BistableX from GitHub, and set "
    "BISTABLEX=BistableX/DataExperimental"
)
# By the set's name, what to do.
HOW_TO_GET = {
    SILVERBOX: GET_SILVERBOX.partition(": ")[2],
    BISTABLEX: GET_BISTABLEX.partition(": ")[2],
}
# Tilts of the base (degrees) and, by frequency (Hz), the levels of the shaker (mV) with turned
# magnets left out. At 9.1 Hz and 200 mV there is one record, of another frequency than its name's.
TILTS, LEVELS = (0, 10, 25, 45), {6.3: (25, 50, 100, 150, 200), 9.1: (25, 50, 100, 150)}
# Records of the upright base that are fitted; all others are kept aside.
FITTED = ((6.3, 100), (6.3, 150), (9.1, 25), (9.1, 50))
CONSTANT_FORCE = "oscillator.restoring_force[0]"


def downloaded() -> list[Truth]:
    """A row of each set, which says how to get it where it is not there."""
    return [_silverbox(), _bistable_beam()]


def _call(name, place, files):
    """Arguments of a set's task: its place, empty if a file is missing, and the files' digest."""
    exists = bool(place) and all(file.is_file() for file in files)
    content = b"".join(file.read_bytes() for file in files) if exists else b""
    digest = hashlib.sha256(content).hexdigest()
    return {name: os.path.abspath(place) if exists else "", "digest": digest}


def _silverbox():
    file = os.environ.get("SILVERBOX", "")
    return Truth(
        "error of the multisine's test part by a cubic spring, identified from its training part",
        SILVERBOX_SOURCE,
        0.0,
        PUBLISHED_CUBIC,
        {
            "identify": Task(
                silverbox_error, _call("file", file, [Path(file)]), label="silverbox", time_limits=4
            )
        },
        unit="NRMSE",
        device=SILVERBOX,
    )


def silverbox_error(file: str, digest: str, report: Callable) -> tuple[float, float]:
    """NRMSE of a run from rest through the test part.

    Raises
    ------
    ProgramNotFound
        The set was not downloaded.
    """
    from harvester.identification.identify import identify
    from harvester.identification.measurement import Measurement

    if not file:
        raise ProgramNotFound(GET_SILVERBOX)
    values = np.genfromtxt(file, delimiter=",", skip_header=1)[:, :2]
    values = values - values[slice(*TRAINED)].mean(axis=0)
    tables = {
        "units": "scaled",
        "oscillator": {"damping": 20.0, "restoring_force": [0.0, 1e5, 0.0, 1e5]},
        "piezo": {"coupling": 0.0},
        "load": {"decay_rate": 1.0},
        "excitation": {"kind": "white", "intensity": 1.0},
        "run": {"duration": 10.0},
    }
    scene = Scene.from_tables(tables, name="silverbox")
    (u, y), (tried, response) = (values[slice(*part)].T for part in (TRAINED, TESTED))
    free = [f"oscillator.{key}" for key in ("damping", "restoring_force[1]", "restoring_force[3]")]
    identification = identify(
        scene,
        Measurement(u, RATE, displacement=y),
        free=[*free, "sensor.acceleration_scale"],
        compare=False,
    )
    seen = identification.simulated(Measurement(tried, RATE, displacement=response))["displacement"]
    error = (seen - response)[LEFT_OUT:]
    return float(np.sqrt(np.mean(error**2)) / np.std(response[LEFT_OUT:])), 0.0


def _bistable_beam():
    folder = os.environ.get("BISTABLEX", "")
    files = [_beam_file(folder, *settings) for settings in _beam_records()]
    call = _call("folder", folder, files)
    return Truth(
        "share of the claimed records, of 32 kept aside at four tilts, that lie within their "
        "intervals: fitted to four of the upright base",
        BISTABLEX_SOURCE,
        1.0,
        0.0,
        {"identify": Task(beam_claims, call, label="bistablex", time_limits=8)},
        unit="of the claimed",
        device=BISTABLEX,
    )


def _beam_records():
    """Tilt, frequency and level of each record."""
    return [(t, f, level) for t in TILTS for f, levels in LEVELS.items() for level in levels]


def _beam_file(folder, tilt, frequency, level):
    subfolder = f"base_rotation_phi={tilt}/single_freq/freq_{frequency:g}Hz/mag_vr=0_vl=0"
    return Path(folder) / subfolder / f"amplitude_{level}mV.csv"


def beam_claims(folder: str, digest: str, report: Callable) -> tuple[float, float]:
    """Share of the claimed records kept aside that lie within their intervals.

    Of the beam the mass, 20 g, is a guess: voltages tell only ratios to it. The tilt of the base is
    a constant force, found in each record of another tilt.

    Raises
    ------
    ProgramNotFound
        The set was not downloaded.
    """
    from harvester.identification.identify import identify
    from harvester.identification.measurement import read_measurement

    if not folder:
        raise ProgramNotFound(GET_BISTABLEX)

    def record(tilt, frequency, level):
        file = _beam_file(folder, tilt, frequency, level)
        # A resistor's voltage has no mean: what is there is the channel's offset.
        offset = float(np.loadtxt(file, delimiter=",", usecols=3).mean())
        settings = {"time": "0:s", "acceleration": "1:g", "voltage": "3:V"}
        tilt_force = {CONSTANT_FORCE: "free"} if tilt else {}
        return read_measurement(file, {**settings, "sensor.voltage_offset": offset, **tilt_force})

    tables = {
        "units": "SI",
        "length_scale": 0.011,
        "oscillator": {
            "mass": 0.02,
            "damping": 0.025,
            "restoring_force": [0.0, -33.9, -80.0, 1.25e5],
        },
        "piezo": {"coupling": 2.6e-6, "capacitance": 1.4e-7},
        "load": {"kind": "resistor", "resistance": 1e6},
        "excitation": {"kind": "sine", "amplitude": 3.0, "frequency": 9.1},
        "run": {"duration": 30.0, "seed": 1},
    }
    scene = Scene.from_tables(tables, name="bistable beam")
    fitted = [(TILTS[0], *keys) for keys in FITTED]
    aside = [keys for keys in _beam_records() if keys not in fitted]
    identification = identify(
        scene,
        [record(*keys) for keys in fitted],
        keep_aside=[record(*keys) for keys in aside],
        compare=False,
    )
    claimed = [prediction for prediction in identification.kept_aside if prediction.claimed]
    held = sum(prediction.holds for prediction in claimed)
    return held / len(claimed) if claimed else 0.0, 0.0
