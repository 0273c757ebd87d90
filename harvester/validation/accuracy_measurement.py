"""Measures errors of paths and means, and computing times, of every method on one scene.

*Strong* error: deviation of the path from scipy's integrator on the same noise (with a netlist as
load: from the compiled engine at 1/32 of its step), before paths diverge. *Weak* error: bias of
means relative to a fine Monte Carlo run on the same noise.

*Total* error: after a wall time t a mean has the error √(b² + s² c/t). b is the method's bias, s²/T
the sampling variance of a run of T simulated seconds, c the processor time per simulated second,
equal to the wall time on an otherwise idle machine.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from circuits.kernel.engine import circuit_of
from harvester.averaging.closures import NOISE_CLOSURES
from harvester.averaging.method import Stationary
from harvester.averaging.of_scene import average
from harvester.base.errors import HarvesterError
from harvester.base.method import Method
from harvester.base.serialising import LEFT_OUT, key, plain
from harvester.device import timescales
from harvester.engines.methods import Engine, engine_of, method_of
from harvester.engines.realization import run
from harvester.engines.request import (
    OUT_OF_TIME,
    Request,
    answers_before_failure,
    relative_error,
    told,
)
from harvester.engines.runner import Runner
from harvester.engines.task import Task
from harvester.scene.model import Scene
from harvester.scene.prepared import Prepared, prepared
from harvester.scene.steps import knot_spacing
from harvester.statistics.batch_means import standard_error
from harvester.statistics.estimate import TOO_SHORT, Estimate
from harvester.statistics.moments import Moments
from harvester.statistics.output_side import estimate_output
from harvester.statistics.paired import deviations, paired_difference
from harvester.statistics.run_quantities import estimate_all
from harvester.studies.answers import successful
from harvester.validation import (
    EFFICIENCY,
    MEANS,
    OUTPUT_POWER,
    STATES,
    VOLTAGE,
    exact_paths,
    throughput,
)
from harvester.validation.accuracy_methods import (
    COMPILED_METHODS,
    LOAD_METHODS,
    LOAD_PATHS,
    LOAD_REFERENCE,
    METHODS,
    REFERENCE,
    THOROUGH_METHODS,
    ComparedMethod,
)
from harvester.validation.paths import from_rest, longest_step, recorded, states_at_knots

# Number of paths for strong errors.
PATHS = 4
# Length of a path in periods of small oscillations, and its largest length in noise knots.
PERIODS = 12
MOST_KNOTS = 1000
# Number of realizations, and noise knots per realization, of brief runs for methods that are too
# slow for the scene's run.
BRIEF_REALIZATIONS = 8
BRIEF_KNOTS = 4000
# Factor of `thorough` on the numbers of paths and realizations.
THOROUGH = 8
# Knots of an untimed first run that compiles and loads everything.
WARM_UP_KNOTS = 20
# A bias and its error below this are rounding errors.
ROUNDING = 1e-12
# Relative errors to which the time is given.
LIMITS = (0.1, 0.03, 0.01)
# A bias below this number of standard errors is not resolved, and may be larger by this number.
BIAS_SIGMAS = 2.0


class Timed:
    """The realizations of a scene by one method, and their computing time.

    Attributes
    ----------
    scene : Scene
    moments : list of Moments
    measured_time, simulated_time : float
        Sum over realizations, without and with settling (s).
    seconds : float
        Processor time of one core, sum over tasks.
    cost : float
        Seconds of one core per measured second, in the fastest task, since other work slows tasks
        down.
    """

    def __init__(self, model: Prepared, answers: Sequence[dict[str, Any]]) -> None:
        self.moments: list[Moments] = [m for answer in answers for m in answer["moments"]]
        self.measured_time = _measured_time(self.moments)
        self.simulated_time = sum(moments.time_reached for moments in self.moments)
        self.seconds = sum(answer["seconds"] for answer in answers)
        self.cost = min(answer["seconds"] / _measured_time(answer["moments"]) for answer in answers)
        self.scene, self.prepared_scene = model.scene, model
        self._estimates: dict[int, dict[str, Estimate]] = {}

    def quantities(self, count: int | None = None) -> dict[str, Estimate]:
        """Estimates from all realizations, or from the first few."""
        moments = self.moments[:count]
        if len(moments) not in self._estimates:
            estimates = estimate_all(moments, self.prepared_scene.system)
            self._estimates[len(moments)] = estimates | estimate_output(moments)
        return self._estimates[len(moments)]


def _measured_time(moments):
    return sum(realization.time_reached - realization.start for realization in moments)


@dataclass(frozen=True)
class TotalError:
    """One method's error of one quantity as a function of wall time.

    Attributes
    ----------
    bias : Estimate
        Bias relative to the reference's mean; without standard error if the runs are too short.
    scatter : float
        Relative standard error of the mean times the root of the simulated time (√s).
    cost : float
        Seconds of one core per measured second, including settling.
    """

    bias: Estimate
    scatter: float
    cost: float

    @property
    def resolved_bias(self) -> float:
        """|bias| reduced by its error bar: √(b² − σ²), or 0.

        nan without an error bar.
        """
        error = self.bias.standard_error
        if error is None:
            return math.nan
        return math.sqrt(max(self.bias.estimate**2 - error**2, 0.0))

    def after(self, seconds: float | np.ndarray) -> float | np.ndarray:
        """Total error after a wall time; `seconds` is a float or an array of any shape."""
        return np.sqrt(self.resolved_bias**2 + self.scatter**2 * self.cost / seconds)

    def seconds_to(self, limit: float) -> float:
        """Wall time to a total error; infinite if the bias alone is shown to be larger.

        nan if this is unknown.
        """
        left = limit**2 - self.resolved_bias**2
        if left > 0.0:
            return self.scatter**2 * self.cost / left
        return math.inf if abs(self.bias.estimate) - self._margin > limit else math.nan

    @property
    def _margin(self):
        """`BIAS_SIGMAS` standard errors of the bias; infinite without an error bar."""
        error = self.bias.standard_error
        return math.inf if error is None else BIAS_SIGMAS * error

    def is_shown(self, limit: float) -> bool:
        """Whether |bias| plus `BIAS_SIGMAS` standard errors is within this error."""
        return abs(self.bias.estimate) + self._margin <= limit

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, with the times at each of `LIMITS`."""
        content = {
            "bias": self.bias.estimate,
            "standard_error": self.bias.standard_error,
            "scatter": self.scatter,
            "wall_seconds_per_second": self.cost,
            "seconds_to": {f"{limit:g}": self.seconds_to(limit) for limit in LIMITS},
            "shown": {f"{limit:g}": self.is_shown(limit) for limit in LIMITS},
        }
        return plain(content)


