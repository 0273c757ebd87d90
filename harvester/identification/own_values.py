"""Values that differ for one validation record, such as the force of a base tilted for it.

They are found as the windows' starts are: where the record, followed in windows by a device whose
other values are given, leaves least. The windows are short at first, and the record is tried from
several values, since a constant force has one well or the other in its favour.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from harvester.base.errors import IdentificationError
from harvester.identification.fitting import fitted_sizes
from harvester.identification.intervals import covariance
from harvester.identification.response import COARSE_STEPS, experiment
from harvester.identification.search import COARSE, HOPELESS, ON_THE_WAY, followed, short_windows
from harvester.identification.shooting import ShootingFit, placed, reach_of
from harvester.identification.unknowns import unknowns, with_values

if TYPE_CHECKING:
    from harvester.identification.fitting import Fitted
    from harvester.identification.measurement import Measurement

# First values to try besides the scene's, as shares of a change of order one.
FIRST_SHARES = (0.0, 0.1, -0.1, 0.2, -0.2)
# Two minima are the same if no value differs by more than this share of its size.
SAME = 0.02


def own_values(
    fitted: Fitted,
    measurement: Measurement,
    likely: Sequence[np.ndarray],
    reach: tuple[float, float],
    visited: tuple[float, float],
    noise: np.ndarray,
    enough: float,
) -> tuple[list[np.ndarray], np.ndarray, tuple[float, float]]:
    """Values of one record's own keys for each of the likely values of all others, and its motion.

    Parameters
    ----------
    measurement : Measurement
        A measurement with keys in `own`.
    likely : sequence of ndarray, shape (keys,)
        Likely values of the fitted keys, the best first.
    reach, visited : (float, float)
        Scaled displacements between which the mass is looked for, and between which the fitted
        records were: of mirrored motions that fit about as well, the one there is taken.
    noise : ndarray, shape (outputs,)
        Noise by which residuals are divided.
    enough : float
        A motion within what was visited that leaves no more of the first output, as a share of its
        standard deviation, is taken without a look elsewhere.

    Returns
    -------
    list of ndarray, shape (own keys,)
    ndarray, shape (own keys,)
        Standard errors that the record's own residuals give the first of them.
    (float, float)
        Scaled displacements of the record's motion.

    Raises
    ------
    IdentificationError
        No value lets the device follow the record.
    """
    problem = _problem(fitted, measurement, likely[0])
    fit = _best(problem, visited, noise)
    if fit is None or _left(problem, fit) > enough:
        other = _best(problem, reach, noise)
        if other is not None and (
            fit is None or _cost(problem, fit, noise) > HOPELESS * _cost(problem, other, noise)
        ):
            fit = other
    if fit is None:
        raise IdentificationError(
            f"{measurement.name}: no value of {', '.join(measurement.own)} follows the record: "
            "check the columns' units and signs, or give the value"
        )
    solutions = [fit.values]
    for values in likely[1:]:
        begun = ShootingFit(fit.values, fit.edges, fit.starts, fit.noise)
        near = _problem(fitted, measurement, values).minimized(begun, ON_THE_WAY, COARSE)
        solutions.append(near.values)
    errors = np.sqrt(np.maximum(np.diag(covariance(problem, fit)), 0.0))
    return solutions, errors, reach_of(problem.states(fit, 0)[:, 0])


def _problem(fitted, measurement, values):
    """The least-squares problem of the record's own values, the fitted ones being as given."""
    reference = fitted.shooting.responses
    # Likely values are of a device: the fitted records were run with them.
    scene = with_values(fitted.scene, fitted.keys, values) or fitted.scene
    sensors = {
        key: float(value)
        for key, value in zip(fitted.keys, values, strict=True)
        if key.startswith("sensor.")
    }
    seen = replace(measurement, sensors={**sensors, **measurement.sensors})
    record = experiment(scene, seen, COARSE_STEPS)
    responses = reference.replaced([record], seen.own)
    records = [other.measurement for other in reference.experiments]
    free = unknowns(record.scene, seen.own, fitted_sizes(fitted, records))
    return fitted.shooting.beside(responses, free, records=1)


def _best(shooting, reach, noise):
    """The best fit in long windows, followed from each minimum in short ones; None without any."""
    measurement = shooting.responses.experiments[0].measurement
    edges = [short_windows(measurement, 0, measurement.acceleration.size)]
    first = np.array([unknown.start for unknown in shooting.unknowns])
    minima: list[ShootingFit] = []
    for share in FIRST_SHARES:
        values = np.clip(first + share * shooting.sizes, shooting.low, shooting.high)
        begun = ShootingFit(values, edges, [], [noise])
        everywhere = np.ones(edges[0].size - 1, bool)
        begun.starts.append(placed(shooting.frozen(), 0, begun, everywhere, reach)[0])
        fit = shooting.minimized(begun, ON_THE_WAY, COARSE)
        moved = [np.abs(fit.values - minimum.values) / shooting.sizes for minimum in minima]
        if fit.grams and all(distance.max() > SAME for distance in moved):
            minima.append(fit)
    fits = [followed(shooting, minimum) for minimum in minima]
    return min(fits, key=lambda fit: _cost(shooting, fit, noise), default=None)


def _cost(shooting, fit, noise):
    """Cost of a fit by a common noise, and its reduction by the windows' starts."""
    # A fit that was followed is weighted by its own residuals.
    same = ShootingFit(fit.values, fit.edges, fit.starts, [noise])
    return shooting.cost(same) + sum(states.size for states in fit.starts)


def _left(shooting, fit):
    """Residual of the first output, as a share of its standard deviation."""
    ones = np.ones_like(fit.noise[0])
    residuals, _ = shooting.residuals(0, fit.values, fit.edges[0], fit.starts[0], ones)
    if residuals is None:
        return math.inf
    seen = shooting.seen(0, fit.edges[0])[:, 0]
    return float(np.sqrt(np.mean(residuals[:, 0] ** 2)) / np.std(seen))
