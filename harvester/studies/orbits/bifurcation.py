"""`bifurcation`: stroboscopic sections of a driven device over any key, up and down.

Each point starts from the final state of the previous one, so that the device stays on its branch
while this exists.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base import formatting as numbers
from harvester.base.errors import HarvesterError, SimulationError
from harvester.base.formatting import prefixed, quantity, with_error
from harvester.base.plain_text import json_text
from harvester.base.tables import require_xarray
from harvester.engines.following import follow, forced
from harvester.engines.methods import Engine
from harvester.engines.task import Task, Wanted
from harvester.results.orbit import NO_PERIOD, REASONS, UNSTEADY
from harvester.results.palette import CIRCUIT, MONTE_CARLO
from harvester.results.panels import Panel, Series, draw_panels
from harvester.results.result import unit_of
from harvester.results.view import Picture, ResultBase, View
from harvester.scene.model import Scene
from harvester.scene.paths import start_state
from harvester.scene.prepared import Prepared
from harvester.scene.steps import step_error, susceptance
from harvester.scene.tables import key_column, key_label, key_words, value_words
from harvester.statistics.attractors import QUANTITIES, means_of
from harvester.statistics.estimate import Estimate
from harvester.statistics.stroboscope import STATE
from harvester.statistics.transient import memory_of
from harvester.studies.orbits.following import LONGER, SAMPLES, motion_of, periods_of

if TYPE_CHECKING:
    from xarray import Dataset

# Number of values in one task: an interrupted run loses at most this many.
PLACES_TOGETHER = 25
# A jump between two values: the section's mean or standard deviation changes by more than this
# share of its largest displacement, or the logarithm of the power by more than JUMP_OF_POWER. The
# change also exceeds JUMP_RATIO times the largest of the NEARBY changes on one side. Chaotic motion
# varies everywhere, and is therefore not a jump.
JUMP_SHARE, JUMP_OF_POWER, JUMP_RATIO, NEARBY = 0.1, 0.4, 4.0, 2
# Maximum number of values of one direction in the table; files contain all.
MOST_VALUES_SHOWN = 25
# Tables of a scene that do not affect the section, so that their keys cannot be varied.
UNUSED_TABLES = ("run", "start")
COLOURS = {"up": CIRCUIT, "down": MONTE_CARLO}


@dataclass(frozen=True)
class Jump:
    """A jump: two neighbouring values between which a sweep leaves its branch.

    Attributes
    ----------
    before, after
        The last value on the old branch and the first value on the new one.
    power_before, power_after
        Mean powers on both sides of the jump, in the scene's units.
    """

    direction: str
    before: float
    after: float
    power_before: float
    power_after: float


@dataclass(frozen=True)
class Branch:
    """One sweep direction; arrays over the values, in ascending order and in the scene's units.

    Attributes
    ----------
    direction : "up" or "down".
    displacement, velocity : ndarray, shape (n, samples)
        Section: samples at the starts of the last forcing periods; NaN if a run failed.
    period : ndarray of int, shape (n,)
        Period of the motion in forcing periods; 0 for an aperiodic motion.
    motion : "period 2", "no period", or the reason for the lack of a steady motion.
    mean_power, rms_voltage, rms_displacement : ndarray, shape (n,)
        NaN without a steady motion.
    errors : dict of str to ndarray, shape (n,)
        Errors of these means, as in `harvester.studies.orbits.following.Orbit`.
    """

    direction: str
    displacement: np.ndarray
    velocity: np.ndarray
    period: np.ndarray
    motion: list[str]
    mean_power: np.ndarray
    rms_voltage: np.ndarray
    rms_displacement: np.ndarray
    errors: dict[str, np.ndarray]


@dataclass(frozen=True, repr=False)
class Bifurcation(ResultBase):
    """Sections of a driven device over one key.

    Attributes
    ----------
    values : ndarray, shape (n,)
        Values in ascending order.
    branches
        The upward sweep, and the downward sweep unless omitted.
    periods
        Number of forcing periods at each value before the samples.
    failures : reasons of failed runs, by "up at VALUE".
    """

    scene: Scene
    key: str
    values: np.ndarray
    branches: list[Branch]
    jumps: list[Jump]
    method: str
    engine_version: str
    periods: int
    failures: dict[str, str]
    seconds: float

    def unit(self, dimension: str) -> str:
        """Unit of a dimension in this scene."""
        return unit_of(self.scene, dimension)

    def view(self) -> View:
        """Table, findings and pictures."""
        return View(
            self._table(),
            self._findings(),
            headline="; ".join(
                line for branch in self.branches for line in self._most_power(branch)
            ),
            pictures=[Picture(_draw, self)],
            records=self._records,
            keys=2,
            is_series=True,
            dataset=self._dataset,
        )

    def _table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows as text: a selection of the values, and both sides of each jump."""
        header, rows = self._records()
        ends = {(jump.direction, end) for jump in self.jumps for end in (jump.before, jump.after)}
        tabulated = {*self.values[:: self._every].tolist(), float(self.values[-1])}
        # Each quantity shares a column with its error.
        units = [self.unit(dimension) for dimension in QUANTITIES.values()]
        names = [name.replace("_", " ") for name in QUANTITIES]
        length = self.unit("displacement")
        head = [header[0], key_label(self.key, self.scene.units), header[2], *names]
        return [*head, "lowest of the section", "highest of the section"], [
            [
                *(row[0], numbers.written(row[1], ".6g"), row[2]),
                *(
                    with_error(Estimate(value, error, None, unit), unit)
                    for value, error, unit in zip(row[3:9:2], row[4:9:2], units, strict=True)
                ),
                *(quantity(extreme, length, 5) for extreme in row[9:]),
            ]
            for row in rows
            if row[1] in tabulated or tuple(row[:2]) in ends
        ]

    @property
    def _every(self):
        """Stride of the table: it shows every n-th value."""
        return math.ceil(self.values.size / MOST_VALUES_SHOWN)

    def _records(self) -> tuple[list[str], list[list[Any]]]:
        """Header and rows of numbers, in the scene's units."""
        header = ["direction", key_column(self.key, self.scene.units), "motion"]
        for name, dimension in QUANTITIES.items():
            words, unit = name.replace("_", " "), self.unit(dimension)
            header += [f"{words} [{unit}]", f"{words} standard error [{unit}]"]
        header += [f"{end} of the section [{self.unit('displacement')}]" for end in ("low", "high")]
        rows = []
        for branch in self.branches:
            for k, value in enumerate(self.values):
                section = branch.displacement[k]
                numbers = [
                    number for name in QUANTITIES
                    for number in (getattr(branch, name)[k], branch.errors[name][k])
                ]  # fmt: skip
                numbers += [section.min(), section.max()]
                rows.append(
                    [branch.direction, float(value), branch.motion[k], *map(float, numbers)]
                )
        return header, rows

    def _findings(self) -> list[str]:
        """Sentences on the findings, one line each."""
        lines = [
            f"{self.method}: {self.engine_version}; at each of {self.values.size} values "
            f"{self.periods} periods of the excitation, then {SAMPLES} samples, one per period; "
            f"{self.seconds:.2f} s"
        ]
        for branch in self.branches:
            lines += self._most_power(branch)
            for kind, reason in REASONS.items():
                where = self.values[[motion == kind for motion in branch.motion]]
                if where.size:
                    named = self._named(*where)
                    lines.append(f"{branch.direction}: {kind} at {named}: {reason}")
        lines.append(
            "each direction follows one motion; at the same value others may have more power: "
            "harvester basins lists them"
        )
        power = self.unit("power")
        lines += [
            f"{jump.direction}: jump between {self._named(jump.before, jump.after)}, "
            f"from {quantity(jump.power_before, power)} to {quantity(jump.power_after, power)}"
            for jump in self.jumps
        ]
        if self._every > 1:
            lines.append(
                f"the table shows one of every {self._every} values and both sides of each jump; "
                "data() and its CSV file contain all"
            )
        if self.scene.load.circuit and not self.scene.load.is_resistor:
            lines.append("at each value, a load's stores have the initial charges of its netlist")
        lines += [line for branch in self.branches for line in self._of_chaos(branch)]
        lines += [f"{location}: {why}" for location, why in self.failures.items()]
        return lines

    def _most_power(self, branch):
        """Sentence on the point with the largest power; empty if no motion has a power."""
        if not np.isfinite(branch.mean_power).any():
            return []
        best = int(np.nanargmax(branch.mean_power))
        power, error = branch.mean_power[best], branch.errors["mean_power"][best]
        most = with_error(Estimate(power, error, None, "power"), self.unit("power"))
        where = self._named(self.values[best])
        return [f"{branch.direction}: largest power, {most}, at {where} ({branch.motion[best]})"]

    def _named(self, *values):
        """The key and some of its values with units, as text."""
        words = (value_words(self.key, float(value), self.scene.units) for value in values)
        return f"{self.key} = {', '.join(words)}"

    def _of_chaos(self, branch):
        """Sentence on values at which the mean of an aperiodic motion has no error bar."""
        missing = np.isfinite(branch.mean_power) & np.isnan(branch.errors["mean_power"])
        return [
            f"{branch.direction}: no error bar at {self._named(*self.values[missing])}: the power "
            f"varies too slowly for {SAMPLES} periods; `basins` at this value averages over many "
            "starts"
        ] * bool(missing.any())

    def _dataset(self) -> Dataset:
        """The sections and means as an xarray Dataset over direction, value and sample.

        Values are in the scene's units. Each mean has a variable `…_standard_error`; the attribute
        `unit` is the unit.
        """
        axes, branches = ("direction", self.key), self.branches
        variables: dict[str, Any] = {"period": (axes, [branch.period for branch in branches])}
        for name, dimension in QUANTITIES.items():
            unit = {"unit": self.unit(dimension)}
            variables[name] = (axes, [getattr(branch, name) for branch in branches], unit)
            errors = [branch.errors[name] for branch in branches]
            variables[f"{name}_standard_error"] = (axes, errors, unit)
        for name in ("displacement", "velocity"):
            section = [getattr(branch, name) for branch in branches]
            variables[name] = ((*axes, "sample"), section, {"unit": self.unit(name)})
        directions = [branch.direction for branch in self.branches]
        attributes = {"scene": json_text(self.scene.to_dict()), "method": self.method}
        coordinates = {"direction": directions, self.key: self.values}
        return require_xarray().Dataset(variables, coordinates, attributes)


