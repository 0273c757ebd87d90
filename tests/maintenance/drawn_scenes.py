"""Cases of `make drawn`: a scene, a command and its options, from a seed and a number alone.

Parameters are drawn log-uniformly. Forces, lengths and levels of excitation follow from the
device's own period, well and voltage, so that springs bend, stoppers are met and diodes conduct.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from harvester.device import timescales
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared

DEVICES = ("linear", "hardening", "bistable", "tristable", "stopper", "coil", "beam")
LOADS = ("resistor", "bridge", "SSHI", "doubler", "store")
NETLISTS = {
    "bridge": "bridge", "SSHI": "sshi_parallel", "doubler": "doubler", "store": "bridge",
}  # fmt: skip
SINES = ("sine", "two sines")
NOISES = ("noise", "noise + sine", "narrow spectrum", "wide spectrum")
RECORDS = ("record", "pulses")
EXCITATIONS = (*SINES, *NOISES, *RECORDS)
LINEAR, SEVERAL_WELLS = ("linear", "coil", "beam"), ("bistable", "tristable")
COMMANDS = (
    "simulate monte-carlo",
    "simulate circuit",
    "average",
    "sweep",
    "basins",
    "bifurcation",
    "frequency-response",
    "optimum",
    "load-study",
    "residence",
    "spectrum",
)
# What a command takes, where it does not take everything.
TAKEN = {
    "average": (DEVICES, ("resistor",), NOISES),
    "basins": (DEVICES, LOADS, SINES),
    "bifurcation": (DEVICES, LOADS, ("sine",)),
    "frequency-response": (DEVICES, LOADS, ("sine",)),
    "optimum": (LINEAR, ("resistor",), (*SINES, "noise", "wide spectrum")),
    "residence": (SEVERAL_WELLS, ("resistor",), ("noise", "wide spectrum")),
    "spectrum": (LINEAR, ("resistor",), ("noise", "narrow spectrum", "wide spectrum")),
}
# Netlists as loads have no truth with many starts: these commands take them on one attractor only.
ONE_ATTRACTOR = ("basins", "bifurcation", "frequency-response")
PULSES = 5


class Case(NamedTuple):
    """One case.

    Attributes
    ----------
    seed, number : int
    command, device, load, excitation : str
    tables : dict
        The scene's.
    frequency : float
        The device's (Hz).
    quality : float
    level : float
        Amplitude of the sine, or rms of the rest (m/s²).
    draws : numpy.random.Generator
        For what a command draws further.
    """

    seed: int
    number: int
    command: str
    device: str
    load: str
    excitation: str
    tables: dict
    frequency: float
    quality: float
    level: float
    draws: np.random.Generator

    @property
    def words(self):
        """The case in words, by which `ONLY` chooses."""
        return f"{self.command}: {self.device}, {self.load}, {self.excitation}"

    def scene(self, **tables):
        """The scene, with other tables where they are given."""
        return Scene.from_tables({**self.tables, **tables}, name=f"case {self.number}")


class _Draws:
    """Log-uniform and uniform numbers of one generator."""

    def __init__(self, generator):
        self.generator = generator

    def log(self, low, high):
        return float(np.exp(self.generator.uniform(math.log(low), math.log(high))))

    def flat(self, low, high):
        return float(self.generator.uniform(low, high))

    def one(self, values):
        return values[int(self.generator.integers(len(values)))]


def drawn(seed: int, number: int, folder: Path) -> Case:
    """The case of a seed and a number; its record is written to the folder."""
    generator = np.random.default_rng(np.random.SeedSequence([seed, number]))
    draw = _Draws(generator)
    command = COMMANDS[number % len(COMMANDS)]
    devices, loads, excitations = TAKEN.get(command, (DEVICES, LOADS, EXCITATIONS))
    device, excitation = draw.one(devices), draw.one(excitations)
    if device == "coil" or (command in ONE_ATTRACTOR and device not in ("linear", "beam")):
        loads = ("resistor",)
    if command == "average" and device not in LINEAR:
        excitation = "noise"
    # Each other case has a resistor, whose truth is independent of the project's integrators.
    load = "resistor" if draw.flat(0.0, 1.0) < 0.5 else draw.one(loads)
    tables, known = (_beam if device == "beam" else _lumped)(draw, device)
    tables["load"] = _load(draw, load, tables, known)
    tables["excitation"], level = _excitation(draw, device, excitation, known, folder / f"{number}")
    tables["run"] = _run(draw, excitation, known, seed, load)
    if device in SEVERAL_WELLS and excitation in (*SINES, *RECORDS):
        tables["start"] = {"displacement": known["length"] * draw.one((-1.0, 1.0))}
    case = Case(
        seed, number, command, device, load, excitation, tables, known["frequency"],
        known["quality"], level, generator,
    )  # fmt: skip
    return case


def _lumped(draw, device):
    """Tables of a device by its values, and what follows from them."""
    f0, mass = draw.log(5.0, 200.0), draw.log(1e-3, 0.1)
    omega = 2.0 * math.pi * f0
    quality = draw.log(8.0, 300.0 if device == "linear" else 60.0)
    stiffness, damping = mass * omega**2, mass * omega / quality
    coupling2, cp = draw.log(0.003, 0.2), draw.log(5e-9, 200e-9)
    theta = math.sqrt(coupling2 * stiffness * cp)
    length = draw.log(4.0, 40.0) * cp / theta
    if device == "coil":
        length = draw.log(0.5e-3, 5e-3)
    k = stiffness
    spring = {
        "linear": [0.0, k],
        "coil": [0.0, k],
        "stopper": [0.0, k],
        "hardening": [0.0, k, 0.0, k / length**2],
        "bistable": [0.0, -0.5 * k, 0.0, 0.5 * k / length**2],
    }
    inner = draw.flat(0.5, 0.7)
    bent, high = (1.0 + inner**-2) / length**2, inner**-2 / length**4
    spring["tristable"] = [0.0, k, 0.0, -k * bent, 0.0, k * high]
    oscillator = {"mass": mass, "damping": damping, "restoring_force": spring[device]}
    tables = {"units": "SI", "oscillator": oscillator}
    known = {
        "frequency": f0, "quality": quality, "mass": mass, "stiffness": stiffness,
        "length": length, "capacitance": cp, "coupling": theta, "damping": damping,
    }  # fmt: skip
    if device == "stopper":
        tables["stoppers"] = [
            {
                "side": "right", "gap": length,
                "stiffness": k * draw.log(20.0, 300.0) / length**0.5,
                "restitution": draw.flat(0.4, 0.95),
            }
        ]  # fmt: skip
    if device == "coil":
        winding = draw.log(50.0, 2000.0)
        known["winding"], ratio = winding, draw.log(0.3, 10.0)
        known["load"] = ratio * winding
        loop = winding + known["load"]
        tables["coil"] = {
            "coupling": math.sqrt(damping * draw.log(0.1, 3.0) * loop), "resistance": winding,
        }  # fmt: skip
        if draw.flat(0.0, 1.0) < 0.5:
            tables["coil"]["inductance"] = draw.log(0.01, 0.5) * loop / omega
    else:
        tables["piezo"] = {"coupling": theta, "capacitance": cp}
    return tables, known


def _beam(draw, device):
    """A bimorph of drawn sizes; its values are those that the program derives."""
    length = draw.log(25e-3, 90e-3)
    tables = {
        "units": "SI",
        "beam": {
            "length": length, "width": length * draw.flat(0.15, 0.6),
            "material": draw.one(("brass", "aluminium", "stainless steel")),
            "thickness": length * draw.log(0.002, 0.01), "piezo": draw.one(("PZT-5A", "PZT-5H")),
            "piezo_thickness": length * draw.log(0.003, 0.008), "layers": 2,
            "connection": draw.one(("series", "parallel")), "tip_mass": draw.log(1e-3, 20e-3),
            "quality_factor": draw.log(15.0, 100.0),
        },
        "load": {"resistance": 1e5},
        "excitation": {"kind": "white", "intensity": 1e-3},
        "run": {"duration": 1.0},
    }  # fmt: skip
    scene = Scene.from_tables(tables, name="beam")
    f0 = timescales.angular_frequency(prepared(scene).system) / (2.0 * math.pi)
    oscillator, piezo = scene.oscillator, scene.transducer
    length = draw.log(4.0, 40.0) * piezo.capacitance / piezo.coupling
    known = {
        "frequency": f0, "quality": tables["beam"]["quality_factor"], "mass": oscillator.mass,
        "stiffness": oscillator.linear_stiffness, "length": length,
        "capacitance": piezo.capacitance, "coupling": piezo.coupling,
        "damping": oscillator.damping,
    }  # fmt: skip
    return tables, known


def _load(draw, load, tables, known):
    if "load" in known:
        return {"kind": "resistor", "resistance": known["load"]}
    omega, cp = 2.0 * math.pi * known["frequency"], known["capacitance"]
    if load == "resistor":
        return {"kind": "resistor", "resistance": draw.log(0.1, 10.0) / (omega * cp)}
    resistance = draw.log(0.7, 20.0) / (omega * cp)
    periods = draw.log(30.0, 300.0) if load == "store" else draw.log(3.0, 10.0)
    parameters = {"resistance": resistance, "storage": periods / known["frequency"] / resistance}
    if load == "SSHI":
        period = 1.0 / known["frequency"]
        parameters |= {
            "capacitance": cp, "inversion_time": period / 200.0, "sense_time": period / 400.0,
            "quality": draw.log(3.0, 10.0),
            "threshold": 0.01 * known["coupling"] * omega * known["length"],
        }  # fmt: skip
    return {"netlist": NETLISTS[load], "parameters": parameters}


def _excitation(draw, device, excitation, known, file):
    """Its table, and the amplitude or rms (m/s²)."""
    f0, quality, length = known["frequency"], known["quality"], known["length"]
    omega = 2.0 * math.pi * f0
    several = device in SEVERAL_WELLS
    force = omega**2 * length
    if device in LINEAR or device == "stopper":
        # Off the peak the amplitude rises with the distance: about one length in any case.
        amplitude, ratio = force * draw.log(0.7, 3.0), 1.0 + draw.flat(-2.0, 2.0) / quality
        if draw.flat(0.0, 1.0) < 0.25:
            ratio = draw.log(0.3, 3.0)
        amplitude *= abs(complex(1.0 - ratio**2, ratio / quality))
    elif device == "hardening":
        amplitude, ratio = force * draw.log(0.02, 0.3), draw.flat(0.8, 1.6)
    else:
        amplitude, ratio = force * draw.log(0.03, 0.5), draw.flat(0.3, 1.3)
    sine = {"kind": "sine", "amplitude": amplitude, "frequency": f0 * ratio}
    if excitation == "sine":
        return {**sine, "phase": draw.flat(0.0, 6.0)}, amplitude
    if excitation == "two sines":
        second = {
            "kind": "sine", "amplitude": amplitude * draw.log(0.3, 1.0),
            "frequency": f0 * ratio * draw.one((0.5, 0.75, 1.0, 1.25, 1.5, 2.0)),
            "phase": draw.flat(0.0, 6.0),
        }  # fmt: skip
        return {"kind": "sum", "parts": [sine, second]}, amplitude
    # Temperature of the mass: what white noise of the density at f0 gives.
    size = draw.log(0.1, 2.0) / 8.0 if several else draw.log(0.2, 2.0)
    temperature = size * omega**2 * length**2
    density = 4.0 * temperature * known["damping"] / known["mass"]
    noise, rms = _noise(draw, excitation, density, f0, quality)
    if excitation == "noise + sine":
        sine["amplitude"] *= 0.5
        return {"kind": "sum", "parts": [noise, sine]}, rms
    if excitation in RECORDS:
        return _record(draw, excitation, density, force, f0, quality, file), rms
    return noise, rms


def _noise(draw, excitation, density, f0, quality):
    """Noise whose one-sided density at the device's frequency is given."""
    if "spectrum" not in excitation:
        memory = draw.log(0.02, 0.5) / f0
        intensity = 0.25 * density * (1.0 + (2.0 * math.pi * f0 * memory) ** 2)
        table = {"kind": "ornstein-uhlenbeck", "intensity": intensity, "correlation_time": memory}
        return table, math.sqrt(intensity / memory)
    if excitation == "narrow spectrum":
        width = draw.log(0.05, 0.3)
        edges = np.array([1.0 - width, 1.0 - 0.5 * width, 1.0 + 0.5 * width, 1.0 + width])
        levels = np.array([0.01, 1.0, 1.0, 0.01])
    else:
        edges = np.array([draw.log(0.1, 0.5), draw.flat(0.8, 1.2), draw.log(2.0, 6.0)])
        levels = np.array([draw.log(0.1, 1.0), 1.0, draw.log(0.1, 1.0)])
    points = np.column_stack([edges * f0, levels * density]).tolist()
    rms = math.sqrt(np.trapezoid(levels * density, edges * f0))
    table = {
        "kind": "spectrum", "unit": "(m/s^2)^2/Hz", "breakpoints": points, "source": "drawn",
    }  # fmt: skip
    return table, rms


