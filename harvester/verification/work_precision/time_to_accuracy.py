"""`time-to-accuracy`: how long every method takes to an error of 10, 3 and 1 % on one scene."""

import math
import os
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any

from harvester.averaging import CLOSURES
from harvester.calling import takes_scene
from harvester.engines import side_by_side
from harvester.engines.pools import ExecutorPool, WorkerPool
from harvester.engines.realization import run
from harvester.engines.steps import knot_spacing
from harvester.errors import HarvesterError, LoadError, SceneError
from harvester.estimates.estimate import Estimate
from harvester.estimates.means import estimate_all
from harvester.estimates.output_side import estimate_output
from harvester.running import Runner, Task, open_runner
from harvester.running.realizations import averages
from harvester.scene.model import Scene
from harvester.scene.units import require_resistor, scale
from harvester.simulation import require_noise
from harvester.verification.work_precision.accuracy import (
    OUTPUT_POWER,
    TotalError,
    bias_of,
    scatter_of,
)
from harvester.verification.work_precision.accuracy_table import Line, Point, TimeToAccuracy
from harvester.verification.work_precision.methods import (
    COMPILED_METHODS,
    LOAD_REFERENCE,
    REFERENCE,
    TIMED_METHODS,
)

# Wall seconds of one core that a method's run may take, and the reference's in units of it.
SECONDS = 20.0
REFERENCE_SHARE = 5.0
# Realizations in one task of Monte Carlo: each by itself is done before a clock sees it.
TOGETHER = 16
MOST_REALIZATIONS = 4096
# Tasks of each method, however long they take.
FEWEST_TASKS = 2
# A realization has its batches as if there were so many: few give an error bar, too.
BATCHED_AS = 8
WARM_UP_KNOTS = 20


@takes_scene
def time_to_accuracy(
    scene: Scene,
    *,
    seconds: float = SECONDS,
    output: str | os.PathLike | None = None,
    workers: int | None = None,
    executor: Executor | WorkerPool | ExecutorPool | None = None,
    scheduler: str | None = None,
    time_budget: float | None = None,
    progress: Callable[[float, str], object] | None = None,
    runner: Runner | None = None,
) -> TimeToAccuracy:
    """Measure how the error of every method falls with its wall time.

    Parameters
    ----------
    scene : Scene, str or Path
        Its run gives the length of each realization.
    seconds : float
        Wall seconds of one core that each method's run may take: the longer, the better are biases
        known.
    output, workers, executor, scheduler, time_budget, progress, runner
        See `harvester.running.open_runner`. What is kept holds the times that were measured.

    Returns
    -------
    TimeToAccuracy

    Raises
    ------
    HarvesterError
        The excitation is no noise; the reference failed or the time budget ended before it.
    """
    require_noise(scene, "time-to-accuracy")
    if not seconds > 0.0:
        raise SceneError(f"time-to-accuracy: {seconds:g} seconds a method: must be > 0")
    opened = open_runner(
        output,
        workers=workers,
        executor=executor,
        scheduler=scheduler,
        time_budget=time_budget,
        progress=progress,
        runner=runner,
    )
    with opened as running:
        reference, methods = _methods(scene, running)
        batched = scene.replace({"run.realizations": BATCHED_AS})
        runs = _Runs(batched, running).of([reference, *methods], seconds)
        closures = _closures(scene, running)
    if not isinstance(runs[0], _Measured):
        raise runs[0] or HarvesterError("the time budget was spent before the reference was there")
    return _put_together(
        scene, reference, runs[0], list(zip(methods, runs[1:], strict=True)), closures
    )


def measured(
    scene: Scene, method: dict[str, Any], indices: list[int], report: Callable
) -> dict[str, Any]:
    """A few realizations by a method, in a worker process.

    Parameters
    ----------
    method : dict
        Options of `harvester.engines.realization.run`.

    Returns
    -------
    dict
        `moments`, one of each; `seconds` that the simulation took of this core.
    """
    # What is compiled or loaded first takes its time before the clock runs.
    brief = scene.replace({"run.settle": 0.0, "run.duration": WARM_UP_KNOTS * knot_spacing(scene)})
    run(brief, indices=indices[:1], window=None, report=report, **method)
    found = run(scene, indices=indices, window=None, report=report, **method)
    return {
        "moments": [each.moments for each in found],
        "seconds": sum(each.seconds for each in found),
    }


class _Measured:
    """Moments of a method's realizations, and what they took."""

    def __init__(self, scene, answers):
        self.moments = [each for found in answers for each in found["moments"]]
        self.time = sum(each.time_reached - each.start for each in self.moments)
        # Other work on the machine only slows a task down.
        self.cost = min(_cost(found) for found in answers)
        self._parameters = scale(scene)[0]

    def quantities(self, count=None):
        """Estimates from all realizations, or from the first few."""
        moments = self.moments[:count]
        return estimate_all(moments, self._parameters) | estimate_output(moments)


def _cost(found):
    """Wall seconds of one measured second of a task's answer."""
    return found["seconds"] / sum(each.time_reached - each.start for each in found["moments"])


