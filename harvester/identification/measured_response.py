"""Measured frequency responses: voltage over base acceleration at discrete frequencies."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import NoneType
from typing import Any, ClassVar, Self

import numpy as np

from harvester.base.arguments import table
from harvester.base.errors import IdentificationError, SceneError
from harvester.base.plain_text import name as plain_name
from harvester.base.plain_text import named, nearest
from harvester.records.columns import MeasuredFile
from harvester.records.formats import read_content
from harvester.records.quantities import QUANTITIES

# Minimum number of frequencies in a response; every third frequency is a validation line.
FEWEST_FREQUENCIES, KEPT_ASIDE = 12, 3
# Noise assumed by the first fit, relative to an output's rms; relative noise of an impedance.
ASSUMED_NOISE, ASSUMED_IMPEDANCE_NOISE = 0.05, 0.005
# A response is conjugated if more than this share of its phase change is towards larger phases,
# with lines weighted by their squares. A device's phase decreases, and noise changes it either way.
RISING = 0.5


@dataclass(frozen=True)
class MeasuredResponse:
    """Voltage over base acceleration at some frequencies, in SI or scaled units.

    Attributes
    ----------
    frequency : ndarray, shape (n,)
        Hz; a descending sweep is reversed.
    response : ndarray, shape (n,)
        V/(m/s²): complex, or only the amplitude.
    acceleration : ndarray of shape (n,), or None
        Amplitude of the base's sine (m/s²), on which the response may depend.
    changes : dict of str to number or text
        Values of the scene that differ in this record: {"load.resistance": 1e5}.
    name : str
    sensors : dict of str to float
        Known effects of sensors: {"sensor.acceleration_highpass": 0.5}.
    """

    frequency: np.ndarray
    response: np.ndarray
    acceleration: np.ndarray | None = None
    changes: dict[str, Any] = field(default_factory=dict)
    name: str = "response"
    sensors: dict[str, float] = field(default_factory=dict)

    # Attributes of time records.
    remarks: ClassVar[tuple[str, ...]] = ()
    own: ClassVar[tuple[str, ...]] = ()
    velocity_in_volts: ClassVar[bool] = False

    def __post_init__(self) -> None:
        arrays = {quantity: np.atleast_1d(values) * 1.0 for quantity, values in self._arrays()}
        shape = arrays["frequency"].shape
        if len(shape) != 1 or not shape[0]:
            raise SceneError(
                f"{self.name}: frequency has the shape {shape}: must be a list of numbers"
            )
        for quantity, values in arrays.items():
            if values.shape != shape:
                raise SceneError(
                    f"{self.name}: {quantity} has the shape {values.shape}: must be one number per "
                    f"line, as frequency has {shape}"
                )
            if not np.isfinite(values).all():
                raise SceneError(f"{self.name}: {quantity}: remove the lines without a number")
        descends = arrays["frequency"][0] > arrays["frequency"][-1]
        for quantity, values in arrays.items():
            object.__setattr__(self, quantity, values[::-1] if descends else values)
        for quantity in ("frequency", "acceleration"):
            least = np.inf if getattr(self, quantity) is None else getattr(self, quantity).min()
            if least <= 0.0:
                raise SceneError(
                    f"{self.name}: {quantity}: {least:.6g}: must be > 0: remove such lines, or "
                    "check the column"
                )
        if np.diff(self.frequency).min(initial=np.inf) <= 0.0:
            raise SceneError(
                f"{self.name}: frequency must be monotonic: check the column; if the file contains "
                "several sweeps, keep one"
            )

    @property
    def outputs(self) -> dict[str, np.ndarray]:
        """Outputs compared with the model: real and imaginary part, or the amplitude."""
        if np.iscomplexobj(self.response):
            return {"real part": self.response.real, "imaginary part": self.response.imag}
        return {"amplitude": self.response}

    @property
    def sensed(self) -> dict[str, np.ndarray]:
        """Amplitudes of the sensors' outputs by name."""
        return {"voltage": np.abs(self.response)}

    @property
    def assumed_noise(self) -> np.ndarray:
        """Noise of each output assumed by the first fit."""
        level = ASSUMED_NOISE * float(np.sqrt(np.mean(np.abs(self.response) ** 2)))
        return np.full(len(self.outputs), level)

    @property
    def resonance(self) -> float:
        """Frequency of the largest amplitude (Hz)."""
        return float(self.frequency[np.argmax(np.abs(self.response))])

    @property
    def frequencies(self) -> tuple[float, float]:
        """Frequencies of the resonance and of the last line (Hz)."""
        return self.resonance, float(self.frequency[-1])

    @property
    def aside(self) -> np.ndarray:
        """Mask of the validation lines."""
        return np.arange(self.frequency.size) % KEPT_ASIDE == 1

    def _arrays(self):
        """Names and values of all fields with one number per frequency."""
        values = ((entry.name, getattr(self, entry.name)) for entry in fields(self))
        return [pair for pair in values if not isinstance(pair[1], (str, dict, NoneType))]

    def part(self, lines: np.ndarray) -> Self:
        """A selection of the frequencies."""
        return replace(self, **{quantity: values[lines] for quantity, values in self._arrays()})

    def check_size(self) -> None:
        """Raise IdentificationError if there are too few frequencies."""
        if self.frequency.size < FEWEST_FREQUENCIES:
            raise IdentificationError(
                f"{self.name}: too short: {self.frequency.size} frequencies: must be "
                f"at least {FEWEST_FREQUENCIES}"
            )

    def check(self) -> None:
        """Raise if the response is too short, covers one side of the resonance, or is conjugated.

        Raises
        ------
        IdentificationError
            Too few frequencies, none on one side of the resonance, or a rising phase.
        """
        self.check_size()
        if self.resonance in self.frequency[[0, -1]]:
            raise IdentificationError(
                f"{self.name}: no excitation in the relevant band: the response is largest at "
                f"{self.resonance:.4g} Hz, where the record ends: measure on both sides of the "
                "resonance"
            )
        turn = np.imag(np.conj(self.response[:-1]) * self.response[1:])
        if turn.sum() > RISING * np.abs(turn).sum():
            raise IdentificationError(
                f"{self.name}: the phase rises through the resonance at {self.resonance:.4g} Hz, "
                "but a device's falls: the response is conjugated; reverse the sign of its phase, "
                "or of its imaginary part"
            )


