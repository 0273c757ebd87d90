"""The density of displacement and velocity together, by simulation or by the stationary solver."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from harvester.estimates.batch_means import FEWEST_BATCHES
from harvester.record.joint import JointHistogram


@dataclass(frozen=True)
class JointDensity:
    """p(X, X') at evenly spaced places, in scaled units.

    Attributes
    ----------
    displacement, velocity : ndarray, shapes (n,) and (m,)
        Centres of the bins, or nodes.
    density : ndarray, shape (n, m)
    standard_error : ndarray, shape (n, m), or None
        Among realizations; None where there are too few or none.
    """

    displacement: np.ndarray
    velocity: np.ndarray
    density: np.ndarray
    standard_error: np.ndarray | None

    def on(self, other: JointDensity) -> np.ndarray:
        """This density at the places of another one, linear between its own; 0 beyond."""
        places = np.meshgrid(other.displacement, other.velocity, indexing="ij")
        axes = self.displacement, self.velocity
        within = RegularGridInterpolator(axes, self.density, bounds_error=False, fill_value=0.0)
        return within(np.stack(places, axis=-1))

    def distance(self, other: JointDensity) -> tuple[float, float]:
        """∬|p − p'| dX dX' from another density, on the places of this one.

        And what of that the standard errors of this one make by chance; nan without them.
        """
        area = np.prod([axis[1] - axis[0] for axis in (self.displacement, self.velocity)])
        apart = float(np.abs(self.density - other.on(self)).sum() * area)
        if self.standard_error is None:
            return apart, math.nan
        return apart, math.sqrt(2.0 / math.pi) * float(self.standard_error.sum() * area)


def joint_density(
    histograms: Sequence[JointHistogram], symmetric: bool = True
) -> JointDensity | None:
    """The density that all realizations have sampled; None where there is no sample.

    Parameters
    ----------
    histograms : sequence of JointHistogram
        One of each realization.
    symmetric : bool
        As in `harvester.estimates.densities.densities`: each sample counts half for its mirror
        image −(X, X').
    """
    widths = np.max([each.bin_widths for each in histograms], axis=0)
    counts = np.stack([_coarser(each, widths) for each in histograms])
    if symmetric:
        counts = 0.5 * (counts + counts[:, ::-1, ::-1])
    samples = counts.sum(axis=(1, 2))
    counts, samples = counts[samples > 0.0], samples[samples > 0.0]
    if not samples.size:
        return None
    area = float(np.prod(widths))
    density, error = counts.sum(axis=0) / (samples.sum() * area), None
    if len(counts) >= FEWEST_BATCHES:
        each = counts / (samples[:, None, None] * area)
        error = each.std(axis=0, ddof=1) / math.sqrt(len(counts))
    bins = counts.shape[1]
    used = [slice(k[0], k[-1] + 1) for k in (np.flatnonzero(density.sum(axis=a)) for a in (1, 0))]
    centres = [(np.arange(bins) - bins // 2 + 0.5) * width for width in widths]
    return JointDensity(
        centres[0][used[0]],
        centres[1][used[1]],
        density[tuple(used)],
        None if error is None else error[tuple(used)],
    )


def _coarser(histogram, widths):
    """Counts of one realization in wider bins about the middle."""
    counts = histogram.counts.astype(float)
    for axis, width in enumerate(widths):
        factor = min(round(width / histogram.bin_widths[axis]), counts.shape[axis] // 2)
        counts = np.moveaxis(counts, axis, 0)
        half, kept = len(counts) // 2, len(counts) // 2 // factor
        wide = np.zeros_like(counts)
        merged = counts.reshape(-1, factor, counts.shape[1]).sum(axis=1)
        wide[half - kept : half + kept] = merged
        counts = np.moveaxis(wide, 0, axis)
    return counts
