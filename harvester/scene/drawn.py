"""A scene's drawing, [beam] and [magnets], as the equivalent lumped tables."""

from __future__ import annotations

from typing import Any

from harvester.base.errors import SceneError
from harvester.device.beam.lumped import Beam, lumped
from harvester.device.beam.magnets import Magnets, spring_points
from harvester.device.keys import SI, check_table
from harvester.device.piezo import PiezoTable
from harvester.scene.tables import Oscillator

# Tables computed from a drawing, and their keys that a scene with [beam] may not contain.
DRAWN = {
    name: [key for key, spec in cls.KEYS.items() if spec.drawn]
    for name, cls in (("oscillator", Oscillator), ("piezo", PiezoTable))
}


def with_drawing(tables: dict[str, Any], origin: str) -> dict[str, Any]:
    """A scene's tables with the lumped values computed from its drawing.

    Raises SceneError if a key of the drawing is invalid, or the scene also gives a computed value.
    """
    if "beam" not in tables:
        if "magnets" in tables:
            raise SceneError(f"{origin}: [magnets] act on a beam's tip: add the table [beam]")
        return tables
    if tables.get("units") != SI:
        raise SceneError(f'{origin}: [beam] is a drawing in metres and needs units = "SI"')
    beam = check_table("beam", tables["beam"], Beam, SI, origin)
    values = lumped(beam, origin)
    oscillator: dict[str, Any] = {
        "mass": values.mass, "damping": values.damping, "base_factor": values.base_factor,
    }  # fmt: skip
    if "magnets" in tables:
        magnets = check_table("magnets", tables["magnets"], Magnets, SI, origin)
        points = spring_points(magnets, beam, origin)
        oscillator |= {"force_table": points, "force_interpolation": "smooth"}
    else:
        oscillator["linear_stiffness"] = values.stiffness
    piezo = {
        "coupling": values.coupling, "capacitance": values.capacitance,
        "base_charge": values.rest_charge,
    }  # fmt: skip
    tables = dict(tables)
    for name, computed in (("oscillator", oscillator), ("piezo", piezo)):
        table = tables.get(name, {})
        for key in DRAWN[name]:
            if key in table:
                raise SceneError(
                    f"{origin}: {name}.{key} follows from [beam]: remove one of them, or change "
                    "the beam's own keys"
                )
        tables[name] = table | computed
    return tables


def without_drawn(tables: dict[str, Any]) -> dict[str, Any]:
    """A scene's tables without the keys that are computed from its drawing."""
    remaining = {
        name: {key: value for key, value in tables[name].items() if key not in keys}
        for name, keys in DRAWN.items()
    }
    undrawn = {name: content for name, content in tables.items() if name not in DRAWN}
    return undrawn | {name: content for name, content in remaining.items() if content}
