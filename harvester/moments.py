"""Streaming accumulation of a record: batch integrals, histograms, first and last point.

One `Moments` per realization, of fixed size whatever the run's length. `harvester.estimators`
turns several of them into means with error bars.
"""

from dataclasses import dataclass

import numpy as np

from harvester.compilation import compiled
from harvester.record import Record

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
)
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
    gap : float
        Distance of the stoppers, to count impacts.
    integrals : ndarray, shape (batches, len(QUANTITIES))
    products : ndarray, shape (len(PRODUCTS),)
    histograms : ndarray, shape (groups, 3, BINS)
        Time spent in each bin of displacement, velocity, voltage; bins symmetric about 0.
    bin_widths : ndarray, shape (3,)
        Powers of two, doubled whenever a value falls outside.
    first, last : ndarray, shape (7,)
        The first measured and the latest point, in `Record`'s order.
    points : int
        Accepted points, those before `start` included.
    """

    start: float
    batch_length: float
    gap: float
    integrals: np.ndarray
    products: np.ndarray
    histograms: np.ndarray
    bin_widths: np.ndarray
    first: np.ndarray
    last: np.ndarray
    points: int = 0

    @classmethod
    def empty(cls, start, stop, gap, batches, groups):
        """Nothing accumulated yet, for the time from `start` to `stop` (s)."""
        columns = len(Record._fields)
        return cls(
            start=start,
            batch_length=(stop - start) / batches,
            gap=gap,
            integrals=np.zeros((batches, len(QUANTITIES))),
            products=np.zeros(len(PRODUCTS)),
            histograms=np.zeros((groups, len(HISTOGRAMS), BINS)),
            bin_widths=np.full(len(HISTOGRAMS), FINEST_BIN),
            first=np.full(columns, np.nan),
            last=np.full(columns, np.nan),
        )

    @property
    def time_reached(self):
        """Time of the latest point (s); nan before the first."""
        return float(self.last[0])

    def add(self, record):
        """Accumulate one chunk that follows the ones before."""
        self.points += record.time.size
        _accumulate(
            record,
            self.start,
            self.batch_length,
            self.gap,
            self.integrals,
            self.products,
            self.histograms,
            self.bin_widths,
            self.first,
            self.last,
        )


@compiled
def _accumulate(
    record, start, batch_length, gap, integrals, products, histograms, widths, first, last
):
    batches = integrals.shape[0]
    groups = histograms.shape[0]
    half = BINS // 2
    for i in range(record.time.size):
        time, x, v = record.time[i], record.displacement[i], record.velocity[i]
        voltage, load = record.voltage[i], record.load_power[i]
        put_in, loss = record.input_power[i], record.loss_power[i]
        before = last[0]
        if before >= start:
            dt = 0.5 * (time - before)
            batch = min(int((0.5 * (before + time) - start) / batch_length), batches - 1)
            _integrate(integrals[batch], dt, last, x, v, voltage, load, put_in, loss, gap)
            _integrate_products(products, dt, last, x, v, voltage, load, put_in, loss)
            group = batch * groups // batches
            for k, value in enumerate((x, v, voltage)):
                index = int(np.floor(value / widths[k]))
                while index >= half or index < -half:
                    _double_bins(histograms[:, k])
                    widths[k] *= 2.0
                    index = int(np.floor(value / widths[k]))
                histograms[group, k, index + half] += 2.0 * dt
        elif time >= start:
            for k in range(len(record)):
                first[k] = record[k][i]
        last[0], last[1], last[2], last[3] = time, x, v, voltage
        last[4], last[5], last[6] = load, put_in, loss


@compiled
def _integrate(row, dt, last, x, v, voltage, load, put_in, loss, gap):
    row[0] += 2.0 * dt
    row[1] += dt * (last[3] * last[3] + voltage * voltage)
    row[2] += dt * (last[1] * last[1] + x * x)
    row[3] += dt * (last[2] * last[2] + v * v)
    row[4] += dt * (last[4] + load)
    row[5] += dt * (last[5] + put_in)
    row[6] += dt * (last[6] + loss)
    if last[1] * x < 0.0:
        row[7] += 1.0
    if abs(last[1]) <= gap and abs(x) > gap:
        row[8] += 1.0


@compiled
def _integrate_products(row, dt, last, x, v, voltage, load, put_in, loss):
    weight = 2.0 * dt
    row[0] += weight * voltage**4
    row[1] += weight * x**4
    row[2] += weight * v**4
    row[3] += weight * load * load
    row[4] += weight * put_in * put_in
    row[5] += weight * loss * loss
    row[6] += weight * put_in * load
    row[7] += weight * load * loss


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
