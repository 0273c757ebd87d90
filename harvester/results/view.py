"""Results as data: a table, findings and pictures, from which all output is produced.

A result class defines `view`, and `to_dict` if its JSON differs from its fields. Printing
(`harvester.results.terminal`), files, pages, notebooks and data frames use the view alone.
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from harvester.base.arguments import Named
from harvester.base.errors import UnknownQuantity
from harvester.base.formatting import NOT_KNOWN, UNCERTAIN, Printed
from harvester.base.libraries import optional_library
from harvester.base.plain_text import json_text, nearest, one_line
from harvester.base.serialising import fields_of
from harvester.base.tables import require_xarray, write_csv
from harvester.results import figures
from harvester.statistics.estimate import Estimate

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from xarray import Dataset

    from harvester.scene.model import Scene

# End of the name of a column of standard errors.
ERROR = " standard error"
# Maximum length of a result's `repr`.
LONGEST_REPR = 150
# Part of a message on densities.
NOT_IN_JSON = "which JSON does not contain: run the scene again"
# Maximum numbers of table rows and sentences in a notebook; `to_dataframe` has all rows.
NOTEBOOK_ROWS, NOTEBOOK_FINDINGS = 60, 12


class Table(NamedTuple):
    """Column names, with units in brackets, and rows of numbers or text."""

    header: Sequence[str]
    rows: Sequence[Sequence[Any]]


@dataclass(frozen=True)
class Picture:
    """A figure that is drawn on request.

    Attributes
    ----------
    draw : callable
        Function of the content that returns a matplotlib Figure, or None if there is no data.
    content : object
    name : str
        Part of the file's name; empty for the main figure.
    needs : str
        Data that the figure needs, and how to obtain them, for the message if they are missing.
    """

    draw: Callable[[Any], Figure | None]
    content: Any
    name: str = ""
    needs: str = ""

    def figure(self) -> Figure | None:
        """Draw the figure in the project's style; None if there is nothing to draw."""
        return figures.drawn(self.draw, self.content)

    def html(self, alternative: str = "", caption: str = "") -> str:
        """The figure as HTML; empty if there is nothing to draw."""
        from harvester.results.page import figure_of

        figure = self.figure()
        words = alternative or caption or self.name or "figure"
        return "" if figure is None else figure_of(figures.image(figure), words, caption)


@dataclass(frozen=True)
class View:
    """A result as data for all kinds of output.

    Attributes
    ----------
    table : Table
        Table for display; cells are text or `harvester.base.formatting.Printed`.
    findings : sequence of str
        Sentences: findings, how they were obtained, and caveats for citing them.
    headline : str
        The main finding; if empty, the first finding.
    alarms : sequence of str
        Findings that make the numbers doubtful.
    pictures : sequence of Picture
        The pictures, the main figure first.
    records : callable or None
        Function that returns a Table of all numbers, one record per row, if `table` is a selection.
    keys : int
        Number of leading columns that identify the rows; 0: the smallest sufficient number.
    is_series : bool
        Whether data frames contain the records, because `table` only summarizes this curve.
    dataset : callable or None
        Function that returns the result as an xarray Dataset.
    texts : callable or None
        Function that returns other files of the result: name suffixes with their texts.
    page : callable or None
        Function that returns the result's HTML page, if it has special sections.
    methods : mapping of str to Result
        Results whose densities are plotted on a terminal, by method.
    """

    table: Table | tuple[Sequence[str], Sequence[Sequence[Any]]]
    findings: Sequence[str]
    headline: str = ""
    alarms: Sequence[str] = ()
    pictures: Sequence[Picture] = ()
    records: Callable[[], Table | tuple] | None = None
    keys: int = 0
    is_series: bool = False
    dataset: Callable[[], Dataset] | None = None
    texts: Callable[[], Mapping[str, str]] | None = None
    page: Callable[[], str] | None = None
    methods: Mapping[str, Any] = field(default_factory=dict)

    @property
    def main_finding(self) -> str:
        """The headline, or the first finding."""
        return self.headline or next(iter(self.findings), "")

    def data(self) -> Table:
        """The records, else the table with the values of its numbers."""
        return Table(*self.records()) if self.records else self.values()

    def values(self) -> Table:
        """The table, else the curve that it summarizes, with the values of its numbers."""
        return self.data() if self.is_series else _expanded(*self.table)


