"""`frequency_response`: amplitude, voltage and power over the frequency of a sine.

One run per direction goes through the frequencies one after another without a jump in phase, so
that the device keeps its branch: what differs between up and down is hysteresis.
"""

from __future__ import annotations

import math
import numbers
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.arguments import listed
from harvester.device import timescales
from harvester.errors import HarvesterError
from harvester.estimates.units import SI_UNITS
from harvester.excitation.sine import KNOTS_PER_PERIOD, Sine, SteppedSine
from harvester.files.plain_text import json_text
from harvester.files.serialising import plain
from harvester.files.tables import xarray_or_say
from harvester.former_names import handed_on
from harvester.prepared.paths import start_state
from harvester.prepared.prepared import prepared
from harvester.prepared.steps import knot_spacing
from harvester.record.range_watch import with_range_watch
from harvester.scene.model import Scene
from harvester.scene.units import Scales
from harvester.show.palette import CIRCUIT, MONTE_CARLO
from harvester.show.panels import Panel, Series, draw_panels, is_wide
from harvester.simulation.methods import engine_of
from harvester.simulation.realization import Waveform

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset

# At each frequency a transient falls to this share before the measurement.
SETTLED_SHARE = 1e-4
# Pieces of the sine at one frequency, beyond which no run ends.
MOST_KNOTS = 1e10
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
# Colour, line and mark of each direction.
UP, DOWN = (CIRCUIT, "-", ">"), (MONTE_CARLO, "--", "<")


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
    sweeps: list[Sweep]
    scales: Scales
    engine_version: str
    dwell: float
    seconds: float

    def values(self, name: str, sweep: Sweep) -> np.ndarray:
        """A quantity of a sweep in the scene's units, shape (n,)."""
        return getattr(sweep, name) * self.scales.of(QUANTITIES[name])

    def unit(self, dimension: str) -> str:
        """Unit of a dimension in this scene."""
        return SI_UNITS[dimension] if self.scene.units == "SI" else "scaled"

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows of the table, as text."""
        header, rows = self.data()
        return [name.replace("_", " ") for name in header], [
            [direction, *(f"{value:.5g}" for value in values), f"{residual:.1e}"]
            for direction, *values, residual in rows
        ]

    def data(self) -> tuple[list[str], list[list[Any]]]:
        """Header and rows of numbers, in the scene's units."""
        header = ["sweep", "frequency [Hz]"]
        header += [f"{name} [{self.unit(each)}]" for name, each in QUANTITIES.items()]
        rows = []
        for sweep in self.sweeps:
            columns = [self.frequencies, *(self.values(name, sweep) for name in QUANTITIES)]
            rows += [[sweep.direction, *row] for row in zip(*columns, sweep.residual, strict=True)]
        return [*header, "residual"], rows

    def to_xarray(self) -> Dataset:
        """An xarray Dataset over sweep and frequency, in the scene's units."""
        units = {name: {"unit": self.unit(each)} for name, each in QUANTITIES.items()}
        variables: dict[str, tuple] = {
            name: (("sweep", "frequency"), [self.values(name, s) for s in self.sweeps], units[name])
            for name in QUANTITIES
        }
        variables["residual"] = (("sweep", "frequency"), [s.residual for s in self.sweeps])
        sweeps = [sweep.direction for sweep in self.sweeps]
        coordinates = {"sweep": sweeps, "frequency": self.frequencies}
        attributes = {"scene": json_text(self.scene.to_dict()), "method": self.engine}
        return xarray_or_say().Dataset(variables, coordinates, attributes)

    def sentences(self) -> list[str]:
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

    def figure(self) -> Figure:
        """Amplitude, voltage and power over frequency."""
        from harvester.show import figures

        return figures.drawn(_draw, self)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, in the scene's units."""
        return plain(
            {
                "engine": self.engine,
                "engine_version": self.engine_version,
                "frequencies": self.frequencies,
                "sweeps": {
                    sweep.direction: {
                        **{name: self.values(name, sweep) for name in QUANTITIES},
                        "residual": sweep.residual,
                    }
                    for sweep in self.sweeps
                },
                "error_kind": "numerical",
                "dwell": self.dwell,
                "seconds": self.seconds,
                "scene": self.scene,
            }
        )


def _draw(response):
    """Amplitude, rms voltage and mean power over frequency, up and down."""
    panels = []
    for name, dimension in QUANTITIES.items():
        series = []
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
        panels.append(Panel("frequency [Hz]", label, series, log_x=wide, log_y=True))
    title = f"{response.scene.name}: {response.engine} (hollow marks: not periodic or not settled)"
    return draw_panels(panels, title, size=(2.6, 2.4))


