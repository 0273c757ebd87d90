"""Words for people: symbols of states and means, a scene's keys, what an efficiency is."""

from __future__ import annotations

from collections.abc import Iterable

SYMBOLS = {
    "displacement": "X",
    "velocity": "X'",
    "voltage": "V",
    "mean_square_voltage": "E[V²]",
    "mean_square_velocity": "E[X'²]",
    "power_conversion_efficiency": "PCE",
    "mean_output_power": "output power",
}

EFFICIENCIES = {
    "power_conversion_efficiency": "power into the load over that power and the device's losses",
    "power_conversion_efficiency_of_input": "power into the load over the mechanical input",
    "converter_efficiency": "power harvested at the load's output over the power into the load",
    "end_to_end_efficiency": "power harvested at the load's output over the mechanical input",
}


def definitions(names: Iterable[str]) -> list[str]:
    """One line for each efficiency among some quantities."""
    return [
        f"{name.replace('_', ' ')}: {EFFICIENCIES[name]}" for name in names if name in EFFICIENCIES
    ]