class ResultBase(ABC):
    """Base of all results: printing, tables and files from their view."""

    if TYPE_CHECKING:
        # Results define `scene` as a dataclass field; a property here would become its default.
        @property
        def scene(self) -> Scene | None:
            """The scene of the result; None if there are several."""

    @property
    def scenes(self) -> Sequence[Scene]:
        """The scenes that were simulated."""
        return [self.scene] if self.scene else []

    @abstractmethod
    def view(self) -> View:
        """Table, findings and pictures of the result."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; NaN and missing errors become null."""
        return fields_of(self)

    def __getitem__(self, name: str) -> Any:
        """The numbers of a table column or of a quantity, by row.

        Numbers with error bars are Estimates. A row's leading columns are its key, as in
        `swept["mean_power"]["monte-carlo", 0.05]`. Raises UnknownQuantity.
        """
        return self._numbers()[name.replace(" ", "_") if isinstance(name, str) else name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._numbers())

    if not TYPE_CHECKING:

        def __getattr__(self, name):
            # Python and notebooks look up names with an underscore, even before fields exist.
            if name.startswith("_") or not vars(self):
                raise AttributeError(name)
            numbers = list(self)
            hint = f"{nearest(name, [*numbers, *dir(self)])}; result[name] has {', '.join(numbers)}"
            hint += '; figure() draws it, harvester.save(result, "file.json") writes it'
            hint = f': write result["{name}"]' if name in numbers else hint
            raise AttributeError(f"{type(self).__name__} has no attribute {name}{hint}")

    def _ipython_key_completions_(self) -> list[str]:
        return list(self)

    def _numbers(self) -> Named:
        """The numbers of the table, or of the whole curve, by name and row."""
        view = self.view()
        header, rows = view.data() if view.is_series else view.table
        names, rows = _with_errors(header, rows)
        keys = view.keys or key_columns(rows, len(names))
        axes = ", ".join(names[:keys])
        numbers = Named(f"{type(self).__name__}, with rows by {axes}: no", {})
        for row in rows:
            row_key = tuple(map(_number, row[:keys])) if keys > 1 else _number(row[0])
            for words, cell in zip(names[keys:], row[keys:], strict=True):
                outer, inner = (row[0], words) if names[0] == "quantity" else (words, row_key)
                name = outer.replace(" ", "_")
                empty = Named(f"{outer}: no", {}, f'result["{name}"]')
                of_name = numbers.setdefault(name, empty)
                if outer == words or isinstance(cell, Printed):
                    of_name[inner] = _number(cell)
        return numbers

    def table(self) -> Table:
        """Header and rows as text; the text of a number has `value`, `error` and `unit`."""
        return Table(*self.view().table)

    def sentences(self) -> list[str]:
        """The findings, and how they were obtained."""
        return list(self.view().findings)

    def headline(self) -> str:
        """The main finding in one line."""
        return self.view().main_finding

    def figure(self, name: str = "") -> Figure:
        """A figure by its name (default: the main figure).

        Raises
        ------
        UnknownQuantity
            The result has no figure of this name, or nothing to draw in it.
        """
        pictures, kind = self.view().pictures, type(self).__name__
        by_name = {picture.name: picture for picture in pictures if picture.name}
        where = f"{kind}: the main figure is figure(), without a name; no figure"
        picture = Named(where, by_name)[name] if name else next(iter(pictures), None)
        figure = picture.figure() if picture else None
        if figure is None:
            needs = f": {picture.needs}" if picture and picture.needs else ""
            raise UnknownQuantity(
                f"{kind}: there is nothing to draw in {name or 'a figure'}{needs}"
            )
        return figure

    def data(self) -> Table:
        """Header and rows of all numbers without rounding; text is unchanged."""
        return self.view().data()

    def to_csv(self, path: str | Path) -> None:
        """Write the rows of `data`; unknown numbers become empty cells.

        Raises
        ------
        OutputError
        """
        write_csv(path, *self.data())

    def to_dataframe(self, table: str = "shown") -> DataFrame:
        """Numbers as a pandas DataFrame with a separate column for errors.

        Parameters
        ----------
        table : str
            `shown`: the rows of `table()`, or the points of the curve that it summarizes. `data`:
            the rows of `data()`, as in the CSV file. `densities`: the densities of all methods, one
            row per bin.

        Raises
        ------
        UnknownQuantity
            The result has no such table, or no densities.
        MissingLibrary
            pandas is missing; it is in the extra `study`.
        """
        view, kind = self.view(), type(self).__name__
        tables = Named(f"{kind}: no table", {"shown": view.values, "data": view.data})
        if view.methods:
            tables["densities"] = partial(_densities, view.methods)
        header, rows = tables[table]()
        if table == "densities" and not rows:
            raise UnknownQuantity(f"{kind}: no densities, {NOT_IN_JSON}")
        library = optional_library("pandas", f"{kind}.to_dataframe", "study")
        return library.DataFrame(rows, columns=list(header))

    def to_xarray(self) -> Dataset:
        """The numbers as an xarray Dataset; a variable's attribute `unit` is its unit.

        Raises
        ------
        MissingLibrary
            xarray is missing; it is in the extra `study`.
        """
        view = self.view()
        if view.dataset:
            return view.dataset()
        header, rows = view.data()
        variables = {}
        for column, name in enumerate(header):
            words, unit = _name_and_unit(name)
            values = [row[column] for row in rows]
            if not all(isinstance(value, str) for value in values):
                values = [math.nan if value in (None, "") else value for value in values]
            variables[words] = ("row", values, {"unit": unit} if unit else {})
        scene = {"scene": json_text(self.scene.to_dict())} if self.scene else {}
        return require_xarray().Dataset(variables, attrs=scene)

    def __repr__(self) -> str:
        name = f" of {self.scene.name}" if self.scene else ""
        text = one_line(f"<{type(self).__name__}{name}: {self.headline()}>")
        return text if len(text) <= LONGEST_REPR else f"{text[: LONGEST_REPR - 2]}…>"

    def _repr_html_(self) -> str:
        """HTML of table, figure and findings for a notebook."""
        from harvester.results.page import facts, table_of, verdict_list, verdicts, wide

        view = self.view()
        header, rows = view.table
        omitted = len(rows) - NOTEBOOK_ROWS
        note = [f"{omitted} more rows: to_dataframe() has all"] if omitted > 0 else []
        parts = [
            verdict_list(verdicts(view)),
            wide(table_of(header, rows[:NOTEBOOK_ROWS])),
            *(picture.html() for picture in view.pictures),
            *map(facts, [*note, *view.findings[:NOTEBOOK_FINDINGS]]),
        ]
        return "\n".join(parts)


