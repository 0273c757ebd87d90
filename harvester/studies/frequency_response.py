"""`frequency_response`: amplitude, voltage and power over the frequency of a sine.

One run per direction goes through the frequencies one after another without a jump in phase, so
that the device keeps its branch: what differs between up and down is hysteresis.
"""

import math
import time
from contextlib import nullcontext
from dataclasses import dataclass, replace

import numpy as np

from harvester.device import timescales
from harvester.engines.protocol import ENGINES
from harvester.engines.realization import Waveform, start_state
from harvester.engines.steps import knot_spacing
from harvester.engines.workers import WorkerPool
from harvester.errors import HarvesterError
from harvester.excitation.sine import KNOTS_PER_PERIOD, Sine, SteppedSine
from harvester.files.writing import finite
from harvester.results import SI_UNITS
from harvester.scene.model import Scene
from harvester.scene.units import scale
from harvester.simulation import TIME_LIMIT, check_name, check_step

# At each frequency a transient falls to this share before the measurement.
SETTLED_SHARE = 1e-4
# Measured periods of the lowest frequency; the change from their first to their second half is
# the residual.
MEASURED_PERIODS = 16
NOTED_RESIDUAL = 0.01
# Quantity, its dimension.
QUANTITIES = {
    "displacement_amplitude": "displacement",
    "rms_voltage": "voltage",
    "mean_power": "power",
}


@dataclass(frozen=True)
class Sweep:
    """One direction of a frequency response; arrays of shape (frequencies,), scaled units.

    Attributes
    ----------
    direction : str
        "up" or "down".
    displacement_amplitude : half of the distance between the extremes of X.
    rms_voltage, mean_power : means over whole periods.
    residual : share by which the mean-square voltage changes from the first half of the measured
        periods to the second: a transient that is left, or a motion without period.
    """

    direction: str
    displacement_amplitude: np.ndarray
    rms_voltage: np.ndarray
    mean_power: np.ndarray
    residual: np.ndarray


@dataclass(frozen=True)
class FrequencyResponse:
    """The periodic response of one scene over frequency.

    Attributes
    ----------
    scene : Scene
        With a sine, whose own frequency is not used.
    engine : str
    frequencies : ndarray, shape (n,)
        Hz, rising.
    sweeps : list of Sweep
        Up, and down where asked for, both in the order of `frequencies`.
    scales : harvester.scene.units.Scales
    engine_version : str
    dwell : float
        Time at each frequency (s).
    seconds : float
        Of simulation, both directions.
    """

    scene: Scene
    engine: str
    frequencies: np.ndarray
    sweeps: list
    scales: object
    engine_version: str
    dwell: float
    seconds: float

    def values(self, name, sweep):
        """A quantity of a sweep in the scene's units, shape (n,)."""
        return getattr(sweep, name) * self.scales.of(QUANTITIES[name])

    def unit(self, dimension):
        """Unit of a dimension in this scene."""
        return SI_UNITS[dimension] if self.scene.units == "SI" else "scaled"

    def table(self):
        """Header and rows of the table, as text."""
        header = ["sweep", "frequency (Hz)"]
        header += [
            f"{name.replace('_', ' ')} ({self.unit(dimension)})"
            for name, dimension in QUANTITIES.items()
        ]
        rows = []
        for sweep in self.sweeps:
            columns = [self.values(name, sweep) for name in QUANTITIES]
            for k, frequency in enumerate(self.frequencies):
                cells = [f"{column[k]:.5g}" for column in columns]
                rows.append(
                    [sweep.direction, f"{frequency:.5g}", *cells, f"{sweep.residual[k]:.1e}"]
                )
        return [*header, "residual"], rows

    def sentences(self):
        """What the numbers say, one line each."""
        lines = [
            f"{self.engine}: {self.engine_version}; {self.dwell:.4g} s at each frequency, "
            f"the transient down to {SETTLED_SHARE:g}; {self.seconds:.2f} s"
        ]
        for sweep in self.sweeps:
            best = int(np.argmax(sweep.mean_power))
            lines.append(
                f"sweep {sweep.direction}: most power, "
                f"{self.values('mean_power', sweep)[best]:.4g}, at {self.frequencies[best]:.4g} Hz"
            )
            unsettled = int(np.count_nonzero(~(sweep.residual <= NOTED_RESIDUAL)))
            if unsettled:
                lines.append(
                    f"sweep {sweep.direction}: at {unsettled} frequencies the motion is not "
                    f"periodic or not settled (residual over {NOTED_RESIDUAL:.0%})"
                )
        return lines

    def to_dict(self):
        """Plain values for JSON, in the scene's units."""
        return {
            "engine": self.engine,
            "engine_version": self.engine_version,
            "frequencies": [float(frequency) for frequency in self.frequencies],
            "sweeps": {
                sweep.direction: {
                    **{
                        name: [finite(value) for value in self.values(name, sweep)]
                        for name in QUANTITIES
                    },
                    "residual": [finite(value) for value in sweep.residual],
                }
                for sweep in self.sweeps
            },
            "error_kind": "numerical",
            "dwell": self.dwell,
            "seconds": self.seconds,
            "scene": self.scene.to_dict(),
        }


