"""Streaming accumulation of a record: batch integrals, histograms, first and last point.

There is one `Moments` per realization, whose size is independent of the run's length.
`harvester.statistics.run_quantities` turns several of them into means with error bars.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from circuits.netlist.kinds import LEVEL, STATE
from harvester.base.compilation import compiled, merged, summing, uncounted
from harvester.device.record import Record, copy_point, part
from harvester.statistics.jumps import Jumps
from harvester.statistics.output_moments import OutputMoments
from harvester.statistics.strain_moments import StrainMoments

# Rows of `Moments.integrals`: time integrals of these quantities, and counts of two events.
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
# If the wells are not mirror images, further rows are the times in each well, from the left.
WELLS = len(QUANTITIES)
# Rows of `Moments.products`: time integrals of products, for variances in a run.
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
BINS = 1024
FINEST_BIN = 2.0**-40


@dataclass
class Moments:
    """Sums, histograms and end points of one realization's record.

    Attributes
    ----------
    start, batch_length
        Beginning of the first batch, and duration of each batch (s).
    free
        Displacements between which there is no contact, to count impacts.
    saddles
        Displacements of the saddles between wells, ascending, to count crossings.
    integrals
        Shape (batches, len(QUANTITIES) or more).
    products
        Shape (len(PRODUCTS),).
    histograms
        Samples in each bin of displacement, velocity, voltage; bins symmetric about 0; shape
        (groups, 3, BINS).
    sample_interval
        Time between the histograms' samples (s), which are evenly spaced, since an engine's points
        are denser at contacts.
    bin_widths
        Powers of two, doubled if a value is outside all bins.
    first, last
        The first measured point and the latest one, in `Record`'s order.
    points
        Number of accepted points, including those before `start`.
    output
        Moments of the load's output and stores, if there are any.
    jumps
        Jumps between wells, if there are several.
    strain
        Strain of the layers, for a scene with a drawing; `StrainWatch` adds to it.
    step
        Longest step (s), if the run chose it; None: the engine's step.
    step_error
        Relative change of the energies in a run with twice the step, if one was made.
    note
        Changes that made the run converge, or unresolved problems; may be empty.
    spread
        For a nonlinear device under one record: relative standard error of the energies among runs
        whose excitations differ by the step error; 0 if there are no such runs.
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
    strain: StrainMoments | None = None
    step: float | None = None
    step_error: float = 0.0
    note: str = ""
    spread: float = 0.0

    @property
    def has_output(self) -> bool:
        """Whether the load has an output."""
        return self.output is not None and self.output.has_output

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
        """Empty moments for the time from `start` to `stop` (s).

        `shares`: whether to store the time in each well.
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
            histograms=np.zeros((groups, len(HISTOGRAMS), BINS), dtype=np.uint32),
            bin_widths=np.full(len(HISTOGRAMS), FINEST_BIN),
            first=np.full(columns, np.nan),
            last=np.full(columns, np.nan),
        )

    @property
    def time_reached(self) -> float:
        """Time of the latest point (s); NaN before the first point."""
        return float(self.last[0])

    def add(self, record: Record) -> None:
        """Accumulate one chunk of a record; chunks must be consecutive."""
        if record.time.size == 0:
            return
        self.points += record.time.size
        if self.jumps is not None:
            self.jumps.add(record)
        add_points(
            record, self.start, self.batch_length, *self.free, self.saddles, self.sample_interval,
            self.integrals, self.products, self.histograms, self.bin_widths, self.first, self.last,
        )  # fmt: skip


def prepare() -> None:
    """Load the compiled code, so that its time does not count as simulation time."""
    points = np.zeros(2)
    moments = Moments.empty(0.0, 1.0, (-1.0, 1.0), (), False, 1, 1, 1.0)
    nothing, ones = np.zeros(1), np.ones((2, 2))
    ends = (-1.0, 1.0)
    moments.jumps = Jumps(0.0, 1.0, nothing, points, ends, points, ones, np.ones((2, 2, 2)))
    time = np.array([0.0, 1.0])
    moments.add(Record(time, *[points] * (len(Record._fields) - 1)))
    output = OutputMoments.beside(moments, ((STATE, ""), (LEVEL, "")))
    output.add(time, points, points[None], [points])


@compiled
def add_points(
    record: Record,
    start: float,
    batch_length: float,
    low: float,
    high: float,
    saddles: np.ndarray,
    interval: float,
    integrals: np.ndarray,
    products: np.ndarray,
    histograms: np.ndarray,
    widths: np.ndarray,
    first: np.ndarray,
    last: np.ndarray,
) -> None:
    """Accumulate one of a record's consecutive chunks; for the parameters see `Moments`."""
    count, before = record.time.size, last.copy()
    begin = np.int64(0)
    copy_point(record, count - 1, last)
    if not last[0] >= start:
        return
    if not before[0] >= start:
        begin = np.searchsorted(record.time, start)
        copy_point(record, begin, before)
        begin += 1
    if np.isnan(first[0]):
        for k in range(first.size):
            first[k] = before[k]
    if begin == count:
        return
    record = part(record, begin, count)
    _add_integrals(before, record, start, batch_length, low, high, saddles, integrals, products)
    length = batch_length * len(integrals) / len(histograms)
    _add_samples(before, record, start, length, interval, histograms, widths)


