"""`residence`: how long noise leaves a device in a well, compared with Kramers' formula."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.errors import HarvesterError
from harvester.base.formatting import (
    NOT_KNOWN,
    Printed,
    quantity,
    value_and_error,
    with_error,
    written,
)
from harvester.base.plain_text import json_text
from harvester.base.serialising import LEFT_OUT
from harvester.base.tables import require_xarray
from harvester.device import timescales
from harvester.device.system import potential
from harvester.engines.methods import Engine, engine_of
from harvester.engines.realization import run
from harvester.engines.task import Task, Wanted
from harvester.excitation.base import kernel_loss
from harvester.results.palette import CIRCUIT, MONTE_CARLO
from harvester.results.panels import Panel, Series, draw_panels, is_wide
from harvester.results.result import unit_of
from harvester.results.view import Picture, ResultBase, View
from harvester.scene.model import Scene
from harvester.scene.prepared import Prepared
from harvester.scene.steps import knot_spacing, spacing_of
from harvester.scene.tables import key_column, key_label, value_words
from harvester.statistics.batch_means import RAISED
from harvester.statistics.estimate import Estimate

if TYPE_CHECKING:
    from xarray import Dataset

# Fewest stays that give an error bar; with sixteen the mean has a relative error of a quarter.
FEWEST_STAYS = 16
# Few stays estimate their scatter badly: their error is at least the one of exponential times.
FEW_STAYS = 64
# Longer times by the knots of white noise are noted from this share on. They were 1.9 ± 0.2 %
# longer where the lacking density times the barrier is 1.2 %.
NOTED_BY_KNOTS = 2e-3
# Number of realizations in one task, and how often their number is doubled to reach the precision.
TOGETHER, MOST_DOUBLINGS = 8, 6
# Lowest barrier, in temperatures (units of kT), for Kramers' formula: at three it is some
# 15 % off.
FEWEST_TEMPERATURES = 3.0
# Most by which the noise's colour may change the rate's exponent: the share by which the noise's
# density at the well's frequency lies below that at zero, times the barrier in temperatures.
MOST_COLOUR = 0.1
# Largest share of the well's stiffness, and of the damping, that the transducer may add.
MOST_TRANSDUCER = 0.01
NODES = 400


@dataclass(frozen=True)
class ResidenceTime:
    """Mean residence time in one well, at one value of the key.

    Attributes
    ----------
    value
        Value of the key; None without one.
    well : float
        Displacement at its bottom, in the scene's units; of two alike the one on the right, which
        stands for both.
    time, standard_error : float, float or None
        Mean time from reaching the well to reaching another (s); no error bar on fewer than
        `FEWEST_STAYS` stays. Infinite where it was never left.
    stays
        Number of stays that ended.
    watched
        Time in the well, of all realizations (s).
    kramers
        Kramers' time (s), where the formula holds.
    reason
        Why it does not.
    longer_by_knots : float
        Share by which the band of white noise's knots lengthens the time: the density that it
        lacks at the well's frequency times the barrier in temperatures. It is up to twice that.
    outcome : "complete", or the reason for the end.
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