def climb(
    prepared_scene: Prepared,
    key: str,
    values: list,
    engine: str,
    step: str | float,
    start: list | None,
    periods: int,
    report: Callable,
    settings: dict[str, Any] | None = None,
    longer: int = 1,
) -> dict[str, Any]:
    """Simulate consecutive values, each from the final state of the previous one, in a worker.

    Parameters
    ----------
    engine, step, settings
        The engine's name, its step, and its non-default options.
    start : list or None
        Displacement, velocity and the transducer's state in the scene's units; None: the scene's.
    periods
        Number of forcing periods before the samples.
    longer
        A value with an aperiodic motion is followed further for this multiple of the periods.

    Returns
    -------
    dict
        `rows`, shape (values, SAMPLES + 1, columns), in the scene's units; `end`, the final state;
        `failures`, the reasons by the index of the point.
    """
    rows, failures = [], {}

    def reached(number: int, share: float) -> None:
        report((number + share) / len(values))

    for number, value in enumerate(values):
        driven = forced(prepared_scene.scene.replace({key: value}), "bifurcation")
        power, length = driven.scales.of("power"), driven.scales.of("displacement")
        # Displacement, velocity and the transducer's state of one scaled unit.
        units = np.array([length, length, driven.scene.transducer.state_unit(driven.setting)])
        begin = start_state(prepared_scene, 0) if start is None else np.array(start) / units
        try:
            for times in (1, longer):
                samples = follow(
                    driven, engine, step, [list(begin)], times * (periods + SAMPLES), SAMPLES,
                    partial(reached, number), settings,
                )[0]  # fmt: skip
                if times == longer or motion_of(driven, samples)[1] != NO_PERIOD:
                    break
                if driven.scene.load.is_resistor:
                    begin = samples[-1, :STATE]
        except SimulationError as error:
            failures[str(number)] = str(error)
            samples = np.full((SAMPLES + 1, STATE + 3), np.nan)
        if np.isfinite(samples).all():
            start = (samples[-1, :STATE] * units).tolist()
        scales = [*units, power, driven.scales.of("voltage") ** 2, length**2]
        rows.append(samples * scales)
    return {"rows": np.array(rows), "end": start, "failures": failures}


