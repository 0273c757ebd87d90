"""Columns of a measured file, selected by quantity, name or number, with their units and times."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from harvester.base.errors import SceneError
from harvester.base.plain_text import named, nearest, shown
from harvester.records.formats import read_table, readable_record
from harvester.records.quantities import (
    COMPLEX_QUANTITIES,
    QUANTITIES,
    SAMPLES,
    Heading,
    column_named,
    heading,
    unit_named,
    usual_unit,
)

SHOWN_NAMES = 12
# Quantities that may be measured in volts or counts and converted by a scale and an offset.
SCALABLE = ("acceleration", "voltage", "displacement", "velocity")
# Quantities that have units even in a scaled scene.
UNSCALED = ("time", "frequency", "phase")
# Spellings of "no unit" in scaled scenes.
UNITLESS = (None, "", "scaled", "1")
# Maximum ratio between the mean rate of a time column and a stated rate; the second applies to
# records that may be resampled.
RATE_TOLERANCE, RATE_FACTOR = 1.01, 5.0


def setting_of(key: str, quantity: str) -> str:
    """Command-line setting after a file that gives a quantity's "column", "unit" or "scale"."""
    if not quantity:
        return f"{key}=HZ"
    return f"{quantity}_scale=NUMBER" if key == "scale" else f"{quantity}=COLUMN:UNIT"


