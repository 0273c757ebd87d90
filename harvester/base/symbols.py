"""Symbols of states and means, names of a scene's keys, definitions of quantities."""

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

DEFINITIONS = {
    "power_conversion_efficiency": "power into the load over that power and the device's losses",
    "power_conversion_efficiency_of_input": "power into the load over the mechanical input",
    "converter_efficiency": "power harvested at the load's output and into its stores, over the "
    "power into the load",
    "end_to_end_efficiency": "power harvested at the load's output and into its stores, over the "
    "mechanical input",
    "mean_power_used_at_output": "power that the output takes; minus the power from the load's "
    "sources, it is the mean output power, which is harvested",
    "mean_storage_power": "into all capacitors, coils and batteries of the load; with output power "
    "and converter loss it adds up to the mean power",
    "mean_device_storage_power": "growth of the device's kinetic, spring and transducer energy; "
    "with mean power and mean loss power it adds up to the mean input power",
    "stored_energy": "of all capacitors and coils of the load, plus the charge of batteries in the "
    "measured time",
    "stored_energy_per_hour": "the mean storage power times an hour, if the stores hold as much",
}


def definitions(names: Iterable[str]) -> list[str]:
    """One line per quantity that has a definition."""
    return [
        f"{name.replace('_', ' ')}: {DEFINITIONS[name]}" for name in names if name in DEFINITIONS
    ]
