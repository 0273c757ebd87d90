"""`residence`: residence times in a well under noise, compared with Kramers' formula."""

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
from harvester.engines.request import OUT_OF_TIME
from harvester.engines.task import Task, Wanted
from harvester.excitation.base import kernel_loss
from harvester.results.palette import CIRCUIT, MONTE_CARLO
from harvester.results.panels import Panel, Series, draw_panels, is_wide
from harvester.results.result import unit_of
from harvester.results.view import Picture, ResultBase, View
from harvester.scene.model import Scene
from harvester.scene.prepared import Prepared
from harvester.scene.steps import knot_spacing, spacing_of
from harvester.scene.tables import key_column, key_label, key_words, value_words
from harvester.statistics.batch_means import RAISED
from harvester.statistics.estimate import Estimate

if TYPE_CHECKING:
    from xarray import Dataset

# Minimum number of stays for an error bar; with sixteen the mean has a relative error of a quarter.
FEWEST_STAYS = 16
# With fewer stays the scatter is uncertain: the error is at least the error for exponentially
# distributed times.
FEW_STAYS = 64
# The relative increase of times by the knots of white noise is noted from this value on. A measured
# increase was 1.9 ± 0.2 %, where the missing density times the barrier was 1.2 %.
NOTED_BY_KNOTS = 2e-3
# Number of realizations per task, and maximum number of doublings to reach the precision.
TOGETHER, MOST_DOUBLINGS = 8, 6
# Lowest barrier, in temperatures (units of kT), for Kramers' formula: at three its error is about
# 15 %.
FEWEST_TEMPERATURES = 3.0
# Maximum effect of the noise's colour on the rate's exponent: the relative decrease of the noise
# density from zero to the well's frequency, times the barrier in temperatures.
MOST_COLOUR = 0.1
# Maximum share of the well's stiffness, and of the damping, due to the transducer.
MOST_TRANSDUCER = 0.01
NODES = 400


