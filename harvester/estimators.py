"""Means with error bars from the moments of one or several realizations.

Standard errors are those of batch means: batches in time, pooled over realizations, are joined
in pairs until neighbours are nearly uncorrelated, and what correlation is left is added to the
variance (Flyvbjerg and Petersen, J. Chem. Phys. 91, 461 (1989), stopped early). Ratios are
linearised batch by batch (delta method). Where too few batches are left, there is no error bar.
"""

import math
from dataclasses import dataclass

import numpy as np

from harvester.device import system, timescales
from harvester.moments import HISTOGRAMS, PRODUCTS, QUANTITIES, WELLS

# Fewest batches that give a standard error (good to about 1/√(2·16) = 18 % of itself), and the
# correlation between neighbours up to which its first-order correction is trusted.
FEWEST_BATCHES = 16
LARGEST_CORRELATION = 0.25
TOTAL_BATCHES = 256
TOTAL_GROUPS = 32
# Batches of each of many realizations: a drift shows between their halves.
FEWEST_TO_DRIFT = 4
KNOTS_PER_BATCH = 8
# Standard error as a share of its ratio that is nothing but rounding in the sums.
ROUNDING = 1e-12
# Between the samples of a histogram: some ten samples per period of the motion.
KNOTS_PER_SAMPLE = 4

# Means over time: the integral each is made from, and its dimension.
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

NONE_SEEN = "none seen: no error bar tells how rare they are"
TOO_SHORT = "too short for an error bar: raise run.duration or run.realizations"


@dataclass(frozen=True)
class Estimate:
    """A mean with its evidence, in scaled units or in those of `dimension`'s scale.

    Attributes
    ----------
    estimate : float
    standard_error : float or None
        None when the run is too short for one.
    effective_sample_size : float or None
        Independent samples that would give this error.
    dimension : str
        "voltage^2", "power", "1", "rate", …
    note : str
        Why there is no error bar; empty otherwise.
    """

    estimate: float
    standard_error: float | None
    effective_sample_size: float | None
    dimension: str
    note: str = ""


@dataclass(frozen=True)
class Density:
    """Histogram density: bin centres, density and its standard error, each of shape (n,)."""

    centre: np.ndarray
    density: np.ndarray
    standard_error: np.ndarray | None
    dimension: str


