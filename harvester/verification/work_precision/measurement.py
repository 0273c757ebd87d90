"""`work-precision`: the error of every method against its run time, on one scene.

*Strong* error: the path itself, against scipy's integrator on the same noise, over a time in
which paths do not separate. *Weak* error: the bias of means, paired with a fine Monte Carlo run
on the same noise; what lies below the sampling error of the run is noise, not bias.
"""

import datetime
import math
import os
import platform
from collections.abc import Callable, Sequence

import numpy as np

from harvester.averaging import CLOSURES
from harvester.averaging.of_scene import average
from harvester.calling import takes_scene
from harvester.device import timescales
from harvester.engines.circuit import describe
from harvester.engines.pools import WorkerPool
from harvester.engines.realization import run as simulate_realizations
from harvester.engines.steps import knot_spacing
from harvester.errors import AveragingError, EnergyNotBalanced, SimulationError
from harvester.estimates.paired import paired_difference
from harvester.scene.model import Scene
from harvester.scene.units import require_resistor, scale
from harvester.simulation import require_noise, simulate
from harvester.verification.work_precision import throughput
from harvester.verification.work_precision.diagram import (
    MEANS,
    STATES,
    Row,
    WorkPrecision,
    relative_error,
)
from harvester.verification.work_precision.methods import (
    COMPILED_METHODS,
    METHODS,
    THOROUGH_METHODS,
    Method,
)
from harvester.verification.work_precision.reference_path import run as follow_exactly

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
# Monte Carlo step that the means are compared with.
REFERENCE_STEP = "fine"
# What --thorough multiplies paths and realizations by.
THOROUGH = 8


@takes_scene
def work_precision(
    scene: Scene,
    *,
    thorough: bool = False,
    workers: int | None = None,
    methods: Sequence[Method] | None = None,
    progress: Callable | None = None,
) -> WorkPrecision:
    """Measure the error and the run time of every method on a scene.

    Parameters
    ----------
    scene : Scene, str or Path
        Its run is the one whose means are compared.
    thorough : bool
        More paths, steps and realizations.
    workers : int or None
        Processes; None: one per core.
    methods : sequence of Method or None
        None: all of them.
    progress : callable or None
        Given (label, scene), returns the callback for the share done.

    Returns
    -------
    WorkPrecision

    Raises
    ------
    HarvesterError, SimulationError
        The reference itself failed.
    """
    require_noise(scene, "work-precision")
    require_resistor(scene, "work-precision")
    chosen = methods or (THOROUGH_METHODS if thorough else METHODS)
    factor = THOROUGH if thorough else 1
    progress = progress or (lambda label, scene: None)
    short = _strong_scene(scene, PATHS * factor)
    runs = {
        False: scene.replace({"run.realizations": scene.run.realizations * factor}),
        True: _brief_scene(scene, BRIEF_REALIZATIONS * factor),
    }
    with WorkerPool(workers=workers) as pool:
        compiled = not pool.map(describe, [{}])[0]["compiled_device_off"]
        methods = (*chosen, *COMPILED_METHODS) if compiled and not methods else chosen
        speeds = throughput.measure(scene, pool, compiled)
        strong = _strong_errors(short, methods, pool, progress("strong errors", short))
        references = {
            brief: _simulate(run, pool, progress("reference", run), step=REFERENCE_STEP)
            for brief, run in runs.items()
        }
        rows = [
            Row(method, *errors, **_means(method, runs, references, pool, progress))
            for method, errors in zip(methods, strong, strict=True)
        ]
    closures, refused = _closures(scene)
    return WorkPrecision(
        scene=scene,
        rows=rows,
        orders=_orders(rows),
        reference=references[False],
        closures=closures,
        refused=refused,
        horizon=short.run.duration,
        paths=short.run.realizations,
        throughput=speeds,
        machine=_machine(references[False]),
    )


