"""`bifurcation`: stroboscopic sections of a driven device over any key, up and down.

Each place begins where the one before it ended, so that the device keeps its branch for as long as
there is one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.errors import HarvesterError, SimulationError
from harvester.estimates.attractors import repetition
from harvester.files.plain_text import json_text
from harvester.files.serialising import plain
from harvester.files.tables import xarray_or_say
from harvester.prepared.paths import start_state
from harvester.prepared.prepared import prepared
from harvester.record.stroboscope import STATE
from harvester.results.result import unit_of
from harvester.running.task import Task, Wanted
from harvester.scene.model import Scene
from harvester.show.numbers import prefixed, quantity
from harvester.show.palette import CIRCUIT, MONTE_CARLO
from harvester.show.panels import Panel, Series, draw_panels
from harvester.show.symbols import key_label
from harvester.simulation.following import follow, forced
from harvester.studies.orbits.following import SAMPLES, periods_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset

    from harvester.simulation.methods import Engine

# Number of values in one task: a killed run loses at most this many.
PLACES_TOGETHER = 25
# The section jumps between two values if its mean or deviation changes by more than this share of
# its greatest displacement, and by more than this multiple of the largest of the next two changes
# before or behind, whichever is less. Chaos changes everywhere and so is no jump.
JUMP_SHARE, JUMP_RATIO, NEARBY = 0.1, 4.0, 2
# Most values of one direction that the table shows; files hold all.
MOST_VALUES_SHOWN = 25
# Tables of a scene that do not affect the section, so their keys cannot be varied.
UNUSED_TABLES = ("run", "start")
COLOURS = {"up": CIRCUIT, "down": MONTE_CARLO}
QUANTITIES = {"mean_power": "power", "rms_voltage": "voltage", "rms_displacement": "displacement"}


@dataclass(frozen=True)
class Jump:
    """A jump: two neighbouring values between which one direction leaves its branch.

    Attributes
    ----------
    direction : str
    before, after : float
        The last value on the old branch and the first on the new one.
    power_before, power_after : float
        Mean powers on both sides of the jump, in the scene's units.
    """

    direction: str
    before: float
    after: float
    power_before: float
    power_after: float


@dataclass(frozen=True)
class Branch:
    """One direction; arrays over the values, in rising order and the scene's units.

    Attributes
    ----------
    direction : str
        "up" or "down".
    displacement, velocity : ndarray, shape (n, samples)
        Section: samples at the beginnings of the last forcing periods; NaN where a run failed.
    period : ndarray of int, shape (n,)
        Period of the motion in forcing periods; 0 if it does not repeat itself.
    mean_power, rms_voltage, rms_displacement : ndarray, shape (n,)
    """

    direction: str
    displacement: np.ndarray
    velocity: np.ndarray
    period: np.ndarray
    mean_power: np.ndarray
    rms_voltage: np.ndarray
    rms_displacement: np.ndarray


@dataclass(frozen=True)
class Bifurcation:
    """Sections of a driven device over one key.

    Attributes
    ----------
    scene : Scene
    key : str
    values : ndarray, shape (n,)
        Rising.
    branches : list of Branch
        Up, and down unless it was left out.
    jumps : list of Jump
    method, engine_version : str
    periods : int
        Number of forcing periods at each value before the samples.
    failures : dict of str to str
        "up at VALUE" to why the run failed.
    seconds : float
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

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows, as text; of many values some, and both sides of each jump."""
        header, rows = self.data()
        ends = {(each.direction, end) for each in self.jumps for end in (each.before, each.after)}
        shown = {*self.values[:: self._every].tolist(), float(self.values[-1])}
        return header, [
            [row[0], f"{row[1]:.6g}", row[2], *map(_text, row[3:])]
            for row in rows
            if row[1] in shown or tuple(row[:2]) in ends
        ]

    @property
    def _every(self):
        """Stride of the table: it shows every n-th value."""
        return math.ceil(self.values.size / MOST_VALUES_SHOWN)

    def data(self) -> tuple[list[str], list[list[Any]]]:
        """Header and rows of numbers, in the scene's units."""
        header = ["direction", self.key, "motion"]
        header += [
            f"{name.replace('_', ' ')} [{self.unit(each)}]" for name, each in QUANTITIES.items()
        ]
        header += [f"{end} of the section [{self.unit('displacement')}]" for end in ("low", "high")]
        rows = []
        for branch in self.branches:
            for k, value in enumerate(self.values):
                section = branch.displacement[k]
                numbers = [getattr(branch, name)[k] for name in QUANTITIES]
                numbers += [section.min(), section.max()]
                rows.append(
                    [
                        branch.direction,
                        float(value),
                        _motion(branch.period[k]),
                        *map(float, numbers),
                    ]
                )
        return header, rows

    def sentences(self) -> list[str]:
        """Sentences on the findings, one line each."""
        lines = [
            f"{self.method}: {self.engine_version}; at each of {self.values.size} values "
            f"{self.periods} periods of the excitation, then {SAMPLES} samples, one a period; "
            f"{self.seconds:.2f} s"
        ]
        for branch in self.branches:
            if np.isfinite(branch.mean_power).any():
                best = int(np.nanargmax(branch.mean_power))
                most = quantity(branch.mean_power[best], self.unit("power"))
                lines.append(
                    f"{branch.direction}: most power, {most}, at {self.key} = "
                    f"{self.values[best]:.6g} "
                    f"({_motion(branch.period[best])})"
                )
        power = self.unit("power")
        lines += [
            f"{each.direction}: jump between {self.key} = {each.before:.6g} and {each.after:.6g}, "
            f"from {quantity(each.power_before, power)} to {quantity(each.power_after, power)}"
            for each in self.jumps
        ]
        if self._every > 1:
            lines.append(
                f"the table has one of {self._every} values and both sides of each jump; the CSV "
                "file that --output writes has all"
            )
        if self.scene.load.circuit and not self.scene.load.is_resistor:
            lines.append("a load's own stores begin at each place as its netlist says")
        lines += [f"{place}: {why}" for place, why in self.failures.items()]
        return lines

    def figure(self) -> Figure:
        """The section and the mean power over the key."""
        from harvester.show import figures

        return figures.drawn(_draw, self)

    def to_xarray(self) -> Dataset:
        """An xarray Dataset over direction, value and sample, in the scene's units."""
        variables: dict[str, Any] = {
            name: (("direction", self.key), [getattr(each, name) for each in self.branches])
            for name in (*QUANTITIES, "period")
        }
        for name in ("displacement", "velocity"):
            section = [getattr(each, name) for each in self.branches]
            variables[name] = (("direction", self.key, "sample"), section)
        directions = [each.direction for each in self.branches]
        attributes = {"scene": json_text(self.scene.to_dict()), "method": self.method}
        coordinates = {"direction": directions, self.key: self.values}
        return xarray_or_say().Dataset(variables, coordinates, attributes)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, in the scene's units."""
        return plain({name: value for name, value in vars(self).items()})


