"""One model fitted to records, with its intervals and its prediction of the data kept aside.

Of records in time the first part is fitted, of frequency responses and impedances two of every
three lines. Records of several kinds are fitted together: each kind is followed by its own model
of the same numbers, and weighs by its own noise. Such a fit begins with the values that one kind
gives alone: records in time, else responses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.errors import IdentificationError
from harvester.excitation.recorded import RecordedMotion
from harvester.identification import intervals
from harvester.identification.identifiability import undetermined
from harvester.identification.measured_response import MeasuredImpedance, MeasuredResponse
from harvester.identification.measurement import frequencies
from harvester.identification.response import (
    COARSE_STEPS,
    FINE_STEPS,
    INTERPOLATIONS,
    NO_STATES,
    Responses,
    SteadyExperiment,
    SteadyResponses,
    experiment,
)
from harvester.identification.search import (
    COARSE,
    FINE,
    FIRST_NOISE,
    HOPELESS,
    LAST,
    ON_THE_WAY,
    followed_anew,
    opened,
    searched,
)
from harvester.identification.shooting import Shooting, ShootingFit
from harvester.identification.unknowns import (
    ORIGIN,
    first_sizes,
    sizes_of,
    unknowns,
    with_values,
)
from harvester.identification.validation_record import (
    ValidationRecord,
    predicted,
    predicted_lines,
)
from harvester.scene.prepared import prepared

if TYPE_CHECKING:
    from harvester.identification.measurement import Measurement
    from harvester.scene.model import Scene

# Two errors that differ by less than this share count as equal.
NOTED = 0.02


@dataclass(frozen=True)
class Fitted:
    """A model with the values that fit.

    Attributes
    ----------
    scene : Scene
        The scene with the fitted values.
    values : ndarray, shape (unknowns,)
    covariance : ndarray, shape (unknowns, unknowns)
    records : list of ValidationRecord
        The kept-aside part of each record.
    interpolation : str
        Interpolation of the acceleration between its samples.
    settled : ShootingFit or None
        Windows of the parts kept aside, of records in time.
    """

    scene: Scene
    values: np.ndarray
    covariance: np.ndarray
    undetermined: list
    records: list[ValidationRecord]
    interpolation: str
    shooting: Shooting
    fit: ShootingFit
    settled: ShootingFit | None = None

    @classmethod
    def concluded(
        cls,
        scene: Scene,
        shooting: Shooting,
        fit: ShootingFit,
        covariance: np.ndarray,
        records: list[ValidationRecord],
        settled: ShootingFit | None = None,
    ) -> Fitted:
        """The model at the end of a fit; `scene` is the scene that the fit began with.

        Raises
        ------
        IdentificationError
            No device has these values.
        """
        keys = [unknown.key for unknown in shooting.unknowns]
        fitted_scene = with_values(scene, keys, fit.values)
        if fitted_scene is None:
            raise IdentificationError(
                f"{scene.name}: the scene refuses the best-fitting values: check the columns' "
                "units and signs, free fewer (--free), or begin nearer (--set)"
            )
        path = shooting.responses.interpolation
        base = fitted_scene.excitation
        if isinstance(base, RecordedMotion) and base.knot_spacing is None:
            # Later simulations under this record then interpolate it as the fit did.
            fitted_scene = fitted_scene.replace({"excitation.interpolation": path})
        unclear = undetermined(shooting.unknowns, fit.values, covariance)
        return cls(
            fitted_scene, fit.values, covariance, unclear, records, path, shooting, fit, settled
        )

    def with_covariance(self, covariance: np.ndarray) -> Fitted:
        """The same model with another covariance, which gives wider intervals."""
        unclear = undetermined(self.shooting.unknowns, self.values, covariance)
        return replace(self, covariance=covariance, undetermined=unclear)

    @property
    def leaves_noise(self) -> bool:
        """Whether the residuals of the data kept aside are only noise, so that no model can
        be better."""
        return all(part.nrmse() <= (1.0 + NOTED) * part.noise() for part in self.records)

    @property
    def keys(self) -> list[str]:
        """Keys of the values."""
        return self.shooting.responses.keys

    @property
    def standard_errors(self) -> np.ndarray:
        """Standard errors of the values."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def relative_errors(self) -> dict[str, float]:
        """Standard error of each value as a share of it, by its key."""
        shares = self.standard_errors / np.maximum(np.abs(self.values), 1e-300)
        return dict(zip(self.keys, map(float, shares), strict=True))

    @property
    def nrmse(self) -> float:
        """Normalized rms error of the first output over all stretches kept aside."""
        return float(np.sqrt(np.mean([part.nrmse() ** 2 for part in self.records])))


