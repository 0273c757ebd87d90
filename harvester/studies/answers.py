"""Helpers for studies: check methods and quantities, extract values and notes from answers."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

from harvester.averaging.method import Stationary
from harvester.averaging.of_scene import DIMENSIONS
from harvester.base.arguments import check_name
from harvester.base.errors import HarvesterError, LoadError, OutOfTime
from harvester.base.method import Method
from harvester.engines.methods import Circuit, Engine, MonteCarlo, method_of
from harvester.engines.orbits import note_on_one_start, with_orbit
from harvester.engines.realization import quantity_names
from harvester.engines.request import COMPLETE, OUT_OF_TIME, Request
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import fixes_knots, resolving, spacing_of
from harvester.scene.units import require_resistor
from harvester.statistics.estimate import Estimate
from harvester.statistics.strain import without_line

# Number of random starts at an optimum without noise. An orbit that a quarter of all starts reach
# is missed with a probability of 1 %.
STARTS = 16


def checked_method(scene: Scene, method: str | Method | None) -> Method:
    """An engine or a stationary method that accepts the scene's load.

    None selects Monte Carlo, or the circuit if only that supports the load and excitation.
    """
    if method is None:
        try:
            MonteCarlo().check(scene)
        except LoadError:
            return Circuit()
        return MonteCarlo()
    chosen = method_of(method)
    if isinstance(chosen, Engine):
        chosen.check(scene)
    else:
        require_resistor(scene, chosen.name)
    return chosen


def is_noisy(scene: Scene, method: Method) -> bool:
    """Whether the method's values depend on the seed."""
    return isinstance(method, Engine) and scene.excitation.random


def check_quantities(
    quantities: Sequence[str], scenes: Iterable[Scene], methods: Sequence[Method]
) -> None:
    """Raise HarvesterError, before a run, if no scene has a quantity; name the nearest quantity.

    The root of a mean square is also a quantity.
    """
    names: dict[str, None] = {}
    if any(isinstance(method, Stationary) for method in methods):
        names = dict.fromkeys(DIMENSIONS)
    for scene in scenes:
        names |= dict.fromkeys(quantity_names(prepared(scene)))
        names |= {name.replace("mean_square", "rms"): None for name in names}
        if names.keys() >= {*quantities}:
            return
    for quantity in quantities:
        missing = without_line(scene, quantity)
        if missing:
            raise HarvesterError(missing)
        check_name("quantity", quantity, names)


def first_answer(runner: Any, request: Request) -> Any:
    """Return the answer to a study's first request; raise the error that stops the study."""
    (answer,) = successful(runner.answer([request]))
    return answer


def successful(outcomes: Sequence) -> Sequence:
    """Return the outcomes of runs; raise the error of a failed one, OutOfTime for a missing one."""
    for outcome in outcomes:
        if outcome is None or isinstance(outcome, HarvesterError):
            raise outcome or OutOfTime(OUT_OF_TIME)
    return outcomes


def is_complete(answer: Any) -> bool:
    """Whether a run ended normally, with a result."""
    return not (isinstance(answer, HarvesterError) or answer is None or answer.outcome != COMPLETE)


def reason_of(answer: Any) -> str:
    """The reason why a run did not complete."""
    return str(answer) if isinstance(answer, HarvesterError) else answer.outcome


def value_of(answer: Any, quantity: str) -> float:
    """A quantity in the scene's units; NaN if the run failed or ended early."""
    return answer.in_units()[quantity].estimate if is_complete(answer) else math.nan


def missing_from(quantity: str, estimate: Estimate) -> list[str]:
    """A sentence if the quantity lacks an error bar because the run was too short; else empty.

    `estimate`: the quantity's estimate, whose note gives the reason for a missing error bar.
    """
    if estimate.standard_error is not None or not estimate.note:
        return []
    name = quantity.replace("_", " ")
    return [f"{name}: {estimate.note}; this also affects the results of this study"]


def on_common_knots(scenes: Sequence[Scene], of: Sequence[Scene] | None = None) -> list[Scene]:
    """Scenes with the finest of their knot spacings, so that all have the same noise.

    `of`: scenes that determine the finest spacing; None: the scenes themselves.
    """
    if fixes_knots(scenes[0]):
        return list(scenes)
    spacing = min(spacing_of(resolving(scene)) for scene in (of or scenes))
    excitations: list[Any] = [scene.excitation for scene in scenes]
    return [
        replace(scene, excitation=replace(excitation, knot_spacing=spacing))
        for scene, excitation in zip(scenes, excitations, strict=True)
    ]


def longer_runs(scene: Scene) -> str:
    """Advice for results whose differences do not exceed their errors."""
    return f"{scene.excitation.longer_run(scene.run)} (four times as long halves the errors)"


def answers_in_time(runner: Any, requests: Iterable[Request], **options: Any) -> list:
    """Answers of `engines.runner.Runner.answer` to requests; raise OutOfTime if one is missing."""
    answers = runner.answer(list(requests), **options)
    if runner.out_of_time:
        raise OutOfTime(OUT_OF_TIME)
    return answers


def orbits_at(scene: Scene, method: Method, runner: Any) -> tuple:
    """The orbits reached from random starts; empty under noise or for a linear device."""
    if scene.run.starts is None:
        scene = replace(scene, run=replace(scene.run, starts=STARTS))
    request = Request(with_orbit(scene), method)
    if request.is_averaged or not note_on_one_start(request.prepared_scene):
        return ()
    return first_answer(runner, request).orbits
