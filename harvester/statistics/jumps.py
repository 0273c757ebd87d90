"""Streaming count of jumps between wells, in the batches of `harvester.statistics.moments`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harvester.base.compilation import compiled, merged
from harvester.device import timescales
from harvester.device.cores import core_energies, cores_within
from harvester.device.record import Record
from harvester.device.system import System, potential

# Number of displacements at which the potential is tabulated, for linear interpolation.
TABULATED = 2049


@dataclass
class Jumps:
    """Time in each well, and numbers of jumps, in one realization; see `harvester.device.cores`.

    Attributes
    ----------
    start, batch_length : as in `harvester.statistics.moments.Moments` (s).
    saddles
        Displacements of the saddles, ascending; wells are counted from the left.
    limits
        Largest ½X'² + U(X) in the core of each well, scaled.
    ends
        Displacements between which all cores lie.
    energies
        U(X) at evenly spaced displacements between `ends`.
    times
        Time for which each well was the last one reached (s); the last row is for the time before
        `start`; shape (batches + 1, wells).
    counts
        Jumps from one well (row) to another (column); the last entry is for the time before
        `start`; shape (batches + 1, wells, wells).
    well
        The well reached last; −1 before the first.
    time
        Time of the latest point (s).
    """

    start: float
    batch_length: float
    saddles: np.ndarray
    limits: np.ndarray
    ends: tuple
    energies: np.ndarray
    times: np.ndarray
    counts: np.ndarray
    well: int = -1
    time: float = np.nan

    @classmethod
    def empty(cls, system: System, start: float, batch_length: float, batches: int) -> Jumps:
        """Empty counts for a device with several wells."""
        ends, wells = cores_within(system), len(timescales.wells(system))
        return cls(
            start=start,
            batch_length=batch_length,
            saddles=np.array(sorted(timescales.saddles(system))),
            limits=core_energies(system),
            ends=ends,
            energies=np.asarray(potential(system, np.linspace(*ends, TABULATED))),
            times=np.zeros((batches + 1, wells)),
            counts=np.zeros((batches + 1, wells, wells)),
        )

    @classmethod
    def between_no_wells(cls, batches: int) -> Jumps:
        """Empty counts for a device with one well."""
        nothing = np.zeros(0)
        ends, times = (0.0, 0.0), np.zeros((batches + 1, 0))
        return cls(0.0, 1.0, nothing, nothing, ends, nothing, times, times[:, None])

    def add(self, record: Record) -> None:
        """Count the jumps in one chunk of a record; chunks must be consecutive."""
        if record.time.size == 0:
            return
        self.well = add_jumps(
            record.time, record.displacement, record.velocity, self.time, self.start,
            self.batch_length, self.saddles, self.limits, *self.ends, self.energies, self.well,
            self.times, self.counts,
        )  # fmt: skip
        self.time = float(record.time[-1])


@compiled
def add_jumps(
    time: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    last: float,
    start: float,
    batch_length: float,
    saddles: np.ndarray,
    limits: np.ndarray,
    low: float,
    high: float,
    energies: np.ndarray,
    well: int,
    times: np.ndarray,
    counts: np.ndarray,
) -> int:
    """Add times and jumps, see `Jumps`; return the well that was reached last.

    `last`: time of the preceding point. An interval belongs to the batch of its middle and to the
    well reached before it.
    """
    batches, batch, stop, since = len(times) - 1, -1, -np.inf, last
    left, right = neighbours(saddles, well)
    for i in range(time.size):
        middle = 0.5 * (last + time[i])
        if middle >= stop:
            if well >= 0:
                times[batch, well] += last - since
            since = last
            if last >= start:
                batch = min(int((middle - start) / batch_length), batches - 1)
                stop = start + (batch + 1) * batch_length if batch < batches - 1 else np.inf
        last = time[i]
        if left < x[i] < right or not low < x[i] < high:
            continue
        # The mass is outside the well reached last. Test whether it is in the core of the well at
        # its position.
        nearest = np.searchsorted(saddles, x[i])
        energy = 0.5 * v[i] * v[i] + energy_at(energies, low, high, x[i])
        if energy <= limits[nearest]:
            if well >= 0:
                times[batch, well] += last - since
                counts[batch, well, nearest] += 1.0
            since, well = last, nearest
            left, right = neighbours(saddles, well)
    if well >= 0:
        times[batch, well] += last - since
    return well


@merged
def energy_at(energies: np.ndarray, low: float, high: float, x: float) -> float:
    """Interpolate U(x) linearly in a table over the displacements from `low` to `high`."""
    position = (x - low) / ((high - low) / (energies.size - 1))
    below = int(position)
    return energies[below] + (position - below) * (energies[below + 1] - energies[below])


@compiled
def neighbours(saddles: np.ndarray, well: int) -> tuple[float, float]:
    """The saddles on either side of a well; an empty interval if `well` is −1."""
    if well < 0:
        return np.inf, -np.inf
    left = saddles[well - 1] if well > 0 else -np.inf
    right = saddles[well] if well < saddles.size else np.inf
    return left, right
