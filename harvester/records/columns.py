"""Columns of a measured file by quantity, name or number, with their units."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from harvester.base.errors import SceneError
from harvester.base.plain_text import named, nearest, shown
from harvester.records.formats import read_table, refused_as_record
from harvester.records.quantities import (
    COMPLEX_QUANTITIES,
    QUANTITIES,
    SAMPLES,
    Heading,
    column_named,
    factor_of,
    heading,
    unit_named,
)
from harvester.records.table import Table

SHOWN_NAMES = 12
# The mean rate of a time column and the given rate may differ by the first factor. If the scene
# names the column, the second applies: uneven samples may then be brought to another rate.
RATE_TOLERANCE, RATE_FACTOR = 1.01, 5.0


class Columns(NamedTuple):
    """A column of motion in the file's unit, and its times.

    Attributes
    ----------
    values
        Shape (n,); NaN where the file holds no number.
    times
        Shape (n,); s after the first.
    sampling_rate : Hz, as given or as the file says.
    unit
        Unit of the samples, as the file writes it; empty where it does not say.
    remarks
        Remarks on the file that go into a result's notes.
    """

    values: np.ndarray
    times: np.ndarray | None
    sampling_rate: float | None
    unit: str = ""
    remarks: tuple[str, ...] = ()


class MeasuredFile:
    """A file's columns with what their headings say.

    `file`: name of the file: for messages, and its ending selects the reader. `expected`: quantity
    of each column of a table of points; empty: any, as the headings say. Raises SceneError if it is
    no record.

    Attributes
    ----------
    where : str
        The file's name in messages.
    table : harvester.records.table.Table
    headings : list of harvester.records.quantities.Heading
        Heading of each column; without a title where the file has no names.
    """

    def __init__(self, file: str, content: bytes, expected: Sequence[str] = ()) -> None:
        self.where = named(file)
        with refused_as_record(self.where):
            self.table: Table = read_table(file, content)
        names = self.table.names
        apart = self.table.units or [""] * len(names)
        kinds = expected if len(expected) == len(names) else [""] * len(names)
        self.headings = [
            _with_unit(heading(name, kind), unit)
            for name, unit, kind in zip(names, apart, kinds, strict=True)
        ]

    def take(self, places: list[int]) -> list[np.ndarray]:
        """The columns at `places`, each float64 of shape (n,). Raises SceneError."""
        with refused_as_record(self.where):
            return self.table.take(places)

    def of(self, quantity: str) -> list[int]:
        """Indices of the numeric columns whose headings name a quantity."""
        return [
            index
            for index, head in enumerate(self.headings)
            if head.quantity == quantity
            and index not in self.table.texts
            and (index not in self.table.complexes or quantity in COMPLEX_QUANTITIES)
        ]

    def times(self) -> list[int]:
        """Indices of the time columns; of columns of sample numbers if there is no other."""
        columns = self.of("time")
        clocks = [k for k in columns if unit_named("time", self.headings[k].unit) != SAMPLES]
        return clocks or columns

    def place(self, key: str, column: str | int) -> int:
        """Index of a column from its name, its title or its number. Raises SceneError."""
        names = self.table.names
        index = column_named(column, names) if isinstance(column, str) else column
        if index is None:
            listed = self.listed() if any(names) else "no header, only numbers"
            raise SceneError(
                f"{self.where}: {key} = {shown(column)}: no such column{nearest(column, names)}; "
                f"the file has {listed}"
            )
        if not 0 <= index < len(self.table.names):
            raise SceneError(
                f"{self.where}: {key} = {shown(column)}: the file has columns "
                f"0 … {len(self.table.names) - 1}"
            )
        if index in self.table.complexes and key not in COMPLEX_QUANTITIES:
            raise SceneError(
                f"{self.where}: {key}: {self.label(index)} holds complex numbers, as a frequency "
                "response does (response=COLUMN:UNIT): name a column of real ones"
            )
        return index

    def chosen(
        self, quantity: str, text: str | None, candidates: Sequence[int]
    ) -> tuple[int | None, str | None]:
        """Index of a quantity's column, and the unit that is given for it.

        `text`: COLUMN:UNIT or COLUMN; None: the only one of those found, if there is any. Raises
        SceneError if there is no such column, or several were found.
        """
        names = self.table.names
        if text is not None:
            column, colon, unit = text.rpartition(":")
            bare = not colon or text in names
            column = text if bare else column
            number = column not in names and column.isdigit()
            return self.place(quantity, int(column) if number else column), None if bare else unit
        if len(candidates) > 1:
            listed = ", ".join(named(names[index]) for index in candidates)
            raise SceneError(
                f"{self.where}: several columns may be the {quantity} ({listed}): name one by "
                f"{quantity}=COLUMN:UNIT behind the file"
            )
        return candidates[0] if candidates else None, None

    def listed(self) -> str:
        """The columns' names, or their numbers."""
        names = self.table.names
        ellipsis = f", … ({len(names)} in all)" if len(names) > SHOWN_NAMES else ""
        shown_names = ", ".join(named(name) for name in names[:SHOWN_NAMES] if name)
        return shown_names + ellipsis if shown_names else f"0 … {len(names) - 1}"

    def label(self, index: int) -> str:
        """A column in messages: its name, or its number."""
        name = self.table.names[index]
        return f"column {named(name) if name else index}"

    def agreed_unit(self, quantity: str, index: int, key: str, stated: str | None) -> str:
        """The unit of a column, in its usual spelling: the heading's, or as given; else empty.

        Raises SceneError if it is unknown, or both say something else.
        """
        written = self.headings[index].unit
        usual = unit_named(quantity, written) if written else None
        if stated:
            factor = factor_of(quantity, stated, f"{self.where}: {key}", "write it in one of them")
            if usual and (usual == SAMPLES) != (unit_named(quantity, stated) == SAMPLES):
                self._refuse_unit(index, key, stated)
            if usual and QUANTITIES[quantity][usual] != factor:
                self._refuse_unit(index, key, stated)
            return str(unit_named(quantity, stated))
        if written and not usual:
            factor_of(
                quantity,
                written,
                f"{self.where}: {self.label(index)}",
                f"correct the header, or say it by {key}",
            )
        return usual or ""

    def _refuse_unit(self, index, key, stated):
        raise SceneError(
            f"{self.where}: {key} = {shown(stated)}: the heading of {self.label(index)} says "
            f"{named(self.headings[index].unit)}: leave {key} out, or correct the one that is wrong"
        )

    def seconds(
        self, values: np.ndarray, index: int, unit: str, rate: float | None, cure: str
    ) -> np.ndarray:
        """A column of times as seconds after the first, float64 of shape (n,).

        `values`: shape (n,). `unit`: unit of time, in its usual spelling; "samples" need a rate.
        Raises SceneError for sample numbers without a rate.
        """
        if unit == SAMPLES and rate is None:
            raise SceneError(
                f"{self.where}: {self.label(index)} counts samples, and their rate is not known: "
                f"{cure}"
            )
        finite = np.flatnonzero(np.isfinite(values))
        # The first time is subtracted before scaling, so that the milliseconds of an epoch are
        # kept.
        with np.errstate(all="ignore"):
            since = values - values[finite[0]] if finite.size else values
            factor = 1.0 / rate if unit == SAMPLES and rate else QUANTITIES["time"][unit]
            return since * factor

    def compare_rates(
        self,
        times: np.ndarray,
        rate: float,
        index: int,
        factor: float = RATE_TOLERANCE,
        key: str = "sampling_rate",
    ) -> None:
        """Refuse a sampling rate that differs from the time column's; times that never rise have
        none.

        `times`: shape (n,); s. `rate`: Hz, as given. `factor`: largest factor by which the two
        rates may differ. Raises SceneError.
        """
        if measured_rate := _other_rate(times, rate, factor):
            raise SceneError(
                f"{self.where}: {key} = {rate:g}: {self.label(index)} says "
                f"{measured_rate:.6g} Hz: leave sampling_rate out, say in which unit the "
                "column is, or name it by time_column to read the rate from it"
            )


