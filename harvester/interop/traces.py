"""Voltage and current over time for firmware tests: CSV, and HDF5 of the Shepherd testbed.

A replay does not depend on its load, whereas a real harvester is damped by the drawn power. The
effect is computed for every trace.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harvester.base.errors import ExportError
from harvester.base.libraries import optional_library
from harvester.base.writing import in_folder, whole_file
from harvester.device import timescales
from harvester.engines.methods import MonteCarlo
from harvester.interop.block import folder_of
from harvester.interop.deck import check_realization
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path, start_state
from harvester.scene.prepared import Prepared, prepared
from harvester.statistics.range_watch import with_range_watch

# Sampling rates (Hz): Shepherd's, and for CSV 200 samples per period at 50 Hz.
SHEPHERD_RATE, CSV_RATE = 100_000.0, 10_000.0
# Samples per block of Shepherd's files, which contain only whole blocks.
BLOCK = 10_000
# Most samples: 0.6 GB of memory at 32 bytes each.
MOST_SAMPLES = 20_000_000
# Most bytes per sample on disk: time and two values in Shepherd's file; a line of text.
BYTES = {"shepherd": 16, "csv": 36}
# Load resistances that represent open and shorted terminals, in matched resistances.
OPEN, SHORTED = 1e6, 1e-4
# Loads, in multiples of the trace's load, at which device and replay are compared.
OTHER_LOADS = (1.0 / 3.0, 3.0)
# Smallest voltage, as a share of the peak, for computing the current from power/voltage.
LEAST_VOLTAGE = 1e-6
# Fewest quantization steps up to the peak of a recorded value; with fewer the scale is refined.
FEWEST_STEPS = 1e5
HIGHEST_RAW = 2**32 - 1
DATA_TYPES = ("ivsample", "isc_voc")


@dataclass(frozen=True)
class Trace:
    """Rectified voltage and current of a load, equally spaced in time from 0.

    Attributes
    ----------
    rate : float
        Samples a second.
    voltage, current : ndarray, shape (samples,)
        V and A, not negative.
    energy : float
        Energy from the engine's points over the same time (J).
    returned : float
        Share of the energy that the load returns, which is not in the trace.
    """

    rate: float
    voltage: np.ndarray
    current: np.ndarray
    energy: float
    returned: float


class _Points:
    """Records all points of a realization's terminals, or of its load's output."""

    def __init__(self) -> None:
        self._parts: list[np.ndarray] = []
        self.conductance = math.nan

    def add(self, record: Any, voltage: np.ndarray | None = None, *_: Any) -> None:
        """Add a chunk: a record, or times and voltages of an output."""
        if voltage is None:
            self._parts.append(np.array([record.time, record.voltage, record.load_power]))
        else:
            self._parts.append(np.array([record, voltage, voltage**2]))

    def points(self) -> np.ndarray:
        """Times (s), voltages and powers, scaled: shape (3, n), without duplicate times."""
        points = np.concatenate(self._parts, axis=1)
        return points[:, np.diff(points[0], prepend=-math.inf) > 0.0]


def record_trace(scene: Scene, rate: float, duration: float, realization: int) -> Trace:
    """Simulate one realization and sample its load's voltage and current, after settling.

    Parameters
    ----------
    rate : float
        Samples a second.
    duration : float
        s.
    realization : int
        Number of the realization with the excitation.
    """
    scene = scene.replace({"run.duration": duration})
    setup, engine, load = prepared(scene), MonteCarlo(), scene.load.circuit
    engine.check(scene)
    start = scene.run.settle
    terminals = _Points()
    output = _Points() if load and load.has_output else None
    engine.prepare(setup)
    engine.run_realizations(
        setup,
        [noise_path(setup, realization)],
        [start_state(setup, realization)],
        with_range_watch(setup, [[terminals]]),
        [output] if output else None,
    )
    # Without a resistor across the output, the trace is recorded at the terminals.
    time, voltage, power = terminals.points()
    if output and output.conductance > 0.0:
        time, voltage, power = output.points()
        power = output.conductance * power
    voltage, power = voltage * setup.scales.voltage, power * setup.scales.power
    size = np.abs(voltage)
    nonzero = size > LEAST_VOLTAGE * size.max(initial=0.0)
    if not nonzero.any():
        raise ExportError(f"{scene.name}: the load's voltage is always zero: nothing to record")
    current = np.interp(time, time[nonzero], power[nonzero] / voltage[nonzero])
    return _sampled(time, voltage, current, power, rate, start, duration)


def _sampled(time, voltage, current, power, rate, start, duration):
    """The trace between two times, by monotone cubic interpolation."""
    from scipy.interpolate import PchipInterpolator

    at = start + np.arange(round(duration * rate)) / rate
    sampled = PchipInterpolator(time, np.array([voltage, current]), axis=1)(at)
    flow = PchipInterpolator(time, power).antiderivative()
    # The sum of samples covers the time from half a sample before the first to half a sample after
    # the last.
    ends = np.clip(at[[0, -1]] + np.array([-0.5, 0.5]) / rate, time[0], time[-1])
    product = sampled[0] * sampled[1]
    delivered = product[product > 0.0].sum()
    returned = 1.0 - product.sum() / delivered if delivered > 0.0 else 0.0
    return Trace(
        rate=rate,
        voltage=np.abs(sampled[0]),
        current=np.maximum(np.sign(sampled[0]) * sampled[1], 0.0),
        energy=float(flow(ends[1]) - flow(ends[0])),
        returned=float(returned),
    )


def with_resistor(scene: Scene, resistance: float) -> Scene:
    """The scene with a resistor (Ω) as its load."""
    tables = scene.to_tables() | {"load": {"kind": "resistor", "resistance": resistance}}
    return Scene.from_tables(tables, scene.name, scene.name, scene.folder)


def replay_loss(scene: Scene, trace: Trace, realization: int) -> str:
    """A sentence that compares the device at other loads with the replay of its trace."""
    power = trace.voltage * trace.current
    reference = float(np.mean(trace.voltage**2) / np.mean(power))
    duration, recorded = trace.voltage.size / trace.rate, float(np.mean(power))
    live = []
    for factor in OTHER_LOADS:
        other = with_resistor(scene, factor * reference)
        live_trace = record_trace(other, trace.rate, duration, realization)
        live.append((factor * reference, float(np.mean(live_trace.voltage * live_trace.current))))
    comparisons = "; ".join(
        f"{watts:.3g} W at {resistance:.3g} Ω, {watts / recorded - 1.0:+.0%}"
        for resistance, watts in live
    )
    return (
        f"recorded at {reference:.3g} Ω (V² over power): {recorded:.3g} W. A replay offers this "
        f"at any load; the real device gives {comparisons}"
    )


def write_csv(
    setup: Prepared,
    output: str | Path,
    rate: float | None = None,
    duration: float | None = None,
    realization: int = 0,
    *,
    report: Callable[[str], None],
) -> list[Path]:
    """Write time (s), voltage (V) and current (A) of a scene's load as SCENE-trace.csv.

    Parameters
    ----------
    setup : Prepared
        A scene in SI.
    output : str or Path
        Folder.
    rate : float or None
        Samples a second; None: `CSV_RATE`.
    duration : float or None
        s; None: the scene's.
    realization : int
        Number of the realization with the excitation.
    report : callable
        Called with the expected file size, and then with the effect of replay.

    Raises
    ------
    ExportError
    """
    scene, rate = setup.scene, rate or CSV_RATE
    duration = _check(scene, "csv", rate, duration, realization, report)
    path = in_folder(folder_of(output, "csv"), f"{scene.name}-trace.csv")
    trace = record_trace(scene, rate, duration, realization)
    rows = np.array([np.arange(trace.voltage.size) / rate, trace.voltage, trace.current]).T
    text = io.StringIO()
    np.savetxt(text, rows, "%.9g", ",", header="time_s,voltage_V,current_A", comments="")
    with whole_file(path) as file:
        file.write(text.getvalue().encode())
    _tell(scene, trace, realization, report)
    return [path]


def write_shepherd(
    setup: Prepared,
    output: str | Path,
    data: str = "ivsample",
    duration: float | None = None,
    realization: int = 0,
    *,
    report: Callable[[str], None],
) -> list[Path]:
    """Write a scene's load, or its open and shorted terminals, as Shepherd's SCENE-DATA.h5.

    Parameters
    ----------
    data : str
        "ivsample": voltage and current of the scene's load. "isc_voc": open-circuit voltage and
        short-circuit current, from one run each.
    setup, output, duration, realization, report
        See `write_csv`; also raises MissingLibrary.
    """
    if data not in DATA_TYPES:
        raise ExportError(f"--data {data}: no such data; there are {', '.join(DATA_TYPES)}")
    optional_library("shepherd_core", "a Shepherd file", "shepherd")
    scene = setup.scene
    duration = _check(scene, "shepherd", SHEPHERD_RATE, duration, realization, report)
    path = in_folder(folder_of(output, "shepherd"), f"{scene.name}-{data}.h5")
    if data == "ivsample":
        trace = record_trace(scene, SHEPHERD_RATE, duration, realization)
        voltage, current = trace.voltage, trace.current
        _tell(scene, trace, realization, report)
    else:
        voltage, current = _extremes(setup, duration, realization, report)
    with whole_file(path) as file:
        file.write(_shepherd_content(scene, data, voltage, current))
    return [path]


def _extremes(setup, duration, realization, report):
    """Open-circuit voltage and short-circuit current; reports the power that they predict."""
    scene = setup.scene
    rate = timescales.angular_frequency(setup.system)
    matched = scene.transducer.matched_resistance(rate)
    opened, shorted, live = (
        record_trace(with_resistor(scene, factor * matched), SHEPHERD_RATE, duration, realization)
        for factor in (OPEN, SHORTED, 1.0)
    )
    promised = float(np.mean(opened.voltage * shorted.current)) / 4.0
    delivered = float(np.mean(live.voltage * live.current))
    report(
        "open voltage and shorted current are from two runs with different motion. A straight line "
        f"between them predicts at most {promised:.3g} W; the real device gives "
        f"{delivered:.3g} W at its matched {matched:.3g} Ω"
    )
    return opened.voltage, shorted.current


def _shepherd_content(scene, data, voltage, current):
    """The file's bytes, through a temporary file: Shepherd's writer needs a path."""
    from shepherd_core import Writer
    from shepherd_core.data_models.base.calibration import CalibrationPair, CalibrationSeries

    from harvester.base.temporary import TemporaryFolder

    scale = CalibrationSeries()
    scale = CalibrationSeries(
        voltage=CalibrationPair(gain=_gain(voltage, scale.voltage.gain), unit="V"),
        current=CalibrationPair(gain=_gain(current, scale.current.gain), unit="A"),
    )
    with TemporaryFolder() as folder:
        path = Path(folder) / "trace.h5"
        with Writer(path, mode="harvester", datatype=data, cal_data=scale, verbose=False) as file:
            file.store_hostname("artificial")
            file["scene"] = scene.name
            for first in range(0, voltage.size, BLOCK):
                block = slice(first, first + BLOCK)
                file.append_iv_data_si(first / SHEPHERD_RATE, voltage[block], current[block])
        return path.read_bytes()


def _gain(values: np.ndarray, usual: float) -> float:
    """Size of a quantization step: Shepherd's default, unless the peak is too high or too low."""
    peak = float(values.max(initial=0.0))
    if peak == 0.0 or FEWEST_STEPS * usual <= peak <= HIGHEST_RAW * usual:
        return usual
    return peak / (HIGHEST_RAW // 2)


def _check(scene, kind, rate, duration, realization, report):
    """Raise if the trace cannot be recorded, report the file size, and return the duration."""
    if scene.units != "SI":
        raise ExportError(
            f'{scene.name}: units = "{scene.units}": a trace is in volts and amperes; give the '
            'device in SI with units = "SI", as the scene paper_si does'
        )
    check_realization(scene, realization)
    duration = duration or scene.run.duration
    samples = duration * rate
    size = samples * BYTES[kind]
    if samples > MOST_SAMPLES:
        raise ExportError(
            f"{scene.name}: {duration:g} s at {rate:g} samples a second are {samples:.3g} samples, "
            f"{size / 1e9:.3g} GB; at most {MOST_SAMPLES:.3g} are written: give --duration, up to "
            f"{MOST_SAMPLES / rate:g} s"
        )
    if kind == "shepherd":
        duration = math.ceil(samples / BLOCK - 1e-9) * BLOCK / rate
    elif round(samples) < 1:
        raise ExportError(
            f"{scene.name}: {duration:g} s at {rate:g} samples a second hold no sample: give "
            f"--duration {1.0 / rate:g} or more"
        )
    size = duration * rate * BYTES[kind]
    report(f"{duration:g} s at {rate:g} samples a second: up to {size / 1e6:.3g} MB")
    return duration


def _tell(scene, trace, realization, report):
    if trace.returned > 1e-3:
        report(
            f"the load returns {trace.returned:.1%} of the energy to the device, which a trace "
            "without signs omits"
        )
    report(replay_loss(scene, trace, realization))
