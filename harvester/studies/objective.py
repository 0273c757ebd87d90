"""A quantity of a scene as a function of some of its parameters."""

import itertools
import math
from collections import ChainMap
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from harvester.averaging import CLOSURES
from harvester.errors import HarvesterError, LoadError, OutOfTime, SceneError
from harvester.estimates.batch_means import standard_error
from harvester.estimates.estimate import Estimate
from harvester.prepared.prepared import prepared
from harvester.prepared.steps import knot_spacing, resolving
from harvester.results.paired import deviations, has_deviations
from harvester.running import Request
from harvester.running.request import COMPLETE
from harvester.scene.model import Scene
from harvester.scene.units import require_resistor
from harvester.simulation.methods import ENGINES
from harvester.simulation.simulate import check_name
from harvester.studies.axis import Axis


def checked_method(scene: Scene, method: str | None) -> str:
    """An engine or a closure that takes the scene's load.

    None stands for Monte Carlo, and for the circuit where only that takes load and excitation.

    Raises
    ------
    HarvesterError
    """
    if method is None:
        try:
            ENGINES["monte-carlo"].check(scene)
        except LoadError:
            return "circuit"
        return "monte-carlo"
    check_name("method", method, ChainMap(ENGINES, CLOSURES))
    if method == "monte-carlo":
        ENGINES["monte-carlo"].check(scene)
    elif method != "circuit":
        require_resistor(scene, method)
    return method


def is_noisy(scene: Scene, method: str) -> bool:
    """Whether another seed gives another value."""
    return method in ENGINES and scene.excitation.random


def check_quantity(quantity: str, answer: Any) -> None:
    """Refuse a quantity that an answer does not have, with the nearest that it has.

    Raises
    ------
    HarvesterError
    """
    check_name("quantity", quantity, tuple(answer.quantities))


def first_answer(runner: Any, request: Request) -> Any:
    """The answer that all else is asked after.

    Raises
    ------
    OutOfTime
    HarvesterError
        What the run failed of.
    """
    (answer,) = runner.answer([request])
    if answer is None:
        raise OutOfTime(
            "the time budget was spent before the first run was done; the same command goes on"
        )
    if isinstance(answer, HarvesterError):
        raise answer
    return answer


def is_complete(answer: Any) -> bool:
    """Whether a run came to its end."""
    return not (isinstance(answer, HarvesterError) or answer is None or answer.outcome != COMPLETE)


def told(answer: Any) -> str:
    """Why it did not."""
    return str(answer) if isinstance(answer, HarvesterError) else answer.outcome


def value_of(answer: Any, quantity: str) -> float:
    """A quantity in the scene's units; nan of what failed or was ended early."""
    return answer.in_units()[quantity].estimate if is_complete(answer) else math.nan


def missing_from(quantity: str, estimate: Estimate) -> list[str]:
    """In a sentence, what the runs were too short for: it moves what is found from them as well.

    Parameters
    ----------
    quantity : str
    estimate : Estimate
        Without an error bar where something is missing.
    """
    if estimate.standard_error is not None or not estimate.note:
        return []
    name = quantity.replace("_", " ")
    return [f"{name}: {estimate.note}; what is missing moves what is found here, too"]


def on_common_knots(scenes: Sequence[Scene], of: Sequence[Scene] | None = None) -> list[Scene]:
    """Scenes with the finest spacing of knots of any: else they would not share their noise.

    Parameters
    ----------
    scenes : sequence of Scene
    of : sequence of Scene or None
        Those whose spacing is looked at; None: the scenes themselves.
    """
    if not hasattr(scenes[0].excitation, "knot_spacing"):
        return list(scenes)
    spacing = min(knot_spacing(prepared(resolving(each))) for each in (of or scenes))
    excitations: list[Any] = [each.excitation for each in scenes]
    return [
        replace(each, excitation=replace(excitation, knot_spacing=spacing))
        for each, excitation in zip(scenes, excitations, strict=True)
    ]


