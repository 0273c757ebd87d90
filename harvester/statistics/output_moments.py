"""Streaming moments of a load's output, in the batches of `harvester.statistics.moments`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from harvester.base.compilation import compiled, summing

# Columns of `OutputMoments.integrals`: time integrals.
QUANTITIES = (
    "time", "voltage", "square_voltage", "fourth_power_of_voltage", "square_deviation",
)  # fmt: skip
# Last axis of `OutputMoments.measured`: time integral, change, numbers of rises above 0 and falls
# to 0, time integral of the square.
MEASURED = ("integral", "change", "rises", "falls", "square")
# First-passage times of the output voltage are stored for levels from 2^-40 to 2^40 scaled volts,
# with this number of levels per doubling.
LEVELS_PER_DOUBLING = 32
DOUBLINGS = 40
LEVELS = np.exp2(
    np.arange(-DOUBLINGS * LEVELS_PER_DOUBLING, DOUBLINGS * LEVELS_PER_DOUBLING)
    / LEVELS_PER_DOUBLING
)


@dataclass
class OutputMoments:
    """Sums and first-passage times of one realization's output voltage, in scaled units.

    Attributes
    ----------
    start, batch_length : as in `harvester.statistics.moments.Moments` (s).
    integrals
        Shape (batches, len(QUANTITIES)).
    rows
        Kind and name of each measure of the load, then of each level.
    measured
        Scaled powers, energies and conditions; levels in V and A, without rises and falls; shape
        (batches, len(rows), len(MEASURED)).
    stored
        Energy in the load's capacitors and coils, scaled; shape (batches, len(MEASURED)).
    first
        Time at which each measure first exceeded 0, including settling (s); NaN: never, or the row
        is a level.
    latest
        Values of these rows at the latest point.
    passages
        Time at which |voltage| first reached each of LEVELS, including settling (s); NaN: never.
    lowest, highest
        Extremes of the voltage in the measured time.
    reference
        Voltage at the beginning of the measured time. `integrals` contains deviations from it,
        since the ripple of a steady voltage would be lost in the round-off of its square.
    conductance
        Sum over the resistors across the output, scaled: power is conductance voltage². NaN before
        the run's end.
    time, voltage, energy
        Values at the latest point.
    has_output
        Whether the load has an output; otherwise only its levels are recorded.
    """

    start: float
    batch_length: float
    integrals: np.ndarray
    rows: tuple[tuple[str, str], ...]
    measured: np.ndarray
    stored: np.ndarray
    first: np.ndarray
    latest: np.ndarray
    passages: np.ndarray = field(default_factory=lambda: np.full(LEVELS.size, np.nan))
    lowest: float = np.inf
    highest: float = -np.inf
    reference: float = np.nan
    conductance: float = np.nan
    time: float = np.nan
    voltage: float = np.nan
    energy: float = 0.0
    has_output: bool = True

    @classmethod
    def beside(
        cls, moments: Any, rows: tuple[tuple[str, str], ...] = (), has_output: bool = True
    ) -> OutputMoments:
        """Sums set to zero, with the start and the batches of `moments`.

        `rows` are the kinds and names of the load's measures.
        """
        batches = len(moments.integrals)
        return cls(
            moments.start,
            moments.batch_length,
            np.zeros((batches, len(QUANTITIES))),
            rows=rows,
            measured=np.zeros((batches, len(rows), len(MEASURED))),
            stored=np.zeros((batches, len(MEASURED))),
            first=np.full(len(rows), np.nan),
            latest=np.zeros(len(rows)),
            has_output=has_output,
        )

    def add(
        self,
        time: np.ndarray,
        voltage: np.ndarray,
        values: np.ndarray | None = None,
        levels: Sequence[np.ndarray | None] = (),
        energy: np.ndarray | None = None,
    ) -> None:
        """Accumulate consecutive points.

        Parameters
        ----------
        time, voltage : ndarray, shape (n,)
        values : ndarray, shape (measures, n), or None
            Values of the load's measures, if there are any.
        levels : sequence of ndarray, shape (n,), or None
            Values of the rows after the measures (V and A); None means 0.
        energy : ndarray, shape (n, n), or None
            Energy stored in the load (scaled), as a quadratic form of the first n levels.
        """
        if time.size == 0:
            return
        spans = _spans(time, self.time, self.start, self.batch_length, len(self.integrals))
        if energy is not None and energy.any():
            # Most terms are 0, so that summing the others is faster than matrix products.
            terms = ((energy[i, j], levels[i], levels[j]) for i, j in np.argwhere(energy))
            held = np.zeros_like(time)
            for factor, one, other in terms:
                if one is not None and other is not None:
                    held += factor * one * other
            _add_level(spans, time, held, self.time, self.energy, self.stored)
            self.energy = float(held[-1])
        self._add_levels(spans, time, levels)
        if values is not None and len(values):
            _add_measured(
                time, values, self.time, self.latest, self.start, self.batch_length, self.measured,
                self.first,
            )  # fmt: skip
        reached = int(np.count_nonzero(np.isfinite(self.passages)))
        _add_passages(time, voltage, LEVELS, reached, self.passages)
        if len(spans) and np.isnan(self.reference):
            begin = spans[0, 0]
            self.reference = float(voltage[begin - 1] if begin else self.voltage)
        _add_integrals(
            spans, time, voltage, self.time, self.voltage, self.reference, self.integrals
        )
        counted = voltage[np.searchsorted(time, self.start) :]
        if counted.size:
            self.lowest = min(self.lowest, float(counted.min()))
            self.highest = max(self.highest, float(counted.max()))
        self.time, self.voltage = float(time[-1]), float(voltage[-1])

    def _add_levels(self, spans, time, levels):
        for row, values in enumerate(levels, len(self.rows) - len(levels)):
            if values is not None:
                values = np.ascontiguousarray(values)
                _add_level(spans, time, values, self.time, self.latest[row], self.measured[:, row])
                self.latest[row] = values[-1]

    def passage(self, voltage: float) -> float:
        """Time (s) at which the output's |voltage| first reached a value; NaN if never."""
        reached = np.isfinite(self.passages)
        if not reached.any() or not 0.0 < voltage <= LEVELS[reached][-1]:
            return float("nan")
        return float(np.interp(voltage, LEVELS[reached], self.passages[reached]))


