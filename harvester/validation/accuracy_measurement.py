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
from harvester.base.errors import HarvesterError, LoadError, OutOfTime
from harvester.base.serialising import LEFT_OUT, key
from harvester.device import timescales
from harvester.engines.request import Answer, Request, answers_before_failure, told
from harvester.engines.runner import Runner
from harvester.engines.task import Task
from harvester.results.paired import paired_difference
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing
from harvester.scene.units import require_resistor
from harvester.validation import MEANS, STATES, exact_paths, throughput
from harvester.validation.accuracy_methods import (
    LOAD_METHODS,
    LOAD_PATHS,
    LOAD_REFERENCE,
    METHODS,
    REFERENCE,
    THOROUGH_METHODS,
    TIMED_LOAD_METHODS,
    TIMED_METHODS,
    ComparedMethod,
    with_compiled,
)
from harvester.validation.paths import from_rest
from harvester.validation.timed import Timed, closures, paths_at_knots, realizations_task

# Number of paths from which the errors of paths are measured.
PATHS = 4
# Length of a path in periods of small oscillations, and its greatest length in knots of the noise.
PERIODS = 12
MOST_KNOTS = 1000
# A method that is too slow for the scene's own run gets a brief one, with this many realizations
# and this many knots of the noise in each.
BRIEF_REALIZATIONS = 8
BRIEF_KNOTS = 4000
# `thorough` multiplies the numbers of paths and of realizations by this.
THOROUGH = 8
# Monte Carlo is timed by tasks of this many realizations: a single one is too short for the clock.
REALIZATIONS_TOGETHER = 16
# Most realizations of a timed run.
MOST_REALIZATIONS = 4096
# The circuit runs as many copies side by side as are fastest in a run of this many realizations.
LONG_RUN = 1000
# The reference runs for this multiple of a method's time.
REFERENCE_SHARE = 5.0
# Fewest tasks of each method, however long they take.
FEWEST_TASKS = 2
# Each realization has as many batches as in a run of so many realizations. Few realizations then
# still give an error bar.
BATCHED_AS = 8


@dataclass(frozen=True)
class MethodRow:
    """Measured errors and times of one method.

    Attributes
    ----------
    run : Timed or None
        The method's run for the means; None if it failed.
    note : str
        How it failed, or empty.
    mean_step : float
        Mean step of the runs for the strong errors (s); nan when they failed.
    strong : dict of str to float
        RMS error of each state over knots and paths, scaled; nan when a path failed, empty for
        runs by time.
    bias : dict of str to Estimate
        Bias of each mean as a share, paired with the reference; empty without a run.
    sampling : dict of str to float
        Standard error of each mean itself in a run of this length, as a share: σ/√N.
    """

    method: ComparedMethod = field(metadata=LEFT_OUT)
    run: Timed | None = field(metadata=LEFT_OUT)
    note: str = ""
    mean_step: float = math.nan
    strong: dict = field(default_factory=dict, metadata=key("strong_error"))
    bias: dict = field(default_factory=dict, metadata=LEFT_OUT)
    sampling: dict = field(default_factory=dict, metadata=key("sampling_error"))

    @property
    def simulated_time(self) -> float:
        """Time of the run for the means (s)."""
        return self.run.simulated_time if self.run else math.nan

    @property
    def seconds_per_unit(self) -> float:
        """Seconds of one core per simulated second."""
        return self.run.seconds / self.run.simulated_time if self.run else math.nan


@dataclass(frozen=True)
class Measured:
    """Measured errors and times of every method on one scene.

    Attributes
    ----------
    reference : ComparedMethod
        The method from whose runs biases are measured.
    references : dict of bool to Timed
        The reference's runs, by `ComparedMethod.brief`.
    closures : dict of str to dict
        For each closure that holds `quantities`, scaled, and `seconds`.
    refused : dict of str to str
        Closures that do not hold, with the reason.
    answer : Answer or None
        The reference's long run with its evidence; None for runs by time, as is all that follows.
    exact_paths : str
        Name of the solution from which strong errors are measured.
    horizon : float
        Length of the paths (s).
    speeds : dict
        `rows` of Throughput, none where the load is a netlist of more than a resistor, and the
        `machine` of all times.
    """

    scene: Scene
    rows: list[MethodRow]
    reference: ComparedMethod
    references: dict[bool, Timed]
    closures: dict
    refused: dict
    answer: Answer | None = None
    exact_paths: str = ""
    horizon: float = math.nan
    paths: int = 0
    speeds: dict = field(default_factory=dict)


