"""A table of force over displacement from a text file: the scene holds its points, not the file."""

from __future__ import annotations

import math
import re
from typing import Any

from harvester.errors import SceneError
from harvester.files.plain_text import named, shown
from harvester.files.reading import read_input

LARGEST_FILE = 1_000_000
SEPARATORS = re.compile(r"\s*[,;\t]\s*|\s+")


def with_force_table(tables: dict[str, Any], origin: str) -> dict[str, Any]:
    """A scene's tables with the points of the file that `oscillator.force_table` names.

    Raises
    ------
    SceneError
        The file cannot be read, or a line of it holds no two numbers.
    """
    oscillator = tables.get("oscillator")
    file = oscillator.get("force_table") if isinstance(oscillator, dict) else None
    if not isinstance(oscillator, dict) or not isinstance(file, str):
        return tables
    try:
        points = _points(file)
    except SceneError as fault:
        raise SceneError(f"{origin}: oscillator.force_table: {fault}") from None
    return {**tables, "oscillator": {**oscillator, "force_table": points}}


def _points(file):
    """Pairs of numbers, one a line; a heading before them and comments are passed over."""
    text = read_input(file, "table of force", LARGEST_FILE).decode("utf-8-sig", "replace")
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
                f"{named(file)}, line {number}: {shown(line)}: must be a displacement and a force, "
                "such as 0.001, 0.25"
            )
    return points