def run(
    scene: Scene,
    engine: str,
    step: str | float,
    report: Callable,
    settings: dict[str, Any] | None = None,
) -> tuple[list[tuple[float, float, float, float]], str, float]:
    """One direction, in a worker process.

    Parameters
    ----------
    engine, step, settings
        The engine's name, its step, and what else of it is not as usual.

    Returns
    -------
    list of tuple, str, float
        (amplitude, rms voltage, mean power, residual) at each frequency, scaled; the engine's
        version; seconds.
    """
    chosen = engine_of(engine, step=step, **settings or {})
    excitation: Any = scene.excitation
    ready = prepared(scene)
    path = excitation.path(knot_spacing(ready), ready.excitation_unit, None)
    windows = []
    for place, frequency in enumerate(excitation.frequencies):
        end = (place + 1) * excitation.dwell
        windows.append(Waveform(end - _measured(excitation, frequency) - 2.0 * path.spacing, end))
    chosen.prepare(ready)
    clock = time.perf_counter()
    observers = with_range_watch(ready, [windows])
    outcome = chosen.run_realizations(ready, [path], [start_state(ready, 0)], observers)
    seconds = time.perf_counter() - clock
    rows = [
        _means(window.record(), frequency, window.stop, _measured(excitation, frequency))
        for window, frequency in zip(windows, excitation.frequencies, strict=True)
    ]
    return rows, outcome["engine_version"], seconds


def rising_frequencies(frequencies: Any) -> np.ndarray:
    """In Hz, each once, of a list, a generator, an array or one number.

    Raises
    ------
    HarvesterError
    """
    wrong = HarvesterError("frequencies: must be one or more numbers > 0, in Hz")
    one = isinstance(frequencies, numbers.Real)
    given = [frequencies] if one else listed(frequencies, "frequencies", "[10.0, 12.5]")
    try:
        rising = np.unique(np.array(given, dtype=float))
    except (TypeError, ValueError):
        raise wrong from None
    if rising.size == 0 or not (np.isfinite(rising).all() and rising[0] > 0.0):
        raise wrong
    return rising


def with_sine(scene: Scene, amplitude: float | None) -> Scene:
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


def stepped(scene: Scene, frequencies: np.ndarray) -> Scene:
    """The scene with a sine that dwells at each frequency until the transient is gone."""
    parameters = prepared(scene).system
    decay = parameters.transducer.decay_rate()
    slowest = 2.0 * timescales.relaxation_time(parameters)
    slowest = max(slowest, 1.0 / decay) if decay > 0.0 else slowest
    if scene.load.circuit:
        from circuits.kernel.slow_modes import slowest_time

        slowest = max(slowest, slowest_time(prepared(scene)))
    motion = 2.0 * math.pi / timescales.fastest_angular_frequency(parameters) / KNOTS_PER_PERIOD
    spacing = min(Sine(1.0, frequencies.max()).spacing(motion), motion)
    dwell = slowest * math.log(1.0 / SETTLED_SHARE) + MEASURED_PERIODS / frequencies.min()
    if not dwell < MOST_KNOTS * spacing:
        raise HarvesterError(
            f"frequencies {frequencies.min():g} … {frequencies.max():g} Hz: {dwell:.3g} s at each, "
            f"in pieces of {spacing:.3g} s, are more than {MOST_KNOTS:g} of them; choose others, "
            "or a load that is sooner charged"
        )
    dwell = math.ceil(dwell / spacing) * spacing
    sine: Any = scene.excitation
    excitation = SteppedSine(sine.amplitude, tuple(map(float, frequencies)), dwell, spacing)
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
    first, second = _integrals(record.time, record.voltage**2, (start, middle, stop))
    power = _integrals(record.time, record.load_power, (start, middle, stop))
    return (
        0.5 * (highest - lowest),
        math.sqrt((first + second) / measured),
        float(sum(power)) / measured,
        abs(second / first - 1.0) if first > 0.0 else 0.0,
    )


def _peak(times, values):
    """The greatest value, between points by a parabola through three of them."""
    times, first = np.unique(times, return_index=True)
    values = values[first]
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
    # Where a switch turns there are two points at one time: none of length 0 is found.
    place = max(int(np.searchsorted(times, min(edge, times[-1]))) - 1, 0)
    since = edge - times[place]
    slope = (values[place + 1] - values[place]) / (times[place + 1] - times[place])
    return total[place] + since * (values[place] + 0.5 * since * slope)


def __getattr__(name: str) -> object:
    if name != "frequency_response":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return handed_on(__name__, "harvester.studies.public", name)
