"""`residence`: how long noise leaves a device in a well, beside Kramers' formula."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.device import timescales
from harvester.errors import HarvesterError
from harvester.estimates.batch_means import RAISED
from harvester.excitation.base import kernel_loss
from harvester.files.plain_text import json_text
from harvester.files.serialising import plain
from harvester.files.tables import xarray_or_say
from harvester.prepared.prepared import prepared
from harvester.prepared.steps import knot_spacing
from harvester.results.result import unit_of
from harvester.running.task import Task, Wanted
from harvester.scene.model import Scene
from harvester.show.numbers import quantity, value_and_error
from harvester.show.palette import CIRCUIT, MONTE_CARLO
from harvester.show.panels import Panel, Series, draw_panels, is_wide
from harvester.show.symbols import key_label
from harvester.simulation.methods import Engine, engine_of
from harvester.simulation.realization import run
from harvester.studies.orbits.kramers import kramers_time

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset

# Fewest stays that give an error bar; with sixteen the mean has a relative error of a quarter.
FEWEST_STAYS = 16
# Longer times by the knots of white noise are noted from this share on. They were 1.9 ± 0.2 %
# longer where the lacking density times the barrier is 1.2 %.
NOTED_BY_KNOTS = 2e-3
# Number of realizations in one task, and how often their number is doubled to reach the precision.
TOGETHER, MOST_DOUBLINGS = 8, 6


@dataclass(frozen=True)
class Stay:
    """How long one well holds the device, at one value of the key.

    Attributes
    ----------
    value : float or None
        Value of the key; None without one.
    well : float
        Displacement at its bottom, in the scene's units; of two alike the one on the right, which
        stands for both.
    time, standard_error : float, float or None
        Mean time from reaching the well to reaching another (s); no error bar on fewer than
        `FEWEST_STAYS` stays. Infinite where it was never left.
    stays : int
        Number of stays that ended.
    watched : float
        Time in the well, of all realizations (s).
    kramers : float or None
        Kramers' time (s), where the formula holds.
    reason : str
        Why it does not.
    longer_by_knots : float
        Share by which the band of white noise's knots lengthens the time: the density that it
        lacks at the well's frequency times the barrier in temperatures. It is up to twice that.
    outcome : str
        "complete", or what ended the run.
    """

    value: float | None
    well: float
    time: float
    standard_error: float | None
    stays: int
    watched: float
    kramers: float | None
    reason: str
    longer_by_knots: float = 0.0
    outcome: str = "complete"


@dataclass(frozen=True)
class Residence:
    """Mean times of residence in the wells of a device under noise.

    Attributes
    ----------
    scene : Scene
    key : str or None
        The key that was varied.
    stays : list of Stay
        Value by value, wells from the left to the right.
    method, engine_version : str
    seconds : float
    """

    scene: Scene
    key: str | None
    stays: list[Stay]
    method: str
    engine_version: str
    seconds: float

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows, as text."""
        name = key_label(self.key, self.scene.units) if self.key else "scene"
        header = [name, f"well at [{unit_of(self.scene, 'displacement')}]"]
        header += ["residence time ± standard error [s]", "stays", "Kramers [s]"]
        return header, [
            [
                "" if each.value is None else f"{each.value:.6g}",
                f"{each.well:.4g}",
                _time_text(each),
                f"{each.stays}",
                "—" if each.kramers is None else f"{each.kramers:.4g}",
            ]
            for each in self.stays
        ]

    def data(self) -> tuple[list[str], list[list[Any]]]:
        """Header and rows of numbers."""
        header = [self.key or "scene", f"well [{unit_of(self.scene, 'displacement')}]"]
        header += ["residence time [s]", "standard error [s]", "stays", "Kramers [s]"]
        return header, [
            [each.value, each.well, each.time, each.standard_error, each.stays, each.kramers]
            for each in self.stays
        ]

    def sentences(self) -> list[str]:
        """Sentences on the meaning of the numbers and on how they were obtained."""
        lines = [
            f"{self.method}: {self.engine_version}; {self.seconds:.2f} s",
            "a stay lasts from reaching a well (no more than a quarter of the energy that leads "
            "out of it) to reaching another one",
        ]
        reasons: dict[str, dict[str, None]] = {}
        for each in self.stays:
            if each.reason:
                value = "" if each.value is None else f"{each.value:.6g}"
                reasons.setdefault(each.reason, {})[value] = None
        everywhere = len({each.value for each in self.stays})
        for reason, values in reasons.items():
            where = f" at {self.key} = {', '.join(values)}" if len(values) < everywhere else ""
            lines.append(f"Kramers' formula is left out{where}: {reason}")
        few = [each for each in self.stays if each.standard_error is None]
        if few:
            lines.append(
                f"{len(few)} of {len(self.stays)} have no error bar, on fewer than {FEWEST_STAYS} "
                "stays: raise run.duration or run.realizations, or ask for a --precision"
            )
        longer = max(each.longer_by_knots for each in self.stays)
        if longer > NOTED_BY_KNOTS:
            lines.append(
                "white noise ends with the band of its knots: times are about "
                f"{longer:.1%} to {2.0 * longer:.1%} longer than without that limit; halve "
                f"excitation.knot_spacing = {knot_spacing(prepared(self.scene)):.3g} to lower this"
            )
        wrong = dict.fromkeys(each.outcome for each in self.stays if each.outcome != "complete")
        return lines + list(wrong)

    def figure(self) -> Figure | None:
        """Residence time over the key; None without one."""
        from harvester.show import figures

        return figures.drawn(_draw, self) if self.key else None

    def to_xarray(self) -> Dataset:
        """An xarray Dataset over the stays."""
        variables = {
            name: (("stay",), [np.nan if v is None else v for v in map(_of(name), self.stays)])
            for name in ("value", "well", "time", "standard_error", "stays", "kramers")
        }
        attributes = {"scene": json_text(self.scene.to_dict()), "method": self.method}
        return xarray_or_say().Dataset(variables, attrs=attributes)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return plain(dict(vars(self)))