class MeasuredFile:
    """A file's columns with the quantities and units of their headings.

    `file`: the file's name, used in messages; its suffix selects the format. `expected`: quantity
    of each column of a table of points; empty: from the headings. `setting`: function that returns
    the name, for messages, of the setting for a quantity's "column", "unit" or "scale", or (with
    the quantity "") the "sampling_rate". `behind`: the setting's source, for messages. Raises
    SceneError if the file is not a record.

    Attributes
    ----------
    where : str
        The file's name in messages.
    table : harvester.records.table.Table
    headings : list of harvester.records.quantities.Heading
        Heading of each column; without a title if the file has no names.
    """

    def __init__(
        self,
        file: str,
        content: bytes,
        expected: Sequence[str] = (),
        setting: Callable[[str, str], str] = setting_of,
        behind: str = " after the file",
    ) -> None:
        self.where, self.setting, self._behind = named(file), setting, behind
        self._expected = expected
        with readable_record(self.where):
            self.table = read_table(file, content)
        names = self.table.names
        quantities = expected if len(expected) == len(names) else [""] * len(names)
        self.headings = [heading(*pair) for pair in zip(names, quantities, strict=True)]
        # A unit in a separate row takes precedence over a unit in the heading.
        for index, unit in enumerate(self.table.units):
            if unit:
                title, _, quantity = self.headings[index]
                quantity = quantity or heading(f"{title} [{unit}]").quantity
                self.headings[index] = Heading(title, unit, quantity)
        self._columns: dict[int, np.ndarray] = {}

    def take(self, indices: Sequence[int]) -> list[np.ndarray]:
        """Return the columns at `indices`, each of shape (n,), with the file's values.

        Columns that are requested together are read in one pass. Raises SceneError.
        """
        missing = [index for index in indices if index not in self._columns]
        if missing:
            with readable_record(self.where):
                self._columns |= zip(missing, self.table.take(missing), strict=True)
        return [self._columns[index] for index in indices]

    def of(self, quantity: str) -> list[int]:
        """Indices of the numeric columns whose headings name a quantity.

        Sample numbers count as times only if there is no other time column.
        """
        columns = [
            index
            for index, head in enumerate(self.headings)
            if head.quantity == quantity
            and index not in self.table.texts
            and (index not in self.table.complexes or quantity in COMPLEX_QUANTITIES)
        ]
        clocks = [k for k in columns if unit_named(quantity, self.headings[k].unit) != SAMPLES]
        return clocks or columns

    def column(
        self, quantity: str, stated: str | int | None, candidates: Sequence[int] | None = None
    ) -> int | None:
        """Index of a quantity's column: the stated column, else the only candidate, else None.

        `stated`: the column's name, title, or number from 0. `candidates`: indices; None: those
        whose headings name the quantity. Raises SceneError if there is no such column, or several
        candidates.
        """
        names, key = self.table.names, self.setting("column", quantity)
        if stated is None:
            candidates = self.of(quantity) if candidates is None else candidates
            if len(candidates) > 1:
                listed = ", ".join(named(names[index]) for index in candidates)
                raise SceneError(
                    f"{self.where}: several columns may be the {quantity} ({listed}): name one by "
                    f"{key}{self._behind}"
                )
            return candidates[0] if candidates else None
        index = column_named(stated, names, quantity) if isinstance(stated, str) else stated
        if index is None or not 0 <= index < len(names):
            listed = self.listed() if any(names) else f"no header, only columns {self.listed()}"
            raise SceneError(
                f"{self.where}: {key.partition('=')[0]} = {shown(stated)}: no such column"
                f"{nearest(stated, names) if index is None else ''}; the file has {listed}"
            )
        if names[index] and not self.headings[index].unit:
            # If the title names no quantity, the setting determines it.
            self.headings[index] = heading(names[index], quantity)
        fault = ""
        if index in self.table.complexes and quantity not in COMPLEX_QUANTITIES:
            fault = "contains complex numbers of a frequency response, which only identify reads"
        elif index in self.table.texts and not np.isfinite(*self.take([index])).any():
            fault = "contains texts instead of numbers"
        if fault:
            raise SceneError(
                f"{self.where}: {quantity}: {self.label(index)} {fault}: name another column by "
                f"{key}{self._behind}"
            )
        return index

    def stated(self, text: str | None) -> tuple[str | int | None, str | None]:
        """Parse COLUMN:UNIT or COLUMN into the column's name or number, and the unit."""
        if text is None:
            return None, None
        names = self.table.names
        column, colon, unit = text.rpartition(":")
        bare = not colon or text in names
        column = text if bare else column
        number = column.isdigit() and column not in names
        return int(column) if number else column, None if bare else unit

    def columns(
        self,
        quantities: Collection[str],
        settings: Mapping[str, str],
        candidates: Callable[[MeasuredFile, str], Sequence[int]],
    ) -> dict[str, tuple[int, str | None]]:
        """Index and stated unit of the column of each quantity that the file contains.

        `settings`: texts COLUMN:UNIT or COLUMN by quantity. Other quantities are found by headings
        among the `candidates`. Raises SceneError.
        """
        stated = {quantity: self.stated(settings.get(quantity)) for quantity in quantities}
        indices = {q: self.column(q, pair[0], candidates(self, q)) for q, pair in stated.items()}
        return {q: (index, stated[q][1]) for q, index in indices.items() if index is not None}

    def listed(self) -> str:
        """The columns' names, or their numbers, as text."""
        names = self.table.names
        ellipsis = f", … ({len(names)} in all)" if len(names) > SHOWN_NAMES else ""
        shown_names = ", ".join(named(name) for name in names[:SHOWN_NAMES] if name)
        return shown_names + ellipsis if shown_names else f"0 … {len(names) - 1}"

    def label(self, index: int) -> str:
        """A column's name or number, for messages."""
        name = self.table.names[index]
        return f"column {named(name) if name else index}"

    def unit(
        self,
        quantity: str,
        index: int,
        stated: str | None = None,
        scaled: bool = False,
        raw: bool = False,
        hint: str = "",
    ) -> str:
        """Usual spelling of a column's unit from its heading or `stated`, which must agree.

        `scaled`: scene and columns are scaled, and only time, frequency and phase have units.
        `raw`: a scale is given; the heading's unit belongs to the raw column, the stated unit to
        the scaled values. `hint`: for messages.
        Returns "" for a time without a unit. Raises SceneError.
        """
        key, written = self.setting("unit", quantity), self.headings[index].unit
        usual, label = unit_named(quantity, written), f"{self.where}: {self.label(index)}"
        if scaled and quantity not in UNSCALED and (usual or stated not in UNITLESS):
            raise SceneError(
                f"{label} is in {named(written or stated)}, but a scene with units = "
                '"scaled" needs values without a unit: set units = "SI", or name another column'
            )
        if scaled and stated in UNITLESS:
            stated = None
            if raw or written in UNITLESS:
                return ""
        unit = usual
        if stated:
            where = f"{self.where}: {key.partition('=')[0]}"
            unit = usual_unit(quantity, stated, where, "write it in one of them")
            if raw:
                return unit
            factors = QUANTITIES[quantity]
            if usual and factors[usual] != factors[unit]:
                raise SceneError(
                    f"{where} = {shown(stated)}: the heading of {self.label(index)} says "
                    f"{named(written)}: omit the unit, or correct the heading"
                )
        scalable = quantity in SCALABLE and not self._expected
        if written and not usual and (not stated or scalable or self._expected):
            cure = f"correct the header{hint}"
            if not self._expected:
                scale = f" and {self.setting('scale', quantity)}" if scalable else ""
                meaning = f": the {quantity} of one {named(written)}" if scalable else ""
                cure = f"{cure}, or give {key}{scale}{self._behind}{meaning}"
            usual_unit(quantity, written, label, cure)
        if not unit and quantity != "time":
            units = QUANTITIES[quantity]
            raise SceneError(
                f"{self.where}: {quantity} has no unit{hint}: write {quantity} "
                f"[{next(iter(units))}] in the header, or give {key}{self._behind}; units are "
                f"{', '.join(units)}"
            )
        return unit or ""

    def times(
        self,
        column: str | int | None = None,
        unit: str | None = None,
        rate: float | None = None,
        beside: Sequence[int] = (),
        always: bool = False,
    ) -> tuple[np.ndarray | None, float | None]:
        """Times (s after the first, shape (n,)) or None, and the sampling rate (Hz) or None.

        A stated rate, the file's rate and the rate of the only time column must agree. A time
        column is read if it is stated, if there is no rate, or `always`. A stated column takes
        precedence over the file's rate.

        `column`, `unit`, `rate`: as stated; the unit may be "samples". `beside`: indices of other
        columns to be read in the same pass. Raises SceneError.
        """
        key, file_rate = self.setting("sampling_rate", ""), self.table.rate
        name = key.partition("=")[0]
        if rate and file_rate and not np.isclose(rate, file_rate, rtol=1e-6):
            raise SceneError(
                f"{self.where}: {name} = {rate:g} Hz contradicts the file, which states "
                f"{file_rate:g} Hz; omit {name}"
            )
        stated, rate = rate is not None, file_rate if rate is None else rate
        says = f"{name} = {rate:g}" if stated else f"the file's sampling rate = {rate or 0.0:g}"
        needed = always or column is not None or rate is None
        clocks = self.of("time") if needed or len(self.of("time")) == 1 else []
        index = self.column("time", column, clocks) if needed else None
        if index is None and unit is not None:
            raise SceneError(
                f"{self.where}: {self.setting('unit', 'time')} = {shown(unit)}: no time column "
                f"is read: name it by {self.setting('column', 'time')}"
            )
        if index is None and rate is None:
            words = [k for k in self.table.texts if self.headings[k].quantity == "time"]
            cause = "no heading names a time"
            if words:
                cause = f"{self.label(words[0])} contains neither numbers nor time stamps"
            raise SceneError(
                f"{self.where}: {name} is missing (Hz), and {cause}: give {key}, "
                f"or the time column by {self.setting('column', 'time')}{self._behind}"
            )
        if index is None and not clocks:
            return None, rate
        clock = clocks[0] if index is None else index
        numbers = self.take([*beside, clock])[-1]
        if index is None:
            # A column without a unit may have any time unit, including samples.
            written = self.headings[clock].unit
            units = [unit_named("time", written)] if written else [*QUANTITIES["time"]]
        else:
            units = [self.unit("time", index, unit) or "s"]
            if column is not None and not stated and units != [SAMPLES]:
                rate = None
        columns = [self._seconds(numbers, clock, u, rate, key) for u in units if u]
        if rate is not None:
            factor = RATE_TOLERANCE if index is None or always else RATE_FACTOR
            rates = [_other_rate(times, rate, factor) for times in columns]
            if rates and all(rates):
                raise SceneError(
                    f"{self.where}: {says}: {self.label(clock)} gives {rates[0]:.6g} Hz: omit "
                    f"{name}, give the column's unit, or name it by "
                    f"{self.setting('column', 'time')} to read the rate from it"
                )
        return None if index is None else columns[0], rate

    def _seconds(self, numbers, index, unit, rate, key):
        """Convert a time column to seconds after the first time; sample numbers need a rate."""
        if unit == SAMPLES and rate is None:
            raise SceneError(
                f"{self.where}: {self.label(index)} contains sample numbers, but "
                f"the sampling rate is unknown: give {key}{self._behind}"
            )
        finite = np.flatnonzero(np.isfinite(numbers))
        # The first time is subtracted before scaling, so that epoch times keep their milliseconds.
        with np.errstate(all="ignore"):
            since = numbers - numbers[finite[0]] if finite.size else numbers
            return since * (1.0 / rate if unit == SAMPLES else QUANTITIES["time"][unit])


def _other_rate(times, rate, factor):
    """Rate (Hz) of `times` if its ratio to `rate` exceeds `factor`, else None."""
    steps = np.diff(times[np.isfinite(times)])
    rising = steps[steps > 0.0]
    span = float(steps.sum())
    if not rising.size or not np.isfinite(span):
        return None
    # Time stamps in whole seconds give many samples' times only to within a second.
    unsure = float(rising.min()) if rising.size < steps.size else 0.0
    low, high = (steps.size / max(span + part, 1e-300) for part in (unsure, -unsure))
    if low <= rate * factor and high >= rate / factor:
        return None
    return steps.size / span if span else np.inf