@dataclass(frozen=True, repr=False)
class Residence(ResultBase):
    """Mean times of residence in the wells of a device under noise.

    Attributes
    ----------
    key
        The key that was varied.
    stays
        Value by value, wells from the left to the right.
    """

    scene: Scene
    key: str | None
    stays: list[ResidenceTime]
    method: str
    engine_version: str
    seconds: float
    precision: float | None = field(default=None, metadata=LEFT_OUT)

    @property
    def sign(self) -> str:
        """ "±" where a row counts the stays in both wells of a symmetric device."""
        return "±" * (len({stay.value for stay in self.stays}) == len(self.stays))

    def view(self) -> View:
        """Table, findings and pictures."""
        return View(
            self._table(),
            self._findings(),
            headline=self._headline(),
            pictures=[Picture(_draw, self)] if self.key else [],
            records=self._records,
            keys=2,
            dataset=self._dataset,
        )

    def _table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows, as text."""
        name = key_label(self.key, self.scene.units) if self.key else "scene"
        header = [name, f"well at [{unit_of(self.scene, 'displacement')}]"]
        header += ["residence time ± standard error [s]", "stays", "Kramers [s]"]
        return header, [
            [
                "" if stay.value is None else written(stay.value, ".6g"),
                Printed(f"{self.sign}{stay.well:.4g}", stay.well),
                Printed(_time_text(stay), stay.time, stay.standard_error, "s"),
                written(stay.stays, "d"),
                NOT_KNOWN if stay.kramers is None else written(stay.kramers, ".4g"),
            ]
            for stay in self.stays
        ]

    def _headline(self):
        stay = self.stays[0]
        where = "" if stay.value is None else f" at {self.key} = {self._value(stay)}"
        well = f"{self.sign}{quantity(stay.well, unit_of(self.scene, 'displacement'))}"
        mean = with_error(Estimate(stay.time, stay.standard_error, None, "time"), "s")
        time = mean if math.isfinite(stay.time) else f"{_time_text(stay)} s"
        return f"mean residence time {time} in the well at {well}{where}"

    def _value(self, stay):
        """The value of the key with its unit; empty without a key."""
        return value_words(self.key, stay.value, self.scene.units) if self.key else ""

    def _records(self) -> tuple[list[str], list[list[Any]]]:
        """Header and rows of numbers."""
        key = key_column(self.key, self.scene.units) if self.key else "scene"
        header = [key, f"well [{unit_of(self.scene, 'displacement')}]"]
        header += ["residence time [s]", "standard error [s]", "stays", "Kramers [s]"]
        return header, [
            [stay.value, stay.well, stay.time, stay.standard_error, stay.stays, stay.kramers]
            for stay in self.stays
        ]

    def _findings(self) -> list[str]:
        """Sentences on the meaning of the numbers and on how they were obtained."""
        lines = [
            f"{self.method}: {self.engine_version}; {self.seconds:.2f} s",
            "a stay lasts from reaching a well (no more than a quarter of the energy that leads "
            "out of it) to reaching another one",
        ]
        reasons: dict[str, dict[str, None]] = {}
        for stay in self.stays:
            if stay.reason:
                reasons.setdefault(stay.reason, {})[self._value(stay)] = None
        everywhere = len({stay.value for stay in self.stays})
        for reason, values in reasons.items():
            where = f" at {self.key} = {', '.join(values)}" if len(values) < everywhere else ""
            lines.append(f"Kramers' formula is left out{where}: {reason}")
        few = [stay for stay in self.stays if stay.standard_error is None]
        if few:
            lines.append(
                f"{len(few)} of {len(self.stays)} have no error bar, on fewer than {FEWEST_STAYS} "
                f"stays: raise run.duration = {self.scene.run.duration:g}"
                + (" or run.realizations, or give a precision" * (self.precision is None))
            )
        if any(stay.kramers for stay in self.stays):
            lines.append(
                "Kramers' formula is asymptotic: its relative error is of the order of one over "
                "the barrier in temperatures"
            )
        missed = [stay for stay in self.stays if stay.outcome == "complete" and self._misses(stay)]
        if missed:
            lines.append(
                f"{len(missed)} of {len(self.stays)} do not have the precision of "
                f"{self.precision:.2g} with {2**MOST_DOUBLINGS} times the scene's realizations: "
                f"raise run.duration = {self.scene.run.duration:g} or run.realizations = "
                f"{self.scene.run.realizations}"
            )
        longer = max(stay.longer_by_knots for stay in self.stays)
        if longer > NOTED_BY_KNOTS:
            lines.append(
                "white noise ends with the band of its knots: times are about "
                f"{longer:.1%} to {2.0 * longer:.1%} longer than without that limit; halve "
                f"excitation.knot_spacing = {spacing_of(self.scene):.3g} to lower this"
            )
        wrong = dict.fromkeys(stay.outcome for stay in self.stays if stay.outcome != "complete")
        return lines + list(wrong)

    def _misses(self, stay):
        """Whether a mean time is not as precise as was asked for."""
        error = math.inf if stay.standard_error is None else stay.standard_error / stay.time
        return self.precision is not None and error > self.precision

    def _dataset(self) -> Dataset:
        """An xarray Dataset over the stays."""
        variables = {}
        for name in ("value", "well", "time", "standard_error", "stays", "kramers"):
            column = [getattr(stay, name) for stay in self.stays]
            variables[name] = (("stay",), [np.nan if v is None else v for v in column])
        attributes = {"scene": json_text(self.scene.to_dict()), "method": self.method}
        return require_xarray().Dataset(variables, attrs=attributes)


def _time_text(stay):
    if not math.isfinite(stay.time):
        return f"over {stay.watched:.4g}"
    return value_and_error(stay.time, stay.standard_error)


def stays(
    prepared_scene: Prepared,
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
    chosen = engine_of(engine, step=step, **settings or {})
    realizations = run(prepared_scene, chosen, indices, None, report)
    jumps: Any = [realization.moments.jumps for realization in realizations]
    # The last row holds the time before `run.settle`. A device at rest leaves its well later than
    # one that has long been there: of 250 s after 50 s of settling, with stays of 208 s, the means
    # were 11 % too long with that time, and 1 ± 1 % without it.
    return {
        "times": np.array([jumps_of.times[:-1] for jumps_of in jumps]),
        "exits": np.array([jumps_of.counts[:-1].sum(axis=2) for jumps_of in jumps]),
        "version": realizations[0].engine_version,
    }


def staying(
    prepared_scene: Prepared,
    value: float | None,
    engine: Engine,
    version: str,
    precision: float | None,
) -> Generator[Wanted, list, tuple[list[ResidenceTime], str]]:
    """A plan for `Runner.follow`: the stays at one value, and the engine's version."""
    scene, done = prepared_scene.scene, 0
    count = scene.run.realizations
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
                {"scene": scene, **engine.as_arguments("engine"), "indices": piece},
                version,
                f"{engine.name} {value}",
                len(piece),
            )
            for piece in pieces
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
        means = stays_of(prepared_scene, value, np.concatenate(times), np.concatenate(exits))
        done, count = count, 2 * count
        errors = [
            stay.standard_error / stay.time if stay.standard_error else math.inf for stay in means
        ]
        if precision is None or outcome != "complete" or max(errors) <= precision:
            break
    if not times:
        wells = timescales.wells(prepared_scene.system)
        nothing = np.zeros((1, 1, len(wells)))
        means = stays_of(prepared_scene, value, nothing, nothing)
    return [replace(stay, outcome=outcome) for stay in means], engine_version


