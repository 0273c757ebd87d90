"""Streaming accumulation of a record: batch integrals, histograms, first and last point.

One `Moments` per realization, of fixed size whatever the run's length. `harvester.estimates.means`
turns several of them into means with error bars.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harvester.compilation import compiled, summing
from harvester.record.jumps import Jumps
from harvester.record.output_side import STATE, OutputMoments
from harvester.record.record import Record

# Rows of `Moments.integrals`: time integrals of these, and the numbers of two events.
QUANTITIES = (
    "time",
    "square_voltage",
    "square_displacement",
    "square_velocity",
    "load_power",
    "input_power",
    "loss_power",
    "well_crossings",
    "impacts",
    "transducer_loss",
)
# Behind them, where they tell more than symmetry does: the time in each well, from the left.
WELLS = len(QUANTITIES)
# Rows of `Moments.products`: time integrals of products, for variances within a run.
PRODUCTS = {
    ("square_voltage", "square_voltage"): 0,
    ("square_displacement", "square_displacement"): 1,
    ("square_velocity", "square_velocity"): 2,
    ("load_power", "load_power"): 3,
    ("input_power", "input_power"): 4,
    ("loss_power", "loss_power"): 5,
    ("input_power", "load_power"): 6,
    ("load_power", "loss_power"): 7,
}
HISTOGRAMS = ("displacement", "velocity", "voltage")
BINS = 512
FINEST_BIN = 2.0**-40


@dataclass
class Moments:
    """What is kept of one realization's record.

    Attributes
    ----------
    start, batch_length : float
        Beginning of the first batch and length of each (s).
    free : (float, float)
        Displacements between which no contact acts, to count impacts.
    saddles : ndarray of float
        Displacements that part the wells, ascending, to count crossings.
    integrals : ndarray, shape (batches, len(QUANTITIES) or more)
    products : ndarray, shape (len(PRODUCTS),)
    histograms : ndarray, shape (groups, 3, BINS)
        Samples in each bin of displacement, velocity, voltage; bins symmetric about 0.
    sample_interval : float
        Time between the histograms' samples (s), which are taken at regular times: an engine's
        own points crowd where contact begins.
    bin_widths : ndarray, shape (3,)
        Powers of two, doubled whenever a value falls outside.
    first, last : ndarray, shape (9,)
        The first measured and the latest point, in `Record`'s order.
    points : int
        Accepted points, those before `start` included.
    output : OutputMoments or None
        Of the load's output side, where it has one.
    jumps : Jumps or None
        Between wells, where there are several.
    """

    start: float
    batch_length: float
    free: tuple
    saddles: np.ndarray
    sample_interval: float
    integrals: np.ndarray
    products: np.ndarray
    histograms: np.ndarray
    bin_widths: np.ndarray
    first: np.ndarray
    last: np.ndarray
    points: int = 0
    output: OutputMoments | None = None
    jumps: Jumps | None = None

    @classmethod
    def empty(
        cls,
        start: float,
        stop: float,
        free: tuple[float, float],
        saddles: Sequence[float] | np.ndarray,
        shares: bool,
        batches: int,
        groups: int,
        sample_interval: float,
    ) -> Moments:
        """Nothing accumulated yet, for the time from `start` to `stop` (s).

        `shares` says whether the time in each well is wanted.
        """
        saddles = np.sort(np.asarray(saddles, dtype=float))
        rows = WELLS + (len(saddles) + 1 if shares else 0)
        columns = len(Record._fields)
        return cls(
            start=start,
            batch_length=(stop - start) / batches,
            free=free,
            saddles=saddles,
            sample_interval=sample_interval,
            integrals=np.zeros((batches, rows)),
            products=np.zeros(len(PRODUCTS)),
            histograms=np.zeros((groups, len(HISTOGRAMS), BINS)),
            bin_widths=np.full(len(HISTOGRAMS), FINEST_BIN),
            first=np.full(columns, np.nan),
            last=np.full(columns, np.nan),
        )

    @property
    def time_reached(self) -> float:
        """Time of the latest point (s); nan before the first."""
        return float(self.last[0])

    def add(self, record: Record) -> None:
        """Accumulate one chunk that follows the ones before."""
        if record.time.size == 0:
            return
        self.points += record.time.size
        if self.jumps is not None:
            self.jumps.add(record)
        # The latest point again in front: every interval then lies within one array.
        points = np.empty((len(record), record.time.size + 1))
        points[:, 0] = self.last
        for row, column in enumerate(record):
            points[row, 1:] = column
        self.last = points[:, -1].copy()
        if not self.last[0] >= self.start:
            return
        if not points[0, 0] >= self.start:
            points = np.ascontiguousarray(points[:, points[0] >= self.start])
        if np.isnan(self.first[0]):
            self.first = points[:, 0].copy()
        _add_integrals(
            points,
            self.start,
            self.batch_length,
            *self.free,
            self.saddles,
            self.integrals,
            self.products,
        )
        _add_samples(
            points,
            self.start,
            self.batch_length * len(self.integrals) / len(self.histograms),
            self.sample_interval,
            self.histograms,
            self.bin_widths,
        )


def prepare() -> None:
    """Load the compiled code, so that it does not count as simulation."""
    points = np.zeros(2)
    moments = Moments.empty(0.0, 1.0, (-1.0, 1.0), (), False, 1, 1, 1.0)
    nothing, ones = np.zeros(1), np.ones((1, 2))
    ends = (-1.0, 1.0)
    moments.jumps = Jumps(0.0, 1.0, nothing, points, ends, points, ones, ones[:, None] * ones)
    time = np.array([0.0, 1.0])
    moments.add(Record(time, *[points] * (len(Record._fields) - 1)))
    output = OutputMoments.beside(moments, ((STATE, ""),))
    output.add(time, points, points[None])


@summing
def _add_integrals(points, start, batch_length, low, high, saddles, integrals, products):
    """Trapezoidal integrals of every interval; each belongs to the batch of its middle."""
    batches = integrals.shape[0]
    time, x = points[0], points[1]
    begin = 0
    while begin < time.size - 1:
        middle = 0.5 * (time[begin] + time[begin + 1])
        batch = min(int((middle - start) / batch_length), batches - 1)
        stop = start + (batch + 1) * batch_length if batch < batches - 1 else np.inf
        end = begin + 1
        while end + 1 < time.size and 0.5 * (time[end] + time[end + 1]) < stop:
            end += 1
        _add_stretch(points, begin, end, integrals[batch], products)
        for i in range(begin, end):
            outside = (x[i + 1] > high) | (x[i + 1] < low)
            integrals[batch, 8] += outside & (low <= x[i]) & (x[i] <= high)
        for saddle in saddles:
            for i in range(begin, end):
                integrals[batch, 7] += (x[i] - saddle) * (x[i + 1] - saddle) < 0.0
        _add_loss(points, begin, end, integrals[batch])
        if integrals.shape[1] > WELLS:
            _add_wells(points, begin, end, saddles, integrals[batch])
        begin = end


@summing
def _add_loss(points, begin, end, integrals):
    """Add the transducer's loss, trapezoidal, to one batch."""
    time, loss = points[0], points[7]
    total = 0.0
    for i in range(begin, end):
        total += 0.5 * (time[i + 1] - time[i]) * (loss[i] + loss[i + 1])
    integrals[9] += total


