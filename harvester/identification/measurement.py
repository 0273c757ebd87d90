"""Measured records: base acceleration beside voltage, displacement or velocity, evenly sampled."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from harvester.errors import SceneError
from harvester.excitation.conditioning import (
    FEWEST_SAMPLES,
    LARGEST_JITTER,
    SHORTEST_STEP,
    UNITS,
    flat_crests,
)
from harvester.excitation.motion_file import read_named_columns, read_record
from harvester.files.plain_text import name as plain_name
from harvester.files.plain_text import named, nearest, shown
from harvester.identification.measured_response import MeasuredResponse, response_of

OUTPUTS = ("voltage", "displacement", "velocity")
# Factors to the scene's units; those of a scaled scene have none.
QUANTITIES: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
    "acceleration": {unit: factor for unit, factor in UNITS.items() if unit != "scaled"},
    "voltage": {"V": 1.0, "mV": 1e-3, "uV": 1e-6, "kV": 1e3},
    "displacement": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "velocity": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    "frequency": {"Hz": 1.0, "kHz": 1e3, "rad/s": 0.5 / math.pi},
    "phase": {"rad": 1.0, "deg": math.pi / 180.0},
}
RESPONSE = {
    f"{volts}/{bracketed}": volt / factor
    for volts, volt in QUANTITIES["voltage"].items()
    for unit, factor in QUANTITIES["acceleration"].items()
    for bracketed in (f"({unit})" if "/" in unit else unit,)
}
QUANTITIES |= dict.fromkeys(("amplitude", "real", "imaginary"), RESPONSE)
SYNONYMS = {
    "t": "time",
    "f": "frequency",
    "base acceleration": "acceleration",
    "voltage amplitude": "amplitude",
    "voltage phase": "phase",
    "real part": "real",
    "imaginary part": "imaginary",
}
# A name of a header with its unit behind it, in brackets, which a unit may contain.
HEADER = re.compile(r"\s*([^\[(]*?)\s*(?:\[\s*([^\]]*?)\s*\]|\(\s*(.*?)\s*\))\s*")


@dataclass(frozen=True)
class Measurement:
    """One record, in SI units, or in those of a scaled scene.

    Attributes
    ----------
    acceleration : ndarray, shape (n,)
        Of the base (m/s²); in a scaled scene η itself, the force per mass on the mass.
    sampling_rate : float
        Hz.
    voltage, displacement, velocity : ndarray of shape (n,), or None
        At the terminals (V); of the mass relative to the base (m, m/s). At least one.
    changes : dict of str to number or text
        What is other than in the scene for this record: {"load.resistance": 1e5}.
    name : str
    """

    acceleration: np.ndarray
    sampling_rate: float
    voltage: np.ndarray | None = None
    displacement: np.ndarray | None = None
    velocity: np.ndarray | None = None
    changes: dict[str, Any] = field(default_factory=dict)
    name: str = "record"

    def __post_init__(self) -> None:
        for quantity in ("acceleration", *OUTPUTS):
            values = getattr(self, quantity)
            if values is not None:
                checked = np.array(values, dtype=float)
                object.__setattr__(self, quantity, checked)
                _check_column(checked, quantity, self.acceleration.shape, self.name)
        if not self.outputs:
            raise SceneError(
                f"{self.name}: nothing was measured beside the acceleration: name a column of "
                f"{', '.join(OUTPUTS)}"
            )
        if not (np.isfinite(self.sampling_rate) and self.sampling_rate > 0.0):
            raise SceneError(
                f"{self.name}: sampling_rate = {shown(self.sampling_rate)}: must be a number > 0"
            )

    @property
    def outputs(self) -> dict[str, np.ndarray]:
        """What was measured of the device, by its name."""
        return {name: getattr(self, name) for name in OUTPUTS if getattr(self, name) is not None}

    sensed = outputs

    @property
    def duration(self) -> float:
        """s."""
        return self.acceleration.size / self.sampling_rate


def _check_column(values, quantity, shape, where):
    """Refuse what is no whole measurement of one quantity."""
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
    if np.ptp(values) == 0.0:
        if quantity == "acceleration":
            return
        raise SceneError(f"{where}: {quantity} is constant: every sample is {values[0]:g}")
    flat = flat_crests(values)
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
        `amplitude` and `phase`, or `real` and `imaginary`: the column's name or number from 0, with
        its unit behind a colon ("2:mV"); `sampling_rate` (Hz); any other key is one of
        the scene, which had this value while the record was taken. A column whose header says
        "voltage [mV]" or the like needs no setting.
    units : str
        Of the scene: "SI", or "scaled", where no column has a unit.

    Raises
    ------
    SceneError
        A column or a unit is missing, or the record is uneven, clipped, too short or has gaps.
    """
    path, settings = str(file), dict(settings or {})
    where = named(path)
    given = {name: settings.pop(name) for name in QUANTITIES if name in settings}
    rate = settings.pop("sampling_rate", None)
    for key in settings:
        if "." not in key:
            known = [*QUANTITIES, "sampling_rate"]
            raise SceneError(f"{where}: unknown setting {named(key)}{nearest(key, known)}")
    factors: dict[str, float] = {}

    def wanted(names: list[str], width: int) -> dict[str, int]:
        found = _columns(given, names, width, units, where)
        factors.update({name: factor for name, (_, factor) in found.items()})
        return {name: place for name, (place, _) in found.items()}

    content, _ = read_record(path)
    columns, own_rate = read_named_columns(path, content, wanted)
    columns = {name: values * factors[name] for name, values in columns.items()}
    if "frequency" in columns:
        return response_of(columns, settings, plain_name(Path(path).name))
    if "acceleration" not in columns:
        raise SceneError(
            f"{where}: no column of the base's acceleration: write acceleration [m/s^2] in its "
            "header, or acceleration=COLUMN:UNIT behind the file"
        )
    rate = _rate(columns.pop("time", None), rate, own_rate, where)
    return Measurement(
        sampling_rate=rate,
        changes=settings,
        name=plain_name(Path(path).name),
        **columns,
    )