def bias_of(name: str, run: Timed, reference: Timed) -> Estimate:
    """A method's bias, from its run and the reference's longer run on the same noise.

    The reference's realizations on the same noise are a control variate. With α the regression
    slope of the method's batches on the reference's, m − α m' + (α − 1) M estimates the bias; m' is
    the reference's mean over these realizations, M over all its realizations. α is 1 if paths stay
    together, and 0 if they diverge immediately.

    Parameters
    ----------
    name : str
        Name of the quantity.

    Returns
    -------
    Estimate
        Bias relative to the reference's mean.
    """
    count = min(len(run.moments), len(reference.moments))
    estimates = (run.quantities(count), reference.quantities(count), reference.quantities())
    mean, paired, overall = (quantities[name] for quantities in estimates)
    run_deviations = deviations(run.moments[:count], name)
    common = deviations(reference.moments[:count], name)
    square = float(np.sum(common**2))
    slope = float(np.sum(run_deviations * common)) / square if square > 0.0 else 0.0
    slope = min(max(slope, 0.0), 1.0)
    bias = mean.estimate - slope * paired.estimate - (1.0 - slope) * overall.estimate
    error, far = standard_error(run_deviations - slope * common), overall.standard_error
    if error is None or far is None:
        return Estimate(bias / overall.estimate, None, None, "1", TOO_SHORT)
    error = math.hypot(error, (1.0 - slope) * far)
    return Estimate(bias / overall.estimate, error / abs(overall.estimate), None, "1")


