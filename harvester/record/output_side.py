"""Streaming accumulation of a load's output side, in the batches of `harvester.record.moments`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from harvester.compilation import compiled

if TYPE_CHECKING:
    from harvester.record.moments import Moments

# Columns of `OutputMoments.integrals`: time integrals, and a change.
QUANTITIES = (
    "time", "voltage", "square_voltage", "change_of_square_voltage", "fourth_power_of_voltage",
)  # fmt: skip
# Last axis of `OutputMoments.measured`: time integral, change, steps from 0 up and down to it, time
# integral of the square.
MEASURED = ("integral", "change", "rises", "falls", "square")
# Sizes of the output voltage whose first passage is kept, from 2^-40 to 2^40 scaled volts.
LEVELS_PER_DOUBLING = 32
DOUBLINGS = 40
LEVELS = np.exp2(
    np.arange(-DOUBLINGS * LEVELS_PER_DOUBLING, DOUBLINGS * LEVELS_PER_DOUBLING)
    / LEVELS_PER_DOUBLING
)


@dataclass
class OutputMoments:
    """What is kept of the output voltage of one realization; scaled units.

    Attributes
    ----------
    start, batch_length : float
        As in `harvester.record.moments.Moments` (s).
    integrals : ndarray, shape (batches, len(QUANTITIES))
    rows : tuple of (str, str)
        Kind and name of each measure of the load, and of each level.
    measured : ndarray, shape (batches, len(rows), len(MEASURED))
        Powers, energies and conditions, scaled; levels in V and A.
    first : ndarray, shape (len(rows),)
        When each was first above 0, settling included (s); nan: never.
    latest : ndarray, shape (len(rows),)
        Their values at the latest point.
    passages : ndarray, shape (len(LEVELS),)
        When the voltage's size first reached each level, settling included (s); nan: never.
    lowest, highest : float
        Of the voltage in the measured time.
    conductance, capacitance : float
        Of the resistors and capacitors across the output, scaled: power is conductance voltage²,
        energy ½ capacitance voltage². nan before the run's end.
    time, voltage : float
        Of the latest point.
    has_output : bool
        Whether the load has an output; else its levels alone are meant.
    """

    start: float
    batch_length: float
    integrals: np.ndarray
    rows: tuple[tuple[str, str], ...]
    measured: np.ndarray
    first: np.ndarray
    latest: np.ndarray
    passages: np.ndarray = field(default_factory=lambda: np.full(LEVELS.size, np.nan))
    lowest: float = np.inf
    highest: float = -np.inf
    conductance: float = np.nan
    capacitance: float = np.nan
    time: float = np.nan
    voltage: float = np.nan
    has_output: bool = True

    @classmethod
    def beside(
        cls,
        moments: Moments,
        rows: tuple[tuple[str, str], ...] = (),
        has_output: bool = True,
    ) -> OutputMoments:
        """Nothing accumulated yet, in the batches of these `Moments`."""
        batches = len(moments.integrals)
        return cls(
            moments.start,
            moments.batch_length,
            np.zeros((batches, len(QUANTITIES))),
            rows=rows,
            measured=np.zeros((batches, len(rows), len(MEASURED))),
            first=np.full(len(rows), np.nan),
            latest=np.zeros(len(rows)),
            has_output=has_output,
        )

    def add(self, time: np.ndarray, voltage: np.ndarray, values: np.ndarray | None = None) -> None:
        """Accumulate consecutive points that follow the ones before.

        Parameters
        ----------
        time, voltage : ndarray, shape (n,)
        values : ndarray, shape (len(rows), n), or None
            Of the load's measures, where it has any.
        """
        if time.size == 0:
            return
        if values is not None:
            _add_measured(
                time,
                values,
                self.time,
                self.latest,
                self.start,
                self.batch_length,
                self.measured,
                self.first,
            )
        reached = int(np.count_nonzero(np.isfinite(self.passages)))
        _add_passages(time, voltage, LEVELS, reached, self.passages)
        self.lowest, self.highest = _add_integrals(
            time,
            voltage,
            self.time,
            self.voltage,
            self.start,
            self.batch_length,
            self.lowest,
            self.highest,
            self.integrals,
        )
        self.time, self.voltage = float(time[-1]), float(voltage[-1])

    def passage(self, voltage: float) -> float:
        """When the output's size first reached a voltage (s); nan: never."""
        reached = np.isfinite(self.passages)
        if not reached.any() or not 0.0 < voltage <= LEVELS[reached][-1]:
            return float("nan")
        return float(np.interp(voltage, LEVELS[reached], self.passages[reached]))


@compiled
def _add_passages(time, voltage, levels, reached, passages):
    """Enter when the voltage's size first reached each level from the given one on."""
    for i in range(time.size):
        while reached < levels.size and abs(voltage[i]) >= levels[reached]:
            passages[reached] = time[i]
            reached += 1


@compiled
def _add_integrals(
    time, voltage, before, last, start, batch_length, lowest, highest, integrals
):  # fmt: skip
    """Trapezoidal integrals of every measured interval; returns the extremes so far."""
    batches = integrals.shape[0]
    for i in range(time.size):
        if time[i] >= start:
            lowest, highest = min(lowest, voltage[i]), max(highest, voltage[i])
        if before >= start:
            batch = min(int((0.5 * (time[i] + before) - start) / batch_length), batches - 1)
            row, step = integrals[batch], time[i] - before
            square, old = voltage[i] * voltage[i], last * last
            row[0] += step
            row[1] += 0.5 * (voltage[i] + last) * step
            row[2] += 0.5 * (square + old) * step
            row[3] += square - old
            row[4] += 0.5 * (square * square + old * old) * step
        before, last = time[i], voltage[i]
    return lowest, highest


@compiled
def _add_measured(time, values, before, latest, start, batch_length, measured, first):
    """Trapezoidal integrals, changes and steps of every measured interval, and first times."""
    batches = measured.shape[0]
    for i in range(time.size):
        counts = before >= start
        step = time[i] - before
        batch = 0
        if counts:
            batch = min(int((0.5 * (time[i] + before) - start) / batch_length), batches - 1)
        for row in range(latest.size):
            value, last = values[row, i], latest[row]
            if value > 0.0 and np.isnan(first[row]):
                first[row] = time[i]
            if counts:
                sums = measured[batch, row]
                sums[0] += 0.5 * step * (value + last)
                sums[1] += value - last
                sums[2] += value > 0.0 and not last > 0.0
                sums[3] += last > 0.0 and not value > 0.0
                sums[4] += 0.5 * step * (value * value + last * last)
            latest[row] = value
        before = time[i]