def response_of(
    columns: dict[str, np.ndarray], changes: dict[str, Any], name: str, sensors: dict[str, float]
) -> MeasuredResponse:
    """A response from columns by quantity, in the scene's units.

    Raises
    ------
    SceneError
        There is neither an amplitude nor a pair of real and imaginary parts.
    """
    if "frequency" not in columns:
        raise SceneError(
            f"{name}: a column of complex numbers is a frequency response, but no column of "
            "frequencies is named: write frequency [Hz] in its header, or frequency=COLUMN:UNIT "
            "after the file"
        )
    if "response" in columns:
        response = columns["response"]
        if not np.iscomplexobj(response):
            raise SceneError(
                f"{name}: the column of the response has no complex numbers: name it by "
                "amplitude=COLUMN:UNIT, and its phase by phase=COLUMN:UNIT"
            )
    elif {"real", "imaginary"} <= set(columns):
        response = columns["real"] + 1j * columns["imaginary"]
    elif "amplitude" in columns:
        response = columns["amplitude"]
        if "phase" in columns:
            response = response * np.exp(1j * columns["phase"])
    else:
        raise SceneError(
            f"{name}: no column of the response: write amplitude [V/g] and phase [deg], or "
            "real [V/g] and imaginary [V/g] in its header, or amplitude=COLUMN:UNIT after the file"
        )
    return MeasuredResponse(
        columns["frequency"], response, columns.get("acceleration"), changes, name, sensors
    )


