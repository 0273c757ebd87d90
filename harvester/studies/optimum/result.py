"""The result of `optimum` over one or several parameters, and its display."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any

from harvester.averaging.closures import notes_on_errors
from harvester.base.formatting import prefixed, quantity, span, with_error
from harvester.base.serialising import fields_of, plain
from harvester.base.symbols import definitions
from harvester.engines.methods import method_of
from harvester.engines.orbits import on_orbits, with_orbit
from harvester.results.orbit import Attractor
from harvester.results.palette import CIRCUIT, MONTE_CARLO
from harvester.results.panels import Panel, Series, draw_panels
from harvester.results.view import Picture, ResultBase, View
from harvester.scene.model import Scene
from harvester.scene.tables import key_column, key_words
from harvester.statistics.estimate import Estimate
from harvester.studies.answers import is_noisy, longer_runs, missing_from
from harvester.studies.optimum.axis import INTERVAL, NARROW, OptimalParameter
from harvester.studies.optimum.flat_region import FLAT_SHARE
from harvester.studies.optimum.objective import NOTHING, is_nothing
from harvester.studies.sweep import orbits_of

SEARCHED, MAXIMUM, OWN = "0.6", MONTE_CARLO, CIRCUIT


@dataclass(frozen=True)
class Averaging:
    """The optimum by averaging, for comparison.

    Attributes
    ----------
    place, value : float or None
        Position and value of averaging's maximum; None (see the reason) if averaging is not valid
        or has no maximum inside the range.
    value_at_simulated_place
        Averaging's value at the optimum by simulation.
    """

    closure: str
    place: float | None
    value: float | None
    reason: str
    value_at_simulated_place: float | None


@dataclass(frozen=True, repr=False)
class Optimum(ResultBase):
    """Optimum of a quantity, in the scene's units.

    For one parameter, a curve is fitted to several points, and compared with averaging. For
    several, a library proposes points, and the limits of each parameter's flat range are sought.

    Attributes
    ----------
    parameters
        Each parameter with its value at the optimum.
    value
        Value from a run at the optimum; for several parameters on independent noise.
    searched : list of (dict, Estimate)
        Points and values of the last fit; for several parameters of all proposals, with NaN if a
        run failed.
    averaging
        Optimum by averaging, for one parameter.
    own
        The value for the unchanged scene, for several parameters.
    orbits
        Without noise: the orbits reached from random starts at the optimum, the followed one first.
    notes
        Caveats for citing the value.
    evaluations
        Total number of runs, for several parameters.
    seconds
        Wall-clock time of this call (s).
    """

    scene: Scene
    quantity: str
    unit: str
    method: str
    parameters: list[OptimalParameter]
    value: Estimate
    searched: list[tuple[dict[str, float], Estimate]]
    averaging: Averaging | None = None
    own: Estimate | None = None
    orbits: tuple[Attractor, ...] = ()
    notes: tuple[str, ...] = ()
    evaluations: int = 0
    seconds: float = 0.0

    @property
    def keys(self) -> list[str]:
        """The keys of the parameters."""
        return [parameter.axis.key for parameter in self.parameters]

    @property
    def place(self) -> Estimate:
        """The best value of the first parameter."""
        first = self.parameters[0]
        return Estimate(first.place, first.standard_error, None, "1")

    @property
    def interval(self) -> tuple[float, float]:
        """Optimum ± two standard errors; for several parameters, value ± two standard errors."""
        about = self.value if self.averaging is None else self.place
        reach = INTERVAL * (math.nan if about.standard_error is None else about.standard_error)
        return about.estimate - reach, about.estimate + reach

    def view(self) -> View:
        """Table, findings and pictures."""
        return View(
            self._table(),
            self._findings(),
            headline=self._headline(),
            pictures=[Picture(_draw, self)],
            records=self._records,
        )

    def _table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows of the table, as text."""
        if self.averaging is not None:
            return self._table_of_methods(self.averaging)
        header = ["parameter", "range", "optimum at", f"within {FLAT_SHARE:.0%} of the maximum"]
        return header, [
            [
                parameter.axis.key,
                self._span(parameter.axis.key, parameter.axis.low, parameter.axis.high),
                self._at(parameter.axis.key, parameter.place),
                self._span(parameter.axis.key, parameter.flat_low, parameter.flat_high),
            ]
            for parameter in self.parameters
        ]

    def _records(self):
        """Header and one row per searched point, in the scene's units."""
        keys = [key_column(key, self.scene.units) for key in self.keys]
        header = [*keys, f"{self.quantity} [{self.unit}]", f"standard_error [{self.unit}]"]
        return header, [
            [*(location[key] for key in self.keys), mean.estimate, mean.standard_error]
            for location, mean in self.searched
        ]

    def _table_of_methods(self, averaging):
        key = self.parameters[0].axis.key
        header = ["method", "parameter", "optimum at", "interval", self.quantity.replace("_", " ")]
        location = self._at(key, self.place.estimate)
        location.error = self.place.standard_error
        rows = [
            [
                self.method,
                key,
                location,
                self._span(key, *self.interval),
                with_error(self.value, self.unit),
            ]
        ]
        if averaging.place is not None:
            location, value = self._at(key, averaging.place), quantity(averaging.value, self.unit)
            rows.insert(0, [f"averaging, {averaging.closure}", key, location, "", value])
        return header, rows

    def _headline(self) -> str:
        """The optimum, its value, and the maximised quantity."""
        listing = ", ".join(
            f"{parameter.axis.key} = {self._at(parameter.axis.key, parameter.place)}"
            for parameter in self.parameters
        )
        words = self.quantity.replace("_", " ")
        return (
            f"largest {words}: {with_error(self.value, self.unit)} at {listing}, by {self.method}"
        )

    def _at(self, key, value):
        """A value of a key with its unit, as text."""
        return quantity(value, key_words(key, self.scene.units)[1])

    def _span(self, key, low, high):
        """A range of a key with its unit, as text."""
        return span(low, high, key_words(key, self.scene.units)[1])

    def _findings(self) -> list[str]:
        """Sentences on the intervals of optimum and value, and on the runs."""
        if self.averaging is None:
            return [*self._on_value(), *self._on_ranges(), *self._on_orbits(), self._on_runs()]
        (parameter,) = self.parameters
        key = parameter.axis.key
        searched = self._span(key, *(self.searched[end][0][key] for end in (0, -1)))
        return [
            *self._on_averaging(self.averaging),
            *definitions([self.quantity]),
            f"{self.method}: cubic through {len(self.searched)} points in {searched} on common "
            f"noise, seed {self.scene.run.seed}; interval: two standard errors",
            *missing_from(self.quantity, self.value),
            *self.notes,
            *self._on_orbits(),
            f"{self.seconds:.1f} s",
        ]

    def _on_averaging(self, averaging):
        """Sentence on the deviation of averaging from the simulation."""
        words = f"averaging, {averaging.closure}"
        shift, value = self._off(averaging)
        lines = [f"{words}: no optimum: {averaging.reason}"]
        if shift is not None:
            lines = [f"{words}: optimum {shift:+.1%}, value {value:+.1%} from {self.method}"]
        if averaging.value_at_simulated_place is not None:
            off = averaging.value_at_simulated_place / self.value.estimate - 1.0
            lines.append(f"{words}, at {self.method}'s optimum: {off:+.1%}")
        return lines

    def _off(self, averaging):
        """Averaging's relative deviations of optimum and value."""
        if averaging.place is None:
            return None, None
        location_deviation = averaging.place / self.place.estimate - 1.0
        return location_deviation, averaging.value / self.value.estimate - 1.0

    def _on_value(self):
        scene_value: Any = self.own
        low, high = self.interval
        noisy = is_noisy(self.scene, method_of(self.method)) and math.isfinite(low)
        reach = f", interval {span(low, high, self.unit)}" if noisy else ""
        return [
            f"{self.quantity.replace('_', ' ')} at the optimum: {with_error(self.value, self.unit)}"
            f"{reach}; of the unchanged scene {with_error(scene_value, self.unit)}",
            *definitions([self.quantity]),
            *missing_from(self.quantity, self.value),
            *notes_on_errors([self.method]),
            *self.notes,
        ]

    def _on_ranges(self):
        """Sentences on the flat range of each parameter."""
        lines: list[str] = []
        values = [value.estimate for _, value in self.searched]
        failures = sum(map(math.isnan, values))
        if is_nothing(self.value):
            words = self.quantity.replace("_", " ")
            return [f"{words} is 0 within its error at the optimum, {NOTHING}"]
        if any(
            math.isnan(parameter.flat_low + parameter.flat_high) for parameter in self.parameters
        ):
            lines.append(
                f"the runs are too short to show how flat the maximum is: {longer_runs(self.scene)}"
            )
        for parameter in self.parameters:
            if parameter.is_narrow:
                lines.append(
                    f"{parameter.axis.key}: more than {FLAT_SHARE:.0%} is lost within {NARROW:.0%} "
                    "of its range: the device needs a tight tolerance"
                )
            if parameter.open_low and parameter.open_high:
                lines.append(
                    f"{parameter.axis.key}: flat: in the whole range not significantly more than "
                    f"{FLAT_SHARE:.0%} below the maximum, so that all values of the range are "
                    f"equal within the errors; {longer_runs(self.scene)}, vary another parameter, "
                    "or give another range"
                )
                continue
            for end, is_open in (
                (parameter.axis.low, parameter.open_low),
                (parameter.axis.high, parameter.open_high),
            ):
                if is_open:
                    lines.append(
                        f"{parameter.axis.key}: still within {FLAT_SHARE:.0%} at the end of its "
                        f"range, {self._at(parameter.axis.key, end)}: the maximum may be beyond it"
                    )
        limit = self.scene.beam.strain_limit if self.scene.beam else None
        if failures:
            strained = "" if limit is None else ", or the strain is beyond beam.strain_limit"
            lines.append(f"at {failures} of {len(self.searched)} points no run completed{strained}")
        return lines

    def _on_orbits(self):
        """Sentences on the followed orbit, and the other orbits at the optimum."""
        if not self.orbits:
            return []
        scene, count = with_orbit(self.scene), sum(orbit.starts for orbit in self.orbits)
        return [
            f"of {count} random starts at the optimum: {on_orbits(scene, self.orbits)}",
            'run.orbit = "best" or "weighted", with run.starts = 16 or more, optimises the orbit '
            "with the most power, or the mean over starts",
        ]

    def _on_runs(self):
        """Sentence on the runs of an optimum over several parameters."""
        noisy = is_noisy(self.scene, method_of(self.method))
        accuracy = "no noise: the optimum has the method's precision"
        if noisy:
            accuracy = "value on independent noise; interval: two standard errors; seed "
            accuracy += str(self.scene.run.seed)
        return (
            f"{self.method}: {self.evaluations} evaluations, {len(self.searched)} of them proposed"
            f"; {accuracy}, {self.seconds:.1f} s"
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; for one parameter, averaging and simulation in parallel."""
        findings = self._side_by_side(self.averaging) if self.averaging else self._over_several()
        return plain(
            {
                "scene": self.scene,
                "maximised": self.quantity,
                **findings,
                **orbits_of(self.scene, self.orbits),
                "seed": self.scene.run.seed,
                "wall_seconds": self.seconds,
            }
        )

    def _side_by_side(self, averaging):
        location_deviation, value = self._off(averaging)
        (parameter,) = self.parameters
        return {
            "over": parameter.axis.key,
            "range": [parameter.axis.low, parameter.axis.high],
            "averaging": {
                **fields_of(averaging),
                "place_deviation": location_deviation,
                "value_deviation": value,
            },
            "simulation": {
                "method": self.method,
                "place": self.place,
                "interval": self.interval,
                "value": self.value,
                "fitted": [
                    {"place": values[parameter.axis.key], **mean.to_dict()}
                    for values, mean in self.searched
                ],
            },
        }

    def _over_several(self):
        return {
            "unit": self.unit,
            "method": self.method,
            "parameters": {
                parameter.axis.key: {
                    "range": [parameter.axis.low, parameter.axis.high],
                    "place": parameter.place,
                    "flat": [parameter.flat_low, parameter.flat_high],
                    "flat_beyond_range": [parameter.open_low, parameter.open_high],
                }
                for parameter in self.parameters
            },
            "flat_within": FLAT_SHARE,
            "value": {**self.value.to_dict(), "interval": self.interval},
            "scene_itself": self.own,
            "searched": [{**values, "value": mean.estimate} for values, mean in self.searched],
            "evaluations": self.evaluations,
            "notes": [*self.notes, *self._on_orbits()],
        }


def _draw(optimum):
    """Draw the searched points, the maximum, and its flat range.

    With several parameters the points also differ in the others, so only the upper envelope is
    meaningful.
    """
    panels = [_panel(optimum, parameter) for parameter in optimum.parameters]
    title = (
        f"{optimum.scene.name}: {len(optimum.searched)} points searched, by {optimum.method} "
        "(bars: two standard errors; hollow: none)"
    )
    return draw_panels(panels, title, size=(3.0, 2.4), sharey=True)


def _panel(optimum, parameter):
    key = parameter.axis.key
    factor, unit = prefixed(optimum.value.estimate, optimum.unit.split()[0])
    coordinates = [location[key] for location, _ in optimum.searched]
    searched = [value.times(factor) for _, value in optimum.searched]
    values = [value.estimate for value in searched]
    bars = [INTERVAL * (value.standard_error or 0.0) for value in searched]
    bare = [value.standard_error is None for value in searched]
    points = Series(
        coordinates, values, "searched", SEARCHED, "", "o", bars=bars, hollow=bare, size=3.0
    )
    top = optimum.value.times(factor)
    height = INTERVAL * (top.standard_error or 0.0)
    maximum = Series(
        x=[parameter.place],
        y=[top.estimate],
        label="maximum",
        colour=MAXIMUM,
        line="",
        marker="*",
        bars=[height],
        size=8.0,
    )
    x_label, x_unit = key_words(key, optimum.scene.units)
    return Panel(
        x_label=x_label,
        x_unit=x_unit,
        y_label=f"{optimum.quantity.replace('_', ' ')} [{unit or '1'}]",
        series=[points, maximum],
        log_x=parameter.axis.logarithmic,
        more=partial(_draw_bounds, optimum, parameter, factor),
    )


def _draw_bounds(optimum, parameter, factor, axes):
    """Draw the optimum's interval or flat region, and the value of the unchanged scene."""
    low, high, label = (
        parameter.flat_low,
        parameter.flat_high,
        f"within {FLAT_SHARE:.0%}, others constant",
    )
    if parameter.standard_error is not None:
        (low, high), label = optimum.interval, "interval of the optimum"
    if not math.isnan(low + high):
        axes.axvspan(low, high, color=MAXIMUM, alpha=0.15, lw=0, label=label)
    if optimum.own is not None:
        axes.axhline(
            factor * optimum.own.estimate, color=OWN, linestyle=":", label="unchanged scene"
        )
