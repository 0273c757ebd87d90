"""Where several parameters together make a quantity largest.

Proposals of a library for noisy functions are evaluated on common noise; the highest are run again
on fresh noise, as the highest of many is partly luck; from the best of them the search climbs along
the axes, which also tells how flat the maximum is; its value comes from a last run on noise that
nothing was chosen by.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from harvester.errors import HarvesterError, OptimumError
from harvester.estimates.estimate import Estimate
from harvester.estimates.units import unit_of
from harvester.files.writing import finite
from harvester.results.result import with_error
from harvester.running import Request, RunnerOptions, open_runner
from harvester.scene.model import Scene
from harvester.simulation.methods import ENGINES
from harvester.studies.axis import Axis
from harvester.studies.flat_region import FLAT_SHARE, NARROW, climb, ranges
from harvester.studies.objective import (
    Objective,
    check_quantity,
    checked_method,
    first_answer,
    is_noisy,
    missing_from,
)
from harvester.studies.proposals import BATCH, Proposals

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Proposals for each parameter, unless told otherwise.
EVALUATIONS_EACH = 60
FEWEST_EVALUATIONS, MOST_EVALUATIONS = 16, 100_000
MOST_PARAMETERS = 8
# Places that are run again on fresh noise.
CONFIRMED = 5
# About how many evaluations the climb takes for each parameter: for the time left.
CLIMB_EACH = 30
# Noise of the search, of the places chosen again, and of the value.
SEARCH, AGAIN, VALUE = 0, 1, 2
# Other states in which a device without chance is started at the maximum.
STARTS = 8
# Standard errors to either side of the value that make its interval.
INTERVAL = 2.0
# How a caller writes what is varied.
OVER = 'over={"load.resistance": (1e4, 1e6)}'


@dataclass(frozen=True)
class OptimumOfSeveral:
    """Where several parameters make a quantity largest; in the scene's units.

    Attributes
    ----------
    scene : Scene
    quantity, unit, method : str
    ranges : list of Range
    value : Estimate
        From a run at the place on noise of its own.
    own : Estimate
        Of the scene itself.
    other_starts : tuple of float
        Values at the place from other states, where the excitation has no chance in it.
    searched : list of (dict, float)
        Places proposed and their values, nan where a run failed.
    evaluations : int
        Runs in all.
    seconds : float
        Wall-clock, of this call.
    """

    scene: Scene
    quantity: str
    unit: str
    method: str
    ranges: list
    value: Estimate
    own: Estimate
    other_starts: tuple
    searched: list
    evaluations: int
    seconds: float = 0.0

    @property
    def interval(self) -> tuple:
        """Of the value: two standard errors to either side; nan where there is no error bar."""
        error = self.value.standard_error
        reach = INTERVAL * (math.nan if error is None else error)
        return self.value.estimate - reach, self.value.estimate + reach

    @property
    def keys(self) -> list[str]:
        """The parameters."""
        return [each.axis.key for each in self.ranges]

    def table(self) -> tuple:
        """Header and rows of the table, as text."""
        header = ["parameter", "range", "optimum at", f"within {FLAT_SHARE:.0%} of the maximum"]
        return header, [
            [
                each.axis.key,
                f"{each.axis.low:.4g} … {each.axis.high:.4g}",
                f"{each.place:.4g}",
                "—"
                if math.isnan(each.flat_low + each.flat_high)
                else f"{each.flat_low:.4g} … {each.flat_high:.4g}",
            ]
            for each in self.ranges
        ]

    def sentences(self) -> list:
        """The value, what bounds the place, and what was run."""
        low, high = self.interval
        interval = f", interval {low:.4g} … {high:.4g}" if math.isfinite(low) else ""
        name = self.quantity.replace("_", " ")
        lines = [
            f"{name} there: {with_error(self.value)}{interval}, {self.unit}; of the scene itself "
            f"{with_error(self.own)}",
            *missing_from(self.quantity, self.value),
        ]
        if any(math.isnan(each.flat_low + each.flat_high) for each in self.ranges):
            lines.append(
                "the runs are too short to tell how flat the maximum is: raise run.duration or "
                "run.realizations"
            )
        for each in self.ranges:
            if each.is_narrow:
                lines.append(
                    f"{each.axis.key}: more than {FLAT_SHARE:.0%} is lost within {NARROW:.0%} of "
                    "its range: a device must hold the value closely"
                )
            for end, is_open in ((each.axis.low, each.open_low), (each.axis.high, each.open_high)):
                if is_open:
                    lines.append(
                        f"{each.axis.key}: still within {FLAT_SHARE:.0%} at the end of its range, "
                        f"{end:.4g}: there may be more beyond"
                    )
        failures = sum(math.isnan(value) for _, value in self.searched)
        if failures:
            lines.append(f"at {failures} of {len(self.searched)} places no run came to its end")
        lines += self._on_starts()
        own_noise = "; value on noise of its own" if is_noisy(self.scene, self.method) else ""
        lines.append(
            f"{self.method}: {self.evaluations} evaluations, {len(self.searched)} of them proposed"
            f"{own_noise}; interval: two standard errors; seed {self.scene.run.seed}, "
            f"{self.seconds:.1f} s"
        )
        return lines

    def _on_starts(self):
        """Whether what was found depends on the state that a device starts in."""
        if not self.other_starts:
            return []
        values = np.array(self.other_starts)
        off = np.abs(values - self.value.estimate)
        others = values[off > FLAT_SHARE * abs(self.value.estimate)]
        states = f"{values.size} other states"
        if not others.size:
            return [f"started there from each of {states} it comes to the same: one attractor"]
        return [
            f"several attractors: started there from {values.size - others.size} of {states} it "
            f"comes to the same, from the others to {others.min():.4g} … {others.max():.4g}; the "
            "search starts every run as the scene does: other values of [start] may find another "
            "branch"
        ]

    def figure(self) -> Figure:
        """Every place proposed over each parameter, the maximum, and how far it is flat."""
        from harvester.show import figures
        from harvester.studies.optimum_drawing import draw

        return figures.drawn(draw, self)

    def to_dict(self) -> dict:
        """Plain values for JSON."""
        return {
            "scene": self.scene.to_dict(),
            "maximised": self.quantity,
            "unit": self.unit,
            "method": self.method,
            "parameters": {
                each.axis.key: {
                    "range": [each.axis.low, each.axis.high],
                    "place": each.place,
                    "flat": [finite(each.flat_low), finite(each.flat_high)],
                    "flat_beyond_range": [each.open_low, each.open_high],
                }
                for each in self.ranges
            },
            "flat_within": FLAT_SHARE,
            "value": self.value.to_dict() | {"interval": [finite(end) for end in self.interval]},
            "scene_itself": self.own.to_dict(),
            "other_starts": [finite(value) for value in self.other_starts],
            "searched": [{**place, "value": finite(value)} for place, value in self.searched],
            "evaluations": self.evaluations,
            "seed": self.scene.run.seed,
            "notes": self._on_starts(),
            "wall_seconds": self.seconds,
        }


def largest_over_several(
    scene: Scene,
    over: Mapping[str, tuple | None],
    maximise: str,
    method: str | None,
    evaluations: int | None,
    precision: float | None,
    running: RunnerOptions,
) -> OptimumOfSeveral:
    """Where several parameters together make a quantity largest: see `harvester.optimum`."""
    clock = time.perf_counter()
    axes = [Axis.of(scene, key, *(ends or (None, None))) for key, ends in over.items()]
    method = checked_method(scene, method)
    count = EVALUATIONS_EACH * len(axes) if evaluations is None else evaluations
    if not FEWEST_EVALUATIONS <= count <= MOST_EVALUATIONS:
        raise HarvesterError(
            f"--evaluations {count}: must be a whole number, {FEWEST_EVALUATIONS} to "
            f"{MOST_EVALUATIONS}"
        )
    if len(axes) > MOST_PARAMETERS:
        raise HarvesterError(f"--over: at most {MOST_PARAMETERS} parameters at a time")

    progress = running.pop("progress", None)

    def follow(done):
        if progress:
            expected = count + CONFIRMED + CLIMB_EACH * len(axes)
            progress(min(done / expected, 0.99), f"{done} evaluations")

    with open_runner(**running) as opened:
        objective = Objective(scene, axes, maximise, method, opened, follow)
        found = _found(scene, objective, count, precision, opened)
    return replace(found, seconds=time.perf_counter() - clock)


def _found(scene, objective, count, precision, runner):
    """All of an `OptimumOfSeveral` but its time."""
    quantity, method = objective.quantity, objective.method
    own = first_answer(runner, Request(scene, method))
    check_quantity(quantity, own)
    proposals = Proposals(len(objective.axes), scene.run.seed, _own_place(scene, objective.axes))
    searched = _search(objective, proposals, count)
    place = _chosen(objective, searched)
    place, answer, sides = climb(objective, place, AGAIN if objective.noisy else SEARCH)
    if objective.noisy:
        options = {"precision": precision, "quantities": (quantity,)}
        (answer,) = objective.answers([place], VALUE, **options)
        if isinstance(answer, HarvesterError):
            raise answer
    return OptimumOfSeveral(
        scene=scene,
        quantity=quantity,
        unit=unit_of(scene, answer.quantities[quantity].dimension),
        method=method,
        ranges=ranges(objective.axes, place, sides),
        value=answer.in_units()[quantity],
        own=own.in_units()[quantity],
        other_starts=_other_starts(objective, place, answer),
        searched=[(objective.values_at(each), value) for each, value in searched],
        evaluations=objective.evaluated,
    )


def _own_place(scene, axes):
    """The scene's own, if it lies within the ranges."""
    tables = [(axis, axis.own(scene)) for axis in axes]
    if not all(axis.low <= value <= axis.high for axis, value in tables):
        return None
    return [axis.coordinate(value) for axis, value in tables]


