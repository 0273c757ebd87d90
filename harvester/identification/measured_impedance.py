"""A measured electrical impedance: what an analyser shows at the piezo's terminals."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harvester.base.errors import IdentificationError, SceneError
from harvester.base.plain_text import name as plain_name
from harvester.base.plain_text import named, nearest
from harvester.identification.measured_response import MeasuredResponse
from harvester.records.columns import MeasuredFile
from harvester.records.formats import read_content
from harvester.records.quantities import QUANTITIES

FEWEST_FREQUENCIES = 12
SETTINGS = ("frequency", "impedance", "phase", "resistance", "reactance")
# Other names of the columns resistance and reactance.
OTHER_NAMES = {"real": "resistance", "imaginary": "reactance"}
PHASE_TITLES = ("theta", "theta z", "θ", "θz", "phi", "φ")
# Largest phase (degrees): a passive part's is at most 90, and the analyser adds an error.
LARGEST_PHASE = 95.0
# A resistance may be negative by this share of |Z|, and by more in this share of the lines.
NEGATIVE_SHARE, NEGATIVE_LINES = 0.02, 0.1
# Most points of one sweep.
MOST_LINES = 50_000
COLUMNS_NEEDED = (
    "|Z| [ohm] and phase [deg], or resistance [ohm] and reactance [ohm] in its header, or "
    "impedance=COLUMN:UNIT and phase=COLUMN:UNIT behind the file"
)


@dataclass(frozen=True)
class MeasuredImpedance(MeasuredResponse):
    """Voltage over current at the terminals, the base clamped, in SI units.

    Attributes
    ----------
    frequency : ndarray, shape (n,)
        Hz, ascending.
    response : ndarray, shape (n,), complex
        Ω.
    background : ndarray of shape (n,), or None
        Admittance (S) beside that of the scene's own mode, capacitance and leak.
    """

    background: np.ndarray | None = None

    @property
    def outputs(self) -> dict[str, np.ndarray]:
        """Outputs that are compared with the model: logarithm of the magnitude, and phase.

        Errors of both are relative errors of the impedance.
        """
        return impedance_outputs(self.response)

    @property
    def sensed(self) -> dict[str, np.ndarray]:
        """Outputs of sensors with free effects: none, as the analyser is taken to be exact."""
        return {}

    def check(self) -> None:
        """Raise IdentificationError if there are too few frequencies."""
        if self.frequency.size < FEWEST_FREQUENCIES:
            raise IdentificationError(
                f"{self.name}: too short: {self.frequency.size} frequencies, and "
                f"{FEWEST_FREQUENCIES} are the fewest"
            )


def impedance_outputs(impedance: np.ndarray) -> dict[str, np.ndarray]:
    """ln |Z| and the phase (rad)."""
    return {"ln |Z|": np.log(np.abs(impedance)), "phase": np.angle(impedance)}


def read_impedance(
    file: str | Path, settings: Mapping[str, Any] | None = None
) -> MeasuredImpedance:
    """An impedance from its file.

    Parameters
    ----------
    file : str or Path
        CSV or another file of columns, or `.s1p` (Touchstone).
    settings : dict of str to str, optional
        `frequency`, `impedance` and `phase` (or `impedance` alone for complex numbers), or
        `resistance` and `reactance`: the column's name or number from 0, with its unit behind a
        colon where its heading does not say it.

    Raises
    ------
    SceneError
        A column or a unit is missing, or what it holds is no impedance.
    """
    path, where = str(file), named(str(file))
    columns = {OTHER_NAMES.get(key, key): str(value) for key, value in (settings or {}).items()}
    for key in columns:
        if key not in SETTINGS:
            raise SceneError(f"{where}: unknown setting {named(key)}{nearest(key, SETTINGS)}")
    measured = MeasuredFile(path, read_content(path)[0])
    if measured.table.rows > MOST_LINES:
        raise SceneError(
            f"{where}: it has {measured.table.rows} lines, and {MOST_LINES} are the most: leave "
            "every second one out"
        )
    frequency, values = _columns(measured, columns)
    impedance = MeasuredImpedance(frequency, values, name=plain_name(Path(path).name))
    _check_passive(impedance.response, where)
    return impedance


def _columns(measured, given):
    """Frequency (Hz) and Z (Ω) by the columns that a file has."""
    columns = measured.columns(SETTINGS, given, _candidates)
    if "frequency" not in columns:
        raise SceneError(
            f"{measured.where}: no column of frequencies: write frequency [Hz] in its header, or "
            f"frequency=COLUMN:UNIT behind the file; the file has {measured.listed()}"
        )
    is_complex = columns.get("impedance", (None,))[0] in measured.table.complexes
    polar = {"impedance"} if is_complex else {"impedance", "phase"}
    parts = {"resistance", "reactance"}
    forms = [form for form in (polar, parts) if form <= set(columns)]
    # Columns that the user named come before those found by their headings.
    form = max(forms, key=lambda form: bool(form & set(given)), default=None)
    if form is None:
        raise SceneError(
            f"{measured.where}: no columns of an impedance: write {COLUMNS_NEEDED}; the file has "
            f"{measured.listed()}"
        )
    values = {n: _values(measured, n, *columns[n]) for n in ("frequency", *sorted(form))}
    if form is parts:
        return values["frequency"], values["resistance"] + 1j * values["reactance"]
    turned = 1.0 if is_complex else np.exp(1j * values["phase"])
    return values["frequency"], values["impedance"] * turned


def _candidates(measured, quantity):
    """Indices of the columns whose headings name a quantity, also by its other names."""
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


def _check_phase(measured, place, values, unit):
    """Refuse degrees that are radians, and radians that are degrees."""
    largest = float(np.abs(values).max())
    limit = math.radians(LARGEST_PHASE)
    if unit == "rad" and largest > limit:
        cause = (
            "a passive part's phase within ±1.571 rad: if it is in degrees, say so "
            "(phase=COLUMN:deg); if not, the column is not that of the impedance's phase"
        )
    elif unit == "deg" and largest > LARGEST_PHASE:
        cause = (
            "a passive part's phase within ±90 deg: the column is not that of the impedance's phase"
        )
    elif unit == "deg" and largest <= limit:
        cause = (
            "a piezo's impedance has −90 deg away from its resonances: if it is in radians, say so "
            "(phase=COLUMN:rad)"
        )
    else:
        return
    raise SceneError(
        f"{measured.where}: {measured.label(place)} lies within ±{largest:.3g} {unit}, and {cause}"
    )


def _check_passive(impedance, where):
    """Refuse an impedance that no passive part can have."""
    if (np.abs(impedance) == 0.0).any():
        raise SceneError(f"{where}: |Z| is 0 in some lines: leave them out, or check the column")
    if np.median(impedance.imag) > 0.0:
        raise SceneError(
            f"{where}: the reactance is positive in most lines, and a piezo's is negative: the "
            "sign of the phase or of the imaginary part is turned round, or the columns are those "
            "of an admittance"
        )
    negative = impedance.real < -NEGATIVE_SHARE * np.abs(impedance)
    if np.mean(negative) > NEGATIVE_LINES:
        raise SceneError(
            f"{where}: the resistance is negative in {np.mean(negative):.0%} of the lines: a "
            "passive part takes power in: check the columns, and the analyser's compensation"
        )
