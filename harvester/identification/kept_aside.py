"""Predict validation records: simulate each from one start under its recorded acceleration.

A prediction is claimed to be valid only in the ranges covered by the fitted records, since a model
extrapolates beyond them.

A record is first fitted in windows, which gives its initial state and the measured orbit. Then
the device is simulated from this state under the whole recorded acceleration, with the fitted
values and with others drawn from their covariance. A value that only this record shows, such as the
tilt of its base, is fitted in its windows for each set of values.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import islice, pairwise
from typing import TYPE_CHECKING

import numpy as np

from harvester.base.errors import IdentificationError
from harvester.device import contact, timescales
from harvester.device.system import potential
from harvester.identification.intervals import covariance
from harvester.identification.response import COARSE_STEPS, FINE_STEPS, experiment
from harvester.identification.search import (
    COARSE,
    HOPELESS,
    ON_THE_WAY,
    followed,
    in_short_windows,
    reach_of,
)
from harvester.identification.sensors import OUTPUT_UNITS
from harvester.identification.shooting import ShootingFit
from harvester.identification.unknowns import unknowns, with_values
from harvester.identification.validation_record import WholeRecord, prediction, root_mean_square
from harvester.scene.units import load_resistance
from harvester.statistics.attractors import repeats_in_noise
from harvester.statistics.batch_means import student_factor
from harvester.statistics.estimate import Estimate

if TYPE_CHECKING:
    from harvester.identification.fitting import Fitted
    from harvester.identification.measurement import Measurement
    from harvester.identification.shooting import Shooting
    from harvester.identification.validation_record import ValidationRecord

# Number of sets of values in addition to the fitted one, and maximum number of draws to find them.
DRAWS, MOST_DRAWN = 8, 80
# Share of a record, from its beginning, that is excluded as the initial transient.
FORGOTTEN = 1.0 / 3.0
# An orbit is between the wells if more than this share of the windows crosses a barrier; one window
# in ten may start in the wrong well.
CROSSING = 0.1
# The base moves as a sine if at least this share of its power is within SINE_LINES lines of the
# peak.
SINE, SINE_LINES = 0.9, 3
# A record belongs to the fitted device if its residuals in windows, beyond noise, are at most this
# multiple of the worst fitted record's, or this share of its rms. Records of a measured beam with
# another tilt of its base had residuals 5 to 20 times as large.
FOLLOWS, FOLLOWS_SHARE = 3.0, 0.05
# Initial values for a record's own values, relative to a change of order one, added to the scene's:
# a constant force favours one well or the other. Two minima are the same if no value differs by
# more than `SAME` of its size.
FIRST_SHARES, SAME = (0.0, 0.1, -0.1, 0.2, -0.2), 0.02
# The covered frequencies are between these shares of the base's cumulative power.
BAND = (0.01, 0.99)
# A position may be outside the covered displacements by this share of their range.
MARGIN = 0.02
# A prediction is claimed if its run exceeds the covered displacements, and its load the covered
# loads, by at most the first share, and its frequencies are within the second factor.
BEYOND, BEYOND_BAND = 0.1, 1.5
SPRING = ("restoring_force[", "linear_stiffness", "cubic_stiffness")


@dataclass(frozen=True)
class Visited:
    """Ranges covered by the records, in SI or scaled units.

    Attributes
    ----------
    displacement, velocity : tuple of (float, float)
        Minimum and maximum of the mass's displacement and velocity in each record, by the model.
    frequency : (float, float)
        Hz, of the base.
    loads : tuple of float
        Resistances (Ω), or decay rates λ of a scaled scene.
    extrapolated : tuple of str
        Features of the device outside the ranges, as text.
    values : tuple of str
        Keys of values that describe the spring around a position that no record covers.
    si : bool
        Whether the scene is in SI units.
    """

    displacement: tuple[tuple[float, float], ...]
    velocity: tuple[tuple[float, float], ...]
    frequency: tuple[float, float]
    loads: tuple[float, ...]
    extrapolated: tuple[str, ...]
    values: tuple[str, ...]
    si: bool

    @property
    def ranges(self) -> str:
        """The covered ranges, as text."""
        speed = max(abs(end) for interval in self.velocity for end in interval)
        moved = " and ".join(
            f"{self._length(low)} … {self._length(high)}"
            for low, high in _joined(self.displacement)
        )
        low, high = self.frequency
        loads = ", ".join(f"{load:.4g}" for load in self.loads)
        return (
            f"displacement {moved}{' mm' if self.si else ''}, velocity up to {speed:.3g}"
            f"{' m/s' if self.si else ''}, frequency {low:.3g} … {high:.3g}"
            f"{' Hz' if self.si else ''}, load {loads}{' Ω' if self.si else ''}"
        )

    def excludes(self, problem: Shooting, x: np.ndarray) -> str:
        """Reason why a run (scaled displacements) of the only record in `problem` is outside
        these ranges; else empty.
        """
        low, high = self.reach
        x = x * problem.length
        if x.min() < low or x.max() > high:
            return "the run exceeds the covered displacements"
        record = problem.experiments[0]
        load = _load(record.scene)
        if not (1.0 - BEYOND) * min(self.loads) <= load <= (1.0 + BEYOND) * max(self.loads):
            return "its load is outside the covered range"
        slowest, fastest = band([record.measurement])
        if slowest < self.frequency[0] / BEYOND_BAND or fastest > BEYOND_BAND * self.frequency[1]:
            return "its frequencies are outside the covered range"
        return ""

    @property
    def reach(self) -> tuple[float, float]:
        """Range of displacements in which a prediction is claimed."""
        low, high = np.min(self.displacement), np.max(self.displacement)
        return float(low - BEYOND * (high - low)), float(high + BEYOND * (high - low))

    def _length(self, value):
        return f"{1e3 * value if self.si else value:.3g}"


def visited(fitted: Fitted) -> Visited | None:
    """The ranges covered by a fit's records; None if there are only frequency responses."""
    if fitted.settled is None:
        return None
    shooting = fitted.shooting
    # Time records come first; sweeps and impedances contain only small motion.
    experiments = shooting.experiments[: len(fitted.settled.edges)]
    fits = fitted.fit, fitted.settled
    paths = [
        shooting.length * np.concatenate([shooting.states(fit, number) for fit in fits])
        for number in range(len(experiments))
    ]
    ranges, velocity = (
        tuple((float(np.nanmin(path[:, k])), float(np.nanmax(path[:, k]))) for path in paths)
        for k in (0, 1)
    )
    system, scales = shooting.at(0, fitted.values).known_device
    si = fitted.scene.units == "SI"
    loads = {_load(experiment.scene) for experiment in experiments}
    spring: tuple[str, ...] = ()
    if not _inside(ranges, 0.0):
        spring = tuple(k for k in fitted.keys if k.rpartition(".")[2].startswith(SPRING))
    outside = _outside(system, scales.displacement, ranges, si, len(loads) > 1)
    if spring:
        names = ", ".join(key.rpartition(".")[2] for key in spring)
        outside = (f"the spring about x = 0 ({names})", *outside)
    return Visited(
        displacement=ranges,
        velocity=velocity,
        frequency=band(experiment.measurement for experiment in experiments),
        loads=tuple(sorted(loads)),
        extrapolated=outside,
        values=spring,
        si=si,
    )


