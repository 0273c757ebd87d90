"""All quantities of a set of realizations, from their moments."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from harvester.device import timescales
from harvester.device.cores import jump_rates
from harvester.device.system import System
from harvester.statistics.batch_means import (
    FEWEST_EFFECTIVE,
    complete_batches,
    independent_events,
    independent_samples,
    ratio_of_sums,
    standard_error,
)
from harvester.statistics.estimate import NONE_SEEN, NOTHING_PUT_IN, Estimate, root, why_no_error
from harvester.statistics.moments import PRODUCTS, QUANTITIES, WELLS, Moments

NEVER_REACHED = "no realization reached this well"
# Means over time, with the integral and the dimension of each.
MEANS = {
    "mean_square_voltage": ("square_voltage", "voltage^2"),
    "mean_power": ("load_power", "power"),
    "mean_square_displacement": ("square_displacement", "displacement^2"),
    "mean_square_velocity": ("square_velocity", "velocity^2"),
    "mean_input_power": ("input_power", "power"),
    "mean_loss_power": ("loss_power", "power"),
    "well_crossing_rate": ("well_crossings", "rate"),
    "impact_rate": ("impacts", "rate"),
    "mean_transducer_loss": ("transducer_loss", "power"),
}


def estimate_all(
    moments: list[Moments],
    parameters: System,
    error_of: Callable = standard_error,
    error_of_voltage: Callable | None = None,
) -> dict[str, Estimate]:
    """All quantities of a set of realizations, scaled; incomplete batches are ignored.

    `error_of`: function that returns the error of a mean from batches, see
    `harvester.statistics.run_estimates.error_of`; `error_of_voltage`: the same for the mean-square
    voltage, if it differs.
    """
    batches = complete_batches(moments)
    if batches is None:
        return {}
    series = {name: batches[:, :, row] for row, name in enumerate(QUANTITIES)}
    duration = sum(float(m.integrals[:, 0].sum()) for m in moments)
    products = {
        pair: sum(float(m.products[row]) for m in moments) / duration
        for pair, row in PRODUCTS.items()
    }
    errors_of = {"mean_square_voltage": error_of_voltage or error_of}
    estimates = {
        name: _mean(series, products, quantity, dimension, errors_of.get(name, error_of))
        for name, (quantity, dimension) in MEANS.items()
    }
    estimates["rms_voltage"] = root(estimates["mean_square_voltage"])
    estimates.update(_efficiencies(series, products, error_of))
    if not timescales.bistable(parameters):
        del estimates["well_crossing_rate"]
    if not parameters.contacts:
        del estimates["impact_rate"]
    if not parameters.lossy_transducer:
        del estimates["mean_transducer_loss"]
    for well in range(batches.shape[2] - WELLS):
        time_in_well = {"time_in_well": batches[:, :, WELLS + well], "time": series["time"]}
        estimates[f"share_of_time_in_well_{well + 1}"] = _mean(
            time_in_well, {}, "time_in_well", "1", error_of
        )
    return estimates | _jump_rates(moments, batches.shape[1], batches.shape[2] == WELLS, error_of)


def _jump_rates(moments, batches, alike, error_of):
    """Rates of jumps (1/s): jumps out of a well over the time spent in it."""
    jumps = [realization.jumps for realization in moments]
    if jumps[0] is None:
        return {}
    counts = np.stack([tally.counts[:batches] for tally in jumps])
    times = np.stack([tally.times[:batches] for tally in jumps])
    estimates = {}
    for name, pairs in jump_rates(times.shape[2], alike).items():
        count = sum(counts[:, :, well, other] for well, other in pairs)
        time = times[:, :, sorted({well for well, _ in pairs})].sum(axis=2)
        reached = {"jumps": count, "time": time}
        estimates[name] = (
            _mean(reached, {}, "jumps", "rate", error_of)
            if time.any()
            else Estimate(math.nan, None, None, "rate", NEVER_REACHED)
        )
    return estimates


def _mean(series, products, name, dimension, error_of):
    mean, error = ratio_of_sums(series[name], series["time"], error_of)
    if dimension == "rate" and mean == 0.0:
        return Estimate(0.0, None, None, dimension, NONE_SEEN)
    size = None
    if (name, name) in products:
        size = independent_samples(mean, products[name, name], error)
    elif dimension == "rate":
        size = independent_events(mean, error)
        if size is not None and size < FEWEST_EFFECTIVE:
            error = size = None
    elif name == "time_in_well":
        # The averaged quantity is always 0 or 1, and therefore equals its square.
        size = independent_samples(mean, mean, error)
    return Estimate(mean, error, size, dimension, why_no_error(mean, error))


def _efficiencies(series, products, error_of):
    """Both forms of Eq. 35: relative to the power lost and used, and to the input power."""
    load, loss, put_in = series["load_power"], series["loss_power"], series["input_power"]
    load_load = products["load_power", "load_power"]
    load_loss = products["load_power", "loss_power"]
    square_of_sum = load_load + 2.0 * load_loss + products["loss_power", "loss_power"]
    mean_used = float((load + loss).sum() / series["time"].sum())
    mean_input = float(put_in.sum() / series["time"].sum())
    cross, square = products["input_power", "load_power"], products["input_power", "input_power"]
    return {
        "power_conversion_efficiency": _efficiency(
            load, load + loss, mean_used, load_load, load_load + load_loss, square_of_sum, error_of
        ),
        "power_conversion_efficiency_of_input": _efficiency(
            load, put_in, mean_input, load_load, cross, square, error_of
        ),
    }


def _efficiency(upper, lower, mean_lower, upper_square, cross, lower_square, error_of):
    """Ratio of two powers; the squares and `cross` are means of products in the run."""
    if mean_lower == 0.0:
        return Estimate(math.nan, None, None, "1", NOTHING_PUT_IN)
    ratio, error = ratio_of_sums(upper, lower, error_of)
    size = None
    if error:
        variance = (upper_square - 2.0 * ratio * cross + ratio**2 * lower_square) / mean_lower**2
        size = max(variance, 0.0) / error**2
    return Estimate(ratio, error, size, "1", why_no_error(ratio, error))