@summing
def _add_integrals(before, record, start, batch_length, low, high, saddles, integrals, products):
    """Add trapezoidal integrals of every interval to the batch of its middle.

    `before` is the point that precedes the record.
    """
    batches, time = integrals.shape[0], record.time
    final, begin = time.size - 1, -1
    while begin < final:
        previous = before[0] if begin < 0 else time[begin]
        middle = 0.5 * (previous + time[begin + 1])
        batch = min(int((middle - start) / batch_length), batches - 1)
        stop = start + (batch + 1) * batch_length if batch < batches - 1 else np.inf
        end = begin + 1
        if end < final and 0.5 * (time[final - 1] + time[final]) < stop:
            end = final
        while end < final and 0.5 * (time[end] + time[end + 1]) < stop:
            end += 1
        _add_stretch(before, record, begin, end, saddles, integrals[batch], products)
        x = before[1] if begin < 0 else record.displacement[begin]
        _count_events(
            x, record.displacement[begin + 1 : end + 1], low, high, saddles, integrals[batch]
        )
        begin = end


@summing
def _count_events(before, x, low, high, saddles, integrals):
    """Count crossings of saddles, and impacts as entries into a contact."""
    impacts = np.int64(((x[0] > high) | (x[0] < low)) & (low <= before) & (before <= high))
    for i in range(1, x.size):
        outside = (x[i] > high) | (x[i] < low)
        impacts += np.int64(outside & (low <= x[i - 1]) & (x[i - 1] <= high))
    crossings = np.int64(0)
    for saddle in saddles:
        crossings += np.int64((before - saddle) * (x[0] - saddle) < 0.0)
        for i in range(1, x.size):
            crossings += np.int64((x[i - 1] - saddle) * (x[i] - saddle) < 0.0)
    integrals[7] += crossings
    integrals[8] += impacts


@summing
def _add_stretch(before, record, begin, end, saddles, integrals, products):
    """Add the intervals between two points to one batch's integrals and to the products."""
    time = record.time
    # The weight of a point is half the sum of the two adjacent intervals.
    weights = np.empty(end - begin + 1)
    previous = before[0] if begin < 0 else time[begin]
    weights[0] = weights[-1] = 0.5 * (time[begin + 1] - previous)
    if end > begin + 1:
        weights[1] = 0.5 * (time[begin + 2] - previous)
        weights[-1] = 0.5 * (time[end] - time[end - 1])
        for k in range(2, weights.size - 1):
            weights[k] = 0.5 * (time[begin + k + 1] - time[begin + k - 1])
    integrals[0] += time[end] - previous
    if begin < 0:
        point = Record(
            before[0:1], before[1:2], before[2:3], before[3:4], before[4:5], before[5:6],
            before[6:7], before[7:8], before[8:9],
        )  # fmt: skip
        _sum_points(point, weights[:1], saddles, integrals, products)
        _sum_points(part(record, 0, end + 1), weights[1:], saddles, integrals, products)
    else:
        _sum_points(part(record, begin, end + 1), weights, saddles, integrals, products)