def _load(scene):
    """Resistance of the load, or its decay rate in a scaled scene."""
    return float(load_resistance(scene) or scene.load.decay_rate)


def band(measurements: Iterable[Measurement]) -> tuple[float, float]:
    """Frequencies between which the base has most of its power, over all records (Hz)."""
    ends = []
    for record in measurements:
        gathered = np.cumsum(_power_of_base(record))
        indices = np.searchsorted(gathered, np.array(BAND) * gathered[-1])
        frequencies = np.fft.rfftfreq(record.acceleration.size, 1.0 / record.sampling_rate)
        ends.append(frequencies[np.minimum(indices, frequencies.size - 1)])
    return float(min(low for low, _ in ends)), float(max(high for _, high in ends))


def _power_of_base(measurement):
    """Power of the base's acceleration at each line of its spectrum, with a Hann window."""
    base = measurement.acceleration - measurement.acceleration.mean()
    return np.abs(np.fft.rfft(base * np.hanning(base.size))) ** 2


def _outside(system, length, ranges, si, several_loads):
    """Features of the device outside the covered displacements."""

    def at(position):
        return f"{1e3 * position:.3g} mm" if si else f"{position:.3g}"

    parts = []
    wells = [length * well for well in timescales.wells(system)]
    for well in wells:
        if not _inside(ranges, well):
            parts.append(f"the {'other ' if len(wells) > 1 else ''}well at {at(well)}")
    for saddle in timescales.saddles(system):
        if not _inside(ranges, length * saddle):
            height = float(potential(system, saddle) - potential(system, timescales.rest(system)))
            energy = f" of {height * length**2:.3g} J/kg" if si else f" of {height:.3g}"
            parts.append(f"the barrier at {at(length * saddle)}{energy}")
    for edge in contact.edges(system.contacts):
        if np.isfinite(edge) and edge and not _inside(ranges, length * edge):
            parts.append(f"the stopper at {at(length * edge)}")
    parts.append(f"the walls beyond {at(np.min(ranges))} and {at(np.max(ranges))}")
    if not several_loads:
        parts.append(
            "other loads (coupling and capacitance are only as accurate as the load's resistance)"
        )
    return tuple(parts)


