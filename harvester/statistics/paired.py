"""Paired differences of results on common noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from harvester.base.errors import HarvesterError
from harvester.base.plain_text import shown
from harvester.statistics.batch_means import (
    complete_batches,
    ratio_deviations,
    ratio_of_sums,
    standard_error,
)
from harvester.statistics.estimate import Estimate, why_no_error
from harvester.statistics.moments import QUANTITIES, Moments
from harvester.statistics.output_side import RATIOS, output_ratios
from harvester.statistics.run_quantities import MEANS
from harvester.statistics.well_balance import weighted, well_balance

# Two paths visit the same wells if no batch's share of time differs by more than this. For jumps at
# the same time the shares of two engines differ by less, for other jumps by most of a batch.
SAME_WELLS = 0.01
EQUAL_COUNTS = "no error bar: both count the same events, so that none tells how far they differ"
EFFICIENCY = "power_conversion_efficiency"
# Quantities that are ratios of sums over batches, for which `deviations` is defined.
WITH_DEVIATIONS = (*MEANS, *RATIOS, EFFICIENCY)


def paired_difference(result: Any, reference: Any) -> dict[str, Estimate]:
    """Relative differences of two results on the same noise paths, with paired errors.

    The common noise cancels in each batch as long as the two paths agree, so that the error is
    often far below the error of either mean. The error is the scatter of the difference itself: if
    paths diverge, nothing cancels, and it equals the error for independent means. If wells differ,
    means are computed from the jump rates, and the error includes the error of the rates.

    Parameters
    ----------
    result, reference : harvester.results.result.Result or harvester.engines.request.Answer
        Results with scene and moments; of the same scene, or of scenes with equal seed, number of
        realizations, settling, duration and samples of noise.

    Returns
    -------
    dict of str to Estimate
        (result − reference)/reference of every mean over time, and of the power conversion
        efficiency.

    Raises
    ------
    HarvesterError
        A result holds no moments: of averaging, or read from JSON. Or the runs have different
        seeds, numbers of realizations or batches.
    """
    for run in (result, reference):
        if not getattr(run, "moments", ()):
            raise HarvesterError(
                f"paired_difference: {shown(run)}: holds no batches on a path of noise, as orbits, "
                "averaging and JSON do; give two results of simulate"
            )
    _check_same_noise(result, reference)
    balances = [
        well_balance(run.scene, run.prepared_scene.system, run.moments)
        for run in (result, reference)
    ]
    ours, theirs = (
        complete_batches(weighted(run.moments, balance))
        for run, balance in zip((result, reference), balances, strict=True)
    )
    if ours is None or theirs is None or ours.shape != theirs.shape:
        return {}
    differences = {}
    for name in MEANS:
        pairs = [_of_batches(batches, name) for batches in (ours, theirs)]
        (upper, _), (reference_upper, _) = pairs
        if not reference_upper.any():
            continue
        ratio, error = ratio_of_sums(upper, reference_upper)
        if any(balances) and ratio:
            error = _error(ratio, pairs, balances)
        note = why_no_error(ratio, error)
        if error == 0.0 and MEANS[name][1] == "rate":
            error, note = None, EQUAL_COUNTS
        differences[name] = Estimate(ratio - 1.0, error, None, "1", note)
    pairs = [_of_batches(batches, EFFICIENCY) for batches in (ours, theirs)]
    if all(load.any() for load, _ in pairs):
        of_ours, of_theirs = (load.sum() / absorbed.sum() for load, absorbed in pairs)
        ratio = float(of_ours / of_theirs)
        error = _error(ratio, pairs, balances)
        note = why_no_error(ratio, error)
        differences[EFFICIENCY] = Estimate(ratio - 1.0, error, None, "1", note)
    return differences


def _check_same_noise(result, reference):
    """Raise if the batches of two results are not those of the same stretches of noise."""
    runs = [run.scene.run for run in (result, reference)]
    times = [(run.moments[0].start, run.moments[0].batch_length) for run in (result, reference)]
    for key in ("seed", "realizations", "settle", "duration"):
        first, second = (getattr(run, key) for run in runs)
        if first != second:
            raise HarvesterError(
                f"paired_difference: run.{key} = {first} and {second}: the runs are not on the "
                "same noise; simulate both scenes with the same [run]"
            )
    if not np.allclose(times[0], times[1], rtol=1e-6):
        raise HarvesterError(
            "paired_difference: the batches of the two runs differ in time; simulate both scenes "
            "with the same [run] and excitation"
        )


def _error(ratio, pairs, balances):
    """Standard error of the ratio of two estimates, including the jumps' contribution to each.

    Both are linearised ratios of sums over batches. If both paths visited the same wells in every
    batch, they share the contribution of the jumps.
    """
    shares = [ratio_deviations(upper, lower) * lower.sum() / upper.sum() for upper, lower in pairs]
    ours, theirs = balances
    same = ours and theirs and np.allclose(ours.features, theirs.features, 0.0, SAME_WELLS)
    for k, balance in enumerate(() if same else balances):
        if balance and balance.error(shares[k]) is None:
            return None
        shares[k] = balance.parts(shares[k]) if balance else shares[k]
    error = standard_error(shares[0] - shares[1])
    return None if error is None else abs(ratio) * error


def deviations(moments: Sequence[Moments], name: str) -> Any:
    """Deviation of each batch from an estimate, to first order; shape (realizations, batches).

    The error of a combination of results on common noise is the `standard_error` of the same
    combination of deviations, which accounts for the common noise. The mean is 0, the unit the
    estimate's scaled one; `name` is one of `WITH_DEVIATIONS`.
    """
    return ratio_deviations(*sums(moments, name))


def sums(moments: Sequence[Moments], name: str) -> tuple[Any, Any]:
    """Numerator and denominator of a quantity as sums over batches; see `deviations`."""
    if name in RATIOS:
        return output_ratios(moments)[name]
    return _of_batches(complete_batches(moments), name)


def _of_batches(batches, name):
    """Numerator and denominator of a mean or the efficiency (Eq. 35), from complete batches."""
    column = {quantity: batches[:, :, k] for k, quantity in enumerate(QUANTITIES)}
    if name == EFFICIENCY:
        return column["load_power"], column["load_power"] + column["loss_power"]
    return column[MEANS[name][0]], column["time"]
