"""Simulated time per second of each way to run the circuit, as ratios measured in one run."""

import datetime
import math
import os
import platform
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from harvester.files.writing import finite
from harvester.prepared.prepared import prepared
from harvester.prepared.steps import knot_spacing
from harvester.running.codec import register
from harvester.running.task import Task
from harvester.scene.model import Scene
from harvester.simulation.realization import run
from harvester.simulation.side_by_side import MOST_COPIES
from harvester.workers.pools import WorkerPool, Workers

# Knots of a realization: a source in the netlist is scanned point by point, so its cost depends
# on how many it has.
KNOTS = 20_000
# Of each measurement the best of so many counts: other work on the machine only slows it down.
REPEATS = 5


@register
@dataclass(frozen=True)
class Throughput:
    """One way to run the circuit.

    Attributes
    ----------
    name : str
    copies : int
        Realizations side by side in each netlist.
    processes : int
    rate : float
        Simulated seconds per second, all realizations together.
    """

    name: str
    copies: int
    processes: int
    rate: float


def task(scene: Scene, version: str) -> Task:
    """The task of every way to run a scene's circuit; `version` is that of the circuit."""
    arguments = {
        "scene": scene,
        "compiled": "compiled" in version,
        "knots": KNOTS,
        "repeats": REPEATS,
    }
    return Task(measured_alone, arguments, version, "throughput")


def measured_alone(
    scene: Scene, compiled: bool, knots: int, repeats: int, report: Callable
) -> dict[str, Any]:
    """See `measure`; in a worker process, on processes of its own.

    Returns
    -------
    dict
        `rows`, a list of Throughput, and the `machine` that they were measured on.
    """
    with WorkerPool(workers=2) as pool:
        return {"rows": measure(scene, pool, compiled, knots, repeats), "machine": machine()}


def machine() -> dict[str, Any]:
    """What the times are measured on, and when."""
    return {
        "date": datetime.date.today().isoformat(),
        "cores": os.cpu_count(),
        "processor": platform.processor() or platform.machine(),
        "system": platform.platform(),
        "python": platform.python_version(),
    }


def measure(
    scene: Scene, pool: Workers, compiled: bool, knots: int, repeats: int
) -> list[Throughput]:
    """Measure every way to run a scene's circuit, at its default step where none is named.

    Parameters
    ----------
    scene : Scene
    pool : harvester.workers.pools.WorkerPool
        With two workers or more for the ratio of two processes to one.
    compiled : bool
        The compiled device is on.
    knots, repeats : int
        Of a realization, and measurements of which the best counts.

    Returns
    -------
    list of Throughput
        The first is a source in the netlist, the second one realization by the external source,
        both with one knot as the longest step; the third one realization at the default step.
    """
    most, many = MOST_COPIES["behavioural"], MOST_COPIES["compiled"]
    ways = [
        ("one realization", 1, 1, "behavioural"),
        ("side by side in one netlist", most, 1, "behavioural"),
        ("two processes", 1, 2, "behavioural"),
    ]
    if compiled:
        ways += [("compiled device", copies, 1, "compiled") for copies in (1, most, many)]
    on = {"scene": scene, "pool": pool, "knots": knots}
    knot = {**on, "step": knot_spacing(prepared(scene))}
    pwl = _measure("PWL in the netlist", 1, source="pwl", **knot)
    # In turn, so that what else the machine does meets all of them alike.
    rounds = [
        [
            _measure("external source, a step a knot", 1, **knot),
            *(_measure(*way, **on) for way in ways),
        ]
        for _ in range(repeats)
    ]
    return [pwl, *(max(rows, key=lambda row: row.rate) for rows in zip(*rounds, strict=True))]


def ratios(rows: list[Throughput]) -> dict[str, float]:
    """External source over PWL, and every way over one realization, {name: ratio}."""
    if not rows:
        return {}
    pwl, external, single = rows[:3]
    found = {f"{external.name} / {pwl.name}": external.rate / pwl.rate}
    for row in rows[3:]:
        name = f"{row.copies} × {row.name}" if row.copies > 1 else row.name
        found[f"{name} / {single.name}"] = row.rate / single.rate
    return found


def to_dict(rows: list[Throughput]) -> dict[str, Any]:
    """Plain values for JSON."""
    return {
        "rows": [{**vars(row), "rate": finite(row.rate)} for row in rows],
        "ratios": {name: finite(ratio) for name, ratio in ratios(rows).items()},
    }


def _measure(
    name,
    copies,
    processes=1,
    device="behavioural",
    *,
    scene,
    pool,
    knots,
    source="external",
    step="default",
):
    """Rate of so many netlists at a time, each with so many copies."""
    spacing = knot_spacing(prepared(scene))
    # Enough knots for a good clock, and no more of them the more copies there are.
    knots = math.ceil(knots / math.sqrt(copies))
    brief = scene.replace(
        run={"duration": knots * spacing, "settle": 0.0, "realizations": copies * processes},
        excitation={"knot_spacing": spacing},
    )
    calls = [
        {
            "scene": brief,
            "engine": "circuit",
            "indices": list(range(first, first + copies)),
            "step": step,
            "source": source,
            "window": None,
            "device": device,
        }
        for first in range(0, copies * processes, copies)
    ]
    netlists = pool.map(run, calls)
    done = [realization for netlist in netlists for realization in netlist]
    seconds = max(r.ended for r in done) - min(r.started for r in done)
    return Throughput(name, copies, processes, len(done) * knots * spacing / seconds)
