"""Fit one model to records, with intervals and a prediction of validation data.

The fit uses the first two thirds of time records, and two of every three lines of frequency
responses and impedances. Records of several kinds are fitted jointly: each kind has its own model
with the same numbers, and is weighted by its own noise. Such a fit starts from the values of one
kind alone: time records, else responses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.errors import IdentificationError
from harvester.excitation.recorded import RecordedMotion
from harvester.identification import intervals
from harvester.identification.intervals import Undetermined, undetermined, units_of
from harvester.identification.linear_start import shifted
from harvester.identification.measured_response import MeasuredImpedance, MeasuredResponse
from harvester.identification.response import COARSE_STEPS, INTERPOLATIONS, NO_STATES, experiment
from harvester.identification.search import (
    COARSE,
    FINE,
    HOPELESS,
    LAST,
    ON_THE_WAY,
    followed,
    in_short_windows,
    restarted,
    searched,
    short_windows,
    split_windows,
)
from harvester.identification.shooting import Shooting, ShootingFit
from harvester.identification.unknowns import (
    DRAG,
    LITTLE,
    MASS,
    ORIGIN,
    SPRING,
    as_coefficients,
    first_sizes,
    power_of,
    sizes_of,
    spring_coefficients,
    unknowns,
    with_values,
)
from harvester.identification.validation_record import ValidationRecord, predicted_lines, validated
from harvester.scene.units import setting

if TYPE_CHECKING:
    from harvester.identification.measurement import Measurement
    from harvester.scene.model import Scene

# Two errors whose relative difference is smaller than this count as equal.
NOTED = 0.02


@dataclass(frozen=True)
class Fitted:
    """A model with the fitted values.

    Attributes
    ----------
    scene : Scene
        The scene with the fitted values.
    shooting : Shooting
        The least-squares problem.
    fit : ShootingFit
        Its solution.
    covariance : ndarray, shape (unknowns, unknowns)
    records : list of ValidationRecord
        The validation part of each record.
    settled : ShootingFit or None
        Windows of the validation parts of time records.
    """

    scene: Scene
    shooting: Shooting
    fit: ShootingFit
    covariance: np.ndarray
    records: list[ValidationRecord]
    settled: ShootingFit | None = None

    @property
    def values(self) -> np.ndarray:
        """The values, shape (unknowns,)."""
        return self.fit.values

    @property
    def interpolation(self) -> str:
        """Interpolation of the acceleration between its samples."""
        return self.shooting.interpolation

    @cached_property
    def undetermined(self) -> list[Undetermined]:
        """Combinations of values that the records do not determine."""
        return undetermined(self.shooting.unknowns, self.values, self.covariance)

    @property
    def undetermined_keys(self) -> set[str]:
        """Keys of values that the records do not determine."""
        return {key for direction in self.undetermined for key in direction.keys}

    @property
    def explains(self) -> bool:
        """Whether the fit's residuals are only the sensors' noise, for every record."""
        return all(record.is_explained for record in self.records)

    @property
    def follows(self) -> bool:
        """Whether the windows of time records are on average at least as long as the first ones.

        A wrong model leaves large residuals, so that its windows are repeatedly shortened.
        """
        edges = self.fit.edges[: len(self.settled.edges)] if self.settled else []
        experiments = self.shooting.experiments
        first = [
            short_windows(experiment.measurement, cut[0], cut[-1])
            for experiment, cut in zip(experiments, edges, strict=False)
        ]
        return sum(cut.size for cut in edges) <= sum(cut.size for cut in first)

    @property
    def keys(self) -> list[str]:
        """Keys of the values."""
        return self.shooting.keys

    @property
    def standard_errors(self) -> np.ndarray:
        """Standard errors of the values."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def relative_errors(self) -> dict[str, float]:
        """Relative standard error of each value by key, relative to `units_of`."""
        shares = self.standard_errors / units_of(self.shooting.unknowns, self.values)
        return self.shooting.known(shares)

    @property
    def nrmse(self) -> float:
        """Normalized rms error of the first output over all validation data."""
        return float(np.sqrt(np.mean([part.nrmse() ** 2 for part in self.records])))

    @cached_property
    def sizes(self) -> dict[str, float]:
        """Sizes of unknowns from the fitted motion; for a response those of `first_sizes`."""
        length = self.shooting.length
        measurements = [experiment.measurement for experiment in self.shooting.experiments]
        if isinstance(measurements[0], MeasuredResponse):
            return first_sizes(self.scene, measurements)
        paths = [self.shooting.states(self.fit, n) for n in range(len(measurements))]
        reach = max(float(np.abs(path[:, 0]).max()) for path in paths) * length
        speed = max(float(np.std(path[:, 1])) for path in paths) * length
        return sizes_of(self.scene, measurements, reach, speed)

    def extended(self, keys: Sequence[str]) -> tuple[Shooting, ShootingFit, Scene]:
        """The fit's problem with further unknowns that have no effect initially, and its scene."""
        scene, free, experiments = self.scene, self.keys, self.shooting.experiments
        if DRAG in keys:
            # The scene omits a drag of 0, so it gets a small value.
            scene = scene.replace({DRAG: LITTLE * self.sizes[DRAG]})
        if powers := [power_of(key) for key in keys if power_of(key)]:
            force = spring_coefficients(scene)
            spring = {SPRING: [*force, *[0.0] * (max(powers) + 1 - len(force))]}
            scene, free = scene.replace(spring), as_coefficients(free)
            experiments = [
                replace(experiment, scene=experiment.scene.replace(spring))
                for experiment in experiments
            ]
        old = zip(unknowns(scene, free, self.sizes), self.values, strict=True)
        # The added values start near 0, so their sizes are those of the motion.
        added = [
            replace(unknown, size=self.sizes.get(unknown.key, unknown.size))
            for unknown in unknowns(scene, keys, self.sizes)
        ]
        every = [*(unknown.begun(value) for unknown, value in old), *added]
        problem = replace(self.shooting, experiments=experiments, unknowns=every)
        return problem, replace(self.fit, values=problem.first), scene


