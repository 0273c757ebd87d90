"""Simulated time per second of each way to run the circuit, as ratios measured in one run."""

import math
from dataclasses import dataclass

from harvester.batches import MOST_COPIES
from harvester.output import finite
from harvester.parameters import knot_spacing

# Knots of a realization: a source in the netlist is scanned point by point, so its cost depends
# on how many it has.
KNOTS = 20_000
# Of each measurement the best of so many counts: other work on the machine only slows it down.
REPEATS = 3


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


def measure(scene, pool, compiled):
    """Measure every way to run a scene's circuit at its default step.

    Parameters
    ----------
    scene : Scene
    pool : harvester.workers.WorkerPool
        With two workers or more for the ratio of two processes to one.
    compiled : bool
        The compiled device is on.

    Returns
    -------
    list of Throughput
        The first is a source in the netlist, the second one realization by the external source.
    """
    most, many = MOST_COPIES["behavioural"], MOST_COPIES["compiled"]
    ways = [
        ("one realization", "behavioural", 1, 1),
        ("side by side in one netlist", "behavioural", most, 1),
        ("two processes", "behavioural", 1, 2),
    ]
    if compiled:
        ways += [("compiled device", "compiled", copies, 1) for copies in (1, most, many)]
    rows = [_measure(scene, pool, "PWL in the netlist", 1, source="pwl", repeats=1)]
    for name, device, copies, processes in ways:
        rows.append(_measure(scene, pool, name, copies, processes, device=device))
    return rows


def ratios(rows):
    """Rate of each over that of one realization, and of this over the PWL's, {name: ratio}."""
    pwl, single = rows[:2]
    found = {f"{single.name} / {pwl.name}": single.rate / pwl.rate}
    for row in rows[2:]:
        name = f"{row.copies} × {row.name}" if row.copies > 1 else row.name
        found[f"{name} / {single.name}"] = row.rate / single.rate
    return found


def to_dict(rows):
    """Plain values for JSON."""
    return {
        "rows": [{**vars(row), "rate": finite(row.rate)} for row in rows],
        "ratios": {name: finite(ratio) for name, ratio in ratios(rows).items()},
    }


def _measure(
    scene, pool, name, copies, processes=1, source="external", device="behavioural", repeats=REPEATS
):
    """Rate of so many netlists at a time, each with so many copies."""
    spacing = knot_spacing(scene)
    # Enough knots for a good clock, and no more of them the more copies there are.
    knots = math.ceil(KNOTS / math.sqrt(copies))
    brief = scene.replace(
        run={"duration": knots * spacing, "settle": 0.0, "realizations": copies * processes},
        excitation={"knot_spacing": spacing},
    )
    calls = [
        {
            "scene": brief,
            "engine": "circuit",
            "indices": list(range(first, first + copies)),
            "step": "default",
            "source": source,
            "window": None,
            "device": device,
        }
        for first in range(0, copies * processes, copies)
    ]
    best = 0.0
    for _ in range(repeats):
        done = [
            realization
            for netlist in pool.map("harvester.realization:run", calls)
            for realization in netlist
        ]
        seconds = max(r.ended for r in done) - min(r.started for r in done)
        best = max(best, len(done) * knots * spacing / seconds)
    return Throughput(name, copies, processes, best)
