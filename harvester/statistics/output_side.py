"""Quantities of a load's output, with error bars as in `statistics.run_quantities`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from circuits.netlist.kinds import BATTERY, LOSS, OUTPUT, STORE, SUPPLY
from harvester.base.formatting import number
from harvester.statistics.agreement import differ
from harvester.statistics.batch_means import (
    FEWEST_BATCHES,
    KNOTS_PER_HISTOGRAM_SAMPLE,
    complete_batches,
    ratio_estimate,
    ratio_of_sums,
    standard_error,
)
from harvester.statistics.estimate import (
    NO_OUTPUT,
    NOT_STARTED,
    NOTHING_PUT_IN,
    RESOLVED_SHARE,
    ROUNDED_OFF,
    STARTS_CHARGED,
    UNRESOLVED,
    Estimate,
    why_no_error,
)
from harvester.statistics.measures import (
    CHANGE,
    INTEGRAL,
    SECONDS_PER_HOUR,
    SQUARE,
    estimate_measures,
    measured_series,
)
from harvester.statistics.moments import QUANTITIES as PIEZO_QUANTITIES
from harvester.statistics.output_moments import QUANTITIES
from harvester.statistics.passivity import SUPPLIED

# The output has started when its voltage first reaches this share of the final mean voltage.
STARTED_SHARE = 0.9
# Power taken by the output, if the load's sources supply a part of it.
USED = "mean_power_used_at_output"
# An output ramps if the mean voltages of this many parts of the measured time are monotonic.
RAMP_STRETCHES = 8
ONE_VALUE_NOTE = "one value per realization: no error bar"
# A source of the load that delivers a smaller share of the harvested power is not reported
# separately, since the steps may cost as much.
LEAST_SUPPLY = 1e-3
# Below this share of the load's power, the output is zero. At 1e-8 the engines still agree to 12 %.
LEAST_SHARE = 1e-9
# Stores charge unevenly if the rates of the run's halves differ by more than this share of their
# mean, and by this number of its standard errors (three of the difference).
UNEVEN_SHARE, UNEVEN_SIGMAS = 0.2, 6.0
# Quantities that are ratios of two sums over batches, with their dimensions.
RATIOS = {
    "mean_output_power": "power",
    "mean_storage_power": "power",
    "mean_converter_loss": "power",
    "converter_efficiency": "1",
    "end_to_end_efficiency": "1",
    "output_voltage": "voltage",
}
_NOTHING_STORED = Estimate(0.0, None, None, "energy")


def estimate_output(
    moments: Sequence[Any],
    error_of: Callable = standard_error,
    error_of_change: Callable | None = None,
) -> dict[str, Estimate]:
    """Quantities of the load's output, scaled; empty without an output.

    The output power is dissipated in the output's resistors, or measured by the load's file.
    `mean_output_power` is this power less the power from the load's sources (`supplied_by_NAME`);
    if there are sources, `mean_power_used_at_output` is also given. The harvested power is the
    output power and the power into capacitors, coils and batteries. `converter_efficiency` is its
    ratio to the power leaving the piezo, `end_to_end_efficiency` its ratio to the mechanical input.
    The quantities of `estimate_measures` are included. `error_of_change` is for the charging rates
    of stores, by default `error_of`.
    """
    error_of_change = error_of_change or error_of
    batches = complete_batches(moments)
    if batches is None or not all(m.has_output for m in moments):
        return {}
    output = _output_series(moments, batches)
    time = batches[:, :, PIEZO_QUANTITIES.index("time")]
    sources, squares, estimates = supplied(moments), _squares(moments, output), {}
    used_energy, stored = _used_and_stored(moments, output)
    if sources:
        square = squares.pop("mean_output_power", None)
        estimates[USED] = ratio_estimate(
            used_energy, time, "power", squares=square, error_of=error_of
        )
    for name, energy in sources.items():
        estimates[f"{SUPPLIED}{name}"] = ratio_estimate(energy, time, "power", error_of=error_of)
    # The final mean is over the second half of the measured time. The load starts discharged, so
    # start-up is counted from the realization's beginning, including settling.
    late = slice(time.shape[1] // 2, None)
    final = abs(float(output["voltage"][:, late].sum() / time[:, late].sum()))
    started = [m.output.passage(STARTED_SHARE * final) for m in moments]
    load_energy = batches[:, :, PIEZO_QUANTITIES.index("load_power")]
    least_resolved = _least_resolved(used_energy, sources, load_energy, stored)
    for name, (upper, lower) in output_ratios(moments).items():
        estimate = ratio_estimate(
            upper, lower, RATIOS[name], NOTHING_PUT_IN, squares.get(name), error_of
        )
        if name in least_resolved:
            estimate = _resolved(estimate, upper, lower, least_resolved[name])
        estimates[name] = estimate
    side = moments[0].output
    has_load = side.conductance > 0.0 or any(kind == OUTPUT for kind, _ in side.rows)
    if not (has_load or sources):
        estimates["mean_output_power"] = Estimate(0.0, None, None, "power", NO_OUTPUT)
    estimates |= {
        "output_ripple": _ripple(moments, output, time, error_of),
        "output_peak_to_peak": _single([m.output.highest - m.output.lowest for m in moments]),
        "start_up_time": _start_up(started, moments, final),
    }
    mean = abs(estimates["output_voltage"].estimate)
    for name in ("output_ripple", "output_peak_to_peak"):
        if estimates[name].estimate <= RESOLVED_SHARE * mean:
            estimates[name] = Estimate(0.0, None, None, "voltage", UNRESOLVED)
    estimates |= _stored_energies(moments, time, error_of)
    storage = estimates["mean_storage_power"]
    # The energy per hour is a forecast, so its error includes the error due to the single path.
    is_battery = _taken_by_batteries(moments, time).any()
    final_energy = estimates.get("final_stored_energy", _NOTHING_STORED).estimate
    held = math.inf if is_battery else final_energy
    estimates["stored_energy_per_hour"] = _per_hour(storage, stored, time, held)
    if storage.note != ROUNDED_OFF:
        storage = ratio_estimate(stored, time, "power", error_of=error_of_change)
    estimates["mean_storage_power"] = storage
    return estimates | estimate_measures(moments, error_of, error_of_change)


def _least_resolved(used, sources, load_energy, stored):
    """Energies, by quantity, below which a difference or a ratio of energies is round-off."""
    load_energy, stored = abs(float(load_energy.sum())), abs(float(stored.sum()))
    exchanged = sum(abs(float(part.sum())) for part in (used, *sources.values()))
    sums = {
        "mean_output_power": exchanged,
        "mean_storage_power": exchanged + load_energy,
        "mean_converter_loss": exchanged + load_energy + stored,
        "converter_efficiency": exchanged + stored,
        "end_to_end_efficiency": exchanged + stored,
    }
    least = LEAST_SHARE * load_energy
    return {name: max(RESOLVED_SHARE * energy, least) for name, energy in sums.items()}


def _resolved(estimate, upper, lower, least):
    """A ratio of energies; 0 if `upper` and its error are below the resolution `least`."""
    error = estimate.standard_error or 0.0
    if least > 0.0 and abs(upper.sum()) <= least and error * abs(lower.sum()) <= least:
        return Estimate(0.0, None, None, estimate.dimension, ROUNDED_OFF)
    return estimate


def _per_hour(storage, stored, time, held):
    """Energy stored per hour; NaN if this rate cannot last for an hour.

    It cannot if the two halves of the run store at different rates, or if the energy of an hour
    exceeds the energy `held` by the stores, since their power depends on their voltage.
    """
    hour = replace(storage.times(SECONDS_PER_HOUR), dimension="hourly_energy")
    if storage.note == ROUNDED_OFF:
        return hour
    half = time.shape[1] // 2
    early, late = (
        float(stored[:, part].sum() / time[:, part].sum()) if half else storage.estimate
        for part in (slice(None, half), slice(half, None))
    )
    error, negligible = storage.standard_error or 0.0, UNEVEN_SHARE * abs(storage.estimate)
    uneven = differ(late - early, error, negligible=negligible, sigmas=UNEVEN_SIGMAS)
    if uneven:
        length = float(time.sum(axis=1).mean())
        change = abs(late - early) / max(abs(late), abs(early))
        note = (
            f"stores charge unevenly: their mean powers in the halves of the measured {length:.3g} "
            f"s differ by {change:.0%} of the larger one, so an hour cannot be extrapolated"
        )
        return Estimate(math.nan, None, None, "hourly_energy", note)
    change = abs(hour.estimate) + (hour.standard_error or 0.0)
    if change > held:
        times = f"{number(change / held, 2)} times " if held else "more than "
        note = (
            f"not extrapolated: the mean storage power of an hour, error included, is {times}the "
            "energy that the stores hold at the end"
        )
        return Estimate(math.nan, None, None, "hourly_energy", note)
    return hour


def _stored_energies(moments, time, error_of):
    """Mean and final energy of the load's stores; empty without stores.

    A battery's energy is its charge since the start of the measured time.
    """
    series = np.stack([m.output.stored[: time.shape[1]] for m in moments])
    charged = _taken_by_batteries(moments, time)
    if not series[:, :, INTEGRAL].any() and not charged.any():
        return {}
    # During a batch, on average half of a battery's charge has arrived.
    energy = series[:, :, INTEGRAL] + (np.cumsum(charged, axis=1) - 0.5 * charged) * time
    squares = None if charged.any() else series[:, :, SQUARE]
    final = [m.output.energy + into.sum() for m, into in zip(moments, charged, strict=True)]
    return {
        "stored_energy": ratio_estimate(energy, time, "energy", squares=squares, error_of=error_of),
        "final_stored_energy": _single(final, "energy"),
    }


def step_sizes(estimates: dict[str, Estimate], measures: Sequence[Any] = ()) -> dict[str, float]:
    """Sizes of the powers whose differences these quantities are; empty without an output.

    The step error of a power is proportional to the power, and a small difference of large powers
    has an error of the same size.

    Parameters
    ----------
    estimates : dict of str to Estimate
    measures : sequence of circuits.netlist.measures.Measure
        A loss whose expression is a difference has the size of the load's power.
    """
    if "mean_converter_loss" not in estimates:
        return {}
    sizes = {name: abs(estimate.estimate) for name, estimate in estimates.items()}
    load_power, put_in = sizes["mean_power"], sizes["mean_input_power"]
    supplies = [size for name, size in sizes.items() if name.startswith(SUPPLIED)]
    output = math.hypot(sizes.get(USED, sizes["mean_output_power"]), *supplies)
    harvested = math.hypot(output, sizes["mean_storage_power"])
    losses = [m.name for m in measures if m.kind == LOSS and m.trees[0][0] == "-"]
    return {
        "mean_output_power": output,
        "mean_storage_power": max(load_power, output),
        **{f"{m.name}_storage_power": max(load_power, output) for m in measures if m.kind == STORE},
        "stored_energy_per_hour": SECONDS_PER_HOUR * max(load_power, output),
        "mean_converter_loss": math.hypot(load_power, harvested),
        "converter_efficiency": harvested / load_power if load_power else 0.0,
        "end_to_end_efficiency": harvested / put_in if put_in else 0.0,
        **{f"{name}_loss": load_power for name in losses},
        **{f"{name}_loss_share": load_power / put_in if put_in else 0.0 for name in losses},
    }


def output_ratios(moments: Sequence[Any]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Numerator and denominator of each of `RATIOS`, of shape (realizations, batches)."""
    batches = complete_batches(moments)
    if batches is None:
        raise ValueError("moments without a complete batch have no ratio")
    series = {quantity: batches[:, :, row] for row, quantity in enumerate(PIEZO_QUANTITIES)}
    load, put_in, time = series["load_power"], series["input_power"], series["time"]
    output = _output_series(moments, batches)
    consumed, stored = _used_and_stored(moments, output)
    delivered = sum(supplied(moments).values(), np.zeros_like(time))
    harvested = consumed - delivered + stored
    return {
        "mean_output_power": (consumed - delivered, time),
        "mean_storage_power": (stored, time),
        "mean_converter_loss": (load - harvested, time),
        "converter_efficiency": (harvested, load),
        "end_to_end_efficiency": (harvested, put_in),
        "output_voltage": (output["voltage"], time),
    }


