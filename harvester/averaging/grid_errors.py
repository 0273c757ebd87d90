"""What grids of an answer tell that differ in one respect: means, and how well they are known.

A respect is "steps", "nodes" of X and X', or "charges", the nodes of Z. Grids are a list of
solutions for each, from the coarsest to the finest; the first of "nodes" is the first of all.
"""

from __future__ import annotations

from collections.abc import Callable
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


def changed(solutions: list[Solution]) -> tuple[str, float]:
    """The judged mean that changes most from the last grid but one to the last, and its share."""
    before, last = (each.means for each in solutions[-2:])
    return worst(last, {name: abs(last[name] - before[name]) for name in JUDGED})


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
    means = {respect: [each.means for each in grids[respect]] for respect in grids}
    found, errors = _summed(means, doubted, {"steps": CORRECTION_TAKEN * left})
    found["power_conversion_efficiency"] = found["mean_power"] / found["power_in"]
    return found, errors


def compared(grids: Grids, find: Callable[[Solution], Numbers]) -> tuple[Numbers, Numbers]:
    """What `find` gives, and its errors: what the two grids of each respect changed, as a whole.

    Empty where it takes too many steps.
    """
    known = {each: find(each) for pair in grids.values() for each in pair}
    if not all(known.values()):
        return {}, {}
    values = {respect: [known[each] for each in pair] for respect, pair in grids.items()}
    found, errors = _summed(values, dict.fromkeys(grids, 1.0))
    return found, {name: sum(each[name] for each in errors.values()) for name in found}


def _summed(values, doubted, taken=None):
    """Numbers with all that finer grids changed, a further share of each respect's last change
    taken, and another share doubted."""
    found, errors = dict(values["nodes"][0]), {}
    for respect, numbers in values.items():
        first, before, last = numbers[0], numbers[max(len(numbers) - 2, 0)], numbers[-1]
        errors[respect] = {}
        for name in found:
            change = last[name] - before[name]
            found[name] += last[name] - first[name] + (taken or {}).get(respect, 0.0) * change
            errors[respect][name] = doubted[respect] * abs(change)
    return found, errors


def worst(means: Numbers, error: Numbers) -> tuple[str, float]:
    """The judged mean with the largest error as a share of it, and that share."""
    scale = {name: abs(means[name]) or np.inf for name in JUDGED}
    if error[efficiency := "power_conversion_efficiency"] > FEW_POINTS:
        scale[efficiency] = min(scale[efficiency], HIGH_EFFICIENCY)
    name = max(JUDGED, key=lambda name: error[name] / scale[name])
    return name, error[name] / scale[name]