def climbing(
    scene: Scene,
    key: str,
    values: np.ndarray,
    engine: Engine,
    version: str,
    periods: int | None,
    directions: Sequence[str],
) -> Generator[Wanted, list, Any]:
    """Generator for `Runner.follow`: sweep in each direction, several points per task.

    Returns the Branch of each direction and the failures; None if the time budget was spent. Each
    direction starts where the previous one ended. `periods` None: as many as the device needs, and
    more if no period is found.
    """
    start, branches, failures, scenes = None, [], {}, scenes_over(scene, key, values)
    for number, direction in enumerate(directions):
        ordered, rows = values if direction == "up" else values[::-1], []
        for first in range(0, ordered.size, PLACES_TOGETHER):
            some = ordered[first : first + PLACES_TOGETHER]
            arguments = {
                "scene": scene,
                "key": key,
                "values": some.tolist(),
                **engine.as_arguments("engine"),
                "start": start,
                "periods": periods or max(periods_of(driven) for driven in scenes),
                "longer": 1 if periods else LONGER**2,
            }
            task = Task(climb, arguments, version, engine.name, some.size)
            ahead = ordered.size * (len(directions) - number) - first
            (answer,) = yield Wanted([task], ahead / PLACES_TOGETHER)
            if answer is None or isinstance(answer, HarvesterError):
                return answer
            rows.append(answer["rows"])
            start = answer["end"]
            for index, why in answer["failures"].items():
                failures[f"{direction} at {some[int(index)]:g}"] = why
        samples = np.concatenate(rows)
        samples = samples if direction == "up" else samples[::-1]
        branches.append(_branch(scenes, engine, direction, samples))
    return branches, failures


