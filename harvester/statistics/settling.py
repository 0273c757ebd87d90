"""Whether a run is longer than the memory of its device and load, and whether its means drift.

Realizations start at rest. Batch means do not detect the part of the initial transient that remains
after `run.settle`. If this part changes a mean by more than its error bar, the error bar is
withheld, and a note names the relaxation time.

    0       settle                     settle + duration
    |-------|------------ measured ------------|
    the transient decays as exp(−t/τ); its mean over the measured time is `left_of_start`

Example: a store with τ = 400 s, a run with settle = 50 s and duration = 500 s. The mean lacks
400/500 · exp(−50/400) · (1 − exp(−500/400)) = 50 % of the change from the start. An error bar
of 2 % would be wrong: it is withheld, and the advice is run.settle = 8 τ = 3200 s.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.device import timescales
from harvester.statistics.batch_means import (
    FEWEST_BATCHES,
    complete_batches,
    constant,
    standard_error,
)
from harvester.statistics.estimate import OF_THE_VALUE, TOO_SHORT
from harvester.statistics.moments import QUANTITIES
from harvester.statistics.output_moments import QUANTITIES as OUTPUT_QUANTITIES
from harvester.statistics.output_side import output_ramp
from harvester.statistics.passivity import START_CHARGED
from harvester.statistics.well_balance import FEWEST_JUMPS

if TYPE_CHECKING:
    from harvester.device.system import System
    from harvester.scene.model import Scene
    from harvester.scene.prepared import Prepared
    from harvester.statistics.estimate import Estimate
    from harvester.statistics.moments import Moments
    from harvester.statistics.store_settling import StoreState
    from harvester.statistics.well_balance import WellBalance

# Number of relaxation times after which an initial transient is negligible, exp(−8) = 3e-4.
FORGETTING_TIMES = 8.0
# A drift is reported if it exceeds this share of the mean and this number of standard errors.
SMALLEST_DRIFT, DRIFT_IN_STANDARD_ERRORS = 2e-3, 4.5
# If a store lacks more than this multiple of its charge, the bound is not printed.
MOST_MISSING = 10.0
# Among the stores that lack at least this share of the largest missing charge, the note names the
# one with the largest capacitance.
FOLLOWING = 0.25
# After three exchange times of the wells, exp(−3) = 5 % of the effect of the starts remains. A note
# names shares of time that the starts change by more than 0.005.
SETTLED, NOTED_START = 3.0, 0.005
# With fewer than 16 jumps between the wells, one more jump would change the means visibly. A run
# without jumps is plausible if fewer than 0.05 are expected.
FEW_JUMPS, UNLIKELY_JUMPS = 16, 0.05
QUANTITIES_OF_THE_CHARGE = (
    "mean_square_voltage",
    "rms_voltage",
    "mean_power",
    "power_conversion_efficiency",
    "power_conversion_efficiency_of_input",
    # Only studies have this quantity.
    "output_power",
)
QUANTITIES_OF_THE_OUTPUT = (
    "output_voltage",
    "output_ripple",
    "mean_output_power",
    "stored_energy",
    "start_up_time",
    "output_power",
)
# Number of points over which the remaining transient of a coherent motion is averaged.
COHERENT_POINTS = 50
DRIFTING_QUANTITIES = {
    "E[V²]": "square_voltage",
    "E[X²]": "square_displacement",
    "E[X'²]": "square_velocity",
}


@dataclass(frozen=True)
class Shortfall:
    """A reason why a run was too short, with the affected quantities.

    Attributes
    ----------
    reason
        Short reason, printed next to each estimate.
    advice
        The consequence, and the setting to change.
    names
        Estimates that lose their error bars; None: all.
    """

    reason: str
    advice: str
    names: tuple | None = None

    @property
    def note(self) -> str:
        """The note as a full sentence."""
        return f"{self.reason}: {self.advice}"


def shortfalls(
    prepared_scene: Prepared,
    moments: list[Moments],
    estimates: dict[str, Estimate],
    balance: WellBalance | None = None,
    stores: Sequence[StoreState] = (),
    memory: float = 0.0,
) -> list[Shortfall]:
    """All reasons why a run was too short; empty for a transient or a sweep.

    The means of a transient or a sweep include that event. `balance`: the balance of the jumps
    between wells, if these differ. `stores`: the load's stores at the end of the run. `memory`:
    minimum correlation time in batches.
    """
    scene, p, excitation = (
        prepared_scene.scene,
        prepared_scene.system,
        prepared_scene.scene.excitation,
    )
    measured = math.isfinite(excitation.highest_frequency)
    event = excitation.drifts and (excitation.transient(scene.run) or not measured)
    if event or "mean_square_voltage" not in estimates:
        return []
    reasons = [_motion(scene, p, estimates), _charge(scene, p, moments, estimates)]
    if excitation.drifts:
        # Means over one record include its transients of stores and its jumps.
        return [reason for reason in (*reasons, _ramp(moments, estimates)) if reason]
    reasons += [
        _storage(scene, stores, estimates),
        _jumps(scene, p, moments, estimates),
        # Without noise the start determines the well, and a longer run has no more jumps.
        _residence(scene, p, moments, estimates, balance) if scene.excitation.random else None,
    ]
    reasons = [reason for reason in reasons if reason]
    return reasons or _drift(moments, balance, memory)


def withheld(estimates: dict[str, Estimate], shortfalls: list[Shortfall]) -> dict[str, Estimate]:
    """The estimates, without the error bars that would be too small."""
    result = dict(estimates)
    for shortfall in reversed(shortfalls):
        for name in result if shortfall.names is None else shortfall.names:
            estimate = result.get(name)
            if not estimate or math.isnan(estimate.estimate) or estimate.note in OF_THE_VALUE:
                continue
            result[name] = replace(
                estimate,
                standard_error=None,
                effective_sample_size=None,
                note=f"no error bar: {shortfall.reason}",
            )
    return result


def left_of_start(time: float, settle: float, duration: float) -> float:
    """Mean of exp(−t/time) over the measured time: the remaining share of an initial transient."""
    share = time / duration
    return share * math.exp(-settle / time) * -math.expm1(-1.0 / share)


def unseen_jump(p: System, square_voltage: Any, measured: float) -> float:
    """Relative increase of E[V²] by one further jump between the wells.

    The jump displaces the charge by the wells' distance; it decays within 1/λ.
    """
    wells, decay = timescales.wells(p), p.transducer.decay_rate()
    if len(wells) == 1 or not square_voltage:
        return 0.0
    distance = wells[0] - wells[-1]
    lasting = min(1.0 / (2.0 * decay), measured) if decay else measured
    share = distance**2 * lasting / (square_voltage * measured)
    return share if math.isfinite(share) else 0.0


def _relative_error(estimate):
    """Standard error as a share of the estimate; 0 if there is no error bar."""
    if estimate is None or estimate.standard_error is None or not estimate.estimate:
        return 0.0
    return abs(estimate.standard_error / estimate.estimate)


def _lengths(run):
    return f"run.settle = {run.settle:g} s and run.duration = {run.duration:g} s"


def _too_short(scene, time, what, share, names=None):
    run, settle = scene.run, FORGETTING_TIMES * time
    length = scene.excitation.own_duration if scene.excitation.drifts else None
    of_record = ""
    if length is not None and settle + run.duration > length:
        of_record = (
            f", which takes a record of {settle + run.duration:.2g} s or "
            'excitation.repetition = "periodic"'
        )
    return Shortfall(
        f"{_lengths(run)} are too short for {what} of {time:.3g} s",
        f"about {100.0 * share:.2g} % of the way from rest to the stationary means is missing in "
        f"the means; raise run.settle to at least {settle:.2g} s{of_record}",
        names,
    )


def _slow(scene, time, what, error, names=None):
    """Shortfall of a run compared with one relaxation time; None if the run is long enough."""
    run = scene.run
    share = left_of_start(time, run.settle, run.duration)
    if share > max(error, SMALLEST_DRIFT):
        return _too_short(scene, time, what, share, names)
    if scene.excitation.period is not None and not scene.excitation.random:
        return None
    return _few_values(scene, time, what, names)


def _few_values(scene, time, what, names=None):
    """Shortfall of a run with too few independent values of its slow quantities, or None."""
    run = scene.run
    # The number of independent values that the slow part of the motion takes.
    values = run.realizations * (1.0 + run.duration / (2.0 * time))
    if values >= FEWEST_BATCHES:
        return None
    return Shortfall(
        f"{_lengths(run)} are too short for {what} of {time:.3g} s",
        f"{run.realizations} realizations contain about {values:.0f} independent values; "
        f"set run.duration = {2.0 * FEWEST_BATCHES * time / run.realizations:.2g} or more",
        names,
    )


def _motion(scene, p, estimates):
    """Shortfall for small oscillations and the load's decay, by the linearised equations."""
    run, excitation = scene.run, scene.excitation
    if p.noise.intensity <= 0.0:
        return None
    matrix, states = _linear(p, estimates, scene.load.is_resistor)
    # The motion may stay in phase with a sine or a record, which may contain sines.
    coherent = excitation.drifts or bool(excitation.random and excitation.lines)
    if not np.all(np.isfinite(matrix)):
        return None
    rates = -np.linalg.eigvals(matrix).real
    if np.any(rates <= 0.0):
        return None
    error = max(
        _relative_error(estimates[name]) for name in ("mean_square_velocity", "mean_square_voltage")
    )
    bound = max(error, SMALLEST_DRIFT)

    def left(settle):
        missing = _left_in_squares(p, matrix, replace(run, settle=settle), coherent)
        return max(missing[state] for state in states)

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            share = left(run.settle)
            if share <= bound:
                return None
            # The slowest decays may hardly affect the means: use the shortest time that suffices.
            times = sorted(1.0 / rates)
            slow = next(
                (time for time in times if left(FORGETTING_TIMES * time) <= bound), times[-1]
            )
    except (RuntimeWarning, ValueError):
        # The rates are too far apart for a numerical solution.
        return None
    moving = ["output_power"] + [
        name
        for name, estimate in estimates.items()
        if not estimate.estimate
        or estimate.standard_error is None
        or not constant(estimate.estimate, estimate.standard_error)
    ]
    return _too_short(scene, slow, "a relaxation of device and load", share, tuple(moving))