def supplied(moments: Sequence[Any]) -> dict[str, np.ndarray]:
    """Energy delivered by the load's sources in each batch: (realizations, batches) by name."""
    batches = complete_batches(moments)
    if batches is None:
        return {}
    consumed, stored = _used_and_stored(moments, _output_series(moments, batches))
    least = LEAST_SUPPLY * abs(consumed.sum() + stored.sum())
    return {
        name: -series
        for kind, name, series in _sources(moments)
        if kind in (SUPPLY, BATTERY) and -series.sum() > least
    }


def taken_by_sources(moments: Sequence[Any]) -> dict[str, float]:
    """Mean power (scaled) taken by each source of the load that takes power, by name."""
    batches = complete_batches(moments)
    if batches is None or not all(m.has_output for m in moments):
        return {}
    time = float(batches[:, :, PIEZO_QUANTITIES.index("time")].sum())
    powers = {name: float(series.sum()) / time for _, name, series in _sources(moments)}
    return {name: power for name, power in powers.items() if power > 0.0}


def _sources(moments):
    for row, (kind, name) in enumerate(moments[0].output.rows):
        if kind in (OUTPUT, SUPPLY, BATTERY):
            yield kind, name, measured_series(moments, row)[:, :, INTEGRAL]


def _used_and_stored(moments, output):
    """Energy delivered to the outputs, including energy from sources, and energy stored."""
    consumed = moments[0].output.conductance * output["square_voltage"]
    stored = np.stack([m.output.stored[: consumed.shape[1], CHANGE] for m in moments])
    consumed = consumed + sum(series for kind, _, series in _sources(moments) if kind == OUTPUT)
    return consumed, stored + _taken_by_batteries(moments, consumed)


