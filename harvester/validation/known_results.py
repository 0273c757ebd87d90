"""The known results for `verify`: the entries of known_results.toml.

A measured point's limit follows from reading accuracy and the measurement's scatter. At one
frequency a linear device with any source impedance gives a resistor R the power R/(a + b R + c R²);
deviations from the best such curve are the scatter.
"""

import functools
import hashlib
import itertools
import math
import operator
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares, nnls

from harvester.base.errors import ProgramNotFound
from harvester.device import timescales
from harvester.engines.request import Request
from harvester.engines.task import Task
from harvester.excitation.base import kernel_loss
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing
from harvester.statistics.agreement import SIGNIFICANT_SIGMAS
from harvester.validation import entries, formulas, tasks

# Number of averaged periods in a measured device's run, and time constant of a rectifier's storage
# capacitor in periods. The paper does not state the latter; the ripple changes the power by less
# than 0.1 %.
PERIODS, STORED = 100.0, 10.0


@dataclass(frozen=True)
class Truth:
    """A result from outside this project.

    Attributes
    ----------
    source : str
        Author or publication.
    allowance : float
        Allowed deviation due to slight differences of the simulated device (noise knots, non-ideal
        diodes), in the unit of `exact`.
    asked : dict of str to Request, Task or ProgramNotFound
        Computation by each method; a task returns (value, standard error). For a missing data set:
        how to download it.
    quantity : str
        Quantity of an answer, in the scene's units.
    device : str
        Name of a measured device; else empty.
    """

    title: str
    source: str
    exact: float
    allowance: float
    asked: dict[str, Request | Task | ProgramNotFound]
    quantity: str = ""
    unit: str = "scaled"
    device: str = ""


def catalogue() -> list[Truth]:
    """All derived, published, and otherwise computed results."""
    results = entries("known_results")["result"]
    return [_truth(entry, case) for entry in results for case in entry.get("each", [{}])]


def measured() -> list[Truth]:
    """All measured points, and downloaded data sets."""
    points = [truth for device in entries("known_results")["device"] for truth in points_of(device)]
    return [*points, *downloaded()]


def _truth(entry, case):
    """The known result of one case of an entry; the case's keys extend the entry's."""
    tables = ("changes", "arguments", "settings")
    values = entry | case | {name: entry.get(name, {}) | case.get(name, {}) for name in tables}
    base, changes = values["scene"], values["changes"].items()
    scene: Any = (
        Scene.read(base) if isinstance(base, str) else Scene.from_tables(base, name="unit device")
    )
    scene = scene.replace({key: None if value == "none" else value for key, value in changes})
    exact = values["exact"] if "exact" in values else _by_formula(values, scene)
    share = values.get("within", 0.0) + _lost(values, scene)
    return Truth(
        title=values["title"] + values.get("case", ""),
        source=values["source"],
        exact=exact,
        allowance=values.get("allowance", share * exact),
        asked={method: _question(values, scene, method) for method in values["by"]},
        quantity=values.get("quantity", ""),
        unit=values.get("unit", "scaled"),
        device=values.get("device", ""),
    )


def _question(values, scene, method):
    """Computation by one method: a mean of a run, the largest of several, or a task."""
    if "among" in values:
        keys, ranges = zip(*values["among"].items(), strict=True)
        cases = itertools.product(*ranges)
        scenes = [scene.replace(dict(zip(keys, case, strict=True))) for case in cases]
        call = {"scenes": scenes, "engine": method, "quantity": values["quantity"]}
        return Task(tasks.highest, call, label="highest", time_limits=len(scenes))
    if "task" in values:
        call = {"scene": scene, "engine": method, **values["settings"]}
        return Task(getattr(tasks, values["task"]), call, label=values["task"])
    return Request(scene, method)


def _by_formula(values, scene):
    """The value of a formula, whose arguments are numbers or keys of the scene."""
    tables = scene.to_tables()

    def number(value):
        if not isinstance(value, str):
            return value
        return functools.reduce(operator.getitem, value.split("."), tables)

    formula = getattr(formulas, values["formula"])
    return formula(**{name: number(value) for name, value in values["arguments"].items()})


