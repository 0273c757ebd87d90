"""Tables of points from text files (force, spectrum): the scene holds the points, not the file."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from harvester.base.errors import SceneError
from harvester.base.plain_text import named, shown
from harvester.base.reading import read_input
from harvester.excitation.columns import MeasuredFile
from harvester.excitation.profiles import with_profile
from harvester.excitation.quantities import QUANTITIES, factor_of, quantity_of

LARGEST_FILE = 1_000_000
# A comment behind numbers.
INLINE = re.compile(r"(?<=[\d \t])#.*")
NUMBER = re.compile(r"[-+\d.,eE\s]+")
# By the key: kind of file, what a line holds, and the quantities of its two columns.
FORCE = "table of force", "a displacement and a force", ("displacement", "force")
DENSITY = "spectrum", "a frequency (Hz) and a density", ("frequency", "density")
TABLES = {"force_table": FORCE, "breakpoints": DENSITY}


def with_points(tables: dict[str, Any], origin: str) -> dict[str, Any]:
    """A scene's tables with the points of the files that its keys of points name.

    `oscillator.force_table`, and `breakpoints` of an excitation or of a part of one. A profile
    that is named is written out.

    Raises SceneError if the file cannot be read, a line of it holds no two numbers, or its heading
    contradicts the scene.
    """
    tables = dict(tables)
    for table, key in (("oscillator", "force_table"), ("excitation", "breakpoints")):
        if isinstance(tables.get(table), dict):
            scaled = tables.get("units") == "scaled"
            tables[table] = _read(tables[table], key, scaled, f"{origin}: {table}")
    return tables


def _read(table, key, scaled, where):
    """A table, and its `parts`, in which a file's name is replaced by the points of the file."""
    table = with_profile(dict(table), where)
    if isinstance(table.get(key), str):
        try:
            unit = table.get("unit")
            if not isinstance(unit, str | None):
                raise SceneError(f"unit = {shown(unit)}: must be a text")
            table |= _points(table[key], key, unit, scaled)
        except SceneError as fault:
            raise SceneError(f"{where}.{key}: {fault}") from None
    if isinstance(table.get("parts"), list):
        table["parts"] = [
            _read(part, key, scaled, f"{where}.parts[{k}]") if isinstance(part, dict) else part
            for k, part in enumerate(table["parts"])
        ]
    return table


def _points(file, key, unit, scaled):
    """The points of a file in SI units, and `unit` where a heading says that of densities."""
    kind, pair, quantities = TABLES[key]
    content = read_input(file, kind, LARGEST_FILE)
    text = content.decode("utf-8-sig", "replace")
    text = content.decode("latin-1") if "\ufffd" in text else text
    # Trailing commas make columns of no numbers.
    lines = [INLINE.sub("", line.strip()).rstrip(" \t,;") for line in text.splitlines()]
    few = f"lines with {pair}: must be at least 2 for a {kind}"
    if not any(lines):
        raise SceneError(f"{named(file)}: 0 {few}")
    measured = MeasuredFile(file, "\n".join([*lines, ""]).encode(), quantities)
    table = measured.table
    titles = [quantity_of(heading.title, "") for heading in measured.headings]
    if titles == [*reversed(quantities)]:
        raise SceneError(f"{named(file)}: its columns stand in the wrong order: must be {pair}")
    if line := _wrong_line(measured):
        raise SceneError(f"{named(file)}, line {line}: must be {pair}")
    columns = measured.take([0, 1])
    if table.rows < 2:
        raise SceneError(f"{named(file)}: {table.rows} {few}")
    units = {}
    for index, quantity in enumerate(quantities):
        where = f"{named(file)}: {measured.label(index)}"
        if written := measured.headings[index].unit:
            square = " (square an amplitude density first)" if quantity == "density" else ""
            factor_of(quantity, written, where, f"correct it{square}")
        scene_unit = unit if quantity == "density" and unit != "scaled" else None
        file_unit = measured.agreed_unit(quantity, index, "unit", scene_unit) if written else ""
        factor = QUANTITIES[quantity][file_unit] if file_unit else 1.0
        if scaled and (factor != 1.0 or (file_unit and quantity == "density")):
            raise SceneError(f'{where}: the scene has units = "scaled": take SI, or scaled values')
        if quantity == "density" and file_unit:
            # The scene keeps the densities in one of the units that it knows.
            units["unit"] = unit or ("g^2/Hz" if "g^2" in file_unit else "(m/s^2)^2/Hz")
            factor /= QUANTITIES[quantity][units["unit"]]
        columns[index] = factor * columns[index]
    return {key: np.column_stack(columns).tolist(), **units}


def _wrong_line(measured):
    """Number of a line without two numbers; 0 if there is none."""
    table = measured.table
    if table.width != 2:
        return table.line_of(0)
    if any(map(NUMBER.fullmatch, table.names)):
        return table.line_of(0) - 1
    bad = np.flatnonzero(~np.isfinite(measured.take([0, 1])).all(axis=0))
    return table.line_of(bad[0]) if bad.size else bool(table.remarks) and table.line_of(table.rows)