SETTINGS = ("frequency", "impedance", "phase", "resistance", "reactance")
# Alternative titles of the columns resistance and reactance.
OTHER_NAMES = {"real": "resistance", "imaginary": "reactance"}
PHASE_TITLES = ("theta", "theta z", "θ", "θz", "phi", "φ")
# Maximum phase (degrees): at most 90 for a passive part, plus the analyser's error.
LARGEST_PHASE = 95.0
# A resistance may be negative by this share of |Z|, and by more in at most this share of the lines.
NEGATIVE_SHARE, NEGATIVE_LINES = 0.02, 0.1
# Maximum number of points of a sweep.
MOST_LINES = 50_000
COLUMNS_NEEDED = (
    "|Z| [ohm] and phase [deg], or resistance [ohm] and reactance [ohm] in its header, or "
    "impedance=COLUMN:UNIT and phase=COLUMN:UNIT after the file"
)


@dataclass(frozen=True)
class MeasuredImpedance(MeasuredResponse):
    """Voltage over current at the terminals with clamped base, in SI units.

    Attributes
    ----------
    frequency : ndarray, shape (n,)
        Hz, ascending.
    response : ndarray, shape (n,), complex
        Ω.
    background : ndarray of shape (n,), or None
        Admittance (S) in addition to the scene's mode, capacitance and leak.
    """

    background: np.ndarray | None = None

    @property
    def outputs(self) -> dict[str, np.ndarray]:
        """Outputs compared with the model: logarithm of the magnitude, and phase.

        Errors of both are relative errors of the impedance.
        """
        return impedance_outputs(self.response)

    @property
    def sensed(self) -> dict[str, np.ndarray]:
        """Outputs of sensors with free parameters: none, since the analyser is assumed exact."""
        return {}

    @property
    def assumed_noise(self) -> np.ndarray:
        """Relative noise of both outputs assumed by the first fit."""
        return np.full(2, ASSUMED_IMPEDANCE_NOISE)


def impedance_outputs(impedance: np.ndarray) -> dict[str, np.ndarray]:
    """ln |Z| and the phase (rad)."""
    return {"ln |Z|": np.log(np.abs(impedance)), "phase": np.angle(impedance)}


def read_impedance(
    file: str | Path, settings: Mapping[str, Any] | None = None
) -> MeasuredImpedance:
    """Read an impedance from a file.

    Parameters
    ----------
    file : str or Path
        CSV or another file of columns, or `.s1p` (Touchstone).
    settings : dict of str to str, optional
        `frequency`, `impedance` and `phase` (or `impedance` alone for complex numbers), or
        `resistance` and `reactance`: the column's name or number from 0, with its unit after a
        colon if its heading has none.

    Raises
    ------
    SceneError
        A column or a unit is missing, or the column is not an impedance.
    """
    path, where = str(file), named(str(file))
    settings = table(settings or {}, "settings", '{"impedance": "1:ohm"}')
    columns = {OTHER_NAMES.get(key, key): str(value) for key, value in settings.items()}
    for key in columns:
        if key not in SETTINGS:
            raise SceneError(f"{where}: unknown setting {named(key)}{nearest(key, SETTINGS)}")
    measured = MeasuredFile(path, read_content(path)[0])
    if measured.table.rows > MOST_LINES:
        raise SceneError(
            f"{where}: it has {measured.table.rows} lines: must be at most {MOST_LINES}: remove "
            "every second line"
        )
    frequency, values = _columns(measured, columns)
    impedance = MeasuredImpedance(frequency, values, name=plain_name(Path(path).name))
    _check_passive(impedance.response, where)
    return impedance


