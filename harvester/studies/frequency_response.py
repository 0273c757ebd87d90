"""`frequency_response`: amplitude, voltage and power over the frequency of a sine.

One run per direction passes through the frequencies with continuous phase, so that the device stays
on its branch: a difference between up and down is hysteresis.
"""

from __future__ import annotations

import math
import numbers
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from circuits.netlist.kinds import BATTERY, OUTPUT, SUPPLY
from harvester.base.arguments import listed, real_numbers
from harvester.base.errors import HarvesterError
from harvester.base.formatting import quantity, written
from harvester.base.plain_text import json_text
from harvester.base.serialising import plain
from harvester.base.tables import require_xarray
from harvester.device import timescales
from harvester.engines.methods import engine_of
from harvester.engines.realization import WaveformObserver as Waveform
from harvester.engines.simulate import check_name
from harvester.excitation.sine import KNOTS_PER_PERIOD, Sine, SteppedSine
from harvester.results.orbit import CHARGING, REASONS
from harvester.results.palette import CIRCUIT, MONTE_CARLO
from harvester.results.panels import Panel, Series, draw_panels, is_wide
from harvester.results.view import Picture, ResultBase, View
from harvester.scene.model import Scene
from harvester.scene.paths import start_state
from harvester.scene.prepared import Prepared
from harvester.scene.steps import (
    faintness,
    knot_spacing,
    step_error,
    steps_per_sample,
    susceptance,
)
from harvester.scene.units import Scales
from harvester.statistics.output_side import LEAST_SUPPLY
from harvester.statistics.range_watch import with_range_watch
from harvester.statistics.transient import transient_time
from harvester.statistics.units import SI_UNITS

if TYPE_CHECKING:
    from xarray import Dataset

# The measurement at a frequency begins when the transient has decayed to this share.
SETTLED_SHARE = 1e-4
# Longest waiting time for a load's store at a frequency, in periods of the lowest frequency. A
# slower store may still be charging.
MOST_PERIODS = 20_000
# Maximum number of knots of the sine at one frequency. A run with more would take too long.
MOST_KNOTS = 1e10
# Number of measured periods of the lowest frequency. The residual is the change from the first half
# of these periods to the second.
MEASURED_PERIODS = 16
NOTED_RESIDUAL = 0.01
# Index of the residual among the quantities of a direction.
RESIDUAL = 3
# Quantities and their dimensions.
QUANTITIES = {
    "displacement_amplitude": "displacement",
    "absolute_amplitude": "displacement",
    "rms_voltage": "voltage",
    "peak_voltage": "voltage",
    "mean_power": "power",
    "peak_power": "power",
    "mean_output_voltage": "voltage",
    "mean_output_power": "power",
}
USUAL = ("displacement_amplitude", "rms_voltage", "mean_power")
AT_THE_OUTPUT = ("mean_output_voltage", "mean_output_power")
G = 9.80665
# Colour, line style and marker of each direction.
UP, DOWN = (CIRCUIT, "-", ">"), (MONTE_CARLO, "--", "<")


@dataclass(frozen=True)
class FrequencySweep:
    """One direction of a frequency response; arrays of shape (frequencies,), scaled units.

    Attributes
    ----------
    direction : "up" or "down".
    displacement_amplitude
        Half the peak-to-peak value of X, relative to the base.
    rms_voltage, mean_power
        Means over an integer number of periods.
    absolute_amplitude
        Amplitude of the mass in the inertial frame.
    peak_voltage, peak_power
        Maxima of |V| and of the power into the load.
    mean_output_voltage, mean_output_power
        At the load's output; NaN if there is none.
    residual
        Relative change of the mean-square voltage from the first half of the measured periods to
        the second: a remaining transient, or aperiodic motion. For a store slower than
        `MOST_PERIODS`, the estimated change still to come; above `NOTED_RESIDUAL` the store is
        still charging, and the other quantities are NaN.
    step_error
        Relative error of the power due to the step; NaN if the engine chooses the steps.
    """

    direction: str
    displacement_amplitude: np.ndarray
    rms_voltage: np.ndarray
    mean_power: np.ndarray
    residual: np.ndarray
    absolute_amplitude: np.ndarray
    peak_voltage: np.ndarray
    peak_power: np.ndarray
    mean_output_voltage: np.ndarray
    mean_output_power: np.ndarray
    step_error: np.ndarray


