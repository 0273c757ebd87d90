"""Symbols of states and means in tables and figures."""

SYMBOLS = {
    "displacement": "X",
    "velocity": "X'",
    "voltage": "V",
    "mean_square_voltage": "E[V²]",
    "mean_square_velocity": "E[X'²]",
    "power_conversion_efficiency": "PCE",
    "mean_output_power": "output power",
}