def batch_counts(realizations, knots):
    """Batches and histogram groups per realization.

    Parameters
    ----------
    realizations : int
    knots : float
        Knots of the noise per realization: a batch spans several.
    """
    most = max(1, int(knots / KNOTS_PER_BATCH))
    batches = min(max(-(-TOTAL_BATCHES // realizations), FEWEST_TO_DRIFT), most)
    return batches, min(-(-TOTAL_GROUPS // realizations), batches)


def standard_error(series):
    """Standard error of the mean of correlated batch means.

    Parameters
    ----------
    series : ndarray, shape (realizations, batches)
        Equal batches in time; rows are independent of each other.

    Returns
    -------
    float or None
        None when fewer than `FEWEST_BATCHES` batches are left before they are uncorrelated.
    """
    series = np.asarray(series, dtype=float)
    mean = series.mean()
    while series.size >= FEWEST_BATCHES:
        deviations = series - mean
        total = float(np.sum(deviations**2))
        if total == 0.0:
            return 0.0
        neighbours = float(np.sum(deviations[:, 1:] * deviations[:, :-1])) / total
        if neighbours <= LARGEST_CORRELATION:
            variance = total / (series.size * (series.size - 1))
            return math.sqrt(variance * (1.0 + 2.0 * max(neighbours, 0.0)))
        series = _joined(series)
    return None


def standard_error_of_drift(series):
    """Standard error of the mean where the strength of the excitation drifts, as in one record.

    From the differences of neighbouring batches (von Neumann, Ann. Math. Stat. 12, 367 (1941)),
    in which a slow drift cancels: the error of this mean among records that drift alike.
    Batches are joined until the correlation ρ between neighbours, which gives their successive
    differences the correlation (2ρ − 1)/(2 − 2ρ), is small; see `standard_error`. A motion that
    is as slow as the drift is taken for it.
    """
    series = np.asarray(series, dtype=float)
    while series.size >= FEWEST_BATCHES and series.shape[1] > 2:
        steps = np.diff(series, axis=1)
        total = float(np.mean(steps**2))
        if total == 0.0:
            return 0.0
        successive = float(np.mean(steps[:, 1:] * steps[:, :-1])) / total
        neighbours = (1.0 + 2.0 * successive) / (2.0 + 2.0 * successive)
        if neighbours <= LARGEST_CORRELATION:
            neighbours = max(neighbours, 0.0)
            variance = 0.5 * total / (1.0 - neighbours) / series.size
            return math.sqrt(variance * (1.0 + 2.0 * neighbours))
        series = _joined(series)
    return None


def _joined(series):
    """Batches joined in pairs; an odd one in front is dropped."""
    odd = series.shape[1] % 2
    return 0.5 * (series[:, odd::2] + series[:, odd + 1 :: 2])


def estimate_all(moments, parameters, error_of=standard_error):
    """Every quantity of a set of realizations.

    Parameters
    ----------
    moments : sequence of harvester.moments.Moments
        One per realization; batches that were not completed are left out.
    parameters : harvester.device.system.System
    error_of : callable
        `standard_error`, or `standard_error_of_drift`.

    Returns
    -------
    dict of str to Estimate
        Scaled units.
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
    estimates = {
        name: _mean(series, products, quantity, dimension, error_of)
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
    return estimates


def paired_difference(result, reference):
    """Relative differences of two results on the same noise paths, with paired errors.

    Batch by batch the common noise cancels as far as the two follow the same path, so that the
    error is often far below that of either mean. Where paths part, nothing cancels and the error
    is that of independent means: it is the scatter of the difference itself.

    Parameters
    ----------
    result, reference : harvester.results.Result
        Each with its moments; of the same scene, or of scenes with the same seed, knots and
        length of run.

    Returns
    -------
    dict of str to Estimate
        (result − reference)/reference of every mean over time, and of the power conversion
        efficiency.
    """
    ours, theirs = complete_batches(result.moments), complete_batches(reference.moments)
    if ours is None or theirs is None or ours.shape != theirs.shape:
        return {}
    differences = {}
    for name, (quantity, _) in MEANS.items():
        row = QUANTITIES.index(quantity)
        if not theirs[:, :, row].any():
            continue
        ratio, error = ratio_of_sums(ours[:, :, row], theirs[:, :, row])
        note = "" if error is not None else TOO_SHORT
        differences[name] = Estimate(ratio - 1.0, error, None, "1", note)
    efficiency = _paired_efficiency(ours, theirs)
    return differences | ({"power_conversion_efficiency": efficiency} if efficiency else {})


def _paired_efficiency(ours, theirs):
    """Relative difference of Eq. 35, both ratios linearised batch by batch; None without power."""
    load, loss = QUANTITIES.index("load_power"), QUANTITIES.index("loss_power")
    shares = []
    for batches in (ours, theirs):
        used = batches[:, :, load] + batches[:, :, loss]
        if not batches[:, :, load].any():
            return None
        # Of each batch: its load power over the mean, less its used power over the mean.
        share = batches[:, :, load] / batches[:, :, load].mean() - used / used.mean()
        shares.append((batches[:, :, load].sum() / used.sum(), share))
    ratio = float(shares[0][0] / shares[1][0])
    error = standard_error(shares[0][1] - shares[1][1])
    note = "" if error is not None else TOO_SHORT
    return Estimate(ratio - 1.0, None if error is None else ratio * error, None, "1", note)


def deviations(moments, name):
    """How far an estimate lies off its mean in each batch, to first order.

    Combinations of several results on common noise get their error from the same combination of
    these: `standard_error` of it knows what the results have in common.

    Parameters
    ----------
    moments : sequence of harvester.moments.Moments
    name : str
        A mean over time, or "power_conversion_efficiency".

    Returns
    -------
    ndarray, shape (realizations, batches)
        Mean 0, in the estimate's scaled units.
    """
    batches = complete_batches(moments)
    load, loss = QUANTITIES.index("load_power"), QUANTITIES.index("loss_power")
    if name == "power_conversion_efficiency":
        upper, lower = batches[:, :, load], batches[:, :, load] + batches[:, :, loss]
    else:
        upper = batches[:, :, QUANTITIES.index(MEANS[name][0])]
        lower = batches[:, :, QUANTITIES.index("time")]
    return (upper - upper.sum() / lower.sum() * lower) / lower.mean()


def energy_balance_residual(moments, parameters):
    """Energy put in that is not found again, as a share of the energy that flows.

    ∫ηX'dt − Δ(½X'² + U + ½βV²) − ∫loss dt − ∫load dt, over the measured time of all
    realizations, divided by the larger of what went in and what came out (Eq. 33).
    """
    put_in = load = loss = stored = 0.0
    for m in moments:
        total = m.integrals.sum(axis=0)
        put_in += total[QUANTITIES.index("input_power")]
        load += total[QUANTITIES.index("load_power")]
        loss += total[QUANTITIES.index("loss_power")]
        stored += stored_change(m, parameters)
    scale = max(abs(put_in), load + loss)
    return float((put_in - load - loss - stored) / scale) if scale > 0.0 else math.nan


def stored_change(moments, parameters):
    """Change of ½X'² + U + ½βV² over the measured time of one realization (scaled)."""
    last, first = (
        system.stored_energy(parameters, *point[1:4], point[7])
        for point in (moments.last, moments.first)
    )
    return last - first


def densities(moments, symmetric=True):
    """Densities of displacement, velocity and voltage, {name: Density}, scaled units.

    `symmetric` says that −η is as likely as η. Eq. 4 is then the same for (−X, −V, −η), so each
    value counts half for its mirror image: a run that spent its time in one well would else give
    one well's density, with an error bar that knows nothing of the other.
    """
    result = {}
    for k, name in enumerate(HISTOGRAMS):
        width = max(float(m.bin_widths[k]) for m in moments)
        groups = np.concatenate([_rebinned(m, k, width) for m in moments])
        if symmetric:
            groups = 0.5 * (groups + groups[:, ::-1])
        times = groups.sum(axis=1)
        groups = groups[times > 0.0]
        times = times[times > 0.0]
        if times.size == 0:
            continue
        density = groups.sum(axis=0) / (times.sum() * width)
        error = None
        if len(groups) >= FEWEST_BATCHES:
            each = groups / (times[:, None] * width)
            error = each.std(axis=0, ddof=1) / math.sqrt(len(groups))
        bins = groups.shape[1]
        centre = (np.arange(bins) - bins // 2 + 0.5) * width
        used = np.flatnonzero(density)
        inside = slice(used[0], used[-1] + 1)
        result[name] = Density(
            centre[inside], density[inside], None if error is None else error[inside], name
        )
    return result


def complete_batches(moments):
    """Batches that every realization completed, shape (realizations, batches, quantities)."""
    complete = min(
        int((m.time_reached - m.start) / m.batch_length + 1e-6) if m.time_reached > m.start else -1
        for m in moments
    )
    if complete < 0:
        return None
    if complete == 0:
        return np.stack([m.integrals[:1] for m in moments])
    return np.stack([m.integrals[:complete] for m in moments])


def ratio_of_sums(upper, lower, error_of=standard_error):
    """Ratio of two sums over batches and its standard error (None when too short)."""
    ratio = float(upper.sum() / lower.sum())
    error = error_of((upper - ratio * lower) / lower.mean())
    # Of a ratio that is the same in every batch only rounding is left.
    return ratio, 0.0 if error is not None and error <= ROUNDING * abs(ratio) else error


def _mean(series, products, name, dimension, error_of):
    mean, error = ratio_of_sums(series[name], series["time"], error_of)
    if dimension == "rate" and mean == 0.0:
        return Estimate(0.0, None, None, dimension, NONE_SEEN)
    size = None
    if error and (name, name) in products:
        size = max(products[name, name] - mean**2, 0.0) / error**2
    return Estimate(mean, error, size, dimension, "" if error is not None else TOO_SHORT)


def root(square):
    """RMS voltage from the mean-square one, with its error."""
    root = math.sqrt(square.estimate)
    error = square.standard_error
    if error is not None:
        error = 0.5 * error / root if root > 0.0 else 0.0
    return Estimate(root, error, square.effective_sample_size, "voltage", square.note)


def _efficiencies(series, products, error_of):
    """Eq. 35 in both forms: against what is lost and used, and against what is put in."""
    load, loss, put_in = series["load_power"], series["loss_power"], series["input_power"]
    load_load, load_loss = (
        products["load_power", "load_power"],
        products["load_power", "loss_power"],
    )
    used = load_load + 2.0 * load_loss + products["loss_power", "loss_power"]
    mean_used = float((load + loss).sum() / series["time"].sum())
    mean_input = float(put_in.sum() / series["time"].sum())
    cross, square = products["input_power", "load_power"], products["input_power", "input_power"]
    return {
        "power_conversion_efficiency": _efficiency(
            load, load + loss, mean_used, load_load, load_load + load_loss, used, error_of
        ),
        "power_conversion_efficiency_of_input": _efficiency(
            load, put_in, mean_input, load_load, cross, square, error_of
        ),
    }


def _efficiency(upper, lower, mean_lower, upper_square, cross, lower_square, error_of):
    """Ratio of two powers; the squares and `cross` are means of products within the run."""
    if mean_lower == 0.0:
        return Estimate(math.nan, None, None, "1", "nothing was put in")
    ratio, error = ratio_of_sums(upper, lower, error_of)
    size = None
    if error:
        variance = (upper_square - 2.0 * ratio * cross + ratio**2 * lower_square) / mean_lower**2
        size = max(variance, 0.0) / error**2
    return Estimate(ratio, error, size, "1", "" if error is not None else TOO_SHORT)


def _rebinned(moments, row, width):
    """One histogram's groups with coarser bins, shape (groups, bins)."""
    groups = moments.histograms[:, row]
    factor = round(width / float(moments.bin_widths[row]))
    half = groups.shape[1] // 2
    if factor == 1:
        return groups
    factor = min(factor, half)
    wide = np.zeros_like(groups)
    kept = half // factor
    merged = groups.reshape(groups.shape[0], -1, factor).sum(axis=2)
    wide[:, half - kept : half + kept] = merged
    return wide
