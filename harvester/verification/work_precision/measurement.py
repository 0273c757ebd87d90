"""`work-precision`: the error of every method against its run time, on one scene.

*Strong* error: the path itself, against scipy's integrator on the same noise (with a netlist as
load, against the compiled engine at a 32nd of its step), over a time in which paths do not
separate. *Weak* error: the bias of means, paired with a fine Monte Carlo run on the same noise;
what lies below the sampling error of the run is noise, not bias.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, Unpack

import numpy as np

from circuits.kernel.engine import circuit_of
from harvester.calling import takes_scene
from harvester.device import timescales
from harvester.errors import HarvesterError, OutOfTime
from harvester.prepared.prepared import prepared
from harvester.prepared.steps import knot_spacing
from harvester.results.paired import paired_difference
from harvester.running import Request, RunnerOptions, Task, open_runner
from harvester.running.request import OUT_OF_TIME, good_ones, told
from harvester.scene.model import Scene
from harvester.simulation.realization import run
from harvester.simulation.simulate import require_noise
from harvester.verification.work_precision import throughput
from harvester.verification.work_precision.diagram import (
    MEANS,
    STATES,
    Row,
    WorkPrecision,
    relative_error,
)
from harvester.verification.work_precision.methods import (
    LOAD_METHODS,
    LOAD_PATHS,
    LOAD_REFERENCE,
    METHODS,
    REFERENCE,
    THOROUGH_METHODS,
    Method,
    with_compiled,
)
from harvester.verification.work_precision.reference_path import run as follow_exactly
from harvester.verification.work_precision.timed import Timed, closures
from harvester.verification.work_precision.timed import task as realizations_task

# Strong errors: paths, and the length of each in periods of small oscillations, or in knots
# where these are many.
PATHS = 4
PERIODS = 12
MOST_KNOTS = 1000
# Brief runs, for methods too slow for the scene's own: how many, and the knots of each.
BRIEF_REALIZATIONS = 8
BRIEF_KNOTS = 4000
# Between the longest and the shortest mean step from which an order can be read: tolerances
# change those of a PWL run little, which follow the restarts at its corners.
LEAST_RATIO = 2.0
# What --thorough multiplies paths and realizations by.
THOROUGH = 8


@takes_scene
def work_precision(
    scene: Scene,
    *,
    thorough: bool = False,
    methods: Sequence[Method] | None = None,
    **running: Unpack[RunnerOptions],
) -> WorkPrecision:
    """Measure the error and the run time of every method on a scene.

    Parameters
    ----------
    scene : Scene, str or Path
        Its run is the one whose means are compared.
    thorough : bool
        More paths, steps and realizations.
    methods : sequence of Method or None
        None: all of them, and the throughput of every way to run the circuit.
    **running
        See `harvester.running.open_runner`. What is kept holds the times that were measured.

    Returns
    -------
    WorkPrecision

    Raises
    ------
    HarvesterError
        The reference itself failed.
    OutOfTime
        The time budget was spent before it was there.
    """
    require_noise(scene, "work-precision")
    with_load = _has_load(scene)
    reference = LOAD_REFERENCE if with_load else REFERENCE
    factor = THOROUGH if thorough else 1
    with open_runner(**running) as runner:
        speeds = _speeds(scene, methods is None and not with_load, runner)
        if methods is None:
            every = THOROUGH_METHODS if thorough else METHODS
            methods = LOAD_METHODS if with_load else with_compiled(every, runner)
        methods = tuple(methods)
        short = _strong_scene(scene, PATHS * factor)
        strong = _strong_errors(short, methods, _exact_paths(short, with_load, runner), runner)
        runs = {
            False: scene.replace({"run.realizations": scene.run.realizations * factor}),
            True: _brief_scene(scene, BRIEF_REALIZATIONS * factor),
        }
        asked = [
            Request(each, reference.engine, step=reference.step(each), moments=True)
            for each in runs.values()
        ]
        references = dict(zip(runs, _there(runner.answer(asked)), strict=True))
        means = _means(runs, references, methods, runner)
        averaged, refused = closures(scene, runner)
    rows = [
        Row(method, *errors, **rest)
        for method, errors, rest in zip(methods, strong, means, strict=True)
    ]
    return WorkPrecision(
        scene=scene,
        rows=rows,
        orders=_orders(rows),
        reference=references[False],
        reference_method=reference,
        exact_paths=LOAD_PATHS.family if with_load else "scipy's DOP853",
        closures=averaged,
        refused=refused,
        horizon=short.run.duration,
        paths=short.run.realizations,
        throughput=speeds["rows"],
        machine=speeds["machine"],
    )


def _has_load(scene):
    """Whether the load is a netlist that is more than a resistor, and the compiled engine takes it.

    Raises
    ------
    LoadError
        It does not.
    """
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


def _there(outcomes):
    """What there is no diagram without: outcomes, none of which failed or is missing."""
    for each in outcomes:
        if isinstance(each, HarvesterError):
            raise each
        if each is None:
            raise OutOfTime("the time budget was spent before the reference was there")
    return outcomes


def _strong_scene(scene, paths):
    """Some periods from rest: short enough that paths do not separate."""
    ready = prepared(scene)
    parameters = ready.system
    spacing = knot_spacing(ready)
    knots = math.ceil(PERIODS * 2.0 * math.pi / timescales.angular_frequency(parameters) / spacing)
    length = min(knots, MOST_KNOTS) * spacing
    return scene.replace(
        {
            "run.duration": length,
            "run.settle": 0.0,
            "run.realizations": paths,
            "excitation.knot_spacing": spacing,
        }
    )


def _brief_scene(scene, realizations):
    """Runs for slow methods: half of each for the transient, or less where the scene says so."""
    ready = prepared(scene)
    half = BRIEF_KNOTS // 2 * knot_spacing(ready)
    run = {"duration": min(scene.run.duration, half), "settle": min(scene.run.settle, half)}
    return scene.replace(
        run={**run, "realizations": realizations},
        excitation={"knot_spacing": knot_spacing(ready)},
    )


def paths_at_knots(
    scene: Scene, method: dict[str, Any], indices: list[int], report: Callable
) -> dict[str, Any]:
    """The paths of a few realizations, called as `timed` is.

    Returns
    -------
    dict
        `states`, shape (realizations, knots, 3), at the knots 1, 2, …; `points` of all records.
    """
    window = (0.0, 2.0 * scene.run.duration)
    found = run(scene, indices=indices, window=window, report=report, **method)
    spacing = knot_spacing(prepared(scene))
    times = spacing * np.arange(1, round(scene.run.duration / spacing) + 1)
    waveforms: Any = [each.waveform for each in found]
    # Every method has the knots among its points.
    states = [
        [np.interp(times, each.time, getattr(each, name)) for name in STATES] for each in waveforms
    ]
    points = sum(each.moments.points for each in found)
    return {"states": np.array(states).transpose(0, 2, 1), "points": points}


def _exact_paths(scene, with_load, runner):
    """The states that errors are reckoned against, shape (realizations, knots, 3)."""
    paths = range(scene.run.realizations)
    if with_load:
        tasks = [
            realizations_task(scene, LOAD_PATHS, [index], runner, paths_at_knots) for index in paths
        ]
        return np.concatenate([each["states"] for each in _there(runner.run(tasks))])
    tasks = [Task(follow_exactly, {"scene": scene, "index": index}) for index in paths]
    return np.array(_there(runner.run(tasks)))


def _strong_errors(scene, methods, truth, runner):
    """(mean step, RMS error of each state) of every method."""
    paths = range(scene.run.realizations)
    split = [[paths] if method.copies is None else [[k] for k in paths] for method in methods]
    tasks = [
        realizations_task(scene, method, together, runner, paths_at_knots)
        for method, netlists in zip(methods, split, strict=True)
        for together in netlists
    ]
    outcomes = iter(runner.run(tasks))
    return [_strong_error(scene, [next(outcomes) for _ in netlists], truth) for netlists in split]


def _strong_error(scene, outcomes, exact):
    good, ended = good_ones(outcomes)
    if ended:
        return math.nan, dict.fromkeys(STATES, math.nan)
    squares = np.square(np.concatenate([each["states"] for each in good]) - exact)
    errors = np.sqrt(squares.mean(axis=(0, 1)))
    points = sum(each["points"] for each in good)
    return exact.shape[1] * knot_spacing(prepared(scene)) * len(exact) / points, {
        name: float(error) for name, error in zip(STATES, errors, strict=True)
    }


def _means(runs, references, methods, runner):
    """Bias, sampling error and time of every method, each as the rest of a Row.

    `runs` and `references` hold the scene's own run (False) and the brief one (True).
    """
    split = []
    for method in methods:
        scene = runs[method.brief]
        size, count = method.together(scene), scene.run.realizations
        split.append(
            [
                realizations_task(scene, method, range(first, min(first + size, count)), runner)
                for first in range(0, count, size)
            ]
        )
    outcomes = iter(runner.run([task for tasks in split for task in tasks]))
    return [
        _means_of(method, runs, references, [next(outcomes) for _ in tasks])
        for method, tasks in zip(methods, split, strict=True)
    ]


def _means_of(method, runs, references, outcomes):
    good, ended = good_ones(outcomes)
    if ended:
        return {
            "bias": {},
            "sampling": {},
            "simulated_time": math.nan,
            "seconds_per_unit": math.nan,
            "note": ended if ended == OUT_OF_TIME else told(ended),
        }
    found, reference = Timed(runs[method.brief], good), references[False]
    differences = paired_difference(found, references[method.brief])
    # The same in every run of this length; from the longest one, which knows it best.
    shorter = math.sqrt(reference.simulated_time / found.simulated_time)
    return {
        "bias": {name: differences[name] for name in MEANS if name in differences},
        "sampling": {name: relative_error(reference, name) * shorter for name in MEANS},
        "simulated_time": found.simulated_time,
        "seconds_per_unit": found.seconds / found.simulated_time,
        "note": "",
    }


def _orders(rows):
    """Least-squares slope of log error over log mean step, per family and state."""
    orders = {}
    for family in dict.fromkeys(row.method.family for row in rows):
        ours = [row for row in rows if row.method.family == family and row.mean_step > 0.0]
        steps = np.log([row.mean_step for row in ours])
        if len(ours) < 2 or np.ptp(steps) < math.log(LEAST_RATIO):
            orders[family] = dict.fromkeys(STATES, math.nan)
            continue
        orders[family] = {
            name: float(np.polyfit(steps, np.log([row.strong[name] for row in ours]), 1)[0])
            for name in STATES
        }
    return orders
