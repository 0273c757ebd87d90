"""Maximise over several parameters together.

1. A library for noisy functions proposes points, which are evaluated on common noise.
2. The highest points are run again on independent noise, since the highest of many is biased.
3. From the best of them, the search climbs along the axes and measures the flat region.
4. A last run on independent noise gives the value without selection bias.

Methods without noise continue from the highest proposal by COBYQA (T. M. Ragonneau, PhD thesis,
Hong Kong Polytechnic University, 2022), to their precision.
"""

import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize

from harvester.base.errors import HarvesterError, OptimumError
from harvester.base.method import Method
from harvester.base.writing import finite
from harvester.engines.progress import Stages
from harvester.engines.request import Request
from harvester.engines.runner import Runner
from harvester.scene.model import Scene
from harvester.statistics.estimate import Estimate
from harvester.statistics.passivity import store_notes
from harvester.statistics.units import unit_of
from harvester.studies.answers import first_answer, is_noisy, successful
from harvester.studies.optimum.axis import Axis
from harvester.studies.optimum.flat_region import climb, ranges
from harvester.studies.optimum.objective import Objective
from harvester.studies.optimum.proposals import BATCH, Proposals
from harvester.studies.optimum.result import Optimum

# Default number of proposals per parameter, and number of grid points that replace them.
EVALUATIONS_EACH, GRID = 60, 17
FEWEST_EVALUATIONS, MOST_EVALUATIONS = 16, 100_000
MOST_PARAMETERS = 8
# Number of points that are run again on independent noise.
CONFIRMED = 5
# Trust radius of a method without noise, as a share of the ranges, initially and finally: within
# the final radius a maximum is flat to 1e-9.
RADIUS, LAST_RADIUS = 0.05, 1e-5
# Approximate number of evaluations of the climb per parameter, for the progress bar.
CLIMB_EACH = 30
# Numbers of the noise streams: for the search, for the chosen points, and for the final value.
SEARCH, AGAIN, VALUE = 0, 1, 2


def over_several(
    scene: Scene,
    axes: Sequence[Axis],
    quantity: str,
    method: Method,
    runner: Runner,
    stages: Stages,
    evaluations: int | None = None,
    precision: float | None = None,
) -> Optimum:
    """The optimum over several parameters, except its computing time; see `optimum`."""
    usual = GRID if _by_grid(axes, is_noisy(scene, method)) else EVALUATIONS_EACH * len(axes)
    count = usual if evaluations is None else evaluations
    if not FEWEST_EVALUATIONS <= count <= MOST_EVALUATIONS:
        raise HarvesterError(
            f"--evaluations {count}: must be a whole number, {FEWEST_EVALUATIONS} to "
            f"{MOST_EVALUATIONS}"
        )
    if len(axes) > MOST_PARAMETERS:
        raise HarvesterError(f"--over: give at most {MOST_PARAMETERS} parameters")
    expected = 1 + count + CONFIRMED + CLIMB_EACH * len(axes)

    def begin(done, after):
        low, high = (min((1 + count) / expected, 0.99) for count in (done, after))
        stages.begin(low, high, f"{done} evaluations")

    objective = Objective(scene, axes, quantity, method, runner, begin)
    stages.begin(0.0, 1.0 / expected, "unchanged scene")
    scene_answer = first_answer(runner, Request(scene, method))
    searched = _search(objective, count)
    location = _chosen(objective, searched)
    stage = AGAIN if objective.noisy else SEARCH
    start = location if objective.noisy else _refined(objective, location)
    location, answer, sides = climb(objective, start, stage)
    if location != start and not objective.noisy:
        location, answer, sides = climb(objective, _refined(objective, location), stage)
    if objective.noisy:
        asked = {"precision": precision, "quantities": (quantity,)}
        (answer,) = successful(objective.answers([location], VALUE, **asked))
    dimension = answer.in_units()[quantity].dimension
    return Optimum(
        scene=scene,
        quantity=quantity,
        unit=unit_of(scene, dimension),
        method=method.name,
        parameters=ranges(objective.axes, location, sides),
        value=answer.in_units()[quantity],
        notes=store_notes(answer.quantities),
        own=scene_answer.in_units()[quantity],
        searched=[
            (objective.values_at(coordinates), Estimate(value, None, None, dimension))
            for coordinates, value in searched
        ],
        evaluations=objective.evaluated,
    )


def _by_grid(axes, noisy):
    """Whether a grid replaces proposals: for one parameter without noise."""
    return len(axes) == 1 and not noisy


def _search(objective, count):
    """Proposed points and their values; for one parameter without noise, a grid."""
    searched: list[tuple] = []
    axes, proposals = objective.axes, None
    grid = [(float(coordinate),) for coordinate in np.linspace(0.0, 1.0, count)]
    if not _by_grid(axes, objective.noisy):
        # The search begins at the scene's values if they are in the ranges.
        scene_values = [axis.own(objective.scene) for axis in axes]
        inside = all(
            axis.low <= value <= axis.high for axis, value in zip(axes, scene_values, strict=True)
        )
        first = [
            axis.coordinate(value) for axis, value in zip(axes, scene_values, strict=True) if inside
        ]
        proposals = Proposals(len(axes), objective.scene.run.seed, first or None)
    while len(searched) < count:
        done, size = len(searched), min(BATCH, count - len(searched))
        points = proposals.ask(size) if proposals else grid[done : done + size]
        values = [objective.value(answer) for answer in objective.answers(points)]
        if proposals:
            proposals.tell([finite(value) for value in values])
        searched += zip(points, values, strict=True)
    if all(math.isnan(value) for _, value in searched):
        raise OptimumError(
            f"all runs failed, at each of {len(searched)} points: check the scene by "
            "harvester simulate"
        )
    return searched


def _chosen(objective, searched):
    """The highest point; under noise, the highest of the best points on independent noise."""
    ended = [pair for pair in searched if not math.isnan(pair[1])]
    highest = [
        coordinates
        for coordinates, _ in sorted(ended, key=lambda point_and_value: -point_and_value[1])
    ]
    if not objective.noisy:
        return highest[0]
    points = list(dict.fromkeys(highest))[:CONFIRMED]
    values = [objective.value(answer) for answer in objective.answers(points, AGAIN, moments=True)]
    if all(math.isnan(value) for value in values):
        raise OptimumError(
            "the repeated runs failed at all of the highest points: check the scene by "
            "harvester simulate"
        )
    return points[int(np.nanargmax(values))]


def _refined(objective, point):
    """The maximum near a point, to the precision of a method without noise."""

    def loss(coordinates):
        (answer,) = objective.answers([tuple(map(float, coordinates))])
        value = objective.value(answer)
        return math.inf if math.isnan(value) else -value / scale

    (answer,) = objective.answers([point])
    scale = abs(objective.value(answer)) or 1.0
    radii = {"initial_tr_radius": RADIUS, "final_tr_radius": LAST_RADIUS}
    best = minimize(loss, point, method="COBYQA", bounds=[(0.0, 1.0)] * len(point), options=radii)
    return tuple(map(float, best.x))
