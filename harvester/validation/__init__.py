"""Checks of the program against closed forms, other integrators, the source paper and itself."""

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

# Compared quantities: states of a path, and means.
STATES = ("displacement", "velocity", "voltage")
VOLTAGE, VELOCITY = "mean_square_voltage", "mean_square_velocity"
POWER, OUTPUT_POWER = "mean_power", "mean_output_power"
EFFICIENCY = "power_conversion_efficiency"
MEANS = (VOLTAGE, VELOCITY, EFFICIENCY)
# Wall-clock limit of one case of `stability` by one engine or stationary method, in seconds.
TIME_LIMIT = 120.0


@cache
def entries(name: str) -> dict[str, Any]:
    """The tables of one of the TOML files in this folder."""
    return tomllib.loads((Path(__file__).parent / f"{name}.toml").read_text("utf-8"))