def _inside(ranges, position):
    return any(
        low - MARGIN * (high - low) <= position <= high + MARGIN * (high - low)
        for low, high in ranges
    )


def _joined(ranges):
    """Merge overlapping ranges, in ascending order."""
    merged: list[list[float]] = []
    for low, high in sorted(ranges):
        if merged and low <= merged[-1][1]:
            merged[-1][1] = max(merged[-1][1], high)
        else:
            merged.append([low, high])
    return merged


def kept_aside(
    fitted: Fitted,
    measurements: Sequence[Measurement],
    visited: Visited,
    records: Sequence[ValidationRecord],
    seed: int,
    report: Callable[[float], object] = lambda share: None,
) -> list[WholeRecord]:
    """Predict records that were not fitted.

    Parameters
    ----------
    visited : Visited
        Ranges covered by the fitted records.
    records : sequence of ValidationRecord
        Validation data of the fitted records, with residuals.
    seed : int
        Seed of the drawn values.
    report : callable, optional
        Called with the share of completed records.
    """
    if not measurements:
        return []
    # A frequency response has no mean power to compare.
    in_time = [record for record in records if record.long]
    parts = [part for record in in_time for part in record.unexplained]
    missed = [0.0 if part.is_noise else part.systematic for part in parts]
    model_error = _model_error(in_time, missed)
    draws = [fitted.shooting.known(draw) for draw in _likely(fitted, seed)]
    limit = max(FOLLOWS * max(missed), FOLLOWS_SHARE)
    predictions = []
    for number, record in enumerate(measurements):
        report(number / len(measurements))
        predictions.append(_of_record(fitted, record, visited, draws, model_error, limit))
    return predictions


def _likely(fitted, seed):
    """Sets of values that define a valid device: the fitted one, then draws from the covariance."""
    random = np.random.default_rng(np.random.SeedSequence(seed))
    normal = random.multivariate_normal(
        fitted.values, fitted.covariance, MOST_DRAWN, check_valid="ignore", method="eigh"
    )
    draws = np.clip(normal, fitted.shooting.low, fitted.shooting.high)
    possible = (draw for draw in draws if fitted.shooting.at(0, draw).device is not None)
    return [fitted.values, *islice(possible, DRAWS)]


def _model_error(records, missed):
    """Relative standard error of predicted powers, from the fitted records.

    It combines the errors of the runs' powers and the part of the residuals that depends on the
    motion: a relative error of the rms counts twice in the power. Student's factor corrects for the
    small number of records.
    """
    pairs = [(record.free_power().estimate, record.powers()[0].estimate) for record in records]
    off = [math.log(max(free, 1e-300) / measured) for free, measured in pairs]
    error = math.sqrt(np.mean(np.square(off)) + np.mean(np.square(2.0 * np.array(missed))))
    return error * student_factor(len(off))