def _text(value):
    return f"{value:.5g}"


def _motion(period):
    return f"period {period}" if period > 0 else "no period"


def climb(
    scene: Scene,
    key: str,
    values: list,
    engine: str,
    step: str | float,
    start: list | None,
    periods: int,
    report: Callable,
    settings: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Values one after another, each from where the last ended; in a worker process.

    Parameters
    ----------
    scene : Scene
    key : str
    values : list of float
    engine, step, settings
        The engine's name, its step, and those of its options that differ from the defaults.
    start : list or None
        Displacement, velocity and the transducer's state in the scene's units; None: the scene's.
    periods : int
        Before the samples.

    Returns
    -------
    dict
        `rows`, shape (values, SAMPLES + 1, columns), in the scene's units; `end` to go on from;
        `failures`, the reasons by the number of the place.
    """
    rows, failures = [], {}
    for number, value in enumerate(values):
        place = forced(scene.replace({key: value}), "bifurcation")
        ready = prepared(place)
        units = _state_units(ready)
        begin = start_state(prepared(scene), 0) if start is None else np.array(start) / units
        try:
            samples = follow(
                place, engine, step, [list(begin)], periods + SAMPLES, SAMPLES, report, settings
            )[0]
        except SimulationError as error:
            failures[str(number)] = str(error)
            samples = np.full((SAMPLES + 1, STATE + 3), np.nan)
        else:
            start = (samples[-1, :STATE] * units).tolist()
        power, length = ready.scales.of("power"), ready.scales.of("displacement")
        scales = [*units, power, ready.scales.of("voltage") ** 2, length**2]
        rows.append(samples * scales)
    return {"rows": np.array(rows), "end": start, "failures": failures}


def _state_units(ready):
    """Displacement, velocity and the transducer's state of one scaled unit."""
    length = ready.scales.displacement
    return np.array([length, length, ready.scene.transducer.state_unit(ready.setting)])


def climbing(
    scene: Scene,
    key: str,
    values: np.ndarray,
    engine: Engine,
    version: str,
    periods: int,
    direction: str,
) -> Generator[Wanted, list, Any]:
    """A plan for `Runner.follow`: one direction, some places in a task; its Branch and failures.

    None where the time was spent.
    """
    ordered = values if direction == "up" else values[::-1]
    start, rows, failures = None, [], {}
    for first in range(0, ordered.size, PLACES_TOGETHER):
        some = ordered[first : first + PLACES_TOGETHER]
        arguments = {
            "scene": scene,
            "key": key,
            "values": some.tolist(),
            **engine.as_arguments("engine"),
            "start": start,
            "periods": periods,
        }
        task = Task(climb, arguments, version, f"{engine.name} {direction}", some.size)
        (answer,) = yield Wanted([task], (ordered.size - first) / PLACES_TOGETHER)
        if answer is None or isinstance(answer, HarvesterError):
            return answer
        rows.append(answer["rows"])
        start = answer["end"]
        for number, why in answer["failures"].items():
            failures[f"{direction} at {some[int(number)]:g}"] = why
    samples = np.concatenate(rows)
    if direction == "down":
        samples = samples[::-1]
    return _branch(scene, key, values, direction, samples), failures


def _branch(scene, key, values, direction, samples):
    found = samples[:, :, :STATE]
    finite = ~np.isnan(found).any(axis=(1, 2))
    periods = np.zeros(len(samples), dtype=int)
    for k in np.flatnonzero(finite):
        # Each section is compared with its own size: one motion may be a hundredth of another's.
        periods[k] = int(repetition(found[k : k + 1])[0])
    whole = np.array([SAMPLES // max(p, 1) * max(p, 1) for p in periods])
    lasting = np.array(
        [
            float(_period_at(scene, key, value)) * count
            for value, count in zip(values, whole, strict=True)
        ]
    )
    ends = samples[:, -1, STATE:]
    begins = samples[np.arange(len(samples)), SAMPLES - whole, STATE:]
    power, voltage, displacement = ((ends - begins) / lasting[:, None]).T
    return Branch(
        direction,
        found[:, 1:, 0],
        found[:, 1:, 1],
        periods,
        power,
        np.sqrt(voltage),
        np.sqrt(displacement),
    )


def _period_at(scene, key, value):
    return scene.replace({key: value}).excitation.period


def jumps_of(values: np.ndarray, branch: Branch) -> list[Jump]:
    """Jumps of the section between neighbouring values: changes far larger than those next
    to them."""
    section = branch.displacement
    size = float(np.nanmax(np.abs(section), initial=0.0))
    shape = np.stack([section.mean(axis=1), section.std(axis=1)])
    change = np.abs(np.diff(shape, axis=1)).max(axis=0)
    found = []
    for k in np.flatnonzero(change > JUMP_SHARE * size):
        sides = change[max(k - NEARBY, 0) : k], change[k + 1 : k + 1 + NEARBY]
        nearby = [float(each.max()) for each in sides if each.size]
        # Sections without a period differ because they sample different parts of the motion.
        wandering = branch.period[k] == 0 and branch.period[k + 1] == 0
        if wandering or (nearby and change[k] < JUMP_RATIO * np.nanmin(nearby)):
            continue
        ends = (k, k + 1) if branch.direction == "up" else (k + 1, k)
        before, after = (float(values[each]) for each in ends)
        powers = (float(branch.mean_power[each]) for each in ends)
        found.append(Jump(branch.direction, before, after, *powers))
    return found


def settling_periods(scenes: list[Scene]) -> int:
    """Forcing periods before the samples: those of the place that forgets most slowly."""
    return max(periods_of(each) for each in scenes)


def _draw(result):
    """Section over the key, and mean power."""
    section, power = [], []
    top = max(np.nanmax(branch.mean_power, initial=0.0) for branch in result.branches)
    factor, unit = prefixed(top, result.unit("power"))
    for branch in result.branches:
        colour, size = COLOURS[branch.direction], 1.0 if branch.direction == "up" else 0.6
        x = np.repeat(result.values, branch.displacement.shape[1])
        section.append(Series(x, branch.displacement.ravel(), None, colour, "", ".", size=size))
        y = factor * branch.mean_power
        power.append(Series(result.values, y, branch.direction, colour, "-"))
    label = key_label(result.key, result.scene.units)
    panels = [
        Panel(label, f"displacement [{result.unit('displacement')}]", section),
        Panel(label, f"mean power [{unit}]", power, from_zero=True),
    ]
    title = f"{result.scene.name}: one sample a period of the excitation, and the mean power"
    return draw_panels(panels, title, size=(4.4, 3.2), columns=1, sharex=True)


def scenes_over(scene: Scene, key: str, values: np.ndarray) -> list[Scene]:
    """The scene at each value, checked before anything runs.

    Raises
    ------
    HarvesterError
    """
    table = key.partition(".")[0]
    if table in UNUSED_TABLES:
        raise HarvesterError(
            f"--over {key}: bifurcation takes its length from --periods and each start from the "
            f"value before: nothing in [{table}] changes its result; name a key of another table"
        )
    return [forced(scene.replace({key: float(each)}), "bifurcation") for each in values]