def fitted_sizes(base: Fitted, measurements: Sequence[Measurement]) -> dict[str, float]:
    """Sizes from the fitted motion; for a frequency response those of `first_sizes`."""
    if isinstance(measurements[0], MeasuredResponse):
        return first_sizes(base.scene, measurements)
    reach, speed = 0.0, 0.0
    fit = base.fit
    for number in range(len(fit.edges)):
        states = base.shooting.states(fit, number)
        reach = max(reach, float(np.abs(states[:, 0]).max()))
        speed = max(speed, float(np.std(states[:, 1])))
    length = base.shooting.responses.length
    return sizes_of(base.scene, measurements, reach * length, speed * length)


# Share of each record, from its beginning, that is fitted; the rest is kept aside.
FITTED_SHARE = 2.0 / 3.0
# With fewer samples in a period of the motion than this the base's path is a spline, not straight
# lines between samples: of 20 samples lines take 0.8 % of the amplitude, of 7 they take 6.5 %.
FEWEST_FOR_LINES = 20.0
# An interpolation is ruled out if its weighted cost is higher by this than that of the other.
RULED_OUT = 9.0
# A fit to responses may begin at these multiples of the scene's stiffness, damping and coupling;
# the best few of these starts are fitted.
STIFFNESSES = np.geomspace(0.2, 5.0, 65)
DAMPINGS, COUPLINGS = (0.25, 1.0, 4.0), (0.3, 1.0, 3.0)
MOST_STARTS = 4
MASS = "oscillator.mass"
# These values are proportional to the mass if the motion stays the same.
IN_PROPORTION = (MASS, "damping", "restoring_force[", "stiffness")
# Relative noise of an impedance that the first fit assumes.
FIRST_IMPEDANCE_NOISE = 0.005
# Number of fits to records of several kinds; each weights the residuals by the noise that the
# previous fit left.
WEIGHTINGS = 3
FORCE = "oscillator.restoring_force[{}]"
ORIGIN_ITERATIONS = 6


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
    """The records as experiments with the scene."""
    experiments = [experiment(scene, record, per_period) for record in measurements]
    return Responses(experiments, keys, length, interpolations_of(measurements)[0])


def interpolations_of(measurements: Sequence[Measurement]) -> tuple[str, ...]:
    """Interpolations to try between samples: only the smooth one where samples are few."""
    fewest = min(record.sampling_rate / frequencies(record)[0] for record in measurements)
    return INTERPOLATIONS if fewest >= FEWEST_FOR_LINES else INTERPOLATIONS[1:]


def fitted(
    scene: Scene,
    measurements: Sequence[Measurement | MeasuredResponse],
    keys: Sequence[str],
    sizes: dict[str, float],
    warm: Fitted | None = None,
) -> Fitted:
    """Fit one model.

    Parameters
    ----------
    scene : Scene
        Scene that gives the initial values and all values that are not free.
    measurements : sequence of Measurement or MeasuredResponse
        Records in time first.
    keys : sequence of str
        Keys of the free values.
    sizes : dict of str to float
        Sizes of keys whose start may be 0.
    warm : Fitted, optional
        A neighbouring model of the same records, from whose values and windows the fit begins.

    Raises
    ------
    IdentificationError
        No start leads to a device that follows the records.
    """
    steady = [record for record in measurements if isinstance(record, MeasuredResponse)]
    times = [record for record in measurements if not isinstance(record, MeasuredResponse)]
    if steady:
        return _fitted_lines(scene, times, steady, keys, sizes, warm)
    length = warm.shooting.responses.length if warm else prepared(scene).scales.displacement
    responses, fine = (
        responses_of(scene, times, keys, length, steps) for steps in (COARSE_STEPS, FINE_STEPS)
    )
    free = unknowns(scene, keys, sizes)
    lengths = lengths_of(times)
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
        fit = _recentred(shooting, fit, scene)
    # A neighbouring model interpolates the records as the model that it is compared with.
    fits = {responses.interpolation: fit}
    if not warm and len(interpolations_of(times)) > 1:
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
    proof, settled = predicted(shooting, fit, _ends(times))
    return Fitted.concluded(scene, shooting, fit, covariance, proof, settled)