@dataclass(frozen=True)
class ResidenceTime:
    """Mean residence time in one well, at one value of the key.

    Attributes
    ----------
    value
        Value of the key; None without a key.
    well : float
        Displacement of its bottom, in the scene's units; of two symmetric wells the right one,
        which represents both.
    time, standard_error : float, float or None
        Mean time from reaching the well to reaching another (s). With fewer than `FEWEST_STAYS`
        stays there is no error bar. Infinite if the well was never left.
    stays
        Number of completed stays.
    watched
        Total time in the well over all realizations (s).
    kramers
        Kramers' time (s), if the formula is valid.
    reason
        Reason why the formula is not valid.
    longer_by_knots : float
        Relative increase of the time by the limited bandwidth of white noise with knots: the
        density missing at the well's frequency, times the barrier in temperatures. The actual
        increase is up to twice as large.
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
    """Mean residence times in the wells of a device under noise.

    Attributes
    ----------
    key
        The key that was varied.
    stays
        Residence times by value, then by well from left to right.
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
        """ "±" if a row combines the stays in both wells of a symmetric device."""
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
        """Sentences on the definitions, and on how the numbers were obtained."""
        lines = [
            f"{self.method}: {self.engine_version}; {self.seconds:.2f} s",
            "a stay lasts from reaching a well (energy at most a quarter of the barrier) "
            "to reaching another one",
        ]
        reasons: dict[str, dict[str, None]] = {}
        for stay in self.stays:
            if stay.reason:
                reasons.setdefault(stay.reason, {})[self._value(stay)] = None
        everywhere = len({stay.value for stay in self.stays})
        for reason, values in reasons.items():
            where = f" at {self.key} = {', '.join(values)}" if len(values) < everywhere else ""
            lines.append(f"Kramers' formula is not valid{where}: {reason}")
        without_error = [stay for stay in self.stays if stay.standard_error is None]
        if without_error:
            lines.append(
                f"{len(without_error)} of {len(self.stays)} times have no error bar, with fewer "
                f"than {FEWEST_STAYS} stays: {self.scene.excitation.longer_run(self.scene.run)}"
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
                f"{len(missed)} of {len(self.stays)} times do not have the precision of "
                f"{self.precision:.2g} with {2**MOST_DOUBLINGS} times the scene's realizations: "
                f"{self.scene.excitation.longer_run(self.scene.run)} or run.realizations = "
                f"{self.scene.run.realizations}"
            )
        longer = max(stay.longer_by_knots for stay in self.stays)
        if longer > NOTED_BY_KNOTS:
            lines.append(
                "the time between samples limits the bandwidth of white noise: times are about "
                f"{longer:.1%} to {2.0 * longer:.1%} longer than without this limit; halve "
                f"excitation.knot_spacing = {spacing_of(self.scene):.3g} to reduce this"
            )
        wrong = dict.fromkeys(stay.outcome for stay in self.stays if stay.outcome != "complete")
        return lines + list(wrong)

    def _misses(self, stay):
        """Whether a mean time is less precise than requested."""
        error = math.inf if stay.standard_error is None else stay.standard_error / stay.time
        return self.precision is not None and error > self.precision

    def _dataset(self) -> Dataset:
        """The residence times as an xarray Dataset."""
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
    """Compute times in the wells and jumps out of them, in a worker process.

    Returns
    -------
    dict
        `times`, `exits`, shape (realizations, batches, wells), wells from the left; `version`.
    """
    chosen = engine_of(engine, step=step, **settings or {})
    realizations = run(prepared_scene, chosen, indices, None, report)
    jumps: Any = [realization.moments.jumps for realization in realizations]
    # The last row is the time before `run.settle`. A device at rest leaves its well later than in
    # the stationary state: with stays of 208 s, 250 s of simulation after 50 s of settling gave
    # means 11 % too long if the settling was included, and 1 ± 1 % if it was excluded.
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
    """Generator for `Runner.follow`: the residence times at one value, and the engine's version."""
    scene, done = prepared_scene.scene, 0
    count = scene.run.realizations
    times, exits, engine_version = [], [], ""
    outcome = "complete"
    # Further realizations run with the unchanged scene, because `run.realizations` determines the
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
                outcome = OUT_OF_TIME if answer is None else str(answer)
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
    prepared_scene: Prepared, value: float | None, times: np.ndarray, exits: np.ndarray
) -> list[ResidenceTime]:
    """Mean residence times; `times` in wells and `exits` have (realizations, batches, wells)."""
    system = prepared_scene.system
    wells = sorted(timescales.wells(system))
    if len(wells) == 2 and system.symmetric:
        times, exits, wells = (
            times.sum(axis=2)[:, :, None],
            exits.sum(axis=2)[:, :, None],
            wells[1:],
        )
    rows = []
    for number, well in enumerate(wells):
        spent, departures = times[:, :, number].ravel(), exits[:, :, number].ravel()
        count, watched = float(departures.sum()), float(spent.sum())
        time = watched / count if count else math.inf
        error = None
        if count >= FEWEST_STAYS:
            off = spent - time * departures
            blocks = int(np.count_nonzero(spent > 0.0))
            error = math.sqrt(blocks / max(blocks - 1.0, 1.0) * float((off**2).sum())) / count
            error *= 1.0 + RAISED / count
            if count < FEW_STAYS:
                error = max(error, time / math.sqrt(count))
        formula, reason = kramers_time(prepared_scene, well)
        bottom = well * prepared_scene.scales.displacement
        longer = _longer_by_knots(prepared_scene, well)
        rows.append(
            ResidenceTime(value, bottom, time, error, int(count), watched, formula, reason, longer)
        )
    return rows


def _longer_by_knots(prepared_scene, well):
    """Compute `ResidenceTime.longer_by_knots`; 0 for noise that is not white."""
    system = prepared_scene.system
    omega = timescales.well_frequency(system, well)
    loss = timescales.loss_rate(system, omega)
    if prepared_scene.scene.excitation.kind != "white" or not loss > 0.0:
        return 0.0
    temperatures = timescales.barrier(system, well) * loss / system.noise.intensity
    return kernel_loss(knot_spacing(prepared_scene), omega) * temperatures


def require_wells(prepared_scene: Prepared) -> None:
    """Raise HarvesterError if the device or the excitation has no residence times."""
    scene = prepared_scene.scene
    if len(timescales.wells(prepared_scene.system)) < 2:
        raise HarvesterError(
            f"{scene.name}: the device has only one well, and residence times need at least "
            "two: give, for example, a negative oscillator.linear_stiffness"
        )
    if not scene.excitation.random:
        raise HarvesterError(
            f'{scene.name}: excitation.kind = "{scene.excitation.kind}": residence times need '
            "noise; under a sine use harvester basins"
        )


