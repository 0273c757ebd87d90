"""Words for people: symbols of states and means, a scene's keys, definitions of quantities."""

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

# Names and SI units of the keys that studies vary.
KEYS = {
    "oscillator.mass": ("mass", "kg"),
    "oscillator.damping": ("damping", "N s/m"),
    "oscillator.linear_stiffness": ("linear stiffness", "N/m"),
    "oscillator.cubic_stiffness": ("cubic stiffness", "N/m³"),
    "stoppers.gap": ("gap to the stoppers", "m"),
    "stoppers.stiffness": ("stiffness of the stoppers", "N/m^1.5"),
    "stoppers.restitution": ("restitution of the stoppers", "1"),
    "piezo.coupling": ("piezoelectric coupling", "N/V"),
    "piezo.capacitance": ("capacitance of the piezo", "F"),
    "piezo.leakage_resistance": ("leakage resistance of the piezo", "Ω"),
    "piezo.base_charge": ("charge that the base moves", "C s²/m"),
    "coil.coupling": ("coupling of the coil", "V s/m"),
    "coil.resistance": ("resistance of the coil", "Ω"),
    "coil.inductance": ("inductance of the coil", "H"),
    "load.resistance": ("load resistance", "Ω"),
    "load.parameters.resistance": ("load resistance", "Ω"),
    "load.decay_rate": ("decay rate of the load", "1/s"),
    "excitation.intensity": ("noise intensity D", "m²/s³"),
    "excitation.correlation_time": ("correlation time of the noise", "s"),
    "excitation.amplitude": ("amplitude", "m/s²"),
    "excitation.frequency": ("frequency", "Hz"),
}
# Units of the other numbers of a scene, whose words are those of the key.
UNITS = {
    **dict.fromkeys(("oscillator.frequency", "beam.measured_frequency"), "Hz"),
    **dict.fromkeys(("run.duration", "run.settle", "excitation.knot_spacing"), "s"),
    **dict.fromkeys(
        (
            "oscillator.quality_factor", "oscillator.damping_ratio", "oscillator.base_factor",
            "stoppers.exponent", "beam.quality_factor", "beam.damping_ratio",
        ), "1",
    ),
    **dict.fromkeys(
        (
            "beam.length", "beam.width", "beam.thickness", "beam.piezo_thickness",
            "beam.piezo_length", "beam.piezo_start", "beam.tip_length", "beam.tip_height",
            "beam.tip_width", "beam.tip_offset", "beam.electrode_spacing", "magnets.distance",
            "magnets.reach", "magnets.offset", "magnets.spacing", "start.displacement",
        ), "m",
    ),
    "oscillator.quadratic_damping": "N s²/m²",
    "start.velocity": "m/s",
    "start.voltage": "V",
    "beam.modulus": "Pa",
    "beam.piezo_modulus": "Pa",
    "beam.density": "kg/m³",
    "beam.piezo_density": "kg/m³",
    "beam.tip_mass": "kg",
    "beam.tip_inertia": "kg m²",
    "magnets.remanence": "T",
}  # fmt: skip
# These units are the same in scaled scenes.
ALWAYS = ("s", "1/s", "Hz", "1")

DEFINITIONS = {
    "power_conversion_efficiency": "power into the load over that power and the device's losses",
    "power_conversion_efficiency_of_input": "power into the load over the mechanical input",
    "converter_efficiency": "power harvested at the load's output over the power into the load",
    "end_to_end_efficiency": "power harvested at the load's output over the mechanical input",
    "mean_power_used_at_output": "what the output takes; less what the load's sources supply, it "
    "is the mean output power, which is harvested",
    "mean_storage_power": "into all capacitors, coils and batteries of the load; with output power "
    "and converter loss it adds up to the mean power",
    "mean_device_storage_power": "growth of the device's kinetic, spring and transducer energy; "
    "with mean power and mean loss power it adds up to the mean input power",
    "stored_energy": "of all capacitors and coils of the load, and what batteries took in the "
    "measured time",
}


def key_words(key: str, units: str) -> tuple[str, str]:
    """Words for a key of a scene, and its unit: empty where it is not known or scaled."""
    table, _, name = key.rpartition(".")
    table_note = f" ({table})" if "[" in table else ""
    words, unit = KEYS.get(key, (name.replace("_", " ") + table_note, UNITS.get(key, "")))
    return words, unit if units == "SI" or unit in ALWAYS else ""


def key_label(key: str, units: str) -> str:
    """ "load resistance [Ω]": a key on the axis of a figure."""
    words, unit = key_words(key, units)
    return f"{words} [{unit}]" if unit and unit != "1" else words


def key_column(key: str, units: str) -> str:
    """ "load.resistance [Ω]": a key in the header of a table of plain numbers."""
    unit = key_words(key, units)[1]
    return f"{key} [{unit}]" if unit else key


def definitions(names: Iterable[str]) -> list[str]:
    """One line for each quantity among these whose name does not say what it is."""
    return [
        f"{name.replace('_', ' ')}: {DEFINITIONS[name]}" for name in names if name in DEFINITIONS
    ]
