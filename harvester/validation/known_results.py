"""The results that `verify` compares with: known_results.toml, and loads on driven devices.

A measured point's limit follows from how well it was read and from the measurement's own scatter:
at one frequency every linear device with any source impedance gives a resistor R the power
R/(a + b R + c R²), and what the points leave of the best such curve is their scatter.
"""

import hashlib
import itertools
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares, nnls

from harvester.device import timescales
from harvester.engines.request import Request
from harvester.engines.task import Task
from harvester.excitation.base import kernel_loss
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing
from harvester.validation import SIGNIFICANT_SIGMAS, entries, formulas, tasks

# Near-ideal diodes and coils, and the ripple of the storage, deviate from the closed form by this
# share; the steps of circuit and Monte Carlo; and the theory of one harmonic.
IDEAL_PARTS, STEPS, ONE_HARMONIC = 0.03, 0.005, 0.02
ENGINES = ("circuit", "monte-carlo")
# Amplitude (m) and frequency (Hz) of a piezo in prescribed motion.
AMPLITUDE, FREQUENCY = 0.005, 12.0
# Quality factor of the coil of a switched load.
QUALITIES = {"sshi_parallel": 8.0, "sshi_series": 8.0, "sece": 1000.0}
IDEAL_LOADS = (
    ("resistor", "Ohm's law", (0.3, 1.0, 4.0)),
    ("bridge", "standard interface, Ottman et al. 2002", (0.25, 1.0, 4.0)),
    ("sshi_parallel", "Guyomar et al. 2005", (1.0,)),
    ("sshi_series", "Lefeuvre et al. 2006", (1.0,)),
    ("sece", "Lefeuvre et al. 2005", (1.0,)),
)
# Distances from the resonance, in half widths, and their names.
FLANKS = ((-1.0, "on the lower flank"), (0.0, "on resonance"), (1.0, "on the upper flank"))
COUPLING = 1e-3
# A run on a measured device settles for this number of the device's time constants, and averages
# this number of periods.
SETTLING, PERIODS = 12.0, 100.0
# The rectifier's storage discharges to 1/e in 10 periods, and its runs settle for 260. The paper
# does not state the storage; the ripple of this one costs less than 0.1 % of the power.
STORED, RECTIFIED = 10.0, 260.0


@dataclass(frozen=True)
class Truth:
    """A result that this project did not compute.

    Attributes
    ----------
    source : str
        Who derived or published it.
    allowance : float
        How far off the simulated device may be because it is not quite that of the result
        (knots of the noise, diodes that are not ideal), in the unit of `exact`.
    asked : dict of str to Request or Task
        What to compute by each method; a task returns (value, standard error).
    quantity : str
        Quantity of an answer, in the scene's units.
    device : str
        Name of the device that was measured; empty for what was derived or computed.
    """

    title: str
    source: str
    exact: float
    allowance: float
    asked: dict[str, Request | Task]
    quantity: str = ""
    unit: str = "scaled"
    device: str = ""


def catalogue() -> list[Truth]:
    """All results that were derived, published or computed by other programs."""
    derived = [truth for entry in entries("known_results")["result"] for truth in _results(entry)]
    return [*derived, *_ideal_loads(), *_coupled_bridges(), *_coupled_sece(), *_flanks()]


def measured() -> list[Truth]:
    """All measured points, and the sets that the reader has downloaded."""
    points = [truth for device in entries("known_results")["device"] for truth in points_of(device)]
    return [*points, *downloaded()]


def _by(scene, methods):
    return {method: Request(scene, method) for method in methods}


def _within(share, title, source, exact, scene, methods, quantity="mean_power", unit="W"):
    """A truth that is met within a share of itself."""
    return Truth(title, source, exact, share * exact, _by(scene, methods), quantity, unit)


def _highest(scenes, engine, quantity):
    """The task of the largest value of a quantity among some scenes."""
    call = {"scenes": scenes, "engine": engine, "quantity": quantity}
    return {engine: Task(tasks.highest, call, label="highest", time_limits=len(scenes))}


