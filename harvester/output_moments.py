"""Streaming accumulation of a load's output side, in the same batches as `harvester.moments`."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

# Columns of `OutputMoments.integrals`: time integrals of these.
QUANTITIES = ("time", "voltage", "square_voltage", "output_power", "storage_power")
# Sizes of the output voltage whose first passage is kept, from 2^-40 to 2^40 scaled volts.
LEVELS_PER_DOUBLING = 32
LEVELS = np.exp2(np.arange(-40 * LEVELS_PER_DOUBLING, 40 * LEVELS_PER_DOUBLING) / 32.0)


class OutputRecord(NamedTuple):
    """A chunk of consecutive points of the output side, scaled units; arrays of one shape (n,).

    Attributes
    ----------
    time : s, increasing.
    voltage : between `out` and `ref`.
    output_power, storage_power : into the resistors and into the capacitors across them.
    """

    time: np.ndarray
    voltage: np.ndarray
    output_power: np.ndarray
    storage_power: np.ndarray


@dataclass
class OutputMoments:
    """What is kept of the output side of one realization.

    Attributes
    ----------
    start, batch_length : float
        As in `harvester.moments.Moments` (s).
    integrals : ndarray, shape (batches, len(QUANTITIES))
    passages : ndarray, shape (len(LEVELS),)
        When the voltage's size first reached each level, settling included (s); nan: never.
    lowest, highest : float
        Of the voltage in the measured time.
    capacitance : float
        Of the storage over the piezo's, times β, so that ½ capacitance voltage² is its scaled
        energy; 0 without storage, nan before the run's end.
    last : ndarray, shape (4,)
        The latest point, in `OutputRecord`'s order.
    """

    start: float
    batch_length: float
    integrals: np.ndarray
    passages: np.ndarray = field(default_factory=lambda: np.full(LEVELS.size, np.nan))
    lowest: float = np.inf
    highest: float = -np.inf
    capacitance: float = np.nan
    last: np.ndarray = field(default_factory=lambda: np.full(4, np.nan))

    @classmethod
    def beside(cls, moments):
        """Nothing accumulated yet, in the batches of these `Moments`."""
        batches = len(moments.integrals)
        return cls(moments.start, moments.batch_length, np.zeros((batches, len(QUANTITIES))))

    def add(self, record):
        """Accumulate one chunk that follows the ones before."""
        if record.time.size == 0:
            return
        self._add_passages(record.time, np.abs(record.voltage))
        points = np.column_stack([self.last, np.array(record)])
        self.last = points[:, -1].copy()
        points = points[:, points[0] >= self.start]
        if points.size == 0:
            return
        time, voltage = points[:2]
        self.lowest = min(self.lowest, float(voltage.min()))
        self.highest = max(self.highest, float(voltage.max()))
        middle = 0.5 * (time[1:] + time[:-1])
        batches = len(self.integrals)
        batch = np.minimum((middle - self.start) // self.batch_length, batches - 1).astype(int)
        values = np.stack([np.ones_like(time), voltage, voltage**2, *points[2:]])
        pieces = 0.5 * (values[:, 1:] + values[:, :-1]) * np.diff(time)
        for row, piece in enumerate(pieces):
            self.integrals[:, row] += np.bincount(batch, piece, minlength=batches)

    def passage(self, voltage):
        """When the output's size first reached a voltage (s); nan: never."""
        reached = np.isfinite(self.passages)
        if not 0.0 < voltage <= LEVELS[reached][-1:].max(initial=0.0):
            return float("nan")
        return float(np.interp(voltage, LEVELS[reached], self.passages[reached]))

    def _add_passages(self, time, size):
        reached = int(np.count_nonzero(np.isfinite(self.passages)))
        passed = int(np.searchsorted(LEVELS, size.max(), side="right"))
        if passed > reached:
            greatest = np.maximum.accumulate(size)
            first = np.searchsorted(greatest, LEVELS[reached:passed])
            self.passages[reached:passed] = time[first]