def _linear(p, estimates, with_resistor):
    """Matrix of (X − rest, X', V, η), without V if the load is not a resistor.

    A netlist load discharges a piezo faster than its leakage does.

    Also returns the indices of the states whose mean squares are tested. The stiffness of a
    monostable spring is that at the measured E[X²]; another load's damping follows from the
    measured power.
    """
    square = estimates["mean_square_displacement"].estimate
    equilibrium = timescales.rest(p)
    stiffness = timescales.stiffness(p, equilibrium)
    if not timescales.bistable(p):
        spread = math.sqrt(max(square - equilibrium**2, 0.0))
        stiffness = sum(float(p.spring.slope(equilibrium + s * spread)) for s in (1, -1)) / 2.0
    memory = 1.0 / p.noise.correlation_time
    decay, damping = p.transducer.decay_rate(), p.damper.damping + p.transducer.damping()
    if decay == 0.0 or not with_resistor:
        total = stiffness + p.transducer.stiffness(stiffness)
        lost = sum(estimates[name].estimate for name in ("mean_power", "mean_loss_power"))
        damping = max(damping, lost / estimates["mean_square_velocity"].estimate)
        rows = [[0.0, 1.0, 0.0], [-total, -damping, 1.0], [0.0, 0.0, -memory]]
        return np.array(rows), (1,)
    return np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-stiffness, -damping, -p.transducer.coupling, 1.0],
            [0.0, 1.0, -decay, 0.0],
            [0.0, 0.0, 0.0, -memory],
        ]
    ), (1, 2)


