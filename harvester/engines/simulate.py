"""`simulate`: a scene through one engine, realizations spread over worker processes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from harvester.base.arguments import check_name as check_name
from harvester.base.errors import HarvesterError, SimulationError
from harvester.base.signatures import Count, MethodOrName, Nodes, Seconds, Step, Window
from harvester.engines.methods import DEFAULTS, Stationary, engine_of
from harvester.engines.methods import check_step as check_step
from harvester.scene.calling import takes_scene

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from harvester.base.worker_pool import Workers
    from harvester.results.orbit import Attractor
    from harvester.results.result import Result
    from harvester.scene.model import Scene

# Default wall-clock limit of one realization, in seconds.
TIME_LIMIT = 3600.0


@takes_scene
def simulate(
    scene: Scene,
    *,
    method: MethodOrName = "circuit",
    source: str = "external",
    device: str = "automatic",
    copies: int | None = None,
    step: Step = "default",
    workers: Count | None = None,
    time_limit: Seconds = TIME_LIMIT,
    keep_going: bool = False,
    stroboscope: bool = False,
    scheme: str | None = None,
    tolerance: float | None = None,
    window: Window | None = None,
    nodes: Nodes = (),
    joint_density: bool = False,
    executor: Executor | None = None,
    runner: Workers | None = None,
    progress: Callable[[float, str], object] | Literal[False] | None = None,
) -> Result:
    """Simulate a scene with one engine: its quantities with error bars.

    Parameters
    ----------
    scene : Scene, str or Path
        A scene, its file or the name of a built-in one.
    method : str or Method
        circuit (ngspice) or monte-carlo (direct integration, without ngspice). In Python also
        `Circuit(…)`, `MonteCarlo(…)` or `Stationary(…)`, objects that hold the settings below;
        a name selects the object with its defaults.
    source : str
        Circuit only: the source of the excitation, external (samples by compiled callbacks) or pwl
        (a source in the netlist, with ngspice's own steps; for comparison).
    device : str
        Circuit only: behavioural (elements), compiled (one device for mechanics and piezo, of the
        extra `fast`) or automatic (compiled if it is installed). Results agree to 1e-9.
    copies : int or None
        Circuit only: number of realizations that run in one netlist, with common time steps
        (default: the fastest number).
    step : str or float
        default, fine, finest, or the longest step in seconds. It is rounded down so that a whole
        number of steps fits between two samples of the excitation; in contact it is shorter.
    workers : int or None
        Maximum number of processes (default: one per core).
    time_limit : float
        Wall-clock limit of one realization, without compilation.
    keep_going : bool
        Repeat a failed realization once; if it fails again, continue without it, and list it in the
        result's `failures`. By default the first failure ends the run.
    stroboscope : bool
        Keep the state at the beginning of every period, as `Result.stroboscope` and a figure. The
        period is the excitation's, its lowest sine's or, under noise, the device's.
    window : (float, float), "all" or None
        Part of the first realization in `Result.waveform` and --waveform, in s from the run's
        beginning (default: 50 periods of the device's motion after settling).
    nodes : sequence of str
        Voltages and currents of the load's netlist in the waveform: NAME or v(NAME) for a node, on
        the DC side against ref, else against n; v(A,B) between two nodes; i(NAME) for a current.
        Several may be given.

    Other Parameters
    ----------------
    scheme : str or None
        One of the engine's `schemes` (harvester.engines.methods), for comparison; None: the
        first.
    tolerance : float or None
        Circuit only: relative tolerance of ngspice's control by the local error, which shortens
        steps below `step`; None: fixed steps, or ngspice's own tolerance for "pwl".
    joint_density : bool
        Keep p(X, X') as `Result.joint_density`.
    executor : concurrent.futures.Executor or None
        Used instead of worker processes: a process pool, Dask's `client.get_executor()`, mpi4py's.
    runner : WorkerPool, an object with one as its `pool`, or None
        Running processes to use again (`harvester.base.worker_pool`).
    progress : callable or False or None
        Called with the finished share, 0 … 1, and the current method. None shows a bar in a
        notebook, False none.

    Returns
    -------
    Result

    Raises
    ------
    HarvesterError
        An unknown name, or no ngspice.
    SimulationError
        A realization failed, or with `keep_going` all did; `partial` is the Result until then.

    Notes
    -----
    The same seed gives every engine the same noise; results do not depend on the number of workers.

    Examples
    --------
    ::

        harvester simulate paper --method circuit --set excitation.intensity=0.1 --json -
    """
    options = {
        "step": step, "source": source, "device": device, "copies": copies, "scheme": scheme,
        "tolerance": tolerance,
    }  # fmt: skip
    if isinstance(method, Stationary):
        from harvester.averaging.of_scene import average

        return average(scene, method=method.check_options_agree(options, DEFAULTS))
    from harvester.engines import outcome, spread
    from harvester.engines.orbits import attractors
    from harvester.scene.paths import several_starts
    from harvester.scene.prepared import prepared
    from harvester.statistics.range_watch import leaves_range

    engine = engine_of(method, **options)
    engine.check(scene)
    prepared_scene = prepared(scene)
    stretch = spread.stretch_of(prepared_scene, window, nodes)
    follow = spread.Follower(prepared_scene, engine.name, progress) if progress else None
    try:
        processes = spread.useful_processes(prepared_scene, engine)
        with spread.running(runner, executor, processes, workers) as pool:
            # A run without noise may have several motions, distinguished by the samples of their
            # starts.
            several = several_starts(prepared_scene)
            outcomes = spread.outcomes(
                prepared_scene, engine, pool, time_limit, follow, keep_going or several, stretch,
                joint_density=joint_density, stroboscope=stroboscope or several,
            )  # fmt: skip
            failures = {k: o for k, o in enumerate(outcomes) if isinstance(o, SimulationError)}
            # A start that leaves the range of the spring is a result, not a failure.
            lost = {
                k: o for k, o in failures.items() if several and leaves_range(prepared_scene, o)
            }
            failures = {k: o for k, o in failures.items() if k not in lost}
            if failures and not keep_going:
                raise next(iter(failures.values()))
            good = {k: o for k, o in enumerate(outcomes) if not isinstance(o, SimulationError)}
            motions: tuple[Attractor, ...] = ()
            if several:
                motions = attractors(prepared_scene, engine, good, len(lost), pool, time_limit)
    except SimulationError as error:
        error.partial = outcome.partial_result(prepared_scene, engine, error)
        raise
    result = outcome.result_of(prepared_scene, engine, [*good.values()], failures, motions=motions)
    return outcome.checked(result if stroboscope else replace(result, stroboscope=None))


def require_paths(scene: Scene, command: str) -> None:
    """Raise if the excitation does not have an unlimited number of independent paths."""
    if not scene.excitation.endless:
        spectrum = '"spectrum" (harvester spectrum makes one of a record) or '
        raise _too_few_paths(scene, command, spectrum)


def require_noise(scene: Scene, command: str) -> None:
    """Raise unless the excitation is Ornstein–Uhlenbeck noise."""
    from harvester.excitation.ornstein_uhlenbeck import OrnsteinUhlenbeck

    if not isinstance(scene.excitation, OrnsteinUhlenbeck):
        raise _too_few_paths(scene, command)


def _too_few_paths(scene, command, others=""):
    return HarvesterError(
        f'{scene.name}: excitation.kind = "{scene.excitation.kind}": {command} needs an unlimited '
        f'number of independent paths: set excitation.kind = {others}"ornstein-uhlenbeck"'
    )