# Share of each record, from its beginning, that is fitted; the rest is validation data.
FITTED_SHARE = 2.0 / 3.0
# With fewer samples per period of the motion, the base's path is a spline instead of linear
# interpolation, which loses 0.8 % of the amplitude at 20 samples and 6.5 % at 7.
FEWEST_FOR_LINES = 20.0
# An interpolation is excluded if its weighted cost exceeds the other's by this amount.
RULED_OUT = 9.0
# A fit to responses may start at these multiples of the scene's stiffness, damping and coupling;
# the best few of these starts are fitted.
GRID: Any = (
    (("restoring_force", "stiffness"), np.geomspace(0.2, 5.0, 65)),
    (("damping",), (0.25, 1.0, 4.0)),
    (("coupling",), (0.3, 1.0, 3.0)),
)
MOST_STARTS = 4
# These values are proportional to the mass if the motion is unchanged.
IN_PROPORTION = (MASS, "damping", "restoring_force[", "stiffness")
# Number of fits to records of several kinds; each weights the residuals by the noise level of the
# previous fit.
WEIGHTINGS = 3
ORIGIN_ITERATIONS = 6


def _fitted_samples(record):
    """Number of fitted samples of a record."""
    return int(FITTED_SHARE * record.acceleration.size)


def _interpolations(measurements):
    """Interpolations to try between samples: only the smooth one if there are few samples."""
    rates = [
        record.sampling_rate / record.frequencies[0]
        for record in measurements
        if not isinstance(record, MeasuredResponse)
    ]
    is_sparse = min(rates, default=FEWEST_FOR_LINES) < FEWEST_FOR_LINES
    return INTERPOLATIONS[1:] if is_sparse else INTERPOLATIONS


