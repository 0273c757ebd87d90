"""Time series of one realization: motion, terminal, the load's output and its nodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.arguments import Named
from harvester.base.formatting import prefixed, quantity
from harvester.base.tables import require_xarray
from harvester.device.record import Record
from harvester.results.palette import CIRCUIT
from harvester.results.panels import Panel, Series, draw_panels
from harvester.results.view import Picture, ResultBase, View
from harvester.statistics.estimate import RESOLVED_SHARE
from harvester.statistics.units import unit_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from harvester.scene.model import Scene
    from harvester.scene.units import Scales

# Size of a panel, in inches.
SIZE = 5.8, 1.3
# Columns that differ by at most this share of their size are drawn once.
SAME = 1e-9
# A column that varies by a smaller share of its mean is drawn as the deviation from the mean.
DEVIATION = 1e-3
# Below this share of the maximum voltage, power over voltage is dominated by round-off, and the
# current is interpolated.
SMALL_VOLTAGE = 1e-9


@dataclass(frozen=True, repr=False)
class Waveform(ResultBase):
    """Time series of a realization in a time interval, in the scene's units.

    `waveform["voltage"]` and `waveform.voltage` are one of `columns`.

    Attributes
    ----------
    scene : Scene
    engine : str
    time : ndarray, shape (n,)
        Time since the beginning of the run, including settling (s).
    columns : dict of str to ndarray
        `displacement`, `velocity`, the terminal's `voltage` and `current` (into the load),
        `output_voltage` if the load has an output, and the requested nodes and currents.
    units : dict of str to str
        Unit of each column.
    record : Record
        The points in scaled units, as engines return them.
    """

    scene: Scene
    engine: str
    time: np.ndarray
    columns: dict[str, np.ndarray]
    units: dict[str, str]
    record: Record = field(compare=False)

    def _numbers(self) -> Named:
        return Named(f"{self.scene.name}: the waveform has no column", self.columns)

    def __getattr__(self, name: str) -> np.ndarray:
        columns = vars(self).get("columns", {})
        return columns[name] if name in columns else super().__getattr__(name)  # type: ignore[misc]

    def view(self) -> View:
        """Extremes and rms of each column, and one panel over time per column."""
        rows = [
            [name.replace("_", " "), *(quantity(float(end), self.units[name]) for end in ends)]
            for name, values in self.columns.items()
            if values.size
            for ends in [(values.min(), values.max(), np.sqrt(np.mean(values**2)))]
        ]
        return View(
            table=(["column", "smallest", "largest", "rms"], rows),
            findings=[f"{self.engine}: {self.summary()}"],
            pictures=[Picture(draw, self)],
            records=self._records,
            is_series=True,
            dataset=self._dataset,
        )

    def _records(self):
        """Header with units, and one row per point."""
        header = ["time [s]", *(f"{name} [{self.units[name]}]" for name in self.columns)]
        return header, np.column_stack([self.time, *self.columns.values()]).tolist()

    def _dataset(self):
        """The columns as a Dataset over `time`, with the attribute `unit`."""
        variables = {
            name: ("time", values, {"unit": self.units[name]})
            for name, values in self.columns.items()
        }
        attributes = {"scene": self.scene.name, "engine": self.engine}
        coordinates = {"time": ("time", self.time, {"unit": "s"})}
        return require_xarray().Dataset(variables, coordinates, attributes)

    def summary(self) -> str:
        """Time range, number of points and columns, as text."""
        if not self.time.size:
            return "no points"
        ends = f"{self.time[0]:.4g} to {self.time[-1]:.4g} s, {self.time.size} points"
        return f"{ends} of {', '.join(self.columns)}"


def waveform_of(
    scene: Scene,
    engine: str,
    scales: Scales,
    record: Record,
    electrical: Mapping[str, np.ndarray],
) -> Waveform:
    """The waveform of a realization, from its scaled record and its `Realization.electrical`."""
    # A repeated point has an adjusted power that corrects the mean over the step. It is dropped.
    once = np.diff(record.time, prepend=-np.inf) > 0.0
    record = Record(*(column[once] for column in record))
    motion = ("displacement", "velocity", "voltage")
    columns = {name: getattr(record, name) * scales.of(name) for name in motion}
    units = {name: unit_of(scene, name) for name in motion}
    columns["current"] = _current(record) * (scales.power / scales.voltage)
    units["current"] = "A" if scene.units == "SI" else "scaled power/voltage"
    for name, values in electrical.items():
        if name == "output_voltage":
            columns[name], units[name] = values[once] * scales.voltage, units["voltage"]
        else:
            columns[name], units[name] = values[once], "A" if name.startswith("i(") else "V"
    return Waveform(scene, engine, record.time, columns, units, record)


def _current(record: Record) -> np.ndarray:
    """Power into the load divided by voltage, interpolated linearly around zeros of the voltage."""
    sizes: Any = np.abs(record.voltage)
    nonzero = sizes > SMALL_VOLTAGE * sizes.max(initial=0.0)
    if not nonzero.any():
        return np.zeros_like(record.voltage)
    currents = record.load_power[nonzero] / record.voltage[nonzero]
    return np.interp(record.time, record.time[nonzero], currents)


def draw(waveform: Waveform) -> Figure:
    """Draw every column over time except the velocity, which follows from the displacement.

    A column that varies by less than the solver's tolerance is drawn as a constant.
    """
    panels = []
    sizes: dict[str, float] = {}
    for name, values in waveform.columns.items():
        unit, size = waveform.units[name], float(np.abs(values).max(initial=0.0))
        sizes[unit] = max(sizes.get(unit, 0.0), size)
    for words, name in _drawn_once(waveform).items():
        values, unit = waveform.columns[name], waveform.units[name]
        middle = float(values.mean()) if values.size else 0.0
        spread = float(np.ptp(values)) if values.size else 0.0
        resolved = RESOLVED_SHARE * sizes[unit]
        if 0.0 < spread <= resolved:
            constant = middle if abs(middle) > resolved else 0.0
            words = f"{words}\n(constant to\n{quantity(resolved, unit, 2)})"
            values = np.full_like(values, constant)
        elif 0.0 < spread < DEVIATION * abs(middle):
            sign = "−" if middle > 0.0 else "+"
            words, values = f"{words}\n{sign} {quantity(abs(middle), unit, 7)}", values - middle
        factor, unit = prefixed(float(abs(values).max(initial=0.0)), unit)
        label = f"{words}\n[{'scaled' if unit.startswith('scaled') else unit}]"
        panels.append(
            Panel("", label, [Series(waveform.time, factor * values, colour=CIRCUIT, width=0.8)])
        )
    panels[-1] = replace(panels[-1], x_label="time [s]")
    title = f"{waveform.scene.name}: one realization by {waveform.engine}"
    figure = draw_panels(panels, title, SIZE, columns=1, sharex=True)
    figure.align_ylabels()
    return figure


def _drawn_once(waveform):
    """Name and column of each panel; equal columns share one panel."""
    drawn: dict[str, str] = {}
    for name, values in waveform.columns.items():
        if name == "velocity":
            continue
        words = name.replace("_", " ") if "(" not in name else name
        size = np.abs(values).max(initial=0.0)
        for other, column in drawn.items():
            same_unit = waveform.units[column] == waveform.units[name]
            if same_unit and np.allclose(waveform.columns[column], values, 0.0, SAME * size):
                drawn = {f"{k}, {words}" if k == other else k: v for k, v in drawn.items()}
                break
        else:
            drawn[words] = name
    return drawn
