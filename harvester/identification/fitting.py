"""One model fitted to the first part of each record, with its intervals and its prediction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from harvester.errors import IdentificationError
from harvester.identification import intervals
from harvester.identification.fitted_model import Fitted
from harvester.identification.measured_response import MeasuredResponse
from harvester.identification.origin import recentred
from harvester.identification.proof import predicted
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
    HOPELESS,
    LAST,
    ON_THE_WAY,
    followed_anew,
    opened,
    searched,
)
from harvester.identification.shooting import Fit
from harvester.identification.steady_fit import fitted_responses
from harvester.identification.unknowns import unknowns
from harvester.prepared.prepared import prepared

if TYPE_CHECKING:
    from harvester.identification.measurement import Measurement
    from harvester.scene.model import Scene

# Share of each record, from its beginning, that is fitted; the rest is kept aside.
FITTED_SHARE = 2.0 / 3.0
# With fewer samples in a period of the motion than this the base's path is a spline, not straight
# lines between samples: of 20 samples lines take 0.8 % of the amplitude, of 7 they take 6.5 %.
FEWEST_FOR_LINES = 20.0
# An interpolation is ruled out if its weighted cost is higher by this than that of the other.
RULED_OUT = 9.0


def lengths_of(measurements: Sequence[Measurement]) -> list[int]:
    """Number of samples of each record that are fitted."""
    return [int(FITTED_SHARE * record.acceleration.size) for record in measurements]


def responses_of(
    scene: Scene,
    measurements: Sequence[Measurement],
    keys: Sequence[str],
    length: float,
    per_period: int,
) -> Responses:
    """The records with the scene, ready to be simulated."""
    experiments = [
        experiment(scene, record, frequencies(record)[1], per_period) for record in measurements
    ]
    return Responses(experiments, keys, interpolations_of(measurements)[0], length)


def interpolations_of(measurements: Sequence[Measurement]) -> tuple[str, ...]:
    """Interpolations to try between samples: only the smooth one where samples are few."""
    fewest = min(record.sampling_rate / frequencies(record)[0] for record in measurements)
    return INTERPOLATIONS if fewest >= FEWEST_FOR_LINES else INTERPOLATIONS[1:]


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
        Scene that gives the initial values and all values that are not free.
    measurements : sequence of Measurement, or of MeasuredResponse
    keys : sequence of str
        Keys of the free values.
    sizes : dict of str to float
        Sizes of keys whose start may be 0.
    warm : Fitted, optional
        A neighbouring model, from whose windows the fit begins.

    Raises
    ------
    IdentificationError
        No start leads to a device that follows the records.
    """
    steady = [record for record in measurements if isinstance(record, MeasuredResponse)]
    if steady and (len(steady) < len(measurements) or _has_impedance(steady)):
        # `joint_fit` calls this function for its first fit, hence the import here.
        from harvester.identification.joint_fit import fitted_together

        return fitted_together(fitted, scene, measurements, keys, sizes, warm)
    if steady:
        return fitted_responses(scene, steady, keys, sizes, warm)
    length = warm.shooting.responses.length if warm else prepared(scene).scales.displacement
    responses, fine = (
        responses_of(scene, measurements, keys, length, steps)
        for steps in (COARSE_STEPS, FINE_STEPS)
    )
    free = unknowns(scene, keys, sizes)
    lengths = lengths_of(measurements)
    if warm:
        responses.interpolation = fine.interpolation = warm.interpolation
        problem = _warmed(responses, fine, free, warm)
    else:
        problem = searched(responses, free, lengths)
    if problem is None:
        raise IdentificationError(
            f"{scene.name}: no values of {', '.join(keys)} follow the records: check the columns' "
            "units and signs, the load's resistance, and begin nearer (--set)"
        )
    shooting, fit = problem
    if not warm:
        fit = recentred(shooting, fit, scene)
    # A neighbouring model interpolates the records as the model that it is compared with.
    fits = {responses.interpolation: fit}
    if not warm and len(interpolations_of(measurements)) > 1:
        fits |= _otherwise(shooting, fit)
    shooting.responses = fine
    for name, start in fits.items():
        fine.interpolation = name
        fits[name] = shooting.minimized(start, LAST, FINE)
    best, *others = sorted(fits, key=lambda name: _misfit(fits[name]))
    fit, fine.interpolation = fits[best], best
    values = fit.values
    covariance = intervals.covariance(shooting, fit)
    for other in (fits[name] for name in others):
        if _misfit(other) - _misfit(fit) < RULED_OUT:
            # The base's path between the samples is unknown: the difference between both fits is an
            # error.
            covariance = covariance + np.outer(other.values - values, other.values - values)
    stretches = [
        (length, record.acceleration.size)
        for length, record in zip(lengths, measurements, strict=True)
    ]
    proof, settled = predicted(shooting, fit, stretches)
    return Fitted.concluded(scene, shooting, fit, covariance, proof, settled)


def _has_impedance(steady):
    from harvester.identification.measured_impedance import MeasuredImpedance

    return any(isinstance(response, MeasuredImpedance) for response in steady)


def _otherwise(shooting, fit):
    """The fit with the other interpolation, by its name; none where no motion follows."""
    responses = shooting.responses
    interpolation = responses.interpolation
    (other,) = (name for name in INTERPOLATIONS if name != interpolation)
    begun = opened(shooting, fit)
    responses.interpolation = other
    trial = followed_anew(shooting, begun, fit.cost)
    if trial:
        # Both costs are compared with the same weights.
        trial = replace(trial, noise=fit.noise)
        trial.cost = shooting.cost(trial)
    responses.interpolation = interpolation
    return {other: trial} if trial and trial.cost < HOPELESS * fit.cost else {}


def _misfit(fit):
    """Cost of a fit plus the number of its fitted window states, to compare fits by."""
    return fit.cost + sum(states.size for states in fit.starts)


def _warmed(coarse, fine, free, warm):
    """A fit that begins at a neighbouring model's values; in that model's windows if it
    leaves only noise, else in short windows."""
    previous = dict(zip(warm.keys, warm.values, strict=True))
    free = [unknown.begun(previous.get(unknown.key, unknown.start)) for unknown in free]
    shooting = warm.shooting.beside(fine, free)
    values = np.array([unknown.start for unknown in free])
    rival, fit = warm.fit.cost, warm.fit
    if warm.leaves_noise:
        begun = Fit(values, fit.edges, fit.starts, fit.noise)
        near = shooting.minimized(begun, ON_THE_WAY, COARSE)
        if near.cost < HOPELESS * rival:
            return shooting, near
    begun = replace(opened(warm.shooting, fit), values=values)
    shooting.responses = coarse
    anew = followed_anew(shooting, begun, rival)
    return (shooting, anew) if anew else None
