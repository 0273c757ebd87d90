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
    deterministic_error,
    duration_for_error,
    error_of_starts,
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
from harvester.statistics.settling import (
    SMALLEST_DRIFT,
    Shortfall,
    shortfalls,
    slow_exchange,
    withheld,
)
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

# Powers that leave the mass; `loss_power` includes the transducer's loss.
LOSSES = ("load_power", "loss_power")
# Number of points of the integrals over frequency.
POINTS = 2001
# A record's spectral density is averaged over segments of 1/STRETCHES of the run's length.
STRETCHES = 8.0


# Changes of a transient's energies by longer steps are noted from this share on: three times the
# change of a resolved transient.
NOTED_CHANGE = 0.03
SENSITIVE = (
    "the motion is sensitive to the steps: the phase of the motion at an event depends on all "
    "steps before it; choose step = finest or a shorter one, preferably with method monte-carlo"
)
CHAOTIC = (
    "the path is chaotic: runs whose excitation differs by the possible step error end with powers "
    "that scatter by {:.0%}, so that no step resolves it and this path is one of many; error bars "
    "include that scatter; set run.starts = 100, which averages over starts, or take a longer "
    "record"
)
# A record longer by more than this factor is not recommended, although slow stores would need it.
LONGEST_ADVICE = 16.0
# Minimum number of periods of a deterministic excitation for an error from their differences.
FEWEST_PERIODS = 2
# Maximum number of notes on options of ngspice, which may differ between realizations.
MOST_NOTES = 3