def _columns(given, names, width, units, where):
    """(place, factor) of each quantity: as given, else by the header."""
    found = {}
    for place, header in enumerate(names):
        title, unit = _title_and_unit(header)
        title = title.lower().replace("_", " ")
        quantity = SYNONYMS.get(title, title)
        if quantity in QUANTITIES and quantity not in found and quantity not in given:
            found[quantity] = place, _factor(quantity, unit, units, where)
    for quantity, text in given.items():
        column, unit = _column_and_unit(quantity, str(text), names)
        found[quantity] = (
            _place(quantity, column, names, width, where),
            _factor(quantity, unit, units, where),
        )
    return found


def _title_and_unit(header):
    match = HEADER.fullmatch(header)
    return (match[1], match[2] or match[3]) if match else (header.strip(), None)


def _column_and_unit(quantity, text, names):
    """A setting's column and unit: what follows the last colon, unless that is in the name."""
    if text in names:
        return text, _title_and_unit(text)[1]
    column, colon, unit = text.rpartition(":")
    return (column, unit) if colon else (text, None)


def _place(quantity, column, names, width, where):
    if column in names:
        return names.index(column)
    if column.isdigit() and int(column) < width:
        return int(column)
    listed = ", ".join(map(named, names)) or f"0 … {width - 1}"
    raise SceneError(
        f"{where}: {quantity} = {shown(column)}: no such column{nearest(column, names)}; the file "
        f"has {listed}"
    )


def _factor(quantity, unit, units, where):
    """To the scene's units."""
    known = QUANTITIES[quantity]
    if units != "SI" and unit in (None, "", "scaled", "1"):
        return 1.0
    if not unit:
        if quantity == "time":
            return 1.0
        raise SceneError(
            f"{where}: {quantity} has no unit: write {quantity} [{next(iter(known))}] in its "
            f"header, or {quantity}=COLUMN:UNIT behind the file; units are {', '.join(known)}"
        )
    plain = unit.replace("²", "^2").replace("µ", "u").replace("μ", "u").replace("s2", "s^2")
    if units != "SI" and quantity not in ("time", "frequency", "phase"):
        raise SceneError(
            f'{where}: {quantity} is in {named(unit)}, and the scene has units = "scaled": take '
            'one with units = "SI", or a record in scaled units'
        )
    if plain not in known:
        raise SceneError(
            f"{where}: {quantity}: unknown unit {named(unit)}{nearest(plain, known)}; units are "
            f"{', '.join(known)}"
        )
    return known[plain]


def _rate(times, given, own, where):
    """Sampling rate (Hz) from the time column, the file, or as given."""
    try:
        rate = own if given is None else float(given)
    except ValueError:
        raise SceneError(f"{where}: sampling_rate = {shown(given)}: must be a number > 0") from None
    if times is None:
        if rate is None:
            raise SceneError(
                f"{where}: neither a time column nor a sampling rate: name the column time [s], "
                "or write sampling_rate=HZ behind the file"
            )
        return rate
    steps = np.diff(times)
    if not (np.isfinite(times).all() and steps.size and steps.min() > SHORTEST_STEP):
        raise SceneError(f"{where}: the time column does not rise from sample to sample")
    spacing = (times[-1] - times[0]) / steps.size
    jitter = float(np.abs(times - times[0] - np.arange(times.size) * spacing).max()) / spacing
    if jitter > LARGEST_JITTER:
        raise SceneError(
            f"{where}: unevenly sampled: the time column leaves an even grid by {jitter:.2g} "
            f"spacings of {spacing:.6g} s: resample the record, or cut it at its gaps"
        )
    return float(1.0 / spacing)