def _draw(residence):
    """Draw times over the key on a logarithmic axis, with Kramers' time if it is valid."""
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
        bare = [stay.standard_error is None for stay in some]
        series.append(Series(x, y, label, colour, "", "o", bars=bars, hollow=bare))
        with_formula = [stay for stay in residence.stays if stay.well == well and stay.kramers]
        if with_formula:
            x, y = [stay.value for stay in with_formula], [stay.kramers for stay in with_formula]
            series.append(Series(x, y, "Kramers", colour, "--"))
    values = [stay.value for stay in residence.stays]
    label, unit = key_words(residence.key, residence.scene.units)
    panel = Panel(
        label, "residence time [s]", series, log_x=is_wide(values), log_y=True, x_unit=unit
    )
    title = f"{residence.scene.name}: mean time in a well (bars: two standard errors; hollow: none)"
    return draw_panels([panel], title, size=(4.0, 3.0))


def kramers_time(prepared_scene: Prepared, well: float) -> tuple[float | None, str]:
    """Mean time to reach the other of two wells (s), or None and why the formula is not valid.

    Kramers' rate for moderate to strong damping (Physica 7, 284, 1940) times the depopulation
    factors of both wells, which are valid for any damping (V. I. Mel'nikov and S. V. Meshkov, J.
    Chem. Phys. 85, 1018, 1986; P. Hänggi, P. Talkner and M. Borkovec, Rev. Mod. Phys. 62, 251,
    1990).

    `well`: displacement of the well, scaled.
    """
    system = prepared_scene.system
    why = _refusal(prepared_scene, well)
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


def _refusal(prepared_scene, well):
    """Reason why Kramers' formula is not valid; empty if it is."""
    system, excitation = prepared_scene.system, prepared_scene.scene.excitation
    if len(timescales.wells(system)) != 2:
        return "it needs two wells"
    if excitation.kind not in ("white", "ornstein-uhlenbeck"):
        return f'it needs white noise, but excitation.kind = "{excitation.kind}"'
    drag = prepared_scene.scene.oscillator.quadratic_damping
    if not system.damper.damping > 0.0 or drag > 0.0:
        return "it needs a linear damper"
    if any(stopper.restitution < 1.0 for stopper in prepared_scene.scene.stoppers):
        return "stoppers take energy"
    omega = math.sqrt(max(timescales.stiffness(system, well), 0.0))
    added, rate = system.transducer.loss_rate(omega), system.transducer.decay_rate()
    # Real and imaginary part of β iω/(iω + λ), the transducer's force over the displacement.
    stiffer = added * omega**2 / rate if rate else system.transducer.stiffness(omega**2)
    if added > MOST_TRANSDUCER * system.damper.damping or stiffer > MOST_TRANSDUCER * omega**2:
        return "the transducer takes energy and stiffens the wells"
    barrier = timescales.barrier(system, well) * system.damper.damping / system.noise.intensity
    # Rounded as printed, since a barrier of three may be computed as 2.9999994.
    if round(barrier, 2) < FEWEST_TEMPERATURES:
        return f"the barrier is {barrier:.2f} temperatures: must be {FEWEST_TEMPERATURES:g} or more"
    colour = (omega * system.noise.correlation_time) ** 2
    if colour * barrier > MOST_COLOUR:
        return "the noise is coloured"
    return ""


def _action(system, well, saddle):
    """∮ X' dX over one cycle in a well at the saddle's energy."""
    from scipy.optimize import brentq

    top = float(potential(system, saddle))
    away = well - saddle
    while float(potential(system, well + away)) < top:
        away *= 1.5
    end = brentq(lambda x: float(potential(system, x)) - top, well, well + away)
    # The substitution x = middle − half · cos(angle) removes the square-root singularities at both
    # ends.
    angle = (np.arange(NODES) + 0.5) * math.pi / NODES
    middle, half = 0.5 * (saddle + end), 0.5 * abs(end - saddle)
    x = middle - half * np.cos(angle)
    speed = np.sqrt(np.maximum(2.0 * (top - np.asarray(potential(system, x))), 0.0))
    return float(2.0 * np.sum(speed * half * np.sin(angle)) * math.pi / NODES)


def _depopulation(loss):
    """A(δ) of Mel'nikov and Meshkov; δ is the energy loss per cycle in temperatures."""
    from scipy.integrate import quad

    total = quad(
        lambda y: math.log(-math.expm1(-loss * (y * y + 0.25))) / (y * y + 0.25),
        0.0, math.inf, limit=200,
    )[0]  # fmt: skip
    return math.exp(total / math.pi)