def _left_in_squares(p, matrix, run, coherent):
    """Relative distance of the mean squares over the measured time from their stationary values.

    A `coherent` motion stays in phase: the remaining transient adds to the amplitudes rather than
    the squares, and decays half as fast. For partly coherent motion this is an upper bound.
    """
    from scipy.linalg import expm, solve_continuous_lyapunov

    noise = np.zeros_like(matrix)
    noise[-1, -1] = -2.0 * p.noise.intensity / p.noise.correlation_time**2
    stationary = solve_continuous_lyapunov(matrix, noise)
    missing = -stationary
    missing[-1, -1] = 0.0

    def later(time):
        flow = expm(matrix * time)
        return flow @ missing @ flow.T

    if coherent:
        steps = run.settle + run.duration * np.linspace(0.0, 1.0, COHERENT_POINTS) ** 2
        squares = np.abs([np.diag(later(time)) for time in steps]) / np.diag(stationary)
        return np.trapezoid(2.0 * np.sqrt(squares) - squares, steps, axis=0) / run.duration
    # The integral I of the missing covariance satisfies A I + I Aᵀ = its change.
    change = later(run.settle + run.duration) - later(run.settle)
    integral = solve_continuous_lyapunov(matrix, change)
    return np.abs(np.diag(integral)) / run.duration / np.diag(stationary)


