"""Maximise over one parameter: by averaging, then by simulation on common noise.

Averaging scans the range and refines its highest point. Simulations near it have common noise, so
that differences of their values are far more precise than the values. A cubic fit gives the
maximum; its standard error follows from paired errors of the values.

    value                      window, half width 0.25 of the range
      |               [....o....^....o....]     o simulated   ^ maximum of the cubic
      |          o    :         |         :
      |     .         :         |         :
      +---------------:---------|---------:------ parameter

    1. The slope at the window's middle is significant: move the window uphill.
    2. The cubic does not fit the values, or falls by more than 0.15: halve the window.
    3. Two standard errors exceed 0.15 of the half width: increase the number of realizations.
    4. Otherwise the maximum of the cubic, with its standard error, is the result.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from harvester.base.errors import HarvesterError, OptimumError
from harvester.base.formatting import with_error
from harvester.base.method import Method
from harvester.engines.methods import Engine
from harvester.engines.progress import Stages
from harvester.engines.request import Answer, Request
from harvester.engines.runner import Runner
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import step_error
from harvester.statistics.agreement import SIGNIFICANT_SIGMAS
from harvester.statistics.estimate import Estimate
from harvester.statistics.passivity import store_notes
from harvester.statistics.run_estimates import error_of
from harvester.statistics.units import unit_of
from harvester.studies.answers import (
    answers_in_time,
    longer_runs,
    missing_from,
    on_common_knots,
    successful,
)
from harvester.studies.optimum.axis import Axis, OptimalParameter
from harvester.studies.optimum.objective import NOTHING, is_nothing, series_in_units
from harvester.studies.optimum.result import Averaging, Optimum

# Number of points of averaging's scan; of its refinement between the neighbours of the highest
# point; degree of the polynomial fitted to them; number of simulated points of a fit.
SCANNED, REFINED, DEGREE, PLACES = 17, 7, 4, 7
# Half width of the fitted window as a share of the range, initially and at least. The window is
# halved while the fit falls by more than `DROP` of its maximum within it.
WINDOW, NARROWEST, DROP = 0.25, 0.02, 0.15
MOVES = 16
# Maximum ratio of two standard errors of the optimum to the window's half width. If it is exceeded,
# the next round has the required number of realizations times RESERVE, but at most
# TIMES_REALIZATIONS times the present number.
WANTED, RESERVE, TIMES_REALIZATIONS = 0.15, 1.2, 4.0
MOST_TIMES_REALIZATIONS = {"monte-carlo": 16.0, "circuit": 1.0}
# The window is narrowed if a value deviates from the cubic by this number of standard errors, and
# by this share of the fall within the window.
MISFIT, MISFIT_SHARE = 4.0, 0.05
# A maximum must exceed the ends of its window by STANDS_OUT of its value; otherwise it is a
# plateau. The window is not narrowed if the fall is below NARROWED: a kink looks the same at every
# scale, and no cubic fits it.
STANDS_OUT, NARROWED = 1e-3, 1e-2
# The window is centred at a maximum farther from its middle than this share of its half width.
RECENTRED = 0.2
MAXIMISED = ("power_conversion_efficiency", "mean_power", "mean_square_voltage")


def along(
    scene: Scene,
    axis: Axis,
    quantity: str,
    method: Method,
    closure: str,
    runner: Runner,
    stages: Stages,
    precision: float | None = None,
) -> Optimum:
    """The optimum over one parameter, except its computing time."""
    # A common knot spacing for the whole range gives all points the same noise.
    ends = [scene.replace({axis.key: end}) for end in (axis.low, axis.high)]
    (device,) = on_common_knots([scene], ends)
    location, value, reason = None, None, f"does not compute {quantity.replace('_', ' ')}"
    if quantity in MAXIMISED:
        stages.begin(0.0, 0.3, "stationary averages")
        location, value, reason = averaged(device, axis, quantity, closure, runner)

    def begin():
        # The number of windows is unknown: each takes half of the remaining progress.
        low = max(stages.share, 0.3)
        stages.begin(low, 0.5 * (low + 0.9), "simulation")

    search = Search(device, axis, quantity, method, runner, begin)
    maximum, fitted = search.find(None if location is None else axis.coordinate(location))
    stages.begin(0.9, 1.0, "comparison")
    at_maximum = device.replace({axis.key: maximum.estimate})
    aim: dict[str, Any] = {}
    if device.excitation.random:
        aim = {"precision": precision, "quantities": (quantity,)}
    simulation = search.request(axis.coordinate(maximum.estimate), **aim)
    requests = [simulation, Request(at_maximum, closure)]
    simulated, by_closure = answers_in_time(runner, requests)
    successful([simulated])
    refused = isinstance(by_closure, HarvesterError) or quantity not in MAXIMISED
    value_of_closure = None if refused else amount(by_closure, quantity)
    return Optimum(
        scene=scene,
        quantity=quantity,
        unit=unit_of(scene, simulated.quantities[quantity].dimension),
        method=method.name,
        parameters=[OptimalParameter(axis, maximum.estimate, maximum.standard_error)],
        value=simulated.in_units()[quantity],
        notes=store_notes(simulated.quantities),
        searched=[({axis.key: value_searched}, estimate) for value_searched, estimate in fitted],
        averaging=Averaging(closure, location, value, reason, value_of_closure),
    )


def amount(answer: Answer, quantity: str) -> float:
    """An answer's value of the quantity, in the scene's units."""
    return answer.in_units()[quantity].estimate


def averaged(
    scene: Scene, axis: Axis, quantity: str, closure: str, runner: Runner
) -> tuple[float | None, float | None, str]:
    """(position, value, "") of the maximum by averaging, or (None, None, reason)."""

    def values(coordinates):
        locations = [axis.value(c) for c in coordinates]
        requests = [Request(scene.replace({axis.key: location}), closure) for location in locations]
        outcomes = answers_in_time(runner, requests)
        refusals = [str(outcome) for outcome in outcomes if isinstance(outcome, HarvesterError)]
        amounts = [
            -math.inf if isinstance(outcome, HarvesterError) else amount(outcome, quantity)
            for outcome in outcomes
        ]
        return amounts, refusals

    grid = np.linspace(0.0, 1.0, SCANNED)
    scanned, refusals = values(grid)
    top = int(np.argmax(scanned))
    if not math.isfinite(scanned[top]):
        return None, None, f"not valid anywhere in the range: {refusals[0]}"
    if top in (0, SCANNED - 1):
        end = axis.value(grid[top])
        return None, None, f"largest at the end of the range, {axis.key} = {end:.4g}"
    if not (math.isfinite(scanned[top - 1]) and math.isfinite(scanned[top + 1])):
        return None, None, f"largest next to points at which it is not valid: {refusals[0]}"
    for side, values_there in (("below", scanned[:top]), ("above", scanned[top:])):
        lowest = min(value for value in values_there if math.isfinite(value))
        if not scanned[top] - lowest > STANDS_OUT * abs(scanned[top]):
            return None, None, f"flat {side} {axis.key} = {axis.value(grid[top]):.4g}"
    closer = np.linspace(grid[top - 1], grid[top + 1], REFINED)
    around, refusals = values(closer)
    if refusals:
        return None, None, f"largest next to points at which it is not valid: {refusals[0]}"
    fit = np.polynomial.Polynomial.fit(closer, around, DEGREE)
    fine = np.linspace(closer[0], closer[-1], 2001)
    best = int(np.argmax(fit(fine)))
    return axis.value(fine[best]), float(fit(fine[best])), ""


class Search:
    """The maximum of a quantity by simulation, with the same noise for all points.

    `scene`: the scene, with the knot spacing common to all points; `begin`: called before each
    window.
    """

    def __init__(
        self,
        scene: Scene,
        axis: Axis,
        quantity: str,
        method: Method,
        runner: Runner,
        begin: Callable[[], object],
    ):
        self._begin, self._error_of = begin, error_of(scene)
        self.scene, self.axis, self.quantity = scene, axis, quantity
        self.method, self._runner = method, runner
        self._more = 1.0
        self._missing: list[str] = []

    def find(self, start: float | None) -> tuple[Estimate, list[tuple[float, Estimate]]]:
        """Return the maximum's position with its standard error, and the values of the fit.

        `start`: initial coordinate; None: the highest of some points over the whole range.
        """
        centre = self._highest() if start is None else start
        half = WINDOW
        for _ in range(MOVES):
            self._begin()
            centre = min(max(centre, half), 1.0 - half)
            coordinates = _spread(centre, half)
            answers = self._answers(coordinates)
            fit = CubicFit(np.linspace(-1.0, 1.0, PLACES), answers, self.quantity, self._error_of)
            if not fit.peaked or abs(fit.place) > 1.0:
                centre = self._moved(centre, half, fit, answers)
            elif (fit.drop > DROP or fit.misfit) and half > NARROWEST:
                centre, half = centre + half * fit.place, max(0.5 * half, NARROWEST)
            elif fit.flat_to:
                centre = self._better_seen(centre, half, fit, answers)
            elif not fit.error or 2.0 * fit.error > WANTED:
                if not self._lengthen(RESERVE * (2.0 * (fit.error or math.inf) / WANTED) ** 2):
                    return self._estimated(centre, half, fit, coordinates, answers)
            else:
                return self._estimated(centre, half, fit, coordinates, answers)
        raise OptimumError(
            f"{self.axis.key}: the maximum of {self._name()} could not be distinguished from "
            f"noise; {longer_runs(self.scene)}, or give a range around it with --from and --to"
        )

    def request(self, coordinate: float, **options: Any) -> Request:
        """The request for one point, with the number of realizations for the required precision."""
        scene = self.scene.replace({self.axis.key: self.axis.value(coordinate)})
        increased = math.ceil(self._more * self.scene.run.realizations)
        realizations = None if self._more == 1.0 else increased
        return Request(scene, self.method, realizations=realizations, **options)

    def _answers(self, coordinates):
        requests = [self.request(coordinate, moments=True) for coordinate in coordinates]
        answers = successful(answers_in_time(self._runner, requests))
        for answer in answers:
            self._missing += missing_from(self.quantity, answer.quantities[self.quantity])
        return answers

    def _highest(self):
        """Coordinate of the highest of some points over the range."""
        grid = np.linspace(0.0, 1.0, PLACES)
        values = [amount(answer, self.quantity) for answer in self._answers(grid)]
        return float(grid[np.argmax(values)])

    def _moved(self, centre, half, fit, answers):
        """The next window's centre, uphill if the slope is significant."""
        if not fit.sloped:
            if self._lengthen():
                return centre
            self._refuse_flat(
                (centre, half),
                answers,
                fit,
                f"is the same within its errors from {self.axis.value(centre - half):.4g} to "
                f"{self.axis.value(centre + half):.4g} by {self.method.name}",
                "choose another range or parameter",
            )
        side = math.copysign(1.0, fit.slope)
        if not half < centre + side * 1e-9 < 1.0 - half:
            self._refuse_end(0.5 + 0.5 * side)
        return centre + side * half

    def _better_seen(self, centre, half, fit, answers):
        """The next window's centre, if the fitted maximum does not exceed both ends of the present
        window.
        """
        around = min(max(centre + half * fit.place, half), 1.0 - half)
        # If the fall is within noise, the position is too uncertain, and more realizations are
        # needed.
        longer = fit.noisy_ends and self._lengthen()
        if longer or abs(around - centre) > RECENTRED * half:
            return around
        low, high = sorted(self.axis.value(centre + half * x) for x in (fit.place, fit.flat_to))
        self._refuse_flat(
            (centre, half),
            answers,
            fit,
            f"is flat from {low:.4g} to {high:.4g} by {self.method.name}, within errors or "
            f"{STANDS_OUT:.1%}",
            "a maximum beyond this plateau needs another range (--from, --to)",
        )

    def _refuse_flat(self, window, answers, fit, flat, otherwise):
        """Raise OptimumError if no differences are significant; say if all values are 0."""
        values = [answer.in_units()[self.quantity] for answer in answers]
        unit = unit_of(self.scene, values[0].dimension)
        listing = ", ".join(
            f"{with_error(value, unit)} at {self.axis.value(coordinate):.4g}"
            for value, coordinate in zip(values, _spread(*window), strict=True)
        )
        if fit.unknown:
            flat = "cannot be compared: its differences have no error bar"
            otherwise = "compare the values with harvester sweep"
        advice = f"{flat}: {listing}; {longer_runs(self.scene)}, or {otherwise}"
        if all(map(is_nothing, values)):
            advice = f"is 0 within its errors at all {len(values)} points, {NOTHING}"
        raise OptimumError(f"{self.axis.key}: {self._name()} {advice}")

    def _lengthen(self, times=TIMES_REALIZATIONS):
        """Multiply the number of realizations; return False if it is already at its limit."""
        before, most = self._more, MOST_TIMES_REALIZATIONS[self.method.name]
        self._more = min(before * min(times, TIMES_REALIZATIONS), most)
        return self._more > before

    def _estimated(self, centre, half, fit, coordinates, answers):
        if fit.error is None:
            raise OptimumError(
                f"{self.axis.key}: the runs are too short for an interval; "
                f"{longer_runs(self.scene)}"
            )
        coordinate = centre + half * fit.place
        error = half * math.hypot(fit.error, fit.bias) * self.axis.slope(coordinate)
        fitted = [
            (self.axis.value(c), answer.in_units()[self.quantity])
            for c, answer in zip(coordinates, answers, strict=True)
        ]
        location = self.axis.value(coordinate)
        if isinstance(self.method, Engine) and not self.scene.excitation.random:
            # A step error that varies over the window moves the maximum in proportion.
            scene_at_maximum = self.scene.replace({self.axis.key: location})
            cost = step_error(prepared(scene_at_maximum), self.method.step, self.method.name)
            error = math.hypot(error, cost * location)
        return Estimate(location, error, None, "1"), fitted

    def _refuse_end(self, coordinate):
        raise OptimumError(
            f"{self.axis.key}: {self._name()} is largest at the end of the range, "
            f"{self.axis.value(coordinate):.4g}, by {self.method.name}: "
            f"{(*self._missing, 'no optimum inside; extend it with --from and --to')[0]}"
        )

    def _name(self):
        return self.quantity.replace("_", " ")