def _taken_by_batteries(moments, like):
    """Energy that batteries store in each batch; 0 for batteries that deliver."""
    charged = np.zeros_like(like)
    for kind, _, series in _sources(moments):
        if kind == BATTERY and series.sum() > 0.0:
            charged = charged + series
    return charged


def _squares(moments, output):
    """Time integrals of squares of output voltage and output power, for effective sample sizes.

    The output power is omitted if it is a sum, since only squares of its parts are stored.
    """
    conductance = moments[0].output.conductance
    measured = [row for row, (kind, _) in enumerate(moments[0].output.rows) if kind == OUTPUT]
    powers = [measured_series(moments, row)[:, :, SQUARE] for row in measured]
    if conductance > 0.0:
        powers.append(conductance**2 * output["fourth_power_of_voltage"])
    squares = {"output_voltage": output["square_voltage"]}
    return squares | ({"mean_output_power": powers[0]} if len(powers) == 1 else {})


def _output_series(moments, batches):
    integrals = np.stack([m.output.integrals[: batches.shape[1]] for m in moments])
    return {name: integrals[:, :, row] for row, name in enumerate(QUANTITIES)}


def _ripple(moments, output, time, error_of):
    """RMS of the voltage about its mean over the measured time (delta method)."""
    reference = np.array([[m.output.reference] for m in moments])
    off = float(output["voltage"].sum() / time.sum()) - reference
    # ⟨(v − mean)²⟩ in each batch. To first order it does not depend on the error of the mean.
    deviation = output["voltage"] - reference * time
    spread = output["square_deviation"] - 2.0 * off * deviation + off**2 * time
    variance, error = ratio_of_sums(spread, time, error_of)
    ripple = math.sqrt(max(variance, 0.0))
    if error is not None:
        error = 0.5 * error / ripple if ripple > 0.0 else 0.0
    return Estimate(ripple, error, None, "voltage", why_no_error(ripple, error))