def fitted(
    scene: Scene,
    measurements: Sequence[Measurement | MeasuredResponse],
    keys: Sequence[str],
    sizes: dict[str, float] | None = None,
    warm: Fitted | None = None,
    follow: Callable[[float], object] = lambda share: None,
) -> Fitted:
    """Fit one model.

    Parameters
    ----------
    scene : Scene
        Scene with the initial values and all values that are not free.
    measurements : sequence of Measurement or MeasuredResponse
        Time records first, then responses and impedances.
    keys : sequence of str
        Keys of the free values.
    sizes : dict of str to float, optional
        Sizes of keys whose initial values may be 0; by default those of `first_sizes`.
    warm : Fitted, optional
        A related model of the same records, from whose values and windows the fit starts.
    follow : callable, optional
        Function of the completed share.

    Raises
    ------
    IdentificationError
        No start leads to a device that follows the records.
    """
    lines = [record for record in measurements if isinstance(record, MeasuredResponse)]
    times = [record for record in measurements if not isinstance(record, MeasuredResponse)]
    swept = [record for record in lines if not isinstance(record, MeasuredImpedance)]
    joint = bool(lines) and (bool(times) or len(swept) < len(lines))
    if scene.stoppers and not times and not joint:
        raise IdentificationError(
            f"{scene.name}: a frequency response cannot determine stoppers: identify them from a "
            "record in time"
        )
    first = warm
    if first is None and lines and (alone := times or swept * joint):
        # The first model, for records of one kind, has the scene's mass.
        first = fitted(scene, alone, [key for key in keys if key != MASS], sizes, None, follow)
    length = first.shooting.length if first else setting(scene).length
    parts: list[Any] = [*times, *(record.part(~record.aside) for record in lines)]
    free = unknowns(scene, keys, sizes or first_sizes(scene, measurements))
    experiments = [experiment(scene, record) for record in parts]
    stateless = [np.zeros(3)] * len(parts)
    problem = Shooting(experiments, free, length, _interpolations(parts)[0], stateless)
    if not lines:
        starts = _in_time(problem, scene, warm, follow)
    else:
        starts = _of_lines(problem, first, scene, len(times), joint)
        if times and not warm:
            # The first model, whose mass may be wrong, may have preferred another interpolation.
            starts = [
                (replace(shooting, interpolation=path), start)
                for path in _interpolations(times)
                for shooting, start in starts
            ]
    for weighting in range(1 + WEIGHTINGS * bool(lines)):
        fits = []
        for shooting, start in starts:
            fit = shooting.minimized(start, LAST, FINE)
            # Without noise in the records, a repeated fit may not improve: the last one is kept.
            if fit.grams or weighting:
                fits.append((shooting, fit if fit.grams else start))
        if not fits:
            raise IdentificationError(
                f"{scene.name}: with no values of {', '.join(keys)} does the model reproduce the "
                "records: check the units and signs of the columns, the load's resistance, and "
                "that all records come from the same device, or start from better estimates (--set "
                "KEY=VALUE)"
            )
        shooting, fit = min(fits, key=lambda pair: _misfit(pair[1]))
        # Fits are compared with the same noise level, from the residuals of the best fit.
        noise = shooting.reweighted(fit).noise
        others = [pair for pair in fits if pair[0].interpolation != shooting.interpolation]
        starts = [
            (other, replace(trial, noise=noise)) for other, trial in [(shooting, fit), *others]
        ]
    # The base's path between the samples is unknown: if another interpolation fits equally well,
    # the difference between the fits is an error.
    alternatives = [
        trial.values - fit.values
        for _, trial in others
        if _misfit(trial) - _misfit(fit) < RULED_OUT
    ]
    covariance = sum((np.outer(d, d) for d in alternatives), intervals.covariance(shooting, fit))
    aside = [experiment(scene, record.part(record.aside)) for record in lines]
    in_time = shooting.experiments[: len(times)]
    held_out = replace(shooting, experiments=[*in_time, *aside], fixed=True)
    spans = [(_fitted_samples(record), record.acceleration.size) for record in times]
    settled: Any = in_short_windows(held_out, fit, spans) if times else None
    if settled and held_out.linearized(settled):
        settled = followed(held_out, settled)
    records: list[Any] = [validated(held_out, settled, number) for number in range(len(times))]
    records += [predicted_lines(held_out, fit.values, len(times) + n) for n in range(len(lines))]
    return Fitted(_with_fit(scene, shooting, fit), shooting, fit, covariance, records, settled)