def frequency_response(
    scene,
    frequencies,
    engine="monte-carlo",
    *,
    amplitude=None,
    down=False,
    step="default",
    workers=None,
    time_limit=TIME_LIMIT,
    pool=None,
):
    """Amplitude, rms voltage and mean power over the frequency of a sine.

    Parameters
    ----------
    scene : Scene
        With `excitation.kind = "sine"`, whose amplitude is kept, or any other with `amplitude`.
    frequencies : sequence of float
        Hz.
    engine : str
        "monte-carlo" (Runge–Kutta) or "circuit" (ngspice), on the same path.
    amplitude : float or None
        Of the base acceleration, m/s² in SI; None: the scene's own.
    down : bool
        Sweep down as well: hysteresis is where the two differ.
    step, workers, time_limit, pool
        See `harvester.simulate`.

    Returns
    -------
    FrequencyResponse

    Raises
    ------
    HarvesterError, SimulationError

    Notes
    -----
    The excitation has no chance in it, so there is no statistical error. `Sweep.residual` tells
    how far the motion is from a settled, periodic one; the step's own error, of second order in
    the circuit, shows when `step` is halved.
    """
    engine = check_name("engine", engine, ENGINES)
    step = check_step(step)
    frequencies = np.unique(np.asarray(frequencies, dtype=float))
    scene = _with_sine(scene, amplitude)
    if frequencies.size == 0 or not (np.isfinite(frequencies).all() and frequencies[0] > 0.0):
        raise HarvesterError("frequencies: must be one or more numbers > 0, in Hz")
    directions = {"up": frequencies, "down": frequencies[::-1]} if down else {"up": frequencies}
    calls = [
        {"scene": _stepped(scene, order), "engine": engine, "step": step}
        for order in directions.values()
    ]
    with nullcontext(pool) if pool else WorkerPool(len(calls), workers) as running:
        outcomes = running.map(run, calls, time_limit)
    sweeps = []
    for direction, (rows, _, _) in zip(directions, outcomes, strict=True):
        ordered = rows if direction == "up" else rows[::-1]
        sweeps.append(Sweep(direction, *np.array(ordered).T))
    return FrequencyResponse(
        scene=scene,
        engine=engine,
        frequencies=frequencies,
        sweeps=sweeps,
        scales=scale(scene)[1],
        engine_version=outcomes[0][1],
        dwell=calls[0]["scene"].excitation.dwell,
        seconds=sum(seconds for _, _, seconds in outcomes),
    )


def run(scene, engine, step, report):
    """One direction, in a worker process.

    Returns
    -------
    list of tuple, str, float
        (amplitude, rms voltage, mean power, residual) at each frequency, scaled; the engine's
        version; seconds.
    """
    chosen = ENGINES[engine]
    excitation = scene.excitation
    path = excitation.path(knot_spacing(scene), scale(scene)[1].displacement, None)
    windows = []
    for place, frequency in enumerate(excitation.frequencies):
        end = (place + 1) * excitation.dwell
        windows.append(Waveform(end - _measured(excitation, frequency) - 2.0 * path.spacing, end))
    chosen.prepare(scene)
    clock = time.perf_counter()
    outcome = chosen.run_realizations(
        scene,
        [path],
        [start_state(scene, 0)],
        [windows],
        step,
        "external",
        ENGINES[engine].schemes[0],
    )
    seconds = time.perf_counter() - clock
    rows = [
        _means(window.record(), frequency, window.stop, _measured(excitation, frequency))
        for window, frequency in zip(windows, excitation.frequencies, strict=True)
    ]
    return rows, outcome["engine_version"], seconds


