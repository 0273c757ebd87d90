"""The joint density of displacement and velocity, by simulation or the stationary solver."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harvester.statistics.batch_means import FEWEST_BATCHES
from harvester.statistics.joint import JointHistogram

# Number of bins across the range in which the density exceeds this share of its peak.
BINS, MATTERS = 90, 1e-3


@dataclass(frozen=True)
class JointDensity:
    """p(X, X') at evenly spaced points, in scaled units.

    Attributes
    ----------
    displacement, velocity
        Bin centres or grid nodes; shapes (n,) and (m,).
    density
        Shape (n, m).
    standard_error
        From the scatter among realizations, shape (n, m); None if these are too few.
    """

    displacement: np.ndarray
    velocity: np.ndarray
    density: np.ndarray
    standard_error: np.ndarray | None

    def on(self, other: JointDensity) -> np.ndarray:
        """This density at the points of another one, interpolated linearly; 0 outside its range."""
        from scipy.interpolate import RegularGridInterpolator

        points = np.meshgrid(other.displacement, other.velocity, indexing="ij")
        axes = self.displacement, self.velocity
        within = RegularGridInterpolator(axes, self.density, bounds_error=False, fill_value=0.0)
        return within(np.stack(points, axis=-1))

    def distance(self, other: JointDensity) -> tuple[float, float]:
        """∬|p − p'| dX dX' between this density and another, on the points of this one.

        The second value is the distance expected from this density's standard errors; NaN without
        them.
        """
        area = np.prod([axis[1] - axis[0] for axis in (self.displacement, self.velocity)])
        apart = float(np.abs(self.density - other.on(self)).sum() * area)
        if self.standard_error is None:
            return apart, math.nan
        return apart, math.sqrt(2.0 / math.pi) * float(self.standard_error.sum() * area)


def joint_density(
    histograms: Sequence[JointHistogram], symmetric: bool = True
) -> JointDensity | None:
    """The density of all realizations' samples; None without samples.

    `symmetric` is as in `harvester.statistics.densities.densities`: each sample is also counted at
    its mirror image −(X, X').
    """
    widths = np.max([histogram.bin_widths for histogram in histograms], axis=0)
    factors = np.array(
        [np.round(widths / histogram.bin_widths) for histogram in histograms], dtype=int
    )
    counts = _of_one_shape(
        [_merged(histogram.counts, f) for histogram, f in zip(histograms, factors, strict=True)]
    )
    merging = [_bins_to_merge(counts.sum(axis=(0, axis))) for axis in (2, 1)]
    counts, widths = (
        np.stack([_merged(grid, merging) for grid in counts]).astype(float),
        widths * merging,
    )
    if symmetric:
        counts = 0.5 * (counts + counts[:, ::-1, ::-1])
    samples = counts.sum(axis=(1, 2))
    counts, samples = counts[samples > 0.0], samples[samples > 0.0]
    if not samples.size:
        return None
    area = float(np.prod(widths))
    density, error = counts.sum(axis=0) / (samples.sum() * area), None
    if len(counts) >= FEWEST_BATCHES:
        densities = counts / (samples[:, None, None] * area)
        error = densities.std(axis=0, ddof=1) / math.sqrt(len(counts))
    ranges = [slice(k[0], k[-1] + 1) for k in (np.flatnonzero(density.sum(axis=a)) for a in (1, 0))]
    centres = [
        (np.arange(bins) - bins // 2 + 0.5) * width
        for bins, width in zip(density.shape, widths, strict=True)
    ]
    return JointDensity(
        centres[0][ranges[0]],
        centres[1][ranges[1]],
        density[tuple(ranges)],
        None if error is None else error[tuple(ranges)],
    )


def _bins_to_merge(counts):
    """Number of adjacent bins to merge on an axis, so that about `BINS` cover the range."""
    seen = np.flatnonzero(counts > MATTERS * counts.max())
    return max(1, round((seen[-1] - seen[0] + 1) / BINS)) if seen.size else 1


def _merged(counts, factors):
    """Merge adjacent bins of each axis, about the middle."""
    for axis in np.flatnonzero(np.array(factors) > 1):
        factor = factors[axis]
        spare = -(counts.shape[axis] // 2) % factor
        wide = np.pad(counts, [(spare, spare) if k == axis else (0, 0) for k in range(2)])
        counts = np.add.reduceat(wide, np.arange(0, wide.shape[axis], factor), axis=axis)
    return counts


def _of_one_shape(arrays):
    """Pad arrays on all sides to the shape of the largest."""
    largest = np.max([array.shape for array in arrays], axis=0)
    margins = [(largest - array.shape) // 2 for array in arrays]
    return np.stack(
        [np.pad(a, [(k, k) for k in margin]) for a, margin in zip(arrays, margins, strict=True)]
    )
