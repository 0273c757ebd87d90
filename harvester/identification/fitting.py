"""One model fitted to the first part of each record, with its intervals and its prediction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from harvester.errors import IdentificationError
from harvester.identification import intervals
from harvester.identification.origin import recentred
from harvester.identification.proof import Stretch, predicted
from harvester.identification.reconstruction import frequencies
from harvester.identification.response import (
    COARSE_STEPS,
    FINE_STEPS,
    INTERPOLATIONS,
    Responses,
    experiment,
)
from harvester.identification.search import (
    COARSE,
    FINE,
    ON_THE_WAY,
    followed,
    searched,
    short_windows,
)
from harvester.identification.shooting import Fit, Shooting
from harvester.identification.unknowns import Unknown, unknowns, with_values
from harvester.scene.units import scale

if TYPE_CHECKING:
    from harvester.identification.measurement import Measurement
    from harvester.scene.model import Scene

# Of each record, from its beginning.
FITTED_SHARE = 2.0 / 3.0
# Weighted cost by which one interpolation must fit better before the other is ruled out.
RULED_OUT = 9.0


@dataclass(frozen=True)
class Fitted:
    """A model with the values that fit.

    Attributes
    ----------
    scene : Scene
        With them.
    unknowns : list of Unknown
    values : ndarray, shape (unknowns,)
    covariance : ndarray, shape (unknowns, unknowns)
    undetermined : list of harvester.identification.intervals.Undetermined
    stretches : list of Stretch
        The kept-aside part of each record.
    interpolation : str
        Of the acceleration between its samples.
    shooting : Shooting
    fit : Fit
    """

    scene: Scene
    unknowns: list[Unknown]
    values: np.ndarray
    covariance: np.ndarray
    undetermined: list
    stretches: list[Stretch]
    interpolation: str
    shooting: Shooting
    fit: Fit

    @property
    def keys(self) -> list[str]:
        """Of the values."""
        return [each.key for each in self.unknowns]

    @property
    def standard_errors(self) -> np.ndarray:
        """Of the values."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def nrmse(self) -> float:
        """Of the first output over all stretches kept aside."""
        return float(np.sqrt(np.mean([each.nrmse() ** 2 for each in self.stretches])))


def lengths_of(measurements: Sequence[Measurement]) -> list[int]:
    """Samples of each record that are fitted to."""
    return [int(FITTED_SHARE * each.acceleration.size) for each in measurements]


def responses_of(
    scene: Scene,
    measurements: Sequence[Measurement],
    keys: Sequence[str],
    length: float,
    per_period: int,
) -> Responses:
    """The records with the scene, ready to be simulated."""
    experiments = [
        experiment(scene, each, frequencies(each)[1], per_period) for each in measurements
    ]
    return Responses(experiments, keys, INTERPOLATIONS[0], length)


def fitted(
    scene: Scene,
    measurements: Sequence[Measurement],
    keys: Sequence[str],
    sizes: dict[str, float],
    warm: Fitted | None = None,
) -> Fitted:
    """Fit one model.

    Parameters
    ----------
    scene : Scene
        Where the fit begins, and all that is not free.
    measurements : sequence of Measurement
    keys : sequence of str
        What is free.
    sizes : dict of str to float
        Of keys whose start may be 0.
    warm : Fitted, optional
        A neighbouring model, from whose windows the fit begins.

    Raises
    ------
    IdentificationError
        No start leads to a device that follows the records.
    """
    length = warm.shooting.responses.length if warm else scale(scene)[1].displacement
    responses = responses_of(scene, measurements, keys, length, COARSE_STEPS)
    free = unknowns(scene, keys, sizes)
    lengths = lengths_of(measurements)
    found = _warmed(responses, free, warm) if warm else searched(responses, free, lengths)
    if found is None or not found[1].grams:
        raise IdentificationError(
            f"{scene.name}: no values of {', '.join(keys)} follow the records: check the columns' "
            "units and signs, the load's resistance, and begin nearer (--set)"
        )
    shooting, fit = found
    if not warm:
        fit = recentred(shooting, fit, scene)
    interpolation = responses.interpolation
    responses = responses_of(scene, measurements, keys, length, FINE_STEPS)
    responses.interpolation = interpolation
    shooting.responses = responses
    fit = shooting.minimized(fit, ON_THE_WAY, FINE)
    fit, other = _interpolated(shooting, fit)
    values = fit.values
    covariance = intervals.covariance(shooting, fit)
    if other.cost - fit.cost < RULED_OUT:
        # Nobody knows how the base moved between the samples.
        covariance = covariance + np.outer(other.values - values, other.values - values)
    unclear = intervals.undetermined(list(keys), values, shooting.sizes, covariance)
    made = with_values(scene, keys, values)
    if made is None:
        raise IdentificationError(f"{scene.name}: what fits best is no device")
    stretches = [
        (length, each.acceleration.size) for length, each in zip(lengths, measurements, strict=True)
    ]
    proof = predicted(responses, shooting, fit, stretches)
    return Fitted(
        made, free, values, covariance, unclear, proof, responses.interpolation, shooting, fit
    )


def _interpolated(shooting, fit):
    """The fit with the interpolation that fits better, and that with the other."""
    responses = shooting.responses
    own, other = INTERPOLATIONS
    if responses.interpolation != own:
        own, other = other, own
    responses.interpolation = other
    trial = Fit(fit.values, fit.edges, [each.copy() for each in fit.starts], fit.noise)
    trial = shooting.minimized(trial, ON_THE_WAY, FINE)
    if trial.cost < fit.cost:
        return trial, fit
    responses.interpolation = own
    return fit, trial


def _warmed(responses, free, warm):
    """The fit from a neighbouring model's."""
    known = dict(zip(warm.keys, warm.values, strict=True))
    free = [each.begun(known.get(each.key, each.start)) for each in free]
    responses.interpolation = warm.interpolation
    shooting = Shooting(responses, free, [])
    shooting.state_sizes = warm.shooting.state_sizes
    shooting.states_there = warm.shooting.states_there
    values = np.array([each.start for each in free])
    # Short windows, on the neighbour's own motion.
    edges, starts = [], []
    for number, old in enumerate(warm.fit.edges):
        states, _, _ = warm.shooting.responses.states(
            number, warm.values, old, warm.fit.starts[number]
        )
        cut = short_windows(responses.experiments[number].measurement, old[0], old[-1])
        edges.append(cut)
        starts.append(states[cut[:-1] - old[0]])
    fit = shooting.minimized(Fit(values, edges, starts, warm.fit.noise), ON_THE_WAY, COARSE)
    if not fit.grams:
        return None
    longest = [int(each[-1] - each[0]) for each in edges]
    return shooting, followed(shooting, fit, longest)
