"""The circuit as judge of a load study: the same noise by both engines, at a few of its places.

At each load's highest point, where the study's answer comes from, and at a place drawn at random.
"""

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np

from harvester.errors import HarvesterError
from harvester.estimates.batch_means import ratio_of_sums
from harvester.running.realizations import Realizations
from harvester.running.request import good_ones, told
from harvester.running.task import Wanted
from harvester.scene.model import Scene
from harvester.studies.evaluation import Evaluation, series_of
from harvester.studies.grid import Grid

# Realizations of a place that both engines run.
PROOF_REALIZATIONS = 8
# A difference counts from so many of its standard errors and from this share on.
SIGNIFICANT_SIGMAS, SIGNIFICANT_SHARE = 3.0, 0.01


@dataclass(frozen=True)
class Proof:
    """What the circuit says of one place of a study.

    Attributes
    ----------
    place : int
        Of the point in the grid.
    highest : bool
        Whether it was chosen as its curve's highest point, and not drawn.
    difference : float
        (circuit − Monte Carlo)/Monte Carlo of the output power on the same noise; nan without.
    standard_error : float
        Of the paired difference; nan without.
    trouble : str
        What came instead of a difference.
    """

    place: int
    highest: bool
    difference: float = math.nan
    standard_error: float = math.nan
    trouble: str = ""

    @property
    def disagrees(self) -> bool:
        """Whether the difference is beyond its error and no trifle."""
        beyond = abs(self.difference) > SIGNIFICANT_SIGMAS * self.standard_error
        return bool(beyond and abs(self.difference) > SIGNIFICANT_SHARE)


def places_to_prove(
    grid: Grid, evaluations: Sequence[Evaluation], seed: int
) -> list[tuple[int, bool]]:
    """(place among the grid's points, whether it is a highest one), in the grid's order.

    Every curve's highest point, and of each load one of the others by chance.
    """
    lengths = [len(values) for values in grid.sweeps.values()]
    numbers = np.arange(len(evaluations)).reshape(len(grid.loads), *lengths)
    if grid.curve is not None:
        numbers = np.moveaxis(numbers, grid.curve + 1, -1)
    power = np.array([each.power for each in evaluations])
    random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(len(evaluations),)))
    chosen: dict[int, bool] = {}
    for of_load in numbers.reshape(len(grid.loads), -1):
        curves = of_load.reshape(-1, lengths[grid.curve] if grid.curve is not None else 1)
        known = [curve[np.isfinite(power[curve])] for curve in curves]
        best = {int(curve[np.argmax(power[curve])]) for curve in known if curve.size}
        others = [int(k) for k in of_load if np.isfinite(power[k]) and k not in best]
        chosen |= dict.fromkeys(best, True)
        if others:
            chosen[int(random.choice(others))] = False
    return sorted(chosen.items())


def proving(
    place: int, highest: bool, scene: Scene, step: str | float, versions: tuple[str, str]
) -> Generator[Wanted, list, Proof]:
    """A plan for `Runner.follow` that returns the Proof of one place.

    Parameters
    ----------
    place, highest
        As in `Proof`.
    scene : Scene
        Of the point.
    step : str or float
    versions : (str, str)
        Of Monte Carlo and of the circuit, see `Runner.version`.
    """
    cuts = [
        Realizations.of(scene, method, step, version, waveform=True)
        for method, version in zip(("monte-carlo", "circuit"), versions, strict=True)
    ]
    count = min(PROOF_REALIZATIONS, scene.run.realizations)
    tasks = [cut.tasks(0, count, scene.run.realizations) for cut in cuts]
    answers = yield Wanted([*tasks[0], *tasks[1]])
    series = []
    for found in (answers[: len(tasks[0])], answers[len(tasks[0]) :]):
        good, ended = good_ones(found)
        powers = series_of(scene, good)
        if powers is None:
            words = told(ended) if isinstance(ended, HarvesterError) else str(ended)
            return Proof(place, highest, trouble=words)
        series.append(powers)
    ours, theirs = series
    shared = min(len(ours), len(theirs))
    ratio, error = ratio_of_sums(theirs[:shared], ours[:shared])
    if error is None:
        return Proof(place, highest, ratio - 1.0, trouble="too short for an error bar")
    return Proof(place, highest, ratio - 1.0, error)