def _with_fit(scene, shooting, fit):
    """Set a fit's values in the scene; raise IdentificationError if they are invalid."""
    fitted_scene = with_values(scene, shooting.known(fit.values))
    if fitted_scene is None:
        raise IdentificationError(
            f"{scene.name}: the best-fitting values are invalid in the scene: check the columns' "
            "units and signs, free fewer (--free), or start from closer values (--set)"
        )
    base = fitted_scene.excitation
    if isinstance(base, RecordedMotion) and base.knot_spacing is None:
        # Later simulations with this record interpolate it as the fit does.
        fitted_scene = fitted_scene.replace({"excitation.interpolation": shooting.interpolation})
    return fitted_scene


def _in_time(problem, scene, warm, follow):
    """Starts of a fit to time records, with the problem of each."""
    times = [record.measurement for record in problem.experiments]
    coarse = [experiment(scene, record, COARSE_STEPS) for record in times]
    if warm:
        # A related model has the interpolation of the model with which it is compared.
        starts = _warmed(replace(problem, interpolation=warm.interpolation), coarse, warm)
    else:
        begun = searched(
            replace(problem, experiments=coarse), [*map(_fitted_samples, times)], follow
        )
        if begun is None:
            return []
        shooting, fit = begun[0], _recentred(*begun, scene)
        starts = [(shooting, fit)]
        for other in _interpolations(times)[1:]:
            starts += _otherwise(shooting, fit, other)
    return [(replace(shooting, experiments=problem.experiments), fit) for shooting, fit in starts]


def _of_lines(problem, first, scene, count, joint):
    """Starts of a fit to responses and impedances, and to time records if there are any."""
    # A response or an impedance is one window without states.
    sweeps = [experiment.measurement for experiment in problem.experiments[count:]]
    edges = [np.array([0, sweep.frequency.size]) for sweep in sweeps]
    lines = edges, [NO_STATES] * len(sweeps), [sweep.assumed_noise for sweep in sweeps]
    if first is None:
        grid = (ShootingFit(values, *lines) for values in _grid(problem, joint))
        best = sorted(grid, key=problem.cost)[:MOST_STARTS]
        return [(problem, start) for start in best]
    sizes = [*first.shooting.state_sizes[:count], *problem.state_sizes[count:]]
    problem = replace(problem, interpolation=first.interpolation, state_sizes=sizes)
    previous = first.shooting.known(first.values)
    values = np.array([previous.get(unknown.key, unknown.start) for unknown in problem.unknowns])
    old = first.fit.edges, first.fit.starts, first.fit.noise
    # Windows of time records are reused.
    windows: Any = [[*a[:count], *(b if joint else a)] for a, b in zip(old, lines, strict=True)]
    starts = [values]
    coupling = previous.get("piezo.coupling")
    if joint and coupling and MASS in problem.keys and scene.transducer:
        # An impedance determines θ²/M; a voltage under a known acceleration determines θ.
        factor = (coupling / scene.transducer.coupling) ** 2
        starts.append(_of_mass(problem, values, factor, scene))
    return [(problem, ShootingFit(values, *windows)) for values in starts]


def _of_mass(shooting, values, factor, scene):
    """Values of a device with the scene's mass times a factor and the scene's impedance."""
    scaled = values.copy()
    for number, unknown in enumerate(shooting.unknowns):
        if unknown.key == "piezo.coupling":
            scaled[number] = scene.transducer.coupling * factor**0.5
        elif any(word in unknown.key for word in IN_PROPORTION):
            scaled[number] *= factor
    return np.clip(scaled, shooting.low, shooting.high)


