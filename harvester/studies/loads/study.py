"""`load_study`: loads and values on common noise, in rounds, every realization kept."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Unpack

from harvester.averaging import CLOSURES
from harvester.calling import takes_scene
from harvester.errors import HarvesterError, LoadError
from harvester.running import RunnerOptions, open_runner
from harvester.scene.model import Scene
from harvester.scene.units import require_resistor
from harvester.simulation.methods import ENGINES
from harvester.simulation.simulate import check_name, check_step, require_noise
from harvester.studies.grid import Grid, make_grid
from harvester.studies.loads.evaluation import Evaluation
from harvester.studies.loads.point import MOST_REALIZATIONS, Point
from harvester.studies.loads.proof import Proof, places_to_prove, proving
from harvester.version import __version__

# Measured time of a realization over its settling: a fifth of the run is then spent on settling.
DURATION_OVER_SETTLE = 4.0
# Monte Carlo everywhere, and the circuit as its judge at some places.
JUDGED = "judged"
METHODS = (JUDGED, *ENGINES, *CLOSURES)
# Wall-clock seconds of a study with a precision, unless told otherwise.
TIME_BUDGET = 540.0
# Of the time budget, kept for the circuit as judge.
PROOF_SHARE = 0.2


@dataclass(frozen=True)
class Study:
    """A load study's points and how it ended.

    Attributes
    ----------
    grid : Grid
    method : str
        "judged", an engine or a closure.
    methods : tuple of str
        Of each point.
    version : str
        Of what computed.
    precision : float or None
    evaluations : list of Evaluation
        In the order of `grid.points`.
    proofs : list of Proof
        Where the circuit was the judge.
    out_of_time : bool
        The time budget ended it: the same call again goes on.
    computed, reused : int
        Tasks.
    wall_seconds : float
    warnings : tuple of str
        Answers that were not believed, outcomes that are not kept, a folder that cannot be locked.
    """

    grid: Grid
    method: str
    methods: tuple[str, ...]
    version: str
    precision: float | None
    evaluations: list[Evaluation]
    proofs: list[Proof]
    out_of_time: bool
    computed: int
    reused: int
    wall_seconds: float
    warnings: tuple[str, ...] = ()


@takes_scene
def load_study(
    scene: Scene,
    *,
    loads: Sequence[str] = (),
    sweeps: Mapping[str, Sequence[float]] | None = None,
    method: str = JUDGED,
    precision: float | None = None,
    step: str | float = "default",
    **running: Unpack[RunnerOptions],
) -> Study:
    """Simulate loads over a grid of values, all on the same noise.

    Parameters
    ----------
    scene : Scene, str or Path
        Itself, its file or its built-in name.
        With a precision, its realizations are cut to `DURATION_OVER_SETTLE` times the settling,
        and there are as many as it takes, at most `MOST_REALIZATIONS`.
    loads : sequence of str
        Names in netlists/ or paths; empty: the scene's own.
    sweeps : dict of str to sequence of float
        "table.key" to values; several make a grid.
    method : str
        "judged": Monte Carlo, and at some places the circuit on the same noise, see
        `harvester.studies.loads.proof`; a load that only the circuit takes is run by it alone.
        "monte-carlo" or "circuit" alone; where the load is a resistor also a closure.
    precision : float or None
        Relative standard error of the output power that each point is run for; None: the
        scene's own run.
    step : str or float
        See `harvester.simulate`.
    **running
        See `harvester.running.open_runner`; with a precision the time budget is `TIME_BUDGET`
        where none is given.

    Returns
    -------
    Study

    Raises
    ------
    HarvesterError
        A mistake in the call. A simulation that fails is the outcome of its point.
    """
    clock = time.monotonic()
    check_name("method", method, METHODS)
    step = check_step(step)
    if precision is not None and not 0.0 < precision < 1.0:
        raise HarvesterError(f"--precision {precision}: must be a number in (0, 1)")
    statistical = method not in CLOSURES
    if precision and statistical:
        require_noise(scene, "a study with a precision")
        scene = _cut(scene)
        if running.get("time_budget") is None:
            running["time_budget"] = TIME_BUDGET
    grid = make_grid(scene, loads, sweeps or {})
    methods = tuple(_method_of(point.scene, method) for point in grid.points)
    with open_runner(**running) as runner:
        # Here already, so that a machine without ngspice says so before it has worked.
        version = runner.version("circuit" if method == JUDGED else method)
        aim = precision if statistical else None
        points = [
            Point(each.scene, own, step, runner.version(own), aim)
            for each, own in zip(grid.points, methods, strict=True)
        ]
        with runner.reserving(PROOF_SHARE if method == JUDGED else 0.0):
            evaluations = runner.follow([point.plan() for point in points])
        proofs = _proofs(runner, grid, methods, evaluations, step) if method == JUDGED else []
    return Study(
        grid=grid,
        method=method,
        methods=methods,
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


def _method_of(scene, method):
    """What runs a point: where the circuit is judge, it itself what Monte Carlo does not take."""
    if method in (JUDGED, "monte-carlo"):
        try:
            ENGINES["monte-carlo"].check(scene)
        except LoadError:
            if method != JUDGED:
                raise
            return "circuit"
        return "monte-carlo"
    if method != "circuit":
        require_resistor(scene, method)
    return method


def _proofs(runner, grid, methods, evaluations, step):
    """Of the places that Monte Carlo ran."""
    versions = runner.version("monte-carlo"), runner.version("circuit")
    return runner.follow(
        [
            proving(place, highest, grid.points[place].scene, step, versions)
            for place, highest in places_to_prove(grid, evaluations, grid.scene.run.seed)
            if methods[place] == "monte-carlo"
        ]
    )


def _cut(scene):
    """The scene with realizations of the length that rounds are made of."""
    run = scene.run
    duration = min(run.duration, DURATION_OVER_SETTLE * run.settle) or run.duration
    return scene.replace({"run.duration": duration, "run.realizations": MOST_REALIZATIONS})