def _branch(scenes, engine, direction, samples):
    """The branch of one sweep direction, from samples in the scenes' units."""
    periods, motions = np.zeros(len(samples), dtype=int), []
    values = np.full((len(samples), 2, len(QUANTITIES)), np.nan)
    for k, driven in enumerate(scenes):
        # The tolerance is relative to the section: one motion may be a hundredth of another.
        period, motion = motion_of(driven, samples[k])
        motions.append(motion)
        if motion not in UNSTEADY:
            seconds = float(driven.scene.excitation.period)
            steps, memory = step_error(driven, engine.step, engine.name), memory_of(driven)
            per_square = driven.scales.of("power") / driven.scales.of("voltage") ** 2
            reactive = susceptance(driven) * per_square
            values[k] = means_of(samples[k : k + 1], seconds, steps, memory, reactive)
            periods[k] = period
    means, errors = values.transpose(1, 2, 0)
    section = np.where(np.isfinite(samples), samples, np.nan)[:, 1:, :2]
    return Branch(
        direction,
        section[:, :, 0],
        section[:, :, 1],
        periods,
        motions,
        **dict(zip(QUANTITIES, means, strict=True)),
        errors=dict(zip(QUANTITIES, errors, strict=True)),
    )


def jumps_of(values: np.ndarray, branch: Branch) -> list[Jump]:
    """Jumps of section or power between neighbouring values.

    A jump is a change that is far larger than the neighbouring changes.
    """
    section = branch.displacement
    size = float(np.nanmax(np.abs(section), initial=0.0)) or 1.0
    shape = np.stack([section.mean(axis=1), section.std(axis=1)])
    moved = np.abs(np.diff(shape, axis=1)).max(axis=0) / size
    power = np.where(branch.mean_power > 0.0, branch.mean_power, np.nan)
    grown = np.abs(np.diff(np.log(power)))
    jumps = []
    for k in range(values.size - 1):
        # Aperiodic sections differ because they sample different parts of the motion.
        if branch.period[k] == 0 and branch.period[k + 1] == 0:
            continue
        if _stands_out(moved, k, JUMP_SHARE) or _stands_out(grown, k, JUMP_OF_POWER):
            ends = (k, k + 1) if branch.direction == "up" else (k + 1, k)
            before, after = (float(values[end]) for end in ends)
            powers = (float(branch.mean_power[end]) for end in ends)
            jumps.append(Jump(branch.direction, before, after, *powers))
    return jumps