@compiled
def _add_passages(time, voltage, levels, reached, passages):
    """Record when |voltage| first reached each level, from level number `reached` on."""
    for i in range(time.size):
        while reached < levels.size and abs(voltage[i]) >= levels[reached]:
            passages[reached] = time[i]
            reached += 1


@compiled
def _add_measured(time, values, before, latest, start, batch_length, measured, first):
    """Add integrals, changes and counts of every measured interval, and first times."""
    batches = measured.shape[0]
    for i in range(time.size):
        counts = before >= start
        step = time[i] - before
        batch = 0
        if counts:
            batch = _batch_of(before, time[i], start, batch_length, batches)
        for row in range(len(values)):
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


@compiled
def _batch_of(before, after, start, batch_length, batches):
    """The batch of the middle of an interval."""
    return min(int((0.5 * (after + before) - start) / batch_length), batches - 1)


@compiled
def _spans(time, before, start, batch_length, batches):
    """Measured intervals by batch: first interval, end (exclusive), and number of the batch.

    An interval has the number of the point at its end.
    """
    begin, count, filled = 0, time.size, 0
    if not before >= start:
        begin = np.searchsorted(time, start) + 1
    spans = np.empty((batches, 3), np.int64)
    while begin < count:
        ahead = time[begin - 1] if begin > 0 else before
        batch = _batch_of(ahead, time[begin], start, batch_length, batches)
        end, beyond = begin + 1, count
        while end < beyond:
            middle = (end + beyond) // 2
            if _batch_of(time[middle - 1], time[middle], start, batch_length, batches) == batch:
                end = middle + 1
            else:
                beyond = middle
        spans[filled, 0], spans[filled, 1], spans[filled, 2] = begin, end, batch
        begin, filled = end, filled + 1
    return spans[:filled]


@compiled
def _add_integrals(spans, time, voltage, before, latest, reference, integrals):
    """Add every measured interval of the output voltage to its batch."""
    for k in range(spans.shape[0]):
        begin, end, batch = spans[k]
        ahead = time[begin - 1] if begin > 0 else before
        last = voltage[begin - 1] if begin > 0 else latest
        times, voltages = time[begin:end], voltage[begin:end]
        integral, square, fourth = _integrals(times, voltages, ahead, last)
        _, deviation, _ = _integrals(times, voltages - reference, ahead, last - reference)
        row = integrals[batch]
        row[0] += time[end - 1] - ahead
        row[1] += integral
        row[2] += square
        row[3] += fourth
        row[4] += deviation


@compiled
def _add_level(spans, time, values, before, latest, measured):
    """Add every measured interval of a level to its batch, like `_add_measured`.
    Adding single points took a twelfth of the time of a run with a bridge, a seventh with SECE.
    """
    for k in range(spans.shape[0]):
        begin, end, batch = spans[k]
        ahead = time[begin - 1] if begin > 0 else before
        last = values[begin - 1] if begin > 0 else latest
        integral, square, _ = _integrals(time[begin:end], values[begin:end], ahead, last)
        sums = measured[batch]
        sums[0] += integral
        sums[1] += values[end - 1] - last
        sums[4] += square


@summing
def _integrals(time, values, ahead, last):
    """Trapezoidal integrals of values, their squares and fourth powers, from the point `ahead`."""
    step, square, old = 0.5 * (time[0] - ahead), values[0] * values[0], last * last
    integral, squares = step * (values[0] + last), step * (square + old)
    fourths = step * (square * square + old * old)
    for i in range(1, time.size):
        step, value, last = 0.5 * (time[i] - time[i - 1]), values[i], values[i - 1]
        square, old = value * value, last * last
        integral += step * (value + last)
        squares += step * (square + old)
        fourths += step * (square * square + old * old)
    return integral, squares, fourths
