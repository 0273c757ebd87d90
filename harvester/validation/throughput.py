"""Measures the simulated time per second of each variant of the circuit."""

import datetime
import math
import os
import platform
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from circuits.equivalent.export import longest_in_contact
from harvester.base.worker_pool import WorkerPool, Workers
from harvester.engines.codec import register
from harvester.engines.methods import Circuit
from harvester.engines.realization import run
from harvester.engines.side_by_side import MOST_COPIES
from harvester.engines.task import Task
from harvester.scene.model import Scene
from harvester.scene.prepared import Prepared
from harvester.scene.steps import knot_spacing
from harvester.validation.paths import from_rest

# Knots per realization. The time of a PWL source depends on this, since ngspice scans its points.
KNOTS = 20_000
# Number of measurements, of which the fastest is used, since other work slows runs down.
REPEATS = 5


@register
@dataclass(frozen=True)
class Throughput:
    """One variant of running the circuit.

    Attributes
    ----------
    copies : int
        Realizations per netlist.
    rate : float
        Simulated seconds per second, sum over realizations.
    """

    name: str
    copies: int
    processes: int
    rate: float


def task(scene: Scene, version: str) -> Task:
    """The task that measures all variants of a scene's circuit; `version`: the engine's."""
    settings = {"compiled": "compiled" in version, "knots": KNOTS, "repeats": REPEATS}
    return Task(measured_alone, {"scene": scene, **settings}, version, "throughput")


def measured_alone(
    prepared_scene: Prepared, compiled: bool, knots: int, repeats: int, report: Callable
) -> dict[str, Any]:
    """The `rows` of `measure` and the `machine`, measured in a worker with separate processes."""
    with WorkerPool(workers=2) as pool:
        return {
            "rows": measure(prepared_scene, pool, compiled, knots, repeats),
            "machine": machine(),
        }


def machine() -> dict[str, Any]:
    return {
        "date": datetime.date.today().isoformat(),
        "cores": os.cpu_count(),
        "processor": platform.processor() or platform.machine(),
        "system": platform.platform(),
        "python": platform.python_version(),
    }


def measure(
    model: Prepared, pool: Workers, compiled: bool, knots: int, repeats: int
) -> list[Throughput]:
    """Measure every variant of a scene's circuit; the best of `repeats` measurements is used.

    The first variant is a source in the netlist, the second one realization with the external
    source, both with steps of one knot, or the longest that a contact allows; the others have the
    default step. The ratio of two processes to one needs two workers.
    """
    most, many = MOST_COPIES["behavioural"], MOST_COPIES["compiled"]
    spacing = knot_spacing(model)
    knot = {"step": min(spacing, longest_in_contact(model.system) or spacing)}
    ways: list[tuple[str, int, int, dict[str, Any]]] = [
        ("external source, a step a knot", 1, 1, knot),
        ("one realization", 1, 1, {}),
        ("side by side in one netlist", most, 1, {}),
        ("two processes", 1, 2, {}),
    ]
    if compiled:
        option = {"device": "compiled"}
        ways += [("compiled device", copies, 1, option) for copies in (1, most, many)]

    def rate(name, copies, processes, options):
        """Time some concurrent netlists, each with some copies; more copies have fewer knots."""
        count = math.ceil(knots / math.sqrt(copies))
        call = {
            "prepared_scene": from_rest(model, count, copies * processes),
            "engine": Circuit(**{"device": "behavioural", **options}),
            "window": None,
        }
        firsts = range(0, copies * processes, copies)
        calls = [{**call, "indices": list(range(first, first + copies))} for first in firsts]
        done = [realization for netlist in pool.map(run, calls) for realization in netlist]
        seconds = max(r.ended for r in done) - min(r.started for r in done)
        return Throughput(name, copies, processes, len(done) * count * spacing / seconds)

    pwl = rate("PWL in the netlist", 1, 1, {**knot, "source": "pwl"})
    # The variants are measured alternately, so that other work on the machine affects all equally.
    rounds = [[rate(*way) for way in ways] for _ in range(repeats)]
    return [pwl, *(max(rows, key=lambda row: row.rate) for rows in zip(*rounds, strict=True))]


def ratios(rows: list[Throughput]) -> dict[str, float]:
    """{name: ratio}: external source to PWL, and every variant to one realization."""
    if not rows:
        return {}
    pwl, external, single = rows[:3]
    speed_ratios = {f"{external.name} / {pwl.name}": external.rate / pwl.rate}
    for row in rows[3:]:
        name = f"{row.copies} × {row.name}" if row.copies > 1 else row.name
        speed_ratios[f"{name} / {single.name}"] = row.rate / single.rate
    return speed_ratios
