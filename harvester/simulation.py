"""`simulate`: a scene through one engine, realizations spread over worker processes."""

import contextlib
import difflib
import math
from dataclasses import replace

from harvester.errors import EnergyNotBalanced, HarvesterError, SimulationError
from harvester.estimators import densities, energy_balance_residual, estimate_all
from harvester.excitation import interpolation_loss
from harvester.output_estimates import estimate_output
from harvester.parameters import STEP_LEVELS, knot_spacing, require_resistor, scale, steps_per_knot
from harvester.realization import ENGINES, SCHEMES, Realization
from harvester.results import Result
from harvester.workers import ExecutorPool, WorkerPool

SOURCES = ("external", "pwl")
# Wall-clock limit of one realization (s) where the user sets none.
TIME_LIMIT = 3600.0
# Largest residual that is not an error, and the one from which on the result carries a note.
LARGEST_RESIDUAL = 0.1
NOTED_RESIDUAL = 0.01


def simulate(
    scene,
    engine="circuit",
    *,
    step="default",
    source="external",
    scheme=None,
    tolerance=None,
    workers=None,
    executor=None,
    keep_going=False,
    time_limit=TIME_LIMIT,
    window=None,
    progress=None,
    pool=None,
):
    """Simulate a scene and estimate its quantities with error bars.

    Parameters
    ----------
    scene : Scene
    engine : str
        "circuit" (ngspice) or "monte-carlo" (Runge–Kutta, no circuit).
    step : str or float
        Longest step: "default", "fine", "finest", or seconds. Rounded down to a whole division
        of the knot spacing; shorter in contact.
    source : str
        Circuit only. "external": the path through compiled callbacks. "pwl": as a source in
        the netlist with ngspice's own steps, for comparison.
    scheme : str or None
        A name in `harvester.realization.SCHEMES`, for comparison; None: the engine's default.
    tolerance : float or None
        Circuit only: relative tolerance of ngspice's control by the local error, which shortens
        steps below `step`; None: fixed steps, or ngspice's own tolerance for "pwl".
    workers : int or None
        Processes; None: one per core.
    executor : concurrent.futures.Executor or None
        Spreads the realizations instead of worker processes of our own: a process pool, Dask's
        `client.get_executor()`, mpi4py's.
    keep_going : bool
        Try a realization whose process crashed or ran out of time once more, leave one that
        fails for good out of the estimates, and name it in `Result.failures`. Without it the
        first failure ends the run.
    time_limit : float
        Wall-clock seconds of one realization.
    window : (float, float) or None
        Stretch of the first realization to keep as `Result.waveform` (s).
    progress : callable or None
        Given the share done, 0 … 1.
    pool : harvester.workers.WorkerPool or None
        Running processes to use again.

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
    engine = check_name("engine", engine, ENGINES)
    source = check_name("source", source, SOURCES)
    if engine == "monte-carlo":
        require_resistor(scene, "Monte Carlo")
    scheme = check_name("scheme", scheme or SCHEMES[engine][0], SCHEMES[engine])
    calls = [
        {
            "scene": scene,
            "engine": engine,
            "index": index,
            "step": step,
            "source": source,
            "scheme": scheme,
            "tolerance": tolerance,
            "window": window if index == 0 else None,
        }
        for index in range(scene.run.realizations)
    ]
    follow = _Follower(scene, progress) if progress else None
    try:
        with _running(pool, executor, len(calls), workers) as running:
            outcomes = running.map(
                "harvester.realization:run", calls, time_limit, follow, keep_going
            )
        failures = {k: o for k, o in enumerate(outcomes) if isinstance(o, SimulationError)}
        realizations = [outcome for k, outcome in enumerate(outcomes) if k not in failures]
        if not realizations:
            raise failures[0]
    except SimulationError as error:
        error.partial = _partial(scene, engine, step, source, error)
        raise
    return _checked(_result(scene, engine, step, source, realizations, failures))


@contextlib.contextmanager
def _running(pool, executor, calls, workers):
    """The pool or the executor that was handed in, else workers that end with the block."""
    if executor is not None:
        yield ExecutorPool(executor)
    elif pool is not None:
        yield pool
    else:
        with WorkerPool(calls, workers) as own:
            yield own


def check_step(step):
    """A level's name or a positive number of seconds.

    Raises
    ------
    HarvesterError
    """
    if isinstance(step, str) and step not in STEP_LEVELS:
        try:
            step = float(step)
        except ValueError:
            return check_name("step", step, STEP_LEVELS)
    if not isinstance(step, str) and not (math.isfinite(step) and step > 0.0):
        raise HarvesterError(f"step {step}: must be one of {', '.join(STEP_LEVELS)} or seconds > 0")
    return step


def check_name(what, name, known):
    """The name, or HarvesterError with the nearest valid one."""
    if name not in known:
        close = difflib.get_close_matches(str(name), known, n=1)
        hint = f" (did you mean {close[0]}?)" if close else ""
        raise HarvesterError(f"unknown {what} {name}{hint}; there are {', '.join(known)}")
    return name


class _Follower:
    """Adds up how far the realizations are."""

    def __init__(self, scene, progress):
        self._total = (scene.run.settle + scene.run.duration) * scene.run.realizations
        self._reached = {}
        self._progress = progress

    def __call__(self, index, moments):
        self._reached[index] = moments.time_reached
        self._progress(min(sum(self._reached.values()) / self._total, 1.0))


def _result(scene, engine, step, source, realizations, failures, outcome="complete"):
    parameters, scales = scale(scene)
    moments = [realization.moments for realization in realizations]
    first = min(realization.started for realization in realizations)
    last = max(realization.started + realization.seconds for realization in realizations)
    return Result(
        scene=scene,
        engine=engine if source == "external" else f"{engine} ({source} source)",
        scaled_quantities=estimate_all(moments, parameters) | estimate_output(moments),
        scales=scales,
        error_kind="statistical",
        energy_balance_residual=energy_balance_residual(moments, parameters),
        wall_seconds=last - first,
        engine_seconds=sum(realization.seconds for realization in realizations),
        simulated_time=sum(m.time_reached for m in moments),
        steps=sum(realization.steps for realization in realizations),
        step=knot_spacing(scene) / steps_per_knot(scene, step),
        realizations=len(moments),
        engine_version=realizations[0].engine_version,
        netlist_sha256=realizations[0].netlist_sha256,
        notes=(*_notes(scene), *_failure_notes(failures, scene)),
        failures={index: f"{type(e).__name__}: {e}" for index, e in failures.items()},
        densities=densities(moments),
        waveform=realizations[0].waveform,
        moments=moments,
        outcome="incomplete" if failures else outcome,
    )


def _partial(scene, engine, step, source, error):
    """A result of the failed realization's moments, or None when it had none."""
    moments = error.partial
    if moments is None or not moments.time_reached > moments.start:
        return None
    realization = Realization(
        moments=moments,
        waveform=None,
        seconds=math.nan,
        started=math.nan,
        steps=moments.points,
        engine_version="",
        netlist_sha256=None,
    )
    outcome = type(error).__name__
    return _result(scene, engine, step, source, [realization], {}, outcome)


def _notes(scene):
    if scene.excitation.prescribes_displacement:
        return ()
    loss = interpolation_loss(knot_spacing(scene), scene.excitation.correlation_time)
    return (f"noise linear between knots: its variance is {loss:.1%} below D/τ1",)


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
            f"{result.engine}: the energy balance leaves {residual:.2%} of the energy unaccounted "
            f"for (limit {LARGEST_RESIDUAL:.0%}): the step is too long for this scene, or the run "
            "too short; choose --step fine or finest",
            partial=result,
        )
    if residual <= NOTED_RESIDUAL:
        return result
    note = f"energy balance residual {residual:.2%}: choose a shorter --step before citing"
    return replace(result, notes=(*result.notes, note))