def _of(name):
    return lambda stay: getattr(stay, name)


def _time_text(stay):
    if not math.isfinite(stay.time):
        return f"over {stay.watched:.4g}"
    if stay.standard_error is None:
        return f"{stay.time:.3g} (no error bar)"
    return value_and_error(stay.time, stay.standard_error)


def stays(
    scene: Scene,
    engine: str,
    indices: list,
    step: str | float,
    report: Callable,
    settings: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Times in the wells and jumps out of them, in a worker process.

    Returns
    -------
    dict
        `times`, `exits`, shape (realizations, batches, wells), wells from the left; `version`.
    """
    found = run(scene, engine_of(engine, step=step, **settings or {}), indices, None, report)
    jumps: Any = [each.moments.jumps for each in found]
    # The last row holds the time before `run.settle`. It counts too: a start at rest is like an
    # arrival by a jump.
    return {
        "times": np.array([each.times for each in jumps]),
        "exits": np.array([each.counts.sum(axis=2) for each in jumps]),
        "version": found[0].engine_version,
    }


def staying(
    scene: Scene,
    value: float | None,
    engine: Engine,
    version: str,
    precision: float | None,
) -> Generator[Wanted, list, tuple[list[Stay], str]]:
    """A plan for `Runner.follow`: the stays at one value, and the engine's version."""
    count, done = scene.run.realizations, 0
    times, exits, engine_version = [], [], ""
    outcome = "complete"
    # Further realizations run under the unchanged scene, because `run.realizations` sets the
    # batches' length.
    for _ in range(MOST_DOUBLINGS + 1):
        indices = list(range(done, count))
        pieces = [indices[first : first + TOGETHER] for first in range(0, len(indices), TOGETHER)]
        tasks = [
            Task(
                stays,
                {"scene": scene, **engine.as_arguments("engine"), "indices": each},
                version,
                f"{engine.name} {value}",
                len(each),
            )
            for each in pieces
        ]
        answers = yield Wanted(tasks)
        for answer in answers:
            if answer is None or isinstance(answer, HarvesterError):
                outcome = "the time budget was spent" if answer is None else str(answer)
                continue
            times.append(answer["times"])
            exits.append(answer["exits"])
            engine_version = answer["version"]
        if not times:
            break
        found = stays_of(scene, value, np.concatenate(times), np.concatenate(exits))
        done, count = count, 2 * count
        errors = [
            each.standard_error / each.time if each.standard_error else math.inf for each in found
        ]
        if precision is None or outcome != "complete" or max(errors) <= precision:
            break
    if not times:
        wells = timescales.wells(prepared(scene).system)
        nothing = np.zeros((1, 1, len(wells)))
        found = stays_of(scene, value, nothing, nothing)
    return [replace(each, outcome=outcome) for each in found], engine_version


def stays_of(scene: Scene, value: float | None, times: np.ndarray, exits: np.ndarray) -> list[Stay]:
    """Mean residence times from `times` in wells and `exits`, both (realizations, batches,
    wells)."""
    ready = prepared(scene)
    system = ready.system
    wells = sorted(timescales.wells(system))
    if len(wells) == 2 and system.symmetric:
        times, exits, wells = (
            times.sum(axis=2)[:, :, None],
            exits.sum(axis=2)[:, :, None],
            wells[1:],
        )
    found = []
    for number, well in enumerate(wells):
        spent, left = times[:, :, number].ravel(), exits[:, :, number].ravel()
        count, watched = float(left.sum()), float(spent.sum())
        time = watched / count if count else math.inf
        error = None
        if count >= FEWEST_STAYS:
            off = spent - time * left
            blocks = int(np.count_nonzero(spent > 0.0))
            error = math.sqrt(blocks / max(blocks - 1.0, 1.0) * float((off**2).sum())) / count
            error *= 1.0 + RAISED / count
        formula, reason = kramers_time(ready, well)
        place = well * ready.scales.displacement
        longer = _longer_by_knots(ready, well)
        found.append(Stay(value, place, time, error, int(count), watched, formula, reason, longer))
    return found


def _longer_by_knots(ready, well):
    """See `Stay.longer_by_knots`; 0 for noise that is not white."""
    system = ready.system
    omega = timescales.well_frequency(system, well)
    loss = timescales.loss_rate(system, omega)
    if ready.scene.excitation.kind != "white" or not loss > 0.0:
        return 0.0
    temperatures = timescales.barrier(system, well) * loss / system.noise.intensity
    return kernel_loss(knot_spacing(ready), omega) * temperatures


def require_wells(scene: Scene) -> None:
    """Refuse a device or an excitation without residence times.

    Raises
    ------
    HarvesterError
    """
    if len(timescales.wells(prepared(scene).system)) < 2:
        raise HarvesterError(
            f"{scene.name}: the device has one well: residence times are those of several, as a "
            "negative oscillator.linear_stiffness makes them"
        )
    if not scene.excitation.random:
        raise HarvesterError(
            f'{scene.name}: excitation.kind = "{scene.excitation.kind}": residence times are those '
            "under noise; harvester basins follows a device under a sine"
        )


def _draw(residence):
    """Times over the key on a logarithmic axis, with Kramers' where it holds."""
    series = []
    wells = dict.fromkeys(each.well for each in residence.stays)
    for number, well in enumerate(wells):
        some = [each for each in residence.stays if each.well == well and math.isfinite(each.time)]
        x, y = [each.value for each in some], [each.time for each in some]
        bars = [2.0 * (each.standard_error or 0.0) for each in some]
        colour = (MONTE_CARLO, CIRCUIT)[number % 2]
        place = quantity(well, unit_of(residence.scene, "displacement"))
        series.append(Series(x, y, f"well at {place}", colour, "", "o", bars=bars))
        known = [each for each in residence.stays if each.well == well and each.kramers]
        if known:
            x, y = [each.value for each in known], [each.kramers for each in known]
            series.append(Series(x, y, "Kramers", colour, "--"))
    values = [each.value for each in residence.stays]
    label = key_label(residence.key, residence.scene.units)
    panel = Panel(label, "residence time [s]", series, log_x=is_wide(values), log_y=True)
    title = f"{residence.scene.name}: mean time in a well (bars: two standard errors)"
    return draw_panels([panel], title, size=(4.0, 3.0))