def _with_unit(head, apart):
    """A heading with the unit that stands apart from it, which goes before its own."""
    if not apart:
        return head
    quantity = head.quantity or heading(f"{head.title} [{apart}]").quantity
    return Heading(head.title, apart, quantity)


def motion_columns(
    file: str,
    content: bytes,
    column: str | int | None = None,
    time_column: str | int | None = None,
    time_unit: str | None = None,
    sampling_rate: float | None = None,
) -> Columns:
    """The column of motion and its times, as the keys of a record's table ask for them.

    `column`, `time_column`: name, title without unit, or number from 0. Without `column` it is the
    only one besides time, or the only one whose heading names an acceleration; without
    `time_column`, `sampling_rate` and a rate of the file it is the only one whose heading names a
    time. `time_unit`: a unit of time, "samples" among them; must agree with the heading.
    `sampling_rate`: Hz; must agree with the file. Raises SceneError.
    """
    measured = MeasuredFile(file, content)
    rate = _agreed_rate(measured, sampling_rate)
    time_place = _time_place(measured, time_column, rate is None)
    motion = _motion_place(measured, column, time_place)
    unit = measured.headings[motion].unit
    remarks = measured.table.remarks
    if time_place is None:
        if time_unit is not None:
            raise SceneError(
                f"{measured.where}: excitation.time_unit = {shown(time_unit)}: no column of times "
                "is read: name it by excitation.time_column"
            )
        _refuse_other_rate(measured, rate, sampling_rate is not None)
        (values,) = measured.take([motion])
        return Columns(values, None, rate, unit, remarks)
    values, times = measured.take([motion, time_place])
    agreed = measured.agreed_unit("time", time_place, "excitation.time_unit", time_unit)
    if time_column is not None and sampling_rate is None and agreed != SAMPLES:
        # The column that the scene names goes before the file's own rate.
        rate = None
    cure = "give excitation.sampling_rate (Hz)"
    times = measured.seconds(times, time_place, agreed or "s", rate, cure)
    if rate is not None:
        measured.compare_rates(times, rate, time_place, RATE_FACTOR, "excitation.sampling_rate")
    return Columns(values, times, rate, unit, remarks)