def _of_record(fitted, measurement, visited, draws, model_error, limit):
    """Compare one validation record with its prediction."""
    length, noise = fitted.shooting.length, _noise(fitted, measurement)
    # The record may be in the other well, so starts on both sides are tried.
    farthest = (1.0 + BEYOND) * float(np.abs(visited.displacement).max()) / length
    own: list[dict[str, float]] = [{}] * len(draws)
    reach, errors = (-farthest, farthest), np.zeros(0)
    if measurement.own:
        inside = tuple(end / length for end in visited.reach)
        problem, fit, own = _own_values(fitted, measurement, draws, noise, inside, reach, limit)
        errors = np.sqrt(np.maximum(np.diag(covariance(problem, fit)), 0.0))
        reach = reach_of(problem.states(fit, 0)[:, 0])
    known = [draw | values for draw, values in zip(draws, own, strict=True)]
    problems = [_problem(fitted, measurement, values) for values in known]
    problem, repeats = problems[0], _repeats(measurement)
    system, _ = problem.at(0, []).known_device
    saddles = np.sort(timescales.saddles(system))
    # Sinusoidal motion is nearly the same in both wells, so unrestricted windows may be in
    # different wells. Windows in a single well are preferred if their fit is similar.
    between = [saddle for saddle in saddles if reach[0] < saddle < reach[1]]
    wells = [*pairwise([reach[0], *between, reach[1]])] if between else []
    settled = _followed(problem, noise, wells, reach, 0.0)
    record, edges = prediction(problem, settled, 0), settled.edges[0]
    followed_path = problem.states(settled, 0)[:, 0]
    late = int(FORGOTTEN * followed_path.size)
    runs = [_run(drawn, settled.starts[0][:1], late) for drawn in problems]
    orbits = [_orbit(x, saddles, np.array([0, x.size]), repeats) for x, _ in runs]
    agreement = float(np.mean([orbit == orbits[0] for orbit in orbits]))
    left = math.sqrt(max(record.nrmse() ** 2 - record.noise() ** 2, 0.0))
    outside = visited.excludes(problem, runs[0][0])
    if agreement < 1.0:
        outside = "values within the uncertainty lead to different orbits"
    if left > limit:
        cause = "with the value fitted in it" if measurement.own else "another tilt, load or sensor"
        outside = f"its residual is {left:.0%} even in short windows: {cause}"
    late_records = [
        replace(record, measured=record.measured[late:], windowed=record.windowed[late:], free=free)
        for _, free in runs
    ]
    return WholeRecord(
        **vars(late_records[0]),
        outside=outside,
        left=left,
        limit=limit,
        measured_orbit=_orbit(followed_path, saddles, edges, repeats),
        predicted_orbit=orbits[0],
        agreement=agreement,
        rms_unit=_unit(measurement) if fitted.scene.units == "SI" else "",
        predicted_rms=_with_error([root_mean_square(free) for _, free in runs], 0.5 * model_error),
        predicted_power=_with_error([drawn.free_power() for drawn in late_records], model_error),
        own={
            key: _with_error([Estimate(row[key], float(error), 1.0, "1") for row in own], 0.0)
            for key, error in zip(measurement.own, errors, strict=True)
        },
    )


def _problem(fitted, measurement, known, free=()):
    """Least-squares problem of one further record with known values by key.

    The only unknowns, in addition to the windows' starts, are the `free` values of the record.
    """
    known = {key: value for key, value in known.items() if key not in free}
    # Drawn values define a valid device, since the fitted records were simulated with them.
    scene = with_values(fitted.scene, known) or fitted.scene
    sensors = {key: value for key, value in known.items() if key.startswith("sensor.")}
    seen = replace(measurement, sensors=sensors | measurement.sensors)
    record = experiment(scene, seen, COARSE_STEPS if free else FINE_STEPS)
    own = unknowns(record.scene, free, fitted.sizes)
    return replace(fitted.shooting, experiments=[record], unknowns=own)


def _own_values(fitted, measurement, draws, noise, inside, reach, enough):
    """Fit a record's own values; return the problem, the fit, and the values for each draw.

    If a mirrored motion fits about as well, the one in the covered displacements is chosen.
    """
    problems = [_problem(fitted, measurement, draw, measurement.own) for draw in draws]
    problem = problems[0]
    fit = _followed(problem, noise, [inside], reach, enough)
    if not fit.grams:
        raise IdentificationError(
            f"{measurement.name}: no value of {', '.join(measurement.own)} fits the record: "
            "check the columns' units and signs, or give the value"
        )
    begun = ShootingFit(fit.values, fit.edges, fit.starts, fit.noise)
    fits = [fit, *(other.minimized(begun, ON_THE_WAY, COARSE) for other in problems[1:])]
    return problem, fit, [problem.known(fit.values) for fit in fits]