def _with_sine(scene, amplitude):
    """The scene under a sine; its frequency is not used."""
    if amplitude is None:
        if not isinstance(scene.excitation, Sine):
            raise HarvesterError(
                f'{scene.name}: excitation.kind = "{scene.excitation.kind}": a frequency response '
                'needs kind = "sine", or an amplitude'
            )
        return scene
    if not (math.isfinite(amplitude) and amplitude > 0.0):
        raise HarvesterError(f"amplitude {amplitude:g}: must be a number > 0")
    return replace(scene, excitation=Sine(amplitude, 1.0))


def _stepped(scene, frequencies):
    """The scene with a sine that dwells at each frequency until the transient is gone."""
    parameters, _ = scale(scene)
    decay = parameters.transducer.decay_rate()
    slowest = 2.0 * timescales.relaxation_time(parameters)
    slowest = max(slowest, 1.0 / decay) if decay > 0.0 else slowest
    motion = 2.0 * math.pi / timescales.fastest_angular_frequency(parameters) / KNOTS_PER_PERIOD
    spacing = min(Sine(1.0, frequencies.max()).spacing(motion), motion)
    dwell = slowest * math.log(1.0 / SETTLED_SHARE) + MEASURED_PERIODS / frequencies.min()
    dwell = math.ceil(dwell / spacing) * spacing
    excitation = SteppedSine(
        scene.excitation.amplitude, tuple(map(float, frequencies)), dwell, spacing
    )
    length = replace(scene.run, settle=0.0, duration=dwell * len(frequencies), realizations=1)
    return replace(scene, excitation=excitation, run=length)


def _measured(excitation, frequency):
    """An even number of whole periods, at least as long as those of the lowest frequency."""
    longest = MEASURED_PERIODS / min(excitation.frequencies)
    return 2 * math.floor(0.5 * longest * frequency + 1e-9) / frequency


def _means(record, frequency, stop, measured):
    """(amplitude, rms voltage, mean power, residual) over the last whole periods."""
    middle, start = stop - 0.5 * measured, stop - measured
    inside = record.time >= start
    highest = _peak(record.time[inside], record.displacement[inside])
    lowest = -_peak(record.time[inside], -record.displacement[inside])
    squares = _integrals(record.time, record.voltage**2, (start, middle, stop))
    power = _integrals(record.time, record.load_power, (start, middle, stop))
    first, second = squares
    return (
        0.5 * (highest - lowest),
        math.sqrt((first + second) / measured),
        float(sum(power)) / measured,
        abs(second / first - 1.0) if first > 0.0 else 0.0,
    )


def _peak(times, values):
    """The greatest value, between points by a parabola through three of them."""
    place = int(np.clip(np.argmax(values), 1, values.size - 2))
    near = slice(place - 1, place + 2)
    a, b, c = np.polyfit(times[near] - times[place], values[near], 2)
    vertex = c - 0.25 * b * b / a if a < 0.0 else values.max()
    return float(max(vertex, values.max()))


def _integrals(times, values, edges):
    """Integrals between neighbouring edges, trapezoidal with values linear between points."""
    steps = 0.5 * np.diff(times) * (values[1:] + values[:-1])
    total = np.concatenate([[0.0], np.cumsum(steps)])
    return np.diff([_integral_to(times, values, total, edge) for edge in edges])


def _integral_to(times, values, total, edge):
    place = int(np.clip(np.searchsorted(times, edge) - 1, 0, times.size - 2))
    since = edge - times[place]
    slope = (values[place + 1] - values[place]) / (times[place + 1] - times[place])
    return total[place] + since * (values[place] + 0.5 * since * slope)