class _Runs:
    """Runs methods on one scene: a first task tells how many more there is time for."""

    def __init__(self, scene, runner):
        self._scene, self._runner = scene, runner

    def of(self, methods, seconds):
        """`_Measured`, the HarvesterError or None of each; the first method is the reference."""
        first = self._runner.run([self._task(method, 0) for method in methods])
        counts = []
        for place, found in enumerate(first):
            budget = seconds * (1.0 if place else REFERENCE_SHARE)
            taken = found["seconds"] if isinstance(found, dict) else math.inf
            most = max(MOST_REALIZATIONS // self._size(methods[place]), 1)
            counts.append(min(max(int(budget / max(taken, 1e-9)), FEWEST_TASKS), most))
        # The reference is to hold every realization of the others, on the same noise.
        wanted = max(n * self._size(m) for n, m in zip(counts, methods, strict=True))
        if methods[0].engine == "monte-carlo":
            counts[0] = max(counts[0], math.ceil(wanted / self._size(methods[0])))
        tasks = [
            self._task(method, place)
            for method, count in zip(methods, counts, strict=True)
            for place in range(1, count)
        ]
        rest = iter(self._runner.run(tasks))
        outcomes = []
        for found, count in zip(first, counts, strict=True):
            answers = [found, *(next(rest) for _ in range(1, count))]
            good = [each for each in answers if isinstance(each, dict)]
            outcomes.append(_Measured(self._scene, good) if good == answers else found)
            if good and good != answers:
                outcomes[-1] = _Measured(self._scene, answers[: _leading(answers)])
        return outcomes

    def _size(self, method):
        if method.engine == "monte-carlo":
            return TOGETHER
        if method.copies is not None:
            return method.copies
        many = self._scene.replace({"run.realizations": 1000})
        kind = "compiled" if method.device == "compiled" else "behavioural"
        return side_by_side.copies(many, lambda: side_by_side.MOST_COPIES[kind], method.step(many))

    def _task(self, method, place):
        size = self._size(method)
        arguments = {
            "scene": self._scene,
            "method": method.options(self._scene),
            "indices": list(range(place * size, (place + 1) * size)),
        }
        version = self._runner.version(method.engine)
        return Task(measured, arguments, version, method.family)


def _leading(answers):
    """How many answers there are before the first that is none."""
    return next((k for k, each in enumerate(answers) if not isinstance(each, dict)), len(answers))


def _methods(scene, runner):
    """The reference, and the methods that take this scene's load."""
    try:
        require_resistor(scene, "Monte Carlo")
    except LoadError:
        return LOAD_REFERENCE, [each for each in TIMED_METHODS if each.takes_loads]
    compiled = COMPILED_METHODS if "compiled" in runner.version("circuit") else ()
    return REFERENCE, [*TIMED_METHODS, *compiled]


def averages_once_more(scene: Scene, closure: str, report: Callable) -> dict[str, Any]:
    """A scene by a closure, timed with its code compiled (in a worker process)."""
    for _ in range(2):
        found = averages(scene, closure, None, False, report)
    return found


def _closures(scene, runner):
    """What the closures' tasks came to, by closure."""
    tasks = [
        Task(
            averages_once_more,
            {"scene": scene, "closure": each},
            label=each,
        )
        for each in CLOSURES
    ]
    return dict(zip(CLOSURES, runner.run(tasks), strict=True))


def _put_together(scene, reference, exact, runs, closures):
    whole = exact.quantities()
    last = OUTPUT_POWER if OUTPUT_POWER in whole else "mean_square_voltage"
    quantities = (last, "power_conversion_efficiency")
    scatter = {name: scatter_of(whole, name, exact.time) for name in quantities}
    nothing = Estimate(0.0, 0.0, None, "1")
    cost = exact.cost
    errors = {name: TotalError(nothing, scatter[name], cost) for name in quantities}
    lines = [_line(method.family, found, exact, whole, scatter) for method, found in runs if found]
    points = [
        _point(name, found, whole, quantities)
        for name, found in closures.items()
        if isinstance(found, dict)
    ]
    refused = {name: str(e) for name, e in closures.items() if isinstance(e, HarvesterError)}
    first = Line(reference.family, errors, exact.time, exact.cost)
    return TimeToAccuracy(scene, quantities, first, lines, points, refused)


def _line(name, found, exact, whole, scatter):
    if isinstance(found, HarvesterError):
        return Line(name, note=f"{type(found).__name__}: {found}")
    count = min(len(found.moments), len(exact.moments))
    own = found.moments[:count]
    sets = found.quantities(count), exact.quantities(count), whole
    errors = {
        quantity: TotalError(bias_of(quantity, own, exact.moments, sets), each, found.cost)
        for quantity, each in scatter.items()
    }
    return Line(name, errors, found.time, found.cost)


def _point(name, found, whole, quantities):
    deviations = {}
    for quantity in quantities:
        ours, theirs = found["quantities"][quantity], whole[quantity]
        ratio = ours.estimate / theirs.estimate
        own = (ours.standard_error or 0.0) / abs(theirs.estimate)
        far = abs(ratio) * (theirs.standard_error or 0.0) / abs(theirs.estimate)
        deviations[quantity] = Estimate(ratio - 1.0, math.hypot(own, far), None, "1")
    return Point(name, found["seconds"], deviations)