@dataclass(frozen=True)
class RunEstimates:
    """Scaled estimates of a run, and caveats for citing them.

    Attributes
    ----------
    whole
        All estimates, each with its error bar.
    shortfalls
        Relaxations for which the run was too short.
    step_error
        Relative error of a power due to the step.
    path_error
        Relative error of the means of one deterministic path due to the step.
    residual
        Residual of the energy balance, as a share of the energy input.
    notes
        Notes on sources in the load, efficiencies above 1 and the shortfalls.
    moments
        Moments of the realizations, weighted by `harvester.statistics.well_balance` if wells
        differ.
    error
        Function that returns the error of a mean from batches of `moments`.
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
        """The estimates, without error bars that would be too small."""
        return withheld(self.whole, self.shortfalls)


def run_estimates(
    prepared_scene: Prepared, moments: Sequence[Moments], step_error: float = 0.0
) -> RunEstimates:
    """Estimates from the moments of a scene's realizations.

    `step_error`: see `harvester.scene.steps.step_error`; for deterministic runs it is part of the
    error.

    Raises
    ------
    SceneError
        The measured time contains no complete step.
    """
    scene, system, scales = prepared_scene.scene, prepared_scene.system, prepared_scene.scales
    moments = list(moments)
    if not measured_time(moments) > 0.0:
        raise SceneError(
            f"{scene.name}: run.duration = {scene.run.duration:g}: it contains no complete step; "
            "raise it to a few periods of the motion"
        )
    step_error = max(step_error, *(m.step_error for m in moments))
    spread = max(m.spread for m in moments)
    balance = well_balance(scene, system, moments)
    balanced = weighted(moments, balance)
    memory = correlation_time(prepared_scene, moments)
    batch = moments[0].batch_length

    def error_over(time, change=False):
        """Return a function that computes errors of means with this least correlation time (s)."""
        return balance.error if balance else error_of(scene, time / batch, change)

    error = error_over(memory)
    # A source that matches the load discharges a store twice as fast as the load alone.
    stores = store_states(prepared_scene, moments)
    # On a single path, means are conditional on the charge of slow stores, which hardly changes.
    drifts = scene.excitation.drifts
    longest = scene.run.duration / FEWEST_BATCHES if drifts else math.inf
    remembered = [s.memory for s in stores if s.memory <= longest or s.spread > SMALLEST_DRIFT]
    slow = memory + 0.5 * max(remembered, default=0.0)
    # On one path the voltage follows slow stores, to which a rectifier ties it.
    followed = error_over(slow) if drifts else error
    estimates = estimate_all(balanced, system, error, followed)
    estimates |= estimate_output(balanced, error_over(slow), error_over(slow, change=True))
    estimates |= device_storage(moments, balanced, system, error_over(memory, change=True))
    estimates |= estimate_strain(balanced, scene.excitation, error)
    square, power = (estimates[f"mean_{name}"].estimate for name in ("square_voltage", "power"))
    step_error *= faintness(susceptance(prepared_scene) * square, power)
    path_error = math.hypot(step_error, spread)
    estimates = _with_limited_samples(estimates, sum(m.points for m in moments))
    sizes = step_sizes(estimates, scene.load.circuit.measures if scene.load.circuit else ())
    # Kinetic and potential energy of a device are about its mean X'².
    held = estimates["mean_square_velocity"].estimate / scene.run.duration
    sizes["mean_device_storage_power"] = held
    estimates = {
        name: with_steps(
            scene, estimate, path_error, memory, sizes.get(name), name.endswith("storage_power")
        )
        for name, estimate in estimates.items()
    }
    reasons = shortfalls(prepared_scene, moments, estimates, balance, stores, slow / batch)
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
    estimates = _with_lengths(scene, balanced, estimates, slow if drifts else memory)
    return RunEstimates(
        estimates, reasons, step_error, path_error, residual, notes, balanced, error, balance
    )


def _with_limited_samples(estimates, points):
    """Limit the effective sample sizes to the number of computed points."""
    return {
        name: replace(estimate, effective_sample_size=float(points))
        if (estimate.effective_sample_size or 0.0) > points
        else estimate
        for name, estimate in estimates.items()
    }


def _with_lengths(scene, moments, whole, memory):
    """Name the duration that would give an error bar in the note of an estimate without one."""
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
    if duration <= run.duration and math.isinf(longest):  # e.g. too few jumps rather than periods
        return whole
    note = f"too short for an error bar: set run.duration = {number(duration, 2)} or more"
    if duration <= run.duration:
        note = f"too short for an error bar: {scene.excitation.longer_run(run)}"
    elif run.settle + duration > longest:
        length = number(run.settle + duration, 2)
        note = f"too short for an error bar: a record of {length} s or more has one"
        if duration > LONGEST_ADVICE * run.duration:
            note = "too short for an error bar: the value changes slowly over the measured time"
    return {
        name: replace(estimate, note=note) if estimate.note == TOO_SHORT else estimate
        for name, estimate in whole.items()
    }


def _sinks(scene, moments, scale):
    """A note on currents at the output that take power but count as a loss of the load."""
    load = scene.load.circuit
    if load is None or not load.has_output or any(m.kind == OUTPUT for m in load.measures):
        return ()
    powers = taken_by_sources(moments)
    return tuple(
        f"{part.name} takes {quantity(scale * powers[name], unit_of(scene, 'power'), 3)} at the "
        "output, which counts as converter loss, since only resistors count as output: to count "
        "it, write * measure: output NAME = watts"
        for part in load.elements
        if (name := part.name.replace(".", "_")) in powers
        and not part.voltage
        and {*part.nodes[:2]} == {*load.pins[2:]}
    )


def _without_value(load, moments):
    """A note on each measure of a load whose expression is not finite at some time."""
    names = without_value(moments)
    return tuple(
        f"{measure.where}: measure: {measure.kind} {measure.name} = {measure.expression} has no "
        "finite value at some time of the run, such as the root of a negative number or a quotient "
        "by 0; correct the expression"
        for measure in (load.measures if load else ())
        if any(row in names for row in measure.rows)
    )


def correlation_time(prepared_scene: Prepared, moments: Sequence[Moments]) -> float:
    """Minimum correlation time of a run's mean squares (s), from damping and excitation band.

    For Gaussian motion with the density S(f), the mean square over a time T has the variance ∫S²
    df/T relative to (∫S df)². An exponential autocorrelation with the time ∫S² df/(2 (∫S df)²)
    gives the same variance. S is the excitation's density filtered by a resonance whose damping
    rate is the run's energy loss rate. The result is 0 if this rate is not positive.
    """
    sums = sum(m.integrals.sum(axis=0) for m in moments)
    lost = sum(sums[QUANTITIES.index(name)] for name in LOSSES)
    square = sums[QUANTITIES.index("square_velocity")]
    if not lost > 0.0 or not square > 0.0:
        return 0.0
    excitation, rate = prepared_scene.scene.excitation, lost / square
    centre = timescales.angular_frequency(prepared_scene.system) / (2.0 * math.pi)
    width = rate / (2.0 * math.pi)
    # Even steps of the resonance's phase, and even steps between the breakpoints of the density.
    f = centre + 0.5 * width * np.tan(np.linspace(-0.5, 0.5, POINTS)[1:-1] * math.pi)
    measured = excitation.measured_density(prepared_scene.scene.run.duration / STRETCHES)
    corners = sorted(excitation.corners if measured is None else measured[0]) or [centre]
    positions = np.linspace(0.0, len(corners) - 1.0, max(POINTS, len(corners)))
    f = np.unique(np.append(f[f > 0.0], np.interp(positions, np.arange(len(corners)), corners)))
    density = excitation.density(f) if measured is None else np.interp(f, *measured)
    if density is None or not density.any():
        return 1.0 / rate
    response = f**2 / ((centre**2 - f**2) ** 2 + (width * f) ** 2) * density
    time = 0.5 * float(np.trapezoid(response**2, f) / np.trapezoid(response, f) ** 2)
    # The product of a sine and noise decorrelates with the amplitude, half as fast as the energy.
    # In a measured density a sine is a band as wide as the run's frequency resolution.
    return 2.0 * time if excitation.lines and measured is None else time


def error_of(scene: Scene, memory: float = 0.0, change: bool = False) -> Callable:
    """Return the function that computes a mean's error from batches, for this excitation and
    starts.

    `memory`: minimum correlation time in batches, see `correlation_time`. `change`: whether the
    mean is the rate of change of a stored energy. On one path this is the final energy less the
    initial energy, so that only random starts give it an error.
    """
    excitation = scene.excitation
    drawn = excitation.random or scene.run.starts is not None
    if excitation.period is not None:
        return partial(deterministic_error, drawn=drawn)
    over_time = standard_error_of_drift if excitation.drifts else standard_error
    in_time = partial(over_time, memory=memory)
    if excitation.random:
        return in_time
    transient = excitation.transient(scene.run)

    def error(series: np.ndarray) -> float | None:
        # All starts have the same excitation in this time.
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
    """The estimate; for a deterministic excitation, its error includes the step error.

    A periodic motion or a transient has no sample size. On other paths the sample size is at most
    the number of correlation times `memory` (s), since repetitions in a cycle add no information.
    The step error is a share of `size`, by default the estimate itself; see `step_sizes`. `change`:
    see `error_of`.
    """
    excitation = scene.excitation
    if excitation.random:
        return estimate
    error, samples = estimate.standard_error, estimate.effective_sample_size
    size = abs(estimate.estimate) if size is None else size
    # Error bars of such means do not include the scatter of batches.
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
    """A note on nodes of a load with a single connection, such as misspelt names."""
    if load is None or not load.loose_nodes:
        return ()
    ellipsis = " …" if load.loose_nodes[3:] else ""
    return (f"nothing else is connected to the node {', '.join(load.loose_nodes[:3])}{ellipsis}",)
