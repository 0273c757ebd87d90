"""One model fitted to measured frequency responses, every third frequency kept aside."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.errors import IdentificationError
from harvester.identification import intervals
from harvester.identification.fitted_model import Fitted
from harvester.identification.proof import ResponseStretch
from harvester.identification.search import FINE, LAST
from harvester.identification.shooting import Fit, Shooting
from harvester.identification.steady_response import SteadyExperiment, SteadyResponses
from harvester.identification.unknowns import unknowns
from harvester.prepared.prepared import prepared

if TYPE_CHECKING:
    from harvester.identification.measured_response import MeasuredResponse
    from harvester.scene.model import Scene

# One line in this many is kept aside.
KEPT_ASIDE = 3
# A fit may begin at these multiples of the scene's stiffness, damping and coupling; the best few of
# these starts are fitted.
STIFFNESSES = np.geomspace(0.2, 5.0, 65)
DAMPINGS, COUPLINGS = (0.25, 1.0, 4.0), (0.3, 1.0, 3.0)
MOST_STARTS = 4
# Noise that the first fit assumes, as a share of a response's rms.
FIRST_NOISE = 0.05
NO_STATES = np.zeros((1, 3))


def fitted_responses(
    scene: Scene,
    measurements: Sequence[MeasuredResponse],
    keys: Sequence[str],
    sizes: dict[str, float],
    warm: Fitted | None = None,
) -> Fitted:
    """Fit one model.

    Parameters
    ----------
    scene : Scene
        Scene that gives the initial values and all values that are not free.
    measurements : sequence of MeasuredResponse
    keys : sequence of str
        Keys of the free values.
    sizes : dict of str to float
        Sizes of keys whose start may be 0.
    warm : Fitted, optional
        A neighbouring model, from whose values the fit begins; else from a grid of values.

    Raises
    ------
    IdentificationError
        The scene has stoppers, or nothing fits.
    """
    if scene.stoppers:
        raise IdentificationError(
            f"{scene.name}: a frequency response cannot determine stoppers: identify them from a "
            "record in time"
        )
    aside = [np.arange(response.frequency.size) % KEPT_ASIDE == 1 for response in measurements]
    shooting = _shooting(scene, measurements, [~lines for lines in aside], keys, sizes)
    if warm:
        previous = dict(zip(warm.keys, warm.values, strict=True))
        values = np.array(
            [previous.get(unknown.key, unknown.start) for unknown in shooting.unknowns]
        )
        begun = [Fit(values, warm.fit.edges, warm.fit.starts, warm.fit.noise)]
    else:
        begun = sorted(_starts(shooting), key=shooting.cost)[:MOST_STARTS]
    fits = [shooting.minimized(start, LAST, FINE) for start in begun]
    fits = [fit for fit in fits if fit.grams]
    if not fits:
        raise IdentificationError(
            f"{scene.name}: no values of {', '.join(keys)} follow the response: check the columns' "
            "units, the load's resistance, and begin nearer (--set)"
        )
    best = min(fits, key=lambda fit: fit.cost)
    fit = shooting.minimized(shooting.reweighted(best), LAST, FINE)
    covariance = intervals.covariance(shooting, fit)
    validation = _shooting(scene, measurements, aside, keys, sizes).responses
    stretches = [stretch_of(validation, fit.values, number) for number in range(len(measurements))]
    return Fitted.concluded(scene, shooting, fit, covariance, stretches)


def _shooting(scene, measurements, lines, keys, sizes):
    """The least-squares problem of some lines of each record."""
    experiments = [
        SteadyExperiment(response.part(some), scene.replace(response.changes))
        for response, some in zip(measurements, lines, strict=True)
    ]
    responses = SteadyResponses(experiments, keys, prepared(scene).scales.displacement)
    return Shooting(responses, unknowns(scene, keys, sizes), [np.zeros(3)] * len(experiments))


def _starts(shooting):
    """Values on a grid of factors, each kind of parameter by its own."""
    first = np.array([unknown.start for unknown in shooting.unknowns])
    kinds = {
        kind: np.array([word in unknown.key for unknown in shooting.unknowns])
        for kind, word in (("spring", "restoring_force"), ("damping", "damping"))
    }
    kinds["spring"] |= np.array(
        [unknown.key.endswith("stiffness") for unknown in shooting.unknowns]
    )
    kinds["coupling"] = np.array(
        [unknown.key.endswith("coupling") for unknown in shooting.unknowns]
    )
    ranges = [
        grid if kinds[kind].any() else (1.0,)
        for kind, grid in (
            ("spring", STIFFNESSES),
            ("damping", DAMPINGS),
            ("coupling", COUPLINGS),
        )
    ]
    edges, noise = [], []
    for experiment in shooting.responses.experiments:
        outputs = list(experiment.measurement.outputs.values())
        edges.append(np.array([0, outputs[0].size]))
        rms = math.sqrt(sum(float(np.mean(values**2)) for values in outputs))
        noise.append(np.full(len(outputs), FIRST_NOISE * rms))
    for factors in product(*ranges):
        values = first.copy()
        for members, factor in zip(kinds.values(), factors, strict=True):
            values[members] *= factor
        values = np.clip(values, shooting.low, shooting.high)
        yield Fit(values, edges, [NO_STATES] * len(edges), noise)


def stretch_of(kept: SteadyResponses, values: np.ndarray, number: int) -> ResponseStretch:
    """The model's prediction of the lines that were kept aside."""
    experiment: Any = kept.experiments[number]
    measured = np.column_stack(list(experiment.measurement.outputs.values()))
    edges = np.array([0, measured.shape[0]])
    _, _, simulated = kept.states(number, values, edges, NO_STATES)
    frequency = experiment.measurement.frequency
    return ResponseStretch(
        name=experiment.measurement.name,
        outputs=tuple(experiment.measurement.outputs),
        rate=float((frequency.size - 1) / (frequency[-1] - frequency[0])),
        measured=measured,
        windowed=simulated,
        free=simulated,
        windows=1,
        resistance=None,
        frequency=frequency,
    )
