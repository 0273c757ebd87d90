"""Measured records: base acceleration beside voltage, displacement or velocity, evenly sampled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from harvester.base.errors import SceneError
from harvester.base.plain_text import name as plain_name
from harvester.base.plain_text import named, nearest, shown
from harvester.excitation.conditioning import (
    FEWEST_SAMPLES,
    LARGEST_PEAK,
    clipped_samples,
    marker_remark,
)
from harvester.identification.measured_response import MeasuredResponse, response_of
from harvester.identification.sensors import OUTPUTS, checked_sensors
from harvester.records.columns import MeasuredFile
from harvester.records.formats import read_content
from harvester.records.quantities import IMPEDANCES, POINTS, QUANTITIES, factor_of, unit_named
from harvester.records.time_base import TimeBase, time_base

# Quantities that a record's columns can hold.
COLUMNS = tuple(name for name in QUANTITIES if name not in (*IMPEDANCES, *POINTS))
# Suffix of a velocity's unit: measured against the laboratory, not relative to the base.
ABSOLUTE = ":absolute"
# Setting of a key whose value is found in one record, for that record alone.
FREE = "free"
# Settings that turn a raw column into its quantity: scale · column + offset.
LINE_ENDS = ("scale", "offset")
LINES = tuple(f"{name}_{end}" for name in ("acceleration", *OUTPUTS) for end in LINE_ENDS)


@dataclass(frozen=True)
class Measurement:
    """One record, in SI units, or in those of a scaled scene.

    Attributes
    ----------
    acceleration : ndarray, shape (n,)
        Acceleration of the base (m/s²); in a scaled scene η itself, the force per mass on the
        mass.
    sampling_rate : float
        Hz.
    voltage, displacement, velocity : ndarray of shape (n,), or None
        Voltage at the terminals (V); displacement and velocity of the mass relative to the base (m,
        m/s). At least one is given.
    changes : dict of str to number or text
        Values of the scene that differ in this record: {"load.resistance": 1e5}.
    name : str
    remarks : tuple of str
        Remarks on markers that stand for samples that could not be measured.
    sensors : dict of str to float
        Known effects of sensors: {"sensor.acceleration_highpass": 0.5}.
    velocity_is_absolute : bool
        Whether the velocity is measured against the laboratory, as by a laser beside the shaker.
    velocity_in_volts : bool
        Whether the velocity's sensor has a scale in V/(m/s), free or among `sensors`.
    own : tuple of str
        Keys of the scene whose values are unknown and of this record alone, such as the constant
        force of a base that was tilted for it. Only a record kept aside has such values.
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
                _check_column(checked, quantity, self.acceleration.shape, self.name)
        if not self.remarks:
            columns = {"acceleration": self.acceleration, **self.outputs}
            object.__setattr__(self, "remarks", _marker_remarks(columns))
        if not self.outputs:
            raise SceneError(
                f"{self.name}: nothing was measured beside the acceleration: name a column of "
                f"{', '.join(OUTPUTS)}"
            )
        checked_sensors(self.sensors, list(self.outputs), self.name)
        if not (np.isfinite(self.sampling_rate) and self.sampling_rate > 0.0):
            raise SceneError(
                f"{self.name}: sampling_rate = {shown(self.sampling_rate)}: must be a number > 0"
            )

    @property
    def outputs(self) -> dict[str, np.ndarray]:
        """The measured outputs of the device (voltage, displacement, velocity) by their names."""
        return {name: getattr(self, name) for name in OUTPUTS if getattr(self, name) is not None}

    sensed = outputs

    @property
    def duration(self) -> float:
        """Duration of the record (s)."""
        return self.acceleration.size / self.sampling_rate


def _marker_remarks(columns):
    """A remark on each column, of 1 dimension, that holds markers such as -9999 or a rail."""
    remarks = {name: marker_remark(values) for name, values in columns.items() if values.ndim == 1}
    return tuple(
        f"{name}: {remark}, and taken as measured: cut the record there"
        for name, remark in remarks.items()
        if remark
    )