def _record(draw, excitation, density, force, f0, quality, file):
    """A record of 90 periods: band-limited noise, or pulses on a little of it."""
    spacing = 1.0 / (24.0 * f0)
    count = 24 * 90
    lines = np.fft.rfft(draw.generator.standard_normal(count))
    f = np.fft.rfftfreq(count, spacing)
    lines *= (f > 0.2 * f0) & (f < 4.0 * f0)
    values = np.fft.irfft(lines, count)
    values *= math.sqrt(4.0 * f0 * density) / values.std()
    if excitation == "pulses":
        values *= 0.05
        width = draw.log(0.2, 1.0) / f0
        times = np.arange(count) * spacing
        for begin in np.sort(draw.generator.uniform(10.0, 80.0, PULSES)) / f0:
            share = (times - begin) / width
            inside = (share > 0.0) & (share < 1.0)
            height = force * draw.log(0.5, 3.0) * draw.one((-1.0, 1.0))
            values += np.where(inside, height * np.sin(math.pi * share), 0.0)
    values -= values.mean()
    path = file.with_suffix(".csv")
    rows = np.column_stack([np.arange(count) * spacing, values])
    np.savetxt(path, rows, delimiter=",", header="time [s],acceleration [m/s^2]", comments="",
               fmt="%.12g")  # fmt: skip
    return {"kind": "record", "file": str(path)}


def _run(draw, excitation, known, seed, load):
    """Settling over three times the decay; short runs and longer ones."""
    period, quality = 1.0 / known["frequency"], known["quality"]
    settle = math.ceil(3.0 * quality) * period
    if excitation in RECORDS:
        return {"seed": seed, "settle": 5.0 * period, "duration": 84.0 * period, "realizations": 1}
    if excitation in SINES:
        return {"seed": seed, "settle": settle, "duration": 60.0 * period, "realizations": 1}
    periods, realizations = draw.log(40.0, 400.0), draw.one((4, 8, 16))
    if load != "resistor":
        periods, realizations = min(periods, 80.0), 4
    return {
        "seed": seed, "settle": settle, "duration": periods * period, "realizations": realizations,
    }  # fmt: skip
