"""Cross-check of a load study with the circuit: both engines on the same noise at a few points.

The points are each load's highest one, which gives the study's result, and a random one. Paths of a
device that jumps between wells diverge after about ten periods at any accuracy, so long runs
resolve a difference only to a few per cent. The first periods from rest resolve it to a few tenths
of a per cent. The settled part also tests charged stores.
"""

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr, stdtrit

from harvester.base.errors import HarvesterError
from harvester.engines.methods import Engine
from harvester.engines.realizations import Realizations, periods_of
from harvester.engines.request import answers_before_failure, told
from harvester.engines.task import Wanted
from harvester.scene.model import Scene
from harvester.scene.paths import distinct_realizations
from harvester.scene.prepared import prepared
from harvester.scene.steps import step_error
from harvester.statistics.agreement import (
    NEGLIGIBLE_SHARE,
    SIGNIFICANT_SIGMAS,
    differ,
    is_sharp,
)
from harvester.statistics.batch_means import ratio_of_sums, standard_error
from harvester.statistics.estimate import why_no_error
from harvester.statistics.run_estimates import error_of
from harvester.studies.grid import Grid
from harvester.studies.loads.evaluation import Evaluation, series_of

# Number of realizations that the circuit and Monte Carlo each run at the compared point: of full
# length, and of the first periods only.
PROOF_REALIZATIONS, EARLY_REALIZATIONS = 8, 64
# The early power is compared if it is at least this share of the settled power, since only leakage
# reaches the output before a store is charged.
LEAST_EARLY_SHARE = 1e-3


@dataclass(frozen=True)
class Proof:
    """The circuit's result at one point of a study, compared with Monte Carlo.

    Attributes
    ----------
    place
        Index of the point in the grid.
    highest
        Whether the point is the highest of its curve, rather than a random one.
    difference : float
        (circuit − Monte Carlo)/Monte Carlo of the output power on the same noise; NaN if it cannot
        be computed.
    standard_error : float
        Standard error of the paired difference, widened for few realizations; NaN if there is no
        difference.
    early_difference, early_standard_error : float
        Difference over the first `PERIODS` periods from rest; NaN if it cannot be computed.
    trouble
        Reason why a difference is missing, first for the settled part; "" if none is missing.
    """

    place: int
    highest: bool
    difference: float = math.nan
    standard_error: float = math.nan
    early_difference: float = math.nan
    early_standard_error: float = math.nan
    trouble: str = ""

    @property
    def checks(self) -> bool:
        """Whether nothing failed and a difference is known to `SHARP_SHARE` or better."""
        errors = (self.standard_error, self.early_standard_error)
        return not self.trouble and any(map(is_sharp, errors))

    @property
    def disagrees(self) -> bool:
        """Whether a difference exceeds its error and is not negligible."""
        pairs = (
            (self.difference, self.standard_error),
            (self.early_difference, self.early_standard_error),
        )
        return any(differ(*pair, negligible=NEGLIGIBLE_SHARE) for pair in pairs)


def points_to_check(
    grid: Grid, evaluations: Sequence[Evaluation], seed: int
) -> list[tuple[int, bool]]:
    """Points to check, in the grid's order: (index, whether it is a curve's highest point).

    They are the highest ranked point of every curve, and a random other point of each load with a
    power.
    """
    lengths = [len(values) for values in grid.sweeps.values()]
    numbers = np.arange(len(evaluations)).reshape(len(grid.loads), *lengths)
    if grid.curve is not None:
        numbers = np.moveaxis(numbers, grid.curve + 1, -1)
    ranked = np.array([evaluation.ranked_power for evaluation in evaluations])
    power = np.array([evaluation.power or math.nan for evaluation in evaluations])
    random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(len(evaluations),)))
    chosen: dict[int, bool] = {}
    for of_load in numbers.reshape(len(grid.loads), -1):
        curves = of_load.reshape(-1, lengths[grid.curve] if grid.curve is not None else 1)
        finite = [curve[np.isfinite(ranked[curve])] for curve in curves]
        best = {int(curve[np.argmax(ranked[curve])]) for curve in finite if curve.size}
        candidates = [int(k) for k in of_load if np.isfinite(power[k]) and k not in best]
        chosen |= dict.fromkeys(best, True)
        if candidates:
            chosen[int(random.choice(candidates))] = False
    return sorted(chosen.items())


