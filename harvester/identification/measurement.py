"""Measured records: base acceleration with voltage, displacement or velocity, evenly sampled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from harvester.base.arguments import table
from harvester.base.errors import SceneError
from harvester.base.plain_text import name as plain_name
from harvester.base.plain_text import named, nearest, shown
from harvester.identification.measured_response import ASSUMED_NOISE, MeasuredResponse, response_of
from harvester.identification.sensors import OUTPUTS, checked_sensors
from harvester.records.columns import MeasuredFile
from harvester.records.formats import read_content
from harvester.records.quantities import IMPEDANCES, POINTS, QUANTITIES
from harvester.records.samples import check_size, check_variation, marker_remark, repaired
from harvester.records.time_base import TimeBase, time_base

# Quantities that a record's columns may contain.
COLUMNS = tuple(name for name in QUANTITIES if name not in (*IMPEDANCES, *POINTS))
# Suffix of a velocity's unit: measured in the inertial frame, not relative to the base.
ABSOLUTE = ":absolute"
# Setting of a key whose value is fitted to one record, for that record alone.
FREE = "free"
# Settings that convert a raw column to its quantity: scale · column + offset.
LINE_ENDS = ("scale", "offset")
LINES = tuple(f"{name}_{end}" for name in ("acceleration", *OUTPUTS) for end in LINE_ENDS)

# The fastest frequency of the motion has this share of the signal's power below it.
FASTEST_SHARE = 0.98


@dataclass(frozen=True)
class Measurement:
    """One record, in SI units or the units of a scaled scene.

    Attributes
    ----------
    acceleration : ndarray, shape (n,)
        Acceleration of the base (m/s²); in a scaled scene η, the force per mass.
    sampling_rate : float
        Hz.
    voltage, displacement, velocity : ndarray of shape (n,), or None
        Voltage at the terminals (V); displacement and velocity of the mass relative to the base (m,
        m/s). At least one is given.
    changes : dict of str to number or text
        Values of the scene that differ in this record: {"load.resistance": 1e5}.
    name : str
    remarks : tuple of str
        Remarks on marker values for missing measurements.
    sensors : dict of str to float
        Known effects of sensors: {"sensor.acceleration_highpass": 0.5}.
    velocity_is_absolute : bool
        Whether the velocity is measured in the inertial frame, e.g. by a laser next to the shaker.
    velocity_in_volts : bool
        Whether the velocity sensor has a scale in V/(m/s), free or in `sensors`.
    own : tuple of str
        Keys of the scene with unknown values for this record alone, such as the constant force if
        its base was tilted. Only a validation record has such values.
    """

    acceleration: np.ndarray
    sampling_rate: float
    voltage: np.ndarray | None = None
    displacement: np.ndarray | None = None
    velocity: np.ndarray | None = None
    changes: dict[str, Any] = field(default_factory=dict)
    name: str = "record"
    remarks: tuple[str, ...] = ()
    sensors: dict[str, float] = field(default_factory=dict)
    velocity_is_absolute: bool = False
    velocity_in_volts: bool = False
    own: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if isinstance(self.own, str):
            object.__setattr__(self, "own", (self.own,))
        for quantity in ("acceleration", *OUTPUTS):
            values = getattr(self, quantity)
            if values is not None:
                checked = np.array(values, dtype=float)
                object.__setattr__(self, quantity, checked)
                where = f"{self.name}: {quantity}"
                if checked.ndim != 1 or checked.shape != self.acceleration.shape:
                    raise SceneError(
                        f"{where} has the shape {checked.shape}: must be that of the acceleration, "
                        f"{self.acceleration.shape}"
                    )
                repaired(checked, None, where)
                check_size(checked, where)
                if quantity != "acceleration":
                    check_variation(checked, where)
        if not self.remarks:
            columns = {"acceleration": self.acceleration, **self.outputs}
            object.__setattr__(self, "remarks", _marker_remarks(columns))
        if not self.outputs:
            raise SceneError(
                f"{self.name}: the acceleration alone is not enough: name a column of "
                f"{', '.join(OUTPUTS)}"
            )
        checked_sensors(self.sensors, list(self.outputs), self.name)
        if not (np.isfinite(self.sampling_rate) and self.sampling_rate > 0.0):
            raise SceneError(
                f"{self.name}: sampling_rate = {shown(self.sampling_rate)}: must be a number > 0"
            )

    @property
    def outputs(self) -> dict[str, np.ndarray]:
        """The measured outputs of the device (voltage, displacement, velocity) by name."""
        return {name: getattr(self, name) for name in OUTPUTS if getattr(self, name) is not None}

    sensed = outputs

    @property
    def assumed_noise(self) -> np.ndarray:
        """Noise of each output assumed by the first fit."""
        return np.array([ASSUMED_NOISE * np.std(values) for values in self.outputs.values()])

    @cached_property
    def frequencies(self) -> tuple[float, float]:
        """Median frequency of the outputs, and their fastest frequency (`FASTEST_SHARE`), in Hz."""
        from scipy import signal

        rate, ends = self.sampling_rate, []
        for values in self.outputs.values():
            segment = min(values.size, max(256, values.size // 8))
            f, density = signal.welch(values, rate, nperseg=segment, detrend="linear")
            # The floor of white noise is subtracted, since it is not motion.
            density = np.maximum(density - 3.0 * np.median(density[3 * f.size // 4 :]), 0.0)
            total = np.cumsum(density)
            shares = total[-1] * np.array([0.5, FASTEST_SHARE])
            moves = total[-1] > 0.0
            ends.append(f[np.searchsorted(total, shares)] if moves else [0.1 * rate] * 2)
        slowest = 1.0 / self.duration
        median, fastest = np.min(ends, axis=0)[0], np.max(ends, axis=0)[1]
        return max(float(median), slowest), max(float(fastest), slowest)

    @property
    def duration(self) -> float:
        """Duration of the record (s)."""
        return self.acceleration.size / self.sampling_rate


def _marker_remarks(columns):
    """A remark on each column with markers such as -9999 or a saturation value."""
    remarks = {name: marker_remark(values) for name, values in columns.items()}
    return tuple(
        f"{name}: {remark}; they are used as measured values: cut the record there"
        for name, remark in remarks.items()
        if remark
    )


def read_measurement(
    file: str | Path, settings: Mapping[str, Any] | None = None, units: str = "SI"
) -> Measurement | MeasuredResponse:
    """Read a record from a file; a column of frequencies makes it a frequency response.

    Parameters
    ----------
    file : str or Path
        CSV or other text, `.npy`, `.wav`, `.mat`.
    settings : dict of str to value, optional
        `acceleration`, `voltage`, `displacement`, `velocity`, `time`, for a response `frequency`,
        `amplitude` and `phase`, `real` and `imaginary`, or `response` for a column of complex
        numbers: the column's name or number from 0, with its unit after a colon ("2:mV") if its
        heading has none. `acceleration_scale`, `acceleration_offset` and likewise for the others:
        the quantity is scale · column + offset in that unit. `sampling_rate` (Hz). Any other key is
        a key of the scene, with its value during the record. A column with a heading such as
        "voltage [mV]" needs no setting.
    units : str
        Units of the scene: "SI", or "scaled", whose columns have no units.

    Raises
    ------
    SceneError
        A column or a unit is missing, or the record is uneven, clipped, too short or has gaps.
    """
    path, settings = str(file), table(settings or {}, "settings", '{"voltage": "2:mV"}')
    where = named(path)
    stated = {name: str(settings.pop(name)) for name in COLUMNS if name in settings}
    names = [*LINES, "sampling_rate"]
    lines = {name: _number(where, name, settings.pop(name)) for name in names if name in settings}
    rate = lines.pop("sampling_rate", None)
    for key in settings:
        if "." not in key:
            near = nearest(key, [*COLUMNS, *names])
            raise SceneError(f"{where}: unknown setting {named(key)}{near}")
    sensors = checked_sensors(
        {key: settings.pop(key) for key in list(settings) if key.startswith("sensor.")},
        OUTPUTS,
        where,
    )
    free_keys = tuple(key for key, value in settings.items() if value == FREE)
    settings = {key: value for key, value in settings.items() if key not in free_keys}
    absolute = _taken_absolute(where, stated)
    measured = MeasuredFile(path, read_content(path)[0])
    chosen = measured.columns([name for name in COLUMNS if name != "time"], stated, _plainest)
    indices = [index for index, _ in chosen.values()]
    raw = {name.rpartition("_")[0] for name in lines}
    unit_of = {
        name: measured.unit(name, index, unit, units != "SI", name in raw)
        for name, (index, unit) in chosen.items()
    }
    is_response = "frequency" in chosen or "response" in chosen
    if is_response and free_keys:
        raise SceneError(
            f"{where}: {named(free_keys[0])} = free: only a time record can have a free "
            "value, but this is a frequency response: give the value"
        )
    if not is_response and "acceleration" not in chosen:
        raise SceneError(
            f"{where}: no column of the base's acceleration: write acceleration [m/s^2] in its "
            "header, or acceleration=COLUMN:UNIT after the file"
        )
    base = TimeBase(1.0)
    if not is_response:
        clock, unit = measured.stated(stated.get("time"))
        times, rate = measured.times(clock, unit, rate, indices, always=True)
        rate = rate if times is None else None
        base = time_base(times, rate, where, "correct it, or cut the record there")
    columns = dict(zip(chosen, measured.take(indices), strict=True))
    # Markers are detected in the file's numbers, before units and scales are applied.
    remarks = _marker_remarks({k: v for k, v in columns.items() if k in ("acceleration", *OUTPUTS)})
    for name, values in columns.items():
        factor = QUANTITIES[name][unit_of[name]] if unit_of[name] else 1.0
        line = lines.get(f"{name}_scale", 1.0) * values + lines.get(f"{name}_offset", 0.0)
        columns[name] = base.resampled(line * factor)
    name = plain_name(Path(path).name)
    if is_response:
        return response_of(columns, settings, name, sensors)
    return Measurement(
        sampling_rate=base.rate,
        changes=settings,
        name=name,
        remarks=remarks + base.remarks,
        sensors=sensors,
        velocity_is_absolute=absolute,
        velocity_in_volts=unit_of.get("velocity") in QUANTITIES["voltage"],
        own=free_keys,
        **columns,
    )


def _plainest(measured, quantity):
    """Indices of the columns whose headings name a quantity, the plainest title first."""
    indices = measured.of(quantity)
    titles = [measured.headings[index].title.lower() for index in indices]
    return indices[titles.index(quantity) :][:1] if quantity in titles else indices


def _taken_absolute(where, settings):
    """Remove `:absolute` from a velocity's setting; return whether it was there."""
    text = settings.get("velocity", "")
    before, _, word = text.rpartition(":")
    if before.rpartition(":")[2] not in QUANTITIES["velocity"] or ":" not in before:
        return False
    if f":{word}" != ABSOLUTE:
        raise SceneError(
            f"{where}: velocity = {shown(text)}: after the unit write absolute (relative to the "
            "ground) or nothing (relative to the base)"
        )
    settings["velocity"] = before
    return True


def _number(where, key, value):
    """A setting's number."""
    try:
        return float(value)
    except (TypeError, ValueError):
        raise SceneError(f"{where}: {key} = {shown(value)}: must be a number") from None
