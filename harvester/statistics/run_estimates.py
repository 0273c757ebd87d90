"""Estimates from the moments of a run, with notes on quantities that need a longer run."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from circuits.netlist.kinds import OUTPUT
from circuits.netlist.load_notes import reading_notes
from harvester.base.errors import SceneError
from harvester.base.formatting import number, quantity
from harvester.device import timescales
from harvester.device.beam.magnets import magnet_notes
from harvester.scene.steps import faintness, susceptance
from harvester.statistics.balance import device_storage, energy_balance_residual
from harvester.statistics.batch_means import (
    FEWEST_BATCHES,
    complete_batches,
    constant,
    duration_for_error,
    error_of_starts,
    error_without_chance,
    measured_time,
    standard_error,
    standard_error_of_drift,
)
from harvester.statistics.estimate import TOO_SHORT
from harvester.statistics.measures import without_value
from harvester.statistics.moments import QUANTITIES
from harvester.statistics.output_side import estimate_output, step_sizes, taken_by_sources
from harvester.statistics.passivity import (
    efficiency_notes,
    faint_output_notes,
    source_notes,
    store_notes,
    supply_notes,
)
from harvester.statistics.run_quantities import estimate_all
from harvester.statistics.settling import Shortfall, shortfalls, slow_exchange, withheld
from harvester.statistics.store_settling import store_states
from harvester.statistics.strain import estimate_strain, strain_notes
from harvester.statistics.units import unit_of
from harvester.statistics.well_balance import weighted, well_balance

if TYPE_CHECKING:
    from harvester.scene.model import Scene
    from harvester.scene.prepared import Prepared
    from harvester.statistics.estimate import Estimate
    from harvester.statistics.moments import Moments
    from harvester.statistics.well_balance import WellBalance

# Where the device's energy goes; `loss_power` contains the transducer's loss.
LOSSES = ("load_power", "loss_power")
# Points of the integrals over frequency.
POINTS = 2001
# A record's spectral density is averaged over segments of the run's length over this.
STRETCHES = 8.0


# A change of a transient's energies by longer steps is noted from this share on: three times what
# a resolved one may have.
NOTED_CHANGE = 0.03
SENSITIVE = (
    "the motion is sensitive to the steps: the phase at which an event meets it rests on all steps "
    "before; choose step = finest or a shorter one, best by the method monte-carlo"
)
CHAOTIC = (
    "the path is chaotic: runs whose excitation differs by the possible step error end with powers "
    "that scatter by {:.0%}, so that no step resolves it and one path is one of many; error bars "
    "hold that scatter; set run.starts = 100, which averages over starts, or take a longer record"
)
# No record is advised that is longer by this factor: a store that charges slowly gives such advice.
LONGEST_ADVICE = 16.0
# Fewest periods of a deterministic excitation whose means show how they differ.
FEWEST_PERIODS = 2
# Most notes on options of ngspice, which may differ from realization to realization.
MOST_NOTES = 3


@dataclass(frozen=True)
class RunEstimates:
    """Scaled estimates of a run, and caveats for citing them.

    Attributes
    ----------
    whole
        All estimates, each with its error bar.
    shortfalls
        The relaxations for which the run was too short.
    step_error
        Share of a power that the steps may cost.
    path_error
        Share by which the steps may change the means of one deterministic path.
    residual
        Residual of the energy balance, as a share of the energy input.
    notes
        Notes on sources in the load, efficiencies above 1 and the shortfalls.
    moments
        Weighted by `harvester.statistics.well_balance` where wells differ.
    error
        The error of a mean from batches of these.
    balance
        Balance of the jumps between wells, if these differ; else None.
    """

    whole: dict[str, Estimate]
    shortfalls: list[Shortfall]
    step_error: float
    path_error: float
    residual: float
    notes: tuple[str, ...]
    moments: list[Moments] = field(repr=False)
    error: Callable = field(repr=False)
    balance: WellBalance | None = field(repr=False)

    @property
    def scaled(self) -> dict[str, Estimate]:
        """The estimates, without the error bars that would be too small."""
        return withheld(self.whole, self.shortfalls)


def run_estimates(
    ready: Prepared, moments: Sequence[Moments], step_error: float = 0.0
) -> RunEstimates:
    """Estimates from the moments of a scene's realizations.

    `step_error` is the share that the steps may cost, see `harvester.scene.steps.step_error`:
    where nothing is by chance it is part of the error.

    Raises
    ------
    SceneError
        No step of the run lies in its measured time.
    """
    scene, system, scales = ready.scene, ready.system, ready.scales
    moments = list(moments)
    if not measured_time(moments) > 0.0:
        raise SceneError(
            f"{scene.name}: run.duration = {scene.run.duration:g}: no whole step lies in it; "
            "raise it to some periods of the motion"
        )
    step_error = max(step_error, *(m.step_error for m in moments))
    spread = max(m.spread for m in moments)
    balance = well_balance(scene, system, moments)
    balanced = weighted(moments, balance)
    memory = correlation_time(ready, moments)
    batch = moments[0].batch_length

    def error_over(time, change=False):
        """The function that gives errors of means with this least correlation time (s)."""
        return balance.error if balance else error_of(scene, time / batch, change)

    error = error_over(memory)
    # A source that matches the load discharges a store twice as fast as the load alone.
    stores = store_states(ready, moments)
    # With one path, means hold for slow stores only at their charge in this run.
    longest = scene.run.duration / FEWEST_BATCHES if scene.excitation.drifts else math.inf
    remembered = [store.memory for store in stores if store.memory <= longest]
    slow = memory + 0.5 * max(remembered, default=0.0)
    estimates = estimate_all(balanced, system, error)
    estimates |= estimate_output(balanced, error_over(slow), error_over(slow, change=True))
    estimates |= device_storage(moments, balanced, system, error_over(memory, change=True))
    estimates |= estimate_strain(balanced, scene.excitation, error)
    square, power = (estimates[f"mean_{name}"].estimate for name in ("square_voltage", "power"))
    step_error *= faintness(susceptance(ready) * square, power)
    path_error = math.hypot(step_error, spread)
    estimates = _with_limited_samples(estimates, sum(m.points for m in moments))
    sizes = step_sizes(estimates, scene.load.circuit.measures if scene.load.circuit else ())
    # A device holds about its mean X'² as kinetic and potential energy.
    held = estimates["mean_square_velocity"].estimate / scene.run.duration
    sizes["mean_device_storage_power"] = held
    estimates = {
        name: with_steps(
            scene, estimate, path_error, memory, sizes.get(name), name.endswith("storage_power")
        )
        for name, estimate in estimates.items()
    }
    reasons = shortfalls(ready, moments, estimates, balance, stores, slow / batch)
    sensitive = scene.excitation.transient(scene.run) and step_error >= NOTED_CHANGE
    notes = (
        *[*dict.fromkeys(moment.note for moment in moments if moment.note)][:MOST_NOTES],
        *source_notes(scene.load.circuit),
        *_loose_nodes(scene.load.circuit),
        *_without_value(scene.load.circuit, moments),
        *_sinks(scene, moments, scales.of("power")),
        *(reading_notes(scene.load.circuit) if scene.load.circuit else ()),
        *efficiency_notes(estimates, scales.of("power"), unit_of(scene, "power")),
        *supply_notes(estimates, scales.of("power"), unit_of(scene, "power")),
        *store_notes(estimates),
        *faint_output_notes(estimates),
        *strain_notes(scene, moments),
        *magnet_notes(scene.magnets),
        *(reason.note for reason in reasons),
        *slow_exchange(scene, balance),
        *(SENSITIVE,) * sensitive,
        *(CHAOTIC.format(spread),) * (spread >= NOTED_CHANGE),
    )
    residual = energy_balance_residual(moments, system)
    estimates = _with_lengths(scene, balanced, estimates, memory)
    return RunEstimates(
        estimates, reasons, step_error, path_error, residual, notes, balanced, error, balance
    )


def _with_limited_samples(estimates, points):
    """The estimates with no more effective samples than points that were computed."""
    return {
        name: replace(estimate, effective_sample_size=float(points))
        if (estimate.effective_sample_size or 0.0) > points
        else estimate
        for name, estimate in estimates.items()
    }


def _with_lengths(scene, moments, whole, memory):
    """The estimates; where one has no error bar, its note names the duration that would give it."""
    batches, period = complete_batches(moments), scene.excitation.period
    if batches is None or all(estimate.note != TOO_SHORT for estimate in whole.values()):
        return whole
    series = batches[:, :, QUANTITIES.index("square_voltage")]
    if not scene.excitation.random:
        series = series.mean(axis=0, keepdims=True)
    duration = duration_for_error(series, scene.run.duration, memory)
    if period and not scene.excitation.random:
        duration = FEWEST_PERIODS * period
    run, longest = scene.run, scene.excitation.longest_run
    if duration <= run.duration and math.isinf(longest):
        return whole  # too few jumps, say, and not too few periods
    note = f"too short for an error bar: set run.duration = {number(duration, 2)} or more"
    if duration <= run.duration:
        note = f"too short for an error bar: {scene.excitation.longer_run(run)}"
    elif run.settle + duration > longest:
        length = number(run.settle + duration, 2)
        note = f"too short for an error bar: a record of {length} s or more has one"
        if duration > LONGEST_ADVICE * run.duration:
            note = "too short for an error bar: it changes slowly over the whole measured time"
    return {
        name: replace(estimate, note=note) if estimate.note == TOO_SHORT else estimate
        for name, estimate in whole.items()
    }


def _sinks(scene, moments, scale):
    """A note on currents across the output that take power and count as a loss of the load."""
    load = scene.load.circuit
    if load is None or not load.has_output or any(m.kind == OUTPUT for m in load.measures):
        return ()
    powers = taken_by_sources(moments)
    return tuple(
        f"{part.name} takes {quantity(scale * powers[name], unit_of(scene, 'power'), 3)} at the "
        "output, which counts as converter loss, as only resistors there are the output: to count "
        "it, write * measure: output NAME = watts"
        for part in load.elements
        if (name := part.name.replace(".", "_")) in powers
        and not part.voltage
        and {*part.nodes[:2]} == {*load.pins[2:]}
    )


def _without_value(load, moments):
    """A note on each measure of a load whose expression has no value at some time."""
    names = without_value(moments)
    return tuple(
        f"{measure.where}: measure: {measure.kind} {measure.name} = {measure.expression} has no "
        "finite value at some time of the run, such as the root of a negative number or a quotient "
        "by 0; correct the expression"
        for measure in (load.measures if load else ())
        if any(row in names for row in measure.rows)
    )


def correlation_time(ready: Prepared, moments: Sequence[Moments]) -> float:
    """Least correlation time of a run's mean squares (s), by damping and the excitation's band.

    A mean square of Gaussian motion with the density S(f) has the variance ∫S² df/T of its mean,
    relative to (∫S df)²: the variance for an exponential autocorrelation with the time
    ∫S² df/(2 (∫S df)²). S is the excitation's density through a resonance with the rate at which
    the run lost its energy; 0 where that rate is not positive.
    """
    sums = sum(m.integrals.sum(axis=0) for m in moments)
    lost = sum(sums[QUANTITIES.index(name)] for name in LOSSES)
    square = sums[QUANTITIES.index("square_velocity")]
    if not lost > 0.0 or not square > 0.0:
        return 0.0
    excitation, rate = ready.scene.excitation, lost / square
    centre = timescales.angular_frequency(ready.system) / (2.0 * math.pi)
    width = rate / (2.0 * math.pi)
    # Even steps of the resonance's phase, and even ones between the breakpoints of the density.
    f = centre + 0.5 * width * np.tan(np.linspace(-0.5, 0.5, POINTS)[1:-1] * math.pi)
    measured = excitation.measured_density(ready.scene.run.duration / STRETCHES)
    corners = sorted(excitation.corners if measured is None else measured[0]) or [centre]
    places = np.linspace(0.0, len(corners) - 1.0, max(POINTS, len(corners)))
    f = np.unique(np.append(f[f > 0.0], np.interp(places, np.arange(len(corners)), corners)))
    density = excitation.density(f) if measured is None else np.interp(f, *measured)
    if density is None or not density.any():
        return 1.0 / rate
    response = f**2 / ((centre**2 - f**2) ** 2 + (width * f) ** 2) * density
    time = 0.5 * float(np.trapezoid(response**2, f) / np.trapezoid(response, f) ** 2)
    # The product of a sine and noise forgets with the amplitude, half as fast as the energy. In a
    # measured density a sine is a band as wide as the run resolves.
    return 2.0 * time if excitation.lines and measured is None else time


def error_of(scene: Scene, memory: float = 0.0, change: bool = False) -> Callable:
    """The function that gives a mean's error from batches, chosen by excitation and starts.

    `memory` is the least correlation time in batches, see `correlation_time`. `change` is true for
    the rate of change of a stored energy. Along one path that is the energy at the end less the
    energy at the beginning, so that only drawn starts give it an error.
    """
    excitation = scene.excitation
    drawn = excitation.random or scene.run.starts is not None
    if excitation.period is not None:
        return partial(error_without_chance, drawn=drawn)
    over_time = standard_error_of_drift if excitation.drifts else standard_error
    in_time = partial(over_time, memory=memory)
    if excitation.random:
        return in_time
    transient = excitation.transient(scene.run)

    def error(series: np.ndarray) -> float | None:
        # All starts meet the same stretch of the excitation.
        common = 0.0 if transient or change else in_time(series.mean(axis=0, keepdims=True))
        chance = error_of_starts(series) if drawn else 0.0
        return None if common is None else math.hypot(common, chance)

    return error


def with_steps(
    scene: Scene,
    estimate: Estimate,
    path_error: float,
    memory: float = 0.0,
    size: float | None = None,
    change: bool = False,
) -> Estimate:
    """The estimate with the error of its steps, if the excitation is deterministic.

    A periodic motion or a transient has no sample size. The sample size of another path is at most
    the number of correlation times `memory` (s): a repetition within a cycle is no further sample.
    The steps cost a share of `size`, by default the estimate's own; see `step_sizes`. `change`: see
    `error_of`.
    """
    excitation = scene.excitation
    if excitation.random:
        return estimate
    error, samples = estimate.standard_error, estimate.effective_sample_size
    size = abs(estimate.estimate) if size is None else size
    # The bars of these do not hold the scatter of batches.
    unvarying = change or excitation.period is not None or excitation.transient(scene.run)
    if unvarying:
        samples = None
    # A quantity that is constant while the motion changes does not depend on the steps.
    if error is not None and (unvarying or not constant(estimate.estimate, error)):
        total_error = math.hypot(error, path_error * size)
        if samples is not None and total_error > 0.0:
            samples *= (error / total_error) ** 2
        error = total_error
    if samples is not None and memory > 0.0:
        samples = min(samples, scene.run.duration / memory)
    return replace(estimate, standard_error=error, effective_sample_size=samples)


def _loose_nodes(load):
    """A note on nodes of a load that lead nowhere: a misspelt name makes such."""
    if load is None or not load.loose_nodes:
        return ()
    ellipsis = " …" if load.loose_nodes[3:] else ""
    return (f"nothing else is connected to the node {', '.join(load.loose_nodes[:3])}{ellipsis}",)