def _grid(shooting, is_known):
    """Values on a grid of factors, one for each kind of parameter; only the start if known."""
    choices = []
    for words, factors in GRID:
        members = np.array([any(word in key for word in words) for key in shooting.keys])
        tried = factors if members.any() and not is_known else (1.0,)
        choices.append([np.where(members, factor, 1.0) for factor in tried])
    for changes in product(*choices):
        yield np.clip(shooting.first * np.prod(changes, axis=0), shooting.low, shooting.high)


def _otherwise(shooting, fit, interpolation):
    """A list of the start with another interpolation; empty if no motion results."""
    other = replace(shooting, interpolation=interpolation)
    trial = restarted(other, split_windows(shooting, fit), fit.cost)
    if trial is None:
        return []
    # Both costs are compared with the same weights.
    trial = replace(trial, noise=fit.noise)
    trial.cost = other.cost(trial)
    return [(other, trial)] if trial.cost < HOPELESS * fit.cost else []


def _misfit(fit):
    """Cost of a fit plus the number of its fitted window states, for comparing fits."""
    return fit.cost + sum(states.size for states in fit.starts)


def _warmed(problem, coarse, warm):
    """A start from a related model's values; with that model's windows if its residuals are noise,
    else with short windows.
    """
    previous = warm.shooting.known(warm.values)
    free = [unknown.begun(previous.get(unknown.key, unknown.start)) for unknown in problem.unknowns]
    shooting = replace(problem, unknowns=free, state_sizes=warm.shooting.state_sizes)
    fit, rival = warm.fit, warm.fit.cost
    if warm.explains:
        begun = ShootingFit(shooting.first, fit.edges, fit.starts, fit.noise)
        near = shooting.minimized(begun, ON_THE_WAY, COARSE)
        if near.cost < HOPELESS * rival:
            return [(shooting, near)]
    begun = replace(split_windows(warm.shooting, fit), values=shooting.first)
    shooting = replace(shooting, experiments=coarse)
    trial = restarted(shooting, begun, rival)
    return [(shooting, trial)] if trial else []


def _recentred(shooting, fit, scene):
    """Shift a fit's origin so that x = 0 is at the scene's equilibrium.

    A voltage alone does not show about which equilibrium the motion is. F(x − d) is the same device
    for every d that leaves the constant force unchanged; the d nearest to the scene's spring is
    used.
    """
    original = scene.oscillator.restoring_force
    outputs = {name for record in shooting.experiments for name in record.measurement.outputs}
    indices = {power_of(key): number for number, key in enumerate(shooting.keys) if power_of(key)}
    if original is None or not {*range(1, len(original))} <= {*indices}:
        return fit
    if scene.stoppers or ORIGIN in shooting.keys or "displacement" in outputs:
        return fit
    free = [indices[power] for power in range(1, len(original))]
    force = np.array([original[0], *fit.values[free]])
    reach = shooting.length * max(float(np.abs(states[:, 0]).max()) for states in fit.starts)
    shifts = [
        float(root.real)
        for root in np.polynomial.Polynomial([0.0, *force[1:]]).roots()
        if abs(root.imag) < 1e-9 * reach
    ]
    powers = reach ** np.arange(1, len(original))
    springs = [(shift, shifted(force, -shift)) for shift in shifts]
    shift, moved = min(
        springs, key=lambda pair: float(np.sum(((pair[1][1:] - original[1:]) * powers) ** 2))
    )
    if abs(shift) < 1e-6 * reach:
        return fit
    values = fit.values.copy()
    values[free] = moved[1:]
    starts = [states - [shift / shooting.length, 0.0, 0.0] for states in fit.starts]
    trial = shooting.minimized(replace(fit, values=values, starts=starts), ORIGIN_ITERATIONS, 1e-9)
    return trial if trial.grams and trial.cost < 1.01 * fit.cost else fit