def proving(
    place: int, highest: bool, scene: Scene, first: tuple[Engine, str], judge: tuple[Engine, str]
) -> Generator[Wanted, list, Proof]:
    """Generator for `Runner.follow` that returns the Proof of one point.

    Parameters
    ----------
    place, highest
        As in `Proof`.
    scene
        The scene of the point.
    first, judge : Monte Carlo and the circuit, each with its version, see `Runner.version`.
    """
    settled, early, costs = [], [], []
    prepared_scene = prepared(scene)
    duration = min(periods_of(prepared_scene), scene.run.settle + scene.run.duration)
    from_rest = prepared_scene.replace({"run.settle": 0.0, "run.duration": duration})
    for method, version in (first, judge):
        costs.append(step_error(prepared_scene, method.step, method.name))
        settled.append(_tasks(prepared_scene, PROOF_REALIZATIONS, method, version))
        early.append(_tasks(from_rest, EARLY_REALIZATIONS, method, version))
    parts = [*settled, *early]
    answers = iter((yield Wanted([task for tasks in parts for task in tasks])))
    grouped = [[next(answers) for _ in tasks] for tasks in parts]
    difference, standard_error, trouble, power = _difference(prepared_scene, costs, *grouped[:2])
    proof = Proof(place, highest, difference, standard_error, trouble=trouble)
    difference, standard_error, trouble, early_power = _difference(
        prepared_scene, costs, *grouped[2:]
    )
    if early_power < LEAST_EARLY_SHARE * power:
        return proof
    return replace(
        proof,
        early_difference=difference,
        early_standard_error=standard_error,
        trouble=proof.trouble or (trouble and f"from rest: {trouble}"),
    )


def _tasks(prepared_scene, most, method, version):
    cut = Realizations.of(prepared_scene, method, version, waveform=True)
    different = distinct_realizations(prepared_scene)
    return cut.tasks(0, min(most, different), different)


def _difference(prepared_scene, costs, ours, theirs):
    """Return (difference, standard error, reason, power by Monte Carlo).

    The difference is (circuit − Monte Carlo)/Monte Carlo on the same noise. If it or its error
    cannot be computed, it is NaN, and `reason` explains this; otherwise `reason` is empty. Without
    noise the error includes the step errors of both engines.
    """
    scene, powers = prepared_scene.scene, []
    for answers in (ours, theirs):
        successful, ended = answers_before_failure(answers)
        series = series_of(prepared_scene, successful)
        if series is None:
            words = told(ended) if isinstance(ended, HarvesterError) else str(ended)
            return math.nan, math.nan, words, math.nan
        powers.append(series)
    ours, theirs = powers
    shared = min(len(ours), len(theirs))
    if not ours[:shared].any():
        return math.nan, math.nan, "no power by Monte Carlo", 0.0
    drawn = scene.excitation.random
    in_time = standard_error if drawn else error_of(scene)
    ratio, error = ratio_of_sums(theirs[:shared], ours[:shared], in_time)
    if error is None and not drawn:
        # Both engines have the same deterministic path: only their steps differ.
        error = 0.0
    if error is None:
        reason = why_no_error(ratio, error).partition(":")[0]
        return ratio - 1.0, math.nan, reason, float(ours.mean())
    error = _of_few(shared) * error if drawn else math.hypot(error, *costs)
    return ratio - 1.0, error, "", float(ours.mean())


def _of_few(realizations):
    """Ratio of Student's quantile to the normal one, at the probability of `SIGNIFICANT_SIGMAS`.

    Batches of one realization may be correlated, so the degrees of freedom are the number of
    realizations minus 1.
    """
    least = max(realizations - 1, 1)
    return float(stdtrit(least, ndtr(SIGNIFICANT_SIGMAS))) / SIGNIFICANT_SIGMAS
