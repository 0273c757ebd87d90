"""Files of points: two numeric columns, with or without a heading."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from harvester.base.errors import SceneError
from harvester.base.plain_text import named
from harvester.base.reading import read_input
from harvester.records import text
from harvester.records.columns import MeasuredFile
from harvester.records.formats import format_of
from harvester.records.quantities import QUANTITIES, quantity_of

LARGEST_FILE = 1_000_000
# A comment after numbers.
INLINE = re.compile(r"(?<=[\d \t])#.*")
NUMBER = re.compile(r"[-+\d.,eE\s]*\d[-+\d.,eE\s]*")


def read_points(
    file: str,
    noun: str,
    quantities: Sequence[str],
    stated: Sequence[str | None] = (None, None),
    scaled: bool = False,
) -> tuple[np.ndarray, list[str]]:
    """Points of shape (n, 2) with the file's values, and their units ("" without a heading).

    `noun`: kind of file, for messages. `quantities`: quantities of the two columns. `stated`: units
    that a heading must not contradict. `scaled`: whether the points belong to a scaled scene, and
    have no units. Raises SceneError if the file cannot be read, a line does not hold two numbers,
    or a heading names other quantities or a wrong unit.
    """
    content = read_input(file, noun, LARGEST_FILE)
    pair = " and ".join(f"a {q} (Hz)" if q == "frequency" else f"a {q}" for q in quantities)
    too_few = f"lines with {pair}: must be at least 2 for a {noun}"
    if format_of(file, content) is text.FORMAT:
        decoded = content.decode("utf-8-sig", "replace")
        decoded = content.decode("latin-1") if "\ufffd" in decoded else decoded
        # Trailing commas would create columns without numbers.
        lines = [INLINE.sub("", line.strip()).rstrip(" \t,;") for line in decoded.splitlines()]
        if not any(lines):
            raise SceneError(f"{named(file)}: 0 {too_few}")
        content = "\n".join([*lines, ""]).encode()
    measured = MeasuredFile(file, content, quantities, lambda key, _: key, "")
    titles = [quantity_of(heading.title, "") for heading in measured.headings]
    if titles == [*reversed(quantities)]:
        raise SceneError(f"{named(file)}: its columns are in the wrong order: must be {pair}")
    if line := _wrong_line(measured):
        raise SceneError(f"{named(file)}, line {line}: must hold two numbers, {pair}")
    points = np.column_stack(measured.take([0, 1]))
    if len(points) < 2:
        raise SceneError(f"{named(file)}: {len(points)} {too_few}")
    units = ["", ""]
    for index, quantity in enumerate(quantities):
        if measured.headings[index].unit:
            square = " (square an amplitude density first)" if quantity == "density" else ""
            unit = units[index] = measured.unit(quantity, index, stated[index], hint=square)
            if scaled and (quantity == "density" or QUANTITIES[quantity][unit] != 1.0):
                raise SceneError(
                    f"{named(file)}: {measured.label(index)} needs conversion to scaled values, as "
                    'the scene has units = "scaled": give scaled values, or set units = "SI"'
                )
    return points, units


def _wrong_line(measured):
    """Number of the first line without two numbers; 0 if there is none."""
    table = measured.table
    if len(table.names) != 2:
        return table.line_of(0)
    if any(map(NUMBER.fullmatch, table.names)):
        return table.line_of(0) - 1
    bad = np.flatnonzero(~np.isfinite(measured.take([0, 1])).all(axis=0))
    return table.line_of(bad[0]) if bad.size else bool(table.remarks) and table.line_of(table.rows)
