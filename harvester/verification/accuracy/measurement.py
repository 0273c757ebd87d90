"""One measurement of every method on one scene: its paths, its means, and the time that they take.

*Strong* error: the path itself, against scipy's integrator on the same noise (with a netlist as
load, against the compiled engine at a 32nd of its step), over a time in which paths do not
separate. *Weak* error: the bias of means against a fine Monte Carlo run on the same noise.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from circuits.kernel.engine import circuit_of
from harvester.device import timescales
from harvester.errors import HarvesterError, LoadError, OutOfTime
from harvester.prepared.prepared import prepared
from harvester.prepared.steps import knot_spacing
from harvester.running import Answer, Request, Runner, Task
from harvester.running.request import OUT_OF_TIME, good_ones, told
from harvester.scene.model import Scene
from harvester.scene.units import require_resistor
from harvester.verification import exact_paths
from harvester.verification.accuracy import throughput
from harvester.verification.accuracy.methods import (
    LOAD_METHODS,
    LOAD_PATHS,
    LOAD_REFERENCE,
    METHODS,
    REFERENCE,
    THOROUGH_METHODS,
    TIMED_LOAD_METHODS,
    TIMED_METHODS,
    Method,
    with_compiled,
)
from harvester.verification.accuracy.timed import (
    Timed,
    closures,
    paths_at_knots,
    realizations_task,
)
from harvester.verification.quantities import STATES

# Strong errors: paths, and the length of each in periods of small oscillations, or in knots
# where these are many.
PATHS = 4
PERIODS = 12
MOST_KNOTS = 1000
# Brief runs, for methods too slow for the scene's own: how many, and the knots of each.
BRIEF_REALIZATIONS = 8
BRIEF_KNOTS = 4000
# Factor of `thorough` on the numbers of paths and of realizations.
THOROUGH = 8
# Runs by time: Monte Carlo's realizations in one task (each by itself is done before a clock sees
# it), most in all, and the number of a run in which as many copies stand side by side as pay.
REALIZATIONS_TOGETHER = 16
MOST_REALIZATIONS = 4096
LONG_RUN = 1000
# Seconds of the reference's run by time, in those of a method's.
REFERENCE_SHARE = 5.0
# Fewest tasks of each method, however long they take.
FEWEST_TASKS = 2
# Each realization has its batches as if there were so many: few give an error bar, too.
BATCHED_AS = 8


@dataclass(frozen=True)
class Strong:
    """Errors of paths: of each method the mean step (s) and the RMS error of each state.

    Attributes
    ----------
    errors : list of (float, dict of str to float)
        Scaled, over knots and paths; nan where a path failed.
    exact : str
        What the errors are deviations from.
    horizon : float
        Length of the paths (s).
    """

    errors: list
    exact: str
    horizon: float
    paths: int


@dataclass(frozen=True)
class Measured:
    """What was measured of every method on one scene.

    Attributes
    ----------
    runs : list of Timed or str
        Of each method its run for the means; text says why there is none.
    reference : Method
        Its runs are what biases are deviations from.
    references : dict of bool to Timed
        Those runs, by `Method.brief`.
    closures : dict of str to dict
        Of those that hold `quantities`, scaled, and `seconds`.
    refused : dict of str to str
        Closures that do not hold, with the reason.
    answer : Answer or None
        The reference's long run with its evidence; None for runs by time.
    strong : Strong or None
        None for runs by time.
    speeds : dict
        `rows` of Throughput, none where the load is a netlist of more than a resistor, and the
        `machine` of all times.
    """

    scene: Scene
    methods: tuple[Method, ...]
    runs: list
    reference: Method
    references: dict[bool, Timed]
    closures: dict
    refused: dict
    answer: Answer | None = None
    strong: Strong | None = None
    speeds: dict = field(default_factory=dict)


def by_own_length(
    scene: Scene, runner: Runner, *, thorough: bool = False, methods: Sequence[Method] | None = None
) -> Measured:
    """Measure the methods by paths, and by the means of the scene's own run.

    Parameters
    ----------
    thorough : bool
        More paths, steps and realizations.
    methods : sequence of Method or None
        None: all of them, and the throughput of every way to run the circuit.

    Raises
    ------
    HarvesterError
        The reference itself failed.
    OutOfTime
        The time budget was spent before it was there.
    """
    with_load = _has_load(scene)
    reference = LOAD_REFERENCE if with_load else REFERENCE
    factor = THOROUGH if thorough else 1
    speeds = _speeds(scene, methods is None and not with_load, runner)
    if methods is None:
        every = THOROUGH_METHODS if thorough else METHODS
        methods = LOAD_METHODS if with_load else with_compiled(every, runner)
    methods = tuple(methods)
    strong = _strong(scene, methods, PATHS * factor, with_load, runner)
    scenes = {
        False: scene.replace({"run.realizations": scene.run.realizations * factor}),
        True: _brief_scene(scene, BRIEF_REALIZATIONS * factor),
    }
    asked = [
        Request(each, reference.engine, step=reference.step(each), moments=True)
        for each in scenes.values()
    ]
    answers = dict(zip(scenes, _there(runner.answer(asked)), strict=True))
    runs = _runs(scenes, methods, runner)
    averaged, refused = closures(scene, runner)
    references = {brief: _timed(scenes[brief], answer) for brief, answer in answers.items()}
    return Measured(
        scene,
        methods,
        runs,
        reference,
        references,
        averaged,
        refused,
        answers[False],
        strong,
        speeds,
    )


def by_time(scene: Scene, runner: Runner, seconds: float) -> Measured:
    """Measure one setting of each family by the means of runs that take so long on one core.

    Raises
    ------
    HarvesterError
        The reference failed.
    OutOfTime
        The time budget was spent before it was there.
    """
    try:
        require_resistor(scene, "Monte Carlo")
        reference, methods = REFERENCE, with_compiled(TIMED_METHODS, runner)
    except LoadError:
        reference, methods = LOAD_REFERENCE, TIMED_LOAD_METHODS
    batched = scene.replace({"run.realizations": BATCHED_AS})
    exact, *runs = _runs_by_time(batched, (reference, *methods), seconds, runner)
    averaged, refused = closures(scene, runner)
    if not isinstance(exact, Timed):
        raise exact or _out_of_time()
    runs = [told(each) if isinstance(each, HarvesterError) else each for each in runs]
    known = [pair for pair in zip(methods, runs, strict=True) if pair[1]]
    methods, runs = tuple(method for method, _ in known), [run for _, run in known]
    references = {False: exact, True: exact}
    return Measured(scene, methods, runs, reference, references, averaged, refused)


def _out_of_time():
    return OutOfTime("the time budget was spent before the reference was there")


def _there(outcomes):
    """Outcomes without which there is no measurement: none failed or is missing."""
    for each in outcomes:
        if each is None or isinstance(each, HarvesterError):
            raise each or _out_of_time()
    return outcomes


def _timed(scene, answer):
    return Timed(scene, [{"moments": answer.moments, "seconds": answer.seconds}])


def _has_load(scene):
    """Whether the load is a netlist that is more than a resistor; LoadError if it is not taken."""
    if scene.load.is_resistor:
        return False
    circuit_of(scene)
    return True


def _speeds(scene, measured, runner):
    """How fast every way to run the circuit is; a load with more than a resistor has but one."""
    if not measured:
        return {"rows": [], "machine": throughput.machine()}
    # By itself: the other tasks would take the processors that it measures.
    return _there(runner.run([throughput.task(scene, runner.version("circuit"))]))[0]


def _brief_scene(scene, realizations):
    """Runs for slow methods: half of each for the transient, or less where the scene says so."""
    ready = prepared(scene)
    half = BRIEF_KNOTS // 2 * knot_spacing(ready)
    run = {"duration": min(scene.run.duration, half), "settle": min(scene.run.settle, half)}
    return scene.replace(
        run={**run, "realizations": realizations},
        excitation={"knot_spacing": knot_spacing(ready)},
    )


def _strong(scene, methods, paths, with_load, runner):
    """Errors of some periods from rest: short enough that paths do not separate."""
    ready = prepared(scene)
    spacing = knot_spacing(ready)
    period = 2.0 * math.pi / timescales.angular_frequency(ready.system)
    length = min(math.ceil(PERIODS * period / spacing), MOST_KNOTS) * spacing
    changes = {
        "run.duration": length,
        "run.settle": 0.0,
        "run.realizations": paths,
        "excitation.knot_spacing": spacing,
    }
    short = scene.replace(changes)
    exact = _exact_paths(short, with_load, runner)
    indices = range(paths)
    split = [[indices] if method.copies is None else [[k] for k in indices] for method in methods]
    tasks = [
        realizations_task(short, method, together, runner, paths_at_knots)
        for method, netlists in zip(methods, split, strict=True)
        for together in netlists
    ]
    outcomes = iter(runner.run(tasks))
    errors = [
        _strong_error(spacing, [next(outcomes) for _ in netlists], exact) for netlists in split
    ]
    name = LOAD_PATHS.family if with_load else "scipy's DOP853"
    return Strong(errors, name, length, paths)


def _exact_paths(scene, with_load, runner):
    """The states that errors are deviations of, shape (realizations, knots, 3)."""
    paths = range(scene.run.realizations)
    if with_load:
        tasks = [
            realizations_task(scene, LOAD_PATHS, [index], runner, paths_at_knots) for index in paths
        ]
        return np.concatenate([each["states"] for each in _there(runner.run(tasks))])
    tasks = [Task(exact_paths.run, {"scene": scene, "index": index}) for index in paths]
    return np.array(_there(runner.run(tasks)))


def _strong_error(spacing, outcomes, exact):
    """Mean step (s) and RMS error of each state of one method."""
    good, ended = good_ones(outcomes)
    if ended:
        return math.nan, dict.fromkeys(STATES, math.nan)
    squares = np.square(np.concatenate([each["states"] for each in good]) - exact)
    errors = np.sqrt(squares.mean(axis=(0, 1)))
    points = sum(each["points"] for each in good)
    mean_step = exact.shape[1] * spacing * len(exact) / points
    return mean_step, {name: float(e) for name, e in zip(STATES, errors, strict=True)}


def _runs(scenes, methods, runner):
    """Each method's run for the means, or why there is none; `scenes` by `Method.brief`."""
    split = []
    for method in methods:
        scene = scenes[method.brief]
        size, count = method.together(scene), scene.run.realizations
        parts = [range(first, min(first + size, count)) for first in range(0, count, size)]
        split.append([realizations_task(scene, method, part, runner) for part in parts])
    outcomes = iter(runner.run([task for tasks in split for task in tasks]))
    runs: list[Timed | str] = []
    for method, tasks in zip(methods, split, strict=True):
        good, ended = good_ones([next(outcomes) for _ in tasks])
        if ended:
            runs.append(ended if ended == OUT_OF_TIME else told(ended))
        else:
            runs.append(Timed(scenes[method.brief], good))
    return runs


