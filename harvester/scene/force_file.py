"""Tables of points from text files (force, spectrum): the scene holds the points, not the file."""

from __future__ import annotations

import math
import re
from typing import Any

from harvester.errors import SceneError
from harvester.excitation.profiles import with_profile
from harvester.files.plain_text import named, shown
from harvester.files.reading import read_input

LARGEST_FILE = 1_000_000
SEPARATORS = re.compile(r"\s*[,;\t]\s*|\s+")


def with_points(tables: dict[str, Any], origin: str) -> dict[str, Any]:
    """A scene's tables with the points of the files that its keys of points name.

    `oscillator.force_table`, and `breakpoints` of an excitation or of a part of one. A profile
    that is named is written out.

    Raises
    ------
    SceneError
        The file cannot be read, or a line of it holds no two numbers.
    """
    tables = dict(tables)
    for table, key, what in (
        ("oscillator", "force_table", ("table of force", "a displacement and a force")),
        ("excitation", "breakpoints", ("spectrum", "a frequency (Hz) and a density")),
    ):
        if isinstance(tables.get(table), dict):
            tables[table] = _read(tables[table], key, what, f"{origin}: {table}")
    return tables


def _read(table, key, what, where):
    """A table, and its `parts`, in which a file's name is replaced by the points of the file."""
    table = with_profile(dict(table), where)
    if isinstance(table.get(key), str):
        try:
            table[key] = _points(table[key], *what)
        except SceneError as fault:
            raise SceneError(f"{where}.{key}: {fault}") from None
    if isinstance(table.get("parts"), list):
        table["parts"] = [
            _read(part, key, what, f"{where}.parts[{place}]") if isinstance(part, dict) else part
            for place, part in enumerate(table["parts"])
        ]
    return table


def _points(file, kind, pair):
    """Pairs of numbers, one a line; a heading before them and comments are passed over."""
    text = read_input(file, kind, LARGEST_FILE).decode("utf-8-sig", "replace")
    points: list[list[float]] = []
    headings = 0
    for number, line in enumerate(text.splitlines(), start=1):
        content = line.partition("#")[0].strip(" \t,;")
        if not content:
            continue
        fields = SEPARATORS.split(content)
        try:
            values = [float(field) for field in fields]
        except ValueError:
            values = []
        if len(values) == 2 and all(map(math.isfinite, values)):
            points.append(values)
        elif not points and not values and headings == 0:
            headings = 1
        else:
            raise SceneError(
                f"{named(file)}, line {number}: {shown(line)}: must be {pair}, such as 0.001, 0.25"
            )
    if len(points) < 2:
        raise SceneError(
            f"{named(file)}: {len(points)} lines with {pair}: must be at least 2 for a {kind}"
        )
    return points