@summing
def _add_wells(points, begin, end, saddles, integrals):
    """Add the time in each well, from the left, to one batch."""
    time, x = points[0], points[1]
    for i in range(begin, end):
        half = 0.5 * (time[i + 1] - time[i])
        integrals[WELLS + np.searchsorted(saddles, x[i])] += half
        integrals[WELLS + np.searchsorted(saddles, x[i + 1])] += half


@summing
def _add_stretch(points, begin, end, integrals, products):
    """Add the intervals between two points to one batch's integrals and to the products."""
    time = points[0]
    # Half of both intervals that meet at a point.
    weights = np.empty(end - begin + 1)
    weights[0] = 0.5 * (time[begin + 1] - time[begin])
    weights[-1] = 0.5 * (time[end] - time[end - 1])
    for i in range(begin + 1, end):
        weights[i - begin] = 0.5 * (time[i + 1] - time[i - 1])
    s0 = s1 = s2 = s3 = s4 = s5 = 0.0
    p0 = p1 = p2 = p3 = p4 = p5 = p6 = p7 = 0.0
    for i in range(begin, end + 1):
        weight = weights[i - begin]
        x, v, voltage = points[1, i], points[2, i], points[3, i]
        load, put_in, loss = points[4, i], points[5, i], points[6, i]
        xx, vv, voltage2 = x * x, v * v, voltage * voltage
        s0 += weight * voltage2
        s1 += weight * xx
        s2 += weight * vv
        s3 += weight * load
        s4 += weight * put_in
        s5 += weight * loss
        p0 += weight * voltage2 * voltage2
        p1 += weight * xx * xx
        p2 += weight * vv * vv
        p3 += weight * load * load
        p4 += weight * put_in * put_in
        p5 += weight * loss * loss
        p6 += weight * put_in * load
        p7 += weight * load * loss
    integrals[0] += time[end] - time[begin]
    for k, value in enumerate((s0, s1, s2, s3, s4, s5)):
        integrals[k + 1] += value
    for k, value in enumerate((p0, p1, p2, p3, p4, p5, p6, p7)):
        products[k] += value


@compiled
def _add_samples(points, start, group_length, interval, histograms, widths):
    """Count samples at whole multiples of the interval, linear between points."""
    groups = histograms.shape[0]
    time = points[0]
    half = BINS // 2
    sample = np.floor(time[0] / interval + 1e-9) + 1.0
    for i in range(time.size - 1):
        while sample * interval <= time[i + 1] + 1e-9 * interval:
            share = (sample * interval - time[i]) / (time[i + 1] - time[i])
            group = min(int((sample * interval - start) / group_length), groups - 1)
            for k in range(3):
                value = points[k + 1, i] + share * (points[k + 1, i + 1] - points[k + 1, i])
                place = np.floor(value / widths[k])
                while place >= half or place < -half:
                    _double_bins(histograms[:, k])
                    widths[k] *= 2.0
                    place = np.floor(value / widths[k])
                histograms[group, k, int(place) + half] += 1.0
            sample += 1.0


@compiled
def _double_bins(histograms):
    """Merge bins in pairs about the centre, in place; shape (groups, BINS)."""
    half = BINS // 2
    for group in range(histograms.shape[0]):
        row = histograms[group]
        for k in range(half // 2):
            row[half + k] = row[half + 2 * k] + row[half + 2 * k + 1]
            row[half - 1 - k] = row[half - 1 - 2 * k] + row[half - 2 - 2 * k]
        row[: half // 2] = 0.0
        row[half + half // 2 :] = 0.0