def _start_up(times, moments, final):
    """Start-up time of the output, with a note if it has not started by the end of the run."""
    # An output that starts within one knot spacing is not started by harvested energy.
    knot = moments[0].sample_interval / KNOTS_PER_HISTOGRAM_SAMPLE
    if all(time <= knot for time in times):
        return Estimate(0.0, None, None, "time", STARTS_CHARGED)
    if not np.isfinite(times).all():
        return Estimate(math.nan, None, None, "time", NOT_STARTED)
    estimate, ends = _single(times, "time"), output_ramp(moments)
    if ends is None or abs(abs(ends[1]) - final) <= (1.0 - STARTED_SHARE) * final:
        return estimate
    note = "the output voltage still ramps when the run ends: raise run.settle or run.duration"
    return replace(estimate, standard_error=None, effective_sample_size=None, note=note)


def output_ramp(moments: Sequence[Any]) -> tuple[float, float] | None:
    """First and last voltage of an output that ramps throughout the measured time; else None.

    They are the means of the first and the last of eight parts, whose means are monotonic. By
    chance this occurs in one of 20 000 runs.
    """
    batches = complete_batches(moments)
    if batches is None or batches.shape[1] < RAMP_STRETCHES or not moments[0].has_output:
        return None
    output = _output_series(moments, batches)
    voltage = output["voltage"].sum(axis=0) / output["time"].sum(axis=0)
    means = np.array([part.mean() for part in np.array_split(voltage, RAMP_STRETCHES)])
    steps = np.diff(means)
    return (float(means[0]), float(means[-1])) if (steps > 0).all() or (steps < 0).all() else None


def _single(values, dimension="voltage"):
    """Mean over realizations of a quantity with one value per realization."""
    mean = float(np.mean(values))
    if len(values) < FEWEST_BATCHES:
        return Estimate(mean, None, None, dimension, ONE_VALUE_NOTE)
    error = float(np.std(values, ddof=1)) / math.sqrt(len(values))
    return Estimate(mean, error, len(values), dimension)