def by_own_length(
    scene: Scene,
    runner: Runner,
    *,
    thorough: bool = False,
    methods: Sequence[ComparedMethod] | None = None,
) -> Measured:
    """Measure the methods by paths, and by the means of the scene's own run.

    Parameters
    ----------
    thorough : bool
        More paths, steps and realizations.
    methods : sequence of ComparedMethod or None
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
    short = _short_scene(scene, PATHS * factor)
    strong = _strong_errors(short, methods, _exact_paths(short, with_load, runner), runner)
    scenes = {
        False: scene.replace({"run.realizations": scene.run.realizations * factor}),
        True: _brief_scene(scene, BRIEF_REALIZATIONS * factor),
    }
    asked = [
        Request(run_scene, reference.engine, step=reference.step(run_scene), moments=True)
        for run_scene in scenes.values()
    ]
    answers = dict(zip(scenes, _there(runner.answer(asked)), strict=True))
    runs = _runs(scenes, methods, runner)
    averaged, refused = closures(scene, runner)
    references = {
        brief: Timed(scenes[brief], [{"moments": answer.moments, "seconds": answer.seconds}])
        for brief, answer in answers.items()
    }
    rows = [
        _row(method, run, errors, references[method.brief], answers[False])
        for method, run, errors in zip(methods, runs, strong, strict=True)
    ]
    return Measured(
        scene=scene,
        rows=rows,
        reference=reference,
        references=references,
        closures=averaged,
        refused=refused,
        answer=answers[False],
        exact_paths=LOAD_PATHS.family if with_load else "scipy's DOP853",
        horizon=short.run.duration,
        paths=short.run.realizations,
        speeds=speeds,
    )


def _row(method, run, errors, reference, answer):
    """A method's row; `answer` is the reference's longest run, which knows its means best."""
    mean_step, strong = errors
    if not isinstance(run, Timed):
        return MethodRow(method, None, run, mean_step, strong)
    differences = paired_difference(run, reference)
    # The sampling error is the same in every run of this length.
    shorter = math.sqrt(answer.simulated_time / run.simulated_time)
    bias = {name: differences[name] for name in MEANS if name in differences}
    sampling = {name: sampling_error(answer, name) * shorter for name in MEANS}
    return MethodRow(method, run, "", mean_step, strong, bias, sampling)


def sampling_error(reference: Answer, name: str) -> float:
    """Standard error of a mean as a share of it; nan without an error bar."""
    estimate = reference.quantities[name]
    if estimate.standard_error is None or not estimate.estimate:
        return math.nan
    return estimate.standard_error / abs(estimate.estimate)


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
    rows = [
        MethodRow(method, run) if isinstance(run, Timed) else MethodRow(method, None, told(run))
        for method, run in zip(methods, runs, strict=True)
        if run is not None
    ]
    references = {False: exact, True: exact}
    return Measured(scene, rows, reference, references, averaged, refused)


def _out_of_time():
    return OutOfTime("the time budget was spent before the reference was there")


def _there(outcomes):
    """The outcomes; raises the error of one that failed, or OutOfTime for a missing one."""
    for outcome in outcomes:
        if outcome is None or isinstance(outcome, HarvesterError):
            raise outcome or _out_of_time()
    return outcomes


def _has_load(scene):
    """Whether the load is a netlist that is more than a resistor; LoadError if it is not taken."""
    if scene.load.is_resistor:
        return False
    circuit_of(prepared(scene))
    return True


def _speeds(scene, measured, runner):
    """How fast every way to run the circuit is; a load with more than a resistor has but one."""
    if not measured:
        return {"rows": [], "machine": throughput.machine()}
    # It runs alone, since other tasks would slow down the processors that it measures.
    return _there(runner.run([throughput.task(scene, runner.version("circuit"))]))[0]


def _brief_scene(scene, realizations):
    """Runs for slow methods: half of each for the transient, or less where the scene says so."""
    model = prepared(scene)
    half = BRIEF_KNOTS // 2 * knot_spacing(model)
    run = {"duration": min(scene.run.duration, half), "settle": min(scene.run.settle, half)}
    return scene.replace(
        run={**run, "realizations": realizations}, excitation={"knot_spacing": knot_spacing(model)}
    )


def _short_scene(scene, paths):
    """Some periods from rest: short enough that paths do not separate."""
    model = prepared(scene)
    period = 2.0 * math.pi / timescales.angular_frequency(model.system)
    knots = min(math.ceil(PERIODS * period / knot_spacing(model)), MOST_KNOTS)
    return from_rest(scene, knots, paths)


def _exact_paths(scene, with_load, runner):
    """The states that errors are deviations of, shape (realizations, knots, 3)."""
    paths = range(scene.run.realizations)
    if with_load:
        tasks = [
            realizations_task(scene, LOAD_PATHS, [index], runner, paths_at_knots) for index in paths
        ]
        return np.concatenate([answer["states"] for answer in _there(runner.run(tasks))])
    tasks = [Task(exact_paths.run, {"scene": scene, "index": index}) for index in paths]
    return np.array(_there(runner.run(tasks)))


def _strong_errors(scene, methods, exact, runner):
    """Mean step (s) and RMS error of each state of every method."""
    together, alone = [range(len(exact))], [[index] for index in range(len(exact))]
    groups = [
        [
            realizations_task(scene, method, indices, runner, paths_at_knots)
            for indices in (together if method.copies is None else alone)
        ]
        for method in methods
    ]
    spacing = knot_spacing(prepared(scene))
    return [_strong_error(spacing, outcomes, exact) for outcomes in _answers(groups, runner)]


def _answers(groups, runner):
    outcomes = iter(runner.run([task for tasks in groups for task in tasks]))
    return [[next(outcomes) for _ in tasks] for tasks in groups]


def _strong_error(spacing, outcomes, exact):
    good, ended = answers_before_failure(outcomes)
    if ended:
        return math.nan, dict.fromkeys(STATES, math.nan)
    squares = np.square(np.concatenate([answer["states"] for answer in good]) - exact)
    errors = np.sqrt(squares.mean(axis=(0, 1))).tolist()
    points = sum(answer["points"] for answer in good)
    mean_step = exact.shape[1] * spacing * len(exact) / points
    return mean_step, dict(zip(STATES, errors, strict=True))


def _runs(scenes, methods, runner):
    """Each method's run for the means, or why there is none; `scenes` by `ComparedMethod.brief`."""
    groups = []
    for method in methods:
        scene = scenes[method.brief]
        size, count = method.together(scene), scene.run.realizations
        parts = [range(first, min(first + size, count)) for first in range(0, count, size)]
        groups.append([realizations_task(scene, method, part, runner) for part in parts])
    runs: list[Timed | str] = []
    for method, outcomes in zip(methods, _answers(groups, runner), strict=True):
        good, ended = answers_before_failure(outcomes)
        reason = told(ended) if isinstance(ended, HarvesterError) else ended
        runs.append(reason or Timed(scenes[method.brief], good))
    return runs


