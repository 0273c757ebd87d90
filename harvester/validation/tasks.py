"""Tasks of `verify` that return (value, error) of quantities other than a scene's mean."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from harvester.engines.methods import engine_of
from harvester.engines.realization import run
from harvester.identification.identify import identify
from harvester.identification.measurement import Measurement, read_measurement
from harvester.scene.model import Scene
from harvester.scene.prepared import Prepared, prepared
from harvester.statistics.run_estimates import run_estimates
from harvester.validation import STATES, exact_paths, other_programs
from harvester.validation.paths import recorded, states_at_knots

# Other programs for a scene's first path. Each returns X and the terminal voltage, scaled, at the
# knots 1, 2, …
OTHERS: dict[str, Callable[[Prepared], np.ndarray]] = {
    "DOP853": lambda model: exact_paths.run(model, 0)[:, [0, 2]],
    "Radau": other_programs.bridge_path,
    "ngspice -b": other_programs.plain_ngspice,
    "VACASK": other_programs.vacask,
}
COLUMNS = ("displacement", "voltage")
# Silverbox: sampling rate (Hz) and published split (nonlinear_benchmarks), without the first
# samples of the test.
RATE = 1e7 / 2**14
TRAINED, TESTED, SKIPPED_SAMPLES = (40_650, 105_712), (105_712, 127_400), 50
# Tilts of the beam's base (degrees) and, by frequency (Hz), shaker levels (mV), without records
# with rotated magnets. The record at 9.1 Hz and 200 mV has another frequency than its name says.
TILTS, LEVELS = (0, 10, 25, 45), {6.3: (25, 50, 100, 150, 200), 9.1: (25, 50, 100, 150)}
BEAM_FILES = {
    (tilt, frequency, level): f"base_rotation_phi={tilt}/single_freq/freq_{frequency:g}Hz/"
    f"mag_vr=0_vl=0/amplitude_{level}mV.csv"
    for tilt in TILTS
    for frequency, levels in LEVELS.items()
    for level in levels
}
# Records of the upright base that are fitted; all others are validation records.
FITTED = ((0, 6.3, 100), (0, 6.3, 150), (0, 9.1, 25), (0, 9.1, 50))


def rebound(prepared_scene: Prepared, engine: str, report: Callable) -> tuple[float, float]:
    """Rebound speed from a stopper, at the end of a run whose mass hits it with speed 1."""
    [path] = recorded(prepared_scene, engine, [0], "default")
    return -float(path.waveform.velocity[-1]), 0.0  # type: ignore[union-attr]


def deviation_from_other_program(
    prepared_scene: Prepared, engine: str, step: str, other: str, column: str, report: Callable
) -> tuple[float, float]:
    """RMS difference from another program's path at the knots, relative to that path's rms.

    `other` is one of `OTHERS`, `column` of `COLUMNS`.
    """
    theirs = OTHERS[other](prepared_scene)[:, COLUMNS.index(column)]
    realizations = recorded(prepared_scene, engine, [0], step)
    states = states_at_knots(prepared_scene, realizations)
    ours = states[0, :, STATES.index(column)]
    return float(np.sqrt(np.mean((ours - theirs) ** 2) / np.mean(theirs**2))), 0.0


def highest(
    scenes: Sequence[Scene], engine: str, quantity: str, report: Callable
) -> tuple[float, float]:
    """The largest value of a quantity (scaled) among several scenes without noise."""
    values = []
    for scene in scenes:
        model = prepared(scene)
        [realization] = run(model, engine_of(engine), [0], None, report)
        estimates = run_estimates(model, [realization.moments]).whole
        values.append(estimates[quantity].estimate)
    return float(max(values)), 0.0


def silverbox_error(
    place: str, digest: str, prepared_scene: Prepared, report: Callable
) -> tuple[float, float]:
    """Normalised RMS error of a run from rest over the test data."""
    values = np.genfromtxt(place, delimiter=",", skip_header=1)[:, :2]
    values = values - values[slice(*TRAINED)].mean(axis=0)
    (u, y), (tried, response) = (values[slice(*part)].T for part in (TRAINED, TESTED))
    free = [f"oscillator.{key}" for key in ("damping", "restoring_force[1]", "restoring_force[3]")]
    free.append("sensor.acceleration_scale")
    fit = identify(
        prepared_scene.scene, Measurement(u, RATE, displacement=y), free=free, compare=False
    )
    seen = fit.simulated(Measurement(tried, RATE, displacement=response))["displacement"]
    error = (seen - response)[SKIPPED_SAMPLES:]
    return float(np.sqrt(np.mean(error**2)) / np.std(response[SKIPPED_SAMPLES:])), 0.0


def beam_claims(
    place: str, digest: str, prepared_scene: Prepared, report: Callable
) -> tuple[float, float]:
    """Share of the claimed predictions of validation records that lie within their intervals.

    The tilt of the base is a constant force, fitted in each record of another tilt.
    """

    def record(tilt, frequency, level):
        file = Path(place) / BEAM_FILES[tilt, frequency, level]
        # A resistor's voltage has zero mean: the mean is the channel's offset.
        offset = float(np.loadtxt(file, delimiter=",", usecols=3).mean())
        settings = {"time": "0:s", "acceleration": "1:g", "voltage": "3:V"}
        tilt_force = {"oscillator.restoring_force[0]": "free"} if tilt else {}
        return read_measurement(file, {**settings, "sensor.voltage_offset": offset, **tilt_force})

    aside = [record(*keys) for keys in BEAM_FILES if keys not in FITTED]
    fitted = [record(*keys) for keys in FITTED]
    fit = identify(prepared_scene.scene, fitted, keep_aside=aside, compare=False)
    claimed = [prediction for prediction in fit.kept_aside if prediction.claimed]
    held = sum(prediction.holds for prediction in claimed)
    return held / len(claimed) if claimed else 0.0, 0.0
