"""Paired differences of results on common noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from harvester.scene.prepared import prepared
from harvester.statistics.batch_means import complete_batches, ratio_of_sums, standard_error
from harvester.statistics.estimate import Estimate, why_no_error
from harvester.statistics.moments import QUANTITIES, Moments
from harvester.statistics.output_side import RATIOS, output_ratio
from harvester.statistics.run_quantities import MEANS
from harvester.statistics.well_balance import weighted, well_balance

# Two paths go through the same wells if no batch's share of time in one differs by more than this:
# jumps that two engines make at the same time end up so close, others differ by most of a batch.
SAME_WELLS = 0.01


def paired_difference(result: Any, reference: Any) -> dict[str, Estimate]:
    """Relative differences of two results on the same noise paths, with paired errors.

    Batch by batch the common noise cancels as far as the two follow the same path, so that the
    error is often far below that of either mean. Where paths part, nothing cancels and the error
    is that of independent means: it is the scatter of the difference itself. Where wells differ,
    the means are those that the rates of jumps keep in balance, and the error holds the rates'.

    Parameters
    ----------
    result, reference : harvester.results.result.Result or harvester.engines.request.Answer
        Each with its scene and moments; of the same scene, or of scenes with the same seed, knots
        and length of run.

    Returns
    -------
    dict of str to Estimate
        (result − reference)/reference of every mean over time, and of the power conversion
        efficiency.
    """
    balances = [
        well_balance(run.scene, prepared(run.scene).system, run.moments)
        for run in (result, reference)
    ]
    ours, theirs = (
        complete_batches(weighted(run.moments, balance))
        for run, balance in zip((result, reference), balances, strict=True)
    )
    if ours is None or theirs is None or ours.shape != theirs.shape:
        return {}
    differences = {}
    for name, (quantity, _) in MEANS.items():
        row = QUANTITIES.index(quantity)
        if not theirs[:, :, row].any():
            continue
        ratio, error = ratio_of_sums(ours[:, :, row], theirs[:, :, row])
        if any(balances) and ratio:
            shares = [_share(batches, row) for batches in (ours, theirs)]
            error = _relative_error(shares, balances)
            error = None if error is None else abs(ratio) * error
        note = why_no_error(ratio, error)
        differences[name] = Estimate(ratio - 1.0, error, None, "1", note)
    efficiency = _paired_efficiency(ours, theirs, balances)
    return differences | ({"power_conversion_efficiency": efficiency} if efficiency else {})


def _share(batches, row):
    """Deviation of each batch from a mean over time, as a share of the mean."""
    sums, time = batches[:, :, row], batches[:, :, QUANTITIES.index("time")]
    return sums / sums.mean() - time / time.mean()


def _relative_error(shares, balances):
    """Standard error of the difference of two results' shares, with what jumps add to each.

    Where both went through the same wells in every batch, what jumps add is common to both.
    """
    ours, theirs = balances
    if ours and theirs and np.allclose(ours.features, theirs.features, rtol=0.0, atol=SAME_WELLS):
        return standard_error(shares[0] - shares[1])
    parts = []
    for share, balance in zip(shares, balances, strict=True):
        if balance is not None and balance.error(share) is None:
            return None
        parts.append(share if balance is None else balance.parts(share))
    return standard_error(parts[0] - parts[1])


def _paired_efficiency(ours, theirs, balances):
    """Relative difference of Eq. 35, both ratios linearised batch by batch; None without power."""
    load, loss = QUANTITIES.index("load_power"), QUANTITIES.index("loss_power")
    shares = []
    for batches in (ours, theirs):
        absorbed = batches[:, :, load] + batches[:, :, loss]
        if not batches[:, :, load].any():
            return None
        # For each batch: its load power over the mean of all, less its used power over the mean of
        # all.
        share = batches[:, :, load] / batches[:, :, load].mean() - absorbed / absorbed.mean()
        shares.append((batches[:, :, load].sum() / absorbed.sum(), share))
    ratio = float(shares[0][0] / shares[1][0])
    error = _relative_error([share for _, share in shares], balances)
    note = why_no_error(ratio, error)
    return Estimate(ratio - 1.0, None if error is None else ratio * error, None, "1", note)


def has_deviations(name: str) -> bool:
    """Whether a quantity is a ratio of sums over batches, which `deviations` takes apart."""
    return name in MEANS or name in RATIOS or name == "power_conversion_efficiency"


def deviations(moments: Sequence[Moments], name: str) -> Any:
    """Deviation of each batch from an estimate, to first order; shape (realizations, batches).

    Combinations of several results on common noise get their error from the same combination of
    these: `standard_error` of it knows what the results have in common. The mean is 0, the unit the
    estimate's scaled one; `name` is one for which `has_deviations` is true.
    """
    upper, lower = sums(moments, name)
    return (upper - upper.sum() / lower.sum() * lower) / lower.mean()


def sums(moments: Sequence[Moments], name: str) -> tuple[Any, Any]:
    """The sums over batches that a quantity is the ratio of; see `deviations`."""
    if name in RATIOS:
        return output_ratio(moments, name)
    batches: Any = complete_batches(moments)
    load, loss = QUANTITIES.index("load_power"), QUANTITIES.index("loss_power")
    if name == "power_conversion_efficiency":
        return batches[:, :, load], batches[:, :, load] + batches[:, :, loss]
    return batches[:, :, QUANTITIES.index(MEANS[name][0])], batches[:, :, QUANTITIES.index("time")]