def _followed(problem, noise, ranges, reach, enough):
    """Fit a record in windows, with displacements in the best one of `ranges`, or anywhere.

    The best range is chosen if the first output's relative residual is at most `enough`, or if
    unrestricted displacements within `reach` do not fit better.
    """
    fits = [_in_windows(problem, noise, ends) for ends in ranges]
    best = min(fits, key=lambda fit: _cost(problem, fit, noise), default=None)
    if best and best.grams and prediction(problem, best, 0).nrmse() <= enough:
        return best
    anywhere = _in_windows(problem, noise, reach)
    near = best and _cost(problem, best, noise) <= HOPELESS * _cost(problem, anywhere, noise)
    return best if near else anywhere


def _in_windows(problem, noise, reach):
    """The best fit in long windows, continued from each minimum in short ones."""
    measurement = problem.experiments[0].measurement
    span = [(0, measurement.acceleration.size)]
    first = problem.first
    minima: list[ShootingFit] = []
    for share in FIRST_SHARES if first.size else (0.0,):
        values = np.clip(first + share * problem.sizes, problem.low, problem.high)
        begun = in_short_windows(problem, ShootingFit(values, [], [], [noise]), span, reach)
        fit = problem.minimized(begun, ON_THE_WAY if first.size else 0, COARSE)
        moved = [np.abs(fit.values - minimum.values) / problem.sizes for minimum in minima]
        if fit.grams and all(distance.max() > SAME for distance in moved):
            minima.append(fit)
    fits = [followed(problem, minimum) for minimum in minima]
    return min(fits, key=lambda fit: _cost(problem, fit, noise), default=begun)


def _cost(problem, fit, noise):
    """Cost of a fit with a common noise level, corrected for the windows' fitted starts."""
    # A completed fit is weighted by its own residuals; here it gets the common noise level.
    same = ShootingFit(fit.values, fit.edges, fit.starts, [noise])
    return problem.cost(same) + sum(states.size for states in fit.starts)


def _noise(fitted, measurement):
    """Noise of each output, from the fit of the other records."""
    levels = dict(zip(measurement.outputs, measurement.assumed_noise, strict=True))
    for other, fitted_levels in zip(fitted.shooting.experiments, fitted.fit.noise, strict=True):
        levels |= zip(other.measurement.outputs, fitted_levels, strict=True)
    return np.array([levels[name] for name in measurement.outputs])


def _run(problem, start, late):
    """Displacement and outputs from one start, without their first part."""
    edges = np.array([0, problem.experiments[0].measurement.acceleration.size])
    states, _, outputs = problem.at(0, []).states(edges, start)
    return states[late:, 0], outputs[late:]


def _repeats(measurement):
    """Samples per period if the base moves as a sine, else None."""
    power = _power_of_base(measurement)
    line = int(np.argmax(power))
    near = power[max(line - SINE_LINES, 0) : line + SINE_LINES + 1]
    if line == 0 or near.sum() < SINE * power.sum():
        return None
    # The frequency is between lines: the power-weighted mean of the strongest line and its
    # neighbours.
    weights = power[line - 1 : line + 2]
    return measurement.acceleration.size / float(
        weights @ np.arange(line - 1, line + 2) / weights.sum()
    )


def _orbit(x, saddles, edges, period):
    """Kind of motion, as text: in which well or between the wells, and whether chaotic."""
    repeats = "" if period is None or repeats_in_noise(x, period) else ", chaotic"
    if not saddles.size:
        return f"in the well{repeats}"
    basins = np.searchsorted(np.sort(saddles), x)
    parts = np.split(basins, edges[1:-1] - edges[0])
    crossing = np.mean([np.ptp(part) > 0 for part in parts])
    if crossing > CROSSING:
        return f"between the wells{repeats}"
    number = int(np.median(basins))
    if saddles.size == 1:
        return f"in the well on the {('left', 'right')[number]}{repeats}"
    return f"in well {number + 1} from the left{repeats}"


def _with_error(estimates, model_error):
    """The first estimate, with the errors of the values, as others scatter, and of the model."""
    first, *others = estimates
    scatter = np.mean([(other.estimate - first.estimate) ** 2 for other in others] or [0.0])
    error = math.hypot(first.standard_error, math.sqrt(scatter), model_error * first.estimate)
    return replace(first, standard_error=error)


def _unit(measurement):
    """Unit of the first output."""
    name = next(iter(measurement.outputs))
    return "V" if name == "velocity" and measurement.velocity_in_volts else OUTPUT_UNITS[name]