def _spread(centre, half):
    """Coordinates of the points in a window."""
    return centre + half * np.linspace(-1.0, 1.0, PLACES)


class CubicFit:
    """Cubic through values at points from −1 to 1, with errors from their common noise.

    `error_of`: error of a mean from batches, see `harvester.statistics.run_estimates.error_of`.

    Attributes
    ----------
    place, error
        Position of the maximum, and its statistical error.
    bias : float
        Distance to the maximum of a spline, if values deviate significantly from the cubic;
        otherwise 0.
    slope
        Slope at the middle of the window.
    sloped, peaked
        Whether the slope, and the downward curvature, are significant.
    drop
        Fall from the maximum to the lower end, as a share of the maximum.
    misfit
        Whether the deviation from the cubic is relevant, so that the window should be narrowed.
    flat_to : int
        −1 or 1: the end at which the value is not significantly below the value at the point
        nearest to the maximum; 0: neither end.
    noisy_ends
        Whether longer runs could make the fall to this end significant.
    unknown
        Whether an error that decides on the maximum is not known.
    """

    def __init__(
        self,
        places: np.ndarray,
        answers: Sequence[Answer],
        quantity: str,
        error_of: Callable,
    ):
        self._error_of = error_of
        powers = np.vander(places, 4, increasing=True)
        solve = np.linalg.pinv(powers)
        values = np.array([amount(answer, quantity) for answer in answers])
        series = np.array([series_in_units(a, quantity) for a in answers])
        c0, c1, c2, c3 = solve @ values
        noise = np.tensordot(solve, series, 1)
        slope_error, curve_error = error_of(noise[1]), error_of(noise[2])
        self.slope = float(c1)
        self.unknown = None in (slope_error, curve_error)
        self.sloped = slope_error is not None and abs(c1) > SIGNIFICANT_SIGMAS * slope_error
        inside = c2 * c2 - 3.0 * c1 * c3
        bent = curve_error is not None and c2 < -SIGNIFICANT_SIGMAS * curve_error
        self.peaked = bent and inside > 0.0
        self.place, self.error, self.drop = math.inf, None, 0.0
        if self.peaked:
            self.place = t = float(c1 / (math.sqrt(inside) - c2))
            # −2 times the change of t by the noise, since c1 + 2 c2 t + 3 c3 t² = 0.
            moved = (noise[1] + 2.0 * t * noise[2] + 3.0 * t * t * noise[3]) / (c2 + 3.0 * c3 * t)
            self.error = error_of(-0.5 * moved)
            top = c0 + t * (c1 + t * (c2 + t * c3))
            self.drop = float(1.0 - (powers @ [c0, c1, c2, c3])[[0, -1]].min() / top)
        self._look_for_misfit(places, values, series, powers @ solve)
        self._look_at_ends(places, values, series)

    def _look_for_misfit(self, positions, values, series, fitting):
        residual = np.eye(len(positions)) - fitting
        off = np.abs(residual @ values)
        errors = [self._error_of(row) for row in np.tensordot(residual, series, 1)]
        beyond = [x for x, e in zip(off, errors, strict=True) if e is not None and x > MISFIT * e]
        self.bias, self.misfit = 0.0, False
        if beyond and self.peaked:
            fine = np.linspace(-1.0, 1.0, 20001)
            self.bias = float(
                abs(fine[np.argmax(CubicSpline(positions, values)(fine))] - self.place)
            )
            fall = values.max() - max(values[0], values[-1])
            narrow = fall <= NARROWED * values.max()
            self.misfit = not narrow and max(beyond) > MISFIT_SHARE * np.ptp(values)

    def _look_at_ends(self, positions, values, series):
        """Compare the values at the window's ends with the highest, since a cubic fit of a plateau
        also has a maximum.
        """
        self.flat_to, self.noisy_ends = 0, False
        nearest = int(np.argmin(np.abs(positions - self.place)))
        least = STANDS_OUT * abs(values[nearest])
        for end in (0, -1):
            fall = values[nearest] - values[end]
            error = self._error_of(series[nearest] - series[end])
            self.unknown |= error is None
            if error is None or not fall > max(SIGNIFICANT_SIGMAS * error, least):
                self.flat_to = int(np.sign(positions[end]))
                self.noisy_ends = error is None or SIGNIFICANT_SIGMAS * error > least