@summing
def _sum_points(record, weights, saddles, integrals, products):
    """Add weighted points to one batch's integrals and to the products."""
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = 0.0
    p0 = p1 = p2 = p3 = p4 = p5 = p6 = p7 = 0.0
    for i in range(weights.size):
        weight = weights[i]
        x, v = record.displacement[i], record.velocity[i]
        voltage, load = record.voltage[i], record.load_power[i]
        put_in, loss = record.input_power[i], record.loss_power[i]
        xx, vv, voltage2 = x * x, v * v, voltage * voltage
        s0 += weight * voltage2
        s1 += weight * xx
        s2 += weight * vv
        s3 += weight * load
        s4 += weight * put_in
        s5 += weight * loss
        s6 += weight * record.transducer_loss[i]
        p0 += weight * voltage2 * voltage2
        p1 += weight * xx * xx
        p2 += weight * vv * vv
        p3 += weight * load * load
        p4 += weight * put_in * put_in
        p5 += weight * loss * loss
        p6 += weight * put_in * load
        p7 += weight * load * loss
    for k, value in enumerate((s0, s1, s2, s3, s4, s5)):
        integrals[k + 1] += value
    integrals[9] += s6
    for k, value in enumerate((p0, p1, p2, p3, p4, p5, p6, p7)):
        products[k] += value
    if integrals.size > WELLS:
        for i in range(weights.size):
            well = np.searchsorted(saddles, record.displacement[i])
            integrals[WELLS + well] += weights[i]


@uncounted
def _add_samples(before, record, start, group_length, interval, histograms, widths):
    """Count samples at integer multiples of the interval, interpolated linearly between points."""
    groups = histograms.shape[0]
    time, columns = record.time, (record.displacement, record.velocity, record.voltage)
    sample = np.floor(before[0] / interval + 1e-9) + 1.0
    end, later = time[-1] + 1e-9 * interval, 0
    while sample * interval <= end:
        moment = sample * interval
        while moment > time[later] + 1e-9 * interval:
            later += 1
        earlier = time[later - 1] if later > 0 else before[0]
        share = (moment - earlier) / (time[later] - earlier)
        group = min(int((moment - start) / group_length), groups - 1)
        for k, column in enumerate(columns):
            value = column[later - 1] if later > 0 else before[k + 1]
            value += share * (column[later] - value)
            count_sample(histograms, widths, group, k, value)
        sample += 1.0


@merged
def count_sample(
    histograms: np.ndarray, widths: np.ndarray, group: int, k: int, value: float
) -> None:
    """Count a sample in the k-th of `HISTOGRAMS`, widening its bins if necessary; see `Moments`."""
    half = BINS // 2
    into = np.floor(value / widths[k])
    while into >= half or into < -half:
        # Groups after this one have no samples yet.
        _double_bins(histograms, group, k)
        widths[k] *= 2.0
        into = np.floor(value / widths[k])
    histograms[group, k, int(into) + half] += np.uint32(1)


@uncounted
def _double_bins(histograms, last, k):
    """Merge bins of the k-th histogram in pairs about the centre, in all groups up to `last`."""
    half = BINS // 2
    for group in range(last + 1):
        row = histograms[group, k]
        for i in range(half):
            above, below = half + i, half - 1 - i
            some = i < half // 2
            row[above] = row[half + 2 * i] + row[half + 2 * i + 1] if some else np.uint32(0)
            row[below] = row[half - 1 - 2 * i] + row[half - 2 - 2 * i] if some else np.uint32(0)
