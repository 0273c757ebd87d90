"""Records in time, frequency responses and an impedance, fitted together.

Each kind is followed by its own model of the same numbers, and weighs by its own noise. The fit
begins with the values that one kind gives alone: records in time, else responses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.errors import IdentificationError
from harvester.identification import intervals
from harvester.identification.fitted_model import Fitted
from harvester.identification.fitting import lengths_of, responses_of
from harvester.identification.impedance_fit import impedance_stretch, kept_aside
from harvester.identification.measured_impedance import MeasuredImpedance
from harvester.identification.measured_response import MeasuredResponse
from harvester.identification.proof import predicted
from harvester.identification.response import FINE_STEPS, Responses
from harvester.identification.search import FINE, LAST
from harvester.identification.shooting import Fit, Shooting
from harvester.identification.steady_fit import FIRST_NOISE, NO_STATES, fitted_responses, stretch_of
from harvester.identification.steady_response import (
    ImpedanceExperiment,
    SteadyExperiment,
    SteadyResponses,
)
from harvester.identification.unknowns import unknowns

if TYPE_CHECKING:
    from harvester.identification.measurement import Measurement
    from harvester.scene.model import Scene

MASS = "oscillator.mass"
# These values are proportional to the mass if the motion stays the same.
IN_PROPORTION = (MASS, "damping", "restoring_force[", "stiffness")
# Relative noise of an impedance that the first fit assumes.
FIRST_IMPEDANCE_NOISE = 0.005
# Number of fits; each weights the residuals by the noise that the previous fit left.
WEIGHTINGS = 3


def fitted_together(
    alone: Callable[..., Fitted],
    scene: Scene,
    measurements: Sequence[Any],
    keys: Sequence[str],
    sizes: dict[str, float],
    warm: Fitted | None = None,
) -> Fitted:
    """Fit one model.

    Parameters
    ----------
    alone : callable
        `fitting.fitted`, of records of one kind.
    scene, keys, sizes
        As there.
    measurements : sequence
        Records in time first.
    warm : Fitted, optional
        A neighbouring model of the same records.

    Raises
    ------
    IdentificationError
        No values follow them all.
    """
    times = [record for record in measurements if not isinstance(record, MeasuredResponse)]
    steady = [record for record in measurements if isinstance(record, MeasuredResponse)]
    first = warm or _first(alone, scene, times, steady, keys, sizes)
    length = first.shooting.responses.length
    aside = [kept_aside(response) for response in steady]
    in_time: Responses | None = None
    if times:
        in_time = responses_of(scene, times, keys, length, FINE_STEPS)
        in_time.interpolation = first.interpolation
    records = [] if in_time is None else in_time.experiments
    free = unknowns(scene, keys, sizes)
    responses, validation = (
        _responses(scene, records, steady, lines, keys, length)
        for lines in ([~lines for lines in aside], aside)
    )
    responses.interpolation = first.interpolation
    shooting = _shooting(responses, free, first, len(times))
    fits = [
        shooting.minimized(start, LAST, FINE) for start in _starts(shooting, first, scene, times)
    ]
    fits = [fit for fit in fits if fit.grams]
    if not fits:
        raise IdentificationError(
            f"{scene.name}: no values of {', '.join(keys)} follow all records: check the columns' "
            "units, the load's resistance, and that all are of the same device"
        )
    fit = min(fits, key=lambda fit: fit.cost)
    for _ in range(WEIGHTINGS):
        fit = shooting.minimized(shooting.reweighted(fit), LAST, FINE)
    covariance = intervals.covariance(shooting, fit)
    stretches: list[Any] = []
    settled: Fit | None = None
    if in_time is not None:
        time_shooting = _shooting(in_time, free, first, len(times))
        part = replace(
            fit,
            edges=fit.edges[: len(times)],
            starts=fit.starts[: len(times)],
            noise=fit.noise[: len(times)],
        )
        ends = [
            (length, record.acceleration.size)
            for length, record in zip(lengths_of(times), times, strict=True)
        ]
        proof, settled = predicted(time_shooting, part, ends)
        stretches += proof
    for number, response in enumerate(steady, len(times)):
        of = impedance_stretch if isinstance(response, MeasuredImpedance) else stretch_of
        stretches.append(of(validation, fit.values, number))
    return Fitted.concluded(scene, shooting, fit, covariance, stretches, settled)


def _first(alone, scene, times, steady, keys, sizes):
    """The model from records of one kind alone (in time, else responses), with the scene's mass."""
    free = [key for key in keys if key != MASS]
    if times:
        return alone(scene, times, free, sizes)
    responses = [record for record in steady if not isinstance(record, MeasuredImpedance)]
    return fitted_responses(scene, responses, free, sizes)


def _responses(scene, records, steady, lines, keys, length):
    """The experiments of a fit; of responses and impedances only some lines."""
    experiments: list[Any] = list(records)
    for response, some in zip(steady, lines, strict=True):
        sort = ImpedanceExperiment if isinstance(response, MeasuredImpedance) else SteadyExperiment
        experiments.append(sort(response.part(some), scene.replace(response.changes)))
    return SteadyResponses(experiments, keys, length)


def _shooting(responses, free, first, records):
    """The least-squares problem, with the first model's sizes of the windows' states."""
    shooting = Shooting(responses, free, [np.zeros(3)] * len(responses.experiments))
    for name in ("state_sizes", "states_there"):
        sizes_of_first = getattr(first.shooting, name)[:records]
        setattr(shooting, name, [*sizes_of_first, *getattr(shooting, name)[len(sizes_of_first) :]])
    return shooting


def _starts(shooting: Shooting, first: Fitted, scene: Scene, times: list[Measurement]) -> list[Fit]:
    """Starts of the fit: the first model's values, and the same rescaled to a likely mass."""
    first_values = dict(zip(first.keys, first.values, strict=True))
    values = np.array(
        [first_values.get(unknown.key, unknown.start) for unknown in shooting.unknowns]
    )
    count = len(times)
    edges, starts = list(first.fit.edges[:count]), list(first.fit.starts[:count])
    noise = list(first.fit.noise[:count])
    for experiment in shooting.responses.experiments[count:]:
        outputs = list(experiment.measurement.outputs.values())
        edges.append(np.array([0, outputs[0].size]))
        starts.append(NO_STATES)
        if isinstance(experiment, ImpedanceExperiment):
            noise.append(np.full(len(outputs), FIRST_IMPEDANCE_NOISE))
            continue
        rms = float(np.sqrt(sum(np.mean(part**2) for part in outputs)))
        noise.append(np.full(len(outputs), FIRST_NOISE * rms))
    factors = [1.0]
    coupling = first_values.get("piezo.coupling")
    if coupling and MASS in [unknown.key for unknown in shooting.unknowns] and scene.transducer:
        # An impedance determines θ²/M; a record of voltage under a known acceleration determines θ.
        factors.append((coupling / scene.transducer.coupling) ** 2)  # type: ignore[attr-defined]
    return [
        Fit(_of_mass(shooting, values, factor, scene), edges, starts, noise) for factor in factors
    ]


def _of_mass(shooting, values, factor, scene):
    """Values of a device whose mass is so many times that of the scene, its impedance the same."""
    if factor == 1.0:
        return values
    scaled = values.copy()
    for number, unknown in enumerate(shooting.unknowns):
        if unknown.key == "piezo.coupling":
            scaled[number] = scene.transducer.coupling * factor**0.5
        elif any(word in unknown.key for word in IN_PROPORTION):
            scaled[number] *= factor
    return np.clip(scaled, shooting.low, shooting.high)