def stays_of(
    ready: Prepared, value: float | None, times: np.ndarray, exits: np.ndarray
) -> list[ResidenceTime]:
    """Mean residence times from `times` in wells and `exits`, both (realizations, batches,
    wells)."""
    system = ready.system
    wells = sorted(timescales.wells(system))
    if len(wells) == 2 and system.symmetric:
        times, exits, wells = (
            times.sum(axis=2)[:, :, None],
            exits.sum(axis=2)[:, :, None],
            wells[1:],
        )
    rows = []
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
            if count < FEW_STAYS:
                error = max(error, time / math.sqrt(count))
        formula, reason = kramers_time(ready, well)
        bottom = well * ready.scales.displacement
        longer = _longer_by_knots(ready, well)
        rows.append(
            ResidenceTime(value, bottom, time, error, int(count), watched, formula, reason, longer)
        )
    return rows


def _longer_by_knots(ready, well):
    """See `ResidenceTime.longer_by_knots`; 0 for noise that is not white."""
    system = ready.system
    omega = timescales.well_frequency(system, well)
    loss = timescales.loss_rate(system, omega)
    if ready.scene.excitation.kind != "white" or not loss > 0.0:
        return 0.0
    temperatures = timescales.barrier(system, well) * loss / system.noise.intensity
    return kernel_loss(knot_spacing(ready), omega) * temperatures


