"""A quantity of a scene as a function of its parameters."""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from harvester.base.errors import SceneError
from harvester.base.method import Method
from harvester.engines.request import Request
from harvester.scene.model import Scene
from harvester.statistics.agreement import differ
from harvester.statistics.estimate import Estimate
from harvester.statistics.paired import WITH_DEVIATIONS, deviations
from harvester.statistics.run_estimates import error_of
from harvester.studies.answers import (
    answers_in_time,
    is_complete,
    is_noisy,
    on_common_knots,
    value_of,
)
from harvester.studies.optimum.axis import Axis

# A value counts as 0 if its distance from 0 is at most this number of standard errors.
NOTHING_SIGMAS = 2.0
NOTHING = (
    "so it cannot be optimised. Check the excitation (level, frequency) and the load: a "
    "rectifier conducts above its diodes' voltages, a lockout or regulator above its threshold"
)


def is_nothing(value: Estimate) -> bool:
    """Whether a value is 0 within its error."""
    return not differ(value.estimate, value.standard_error or 0.0, sigmas=NOTHING_SIGMAS)


def series_in_units(answer: Any, quantity: str) -> np.ndarray:
    """Deviations of batches from a quantity's mean, in the scene's units: (realizations, batches).

    Without noise there is one row, the mean over the starts on the followed orbit. The answer must
    contain its moments, and `harvester.statistics.paired.deviations` must accept the quantity.
    """
    factor = answer.prepared_scene.scales.of(answer.quantities[quantity].dimension)
    series = factor * deviations(answer.moments, quantity)
    return series if answer.scene.excitation.random else series.mean(axis=0, keepdims=True)


class Objective:
    """A quantity at points in the unit cube of some parameters.

    `begin`: function of the numbers of points evaluated before and after a batch of points.
    """

    def __init__(
        self,
        scene: Scene,
        axes: Sequence[Axis],
        quantity: str,
        method: Method,
        runner: Any,
        begin: Callable[[int, int], object],
    ):
        self.axes, self.quantity, self.method = tuple(axes), quantity, method
        self.noisy = is_noisy(scene, method)
        self.scene = scene
        if self.noisy:
            corners = itertools.product(*((0.0, 1.0) for _ in axes))
            ends = [self.scene_at(corner) for corner in corners]
            (self.scene,) = on_common_knots([scene], ends)
        self._runner, self._begin = runner, begin
        self.evaluated = 0

    def values_at(self, point: Sequence[float]) -> dict[str, float]:
        """The parameters at a point."""
        return {a.key: a.value(float(c)) for a, c in zip(self.axes, point, strict=True)}

    def scene_at(self, point: Sequence[float], stage: int = 0) -> Scene:
        """The scene at a point; each stage of a search has different noise."""
        changes = self.values_at(point)
        if stage and self.noisy:
            words = np.random.SeedSequence(self.scene.run.seed, spawn_key=(stage, 0))
            changes["run.seed"] = int(words.generate_state(1, np.uint64)[0])
        return self.scene.replace(changes)

    def answers(self, points: Sequence, stage: int = 0, **options: Any) -> list:
        """Answers at points; the error at points that fail.

        `**options`: options of the `Request`.
        """
        answers: list[Any] = [None] * len(points)
        requests: dict[int, Request] = {}
        for k, location in enumerate(points):
            try:
                requests[k] = Request(self.scene_at(location, stage), self.method, **options)
            except SceneError as error:
                answers[k] = error
        self._begin(self.evaluated, self.evaluated + len(requests))
        replies = answers_in_time(self._runner, requests.values())
        self.evaluated += len(requests)
        for k, answer in zip(requests, replies, strict=True):
            answers[k] = answer
        return answers

    def value(self, answer: Any) -> float:
        """The quantity as in `value_of`; NaN if a beam's strain exceeds its limit."""
        return math.nan if self.is_overstrained(answer) else value_of(answer, self.quantity)

    def is_overstrained(self, answer: Any) -> bool:
        """Whether the mean peak strain of the layers is above the scene's limit."""
        limit = self.scene.beam.strain_limit if self.scene.beam else None
        if limit is None or not is_complete(answer):
            return False
        return answer.quantities["peak_strain"].estimate > limit

    def error_of_difference(self, answer: Any, other: Any) -> float:
        """Standard error of the difference of two answers on the same noise; inf if unknown."""
        if not self.noisy:
            return 0.0
        if self.quantity not in WITH_DEVIATIONS:
            errors = [a.in_units()[self.quantity].standard_error for a in (answer, other)]
            return math.inf if None in errors else math.hypot(*errors)
        series = [series_in_units(compared, self.quantity) for compared in (answer, other)]
        error = error_of(self.scene)(series[0] - series[1])
        return math.inf if error is None else error
