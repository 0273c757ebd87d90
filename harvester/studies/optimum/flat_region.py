"""Flat region of a maximum: the range of each parameter without a significant loss.

Points at increasing distance along each axis are compared with the maximum on the same noise, so
that differences are more precise than values. If a point is higher, the search moves to it and
starts again.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from harvester.studies.optimum.axis import Axis, OptimalParameter
from harvester.studies.optimum.objective import Objective

# A point belongs to the flat region if its value is below the maximum by at most FLAT_SHARE of the
# maximum plus FLAT_SIGMAS standard errors of the difference.
FLAT_SHARE, FLAT_SIGMAS = 0.01, 2.0
# The first step is the distance to the end of the range, halved HALVINGS times. REFINEMENTS
# bisections then locate the edge, or WITHOUT_NOISE for a method without noise.
HALVINGS, REFINEMENTS, WITHOUT_NOISE = 6, 2, 8
# A point is higher if its excess exceeds HIGHER standard errors and the share SHARE_HIGHER.
HIGHER, SHARE_HIGHER = 3.0, 1e-3
# Maximum number of points around which the region is sought, each higher than the one before.
MOVES = 6


@dataclass(frozen=True)
class FlatSide:
    """Extent of the flat region on one side along one axis.

    Attributes
    ----------
    end : float
        Coordinate of the farthest point that is still flat; NaN if the runs are too short for
        errors of differences.
    is_open
        Whether the flat region extends to the end of the range.
    """

    end: float
    is_open: bool


def climb(objective: Objective, point: tuple, stage: int) -> tuple[tuple, Any, list]:
    """Climb to a point that no other point along an axis exceeds, and measure its flat region.

    `point`: coordinates of the start; `stage`: number of the noise stream. Returns the point, its
    answer, and (FlatSide below, FlatSide above) for each axis.
    """
    (answer,) = objective.answers([point], stage, moments=True)
    moves = 0
    while True:
        rays, higher = _look_around(objective, point, answer, stage)
        if higher is None or moves == MOVES - 1:
            sides = [ray.side() for ray in rays]
            return point, answer, list(zip(sides[::2], sides[1::2], strict=True))
        point, answer = higher
        moves += 1


def _look_around(objective, point, answer, stage):
    """Rays from a point with their flat parts, and (point, answer) of a higher point or None."""
    rays = [_Ray(axis, way, point) for axis in range(len(point)) for way in (-1.0, 1.0)]
    best = None
    for turn in range(1 + (REFINEMENTS if objective.noisy else WITHOUT_NOISE)):
        pairs = [(ray, share) for ray in rays for share in ray.wanted(turn)]
        answers = objective.answers([ray.at(share) for ray, share in pairs], stage, moments=True)
        value = objective.value(answer)
        for (ray, reach), moved in zip(pairs, answers, strict=True):
            moved_value, gain, error = objective.value(moved), -np.inf, 0.0
            if not np.isnan(moved_value):
                gain, error = moved_value - value, objective.error_of_difference(moved, answer)
            ray.flat[reach] = gain >= -FLAT_SHARE * abs(value) - FLAT_SIGMAS * error
            ray.known &= np.isfinite(error)
            least = max(HIGHER * error, SHARE_HIGHER * abs(value))
            if gain > least and (best is None or gain > best[0]):
                best = gain, ray.at(reach), moved
    return rays, best and best[1:]


class _Ray:
    """A line from a point along one axis to an end of its range."""

    def __init__(self, axis, way, point):
        self._axis, self._way, self._place = axis, way, point
        self._length = point[axis] if way < 0.0 else 1.0 - point[axis]
        self.flat, self.known = {}, True

    def at(self, reach):
        """The point at the share `reach` of the ray."""
        moved = list(self._place)
        moved[self._axis] = min(max(moved[self._axis] + self._way * reach * self._length, 0.0), 1.0)
        return tuple(moved)

    def wanted(self, turn):
        """Shares of the ray to evaluate next."""
        if self._length < 1e-9:
            return []
        if turn == 0:
            return [0.5**k for k in range(HALVINGS, -1, -1)]
        inside, outside = self._edge()
        return [] if outside is None else [0.5 * (inside + outside)]

    def side(self):
        inside, outside = self._edge()
        if not self.known:
            return FlatSide(np.nan, False)
        return FlatSide(self.at(inside)[self._axis], outside is None)

    def _edge(self):
        """The last flat share of the ray, and the first share that is not flat, or None."""
        inside = 0.0
        for reach in sorted(self.flat):
            if not self.flat[reach]:
                return inside, reach
            inside = reach
        return inside, None


def ranges(axes: Sequence[Axis], point: tuple, sides: list) -> list[OptimalParameter]:
    """The flat ranges from `climb`, in the unit of each parameter."""
    return [
        OptimalParameter(
            axis=axis,
            place=axis.value(coordinate),
            flat_low=axis.value(below.end),
            flat_high=axis.value(above.end),
            open_low=below.is_open,
            open_high=above.is_open,
        )
        for axis, coordinate, (below, above) in zip(axes, point, sides, strict=True)
    ]
