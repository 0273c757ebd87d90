"""Realizations by a method and answers of closures, each with the time that it took."""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

from harvester.averaging.closures import NOISE_CLOSURES
from harvester.base.errors import HarvesterError
from harvester.engines.methods import engine_of
from harvester.engines.realization import run
from harvester.engines.realizations import averages
from harvester.engines.runner import Runner
from harvester.engines.task import Task
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing
from harvester.statistics.estimate import Estimate
from harvester.statistics.means import estimate_all
from harvester.statistics.moments import Moments
from harvester.statistics.output_side import estimate_output
from harvester.validation.accuracy_methods import ComparedMethod
from harvester.validation.paths import recorded, states_at_knots

WARM_UP_KNOTS = 20


def timed(
    scene: Scene, method: dict[str, Any], indices: list[int], report: Callable
) -> dict[str, Any]:
    """Moments of a few realizations, and the seconds of this core that they took.

    In a worker process; `method` holds what `ComparedMethod.options` gives.
    """
    # A brief run compiles and loads everything before the clock starts.
    brief = scene.replace(
        {"run.settle": 0.0, "run.duration": WARM_UP_KNOTS * knot_spacing(prepared(scene))}
    )
    settings = dict(method)
    engine = engine_of(settings.pop("engine"), **settings)
    run(brief, engine, indices[:1], None, report)
    realizations = run(scene, engine, indices, None, report)
    return {
        "moments": [realization.moments for realization in realizations],
        "seconds": sum(realization.seconds for realization in realizations),
    }


def paths_at_knots(
    scene: Scene, method: dict[str, Any], indices: list[int], report: Callable
) -> dict[str, Any]:
    """States of a few realizations at the knots, and the number of points of all their records."""
    realizations = recorded(scene, indices=indices, **method)
    points = sum(realization.moments.points for realization in realizations)
    return {"states": states_at_knots(scene, realizations), "points": points}


def realizations_task(
    scene: Scene,
    method: ComparedMethod,
    indices: Sequence[int],
    runner: Runner,
    function: Callable = timed,
) -> Task:
    """The task of some realizations that run together; `function` takes what `timed` takes."""
    arguments = {"scene": scene, "method": method.options(scene), "indices": list(indices)}
    version = runner.version(method.engine)
    return Task(function, arguments, version, method.family, len(indices))


class Timed:
    """The realizations of a scene by one method, and the time that they took.

    Attributes
    ----------
    scene : Scene
    moments : list of Moments
    measured_time, simulated_time : float
        Summed over realizations, without and with settling (s).
    seconds : float
        Summed over tasks, of one core.
    cost : float
        Seconds of one core for a measured one, of the fastest task: other work on the machine only
        slows a task down.
    """

    def __init__(self, scene: Scene, answers: Sequence[dict[str, Any]]) -> None:
        self.moments: list[Moments] = [
            moments for answer in answers for moments in answer["moments"]
        ]
        self.measured_time = _measured_time(self.moments)
        self.simulated_time = sum(moments.time_reached for moments in self.moments)
        self.seconds = sum(answer["seconds"] for answer in answers)
        self.cost = min(answer["seconds"] / _measured_time(answer["moments"]) for answer in answers)
        self.scene = scene
        self._estimates: dict[int, dict[str, Estimate]] = {}

    def quantities(self, count: int | None = None) -> dict[str, Estimate]:
        """Estimates from all realizations, or from the first few."""
        moments = self.moments[:count]
        if len(moments) not in self._estimates:
            estimates = estimate_all(moments, self._system) | estimate_output(moments)
            self._estimates[len(moments)] = estimates
        return self._estimates[len(moments)]

    @cached_property
    def _system(self):
        return prepared(self.scene).system


def _measured_time(moments):
    return sum(realization.time_reached - realization.start for realization in moments)


def averages_once_more(scene: Scene, closure: str, report: Callable) -> dict[str, Any]:
    """A scene by a closure, timed with its code compiled (in a worker process)."""
    for _ in range(2):
        answer = averages(scene, closure, None, False, report)
    return answer


def closures(scene: Scene, runner: Runner) -> tuple[dict[str, dict], dict[str, str]]:
    """Answers of the closures that hold, and the other closures' reasons for refusal, by their
    names.

    An answer holds `quantities`, scaled, and the `seconds` of one core.
    """
    tasks = [
        Task(averages_once_more, {"scene": scene, "closure": closure}, label=closure)
        for closure in NOISE_CLOSURES
    ]
    outcomes = dict(zip(NOISE_CLOSURES, runner.run(tasks), strict=True))
    answers = {name: outcome for name, outcome in outcomes.items() if isinstance(outcome, dict)}
    refused = {name: str(e) for name, e in outcomes.items() if isinstance(e, HarvesterError)}
    return answers, refused