def _check_column(values, quantity, shape, where):
    """Refuse a column that is too short, constant, clipped or has samples without a number."""
    if values.ndim != 1 or values.shape != shape:
        raise SceneError(f"{where}: {quantity} has the shape {values.shape}, not {shape}")
    if values.size < FEWEST_SAMPLES:
        raise SceneError(
            f"{where}: the record is too short: {values.size} samples, and {FEWEST_SAMPLES} are "
            "the fewest"
        )
    lost = np.flatnonzero(~np.isfinite(values))
    if lost.size:
        raise SceneError(
            f"{where}: {quantity}: {lost.size} of {values.size} samples are without a number (the "
            f"first is sample {lost[0]}): cut the record there"
        )
    if np.abs(values).max() > LARGEST_PEAK:
        raise SceneError(
            f"{where}: {quantity}: the largest sample is {np.abs(values).max():g}, and must be at "
            f"most {LARGEST_PEAK:g}: check the column and its unit"
        )
    if np.ptp(values) == 0.0:
        if quantity == "acceleration":
            return
        raise SceneError(f"{where}: {quantity} is constant: every sample is {values[0]:g}")
    flat = clipped_samples(values)
    if flat.any():
        raise SceneError(
            f"{where}: {quantity} is clipped: {np.count_nonzero(flat)} of {values.size} samples "
            f"stay at its largest value, {np.abs(values[flat]).max():g}: measure in a wider range"
        )


def read_measurement(
    file: str | Path, settings: Mapping[str, Any] | None = None, units: str = "SI"
) -> Measurement | MeasuredResponse:
    """A record from its file; a column of frequencies makes it a frequency response.

    Parameters
    ----------
    file : str or Path
        CSV or other text, `.npy`, `.wav`, `.mat`.
    settings : dict of str to value, optional
        `acceleration`, `voltage`, `displacement`, `velocity`, `time`, of a response `frequency`,
        `amplitude` and `phase`, `real` and `imaginary`, or `response` for a column of complex
        numbers: the column's name or number from 0, with its unit behind a colon ("2:mV") where its
        heading does not say it; `acceleration_scale`, `acceleration_offset` and those of the
        others: the quantity is scale · column + offset in that unit; `sampling_rate` (Hz); any
        other key is one of the scene, which had this value while the record was taken. A column
        whose heading says "voltage [mV]" or the like needs no
        setting.
    units : str
        Units of the scene: "SI", or "scaled", where no column has a unit.

    Raises
    ------
    SceneError
        A column or a unit is missing, or the record is uneven, clipped, too short or has gaps.
    """
    path, settings = str(file), dict(settings or {})
    where = named(path)
    columns_of = {name: str(settings.pop(name)) for name in COLUMNS if name in settings}
    lines = {name: _number(where, name, settings.pop(name)) for name in LINES if name in settings}
    rate = _number(where, "sampling_rate", settings.pop("sampling_rate", None))
    for key in settings:
        if "." not in key:
            names = [*COLUMNS, *LINES, "sampling_rate"]
            raise SceneError(f"{where}: unknown setting {named(key)}{nearest(key, names)}")
    sensors = checked_sensors(
        {key: settings.pop(key) for key in list(settings) if key.startswith("sensor.")},
        OUTPUTS,
        where,
    )
    free_keys = tuple(key for key, value in settings.items() if value == FREE)
    settings = {key: value for key, value in settings.items() if key not in free_keys}
    absolute = _taken_absolute(where, columns_of)
    content, _ = read_content(path)
    measured = MeasuredFile(path, content)
    rate = measured.table.rate if rate is None else rate
    columns, remarks, unit_of = _columns(measured, columns_of, lines, units, rate)
    if "frequency" in columns or "response" in columns:
        if free_keys:
            raise SceneError(
                f"{where}: {named(free_keys[0])} = free: only a record of a motion can free a "
                "value for itself, and this is a frequency response: give the value"
            )
        return response_of(columns, settings, plain_name(Path(path).name), sensors)
    if "acceleration" not in columns:
        raise SceneError(
            f"{where}: no column of the base's acceleration: write acceleration [m/s^2] in its "
            "header, or acceleration=COLUMN:UNIT behind the file"
        )
    base = _base(columns.pop("time", None), rate, where)
    columns = {name: base.resampled(values) for name, values in columns.items()}
    return Measurement(
        sampling_rate=1.0 / base.spacing,
        changes=settings,
        name=plain_name(Path(path).name),
        remarks=remarks + base.remarks,
        sensors=sensors,
        velocity_is_absolute=absolute,
        velocity_in_volts=unit_of.get("velocity") in QUANTITIES["voltage"],
        own=free_keys,
        **columns,
    )