def _charge(scene, p, moments, estimates):
    """Shortfall compared with 1/λ, the time in which the charge follows a jump between wells."""
    decay = p.transducer.decay_rate()
    if not timescales.bistable(p) or not decay:
        return None
    jumps = _total(moments, "well_crossings") or _expected_jumps(p, moments, estimates)
    if jumps < UNLIKELY_JUMPS:
        return None
    error = _relative_error(estimates["mean_square_voltage"])
    return _slow(scene, 1.0 / decay, "the load's 1/λ", error, QUANTITIES_OF_THE_CHARGE)


def _storage(scene, stores, estimates):
    """Shortfall for a store of the load that still charges, or is slow compared with the run."""
    run = scene.run
    measured = "output_voltage" if "output_voltage" in estimates else "mean_power"
    bound = max(_relative_error(estimates.get(measured)), SMALLEST_DRIFT)
    if not stores:
        return None
    worst = max(stores, key=lambda each: abs(each.missing) - DRIFT_IN_STANDARD_ERRORS * each.error)
    if abs(worst.missing) > bound + DRIFT_IN_STANDARD_ERRORS * worst.error:
        # Stray capacitances follow the storage capacitor.
        alike = [store for store in stores if abs(store.missing) > FOLLOWING * abs(worst.missing)]
        elements = scene.load.circuit.elements
        sizes = {part.name: part.size or 0.0 for part in elements if part.letter == "c"}
        worst = max(alike, key=lambda store: sizes.get(store.name, 0.0))
        away = f"its charge is up to {100.0 * abs(worst.missing):.2g} % away from its "
        longest = (
            f" (to {run.settle + FORGETTING_TIMES * worst.time:.2g} s at most, less where a diode "
            "charges it)"
        )
        if abs(worst.missing) > MOST_MISSING:
            # While diodes block, the bound is meaningless.
            away, longest = "it is far from its ", ""
        return Shortfall(
            f"the store {worst.name} ({worst.where}) still "
            f"{'charges' if worst.missing > 0.0 else 'discharges'}",
            f"{away}steady state, which affects all means; raise run.settle{longest}, or "
            + START_CHARGED,
        )
    if not scene.excitation.random:
        return None
    slowest = max(stores, key=lambda each: each.memory)
    if not slowest.memory > 0.0:
        return None
    return _few_values(scene, slowest.memory, f"the memory of the store {slowest.name}")