def _results(entry):
    """The truths of one `result`, one for each of its cases."""
    for case in entry.get("each", [{}]):
        values = {**entry, **case}
        changes, arguments, settings = (
            {**entry.get(name, {}), **case.get(name, {})}
            for name in ("changes", "arguments", "settings")
        )
        scene = Scene.read(values["scene"]).replace(changes)
        if "formula" in values:
            values["exact"] = getattr(formulas, values["formula"])(**arguments)
        exact, quantity = values["exact"], values.get("quantity", "")
        asked: dict[str, Any] = _by(scene, values["by"])
        if "task" in values:
            function = getattr(tasks, values["task"])
            for method in asked:
                call = {"scene": scene, "engine": method, **settings}
                asked[method] = Task(function, call, label=values["task"])
        elif "starts" in values:
            starts = itertools.product(*values["starts"].values())
            names = [f"start.{name}" for name in values["starts"]]
            scenes = [scene.replace(dict(zip(names, start, strict=True))) for start in starts]
            (method,) = asked
            asked = _highest(scenes, method, quantity)
        allowance = values.get(
            "allowance", (values.get("within", 0.0) + _lost(values, scene)) * exact
        )
        title, unit = values["title"] + values.get("case", ""), values.get("unit", "scaled")
        yield Truth(title, values["source"], exact, allowance, asked, quantity, unit)


def _lost(values, scene):
    """Share that noise lacks between knots: of its density, and to the device's memory."""
    if values.get("noise") == "coloured":
        # Straight lines between knots lower the variance of the noise by 1/120.
        return 1.0 / 120.0
    if "noise" not in values:
        return 0.0
    model = prepared(scene)
    system, spacing = model.system, knot_spacing(model)
    damping = system.damper.damping + system.transducer.damping()
    lost = kernel_loss(spacing, timescales.angular_frequency(system))
    return lost + damping * spacing / math.sqrt(6.0)


def _ideal_loads():
    """Loads on a piezo in prescribed motion, the switched ones at their best resistance."""
    base: Any = Scene.read("device").replace({"length_scale": None})
    piezo, period = base.transducer, 1.0 / FREQUENCY
    omega = 2.0 * math.pi * FREQUENCY
    unit = piezo.coupling**2 * AMPLITUDE**2 * omega / piezo.capacitance
    excitation = {
        "kind": "prescribed_displacement", "amplitude": AMPLITUDE, "frequency": FREQUENCY
    }  # fmt: skip
    run = {"run.duration": 10 * period, "run.settle": 40 * period, "run.realizations": 1}
    base = base.replace({"excitation": excitation, **run})
    for name, source, shares in IDEAL_LOADS:
        for share in shares:
            # ωCR, and the power there.
            ratio, exact = formulas.ideal_load(name, unit, share, QUALITIES["sshi_series"])
            resistance = ratio / (omega * piezo.capacitance)
            values: dict[str, Any] = {"resistance": resistance}
            if name in QUALITIES:
                times = {"inversion_time": period / 400.0, "sense_time": period / 1000.0}
                values |= {"quality": QUALITIES[name], "capacitance": piezo.capacitance, **times}
            ideal, quantity = STEPS, "mean_power"
            if name != "resistor":
                values |= {"diode": 0, "storage": 10.0 * period / resistance}
                values["initial"] = math.sqrt(exact * resistance)
                ideal, quantity = IDEAL_PARTS, "mean_output_power"
            scene = base.replace({"load.netlist": name, "load.parameters": values})
            ratio = resistance * omega * piezo.capacitance
            title = f"{name} on a prescribed sine, omega C R = {ratio:.3g}"
            yield _within(ideal, title, source, exact, scene, ["circuit"], quantity)


def _unit_device(device, omega, load, settle, duration=None):
    """The scene of a `Driven` device, in SI with units of 1, measured for 100 periods."""
    frequency = omega / (2.0 * math.pi)
    duration = duration or 200.0 * math.pi / omega
    tables = {
        "units": "SI",
        "length_scale": 1.0,
        "oscillator": {"mass": 1.0, "damping": device.damping, "linear_stiffness": 1.0},
        "piezo": {"coupling": device.coupling, "capacitance": device.capacitance},
        "excitation": {"kind": "sine", "amplitude": device.force, "frequency": frequency},
        "load": load,
        "run": {"seed": 1, "realizations": 1, "settle": settle, "duration": duration},
    }
    return Scene.from_tables(tables, name="unit device")