def _taken_absolute(where, given):
    """Whether a velocity's setting ends in `:absolute` (not relative to the base); the word
    is removed."""
    text = given.get("velocity", "")
    before, _, word = text.rpartition(":")
    if before.rpartition(":")[2] not in QUANTITIES["velocity"] or ":" not in before:
        return False
    if f":{word}" != ABSOLUTE:
        raise SceneError(
            f"{where}: velocity = {shown(text)}: behind the unit stands absolute (of the room), or "
            "nothing (relative to the base)"
        )
    given["velocity"] = before
    return True


def _number(where, key, value):
    """A setting's number."""
    try:
        return None if value is None else float(value)
    except ValueError:
        raise SceneError(f"{where}: {key} = {shown(value)}: must be a number") from None


def _columns(measured, given, lines, units, rate):
    """Columns of each quantity in SI, or in the scene's scaled units, remarks, and the units."""
    chosen, unit_of = _chosen(measured, given), {}
    places = {quantity: index for quantity, (index, _) in chosen.items()}
    for quantity, (index, unit) in chosen.items():
        scaled_by = any(f"{quantity}_{end}" in lines for end in LINE_ENDS)
        unit_of[quantity] = _unit(measured, quantity, index, unit, units, scaled_by)
    values = dict(zip(places, measured.take(list(places.values())), strict=True))
    # The checks below compare numbers as they stand in the file, before units and scales.
    remarks = _marker_remarks({k: v for k, v in values.items() if k in ("acceleration", *OUTPUTS)})
    for quantity, unit in unit_of.items():
        if quantity == "time":
            cure = "write sampling_rate=HZ behind the file"
            index = places[quantity]
            values[quantity] = measured.seconds(values[quantity], index, unit or "s", rate, cure)
            if rate is not None:
                measured.compare_rates(values[quantity], rate, index)
            continue
        factor = QUANTITIES[quantity][unit] if unit else 1.0
        scale, offset = (lines.get(f"{quantity}_{end}") for end in LINE_ENDS)
        line = (1.0 if scale is None else scale) * values[quantity] + (offset or 0.0)
        values[quantity] = line * factor
    return values, remarks, unit_of


def _chosen(measured, given):
    """(index, given unit) of each quantity's column: the plainest title goes first."""
    chosen = {}
    for quantity in COLUMNS:
        candidates = measured.times() if quantity == "time" else measured.of(quantity)
        plain = [n for n in candidates if measured.headings[n].title.lower() == quantity]
        candidates = (plain or candidates)[:1] if plain or quantity == "time" else candidates
        chosen[quantity] = measured.chosen(quantity, given.get(quantity), candidates)
    return {quantity: pair for quantity, pair in chosen.items() if pair[0] is not None}


def _unit(measured, quantity, place, given, units, is_scaled):
    """A column's unit in its usual spelling; empty for what a scaled scene takes as it is."""
    where, written = measured.where, measured.headings[place].unit
    if units != "SI" and (given or written) in (None, "", "scaled", "1"):
        return ""
    if is_scaled and given:
        # The heading's unit is that of the raw column, so only the given one counts.
        usual = next(iter(QUANTITIES[quantity]))
        factor_of(quantity, given, f"{where}: {quantity}", f"write {usual} or the like")
        return unit_named(quantity, given)
    unit = measured.agreed_unit(quantity, place, f"{quantity}=COLUMN:UNIT", given)
    if units != "SI" and quantity not in ("time", "frequency", "phase"):
        raise SceneError(
            f"{where}: {quantity} is in {named(given or written)}, and the scene has units = "
            '"scaled": take one with units = "SI", or a record in scaled units'
        )
    if not unit and quantity != "time":
        factors = QUANTITIES[quantity]
        raise SceneError(
            f"{where}: {quantity} has no unit: write {quantity} [{next(iter(factors))}] in its "
            f"header, or {quantity}=COLUMN:UNIT behind the file; units are {', '.join(factors)}"
        )
    return unit


def _base(times, rate, where):
    """The time base by the time column, else by the rate as given or as the file says."""
    if times is None and rate is None:
        raise SceneError(
            f"{where}: neither a time column nor a sampling rate: name the column time [s], "
            "or write sampling_rate=HZ behind the file"
        )
    if times is None:
        return TimeBase(1.0 / rate)
    base = time_base(times, None, where, "correct it, or cut the record there")
    if base is None:
        raise SceneError(
            f"{where}: unevenly sampled: samples are missing between the times, or were not taken "
            "at one rate: resample the record, or cut it at its gaps"
        )
    return base