@dataclass(frozen=True)
class MethodRow:
    """Measured errors and times of one method.

    Attributes
    ----------
    run : Timed or None
        The method's run for the means; None if it failed.
    note : str
        Reason of a failure; empty without one.
    mean_step : float
        Mean step of the runs for the strong errors (s); nan if they failed.
    strong : dict of str to float
        RMS error of each state over knots and paths, scaled; nan if a path failed.
    bias : dict of str to Estimate
        Relative bias of each mean, paired with the reference; empty without a run.
    sampling : dict of str to float
        Relative standard error of each mean in a run of this length: σ/√N.
    errors : dict of str to TotalError
        Total errors of the timed quantities; empty without a run.
    """

    method: ComparedMethod = field(metadata=LEFT_OUT)
    run: Timed | None = field(metadata=LEFT_OUT)
    note: str = ""
    mean_step: float = math.nan
    strong: dict = field(default_factory=dict, metadata=key("strong_error"))
    bias: dict = field(default_factory=dict)
    sampling: dict = field(default_factory=dict, metadata=key("sampling_error"))
    errors: dict = field(default_factory=dict)

    @property
    def simulated_time(self) -> float:
        """Time of the run for the means (s)."""
        return self.run.simulated_time if self.run else math.nan

    @property
    def seconds_per_unit(self) -> float:
        """Seconds of one core per simulated second."""
        return self.run.seconds / self.run.simulated_time if self.run else math.nan


def measure(
    scene: Scene,
    runner: Runner,
    thorough: bool,
    methods: Sequence[str | Method | ComparedMethod] | None,
) -> dict[str, Any]:
    """Measure paths and means of all methods; returns the fields of `Accuracy`.

    Parameters
    ----------
    thorough : bool
        More paths, steps and realizations.
    methods : sequence of str, Method or ComparedMethod, or None
        See `harvester.accuracy`.

    Raises
    ------
    HarvesterError
        The reference failed.
    OutOfTime
        The time budget was spent before the reference was complete.
    """
    model = prepared(scene)
    with_load = not scene.load.is_resistor
    if with_load:
        # Raises LoadError before any run if Monte Carlo does not support the load.
        circuit_of(model)
    reference = LOAD_REFERENCE if with_load else REFERENCE
    factor = THOROUGH if thorough else 1
    # With a load other than a resistor there is only one variant of the circuit.
    speeds: dict[str, Any] = {"rows": [], "machine": throughput.machine()}
    compared, stationary = chosen(methods, model, thorough, runner)
    refused: dict[str, str] = {}
    if methods is None and not with_load:
        # This measurement runs alone, since other tasks would distort the measured times.
        (outcome,) = runner.run([throughput.task(scene, runner.version("circuit"))])
        speeds = outcome if isinstance(outcome, dict) else speeds
        refused |= {"throughput": told(outcome)} if isinstance(outcome, HarvesterError) else {}
    short = _short_scene(model, PATHS * factor)
    strong = _strong_errors(short, compared, _exact_paths(short, with_load, runner), runner)
    scenes = {
        False: model.with_run(realizations=scene.run.realizations * factor),
        True: _brief_scene(model, BRIEF_REALIZATIONS * factor),
    }
    requests = [
        Request(run.scene, reference.engine, step=reference.step(run), moments=True)
        for run in scenes.values()
    ]
    answers = dict(zip(scenes, successful(runner.answer(requests)), strict=True))
    runs = _runs(scenes, compared, runner)
    averaged, invalid = closures(scene, stationary, runner)
    references = {
        brief: Timed(scenes[brief], [{"moments": answer.moments, "seconds": answer.seconds}])
        for brief, answer in answers.items()
    }
    exact, answer = references[False], answers[False]
    last = OUTPUT_POWER if OUTPUT_POWER in exact.quantities() else VOLTAGE
    scatter = {
        name: relative_error(exact.quantities()[name]) * math.sqrt(exact.measured_time)
        for name in (last, EFFICIENCY)
    }
    none, settling = Estimate(0.0, 0.0, None, "1"), exact.simulated_time / exact.measured_time
    rows = [
        _row(method, run, errors, references[method.brief], answer, scatter, settling)
        for method, run, errors in zip(compared, runs, strong, strict=True)
    ]
    return dict(
        scene=scene,
        rows=rows,
        reference=reference,
        answer=answer,
        errors={name: TotalError(none, spread, exact.cost) for name, spread in scatter.items()},
        closures=averaged,
        refused=refused | invalid,
        exact_paths=LOAD_PATHS.family if with_load else "scipy's DOP853",
        horizon=short.scene.run.duration,
        paths=short.scene.run.realizations,
        speeds=speeds,
    )


