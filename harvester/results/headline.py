"""The headline of a report: power, load and conditions."""

from __future__ import annotations

from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from harvester.base.formatting import quantity, with_error
from harvester.scene.tables import key_words

if TYPE_CHECKING:
    from harvester.scene.model import Scene

NOT_NAMED = ("kind", "knot_spacing", "full_scale")


def headline(result: Any) -> str:
    """One sentence on the power, the load, the excitation and the method."""
    quantities, scene = result.scaled_quantities, result.scene
    name = next((key for key in ("mean_output_power", "mean_power") if key in quantities), "")
    if not name:
        return f"No power of {scene.name}: {conditions(scene)}, by {result.engine}."
    estimate = result.quantity(name)
    power = with_error(estimate, result.unit(estimate.dimension))
    power += " (± numerical error alone)" * (result.error_kind == "numerical")
    where = "harvested at the output of" if name == "mean_output_power" else "into"
    return f"{power} {where} {load(scene)}; {conditions(scene)}; by {result.engine}."


def load(scene: Scene) -> str:
    """The load and its values, as text."""
    table = scene.to_tables()["load"]
    values = [*_values("load", table, scene), *_values("load.parameters", table, scene)]
    name = PurePath(str(table.get("netlist", ""))).stem
    if name:
        return ", ".join([f"the load {table.get('subcircuit') or name}", *values])
    return f"a resistor ({', '.join(values)})"


def conditions(scene: Scene) -> str:
    """The excitation, as text."""
    table = scene.to_tables()["excitation"]
    kind = f"{table['kind']} excitation"
    if "file" in table:
        kind = f"record {PurePath(table['file']).name}"
    if isinstance(table.get("column"), str):
        kind += f", column {table['column']}"
    return ", ".join([kind, *_values("excitation", table, scene)])


def _values(prefix, table, scene):
    """A table's numbers with names and units, without settings of the run and the step."""
    inner = table.get("parameters", {}) if prefix.endswith("parameters") else table
    for key, value in inner.items():
        if isinstance(value, (int, float)) and key not in NOT_NAMED and value is not True:
            words, unit = key_words(f"{prefix}.{key}", scene.units)
            yield f"{words} {quantity(float(value), unit)}"
