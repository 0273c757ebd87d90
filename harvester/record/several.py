"""Moments of several realizations, added to in one compiled call."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harvester.compilation import compiled
from harvester.record.jumps import Jumps, add_jumps
from harvester.record.moments import Moments, add_points
from harvester.record.record import Record

SUMS = ("integrals", "products", "histograms", "bin_widths", "first", "last")


class SeveralMoments:
    """Moments of several realizations of one scene, without an output side.

    What is added here appears in each of them.

    Parameters
    ----------
    moments : sequence of Moments
    """

    def __init__(self, moments: Sequence[Moments]) -> None:
        self._moments = moments
        one, batches = moments[0], len(moments[0].integrals)
        self._setting = (one.start, one.batch_length, *one.free, one.saddles, one.sample_interval)
        self._sums = _stacked(moments, SUMS)
        jumps = [each.jumps for each in moments if each.jumps is not None]
        self._jumps = jumps
        counted = jumps or [Jumps.between_no_wells(batches)] * len(moments)
        self._cores = (counted[0].limits, *counted[0].ends, counted[0].energies)
        self._counts = _stacked(counted, ("times", "counts"))
        self._wells = np.array([each.well for each in counted])
        self._reached = np.array([each.time for each in counted])

    def add(self, columns: np.ndarray, points: np.ndarray) -> None:
        """Accumulate one chunk of each that follows the ones before.

        Parameters
        ----------
        columns : ndarray, shape (realizations, 9, ·)
            Of a `Record` each.
        points : ndarray of int64, shape (realizations,)
            How many of them are meant.
        """
        _add(
            columns,
            points,
            self._setting,
            self._sums,
            self._cores,
            self._counts,
            self._wells,
            self._reached,
        )
        for each, count in zip(self._moments, points.tolist(), strict=True):
            each.points += count
        reached = zip(self._wells.tolist(), self._reached.tolist(), strict=True)
        for jumps, (well, time) in zip(self._jumps, reached, strict=False):
            jumps.well, jumps.time = well, time


def prepare() -> None:
    """Load the compiled code, so that it does not count as simulation."""
    nothing = Moments.empty(0.0, 1.0, (-1.0, 1.0), (), False, 1, 1, 1.0)
    SeveralMoments([nothing]).add(np.zeros((1, len(Record._fields), 1)), np.zeros(1, np.int64))


def _stacked(parts, names):
    """Arrays of several objects as one with a leading axis, of which each object keeps its own."""
    stacks = []
    for name in names:
        stack = np.stack([getattr(each, name) for each in parts])
        for each, row in zip(parts, stack, strict=True):
            setattr(each, name, row)
        stacks.append(stack)
    return tuple(stacks)


@compiled
def _add(columns, points, setting, sums, cores, counts, wells, reached):
    start, length, low, high, saddles, interval = setting
    integrals, products, histograms, widths, first, last = sums
    limits, left, right, energies = cores
    times, jumps = counts
    for k in range(points.size):
        n = points[k]
        if n == 0:
            continue
        row = columns[k]
        record = Record(
            row[0, :n], row[1, :n], row[2, :n], row[3, :n], row[4, :n], row[5, :n], row[6, :n],
            row[7, :n], row[8, :n],
        )  # fmt: skip
        if limits.size > 0:
            wells[k] = add_jumps(
                record.time, record.displacement, record.velocity, reached[k], start, length,
                saddles, limits, left, right, energies, wells[k], times[k], jumps[k],
            )  # fmt: skip
            reached[k] = record.time[-1]
        add_points(
            record, start, length, low, high, saddles, interval, integrals[k], products[k],
            histograms[k], widths[k], first[k], last[k],
        )  # fmt: skip
