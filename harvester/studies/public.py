"""Public studies.

A signature and its docstring define the options of a command and their help. Functions import their
implementations, so that reading the options does not import numba.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Unpack

from harvester.base.arguments import check_name, listed, real_numbers, table
from harvester.base.errors import AveragingError, HarvesterError, LoadError
from harvester.base.method import Method
from harvester.base.plain_text import shown
from harvester.base.signatures import (
    Count,
    Distributions,
    Faults,
    Grid,
    Grids,
    Hertz,
    Kind,
    Loads,
    MethodOrName,
    Methods,
    Over,
    Overrides,
    Quantities,
    Ranges,
    RunnerOptions,
    Seconds,
    Share,
    Step,
)
from harvester.engines.methods import Engine, engine_of, method_of
from harvester.engines.simulate import TIME_LIMIT, require_paths, simulate
from harvester.scene.calling import checked, scene_of, takes_scene
from harvester.studies import JUDGED, ROWS, TIME_BUDGET

COVARIANCE = Kind("FILE", "a dictionary or a path", lambda v: isinstance(v, (Mapping, str, Path)))

if TYPE_CHECKING:
    from collections.abc import Callable
    from concurrent.futures import Executor

    from harvester.base.worker_pool import Workers
    from harvester.scene.model import Scene
    from harvester.studies.comparison.comparison import Comparison
    from harvester.studies.frequency_response import FrequencyResponse
    from harvester.studies.loads.study import LoadStudy
    from harvester.studies.optimum.result import Optimum
    from harvester.studies.sensitivity.study import Sensitivity
    from harvester.studies.spectrum import SpectrumAnalysis
    from harvester.studies.sweep import Sweep


@takes_scene
def validate(
    scene: Scene,
    *,
    step: Step = "default",
    workers: Count | None = None,
    time_limit: Seconds = TIME_LIMIT,
    executor: Executor | None = None,
    runner: Workers | None = None,
    progress: Callable[[float, str], object] | Literal[False] | None = None,
) -> Comparison:
    """Compare circuit, Monte Carlo and averaging on one scene.

    Parameters
    ----------
    scene : Scene, str or Path
        A scene, its file or the name of a built-in one.
    step : str or float
        default, fine, finest, or the longest step in seconds.
    workers : int or None
        Number of processes (default: one per core).
    time_limit : float
        Wall-clock limit of one realization.

    Other Parameters
    ----------------
    executor, runner
        See `harvester.simulate`.
    progress : callable or False or None
        Called with the finished share, 0 … 1, and the current method. None shows a bar in a
        notebook, False shows none.

    Raises
    ------
    HarvesterError, SimulationError

    Examples
    --------
    ::

        harvester validate paper --output results --report paper.html
    """
    from harvester.device import timescales
    from harvester.engines.progress import Stages
    from harvester.engines.spread import running
    from harvester.scene.prepared import prepared
    from harvester.statistics.paired import paired_difference
    from harvester.studies.comparison import comparison

    parameters = prepared(scene).system
    until = comparison.SHOWN_PERIODS * 2.0 * math.pi / timescales.angular_frequency(parameters)
    results, stages = [], Stages(progress) if progress else None
    with (
        ThreadPoolExecutor(1) as meanwhile,
        running(runner, executor, scene.run.realizations, workers) as pool,
    ):
        averaged = meanwhile.submit(_averaged, scene)
        for method, (begin, end) in comparison.SHARES.items():
            if stages:
                stages.begin(begin, end, method)
            result = simulate(
                scene,
                method=method,
                step=step,
                time_limit=time_limit,
                window=(0.0, until),
                joint_density=method == "monte-carlo",
                runner=pool,
                progress=stages,
            )
            results.append(result)
    circuit, monte_carlo = results
    paired = paired_difference(circuit, monte_carlo)
    closures, refused = averaged.result()
    return comparison.Comparison(circuit, monte_carlo, closures, refused, paired)


def _averaged(scene):
    """Results of the valid stationary methods, and the reasons why others are not valid."""
    from harvester.averaging.closures import CLOSURES
    from harvester.averaging.of_scene import average

    closures, refused = {}, {}
    for closure, method in CLOSURES.items():
        try:
            closures[closure] = average(scene, method=closure, jump_rates=method.jump_rates)
        except (AveragingError, LoadError) as error:
            refused[closure] = str(error)
    return closures, refused


@takes_scene
def frequency_response(
    scene: Scene,
    frequencies: Grid,
    *,
    amplitude: Annotated[float, Kind("A")] | None = None,
    down: bool = False,
    quantities: Quantities = (),
    per_g: bool = False,
    method: MethodOrName = "monte-carlo",
    step: Step = "default",
    **running: Unpack[RunnerOptions],
) -> FrequencyResponse:
    """Amplitude, voltage and power over the frequency of a sine.

    Parameters
    ----------
    scene : Scene, str or Path
        A scene, its file or the name of a built-in one;
        with `excitation.kind = "sine"`, whose amplitude is kept, or any other with `amplitude`.
    frequencies : sequence of float
        Frequencies in Hz, such as numpy.linspace(5, 30, 51) or [10.0, 12.5].
    amplitude : float or None
        Amplitude of the base acceleration, m/s² in SI (default: the amplitude of the scene's sine).
    down : bool
        Also sweep down, to show hysteresis as a difference between the sweeps.
    quantities : sequence of str
        Quantities to show, one or several of: displacement_amplitude (of the tip, relative to the
        base), absolute_amplitude, rms_voltage, peak_voltage, mean_power, peak_power; of a load with
        an output mean_output_voltage and mean_output_power (default: the first, rms_voltage,
        mean_power and the output's quantities).
    per_g : bool
        Normalise to a base acceleration of 1 g: values per g, powers per g². For a nonlinear device
        they are valid only at the given amplitude.
    method : str or Method
        monte-carlo (Runge–Kutta) or circuit (ngspice), on the same path.
    step : str or float
        default, fine, finest, or the longest step in seconds.
    time_limit : float
        Wall-clock limit of one realization (default: 3600).
    **running
        See `harvester.open_runner`.

    Raises
    ------
    HarvesterError, SimulationError

    Notes
    -----
    The excitation is deterministic, so there is no statistical error. `FrequencySweep.residual`
    measures the deviation from settled, periodic motion. A run with half the `step` shows the step
    error, which is of second order in the circuit.

    Examples
    --------
    ::

        harvester frequency-response device --amplitude 4 --frequencies 5:30:linear:51 --down
    """
    import numpy as np

    from harvester.engines.opening import open_runner
    from harvester.engines.task import Task
    from harvester.scene.prepared import prepared
    from harvester.studies import frequency_response as work
    from harvester.studies.answers import successful

    engine = engine_of(method, step=step)
    scene = work.with_sine(scene, amplitude)
    names = work.shown_of(scene, quantities, per_g)
    rising = work.rising_frequencies(frequencies)
    directions = {"up": rising, "down": rising[::-1]} if down else {"up": rising}
    prepared_scene = prepared(scene)
    scenes: list[Any] = [work.stepped(prepared_scene, order) for order in directions.values()]
    with open_runner(**running) as runner:
        version = runner.version(engine.name)
        arguments = [{"scene": swept, **engine.as_arguments("engine")} for swept in scenes]
        tasks = [Task(work.one_direction, values, version, engine.name) for values in arguments]
        outcomes = successful(runner.run(tasks))
    sweeps = []
    for direction, (rows, _, _) in zip(directions, outcomes, strict=True):
        ordered = rows if direction == "up" else rows[::-1]
        sweeps.append(work.FrequencySweep(direction, *np.array(ordered).T))
    return work.FrequencyResponse(
        scene=scene,
        engine=engine.name,
        frequencies=rising,
        sweeps=sweeps,
        scales=prepared_scene.scales,
        engine_version=outcomes[0][1],
        dwell=scenes[0].excitation.dwell,
        seconds=sum(seconds for _, _, seconds in outcomes),
        shown=names,
        per_g=per_g,
    )


@checked
def spectrum(
    source: Annotated[Any, Kind("FILE")],
    /,
    *,
    overrides: Overrides = (),
    device: Annotated[Any, Kind("FILE")] | None = None,
    column: str | None = None,
    unit: str | None = None,
    sampling_rate: Hertz | None = None,
    resolution: Hertz | None = None,
    duration: Seconds | None = None,
    breakpoints: int = 20,
    mend: Faults = (),
) -> SpectrumAnalysis:
    """Spectral density of a scene's excitation or a record, its moments, and a test specification.

    Parameters
    ----------
    source : Scene, str or Path
        A scene, its file (.toml) or its built-in name; else a record's file.
    overrides : sequence of str or dict
        Override a value of the scene, or of the device of a record; TABLE=none removes a table.
    device : Scene, str, Path or None
        For a record: the scene of the device whose resonance is evaluated.
    column : str or None
        For a record: name or number of the acceleration's column.
    unit : str or None
        Unit of a record's column, if its heading has none: g, m/s^2, …
    sampling_rate : float or None
        Sampling rate of a record, if its file has none (Hz).
    resolution : float or None
        Bandwidth of the density (Hz); default: the bandwidth of 64 segments.
    duration : float or None
        For a scene: duration of the generated excitation (s; default: run.duration).
    breakpoints : int
        Maximum number of breakpoints in the specification, whose file a scene with kind =
        "spectrum" can use.
    mend : sequence of str
        For a record: faults to repair, as in a scene: nan, uneven, clipped.

    Raises
    ------
    SceneError, HarvesterError

    Examples
    --------
    ::

        harvester spectrum truck.csv --unit g --device device --breakpoints 12 --output truck
    """
    from harvester.scene.source import built_in_names
    from harvester.studies import spectrum as work

    if breakpoints < 2:
        raise HarvesterError(f"breakpoints {breakpoints}: must be at least 2")
    name = str(source)
    if not isinstance(source, (str, Path)) or name.endswith(".toml") or name in built_in_names():
        for option, value in {"device": device, "column": column, "unit": unit}.items():
            if value is not None:
                of_scene = getattr(source, "name", source)
                raise HarvesterError(
                    f"{option}: is for a record, but {of_scene} is a scene: omit {option}"
                )
        return work.of_scene(scene_of(source, overrides), duration, resolution, breakpoints)
    if duration is not None:
        raise HarvesterError("duration: is for a scene; a record is analysed completely")
    number: Any = int(column) if column is not None and column.isdigit() else column
    faults = [*listed(mend, "mend", 'mend=["nan"]', str)]
    keys = {"unit": unit, "column": number, "sampling_rate": sampling_rate, "mend": faults}
    if overrides and device is None:
        raise HarvesterError(f"--set: is for a scene, but {name} is a record: give --device")
    of_device = None if device is None else scene_of(device, overrides)
    return work.of_record(name, keys, of_device, resolution, breakpoints)


@takes_scene
def sweep(
    scene: Scene,
    over: Over,
    *,
    methods: Methods = ("monte-carlo",),
    quantities: Quantities = ("mean_power",),
    precision: Share | None = None,
    step: Step = "default",
    **running: Unpack[RunnerOptions],
) -> Sweep:
    """Simulate a scene at every point of a grid with every method, all on the same noise.

    Parameters
    ----------
    scene : Scene, str or Path
        A scene, its file or the name of a built-in one.
    over : dict of str to sequence of float or str
        Any key of the scene and its values, numbers or texts, such as
        {"load.resistance": numpy.geomspace(1e4, 1e6, 7)}; several make a grid.
    methods : sequence of str or Method
        Engines and stationary methods; several may be given (default: monte-carlo).
    quantities : sequence of str
        Quantities of the tables and of a precision; several may be given (default:
        mean_power).
    precision : float or None
        Target relative standard error of each point by the engines (default: use the scene's number
        of realizations).
    step : str or float
        default, fine, finest, or the longest step in seconds, for engines given by name.
    time_limit : float
        Wall-clock limit of one realization (default: 3600).
    **running
        See `harvester.open_runner`.

    Raises
    ------
    HarvesterError
        A mistake in the call. A failed simulation is the outcome of its point.

    Examples
    --------
    ::

        harvester sweep paper --over excitation.intensity=0.005:0.1:log:7 --method monte-carlo
            --method fokker_planck --quantity mean_square_voltage --output swept
    """
    from harvester.engines.opening import open_runner
    from harvester.engines.request import Request
    from harvester.studies import sweep as work
    from harvester.studies.answers import check_quantities
    from harvester.studies.grid import make_grid

    clock = time.perf_counter()
    methods = listed(methods, "methods", 'methods=["monte-carlo"]')
    chosen = [item if isinstance(item, Method) else method_of(item, step=step) for item in methods]
    names = [method.name for method in chosen]
    labels = tuple(m.label if names.count(m.name) > 1 else m.name for m in chosen)
    if not methods or len(set(labels)) < len(methods):
        raise HarvesterError(f"methods = {list(labels)}: give at least one, and each once")
    quantities = listed(quantities, "quantities", 'quantities=["mean_power"]', str)
    grid = make_grid(scene, (), over, any_key=True)
    check_quantities(quantities, [point.scene for point in grid.points], chosen)
    requests = [
        Request(point.scene, method, precision=precision, quantities=quantities)
        for point in grid.points
        for method in chosen
    ]
    with open_runner(**running) as runner:
        answers = runner.answer(requests)
        out_of_time = runner.out_of_time
    shape = (*(len(values) for values in grid.sweeps.values()), len(methods))
    cells = work.cells_of(labels, answers, quantities)
    return work.Sweep(
        scene=grid.scene,
        values=grid.sweeps,
        methods=labels,
        quantities=quantities,
        cells=cells.reshape(shape),
        scenes=[point.scene for point in grid.points],
        notes=grid.notes,
        out_of_time=out_of_time,
        seconds=time.perf_counter() - clock,
    )


@takes_scene
def load_study(
    scene: Scene,
    *,
    loads: Loads = (),
    over: Grids | None = None,
    method: MethodOrName = JUDGED,
    precision: Share | None = None,
    step: Step = "default",
    **running: Unpack[RunnerOptions],
) -> LoadStudy:
    """Compare loads over a grid of values on the same noise: power, optimum, ranking.

    Parameters
    ----------
    scene : Scene, str or Path
        A scene, its file or the name of a built-in one.
        With a precision, the measured time of a realization is limited to `DURATION_OVER_SETTLE`
        times the settling time, and their number is as required, at most `MOST_REALIZATIONS`.
    loads : sequence of str
        A load of netlists/ or a file; several may be given (default: the scene's load).
    over : dict of str to sequence of float
        Numbers of the scene and their values, such as
        {"load.parameters.resistance": numpy.geomspace(1e4, 1e6, 7)}; several make a grid.
    method : str or Method
        judged: monte-carlo, cross-checked with the circuit on the same noise at the optima and at
        random points (`harvester.studies.loads.proof`; loads that only the circuit supports are run
        by it alone); monte-carlo or circuit alone; for a resistor also a stationary method.
    precision : float or None
        Target relative standard error of the output power at every point (default: use the scene's
        number of realizations).
    step : str or float
        default, fine, finest, or the longest step in seconds.
    time_limit : float
        Wall-clock limit of one realization (default: 3600).
    **running
        See `harvester.open_runner`; with a precision the default time budget is `TIME_BUDGET`.

    Raises
    ------
    HarvesterError
        A mistake in the call. A failed simulation is the outcome of its point.

    Examples
    --------
    ::

        harvester load-study device --load bridge --load sece --sweep
            load.parameters.resistance=1e4:1e7:log:7 --precision 0.03 --output study
    """
    from harvester.engines.opening import open_runner
    from harvester.studies.grid import make_grid
    from harvester.studies.loads import study as work
    from harvester.studies.loads.evaluation import MOST_REALIZATIONS, evaluating
    from harvester.version import __version__

    clock = time.monotonic()
    chosen: Any
    chosen, judge = work.chosen(method, step)
    statistical = isinstance(chosen, Engine)
    if precision and statistical:
        require_paths(scene, "a study with a precision")
        run = scene.run
        duration = min(run.duration, work.DURATION_OVER_SETTLE * run.settle) or run.duration
        scene = scene.replace({"run.duration": duration, "run.realizations": MOST_REALIZATIONS})
        if running.get("time_budget") is None:
            running["time_budget"] = TIME_BUDGET
    grid = make_grid(scene, loads, over or {})
    methods = tuple(work.method_at(point.scene, chosen, judge) for point in grid.points)
    with open_runner(**running) as runner, runner.in_stages() as stages:
        # Checked before any work, so that a machine without ngspice fails at once.
        version = runner.version((judge or chosen).name)
        aim = precision if statistical else None
        plans = [
            evaluating(node.scene, point_method, runner.version(point_method.name), aim)
            for node, point_method in zip(grid.points, methods, strict=True)
        ]
        share = work.PROOF_SHARE if judge else 0.0
        stages.begin(0.0, 1.0 - share, "")
        with runner.reserving(share):
            evaluations = runner.follow(plans)
        stages.begin(1.0 - share, 1.0, "cross-check")
        proofs = work.proofs(runner, grid, (chosen, judge), evaluations) if judge else []
    return work.LoadStudy(
        grid=grid,
        method=JUDGED if judge else chosen.name,
        version=", ".join(filter(None, (f"harvester {__version__}", version))),
        precision=precision,
        evaluations=evaluations,
        proofs=proofs,
        out_of_time=runner.out_of_time,
        computed=runner.computed,
        reused=runner.reused,
        wall_seconds=time.monotonic() - clock,
        warnings=tuple(runner.warnings),
    )


@takes_scene
def sensitivity(
    scene: Scene,
    vary: Distributions | None = None,
    *,
    covariance: Annotated[Mapping[str, Any] | str | Path, COVARIANCE] | None = None,
    quantity: str | None = None,
    method: MethodOrName | None = None,
    above: Annotated[float, Kind("LIMIT")] | None = None,
    rows: int = ROWS,
    precision: Share | None = None,
    **running: Unpack[RunnerOptions],
) -> Sensitivity:
    """Tolerances: effect of each parameter (Sobol indices), scatter of a quantity, and yield.

    Parameters
    ----------
    scene : Scene, str or Path
        The scene; its [run] applies to every device, with half of the realizations for each of two
        replicates.
    vary : dict of str to str
        ±10%, +-10%, ±0.5, uniform:LOW:HIGH, normal:5% or normal:MEAN:SD for a number of the scene:
        see `harvester.studies.sensitivity.tolerances`.
    covariance : dict or file
        JSON of `harvester identify`: parameters scatter according to their uncertainty, along the
        principal axes (`harvester.studies.sensitivity.tolerances`).
    quantity : str or None
        mean_power, power_conversion_efficiency, for a load with an output mean_output_power, …
        (default: the power, at the output if the load has one).
    method : str, Method or None
        An engine or a stationary method (default: monte-carlo, or circuit if the load needs it).
    above : float or None
        Also estimate the yield, the share of devices above this limit in the scene's units.
    rows : int
        Number N of rows, a power of two; N × (parameters + 2) devices are simulated.
    precision : float or None
        Target relative standard error of each device's quantity in each of two runs (default: use
        the scene's number of realizations). The noise is removed for any length of run: a few rows
        of long runs and many rows of short runs cost the same.
    **running
        See `harvester.open_runner`.

    Raises
    ------
    HarvesterError
        A mistake in the call, or no data for indices.
    OutOfTime
        Too few rows for indices.

    Notes
    -----
    See `harvester.studies.sensitivity.sobol` for the estimators and the removal of noise.

    Examples
    --------
    ::

        harvester sensitivity paper --vary oscillator.cubic_stiffness=±10% --vary
            stoppers.gap=normal:2% --above 0.001 --output tolerances
    """
    from harvester.engines.opening import open_runner
    from harvester.studies.answers import check_quantities, checked_method
    from harvester.studies.sensitivity import study as work
    from harvester.studies.sensitivity.tolerances import directions, tolerance

    clock = time.perf_counter()
    varied = table({} if vary is None else vary, "vary", 'vary={"load.resistance": "±10%"}')
    tolerances: list[Any] = [tolerance(scene, key, text) for key, text in varied.items()]
    if covariance is not None:
        axes = directions(scene, covariance)
        for key in varied:
            if axes and key in axes[0].centre:
                raise HarvesterError(
                    f"--vary {key}: the covariance already contains its scatter: omit --vary {key}"
                )
        tolerances += axes
    if not tolerances:
        raise HarvesterError(
            "--vary: name at least one parameter, TABLE.KEY=±10%, or give --covariance"
        )
    fewest, most = work.FEWEST_ROWS, work.MOST_ROWS
    if not fewest <= rows <= most or rows & (rows - 1):
        raise HarvesterError(
            f"--rows {rows}: must be a power of two, {fewest} to {most}, such as {ROWS}"
        )
    chosen = checked_method(scene, method)
    shape = rows, len(tolerances) + 2
    quantity = quantity or _power_of(scene)
    check_quantities([quantity], [scene], [chosen])
    with open_runner(**running) as opened:
        study = work.study_of(scene, tolerances, quantity, chosen, above, shape, precision, opened)
    return replace(study, seconds=time.perf_counter() - clock)


@takes_scene
def optimum(
    scene: Scene,
    over: Ranges,
    *,
    low: Annotated[float, Kind("A", option="from")] | None = None,
    high: Annotated[float, Kind("B", option="to")] | None = None,
    maximise: Annotated[str, Kind("QUANTITY")] | None = None,
    method: MethodOrName | None = None,
    closure: str | None = None,
    evaluations: int | None = None,
    precision: Share | None = None,
    **running: Unpack[RunnerOptions],
) -> Optimum:
    """Find values of one or several parameters with the largest power or efficiency (Eq. 37).

    Parameters
    ----------
    scene : Scene, str or Path
        The scene. Its [run] applies to the first runs at each point (one parameter), or to each
        evaluation (several parameters).
    over : str, or dict of str to (float, float) or None
        A number of the scene and its range (default: a tenth to ten times its value, within the
        key's limits); several may be given.
    low : float or None
        Lower end of the range of a single parameter.
    high : float or None
        Upper end of this range.
    maximise : str or None
        mean_power, power_conversion_efficiency or mean_square_voltage; for a load with an output
        also mean_output_power etc.; for several parameters any quantity (default: the power, at the
        output if the load has one).
    method : str, Method or None
        monte-carlo, circuit or a stationary method (default: monte-carlo, or circuit if the load
        needs it). A method without noise determines the optimum to its own precision.
    closure : str or None
        Stationary method compared with the simulation, for one parameter (default: the most
        accurate).
    evaluations : int or None
        Number of proposed points for several parameters (default: 60 for each), or of grid points
        for one parameter by a stationary method (17). The climb adds some tens of points.
    precision : float or None
        Target relative standard error of the value at the optimum (default: use the scene's number
        of realizations).
    **running
        See `harvester.open_runner`.

    Returns
    -------
    Optimum
        For one parameter, averaging and simulation are compared, and the optimum has an interval;
        for several, the value has one.

    Raises
    ------
    HarvesterError
        An unknown key, or an empty range.
    OptimumError
        The largest value is at an end of the range, or no maximum exceeds the noise.
    SimulationError
        A run failed; `OutOfTime` if the time budget is spent.
    MissingLibrary
        Several parameters need Optuna, which is not installed.

    Notes
    -----
    The points proposed for several parameters depend only on the seed and the answers. Therefore an
    interrupted call with `output`, when repeated, reuses finished answers and gives the same
    result.

    Examples
    --------
    ::

        harvester optimum device --maximise mean_power --over load.resistance=1e4:1e7 --over
            oscillator.linear_stiffness=-100:-20
    """
    from harvester.averaging.closures import CLOSURES
    from harvester.averaging.method import DEFAULT_CLOSURE
    from harvester.engines.opening import open_runner
    from harvester.statistics.output_side import RATIOS
    from harvester.studies.answers import check_quantities, checked_method, orbits_at
    from harvester.studies.optimum.axis import Axis
    from harvester.studies.optimum.line import MAXIMISED, along
    from harvester.studies.optimum.several import over_several

    clock = time.perf_counter()
    example = 'over={"load.resistance": (1e4, 1e6)}'
    ranges = {over: None} if isinstance(over, str) else table(over, "over", example)
    if not ranges:
        raise HarvesterError("--over: name at least one parameter, TABLE.KEY")
    if low is not None or high is not None:
        if len(ranges) > 1 or [*ranges.values()] != [None]:
            raise HarvesterError(
                "--from and --to: are for a single --over TABLE.KEY; otherwise write "
                "--over TABLE.KEY=LOW:HIGH"
            )
        ranges = dict.fromkeys(ranges, (low, high))
    ends = {key: _ends(key, interval) for key, interval in ranges.items()}
    maximise = maximise or _power_of(scene)
    limited = scene.beam is not None and scene.beam.strain_limit is not None
    chosen = checked_method(scene, method)
    # A maximum at the strain limit has no peak to which a curve can be fitted, and a stationary
    # method has no noise: both use the search for several parameters.
    is_one = len(ends) == 1 and not limited and isinstance(chosen, Engine)
    if evaluations is not None and is_one:
        raise HarvesterError("--evaluations: is for several parameters, a second --over")
    if closure is not None and not is_one:
        raise HarvesterError("--closure: is for one parameter by an engine; else use --method")
    closure = check_name("closure", closure or DEFAULT_CLOSURE, CLOSURES)
    if is_one:
        load = scene.load.circuit
        outputs = RATIOS if load and load.has_output else ()
        check_name("quantity", maximise, (*MAXIMISED, *outputs))
    else:
        check_quantities([maximise], [scene], [chosen])
    if limited and not isinstance(chosen, Engine):
        raise HarvesterError(
            f"{scene.name}: beam.strain_limit: {chosen.name} computes no peak strain; use --method "
            "monte-carlo or circuit, or remove the limit"
        )
    axes = [Axis.of(scene, key, *interval) for key, interval in ends.items()]
    with contextlib.ExitStack() as opened:
        runner = opened.enter_context(open_runner(**running))
        stages = opened.enter_context(runner.in_stages())
        if is_one:
            result = along(scene, axes[0], maximise, chosen, closure, runner, stages, precision)
        else:
            result = over_several(
                scene, axes, maximise, chosen, runner, stages, evaluations, precision
            )
        location = {parameter.axis.key: parameter.place for parameter in result.parameters}
        orbits = orbits_at(scene.replace(location), chosen, runner)
    return replace(result, orbits=orbits, seconds=time.perf_counter() - clock)


def _power_of(scene):
    """The power to maximise: at the load's output if it has one."""
    load = scene.load.circuit
    return "mean_output_power" if load and load.has_output else "mean_power"


def _ends(key, ends):
    """Both ends of a range; None, None if the range follows from the scene's value."""
    if ends is None:
        return None, None
    pair = listed(ends, f"over[{shown(key)}]", "(0.1, 2.0)")
    if len(pair) != 2:
        raise HarvesterError(f"over[{shown(key)}]: has {len(pair)} numbers; write (0.1, 2.0)")
    for end in pair:
        if end is not None:
            real_numbers([end], f"over[{shown(key)}]", "(0.1, 2.0)")
    return pair