def _ideal_bridge(resistance):
    values = {"diode": 0, "resistance": resistance, "storage": 60.0 / resistance}
    return {"netlist": "bridge", "parameters": values}


def _coupled_bridges():
    for ratio in (0.01, 0.09, 0.3):
        device = formulas.Driven(3.0, 0.08, COUPLING, COUPLING**2 / ratio)
        omega, resistance, exact = formulas.best_coupled_bridge(device)
        scene = _unit_device(device, omega, _ideal_bridge(resistance), 600.0)
        title = f"coupled bridge at its best frequency and resistance, theta^2/(k Cp) = {ratio:g}"
        by, quantity = ["monte-carlo"], "mean_output_power"
        yield _within(ONE_HARMONIC, title, "Shu and Lien 2006", exact, scene, by, quantity)


def _coupled_sece():
    share = 0.005
    capacitance = COUPLING**2 / share
    values = {
        "diode": 0, "resistance": 0.1 / capacitance, "storage": 400.0 * capacitance,
        "capacitance": capacitance, "inversion_time": 0.02, "sense_time": 0.005, "quality": 1000,
        "threshold": 1e-6, "residual": 0.5,
    }  # fmt: skip
    load = {"netlist": "sece", "parameters": values}
    for figure in (0.1, math.pi / 4.0, math.pi):
        quality = figure / share
        device = formulas.Driven(100.0 / quality, 1.0 / quality, COUPLING, capacitance)
        omegas = [math.sqrt(1.0 + share * shift) for shift in (0.6, 0.8, 1.0, 1.2, 1.4)]
        scenes = [
            _unit_device(device, omega, load, 10.0 * quality, 100.0 * math.pi) for omega in omegas
        ]
        exact = formulas.coupled_sece_share(figure) * device.force**2 / (8.0 * device.damping)
        title = f"SECE at its best frequency, k^2 Q = {figure:.3g}"
        asked = _highest(scenes, "monte-carlo", "mean_power")
        source, allowance = "Lefeuvre et al. 2006", ONE_HARMONIC * exact
        yield Truth(title, source, exact, allowance, asked, "mean_power", "W")


def _flanks():
    """A resistor and a bridge on resonance and at half power beside it: steps must not shift it."""
    device = formulas.Driven(force=1e-3, damping=1e-3, coupling=COUPLING, capacitance=2e-3)
    resistance, damping = 0.2 / device.capacitance, device.damping
    for side, words in FLANKS:
        omega = 1.0 + side * 0.5 * damping
        scene = _unit_device(device, omega, {"resistance": resistance}, 25.0 / damping)
        exact = formulas.resistor_power_at(omega, resistance, device)
        title = f"resistor at Q = 1000, {words}"
        yield _within(STEPS, title, "linear circuit", exact, scene, ENGINES)
    ratio = 0.01
    device = formulas.Driven(3.0, 0.01, COUPLING, COUPLING**2 / ratio)
    resistance, damping = 0.5 * math.pi / device.capacitance, device.damping

    def power(omega):
        return formulas.coupled_bridge_power(omega, resistance, device)

    peak = max((1.0 + ratio * k / 1000.0 for k in range(1001)), key=power)
    for side, words in FLANKS:
        omega = peak * (1.0 + side * 0.5 * damping)
        scene = _unit_device(device, omega, _ideal_bridge(resistance), 40.0 / damping)
        title, quantity = f"bridge at Q = 100, {words}", "mean_output_power"
        exact, source = power(omega), "Shu and Lien 2006"
        yield _within(ONE_HARMONIC, title, source, exact, scene, ENGINES, quantity)