def _search(objective, proposals, count):
    """Places proposed and their values."""
    searched = []
    while len(searched) < count:
        places = proposals.ask(min(BATCH, count - len(searched)))
        values = [objective.value(answer) for answer in objective.answers(places)]
        proposals.tell([finite(value) for value in values])
        searched += zip(places, values, strict=True)
    if all(math.isnan(value) for _, value in searched):
        raise OptimumError(f"at none of {len(searched)} places did a run come to its end")
    return searched


def _chosen(objective, searched):
    """The highest place; under noise the highest of the best ones on fresh noise."""
    ended = [each for each in searched if not math.isnan(each[1])]
    highest = [place for place, _ in sorted(ended, key=lambda each: -each[1])]
    if not objective.noisy:
        return highest[0]
    places = list(dict.fromkeys(highest))[:CONFIRMED]
    values = [objective.value(each) for each in objective.answers(places, AGAIN, moments=True)]
    if all(math.isnan(value) for value in values):
        raise OptimumError("at none of the highest places did a second run come to its end")
    return places[int(np.nanargmax(values))]


def _other_starts(objective, place, answer):
    """Values from states drawn over what the motion at the maximum spans, and half as far again."""
    if objective.noisy or objective.method not in ENGINES:
        return ()
    if objective.scene.excitation.prescribes_displacement:
        return ()
    means = answer.in_units()
    reach = [
        1.5 * math.sqrt(2.0 * means[name].estimate)
        for name in ("mean_square_displacement", "mean_square_velocity")
    ]
    words = np.random.SeedSequence(objective.scene.run.seed, spawn_key=(VALUE, 1))
    states = np.random.default_rng(words).uniform(-1.0, 1.0, size=(STARTS, 2)) * reach
    changes = [{"start.displacement": float(x), "start.velocity": float(v)} for x, v in states]
    values = [objective.value(each) for each in objective.answers_with(place, changes)]
    return tuple(value for value in values if not math.isnan(value))
