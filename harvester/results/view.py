"""Results as data: a table, findings and pictures, from which everything that is shown follows.

A result class defines `view` (and `to_dict` where its JSON is not its fields). Printing
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

# Most characters of a result's `repr`.
LONGEST_REPR = 150
# Most rows of a table in a notebook, and most sentences below it; `to_dataframe` has all rows.
NOTEBOOK_ROWS, NOTEBOOK_FINDINGS = 60, 12


class Table(NamedTuple):
    """Names of columns, with their unit in brackets, and rows of numbers or text."""

    header: Sequence[str]
    rows: Sequence[Sequence[Any]]


@dataclass(frozen=True)
class Picture:
    """A figure that is drawn when it is asked for.

    Attributes
    ----------
    draw : callable
        Function of the content that returns a matplotlib Figure, or None if there is nothing to
        draw.
    content : object
    name : str
        Part of the file's name; empty for the main figure.
    needs : str
        What there must be to draw, and how to get it, for the message where it is missing.
    """

    draw: Callable[[Any], Figure | None]
    content: Any
    name: str = ""
    needs: str = ""

    def figure(self) -> Figure | None:
        """The figure in the project's style; None if there is nothing to draw."""
        return figures.drawn(self.draw, self.content)

    def html(self, alternative: str = "", caption: str = "") -> str:
        """The figure within a page; empty if there is nothing to draw."""
        from harvester.results.page import figure_of

        figure = self.figure()
        words = alternative or caption or self.name or "figure"
        return "" if figure is None else figure_of(figures.image(figure), words, caption)