def points_of(device: dict[str, Any]) -> Iterator[Truth]:
    """The known results of a measured device, one for each of its points."""
    for frequency, (resistances, powers) in device["series"].items():
        share = device["reading"] + SIGNIFICANT_SIGMAS * scatter_of(device, frequency)
        for kilo, published in zip(resistances, powers, strict=True):
            power, title = device["scale"] * published, f"{device['name']}, {frequency} Hz"
            scene = _measured_scene(device, float(frequency), 1e3 * kilo, power)
            quantity = "mean_output_power" if "netlist" in device else "mean_power"
            asked = _by(scene, device["by"])
            yield Truth(
                f"{title}, {kilo:g} kΩ", device["source"], power, share * power, asked, quantity,
                "W", device["name"],
            )  # fmt: skip


def _measured_scene(device, frequency, resistance, power):
    """A cantilever's first mode in SI with a load, its base driven by a sine (Hz)."""
    lumped, load = device["lumped"], {"resistance": resistance}
    mass, stiffness, ratio = (lumped[name] for name in ("mass", "stiffness", "damping_ratio"))
    settle = SETTLING / (ratio * (stiffness / mass) ** 0.5)
    if "netlist" in device:
        load |= {
            "storage": STORED / (frequency * resistance),
            "initial": (power * resistance) ** 0.5,
        }
        load, settle = {"netlist": device["netlist"], "parameters": load}, RECTIFIED / frequency
    tables = {
        "units": "SI",
        "oscillator": {
            "mass": mass,
            "damping": 2.0 * ratio * (stiffness * mass) ** 0.5,
            "linear_stiffness": stiffness,
            "base_factor": lumped["base_factor"],
        },
        "piezo": {name: lumped[name] for name in ("coupling", "capacitance")},
        "load": load,
        "excitation": {
            "kind": "sine", "amplitude": device["acceleration"], "frequency": frequency
        },
        "run": {"seed": 1, "realizations": 1, "settle": settle, "duration": PERIODS / frequency},
    }  # fmt: skip
    return Scene.from_tables(tables, name="measured device")


def scatter_of(device: dict[str, Any], frequency: str) -> float:
    """Relative rms of a device's points at a frequency about the curve of a linear device."""
    resistances, powers = device["series"][frequency]
    scaled = [device["scale"] * power for power in powers]
    return device["scatter"] if "scatter" in device else linear_scatter(resistances, scaled)


def linear_scatter(resistances: Sequence[float], powers: Sequence[float]) -> float:
    """Relative rms of powers about the best R/(a + b R + c R²), a, b, c ≥ 0."""
    r, p = np.array(resistances, dtype=float), np.array(powers, dtype=float)
    table = np.column_stack([1.0 / r, np.ones_like(r), r]) * p[:, None]
    sizes = table.max(axis=0)
    begun = np.log(np.maximum(nnls(table / sizes, np.ones_like(r))[0], 1e-9) / sizes)

    def residuals(logarithms: np.ndarray) -> np.ndarray:
        a, b, c = np.exp(logarithms)
        return np.log(p * (a / r + b + c * r))

    return float(np.sqrt(np.sum(least_squares(residuals, begun).fun ** 2) / (r.size - begun.size)))


def downloaded() -> list[Truth]:
    """A row of each set, which says how to get it where it is not there."""
    return [_set(entry) for entry in entries("known_results")["set"]]


def _set(entry):
    place = Path(os.environ.get(entry["variable"], ""))
    files = sorted(place.glob(entry["files"])) if "files" in entry else [place]
    exists = bool(files) and all(file.is_file() for file in files)
    content = b"".join(file.read_bytes() for file in files) if exists else b""
    call = {
        "place": os.path.abspath(place) if exists else "",
        "digest": hashlib.sha256(content).hexdigest(),
        "scene": Scene.from_tables(entry["scene"], name=entry["variable"].lower()),
        "missing": f"{entry['variable']} {entry['missing']}: {entry['cure']}",
    }
    function = getattr(tasks, entry["task"])
    task = Task(function, call, label=entry["task"], time_limits=entry["time_limits"])
    values = [entry[name] for name in ("title", "source", "exact", "allowance")]
    return Truth(*values, {"identify": task}, unit=entry["unit"], device=entry["device"])