def _runs_by_time(scene, methods, seconds, runner):
    """`Timed`, the HarvesterError or None of each method; the first is the reference.

    A first task of each tells how many more there is time for.
    """
    sizes = [_together(scene, method) for method in methods]
    first = runner.run(_tasks(scene, methods, sizes, [(0, 1)] * len(methods), runner))
    counts = _counts(sizes, first, seconds)
    rest = iter(runner.run(_tasks(scene, methods, sizes, [(1, n) for n in counts], runner)))
    outcomes: list[Any] = []
    for found, count in zip(first, counts, strict=True):
        good, ended = good_ones([found, *(next(rest) for _ in range(1, count))])
        failed = ended if isinstance(ended, HarvesterError) else None
        outcomes.append(Timed(scene, good) if good else failed)
    return outcomes


def _tasks(scene, methods, sizes, spans, runner):
    """Tasks of each method from the first to before the last of its span."""
    return [
        realizations_task(scene, method, range(place * size, (place + 1) * size), runner)
        for method, size, span in zip(methods, sizes, spans, strict=True)
        for place in range(*span)
    ]


def _counts(sizes, first, seconds):
    """Tasks of each method that its time allows."""
    counts = []
    for place, (size, found) in enumerate(zip(sizes, first, strict=True)):
        budget = seconds * (1.0 if place else REFERENCE_SHARE)
        taken = found["seconds"] if isinstance(found, dict) else math.inf
        most = max(MOST_REALIZATIONS // size, 1)
        counts.append(min(max(int(budget / max(taken, 1e-9)), FEWEST_TASKS), most))
    # The reference holds every realization of the others, on the same noise.
    wanted = max(count * size for count, size in zip(counts, sizes, strict=True))
    counts[0] = max(counts[0], math.ceil(wanted / sizes[0]))
    return counts


def _together(scene, method):
    """Realizations in one task."""
    if method.engine == "monte-carlo":
        return REALIZATIONS_TOGETHER
    return method.together(scene.replace({"run.realizations": LONG_RUN}))
