"""Streaming joint histogram of displacement and velocity, computed on request."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harvester.base.compilation import compiled
from harvester.device.record import Record
from harvester.statistics.moments import FINEST_BIN

BINS = 256


@dataclass
class JointHistogram:
    """Samples of one realization in bins of (X, X'), symmetric about 0.

    Attributes
    ----------
    start, interval
        Beginning of the measured time, and time between samples (s).
    counts
        Counts by displacement (rows) and velocity (columns), shape (BINS, BINS).
    bin_widths
        Powers of two, doubled if a value is outside all bins.
    latest
        Time, displacement and velocity of the latest point.
    """

    start: float
    interval: float
    counts: np.ndarray
    bin_widths: np.ndarray
    latest: np.ndarray

    @classmethod
    def empty(cls, start: float, interval: float) -> JointHistogram:
        """A histogram without samples."""
        counts = np.zeros((BINS, BINS), dtype=np.uint32)
        return cls(start, interval, counts, np.full(2, FINEST_BIN), np.full(3, np.nan))

    def add(self, record: Record) -> None:
        """Sample one chunk of a record; chunks must be consecutive."""
        points = record.time, record.displacement, record.velocity
        _add_samples(*points, self.latest, self.start, self.interval, self.counts, self.bin_widths)


@compiled
def _add_samples(time, x, v, latest, start, interval, counts, widths):
    """Count states at integer multiples of the interval, interpolated linearly between points."""
    half = BINS // 2
    for i in range(time.size):
        begin = latest[0]
        if begin >= start and time[i] > begin:
            sample = np.floor(begin / interval + 1e-9) + 1.0
            while sample * interval <= time[i] + 1e-9 * interval:
                share = (sample * interval - begin) / (time[i] - begin)
                row = _bin_of(latest[1] + share * (x[i] - latest[1]), 0, counts, widths)
                column = _bin_of(latest[2] + share * (v[i] - latest[2]), 1, counts, widths)
                # The bins of the two axes may have been doubled separately.
                counts[row + half, column + half] += np.uint32(1)
                sample += 1.0
        latest[0], latest[1], latest[2] = time[i], x[i], v[i]


@compiled
def _bin_of(value, axis, counts, widths):
    """Bin of a value, counted from the middle; bins are doubled until one contains it."""
    half = BINS // 2
    position = np.floor(value / widths[axis])
    while position >= half or position < -half:
        _double(counts if axis == 0 else counts.T)
        widths[axis] *= 2.0
        position = np.floor(value / widths[axis])
    return int(position)


@compiled
def _double(counts):
    """Merge rows in pairs about the middle, in place."""
    half = BINS // 2
    for k in range(half // 2):
        counts[half + k] = counts[half + 2 * k] + counts[half + 2 * k + 1]
        counts[half - 1 - k] = counts[half - 1 - 2 * k] + counts[half - 2 - 2 * k]
    counts[: half // 2] = 0
    counts[half + half // 2 :] = 0


def prepare() -> None:
    """Load the compiled code, so that its time does not count as simulation time."""
    points = np.array([0.0, 1.0])
    JointHistogram.empty(0.0, 1.0).add(Record(*[points] * len(Record._fields)))
