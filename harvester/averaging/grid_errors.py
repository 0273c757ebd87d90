"""What grids of an answer tell that differ in one respect: means, and how well they are known.

A respect is "steps", "nodes" of X and X', or "charges", the nodes of Z. Grids are a list of
solutions for each, from the coarsest to the finest; the first of "nodes" is the first of all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from harvester.averaging.region import NODE_REFINEMENT

if TYPE_CHECKING:
    from harvester.averaging.solution import Solution

    Grids = dict[str, list[Solution]]
    Numbers = dict[str, float]

# Share of Richardson's correction for the step that is made: where steps are long, errors are of
# higher order than the second. Share of it, and of the last change by nodes, stated as error.
CORRECTION_TAKEN, STATED_ERROR = 0.6, {"steps": 0.7, "nodes": 0.75, "charges": 0.75}
# Doubt in nodes between which a contact goes and comes back: of first order.
UNRESOLVED = 1.0 / (NODE_REFINEMENT - 1.0)
JUDGED = (
    "mean_square_voltage",
    "power_conversion_efficiency",
    "mean_square_velocity",
    "mean_square_displacement",
)
# An efficiency's error beyond the second is judged as a share of the first at most: where 1 % of a
# high one would be more, 0.3 points are asked for.
HIGH_EFFICIENCY, FEW_POINTS = 0.3, 3e-3


def changed(solutions: list[Solution], judged: Sequence[str]) -> tuple[str, float]:
    """The judged mean that changes most from the last grid but one to the last, and its share."""
    before, last = (means_of(each.totals) for each in solutions[-2:])
    return worst(last, {name: abs(last[name] - before[name]) for name in judged}, judged)


def compared(grids: Grids, find: Callable[[Solution], Numbers | None]) -> tuple[Numbers, Numbers]:
    """What `find` gives, and its errors: what the two grids of each respect changed, as a whole.

    Empty where it takes too many steps.
    """
    solutions = {id(each): each for pair in grids.values() for each in pair}
    found = {}
    for key, each in solutions.items():
        values = find(each)
        if values is None:
            return {}, {}
        found[key] = values
    changes = [
        {name: found[id(last)][name] - value for name, value in found[id(first)].items()}
        for first, last in grids.values()
    ]
    start = found[id(grids["nodes"][0])]
    return (
        {name: value + sum(each[name] for each in changes) for name, value in start.items()},
        {name: sum(abs(each[name]) for each in changes) for name in start},
    )


def corrected(grids: Grids) -> tuple[Numbers, dict[str, Numbers]]:
    """Means without the errors that grids tell, and what of these is in doubt, by respect.

    The errors of steps and nodes add up, so that each is known from grids that differ in it alone:
    the step's is of second order or higher and most of it taken off; that of nodes vanishes faster.
    """
    sooner, soonest = grids["steps"][-2:]
    left = 1.0 / ((soonest.steps / sooner.steps) ** 2 - 1.0)
    doubted = STATED_ERROR | {"steps": left * STATED_ERROR["steps"]}
    if grids["nodes"][-1].unresolved:
        doubted["nodes"] = UNRESOLVED
    taken = {"steps": CORRECTION_TAKEN * left}
    means = _combined(grids, taken)
    errors = {}
    for respect, doubt in doubted.items():
        less = _combined(grids, taken | {respect: taken.get(respect, 0.0) - doubt})
        errors[respect] = {name: abs(mean - less[name]) for name, mean in means.items()}
    return means, errors


def _combined(grids, further):
    """Means with all that finer grids changed, and further shares of each respect's last change."""
    totals = dict(grids["nodes"][0].totals)
    for respect, solutions in grids.items():
        first, before, last = (solutions[k].totals for k in (0, max(len(solutions) - 2, 0), -1))
        for name in totals:
            change = last[name] - first[name]
            totals[name] += change + further.get(respect, 0.0) * (last[name] - before[name])
    return means_of(totals)


def means_of(totals: Numbers) -> Numbers:
    """The totals, and what the power that comes in turns to."""
    means = dict(totals)
    power_in = means.pop("power_in")
    power = means["mean_power"]
    loss = power_in - power - means["mean_transducer_loss"]
    return means | {
        "mechanical_loss": loss,
        "power_conversion_efficiency": power / power_in,
    }


def worst(means: Numbers, error: Numbers, judged: Sequence[str] = JUDGED) -> tuple[str, float]:
    """The judged mean with the largest error as a share of it, in words, and that share."""
    scale = {name: abs(means[name]) or np.inf for name in judged}
    if (efficiency := "power_conversion_efficiency") in scale and error[efficiency] > FEW_POINTS:
        scale[efficiency] = min(scale[efficiency], HIGH_EFFICIENCY)
    excess = {name: error[name] / scale[name] for name in judged}
    name = max(excess, key=excess.__getitem__)
    return name, excess[name]
