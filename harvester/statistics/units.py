"""The unit of an estimate in its scene's units."""

from __future__ import annotations

from typing import TYPE_CHECKING

from harvester.scene.units import UNSCALED

if TYPE_CHECKING:
    from harvester.scene.model import Scene

SI_UNITS = {
    "voltage": "V",
    "power": "W",
    "displacement": "m",
    "velocity": "m/s",
    "energy": "J",
    "rate": "1/s",
    "hourly_rate": "1/h",
    "hourly_energy": "J/h",
    "time": "s",
    "stress": "Pa",
    "1": "1",
}


def unit_of(scene: Scene, dimension: str) -> str:
    """Unit of a dimension such as "voltage^2" in the scene's units."""
    base, _, exponent = dimension.partition("^")
    if base == "1":
        return "1"
    if scene.units == "SI" or base in UNSCALED:
        unit = SI_UNITS[base]
        unit = f"({unit})" if exponent and "/" in unit else unit
    else:
        unit = f"scaled {base}"
    return f"{unit}^{exponent}" if exponent else unit
