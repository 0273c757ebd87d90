"""`load_study`: loads and values on common noise, in rounds, every piece kept."""

import contextlib
import math
import time
from dataclasses import dataclass

import harvester
from harvester.averaging import CLOSURES
from harvester.engines.circuit import describe
from harvester.engines.protocol import ENGINES
from harvester.engines.workers import ExecutorPool, WorkerPool
from harvester.errors import HarvesterError
from harvester.scene.units import require_resistor
from harvester.simulation import TIME_LIMIT, check_name, check_step, require_noise
from harvester.studies.folder import held
from harvester.studies.grid import Grid, make_grid
from harvester.studies.pieces import Store
from harvester.studies.rounds import MOST, Rounds, Runner

# Measured time of a realization over its settling: a fifth of the run is then spent on settling.
DURATION_OVER_SETTLE = 4.0
# Wall-clock seconds of a study with a precision, unless told otherwise.
TIME_BUDGET = 540.0
# Pieces that are named when they are not believed.
MOST_NAMED = 10


@dataclass(frozen=True)
class Study:
    """A load study's points and how it ended.

    Attributes
    ----------
    grid : Grid
    method : str
        Engine or closure.
    version : str
        Of what computed.
    precision : float or None
    evaluations : list of Evaluation
        In the order of `grid.points`.
    out_of_time : bool
        The time budget ended it: the same call again goes on.
    computed, reused : int
        Pieces.
    wall_seconds : float
    warnings : tuple of str
        Pieces that were not believed, outcomes that are not kept, a folder that cannot be locked.
    """

    grid: Grid
    method: str
    version: str
    precision: float | None
    evaluations: list
    out_of_time: bool
    computed: int
    reused: int
    wall_seconds: float
    warnings: tuple = ()


def load_study(
    scene,
    loads=(),
    sweeps=None,
    *,
    engine="circuit",
    precision=None,
    time_budget=None,
    step="default",
    output=None,
    workers=None,
    executor=None,
    time_limit=TIME_LIMIT,
    progress=None,
    pool=None,
):
    """Simulate loads over a grid of values, all on the same noise.

    Parameters
    ----------
    scene : Scene
        With a precision, its realizations are cut to `DURATION_OVER_SETTLE` times the settling,
        and there are as many as it takes, at most `MOST`.
    loads : sequence of str
        Names in netlists/ or paths; empty: the scene's own.
    sweeps : dict of str to sequence of float
        "table.key" to values; several make a grid.
    engine : str
        "circuit"; where the load is a resistor also "monte-carlo" or a closure.
    precision : float or None
        Relative standard error of the output power that each point is run for; None: the
        scene's own run.
    time_budget : float or None
        Wall-clock seconds of this call, after which no piece is begun; None: `TIME_BUDGET` with a
        precision, no limit without.
    step : str or float
        See `harvester.simulate`.
    output : str or Path or StudyFolder or None
        Folder whose `points/` keeps every finished piece, and is read first; held for this call
        alone.
    workers : int or None
    executor : concurrent.futures.Executor or None
        Instead of worker processes of our own; the numbers are the same.
    time_limit : float
        Wall-clock seconds of one realization.
    progress : callable or None
        Given the share done, 0 … 1, and a few words.
    pool : harvester.engines.workers.WorkerPool or None
        Running processes to use again.

    Returns
    -------
    Study

    Raises
    ------
    HarvesterError
        A mistake in the call. A simulation that fails is the outcome of its point.
    """
    clock = time.monotonic()
    check_name("engine", engine, (*ENGINES, *CLOSURES))
    step = check_step(step)
    if precision is not None and not 0.0 < precision < 1.0:
        raise HarvesterError(f"--precision {precision}: must be a number in (0, 1)")
    if time_budget is not None and not time_budget > 0.0:
        raise HarvesterError(f"--time-budget {time_budget}: must be a number > 0")
    statistical = engine in ENGINES
    if precision and statistical:
        require_noise(scene, "a study with a precision")
        scene = _cut(scene)
        time_budget = TIME_BUDGET if time_budget is None else time_budget
    grid = make_grid(scene, loads, sweeps or {})
    for point in grid.points if engine != "circuit" else ():
        require_resistor(point.scene, engine)
    deadline = clock + time_budget if time_budget else math.inf
    with (
        held(output) if output else contextlib.nullcontext() as folder,
        _running(pool, executor, workers) as running,
    ):
        version = _version(running, engine)
        store = Store(folder)
        runner = Runner(running, store, deadline, time_limit)
        rounds = Rounds(grid, engine, step, version, precision if statistical else None, runner)
        evaluations, out_of_time = rounds.run(progress or (lambda share, words: None))
    return Study(
        grid=grid,
        method=engine,
        version=version,
        precision=precision,
        evaluations=evaluations,
        out_of_time=out_of_time,
        computed=runner.computed,
        reused=runner.reused,
        wall_seconds=time.monotonic() - clock,
        warnings=(*(folder.notes if folder else ()), *_warnings(store, runner)),
    )


def _warnings(store, runner):
    lines = list(store.refused.values())
    if len(lines) > MOST_NAMED:
        lines[MOST_NAMED:] = [f"and {len(lines) - MOST_NAMED} more pieces of this kind"]
    passing = runner.passing()
    if passing and store.on_disk:
        lines.append(
            f"{passing} pieces ended by a limit or by the machine and are not kept: the same "
            "command computes them again"
        )
    return lines


def _cut(scene):
    """The scene with realizations of the length that rounds are made of."""
    run = scene.run
    duration = min(run.duration, DURATION_OVER_SETTLE * run.settle) or run.duration
    return scene.replace({"run.duration": duration, "run.realizations": MOST})


def _running(pool, executor, workers):
    """The pool or the executor that was handed in, else workers that end with the block."""
    if executor is not None:
        return contextlib.nullcontext(ExecutorPool(executor))
    return WorkerPool(None, workers) if pool is None else contextlib.nullcontext(pool)


def _version(pool, engine):
    """What computes, for the pieces' names."""
    if engine != "circuit":
        return f"harvester {harvester.__version__}"
    found = pool.map(describe, [{}])[0]
    device = "behavioural" if found["compiled_device_off"] else "compiled"
    return f"harvester {harvester.__version__}, {found['version']}, {device} device"