def _ends(times):
    """First and last sample of each record's part that is kept aside."""
    return [
        (length, record.acceleration.size)
        for length, record in zip(lengths_of(times), times, strict=True)
    ]


def _fitted_lines(scene, times, steady, keys, sizes, warm):
    """Fit one model to responses and impedances, and to records in time if there are any."""
    joint = bool(times) or any(isinstance(record, MeasuredImpedance) for record in steady)
    if scene.stoppers and not joint:
        raise IdentificationError(
            f"{scene.name}: a frequency response cannot determine stoppers: identify them from a "
            "record in time"
        )
    first, count = warm, len(times)
    if joint and first is None:
        # The first model, of records of one kind, has the scene's mass.
        alone = times or [r for r in steady if not isinstance(r, MeasuredImpedance)]
        first = fitted(scene, alone, [key for key in keys if key != MASS], sizes)
    length = first.shooting.responses.length if joint else prepared(scene).scales.displacement
    in_time = responses_of(scene, times, keys, length, FINE_STEPS) if times else None
    free = unknowns(scene, keys, sizes)
    responses, validation = (
        _line_responses(scene, in_time, steady, keys, length, aside) for aside in (False, True)
    )
    shooting = Shooting(responses, free, [np.zeros(3)] * len(responses.experiments))
    if first:
        responses.interpolation = first.interpolation
        shooting.state_sizes[:count] = first.shooting.state_sizes[:count]
        shooting.states_there[:count] = first.shooting.states_there[:count]
        starts = _near_starts(shooting, first, scene, count, joint)
    else:
        starts = sorted(_grid_starts(shooting), key=shooting.cost)[:MOST_STARTS]
    fits = [shooting.minimized(start, LAST, FINE) for start in starts]
    fits = [fit for fit in fits if fit.grams]
    if not fits:
        advice = "that all are of the same device" if joint else "begin nearer (--set)"
        raise IdentificationError(
            f"{scene.name}: no values of {', '.join(keys)} follow "
            f"{'all records' if joint else 'the response'}: check the columns' units, the load's "
            f"resistance, and {advice}"
        )
    fit = min(fits, key=lambda fit: fit.cost)
    for _ in range(WEIGHTINGS if joint else 1):
        fit = shooting.minimized(shooting.reweighted(fit), LAST, FINE)
    covariance = intervals.covariance(shooting, fit)
    stretches: list[Any] = []
    settled: ShootingFit | None = None
    if in_time:
        in_time.interpolation = first.interpolation
        time_fit = ShootingFit(fit.values, fit.edges[:count], fit.starts[:count], fit.noise[:count])
        time_shooting = shooting.beside(in_time, free, count)
        stretches, settled = predicted(time_shooting, time_fit, _ends(times))
    lines = range(count, count + len(steady))
    stretches += [predicted_lines(validation, fit.values, number) for number in lines]
    return Fitted.concluded(scene, shooting, fit, covariance, stretches, settled)


def _line_responses(scene, in_time, steady, keys, length, aside):
    """Responses of the records and of each steady record's lines: fitted ones, or those aside."""
    experiments = [
        SteadyExperiment(record.part(record.aside == aside), scene.replace(record.changes))
        for record in steady
    ]
    return SteadyResponses([*(in_time.experiments if in_time else ()), *experiments], keys, length)


def _line_windows(experiments):
    """Edges, starts and first noise of responses and impedances: one window without states each."""
    edges, noise = [], []
    for sweep in experiments:
        outputs = list(sweep.measurement.outputs.values())
        edges.append(np.array([0, outputs[0].size]))
        level = FIRST_IMPEDANCE_NOISE
        if not isinstance(sweep.measurement, MeasuredImpedance):
            level = FIRST_NOISE * float(np.sqrt(sum(np.mean(values**2) for values in outputs)))
        noise.append(np.full(len(outputs), level))
    return edges, [NO_STATES] * len(edges), noise