def _stands_out(change, k, least):
    """Whether a change exceeds `least`, and is far larger than those on one side of it."""
    sides = change[max(k - NEARBY, 0) : k], change[k + 1 : k + 1 + NEARBY]
    # Next to a value without a steady motion there is no change to compare with.
    nearby = [float(np.nanmax(changes)) for changes in sides if np.isfinite(changes).any()]
    return change[k] > least and not (nearby and change[k] < JUMP_RATIO * min(nearby))


def _draw(result):
    """Draw the section and the mean power over the key."""
    section, power = [], []
    top = max(np.nanmax(branch.mean_power, initial=0.0) for branch in result.branches)
    factor, unit = prefixed(top, result.unit("power"))
    # Many values need small markers, few values large ones.
    largest = min(max(1.0, MOST_VALUES_SHOWN / result.values.size), 4.0)
    for branch in result.branches:
        size = largest * (1.0 if branch.direction == "up" else 0.6)
        colour = COLOURS[branch.direction]
        x = np.repeat(result.values, branch.displacement.shape[1])
        section.append(Series(x, branch.displacement.ravel(), None, colour, "", ".", size=size))
        y = factor * branch.mean_power
        bars = 2.0 * factor * branch.errors["mean_power"]
        power.append(Series(result.values, y, branch.direction, colour, "-", bars=bars))
    label, x_unit = key_words(result.key, result.scene.units)
    displacement = f"displacement [{result.unit('displacement')}]"
    panels = [
        Panel(label, displacement, section, x_unit=x_unit),
        Panel(label, f"mean power [{unit}]", power, from_zero=True, x_unit=x_unit),
    ]
    title = f"{result.scene.name}: one sample per period of the excitation, and the mean power "
    title += "(bars: two errors)"
    return draw_panels(panels, title, size=(4.4, 3.2), columns=1, sharex=True)


def scenes_over(scene: Scene, key: str, values: np.ndarray) -> list[Prepared]:
    """The prepared scene at each value, checked before any run."""
    table = key.partition(".")[0]
    if table in UNUSED_TABLES:
        raise HarvesterError(
            f"--over {key}: --periods sets the length, and each run starts where the previous one "
            f"ended, so [{table}] has no effect; name a key of another table"
        )
    # This check comes first: without a periodic excitation the key may not exist.
    forced(scene, "bifurcation")
    return [forced(scene.replace({key: float(value)}), "bifurcation") for value in values]
