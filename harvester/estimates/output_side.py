"""Quantities of a load's output side, with the error bars of `harvester.estimates.means`."""

import math

import numpy as np

from harvester.estimates.batch_means import FEWEST_BATCHES, complete_batches, ratio_of_sums
from harvester.estimates.estimate import TOO_SHORT, Estimate
from harvester.record.moments import QUANTITIES as PIEZO_QUANTITIES
from harvester.record.output_side import QUANTITIES

# Share of the final mean voltage at which the output counts as started.
STARTED = 0.9
ONE_VALUE = "one value a realization: no error bar"


def estimate_output(moments):
    """Quantities of the output side of a set of realizations.

    Parameters
    ----------
    moments : sequence of harvester.record.moments.Moments

    Returns
    -------
    dict of str to Estimate
        Scaled units; empty where the load has no output. What is harvested is what goes into
        the output's resistors and its storage: `converter_efficiency` is its share of the power
        leaving the piezo, `end_to_end_efficiency` that of the mechanical input.
    """
    batches = complete_batches(moments)
    if batches is None or any(m.output is None for m in moments):
        return {}
    series = {name: batches[:, :, row] for row, name in enumerate(PIEZO_QUANTITIES)}
    load, put_in, time = series["load_power"], series["input_power"], series["time"]
    own = np.stack([m.output.integrals[: batches.shape[1]] for m in moments])
    output = {name: own[:, :, row] for row, name in enumerate(QUANTITIES)}
    half = 0.5 * moments[0].output.capacitance
    used = moments[0].output.conductance * output["square_voltage"]
    stored = half * output["change_of_square_voltage"]
    harvested = used + stored
    estimates = {
        "mean_output_power": _mean(used, time, "power"),
        "mean_storage_power": _mean(stored, time, "power"),
        "mean_converter_loss": _mean(load - harvested, time, "power"),
        "converter_efficiency": _mean(harvested, load, "1"),
        "end_to_end_efficiency": _mean(harvested, put_in, "1"),
        "output_voltage": _mean(output["voltage"], time, "voltage"),
        "output_ripple": _ripple(output, time),
        "output_peak_to_peak": _single([m.output.highest - m.output.lowest for m in moments]),
        "start_up_time": _start_up(moments, output["voltage"], time),
    }
    if half > 0.0:
        estimates["stored_energy"] = _mean(half * output["square_voltage"], time, "energy")
        final = [half * m.output.voltage**2 for m in moments]
        estimates["final_stored_energy"] = _single(final, "energy")
    return estimates


def _mean(upper, lower, dimension):
    if not lower.any():
        return Estimate(math.nan, None, None, dimension, "nothing was put in")
    ratio, error = ratio_of_sums(upper, lower)
    return Estimate(ratio, error, None, dimension, "" if error is not None else TOO_SHORT)


def _ripple(output, time):
    """RMS of the voltage about its mean over the measured time (delta method)."""
    mean = float(output["voltage"].sum() / time.sum())
    # ⟨(v − mean)²⟩ batch by batch; to first order the mean's own error does not enter.
    spread = output["square_voltage"] - 2.0 * mean * output["voltage"] + mean**2 * time
    variance, error = ratio_of_sums(spread, time)
    ripple = math.sqrt(max(variance, 0.0))
    if error is not None:
        error = 0.5 * error / ripple if ripple > 0.0 else 0.0
    return Estimate(ripple, error, None, "voltage", "" if error is not None else TOO_SHORT)


def _start_up(moments, voltage, time):
    """First time at 90 % of the final mean, that of the last half of the measured time.

    Counted from the realization's beginning, settling included: the load starts discharged.
    """
    half = voltage.shape[1] // 2
    final = abs(float(voltage[:, half:].sum() / time[:, half:].sum()))
    return _single([m.output.passage(STARTED * final) for m in moments], "time")


def _single(values, dimension="voltage"):
    """Mean over realizations of what each gives once."""
    mean = float(np.mean(values))
    if len(values) < FEWEST_BATCHES:
        return Estimate(mean, None, None, dimension, ONE_VALUE)
    error = float(np.std(values, ddof=1)) / math.sqrt(len(values))
    return Estimate(mean, error, len(values), dimension)