def _strong_scene(scene, paths):
    """Some periods from rest: short enough that paths do not separate."""
    parameters, _ = scale(scene)
    spacing = knot_spacing(scene)
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
    half = BRIEF_KNOTS // 2 * knot_spacing(scene)
    run = {"duration": min(scene.run.duration, half), "settle": min(scene.run.settle, half)}
    return scene.replace(
        run={**run, "realizations": realizations},
        excitation={"knot_spacing": knot_spacing(scene)},
    )


def _strong_errors(scene, methods, pool, follow):
    """(mean step, RMS error of each state) of every method."""
    indices = range(scene.run.realizations)
    exact = pool.map(
        follow_exactly,
        [{"scene": scene, "index": index} for index in indices],
    )
    window = (0.0, 2.0 * scene.run.duration)
    calls = [
        {"scene": scene, "indices": together, "window": window, **method.options(scene)}
        for method in methods
        for together in ([list(indices)] if method.copies is None else [[k] for k in indices])
    ]
    outcomes = iter(pool.map(simulate_realizations, calls, keep_going=True))
    if follow:
        follow(1.0)
    errors = []
    for method in methods:
        netlists = 1 if method.copies is None else len(indices)
        errors.append(_strong_error(scene, [next(outcomes) for _ in range(netlists)], exact))
    return errors


def _strong_error(scene, outcomes, exact):
    if any(isinstance(outcome, SimulationError) for outcome in outcomes):
        return math.nan, dict.fromkeys(STATES, math.nan)
    paths = [path for outcome in outcomes for path in outcome]
    spacing = knot_spacing(scene)
    times = spacing * np.arange(1, len(exact[0]) + 1)
    errors = {}
    for column, name in enumerate(STATES):
        # Every method has the knots among its points.
        differences = [
            np.interp(times, path.waveform.time, getattr(path.waveform, name)) - states[:, column]
            for path, states in zip(paths, exact, strict=True)
        ]
        errors[name] = float(np.sqrt(np.mean(np.square(differences))))
    steps = sum(path.moments.points for path in paths)
    return float(times[-1]) * len(paths) / steps, errors


def _simulate(scene, pool, follow, engine="monte-carlo", **options):
    """A complete result, also when its energy balance does not close."""
    try:
        return simulate(scene, method=engine, runner=pool, progress=follow, **options)
    except EnergyNotBalanced as error:
        return error.partial


def _means(method, runs, references, pool, progress):
    """Bias, sampling error and time of one method, as the rest of a Row.

    `runs` and `references` hold the scene's own run (False) and the brief one (True).
    """
    scene, reference = runs[method.brief], references[False]
    follow = progress(f"{method.family}, {method.setting(scene)}", scene)
    try:
        result = _simulate(scene, pool, follow, copies=method.copies, **method.options(scene))
    except SimulationError as error:
        return {
            "bias": {},
            "sampling": {},
            "simulated_time": math.nan,
            "seconds_per_unit": math.nan,
            "note": f"{type(error).__name__}: {error}",
        }
    differences = paired_difference(result, references[method.brief])
    # The same in every run of this length; from the longest one, which knows it best.
    shorter = math.sqrt(reference.simulated_time / result.simulated_time)
    return {
        "bias": {name: differences[name] for name in MEANS if name in differences},
        "sampling": {name: relative_error(reference, name) * shorter for name in MEANS},
        "simulated_time": result.simulated_time,
        "seconds_per_unit": result.engine_seconds / result.simulated_time,
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


def _closures(scene):
    """Results of the closures that hold, and why the others do not."""
    results, refused = {}, {}
    for closure in CLOSURES:
        try:
            results[closure] = average(scene, method=closure)
        except AveragingError as error:
            refused[closure] = str(error)
    return results, refused


def _machine(reference):
    return {
        "date": datetime.date.today().isoformat(),
        "cores": os.cpu_count(),
        "processor": platform.processor() or platform.machine(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "monte_carlo": reference.engine_version,
    }
