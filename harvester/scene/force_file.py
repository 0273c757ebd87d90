"""Tables of points from text files (force, spectrum): the scene holds the points, not the file."""

from __future__ import annotations

from typing import Any

from harvester.base.errors import SceneError
from harvester.base.plain_text import shown
from harvester.excitation.profiles import write_out_profile
from harvester.records.points import read_points
from harvester.records.quantities import QUANTITIES
from harvester.scene.toml import parts_of

# Key of a table of points: its kind of file, and the quantities of its two columns.
TABLES = {
    "force_table": ("table of force", ("displacement", "force")),
    "breakpoints": ("spectrum", ("frequency", "density")),
}


def read_points_of(tables: dict[str, Any], origin: str) -> None:
    """Replace the names of files in a scene's tables by their points.

    These are `oscillator.force_table` and the `breakpoints` of an excitation and of its parts. The
    name of a standard profile is also replaced by points.

    Raises SceneError if the file cannot be read, a line does not hold two numbers, or the heading
    contradicts the scene.
    """
    scaled = tables.get("units") == "scaled"
    for name, key in (("oscillator", "force_table"), ("excitation", "breakpoints")):
        for where, table in parts_of(tables.get(name), f"{origin}: {name}"):
            write_out_profile(table, where)
            if not isinstance(table.get(key), str):
                continue
            try:
                unit = table.get("unit")
                if not isinstance(unit, str | None):
                    raise SceneError(f"unit = {shown(unit)}: must be a text")
                table |= _points(table[key], key, unit, scaled)
            except SceneError as fault:
                raise SceneError(f"{where}.{key}: {fault}") from None


def _points(file, key, unit, scaled):
    """The points of a file in SI units, and `unit` if a heading gives the unit of densities."""
    noun, quantities = TABLES[key]
    stated = (None, unit if key == "breakpoints" and unit != "scaled" else None)
    points, units = read_points(file, noun, quantities, stated, scaled)
    factors = [QUANTITIES[q][u] if u else 1.0 for q, u in zip(quantities, units, strict=True)]
    scene_unit = {}
    if key == "breakpoints" and units[1]:
        # The scene stores densities in one of the units that it accepts.
        scene_unit = {"unit": unit or ("g^2/Hz" if "g^2" in units[1] else "(m/s^2)^2/Hz")}
        factors[1] /= QUANTITIES["density"][scene_unit["unit"]]
    return {key: (points * factors).tolist(), **scene_unit}