def _row(method, run, path_errors, reference, answer, scatter, settling):
    """A method's row; `answer` is the reference's longest run, with the most precise means.

    `settling`: simulated over measured time of the scene's own run.
    """
    mean_step, strong = path_errors
    if not isinstance(run, Timed):
        return MethodRow(method, None, run, mean_step, strong)
    differences = paired_difference(run, reference)
    # The sampling error is the same in every run of this length.
    shorter = math.sqrt(answer.simulated_time / run.simulated_time)
    bias = {name: differences[name] for name in MEANS if name in differences}
    sampling = {name: relative_error(answer.quantities[name]) * shorter for name in MEANS}
    # A brief run settles for a larger share of its time than the scene's own run.
    cost = run.cost * run.measured_time / run.simulated_time * settling
    errors = {
        name: TotalError(bias_of(name, run, reference), spread, cost)
        for name, spread in scatter.items()
    }
    return MethodRow(method, run, "", mean_step, strong, bias, sampling, errors)


def _brief_scene(model, realizations):
    """The scene of brief runs: half of each run, but at most `run.settle`, is settling."""
    scene = model.scene
    half = BRIEF_KNOTS // 2 * knot_spacing(model)
    changes = {
        "run.duration": min(scene.run.duration, half),
        "run.settle": min(scene.run.settle, half),
        "run.realizations": realizations,
        "excitation.knot_spacing": knot_spacing(model),
    }
    return model.replace(changes)


def _short_scene(model, paths):
    """The scene of some periods from rest, short enough that paths do not diverge."""
    period = 2.0 * math.pi / timescales.angular_frequency(model.system)
    knots = min(math.ceil(PERIODS * period / knot_spacing(model)), MOST_KNOTS)
    return from_rest(model, knots, paths)


def _exact_paths(model, with_load, runner):
    """Reference states for strong errors, shape (realizations, knots, 3)."""
    if with_load:
        [outcomes] = _answers([(model, LOAD_PATHS, 1)], runner, paths_at_knots)
        return np.concatenate([answer["states"] for answer in successful(outcomes)])
    scene = model.scene
    indices = range(scene.run.realizations)
    tasks = [Task(exact_paths.run, {"scene": scene, "index": index}) for index in indices]
    return np.array(successful(runner.run(tasks)))


def _strong_errors(model, methods, exact, runner):
    """Mean step (s) and RMS error of each state of every method."""
    spacing = knot_spacing(model)
    calls = [(model, method, method.copies or len(exact)) for method in methods]
    answers = _answers(calls, runner, paths_at_knots)
    return [_strong_error(spacing, outcomes, exact) for outcomes in answers]


def _answers(calls, runner, function):
    """Outcomes of the tasks of each call (scene, method, realizations)."""
    groups = []
    for model, method, size in calls:
        indices = range(model.scene.run.realizations)
        parts = [indices[first : first + size] for first in indices[::size]]
        groups.append([realizations_task(model, method, part, runner, function) for part in parts])
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
    calls = [(scenes[m.brief], m, m.together(scenes[m.brief])) for m in methods]
    runs: list[Timed | str] = []
    for (model, *_), outcomes in zip(calls, _answers(calls, runner, timed), strict=True):
        good, ended = answers_before_failure(outcomes)
        reason = told(ended) if isinstance(ended, HarvesterError) else ended
        runs.append(reason or Timed(model, good))
    return runs