def answers_in_time(runner: Any, requests: Sequence[Request], **options: Any) -> list:
    """What a runner answers; see `harvester.running.Runner.answer`.

    Raises
    ------
    OutOfTime
    """
    answers = runner.answer(list(requests), **options)
    if runner.out_of_time:
        raise OutOfTime(
            "the time budget was spent before the optimum was found; with --output the same "
            "command goes on"
        )
    return answers


def series_in_units(answer: Any, quantity: str) -> np.ndarray:
    """How far a quantity is off its mean in each batch, in the scene's units.

    Parameters
    ----------
    answer : harvester.running.Answer
        With its moments.
    quantity : str
        One that `harvester.results.paired.deviations` knows.

    Returns
    -------
    ndarray, shape (realizations, batches)
    """
    factor = prepared(answer.scene).scales.of(answer.quantities[quantity].dimension)
    return factor * deviations(answer.moments, quantity)


class Objective:
    """A quantity at places in the unit cube of some axes.

    Parameters
    ----------
    scene : Scene
    axes : sequence of Axis
    quantity, method : str
    runner : harvester.running.Runner
    follow : callable
        Given the number of places evaluated.
    """

    def __init__(
        self,
        scene: Scene,
        axes: Sequence[Axis],
        quantity: str,
        method: str,
        runner: Any,
        follow: Callable[[int], None],
    ):
        self.axes, self.quantity, self.method = tuple(axes), quantity, method
        self.noisy = is_noisy(scene, method)
        self.scene = scene
        if self.noisy:
            corners = itertools.product(*((0.0, 1.0) for _ in axes))
            ends = [self.scene_at(corner) for corner in corners]
            (self.scene,) = on_common_knots([scene], ends)
        self._runner, self._follow = runner, follow
        self.evaluated = 0

    def values_at(self, place: Sequence[float]) -> dict[str, float]:
        """The parameters at a place."""
        return {a.key: a.value(float(c)) for a, c in zip(self.axes, place, strict=True)}

    def scene_at(self, place: Sequence[float], stage: int = 0) -> Scene:
        """The scene at a place; each stage of a search has noise of its own."""
        changes = self.values_at(place)
        if stage and self.noisy:
            words = np.random.SeedSequence(self.scene.run.seed, spawn_key=(stage, 0))
            changes["run.seed"] = int(words.generate_state(1, np.uint64)[0])
        return self.scene.replace(changes)

    def answers(self, places: Sequence, stage: int = 0, **options: Any) -> list:
        """Answers at places, or the error in its place.

        Parameters
        ----------
        places : sequence of sequence of float
        stage : int
        **options
            Of the `Request`.

        Raises
        ------
        OutOfTime
        """
        found: list[Any] = [None] * len(places)
        requests: dict[int, Request] = {}
        for k, place in enumerate(places):
            try:
                requests[k] = Request(self.scene_at(place, stage), self.method, **options)
            except SceneError as error:
                found[k] = error
        for k, answer in zip(requests, self._answers(requests.values()), strict=True):
            found[k] = answer
        return found

    def answers_with(self, place: Sequence[float], changes: Sequence[dict]) -> list:
        """Answers at one place, each with other changes of the scene; see `answers`."""
        scene = self.scene_at(place)
        return self._answers([Request(scene.replace(each), self.method) for each in changes])

    def _answers(self, requests):
        return answers_in_time(self._runner, requests, on_answer=self._count)

    def value(self, answer: Any) -> float:
        """See `value_of`."""
        return value_of(answer, self.quantity)

    def error_of_difference(self, answer: Any, other: Any) -> float:
        """Standard error of the difference of two answers on the same noise; infinite without."""
        if not self.noisy:
            return 0.0
        if not has_deviations(self.quantity):
            errors = [a.in_units()[self.quantity].standard_error for a in (answer, other)]
            return math.inf if None in errors else math.hypot(*errors)
        series = [series_in_units(each, self.quantity) for each in (answer, other)]
        error = standard_error(series[0] - series[1])
        return math.inf if error is None else error

    def _count(self, index, answer):
        self.evaluated += 1
        self._follow(self.evaluated)