def _near_starts(shooting, first, scene, count, joint):
    """Starts at a neighbouring model's values, and at the same rescaled to a likely mass."""
    previous = dict(zip(first.keys, first.values, strict=True))
    values = np.array([previous.get(unknown.key, unknown.start) for unknown in shooting.unknowns])
    old = first.fit.edges, first.fit.starts, first.fit.noise
    if not joint:
        return [ShootingFit(values, *old)]
    # Windows of records in time are taken over.
    lines = _line_windows(shooting.responses.experiments[count:])
    edges, starts, noise = ([*a[:count], *b] for a, b in zip(old, lines, strict=True))
    fits = [ShootingFit(values, edges, starts, noise)]
    coupling = previous.get("piezo.coupling")
    if coupling and MASS in shooting.responses.keys and scene.transducer:
        # An impedance determines θ²/M; a record of voltage under a known acceleration determines θ.
        factor = (coupling / scene.transducer.coupling) ** 2
        fits.append(ShootingFit(_of_mass(shooting, values, factor, scene), edges, starts, noise))
    return fits


def _of_mass(shooting, values, factor, scene):
    """Values of a device with the scene's mass times a factor and the scene's impedance."""
    if factor == 1.0:
        return values
    scaled = values.copy()
    for number, unknown in enumerate(shooting.unknowns):
        if unknown.key == "piezo.coupling":
            scaled[number] = scene.transducer.coupling * factor**0.5
        elif any(word in unknown.key for word in IN_PROPORTION):
            scaled[number] *= factor
    return np.clip(scaled, shooting.low, shooting.high)


def _grid_starts(shooting):
    """Values on a grid of factors, each kind of parameter by its own."""
    keys = shooting.responses.keys
    first = np.array([unknown.start for unknown in shooting.unknowns])
    kinds = (
        (["restoring_force" in key or key.endswith("stiffness") for key in keys], STIFFNESSES),
        (["damping" in key for key in keys], DAMPINGS),
        ([key.endswith("coupling") for key in keys], COUPLINGS),
    )
    grids = [factors if any(members) else (1.0,) for members, factors in kinds]
    windows = _line_windows(shooting.responses.experiments)
    for factors in product(*grids):
        values = first.copy()
        for (members, _), factor in zip(kinds, factors, strict=True):
            values[members] *= factor
        yield ShootingFit(np.clip(values, shooting.low, shooting.high), *windows)


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
        begun = ShootingFit(values, fit.edges, fit.starts, fit.noise)
        near = shooting.minimized(begun, ON_THE_WAY, COARSE)
        if near.cost < HOPELESS * rival:
            return shooting, near
    begun = replace(opened(warm.shooting, fit), values=values)
    shooting.responses = coarse
    anew = followed_anew(shooting, begun, rival)
    return (shooting, anew) if anew else None


def _recentred(shooting, fit, scene):
    """The fit with x = 0 moved to the equilibrium that the scene has there.

    A record of the voltage alone does not show which equilibrium the motion is about. With the
    constant force unchanged, F(x − d) is the same device for every d at which its constant force
    is that; of these the one nearest to the scene's own spring is taken.
    """
    responses = shooting.responses
    keys, original = responses.keys, scene.oscillator.restoring_force
    outputs = [experiment.measurement.outputs for experiment in responses.experiments]
    if original is None or any(FORCE.format(n) not in keys for n in range(1, len(original))):
        return fit
    if scene.stoppers or ORIGIN in keys or any("displacement" in o for o in outputs):
        return fit
    force = np.array(
        [original[0], *(fit.values[keys.index(FORCE.format(n))] for n in range(1, len(original)))]
    )
    reach = responses.length * max(float(np.abs(states[:, 0]).max()) for states in fit.starts)
    shifts = [
        float(root.real)
        for root in np.polynomial.Polynomial([0.0, *force[1:]]).roots()
        if abs(root.imag) < 1e-9 * reach
    ]
    powers = reach ** np.arange(1, len(original))
    shifted = [(shift, _shifted(force, shift)) for shift in shifts]
    shift, moved = min(
        shifted, key=lambda pair: float(np.sum(((pair[1][1:] - original[1:]) * powers) ** 2))
    )
    if abs(shift) < 1e-6 * reach:
        return fit
    values = fit.values.copy()
    for n in range(1, len(original)):
        values[keys.index(FORCE.format(n))] = moved[n]
    starts = [states - [shift / responses.length, 0.0, 0.0] for states in fit.starts]
    trial = shooting.minimized(replace(fit, values=values, starts=starts), ORIGIN_ITERATIONS, 1e-9)
    return trial if trial.grams and trial.cost < 1.01 * fit.cost else fit


def _shifted(force, distance):
    """Coefficients of F(x + distance)."""
    moved = np.polynomial.Polynomial(force)(np.polynomial.Polynomial([distance, 1.0]))
    return np.append(moved.coef, np.zeros(len(force)))[: len(force)]
