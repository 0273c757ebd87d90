"""`simulate`: a scene through one engine, realizations spread over worker processes."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import Executor
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.calling import takes_scene
from harvester.device import timescales
from harvester.errors import EnergyNotBalanced, HarvesterError, SimulationError
from harvester.estimates.batch_means import measured_time
from harvester.estimates.densities import densities
from harvester.estimates.joint_density import joint_density as joint_density_of
from harvester.estimates.of_run import run_estimates
from harvester.excitation import OrnsteinUhlenbeck
from harvester.files.plain_text import nearest
from harvester.prepared.prepared import prepared
from harvester.prepared.steps import STEP_LEVELS, knot_spacing, step_error, steps_per_knot
from harvester.results.residual_cause import suspected_cause
from harvester.results.result import Result
from harvester.scene.model import Scene
from harvester.simulation import side_by_side
from harvester.simulation.methods import ENGINES
from harvester.simulation.realization import Realization, run
from harvester.workers.pools import Workers, processes

if TYPE_CHECKING:
    from harvester.device.system import System

SOURCES = ("external", "pwl")
DEVICES = ("automatic", "behavioural", "compiled")
# Wall-clock limit of one realization (s) where the user sets none.
TIME_LIMIT = 3600.0
# Largest residual that is not an error, and the one from which on the result carries a note.
LARGEST_RESIDUAL = 0.1
NOTED_RESIDUAL = 0.01


@takes_scene
def simulate(
    scene: Scene,
    *,
    method: str = "circuit",
    step: str | float = "default",
    source: str = "external",
    scheme: str | None = None,
    tolerance: float | None = None,
    device: str = "automatic",
    copies: int | None = None,
    keep_going: bool = False,
    time_limit: float = TIME_LIMIT,
    window: tuple[float, float] | None = None,
    joint_density: bool = False,
    workers: int | None = None,
    executor: Executor | None = None,
    runner: Workers | None = None,
    progress: Callable[[float, str], object] | None = None,
) -> Result:
    """Simulate a scene and estimate its quantities with error bars.

    Parameters
    ----------
    scene : Scene, str or Path
        Itself, its file or its built-in name.
    method : str
        "circuit" (ngspice) or "monte-carlo" (the equations themselves, no ngspice).
    step : str or float
        Longest step: "default", "fine", "finest", or seconds. Rounded down to a whole division
        of the knot spacing; shorter in contact.
    source : str
        Circuit only. "external": the path through compiled callbacks. "pwl": as a source in
        the netlist with ngspice's own steps, for comparison.
    scheme : str or None
        One of the engine's `schemes` (harvester.simulation.methods), for comparison; None: the
        first.
    tolerance : float or None
        Circuit only: relative tolerance of ngspice's control by the local error, which shortens
        steps below `step`; None: fixed steps, or ngspice's own tolerance for "pwl".
    device : str
        Circuit only: "behavioural" elements, one "compiled" device for mechanics and piezo (the
        extra `fast`), or "automatic": compiled where it is found. The same numbers to 1e-9.
    copies : int or None
        Circuit only: realizations side by side in one netlist, which share their steps; None:
        `harvester.simulation.side_by_side.copies`, whatever the number of workers.
    keep_going : bool
        Try a realization whose process crashed or ran out of time once more, leave one that
        fails for good out of the estimates, and name it in `Result.failures`. Without it the
        first failure ends the run.
    time_limit : float
        Wall-clock seconds of one realization.
    window : (float, float) or None
        Stretch of the first realization to keep as `Result.waveform` (s).
    joint_density : bool
        Keep p(X, X') as `Result.joint_density`.
    workers : int or None
        Processes; None: one per core.
    executor : concurrent.futures.Executor or None
        Spreads the realizations instead of worker processes of our own: a process pool, Dask's
        `client.get_executor()`, mpi4py's.
    runner : WorkerPool or what has one as its `pool`, or None
        Running processes to use again (`harvester.workers.pools`).
    progress : callable or None
        Given the share done, 0 … 1, and the method at work.

    Returns
    -------
    Result

    Raises
    ------
    HarvesterError
        An unknown name, or no ngspice.
    SimulationError
        A realization failed, or with `keep_going` all did; `partial` is a Result of what it had.

    Notes
    -----
    The same seed gives the same noise to every engine and the same numbers whatever the
    number of workers.
    """
    step = check_step(step)
    engine = check_name("method", method, ENGINES)
    source = check_name("source", source, SOURCES)
    ENGINES[engine].check(scene)
    scheme = check_name("scheme", scheme or ENGINES[engine].schemes[0], ENGINES[engine].schemes)
    device = check_name("device", device, DEVICES)
    copies = check_copies(copies, scene, engine, source)
    options = {"step": step, "source": source, "scheme": scheme, "tolerance": tolerance}
    follow = _Follower(scene, engine, progress) if progress else None
    try:
        with running(runner, executor, scene.run.realizations, workers) as pool:
            together = copies or _copies_that_pay(scene, engine, device, options, pool)
            options |= {"device": device, "joint_density": joint_density}
            calls = _calls(scene, engine, together, window, options)
            outcomes = _outcomes(pool, calls, time_limit, follow, keep_going)
    except SimulationError as error:
        error.partial = _partial(scene, engine, step, source, error)
        raise
    failures = {k: o for k, o in enumerate(outcomes) if isinstance(o, SimulationError)}
    realizations = [outcome for k, outcome in enumerate(outcomes) if k not in failures]
    return _checked(_result(scene, engine, step, source, realizations, failures))


def _copies_that_pay(scene, engine, device, options, pool):
    """Realizations in one call of an engine where nothing else is asked for."""
    shared = (options[name] for name in ("step", "source", "tolerance"))
    count = scene.run.realizations
    if engine == "monte-carlo":
        workers = getattr(pool, "size", math.inf)
        return side_by_side.together(count, workers) if scene.load.is_resistor else 1
    if engine != "circuit" or count == 1 or not side_by_side.share_steps(scene, *shared):
        return 1
    from circuits.ngspice.engine import device_used

    (used,) = pool.map(device_used, [{"scene": scene, "device": device}])
    return side_by_side.copies(count, used)


def _calls(scene, engine, copies, window, options):
    """Arguments of `harvester.simulation.realization.run`, so many realizations in each."""
    indices = range(scene.run.realizations)
    return [
        {
            "scene": scene,
            "engine": engine,
            "indices": list(indices[start : start + copies]),
            "window": window if start == 0 else None,
            **options,
        }
        for start in range(0, len(indices), copies)
    ]


def _outcomes(pool, calls, time_limit, follow, keep_going):
    """A Realization or the SimulationError in its place, for every realization in order.

    Realizations that failed together are tried again one by one.

    Raises
    ------
    SimulationError
        One failed and nothing keeps going, or all failed.
    """
    most = max(len(call["indices"]) for call in calls)
    outcomes: dict[int, Any] = {}
    together = pool.map(run, calls, most * time_limit, follow, keep_going)
    for call, outcome in zip(calls, together, strict=True):
        if isinstance(outcome, SimulationError):
            outcome = [outcome] * len(call["indices"])
        outcomes.update(zip(call["indices"], outcome, strict=True))
    if most > 1:
        again = [k for k, outcome in outcomes.items() if isinstance(outcome, SimulationError)]
        single = [{**calls[0], "indices": [k], "window": None} for k in again]
        alone = pool.map(run, single, time_limit, None, keep_going)
        for index, outcome in zip(again, alone, strict=True):
            outcomes[index] = outcome if isinstance(outcome, SimulationError) else outcome[0]
    in_order = [outcomes[index] for index in sorted(outcomes)]
    if all(isinstance(outcome, SimulationError) for outcome in in_order):
        raise in_order[0]
    return in_order


@contextlib.contextmanager
def running(
    runner: Workers | None, executor: Executor | None, calls: int, workers: int | None
) -> Iterator[Workers]:
    """What was handed in, a runner's own processes too; else workers that end with the block."""
    if executor is None and runner is not None:
        yield getattr(runner, "pool", runner)
    else:
        with processes(executor, workers, calls) as pool:
            yield pool


def check_step(step: str | float) -> str | float:
    """A level's name or a positive number of seconds.

    Raises
    ------
    HarvesterError
    """
    if isinstance(step, str) and step not in STEP_LEVELS:
        try:
            step = float(step)
        except ValueError:
            return check_name("step", str(step), STEP_LEVELS)
    if not isinstance(step, str) and not (math.isfinite(step) and step > 0.0):
        raise HarvesterError(f"step {step}: must be one of {', '.join(STEP_LEVELS)} or seconds > 0")
    return step


def check_copies(copies: int | None, scene: Scene, engine: str, source: str) -> int | None:
    """None, or a whole number ≥ 1 that this load, engine and source can take.

    Raises
    ------
    HarvesterError
    """
    if copies is None:
        return None
    if not isinstance(copies, int) or copies < 1:
        raise HarvesterError(f"copies {copies}: must be a whole number ≥ 1")
    simple = scene.load.is_resistor and source == "external"
    if copies > 1 and not (engine == "circuit" and simple):
        raise HarvesterError(
            f"copies {copies}: only the circuit with its external source and a resistor as load "
            "takes more than one"
        )
    return copies


def check_name(what: str, name: str, known: Collection[str]) -> str:
    """The name, or HarvesterError with the nearest valid one."""
    if name not in known:
        raise HarvesterError(
            f"unknown {what} {name}{nearest(name, known)}; there are {', '.join(known)}"
        )
    return name


def require_noise(scene: Scene, command: str) -> None:
    """Refuse kinds of excitation that a command cannot vary or repeat.

    Raises
    ------
    HarvesterError
    """
    if not isinstance(scene.excitation, OrnsteinUhlenbeck):
        raise HarvesterError(
            f'{scene.name}: excitation.kind = "{scene.excitation.kind}": {command} needs as many '
            'independent paths as it likes: set excitation.kind = "ornstein-uhlenbeck"'
        )


class _Follower:
    """Adds up how far the realizations are."""

    def __init__(self, scene, method, progress):
        self._method = method
        self._total = (scene.run.settle + scene.run.duration) * scene.run.realizations
        self._reached = {}
        self._sum = 0.0
        self._progress = progress

    def __call__(self, index, moments):
        reached = sum(each.time_reached for each in moments)
        self._sum += reached - self._reached.get(index, 0.0)
        self._reached[index] = reached
        self._progress(min(max(self._sum / self._total, 0.0), 1.0), self._method)


# The sums of a run that diverged may overflow: its residual is then no number, which is refused.
@np.errstate(over="ignore", invalid="ignore")
def _result(scene, engine, step, source, realizations, failures, outcome="complete"):
    ready = prepared(scene)
    parameters, scales = ready.system, ready.scales
    moments = [realization.moments for realization in realizations]
    first = min(realization.started for realization in realizations)
    last = max(realization.ended for realization in realizations)
    cost = step_error(ready, step, engine)
    found = run_estimates(scene, moments, cost)
    shapes = densities(found.moments, is_symmetric(scene, parameters))
    joints = [realization.joint for realization in realizations if realization.joint is not None]
    joint = joint_density_of(joints, is_symmetric(scene, parameters)) if joints else None
    if found.shortfalls:
        shapes = {name: replace(shape, standard_error=None) for name, shape in shapes.items()}
        joint = joint and replace(joint, standard_error=None)
    return Result(
        scene=scene,
        engine=engine if source == "external" else f"{engine} ({source} source)",
        scaled_quantities=found.scaled,
        scales=scales,
        error_kind="statistical",
        energy_balance_residual=found.residual,
        wall_seconds=last - first,
        engine_seconds=sum(realization.seconds for realization in realizations),
        simulated_time=sum(m.time_reached for m in moments),
        steps=sum(m.points for m in moments),
        step=knot_spacing(ready) / steps_per_knot(ready, step, engine),
        step_error=cost if source == "external" else None,
        realizations=len(moments),
        engine_version=realizations[0].engine_version,
        netlist_sha256=realizations[0].netlist_sha256,
        notes=(*notes_on_excitation(scene), *found.notes, *_failure_notes(failures, scene)),
        failures={index: f"{type(e).__name__}: {e}" for index, e in failures.items()},
        densities=shapes,
        joint_density=joint,
        waveform=realizations[0].waveform,
        moments=moments,
        outcome="incomplete" if failures else outcome,
    )


def is_symmetric(scene: Scene, parameters: System) -> bool:
    """Whether a motion and its mirror image are equally likely."""
    return scene.excitation.symmetric and parameters.symmetric and scene.start is None


def _partial(scene, engine, step, source, error):
    """A result of the failed realizations' moments, or None when they had none."""
    reached = [m for m in error.partial or () if measured_time([m]) > 0.0]
    if not reached:
        return None
    nothing: dict[str, Any] = {
        "waveform": None,
        "joint": None,
        "engine_version": "",
        "netlist_sha256": None,
    }
    realizations = [
        Realization(moments=m, seconds=math.nan, started=math.nan, ended=math.nan, **nothing)
        for m in reached
    ]
    outcome = type(error).__name__
    return _result(scene, engine, step, source, realizations, {}, outcome)


def notes_on_excitation(scene: Scene) -> tuple[str, ...]:
    """What a reader must know of the noise that a scene is run with."""
    ready = prepared(scene)
    parameters = ready.system
    frequency = timescales.angular_frequency(parameters)
    return scene.excitation.notes(knot_spacing(ready), frequency, scene.run)


def _failure_notes(failures, scene):
    if not failures:
        return ()
    first = next(iter(failures.values()))
    return (f"{len(failures)} of {scene.run.realizations} realizations failed: {first}",)


def _checked(result):
    """The result, with a note or an error where its energy balance does not close."""
    residual = abs(result.energy_balance_residual)
    if not residual <= LARGEST_RESIDUAL:
        raise EnergyNotBalanced(
            f"{result.engine}: the energy balance leaves {100.0 * residual:.4g} % of the energy "
            f"unaccounted for (limit {LARGEST_RESIDUAL:.0%}); suspected: "
            f"{suspected_cause(result)}; else choose --step fine or finest",
            partial=result,
        )
    if residual <= NOTED_RESIDUAL:
        return result
    note = f"energy balance residual {residual:.2%}; suspected: {suspected_cause(result)}"
    return replace(result, notes=(*result.notes, note))
