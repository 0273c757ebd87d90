"""Writes tables of numbers: CSV, and NetCDF through xarray."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from harvester.base.libraries import optional_library
from harvester.base.plain_text import one_line
from harvester.base.writing import whole_file, write_text


def write_csv(path: str | Path, header: Sequence[str], rows: Iterable[Sequence]) -> None:
    """Write a CSV file atomically; see `csv_text`; raises OutputError."""
    write_text(path, csv_text(header, rows))


def csv_text(header: Sequence[str], rows: Iterable[Sequence]) -> str:
    """Write a table as CSV; cells that are not numbers are empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return text.getvalue()


def write_netcdf(path: str | Path, dataset: Any) -> None:
    """Write an xarray Dataset as NetCDF (classic, 64-bit offsets), whole or not at all.

    Raises OutputError.
    """
    with whole_file(path) as file:
        file.write(dataset.to_netcdf(engine="scipy", format="NETCDF3_64BIT"))


def require_xarray() -> ModuleType:
    """Import xarray; raises MissingLibrary if it is not installed."""
    return optional_library("xarray", "NetCDF", "study")


def markdown_table(rows: Iterable[Sequence[str]]) -> str:
    """Rows of text as a Markdown table; the first row is the header.

    >>> print(markdown_table([["quantity"], ["|X|"]]))
    | quantity |
    | --- |
    | \\|X\\| |
    """
    header, *others = [[cell.replace("|", r"\|") for cell in cells] for cells in rows]
    lines = [header, ["---"] * len(header), *others]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _cell(value):
    if isinstance(value, str):
        return one_line(value)
    if value is None or math.isnan(value):
        return ""
    return value if isinstance(value, int) else f"{value:.9g}"
