"""Densities of displacement, velocity and voltage from histograms."""

from __future__ import annotations

import math

import numpy as np

from harvester.statistics.batch_means import FEWEST_BATCHES
from harvester.statistics.estimate import Density
from harvester.statistics.moments import HISTOGRAMS, Moments
from harvester.statistics.well_balance import WellBalance


def densities(
    moments: list[Moments],
    symmetric: bool = True,
    balance: WellBalance | None = None,
    drawn: bool = False,
) -> dict[str, Density]:
    """Densities of displacement, velocity and voltage by name, in scaled units.

    Parameters
    ----------
    symmetric : bool
        Whether −η is as likely as η. Eq. 4 is then invariant under (X, V, η) → (−X, −V, −η), so
        each sample is also counted at its mirror image. Otherwise a run that stays in one well
        would give the density of one well, with an error bar that ignores the other.
    balance : WellBalance or None
        Balance whose weights the moments have; if it has no errors, there are no error bars.
    drawn : bool
        Whether only the starts are random: error bars are then the scatter among realizations.
    """
    result = {}
    for k, name in enumerate(HISTOGRAMS):
        width = max(float(m.bin_widths[k]) for m in moments)
        of_each = [_rebinned(m, k, width) for m in moments]
        if drawn:
            of_each = [histogram.sum(axis=0, keepdims=True) for histogram in of_each]
        groups = np.concatenate(of_each)
        if symmetric:
            groups = 0.5 * (groups + groups[:, ::-1])
        times = groups.sum(axis=1)
        if not times.any():
            continue
        if balance is None:
            groups, times = groups[times > 0.0], times[times > 0.0]
        density = groups.sum(axis=0) / (times.sum() * width)
        error = None
        if len(groups) >= FEWEST_BATCHES:
            deviations = (groups / width - density * times[:, None]) / times.mean()
            if balance is None:
                error = deviations.std(axis=0, ddof=1) / math.sqrt(len(groups))
            else:
                error = balance.errors_of_groups(deviations)
        bins = groups.shape[1]
        centre = (np.arange(bins) - bins // 2 + 0.5) * width
        filled = np.flatnonzero(density)
        inside = slice(filled[0], filled[-1] + 1)
        result[name] = Density(
            centre[inside], density[inside], None if error is None else error[inside], name
        )
    return result


def _rebinned(moments, row, width):
    """One histogram's groups with coarser bins, shape (groups, bins)."""
    groups = moments.histograms[:, row]
    factor = round(width / float(moments.bin_widths[row]))
    half = groups.shape[1] // 2
    if factor == 1:
        return groups
    factor = min(factor, half)
    wide = np.zeros_like(groups)
    reach = half // factor
    merged = groups.reshape(groups.shape[0], -1, factor).sum(axis=2)
    wide[:, half - reach : half + reach] = merged
    return wide
