"""`time-to-accuracy`: how long every method takes to an error of 10, 3 and 1 % on one scene."""

import math
from typing import Unpack

from harvester.calling import takes_scene
from harvester.errors import HarvesterError, LoadError, OutOfTime, SceneError
from harvester.estimates.estimate import Estimate
from harvester.running import RunnerOptions, open_runner
from harvester.running.request import good_ones, told
from harvester.scene.model import Scene
from harvester.scene.units import require_resistor
from harvester.simulation.simulate import require_noise
from harvester.verification.work_precision.accuracy import (
    OUTPUT_POWER,
    TotalError,
    bias_of,
    scatter_of,
)
from harvester.verification.work_precision.accuracy_table import Line, Point, TimeToAccuracy
from harvester.verification.work_precision.methods import (
    LOAD_REFERENCE,
    REFERENCE,
    TIMED_LOAD_METHODS,
    TIMED_METHODS,
    with_compiled,
)
from harvester.verification.work_precision.timed import Timed, closures, task

# Seconds of one core that a method's run may take, and the reference's in units of it.
SECONDS = 10.0
REFERENCE_SHARE = 5.0
# Realizations in one task of Monte Carlo: each by itself is done before a clock sees it.
REALIZATIONS_TOGETHER = 16
MOST_REALIZATIONS = 4096
# Realizations of a run in which as many copies stand side by side as pay.
LONG_RUN = 1000
# Tasks of each method, however long they take.
FEWEST_TASKS = 2
# A realization has its batches as if there were so many: few give an error bar, too.
BATCHED_AS = 8


@takes_scene
def time_to_accuracy(
    scene: Scene,
    *,
    seconds: float = SECONDS,
    **running: Unpack[RunnerOptions],
) -> TimeToAccuracy:
    """Measure how the error of every method falls with its wall time.

    Parameters
    ----------
    scene : Scene, str or Path
        Its run gives the length of each realization.
    seconds : float
        Seconds of one core that each method's run may take: the longer, the better are biases
        known.
    **running
        See `harvester.running.open_runner`. What is kept holds the times that were measured.

    Returns
    -------
    TimeToAccuracy

    Raises
    ------
    HarvesterError
        The excitation is no noise, or the reference failed.
    OutOfTime
        The time budget was spent before the reference was there.
    """
    require_noise(scene, "time-to-accuracy")
    if not seconds > 0.0:
        raise SceneError(f"time-to-accuracy: {seconds:g} seconds a method: must be > 0")
    with open_runner(**running) as runner:
        reference, methods = _methods(scene, runner)
        batched = scene.replace({"run.realizations": BATCHED_AS})
        exact, *runs = _runs(batched, [reference, *methods], seconds, runner)
        averaged, refused = closures(scene, runner)
    if not isinstance(exact, Timed):
        raise exact or OutOfTime("the time budget was spent before the reference was there")
    runs = list(zip(methods, runs, strict=True))
    return _put_together(scene, reference, exact, runs, averaged, refused)


def _runs(scene, methods, seconds, runner):
    """`Timed`, the HarvesterError or None of each method; the first is the reference.

    A first task of each tells how many more there is time for.
    """
    sizes = [_together(scene, method) for method in methods]
    first = runner.run(_tasks(scene, methods, sizes, [(0, 1)] * len(methods), runner))
    counts = _counts(methods, sizes, first, seconds)
    rest = iter(runner.run(_tasks(scene, methods, sizes, [(1, n) for n in counts], runner)))
    outcomes = []
    for found, count in zip(first, counts, strict=True):
        good, ended = good_ones([found, *(next(rest) for _ in range(1, count))])
        failed = ended if isinstance(ended, HarvesterError) else None
        outcomes.append(Timed(scene, good) if good else failed)
    return outcomes


def _tasks(scene, methods, sizes, spans, runner):
    """Of each method those from one to before another."""
    return [
        task(scene, method, range(place * size, (place + 1) * size), runner)
        for method, size, span in zip(methods, sizes, spans, strict=True)
        for place in range(*span)
    ]


def _counts(methods, sizes, first, seconds):
    """Tasks of each method that its time allows."""
    counts = []
    for place, (size, found) in enumerate(zip(sizes, first, strict=True)):
        budget = seconds * (1.0 if place else REFERENCE_SHARE)
        taken = found["seconds"] if isinstance(found, dict) else math.inf
        most = max(MOST_REALIZATIONS // size, 1)
        counts.append(min(max(int(budget / max(taken, 1e-9)), FEWEST_TASKS), most))
    # The reference is to hold every realization of the others, on the same noise.
    if methods[0].engine == "monte-carlo":
        wanted = max(count * size for count, size in zip(counts, sizes, strict=True))
        counts[0] = max(counts[0], math.ceil(wanted / sizes[0]))
    return counts


def _together(scene, method):
    """Realizations in one task."""
    if method.engine == "monte-carlo":
        return REALIZATIONS_TOGETHER
    return method.together(scene.replace({"run.realizations": LONG_RUN}))


def _methods(scene, runner):
    """The reference, and the methods that take this scene's load."""
    try:
        require_resistor(scene, "Monte Carlo")
    except LoadError:
        return LOAD_REFERENCE, TIMED_LOAD_METHODS
    return REFERENCE, with_compiled(TIMED_METHODS, runner)


def _put_together(scene, reference, exact, runs, averaged, refused):
    whole = exact.quantities()
    last = OUTPUT_POWER if OUTPUT_POWER in whole else "mean_square_voltage"
    quantities = (last, "power_conversion_efficiency")
    scatter = {name: scatter_of(whole, name, exact.measured_time) for name in quantities}
    nothing = Estimate(0.0, 0.0, None, "1")
    errors = {name: TotalError(nothing, scatter[name], exact.cost) for name in quantities}
    lines = [_line(method.family, found, exact, whole, scatter) for method, found in runs if found]
    points = [_point(name, found, whole, quantities) for name, found in averaged.items()]
    first = Line(reference.family, errors, exact.measured_time, exact.cost)
    return TimeToAccuracy(scene, quantities, first, lines, points, refused)


def _line(name, found, exact, whole, scatter):
    if isinstance(found, HarvesterError):
        return Line(name, note=told(found))
    count = min(len(found.moments), len(exact.moments))
    own = found.moments[:count]
    sets = found.quantities(count), exact.quantities(count), whole
    errors = {
        quantity: TotalError(bias_of(quantity, own, exact.moments, sets), each, found.cost)
        for quantity, each in scatter.items()
    }
    return Line(name, errors, found.measured_time, found.cost)


def _point(name, found, whole, quantities):
    deviations = {}
    for quantity in quantities:
        ours, theirs = found["quantities"][quantity], whole[quantity]
        ratio = ours.estimate / theirs.estimate
        own = (ours.standard_error or 0.0) / abs(theirs.estimate)
        far = abs(ratio) * (theirs.standard_error or 0.0) / abs(theirs.estimate)
        deviations[quantity] = Estimate(ratio - 1.0, math.hypot(own, far), None, "1")
    return Point(name, found["seconds"], deviations)