@dataclass(frozen=True)
class View:
    """A result as data.

    Attributes
    ----------
    table : Table
        For people; its cells are text or `harvester.base.formatting.Printed`.
    findings : sequence of str
        Sentences: the findings, how they were obtained, caveats for citing them.
    headline : str
        The main finding; the first one if empty.
    alarms : sequence of str
        Findings that put the numbers in doubt.
    pictures : sequence of Picture
        The main figure first.
    records : callable or None
        Returns the Table of all numbers, one record a row, where `table` shows a selection.
    keys : int
        Number of the table's first columns that identify its rows; 0: the fewest that do.
    is_series : bool
        Whether a data frame has the records, because they are a curve that the table summarizes.
    dataset : callable or None
        Returns the xarray Dataset on the result's own axes.
    texts : callable or None
        Returns other files of the result: the ending of each file's name, with its text.
    page : callable or None
        Returns the result's HTML page, if that has special sections.
    methods : mapping of str to Result
        Results whose densities a terminal sketches, by the name of their method.
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
        """The records, or the table with the values of its printed numbers."""
        return Table(*self.records()) if self.records else self.values()

    def values(self) -> Table:
        """The table, or the curve that it sums up, with the values of its printed numbers."""
        return self.data() if self.is_series else _expanded(*self.table)


class ResultBase(ABC):
    """Base of all results: printing, tables and files from their view."""

    if TYPE_CHECKING:
        # In a dataclass it is a field, which must not get a default here.
        @property
        def scene(self) -> Scene | None:
            """The scene of the result; None if it has many."""

    @abstractmethod
    def view(self) -> View:
        """Table, findings and pictures of the result."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; NaN and missing errors become null."""
        return fields_of(self)

    def __getitem__(self, name: str) -> Any:
        """The numbers that the table has in a column, or for a quantity, by row.

        A number with an error bar is an Estimate. The first columns of a row identify it, as in
        `swept["mean_power"]["monte-carlo", 0.05]`. Raises UnknownQuantity.
        """
        return self._numbers()[name.replace(" ", "_") if isinstance(name, str) else name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._numbers())

    if not TYPE_CHECKING:

        def __getattr__(self, name):
            # Python and notebooks ask for names with an underscore, also before there are fields.
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
        """The table's numbers by name and row; for a curve, of all its points."""
        view = self.view()
        header, rows = view.data() if view.is_series else view.table
        names = [_name_and_unit(column)[0].partition(" ± ")[0] for column in header]
        keys = view.keys or key_columns(rows, len(names))
        axes = ", ".join(names[:keys])
        numbers = Named(f"{type(self).__name__}, with rows by {axes}: no", {})
        for row in rows:
            place = tuple(map(_number, row[:keys])) if keys > 1 else _number(row[0])
            for words, cell in zip(names[keys:], row[keys:], strict=True):
                outer, inner = (row[0], words) if names[0] == "quantity" else (words, place)
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
        """A figure by its name, the main one without a name.

        Raises
        ------
        UnknownQuantity
            The result has no figure of this name, or nothing to draw in it.
        """
        pictures, kind = self.view().pictures, type(self).__name__
        by_name = {picture.name: picture for picture in pictures if picture.name}
        where = f"{kind}: the main figure is figure(), without a name; no figure"
        picture = Named(where, by_name)[name] if name else next(iter(pictures), None)
        figure = picture and picture.figure()
        if figure is None:
            needs = f": {picture.needs}" if picture and picture.needs else ""
            raise UnknownQuantity(
                f"{kind}: there is nothing to draw in {name or 'a figure'}{needs}"
            )
        return figure

    def data(self) -> Table:
        """Header and rows of all numbers, without rounding; text stays text."""
        return self.view().data()

    def to_csv(self, path: str | Path) -> None:
        """Write the rows of `data`; unknown numbers are empty cells.

        Raises
        ------
        OutputError
        """
        write_csv(path, *self.data())

    def to_dataframe(self, table: str = "shown") -> DataFrame:
        """Numbers as a pandas DataFrame, in which an error has a column of its own.

        Parameters
        ----------
        table : str
            `shown`: the rows of `table()`, or the points of a curve that it sums up. `data`: those
            of `data()`, the CSV file. `densities`: those of all methods, a row for each bin.

        Raises
        ------
        UnknownQuantity
            The result has no such table.
        MissingLibrary
            pandas, of the extra `study`.
        """
        view, kind = self.view(), type(self).__name__
        tables = Named(f"{kind}: no table", {"shown": view.values, "data": view.data})
        if view.methods:
            tables["densities"] = partial(_densities, view.methods)
        header, rows = tables[table]()
        library = optional_library("pandas", f"{kind}.to_dataframe", "study")
        return library.DataFrame(rows, columns=list(header))

    def to_xarray(self) -> Dataset:
        """The numbers as an xarray Dataset; the attribute `unit` of a variable is its unit.

        Raises
        ------
        MissingLibrary
            xarray, of the extra `study`.
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
        """Table, figure and findings in a notebook."""
        from harvester.results.page import facts, table_of, verdict_list, verdicts, wide

        view = self.view()
        header, rows = view.table
        left = len(rows) - NOTEBOOK_ROWS
        more = [f"{left} more rows: to_dataframe() has all"] if left > 0 else []
        parts = [
            verdict_list(verdicts(view)),
            wide(table_of(header, rows[:NOTEBOOK_ROWS])),
            *(picture.html() for picture in view.pictures),
            *map(facts, [*more, *view.findings[:NOTEBOOK_FINDINGS]]),
        ]
        return "\n".join(parts)


def key_columns(rows: Sequence[Sequence[Any]], columns: int) -> int:
    """Number of columns at the left that identify the rows; 1 if none do."""
    for count in range(1, columns):
        if len({tuple(row[:count]) for row in rows}) == len(rows):
            return count
    return 1


def _densities(methods):
    """The densities of several results, below one another."""
    tables = {method: result.density_table() for method, result in methods.items()}
    header = ["method", *next(iter(tables.values())).header]
    return header, [[method, *row] for method, table in tables.items() for row in table.rows]


def _number(cell):
    """The Estimate, the ends or the value that a cell shows; a text as it is."""
    if not isinstance(cell, Printed):
        return cell
    if cell.estimate or cell.error is not None:
        estimate: Any = cell.estimate or Estimate(cell.value, cell.error, None, cell.unit)
        return replace(estimate, unit=cell.unit)
    return cell.ends or cell.value


def _expanded(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> Table:
    """Convert a table for people to values: a number's error gets a separate column."""
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
            columns[f"{words} standard error{suffix}"] = [
                getattr(cell, "error", None) for cell in cells
            ]
        if any(cell.endswith(UNCERTAIN) for cell in printed):
            marks = [str(cell).endswith(UNCERTAIN) for cell in cells]
            columns[f"{words}{UNCERTAIN}"] = marks
        if len(units) > 1 and "unit" not in header:
            columns[f"{words} unit"] = [getattr(cell, "unit", "") for cell in cells]
    return Table([*columns], [list(row) for row in zip(*columns.values(), strict=True)])


def _values(cells):
    """Numbers of a column's cells; in a column of numbers a cell without one is None."""
    numeric = any(isinstance(cell, Printed) for cell in cells)
    values = [cell.value if isinstance(cell, Printed) else cell for cell in cells]
    return [None if numeric and value == "" else value for value in values]


def _name_and_unit(name: str) -> tuple[str, str]:
    match = re.fullmatch(r"(.*) \[([^\]]*)\]", name)
    return (match[1], match[2]) if match else (name, "")