@dataclass(frozen=True, repr=False)
class FrequencyResponse(ResultBase):
    """The periodic response of one scene over frequency.

    Attributes
    ----------
    scene
        Scene with a sine, whose frequency is ignored.
    frequencies : ndarray, shape (n,)
        Frequencies in Hz, ascending.
    sweeps
        The upward sweep, and the downward sweep if requested, both in the order of `frequencies`.
    dwell
        Time at each frequency (s).
    seconds
        Processor time of the simulation (s), both directions.
    shown
        Quantities in the table and figure; the JSON contains all.
    per_g : bool
        Whether all values are for a base acceleration of 1 g: amplitudes and voltages are divided
        by the excitation's amplitude in g, powers by its square.
    """

    scene: Scene
    engine: str
    frequencies: np.ndarray
    sweeps: list[FrequencySweep]
    scales: Scales
    engine_version: str
    dwell: float
    seconds: float
    shown: tuple[str, ...] = USUAL
    per_g: bool = False

    def values(self, name: str, sweep: FrequencySweep) -> np.ndarray:
        """A quantity of a sweep in the scene's units, shape (n,)."""
        dimension, excitation = QUANTITIES[name], self.scene.excitation
        values = getattr(sweep, name) * self.scales.of(dimension)
        if not self.per_g:
            return values
        assert isinstance(excitation, Sine)
        return values / (excitation.amplitude / G) ** (2 if dimension == "power" else 1)

    def unit(self, dimension: str) -> str:
        """Unit of a dimension in this scene."""
        if self.scene.units != "SI":
            return "scaled"
        per = {"power": "/g²"}.get(dimension, "/g") if self.per_g else ""
        return SI_UNITS[dimension] + per

    @property
    def power(self) -> str:
        """Name of the power that is evaluated: at the output if the load has one."""
        return "mean_output_power" if _has_output(self.scene) else "mean_power"

    def view(self) -> View:
        """Table, findings and pictures."""
        return View(
            self._table(),
            self._findings(),
            headline=self._headline(),
            pictures=[Picture(_draw, self)],
            records=self._records,
            keys=2,
            dataset=self._dataset,
        )

    def _table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows of the table, as text."""
        units = ["Hz", *(self.unit(QUANTITIES[name]) for name in self.shown)]
        header = ["sweep", "frequency", *(name.replace("_", " ") for name in self.shown)]
        return [*header, "residual"], [
            [direction, *map(partial(quantity, digits=5), values, units), written(residual, ".1e")]
            for direction, *values, residual in self._records()[1]
        ]

    def _records(self) -> tuple[list[str], list[list[Any]]]:
        """Header and rows of numbers, in the scene's units."""
        header = ["sweep", "frequency [Hz]"]
        header += [f"{name} [{self.unit(QUANTITIES[name])}]" for name in self.shown]
        rows = []
        for sweep in self.sweeps:
            columns = [self.frequencies, *(self.values(name, sweep) for name in self.shown)]
            rows += [[sweep.direction, *row] for row in zip(*columns, sweep.residual, strict=True)]
        return [*header, "residual"], rows

    def _dataset(self) -> Dataset:
        """An xarray Dataset over sweep and frequency, in the scene's units."""
        axes = ("sweep", "frequency")
        variables: dict[str, tuple] = {}
        for name in quantities_of(self.scene):
            unit = {"unit": self.unit(QUANTITIES[name])}
            variables[name] = (axes, [self.values(name, s) for s in self.sweeps], unit)
        for name in ("residual", "step_error"):
            variables[name] = (axes, [getattr(sweep, name) for sweep in self.sweeps])
        sweeps = [sweep.direction for sweep in self.sweeps]
        coordinates = {"sweep": sweeps, "frequency": self.frequencies}
        attributes = {"scene": json_text(self.scene.to_dict()), "method": self.engine}
        return require_xarray().Dataset(variables, coordinates, attributes)

    def _findings(self) -> list[str]:
        """Sentences on the findings, one line each."""
        lines = [
            f"{self.engine}: {self.engine_version}; {self.dwell:.4g} s at each frequency, "
            f"the transient decays to {SETTLED_SHARE:g} within {MOST_PERIODS} periods; "
            f"{self.seconds:.2f} s"
        ]
        lines.append(
            "residual: share by which the mean-square voltage changes from the first half of the "
            "measured periods to the second; the power's error is at least as large"
        )
        costs = np.concatenate([sweep.step_error for sweep in self.sweeps])
        if np.isfinite(costs).any():
            least, most = 100.0 * np.nanmin(costs), 100.0 * np.nanmax(costs)
            where = self.frequencies[np.nanargmax(costs) % self.frequencies.size]
            lines.append(
                f"step errors of powers are {least:.1g} to {most:.1g} %, largest at {where:.4g} "
                "Hz; step = fine reduces them to a sixteenth or less"
            )
        for sweep in self.sweeps:
            name = self.power
            charging = np.count_nonzero(np.isnan(sweep.mean_power))
            if charging:
                lines.append(
                    f"sweep {sweep.direction}: {CHARGING} at {charging} frequencies, which have no "
                    f"power: {REASONS[CHARGING]}"
                )
            if charging == sweep.mean_power.size:
                continue
            best = int(np.nanargmax(getattr(sweep, name)))
            lines.append(
                f"sweep {sweep.direction}: largest {name.removeprefix('mean_').replace('_', ' ')}, "
                f"{quantity(self.values(name, sweep)[best], self.unit('power'))}, at "
                f"{self.frequencies[best]:.4g} Hz (residual {sweep.residual[best]:.1e})"
            )
            unsettled = int(np.count_nonzero(~(sweep.residual <= NOTED_RESIDUAL))) - charging
            if unsettled:
                lines.append(
                    f"sweep {sweep.direction}: at {unsettled} frequencies the motion is not "
                    f"periodic or not settled (residual over {NOTED_RESIDUAL:.0%})"
                )
        return lines

    def _headline(self) -> str:
        """The largest power and its frequency."""
        if np.isnan([sweep.mean_power for sweep in self.sweeps]).all():
            return f"{CHARGING}: {REASONS[CHARGING]}"
        peaks = [
            (float(np.nanmax(self.values(self.power, s), initial=0.0)), s) for s in self.sweeps
        ]
        power, sweep = max(peaks, key=lambda peak: peak[0])
        frequency = self.frequencies[int(np.nanargmax(getattr(sweep, self.power)))]
        words = self.power.removeprefix("mean_").replace("_", " ")
        return (
            f"largest {words}: {quantity(power, self.unit('power'))} at {frequency:.4g} Hz, sweep "
            f"{sweep.direction}, by {self.engine}"
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, in the scene's units."""
        return plain(
            {
                "engine": self.engine,
                "engine_version": self.engine_version,
                "frequencies": self.frequencies,
                "sweeps": {
                    sweep.direction: {
                        **{name: self.values(name, sweep) for name in quantities_of(self.scene)},
                        "residual": sweep.residual,
                        "step_error": sweep.step_error,
                    }
                    for sweep in self.sweeps
                },
                "per_g": self.per_g,
                "error_kind": "numerical",
                "dwell": self.dwell,
                "seconds": self.seconds,
                "scene": self.scene,
            }
        )


def _draw(response):
    """Draw amplitude, rms voltage and mean power over frequency, up and down."""
    panels = []
    for name in response.shown:
        dimension, series = QUANTITIES[name], []
        for sweep in response.sweeps:
            colour, line, marker = UP if sweep.direction == "up" else DOWN
            x, y = response.frequencies, response.values(name, sweep)
            series.append(Series(x, y, f"sweep {sweep.direction}", colour, line))
            unsettled = ~(sweep.residual <= NOTED_RESIDUAL)
            x, y = x[unsettled], y[unsettled]
            if unsettled.any():
                hollow = [True] * x.size
                series.append(Series(x, y, None, colour, "", marker, hollow=hollow))
        label = f"{name.replace('_', ' ')} [{response.unit(dimension)}]"
        wide = is_wide(response.frequencies)
        positive = all((response.values(name, sweep) > 0.0).all() for sweep in response.sweeps)
        panels.append(Panel("frequency [Hz]", label, series, log_x=wide, log_y=positive))
    marked = any(not (sweep.residual <= NOTED_RESIDUAL).all() for sweep in response.sweeps)
    title = f"{response.scene.name}: {response.engine}"
    title += " (hollow marks: not periodic or not settled)" * marked
    return draw_panels(panels, title, size=(2.6, 2.4))


class _Outputs:
    """Pass a load's output to the time windows of all frequencies."""

    def __init__(self, windows: list[Waveform], rows: Sequence[tuple[str, str]]) -> None:
        self._windows = windows
        self._powers = [k for k, (kind, _) in enumerate(rows) if kind == OUTPUT]
        self._sources = [k for k, (kind, _) in enumerate(rows) if kind in (SUPPLY, BATTERY)]
        self.conductance = math.nan

    def add(
        self, time: np.ndarray, voltage: np.ndarray, values: np.ndarray, *others: object
    ) -> None:
        """Add points of the voltage, the measured output power, and the power of each source."""
        used = values[self._powers].sum(axis=0)
        for window in self._windows:
            window.add_output(voltage, used, *values[self._sources])


def one_direction(
    prepared_scene: Prepared,
    engine: str,
    step: str | float,
    report: Callable,
    settings: dict[str, Any] | None = None,
) -> tuple[list[tuple[float, ...]], str, float]:
    """Compute one direction in a worker process.

    `engine`, `step`, `settings`: the engine's name, its step, and its non-default options.

    Returns
    -------
    list of tuple, str, float
        The scaled quantities of `FrequencySweep`, at each frequency; the engine's version;
        processor time (s).
    """
    chosen = engine_of(engine, step=step, **settings or {})
    scene = prepared_scene.scene
    excitation: Any = scene.excitation
    path = excitation.path(knot_spacing(prepared_scene), prepared_scene.excitation_unit, None)
    windows = []
    for number, frequency in enumerate(excitation.frequencies):
        end = (number + 1) * excitation.dwell
        windows.append(Waveform(end - _measured(excitation, frequency) - 2.0 * path.spacing, end))
    output = _Outputs(windows, scene.load.circuit.recorded) if _has_output(scene) else None
    chosen.prepare(prepared_scene)
    clock = time.perf_counter()
    observers = with_range_watch(prepared_scene, [windows])
    outputs = [output] if output else None
    outcome = chosen.run_realizations(
        prepared_scene, [path], [start_state(prepared_scene, 0)], observers, outputs
    )
    seconds = time.perf_counter() - clock
    rows = []
    for number, (window, frequency) in enumerate(zip(windows, excitation.frequencies, strict=True)):
        record, ends = window.record(), (window.stop, _measured(excitation, frequency))
        base = (
            excitation.base_displacement(record.time, number) / prepared_scene.scales.displacement
        )
        at_output = (math.nan, math.nan)
        if output:
            at_output = _output_means(record.time, window.outputs(), *ends, output.conductance)
        row = np.array([*_means(record, base, *ends), *at_output])
        if excitation.dwell < transient_time(prepared_scene, SETTLED_SHARE):
            # The remaining change after a time t is τ/t times the change during t.
            residual = (
                row[RESIDUAL] * transient_time(prepared_scene, math.exp(-1.0)) / (0.5 * ends[1])
            )
            row[:] = row if residual <= NOTED_RESIDUAL else math.nan
            row[RESIDUAL] = residual
        rows.append((*row.tolist(), _step_error(prepared_scene, chosen, frequency, *row[1:3])))
    return rows, outcome["engine_version"], seconds


def _step_error(stepped, engine, frequency, rms_voltage, power):
    """Relative error of the power due to the step; NaN if the engine chooses the steps."""
    if engine.chooses_steps:
        return math.nan
    scene, spacing = stepped.scene, knot_spacing(stepped)
    sine = Sine(scene.excitation.amplitude, frequency, knot_spacing=spacing)
    prepared_scene = stepped.replace(excitation=sine)
    steps = steps_per_sample(stepped, engine.step, engine.name)
    cost = step_error(prepared_scene, spacing / steps, engine.name)
    return cost * faintness(susceptance(prepared_scene) * rms_voltage**2, power)


def rising_frequencies(frequencies: Any) -> np.ndarray:
    """Unique frequencies in Hz in ascending order, from a list, generator, array or number."""
    listed_frequencies = [frequencies] if isinstance(frequencies, numbers.Real) else frequencies
    rising = np.unique(real_numbers(listed_frequencies, "frequencies", "[10.0, 12.5]"))
    if rising[0] <= 0.0:
        raise HarvesterError("frequencies: must be one or more numbers > 0, in Hz")
    return rising


def with_sine(scene: Scene, amplitude: float | None) -> Scene:
    """The scene under a sine, whose frequency is ignored."""
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


def _has_output(scene):
    return bool(scene.load.circuit and scene.load.circuit.has_output)


def quantities_of(scene: Scene) -> list[str]:
    """Names of the quantities that the scene's load has."""
    return [name for name in QUANTITIES if name not in AT_THE_OUTPUT or _has_output(scene)]


def shown_of(scene: Scene, quantities: Sequence[str], per_g: bool) -> tuple[str, ...]:
    """Quantities to show, by default the usual ones and the output's quantities.

    Raises HarvesterError for an unknown quantity, or if `per_g` is requested in a scaled scene.
    """
    if per_g and scene.units != "SI":
        raise HarvesterError(f'{scene.name}: --per-g: needs units = "SI", not "scaled": omit it')
    chosen = listed(quantities, "quantities", 'quantities=["rms_voltage"]', str)
    available = quantities_of(scene)
    usual = (*USUAL, *(AT_THE_OUTPUT if _has_output(scene) else ()))
    return tuple(check_name("quantity", name, available) for name in chosen) or usual


def stepped(prepared_scene: Prepared, frequencies: np.ndarray) -> Scene:
    """The scene with a sine that dwells at each frequency until the transient has decayed."""
    scene = prepared_scene.scene
    motion = (
        2.0
        * math.pi
        / timescales.fastest_angular_frequency(prepared_scene.system)
        / KNOTS_PER_PERIOD
    )
    spacing = min(Sine(1.0, frequencies.max()).spacing(motion), motion)
    dwell = transient_time(prepared_scene, SETTLED_SHARE, MOST_PERIODS / frequencies.min())
    dwell += MEASURED_PERIODS / frequencies.min()
    if not dwell < MOST_KNOTS * spacing:
        raise HarvesterError(
            f"frequencies {frequencies.min():g} … {frequencies.max():g} Hz: {dwell:.3g} s at each, "
            f"in steps of {spacing:.3g} s, exceed {MOST_KNOTS:g} steps; choose other frequencies, "
            "or a load with faster stores"
        )
    dwell = math.ceil(dwell / spacing) * spacing
    sine: Any = scene.excitation
    excitation = SteppedSine(sine.amplitude, tuple(map(float, frequencies)), dwell, spacing)
    length = replace(scene.run, settle=0.0, duration=dwell * len(frequencies), realizations=1)
    return replace(scene, excitation=excitation, run=length)


def _measured(excitation, frequency):
    """Even number of whole periods, at least as long as the measured periods of the lowest
    frequency.
    """
    longest = MEASURED_PERIODS / min(excitation.frequencies)
    return 2 * math.floor(0.5 * longest * frequency + 1e-9) / frequency


def _means(record, base, stop, measured):
    """`FrequencySweep`'s quantities over the last whole periods, except the output's."""
    middle, start = stop - 0.5 * measured, stop - measured
    inside = record.time >= start
    times = record.time[inside]
    # Amplitudes are half the peak-to-peak values.
    relative, absolute = (
        0.5 * (_peak(times, x[inside]) + _peak(times, -x[inside]))
        for x in (record.displacement, base + record.displacement)
    )
    first, second = _integrals(record.time, record.voltage**2, (start, middle, stop))
    power = _integrals(record.time, record.load_power, (start, middle, stop))
    return (
        relative,
        math.sqrt((first + second) / measured),
        float(sum(power)) / measured,
        abs(second / first - 1.0) if first > 0.0 else 0.0,
        absolute,
        _peak(times, np.abs(record.voltage[inside])),
        _peak(times, record.load_power[inside]),
    )


def _output_means(times, outputs, stop, measured, conductance):
    """Mean voltage and power of a load's output over the last whole periods.

    The power excludes power from the load's sources.
    """
    voltage, used, *sources = outputs
    ends = (stop - measured, stop)
    mean = _integrals(times, voltage, ends) / measured
    power = _integrals(times, conductance * voltage**2 + used, ends) / measured
    means = (_integrals(times, source, ends)[0] / measured for source in sources)
    least = LEAST_SUPPLY * abs(power[0])
    supplied = sum(-taken_power for taken_power in means if -taken_power > least)
    return float(mean[0]), float(power[0] - supplied)


def _peak(times, values):
    """The maximum, interpolated by a parabola through three points."""
    times, first = np.unique(times, return_index=True)
    values = values[first]
    peak = int(np.clip(np.argmax(values), 1, values.size - 2))
    near = slice(peak - 1, peak + 2)
    a, b, c = np.polyfit(times[near] - times[peak], values[near], 2)
    vertex = c - 0.25 * b * b / a if a < 0.0 else values.max()
    return float(max(vertex, values.max()))


def _integrals(times, values, edges):
    """Trapezoidal integrals between consecutive edges, with linear interpolation between points."""
    steps = 0.5 * np.diff(times) * (values[1:] + values[:-1])
    total = np.concatenate([[0.0], np.cumsum(steps)])
    integrals = []
    for edge in edges:
        # At a switching event two points have the same time. The interval found has a positive
        # length.
        index = max(int(np.searchsorted(times, min(edge, times[-1]))) - 1, 0)
        since = edge - times[index]
        slope = (values[index + 1] - values[index]) / (times[index + 1] - times[index])
        integrals.append(total[index] + since * (values[index] + 0.5 * since * slope))
    return np.diff(integrals)