def key_columns(rows: Sequence[Sequence[Any]], columns: int) -> int:
    """Number of leading columns that identify the rows; 1 if none do."""
    for count in range(1, columns):
        if len({tuple(row[:count]) for row in rows}) == len(rows):
            return count
    return 1


def _densities(methods):
    """The densities of several results in one table."""
    tables = {method: result.density_table() for method, result in methods.items()}
    header = ["method", *next(iter(tables.values())).header]
    return header, [[method, *row] for method, table in tables.items() for row in table.rows]


def _with_errors(header, rows):
    """Names of columns and rows, in which a value and its standard error are one Estimate."""
    columns = [_name_and_unit(column) for column in header]
    names = [name.partition(" ± ")[0] for name, _ in columns]
    values = [k for k, name in enumerate(names) if not name.endswith(ERROR)]
    errors = {k: names.index(names[k] + ERROR) for k in values if names[k] + ERROR in names}

    def joined(row, k):
        if k not in errors:
            return row[k]
        error, unit = row[errors[k]], columns[k][1]
        return Estimate(row[k], error if math.isfinite(error) else None, None, unit, unit=unit)

    return [names[k] for k in values], [[joined(row, k) for k in values] for row in rows]


def _number(cell):
    """The Estimate, the interval or the value of a cell; text is unchanged."""
    if not isinstance(cell, Printed):
        return cell.item() if isinstance(cell, np.generic) else cell
    if cell.estimate or cell.error is not None:
        estimate: Any = cell.estimate or Estimate(cell.value, cell.error, None, cell.unit)
        return replace(estimate, unit=cell.unit)
    return cell.ends or cell.value


def _expanded(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> Table:
    """Convert a table for display to values: a number's error gets a separate column."""
    columns: dict[str, list[Any]] = {}
    for column, name in enumerate(header):
        cells = [row[column] for row in rows]
        printed = [cell for cell in cells if isinstance(cell, Printed)]
        units = {cell.unit for cell in printed if cell.unit and cell != NOT_KNOWN}
        words, unit = _name_and_unit(name)
        words = words.partition(" ± ")[0]
        unit = unit or (next(iter(units)) if len(units) == 1 else "")
        suffix = f" [{unit}]" if unit and unit != "1" else ""
        has_ends = any(cell.ends for cell in printed)
        if not has_ends or any(math.isfinite(cell.value) for cell in printed):
            columns[f"{words}{suffix}"] = (
                [next((cell.unit for cell in row if getattr(cell, "unit", "")), "") for row in rows]
                if name == "unit"
                else _values(cells)
            )
        for k, end in enumerate(("low", "high") if has_ends else ()):
            pairs = [getattr(cell, "ends", None) for cell in cells]
            columns[f"{words}, {end}{suffix}"] = [pair and pair[k] for pair in pairs]
        if any(cell.error is not None for cell in printed):
            columns[f"{words}{ERROR}{suffix}"] = [getattr(cell, "error", None) for cell in cells]
        if any(cell.endswith(UNCERTAIN) for cell in printed):
            marks = [str(cell).endswith(UNCERTAIN) for cell in cells]
            columns[f"{words}{UNCERTAIN}"] = marks
        if len(units) > 1 and "unit" not in header:
            columns[f"{words} unit"] = [getattr(cell, "unit", "") for cell in cells]
    return Table([*columns], [list(row) for row in zip(*columns.values(), strict=True)])


def _values(cells):
    """The numbers of a column's cells; a cell without a number becomes None."""
    numeric = any(isinstance(cell, Printed) for cell in cells)
    values = [cell.value if isinstance(cell, Printed) else cell for cell in cells]
    return [None if numeric and value == "" else value for value in values]


def _name_and_unit(name: str) -> tuple[str, str]:
    match = re.fullmatch(r"(.*) \[([^\]]*)\]", name)
    return (match[1], match[2]) if match else (name, "")