def timed(
    prepared_scene: Prepared, method: dict[str, Any], indices: list[int], report: Callable
) -> dict[str, Any]:
    """Moments of a few realizations, and their processor time.

    Called in a worker process; `method` contains the values of `ComparedMethod.options`.
    """
    warm_up = WARM_UP_KNOTS * knot_spacing(prepared_scene)
    brief = prepared_scene.replace({"run.settle": 0.0, "run.duration": warm_up})
    settings = dict(method)
    engine = engine_of(settings.pop("engine"), **settings)
    run(brief, engine, indices[:1], None, report)
    realizations = run(prepared_scene, engine, indices, None, report)
    return {
        "moments": [realization.moments for realization in realizations],
        "seconds": sum(realization.seconds for realization in realizations),
    }


def paths_at_knots(
    prepared_scene: Prepared, method: dict[str, Any], indices: list[int], report: Callable
) -> dict[str, Any]:
    """States of a few realizations at the knots, and the total number of points."""
    realizations = recorded(prepared_scene, indices=indices, **method)
    points = sum(realization.moments.points for realization in realizations)
    return {"states": states_at_knots(prepared_scene, realizations), "points": points}


def realizations_task(
    model: Prepared,
    method: ComparedMethod,
    indices: Sequence[int],
    runner: Runner,
    function: Callable,
) -> Task:
    """A task of some realizations; `function` has the signature of `timed`."""
    options = method.options(model)
    arguments = {"scene": model.scene, "method": options, "indices": list(indices)}
    version = runner.version(method.engine)
    return Task(function, arguments, version, method.family, len(indices))


def averages_once_more(
    prepared_scene: Prepared, closure: str, report: Callable, **settings: Any
) -> dict[str, Any]:
    """A scene by a stationary method, timed without compilation, in a worker process."""
    for _ in range(2):
        result = average(prepared_scene.scene, method=Stationary(closure, **settings))
    return {"quantities": result.scaled_quantities, "seconds": result.engine_seconds}


def closures(
    scene: Scene, methods: Sequence[Stationary], runner: Runner
) -> tuple[dict[str, dict], dict[str, str]]:
    """Answers of valid stationary methods, and reasons of invalid ones, by name.

    An answer contains `quantities`, scaled, and `seconds` of one core.
    """
    tasks = [
        Task(averages_once_more, {"scene": scene, "closure": m.name, **m.settings}, label=m.name)
        for m in methods
    ]
    outcomes = {task.label: outcome for task, outcome in zip(tasks, runner.run(tasks), strict=True)}
    answers = {name: outcome for name, outcome in outcomes.items() if isinstance(outcome, dict)}
    refused = {name: str(o or OUT_OF_TIME) for name, o in outcomes.items() if name not in answers}
    return answers, refused


def chosen(
    methods: Sequence[str | Method | ComparedMethod] | None,
    model: Prepared,
    thorough: bool,
    runner: Runner,
) -> tuple[list[ComparedMethod], list[Stationary]]:
    """The compared engines and stationary methods; see `harvester.accuracy`."""
    with_load = not model.scene.load.is_resistor
    every = LOAD_METHODS if with_load else THOROUGH_METHODS if thorough else METHODS
    if methods is None:
        methods = [*dict.fromkeys(method.engine for method in every), *NOISE_CLOSURES]
    items = [m if isinstance(m, ComparedMethod) else method_of(m) for m in methods]
    names = [name for name in methods if isinstance(name, str)]
    if "circuit" in names and not with_load and "compiled" in runner.version("circuit"):
        every = (*every, *COMPILED_METHODS)
    # No step is longer than the time between two samples of the excitation.
    default = {m.engine: longest_step(model, "default", m.engine) for m in every}
    every = [m for m in every if m.refinement >= 1 or m.step(model) > default[m.engine]]
    compared: list[ComparedMethod] = [m for m in items if isinstance(m, ComparedMethod)]
    for method, item in zip(methods, items, strict=True):
        if isinstance(item, Engine):
            listed = [m for m in every if m.engine == method]
            compared += listed or [ComparedMethod.of(item, model)]
    return compared, [item for item in items if isinstance(item, Stationary)]


def is_reference(bias: Estimate) -> bool:
    """Whether a bias belongs to the reference itself: only rounding errors."""
    return abs(bias.estimate) + (bias.standard_error or 0.0) < ROUNDING