def _runs_by_time(scene, methods, seconds, runner):
    """`Timed`, the HarvesterError or None of each method; the first is the reference.

    The time of each method's first task decides how many more are run.
    """
    sizes = [_together(scene, method) for method in methods]

    def answers(spans):
        """For each method the answers of a span of tasks, with as many realizations as its size."""
        groups = [
            [
                realizations_task(scene, method, range(k * size, (k + 1) * size), runner)
                for k in span
            ]
            for method, size, span in zip(methods, sizes, spans, strict=True)
        ]
        return _answers(groups, runner)

    first = answers([range(1)] * len(methods))
    counts = _counts(sizes, [outcome for (outcome,) in first], seconds)
    remaining = answers([range(1, count) for count in counts])
    outcomes: list[Any] = []
    for first_outcomes, others in zip(first, remaining, strict=True):
        good, ended = answers_before_failure([*first_outcomes, *others])
        failed = ended if isinstance(ended, HarvesterError) else None
        outcomes.append(Timed(scene, good) if good else failed)
    return outcomes


def _counts(sizes, first, seconds):
    """Number of tasks for each method within its time, from the seconds of its first task."""
    counts = []
    for index, (size, outcome) in enumerate(zip(sizes, first, strict=True)):
        budget = seconds * (1.0 if index else REFERENCE_SHARE)
        task_seconds = outcome["seconds"] if isinstance(outcome, dict) else math.inf
        most = max(MOST_REALIZATIONS // size, 1)
        counts.append(min(max(int(budget / max(task_seconds, 1e-9)), FEWEST_TASKS), most))
    # The reference has every realization of the other methods, on the same noise.
    needed = max(count * size for count, size in zip(counts, sizes, strict=True))
    counts[0] = max(counts[0], math.ceil(needed / sizes[0]))
    return counts


def _together(scene, method):
    if method.engine == "monte-carlo":
        return REALIZATIONS_TOGETHER
    return method.together(scene.replace({"run.realizations": LONG_RUN}))
