"""What a load study consists of, and the steps that `load_study` takes."""

from dataclasses import dataclass

from harvester.errors import LoadError
from harvester.running import Runner
from harvester.scene.model import Scene
from harvester.scene.units import require_resistor
from harvester.simulation.methods import ENGINES
from harvester.studies.evaluation import Evaluation
from harvester.studies.grid import Grid
from harvester.studies.point import MOST_REALIZATIONS
from harvester.studies.proof import Proof, places_to_prove, proving
from harvester.studies.public import JUDGED

# Measured time of a realization over its settling: a fifth of the run is then spent on settling.
DURATION_OVER_SETTLE = 4.0
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


def method_of(scene: Scene, method: str) -> str:
    """What runs a point: a load that Monte Carlo does not take is run by its judge, the circuit."""
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


def proofs(
    runner: Runner,
    grid: Grid,
    methods: tuple[str, ...],
    evaluations: list[Evaluation],
    step: str | float,
) -> list[Proof]:
    """The circuit beside Monte Carlo, on the same noise, at chosen points that Monte Carlo ran."""
    versions = runner.version("monte-carlo"), runner.version("circuit")
    return runner.follow(
        [
            proving(place, highest, grid.points[place].scene, step, versions)
            for place, highest in places_to_prove(grid, evaluations, grid.scene.run.seed)
            if methods[place] == "monte-carlo"
        ]
    )


def cut(scene: Scene) -> Scene:
    """The scene with realizations of the length that rounds are made of."""
    run = scene.run
    duration = min(run.duration, DURATION_OVER_SETTLE * run.settle) or run.duration
    return scene.replace({"run.duration": duration, "run.realizations": MOST_REALIZATIONS})