def _columns(measured, settings):
    """Frequency (Hz) and Z (Ω) from the file's columns."""
    columns = measured.columns(SETTINGS, settings, _candidates)
    if "frequency" not in columns:
        raise SceneError(
            f"{measured.where}: no column of frequencies: write frequency [Hz] in its header, or "
            f"frequency=COLUMN:UNIT after the file; the file has {measured.listed()}"
        )
    is_complex = columns.get("impedance", (None,))[0] in measured.table.complexes
    polar = {"impedance"} if is_complex else {"impedance", "phase"}
    parts = {"resistance", "reactance"}
    forms = [form for form in (polar, parts) if form <= set(columns)]
    # Columns named by the user take precedence over those identified by headings.
    form = max(forms, key=lambda form: bool(form & set(settings)), default=None)
    if form is None:
        raise SceneError(
            f"{measured.where}: no columns of an impedance: write {COLUMNS_NEEDED}; the file has "
            f"{measured.listed()}"
        )
    values = {n: _values(measured, n, *columns[n]) for n in ("frequency", *sorted(form))}
    if form is parts:
        return values["frequency"], values["resistance"] + 1j * values["reactance"]
    return values["frequency"], values["impedance"] * np.exp(1j * values.get("phase", 0.0))


def _candidates(measured, quantity):
    """Indices of the columns whose headings name a quantity, including alternative titles."""
    indices = measured.of(quantity)
    for name, usual in OTHER_NAMES.items():
        indices = indices or (measured.of(name) if usual == quantity else [])
    if quantity == "phase" and not indices:
        titles = [heading.title.lower().replace("_", " ") for heading in measured.headings]
        indices = [index for index, title in enumerate(titles) if title in PHASE_TITLES]
    return indices


def _values(measured, quantity, index, stated):
    """The values of a column, converted to SI units."""
    (values,) = measured.take([index])
    hint = ""
    if quantity == "phase":
        sort = "radians" if np.abs(values).max() <= math.radians(LARGEST_PHASE) else "degrees"
        hint = f" (from {values.min():.3g} to {values.max():.3g}, as {sort} would be)"
    unit = measured.unit(quantity, index, stated, hint=hint)
    if quantity == "phase":
        _check_phase(measured, index, values, unit)
    return values * QUANTITIES[quantity][unit]


def _check_phase(measured, index, values, unit):
    """Raise if degrees are likely radians, or radians degrees."""
    largest = float(np.abs(values).max())
    causes = {
        ("rad", False): "a passive part's phase is within ±1.571 rad: if the column is in degrees, "
        "write phase=COLUMN:deg; if not, the column is not the impedance's phase",
        ("deg", True): "a piezo's phase is −90 deg off resonance: if the column is in radians, "
        "give the unit (phase=COLUMN:rad)",
    }
    cause = causes.get((unit, largest <= math.radians(LARGEST_PHASE)))
    if unit == "deg" and largest > LARGEST_PHASE:
        cause = "a passive part's phase is within ±90 deg: the column is not the impedance's phase"
    if cause:
        column = f"{measured.where}: {measured.label(index)}"
        raise SceneError(f"{column} is within ±{largest:.3g} {unit}, but {cause}")


def _check_passive(impedance, where):
    """Raise if no passive part can have this impedance."""
    if (np.abs(impedance) == 0.0).any():
        raise SceneError(f"{where}: |Z| is 0 in some lines: remove them, or check the column")
    if np.median(impedance.imag) > 0.0:
        raise SceneError(
            f"{where}: the reactance is positive in most lines, but a piezo's is negative: the "
            "sign of the phase or of the imaginary part is reversed, or the columns are those "
            "of an admittance"
        )
    negative = impedance.real < -NEGATIVE_SHARE * np.abs(impedance)
    if np.mean(negative) > NEGATIVE_LINES:
        raise SceneError(
            f"{where}: the resistance is negative in {np.mean(negative):.0%} of the lines: a "
            "passive part absorbs power: check the columns, and the analyser's compensation"
        )