def _lost(values, scene):
    """Relative loss by interpolation between knots: of noise density, and by damping in between."""
    if values.get("noise") == "coloured":
        # Linear interpolation lowers the variance of the noise by 1/120.
        return 1.0 / 120.0
    if "noise" not in values:
        return 0.0
    model = prepared(scene)
    system, spacing = model.system, knot_spacing(model)
    damping = system.damper.damping + system.transducer.damping()
    lost = kernel_loss(spacing, timescales.angular_frequency(system))
    return lost + damping * spacing / math.sqrt(6.0)


def points_of(device: dict[str, Any]) -> Iterator[Truth]:
    """The known results of a measured device, one per point."""
    rectified = "netlist" in device["scene"]["load"]
    for frequency, (resistances, powers) in device["series"].items():
        share = device["reading"] + SIGNIFICANT_SIGMAS * scatter_of(device, frequency)
        for kilo, published in zip(resistances, powers, strict=True):
            power, hertz, load = device["scale"] * published, float(frequency), {}
            load["resistance"] = resistance = 1e3 * kilo
            if rectified:
                load["storage"] = STORED / (hertz * resistance)
                load["initial"] = (power * resistance) ** 0.5
            changes = {"excitation.frequency": hertz, "run.duration": PERIODS / hertz}
            title = f"{device['name']}, {frequency} Hz, {kilo:g} kΩ"
            point = {"title": title, "device": device["name"], "unit": "W"}
            point |= {"exact": power, "within": share}
            point["changes"] = {**changes, "load.parameters" if rectified else "load": load}
            yield _truth(device, point)


def scatter_of(device: dict[str, Any], frequency: str) -> float:
    """Relative rms deviation of a device's points at a frequency from a linear device's curve."""
    resistances, powers = device["series"][frequency]
    scaled = [device["scale"] * power for power in powers]
    return device["scatter"] if "scatter" in device else linear_scatter(resistances, scaled)


def linear_scatter(resistances: Sequence[float], powers: Sequence[float]) -> float:
    """Relative rms deviation of powers from the best R/(a + b R + c R²), a, b, c ≥ 0."""
    r, p = np.array(resistances, dtype=float), np.array(powers, dtype=float)
    table = np.column_stack([1.0 / r, np.ones_like(r), r]) * p[:, None]
    sizes = table.max(axis=0)
    begun = np.log(np.maximum(nnls(table / sizes, np.ones_like(r))[0], 1e-9) / sizes)

    def residuals(logarithms: np.ndarray) -> np.ndarray:
        a, b, c = np.exp(logarithms)
        return np.log(p * (a / r + b + c * r))

    return float(np.sqrt(np.sum(least_squares(residuals, begun).fun ** 2) / (r.size - begun.size)))


def downloaded() -> list[Truth]:
    """A row per data set, with download instructions if it is missing."""
    return [_set(entry) for entry in entries("known_results")["set"]]


def _set(entry):
    name = os.environ.get(entry["variable"], "")
    folder = Path(name)
    files = [folder]
    if "files" in entry:
        files = sorted(folder / file for file in getattr(tasks, entry["files"]).values())
    question: Any = ProgramNotFound(f"not downloaded: {entry['cure']}")
    if name and all(file.is_file() for file in files):
        content = b"".join(file.read_bytes() for file in files)
        call = {
            "place": os.path.abspath(folder),
            "digest": hashlib.sha256(content).hexdigest(),
            "scene": Scene.from_tables(entry["scene"], name=entry["variable"].lower()),
        }
        limits = entry["time_limits"]
        question = Task(getattr(tasks, entry["task"]), call, "", entry["task"], limits)
    elif name:
        question = ProgramNotFound(f"{entry['variable']} = {name}: other data; {entry['cure']}")
    names = ("title", "source", "exact", "allowance", "unit", "device")
    return Truth(asked={"identify": question}, **{name: entry[name] for name in names})