def _agreed_rate(measured, stated):
    """Sampling rate as given or as the file says, which must be the same."""
    rate = measured.table.rate
    if stated is not None and rate is not None and not np.isclose(stated, rate, rtol=1e-6):
        raise SceneError(
            f"{measured.where}: excitation.sampling_rate = {stated:g}: the file says {rate:g} Hz: "
            "leave it out"
        )
    return stated if stated is not None else rate


def _time_place(measured, column, needed):
    """Index of the time column: the named one, else the only one if times are needed."""
    if column is not None:
        return measured.place("excitation.time_column", column)
    candidates = measured.times() if needed else []
    if len(candidates) > 1:
        names = ", ".join(named(measured.table.names[index]) for index in candidates)
        raise SceneError(
            f"{measured.where}: several columns may be the time ({names}): name one by "
            "excitation.time_column"
        )
    if needed and not candidates:
        raise SceneError(
            f"{measured.where}: excitation.sampling_rate is missing (Hz), or time_column to read "
            "it from"
        )
    return candidates[0] if candidates else None


def _motion_place(measured, column, time_place):
    if column is not None:
        return measured.place("excitation.column", column)
    times = measured.of("time") if time_place is None else [time_place]
    others = [
        index
        for index in range(len(measured.table.names))
        if index not in times
        and index not in measured.table.texts
        and index not in measured.table.complexes
    ]
    if not others and measured.table.complexes:
        raise SceneError(
            f"{measured.where}: {measured.label(measured.table.complexes[0])} holds complex "
            "numbers, which are a frequency response and no motion: `identify` reads them"
        )
    if len(others) != 1:
        others = [index for index in measured.of("acceleration") if index in others]
    if len(others) != 1:
        raise SceneError(
            f"{measured.where}: excitation.column is missing; the file has {measured.listed()}"
        )
    return others[0]


def _refuse_other_rate(measured, rate, stated):
    """Refuse a sampling rate, of the scene or the file, that differs from the one time column."""
    clocks = measured.times()
    if len(clocks) != 1:
        return
    (times,) = measured.take(clocks)
    written = measured.headings[clocks[0]].unit
    key = "excitation.sampling_rate" if stated else "the file's sampling rate"
    # A column without a unit may be in any, also in samples.
    units = [unit_named("time", written)] if written else [*QUANTITIES["time"]]
    seconds = [measured.seconds(times, clocks[0], unit, rate, "") for unit in units if unit]
    if seconds and all(_other_rate(column, rate, RATE_TOLERANCE) for column in seconds):
        measured.compare_rates(seconds[0], rate, clocks[0], key=key)


def _other_rate(times, rate, factor):
    """The rate (Hz) of times where it differs from a rate by more than a factor, else None."""
    steps = np.diff(times[np.isfinite(times)])
    rising = steps[steps > 0.0]
    span = float(steps.sum())
    if not rising.size or not np.isfinite(span):
        return None
    # Time stamps in whole seconds give the time of many samples only to within a second.
    unsure = float(rising.min()) if rising.size < steps.size else 0.0
    low, high = (steps.size / max(span + part, 1e-300) for part in (unsure, -unsure))
    return steps.size / span if low > rate * factor or high < rate / factor else None