def require_wells(prepared_scene: Prepared) -> None:
    """Refuse a device or an excitation without residence times."""
    scene = prepared_scene.scene
    if len(timescales.wells(prepared_scene.system)) < 2:
        raise HarvesterError(
            f"{scene.name}: the device has one well: residence times need several, as a "
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
    wells = dict.fromkeys(stay.well for stay in residence.stays)
    for number, well in enumerate(wells):
        some = [stay for stay in residence.stays if stay.well == well and math.isfinite(stay.time)]
        x, y = [stay.value for stay in some], [stay.time for stay in some]
        bars = [2.0 * (stay.standard_error or 0.0) for stay in some]
        colour = (MONTE_CARLO, CIRCUIT)[number % 2]
        label = (
            f"well at {residence.sign}{quantity(well, unit_of(residence.scene, 'displacement'))}"
        )
        series.append(Series(x, y, label, colour, "", "o", bars=bars))
        with_formula = [stay for stay in residence.stays if stay.well == well and stay.kramers]
        if with_formula:
            x, y = [stay.value for stay in with_formula], [stay.kramers for stay in with_formula]
            series.append(Series(x, y, "Kramers", colour, "--"))
    values = [stay.value for stay in residence.stays]
    label = key_label(residence.key, residence.scene.units)
    panel = Panel(label, "residence time [s]", series, log_x=is_wide(values), log_y=True)
    title = f"{residence.scene.name}: mean time in a well (bars: two standard errors)"
    return draw_panels([panel], title, size=(4.0, 3.0))


def kramers_time(ready: Prepared, well: float) -> tuple[float | None, str]:
    """Mean time until the other of two wells (s), or None and why the formula does not hold.

    Kramers' rate for moderate to strong damping (Physica 7, 284, 1940) times the depopulation
    factors of both wells, which hold for any damping (V. I. Mel'nikov and S. V. Meshkov, J. Chem.
    Phys. 85, 1018, 1986; P. Hänggi, P. Talkner and M. Borkovec, Rev. Mod. Phys. 62, 251, 1990).

    `well`: displacement of the well, scaled.
    """
    system = ready.system
    why = _refusal(ready, well)
    if why:
        return None, why
    (saddle,) = timescales.saddles(system)
    damping = system.damper.damping
    temperature = system.noise.intensity / damping
    barrier = timescales.barrier(system, well) / temperature
    omega = math.sqrt(timescales.stiffness(system, well))
    over = math.sqrt(-timescales.stiffness(system, saddle))
    slowing = (math.sqrt(damping**2 / 4.0 + over**2) - damping / 2.0) / over
    losses = [
        damping * _action(system, side, saddle) / temperature for side in timescales.wells(system)
    ]
    factor = math.prod(_depopulation(loss) for loss in losses) / _depopulation(sum(losses))
    return 2.0 * math.pi / (omega * slowing * factor) * math.exp(barrier), ""


def _refusal(ready, well):
    """Why Kramers' formula does not hold; empty where it does."""
    system, excitation = ready.system, ready.scene.excitation
    if len(timescales.wells(system)) != 2:
        return "it is for two wells"
    if excitation.kind not in ("white", "ornstein-uhlenbeck"):
        return f'it is for white noise, and excitation.kind = "{excitation.kind}"'
    drag = ready.scene.oscillator.quadratic_damping
    if not system.damper.damping > 0.0 or drag > 0.0:
        return "it is for a linear damper"
    if any(stopper.restitution < 1.0 for stopper in ready.scene.stoppers):
        return "stoppers take energy"
    omega = math.sqrt(max(timescales.stiffness(system, well), 0.0))
    added, rate = system.transducer.loss_rate(omega), system.transducer.decay_rate()
    # Real and imaginary part of β iω/(iω + λ), the transducer's force over the displacement.
    stiffer = added * omega**2 / rate if rate else system.transducer.stiffness(omega**2)
    if added > MOST_TRANSDUCER * system.damper.damping or stiffer > MOST_TRANSDUCER * omega**2:
        return "the transducer takes energy and stiffens the wells"
    barrier = timescales.barrier(system, well) * system.damper.damping / system.noise.intensity
    # Rounded as printed: an intensity of few digits makes 2.9999994 of three.
    if round(barrier, 2) < FEWEST_TEMPERATURES:
        return f"the barrier is {barrier:.2f} temperatures and not {FEWEST_TEMPERATURES:g} or more"
    colour = (omega * system.noise.correlation_time) ** 2
    if colour * barrier > MOST_COLOUR:
        return "the noise is coloured"
    return ""


def _action(system, well, saddle):
    """∮ X' dX of one round in a well at the saddle's energy."""
    from scipy.optimize import brentq

    top = float(potential(system, saddle))
    away = well - saddle
    while float(potential(system, well + away)) < top:
        away *= 1.5
    end = brentq(lambda x: float(potential(system, x)) - top, well, well + away)
    # The substitution x = middle − half · cos(angle) removes the root singularities at both ends.
    angle = (np.arange(NODES) + 0.5) * math.pi / NODES
    middle, half = 0.5 * (saddle + end), 0.5 * abs(end - saddle)
    x = middle - half * np.cos(angle)
    speed = np.sqrt(np.maximum(2.0 * (top - np.asarray(potential(system, x))), 0.0))
    return float(2.0 * np.sum(speed * half * np.sin(angle)) * math.pi / NODES)


def _depopulation(loss):
    """A(δ) of Mel'nikov and Meshkov, δ the energy lost in a round in temperatures."""
    from scipy.integrate import quad

    total = quad(
        lambda y: math.log(-math.expm1(-loss * (y * y + 0.25))) / (y * y + 0.25),
        0.0, math.inf, limit=200,
    )[0]  # fmt: skip
    return math.exp(total / math.pi)