def _jumps(scene, p, moments, estimates):
    """Shortfall of a run with too few jumps to estimate their contribution to E[V²]."""
    crossings = _total(moments, "well_crossings")
    # Without noise, motion in one well remains there, and periodic motion between the wells has
    # equally many passes in each period.
    if not scene.excitation.random and (scene.excitation.period or not crossings):
        return None
    decay = p.transducer.decay_rate()
    if not timescales.bistable(p) or not decay or crossings >= FEW_JUMPS:
        return None
    square = estimates["mean_square_voltage"]
    measured = _total(moments, "time")
    increase = unseen_jump(p, square.estimate, measured)
    if increase <= max(_relative_error(square), SMALLEST_DRIFT):
        return None
    if not crossings and _expected_jumps(p, moments, estimates) < UNLIKELY_JUMPS:
        return None
    seen = f"{crossings:.0f} passes" if crossings else "no pass"
    return Shortfall(
        f"{seen} between the wells in {measured:.3g} s",
        f"one more jump would increase E[V²] by {100.0 * increase:.2g} %; raise run.duration or "
        "run.realizations",
        QUANTITIES_OF_THE_CHARGE,
    )


def _residence(scene, p, moments, estimates, balance):
    """Shortfall of a run with few jumps between wells, for quantities that depend on the well."""
    shares = [name for name in estimates if name.startswith("share_of_time_in_well_")]
    if not shares:
        return None
    counts = sum(realization.jumps.counts[:-1].sum(axis=0) for realization in moments)
    times = sum(realization.jumps.times[:-1].sum(axis=0) for realization in moments)
    if balance is None:
        # If the wells are alike, or all runs stay in the well of a given start, only the shares are
        # affected.
        names = tuple(shares)
        if counts.sum() >= FEWEST_JUMPS:
            return None
    else:
        names = tuple(name for name, estimate in estimates.items() if _unknown(name, estimate))
        if not names:
            return None
    fewest = float(min(counts.sum(axis=0).min(), counts.sum(axis=1).min()))
    needed = FEWEST_JUMPS / (fewest + 1.0) * times.sum()
    # Wells of a symmetric spring can differ only by their stoppers.
    untouched = p.spring.symmetric and p.contacts and not _total(moments, "impacts")
    averaged = scene.load.is_resistor and not scene.excitation.averaging_refusal()
    return Shortfall(
        f"{counts.sum():.0f} jumps between {'wells' if balance is None else 'uneven wells'} in "
        f"{times.sum():.3g} s"
        + f", only {fewest:.0f} into or out of one of them"
        * bool(counts.sum()),
        "shares of time and quantities that depend on them are unknown; simulate "
        f"{needed:.1g} s or more in total (run.duration times run.realizations)"
        + ", or average by fokker_planck" * averaged
        + "; the mass touched no stopper: without [stoppers] the wells are alike" * bool(untouched),
        names,
    )


def _unknown(name, estimate):
    """Whether an estimate lacks an error bar due to few jumps, or is a rate of few jumps."""
    is_rare = (estimate.effective_sample_size or FEWEST_JUMPS) < FEWEST_JUMPS
    return estimate.note == TOO_SHORT or (is_rare and name.startswith("jump_rate"))


def slow_exchange(scene: Scene, balance: WellBalance | None) -> tuple[str, ...]:
    """A note if settling and run are short compared with the exchange time of the wells."""
    if balance is None or balance.shares is None:
        return ()
    run = scene.run
    # Realizations start in successive wells, or all in the same one.
    missing = 1.0 if scene.start else np.max(np.abs(balance.shares - 1.0 / len(balance.shares)))
    if missing * left_of_start(balance.exchange_time, run.settle, run.duration) < NOTED_START:
        return ()
    return (
        f"shares of time settle within {balance.exchange_time:.3g} s, but run.settle is "
        f"{run.settle:g} s: they are computed from the jump rates, not from the run; "
        f"with run.settle = {SETTLED * balance.exchange_time:.2g} both agree",
    )


def _total(moments, quantity):
    return sum(float(m.integrals[:, QUANTITIES.index(quantity)].sum()) for m in moments)


def _expected_jumps(p, moments, estimates):
    """Largest likely number of jumps out of the wells, by the rate of a weakly damped mass.

    The energy is the upper end of its interval, so that runs with little energy by chance lose
    their error bars like others. A slow charge raises the barrier, in proportion to the load's time
    constant over the motion's.
    """
    square, decay = timescales.angular_frequency(p) ** 2, p.transducer.decay_rate()
    lagging, lifting = square / (decay**2 + square), p.transducer.stiffness(square)
    barrier = min(
        timescales.barrier(p, well) + 0.5 * lagging * lifting * (well - saddle) ** 2
        for well in timescales.wells(p)
        for saddle in timescales.beside(p, well)
    )
    square_velocity = estimates["mean_square_velocity"]
    energy = square_velocity.estimate + 2.0 * (square_velocity.standard_error or 0.0)
    if not energy > 0.0 or not math.isfinite(barrier):
        return 0.0
    height = barrier / energy
    return height * math.exp(-height) / timescales.relaxation_time(p) * _total(moments, "time")


def _drift(moments, balance, memory):
    """Shortfalls for means that change from the first half of the measured time to the second."""
    batches = complete_batches(moments)
    if batches is None or batches.shape[1] < 2:
        return []
    series = {
        name: batches[:, :, QUANTITIES.index(row)] for name, row in DRIFTING_QUANTITIES.items()
    }
    time = batches[:, :, QUANTITIES.index("time")]
    if all(m.has_output for m in moments):
        integrals = np.stack([m.output.integrals[: batches.shape[1]] for m in moments])
        series["the output voltage"] = integrals[:, :, OUTPUT_QUANTITIES.index("voltage")]
    for name, values in series.items():
        values = values / time
        change = _change(balance.without_wells(values) if balance else values, memory)
        if change:
            return [
                Shortfall(
                    f"{name} still drifts",
                    f"it changes by {change:+.2g} of its mean from the first half of the measured "
                    "time to the second; raise run.settle and run.duration",
                )
            ]
    return []


def _ramp(moments, estimates):
    """Shortfall for an output that ramps throughout the measured time, or None."""
    ends = output_ramp(moments)
    mean = estimates["output_voltage"].estimate if ends else 0.0
    if ends is None or abs(ends[1] - ends[0]) <= SMALLEST_DRIFT * abs(mean):
        return None
    share = (ends[1] - ends[0]) / abs(mean)
    return Shortfall(
        f"the output voltage {'rises' if share > 0.0 else 'falls'} throughout the measured time",
        f"it changes by {share:+.2g} of its mean from the first to the last eighth; raise "
        f"run.settle, or {START_CHARGED}",
        QUANTITIES_OF_THE_OUTPUT,
    )


def _change(values, memory):
    """Relative change from the first half to the second; 0 if it may be due to chance."""
    half = values.shape[1] // 2
    early, late = values[:, :half], values[:, -half:]
    change, mean = float(late.mean() - early.mean()), float(values.mean())
    if not abs(change) > SMALLEST_DRIFT * abs(mean):
        return 0.0
    errors = [standard_error(part, memory=memory) for part in (early, late)]
    if len(values) >= FEWEST_BATCHES:
        differences = late.mean(axis=1) - early.mean(axis=1)
        spread = float(differences.std(ddof=1)) / math.sqrt(len(values))
        error = max(spread, math.hypot(*(error_or_none or 0.0 for error_or_none in errors)))
    else:
        bars = [bar for bar in errors if bar is not None]
        if len(bars) < len(errors):
            return 0.0
        error = math.hypot(*bars)
    return change / abs(mean) if abs(change) > DRIFT_IN_STANDARD_ERRORS * error else 0.0
