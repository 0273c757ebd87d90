"""Moments of several realizations, accumulated during integration with SIMD instructions.

All realizations take the same steps, and some have additional points in a step. A step belongs to
the batch of its middle, and is measured if it begins at or after the start.

A block of memory contains eight realizations, one in each column:
    cells[TIME + k]              t₀ t₁ … t₇   latest point: nine rows (`add_point` replaces it)
    cells[SQUARE_VOLTAGES + k]   ΣV²Δt of     sums since the batch began (`add_point` adds to them,
                                 0 … 7        `end_batch` moves them into the batch)
    cells[BEFORE + k]            x₀ x₁ … x₇   displacement before the latest point (`follow`)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from harvester.base.compilation import merged_once, uncounted
from harvester.device.record import Record
from harvester.statistics.jumps import Jumps, energy_at, neighbours
from harvester.statistics.moments import PRODUCTS, QUANTITIES, WELLS, Moments, count_sample

# One vector instruction processes eight doubles, the widest register: eight realizations. They
# share a block of memory, in which each quantity has a row of eight numbers.
TOGETHER = 8
FIELDS, SUMS = len(Record._fields), len(QUANTITIES) + len(PRODUCTS)
# Offsets of the rows in a block. The rows are the latest point, the sums in the order of
# `Moments.integrals` and `Moments.products`, the displacement before the latest point, the time
# since then (0 before the start), and the two saddles around the well reached last.
TIME, DISPLACEMENT, VELOCITY, VOLTAGE, LOAD_POWER, INPUT_POWER, LOSS_POWER, OWN_LOSS, STATE = range(
    0, FIELDS * TOGETHER, TOGETHER
)
TOTALS = FIELDS * TOGETHER
(
    INTERVALS, SQUARE_VOLTAGES, SQUARE_DISPLACEMENTS, SQUARE_VELOCITIES, LOADS, INPUTS, LOSSES,
    CROSSINGS, IMPACTS, OWN_LOSSES,
) = range(TOTALS, TOTALS + 10 * TOGETHER, TOGETHER)  # fmt: skip
PRODUCT_SUMS = TOTALS + len(QUANTITIES) * TOGETHER
(
    VOLTAGE_4, DISPLACEMENT_4, VELOCITY_4, LOAD_2, INPUT_2, LOSS_2, INPUT_LOAD, LOAD_LOSS,
) = range(PRODUCT_SUMS, PRODUCT_SUMS + 8 * TOGETHER, TOGETHER)  # fmt: skip
BEFORE, LASTING, LEFT, RIGHT = range(
    TOTALS + SUMS * TOGETHER, TOTALS + (SUMS + 4) * TOGETHER, TOGETHER
)
BLOCK = RIGHT + TOGETHER


class Tally(NamedTuple):
    """Arrays to which compiled code adds, as in `Moments` and `Jumps`; the first axis is the
    realization.

    Attributes
    ----------
    rows
        Shape (blocks of eight, BLOCK).
    wells
        Well reached last; −1 before the first.
    since
        Time (s) up to which the time in that well has been added.
    """

    start: float
    batch_length: float
    low: float
    high: float
    saddles: np.ndarray
    every: int
    rows: np.ndarray
    integrals: np.ndarray
    products: np.ndarray
    histograms: np.ndarray
    bin_widths: np.ndarray
    first: np.ndarray
    limits: np.ndarray
    core_low: float
    core_high: float
    energies: np.ndarray
    times: np.ndarray
    counts: np.ndarray
    wells: np.ndarray
    since: np.ndarray


class SeveralMoments:
    """Moments of several realizations of one scene, without a load output.

    Additions to `tally` also change the moments; `collect` completes them. The moments are
    initially empty, with samples at multiples of the knots' `spacing` (s).
    """

    def __init__(self, moments: Sequence[Moments], spacing: float) -> None:
        self._moments = moments
        one, count = moments[0], len(moments)
        self._jumps = [m.jumps for m in moments if m.jumps is not None]
        counted = self._jumps or [Jumps.between_no_wells(len(one.integrals))] * count
        rows = np.zeros((math.ceil(count / TOGETHER), BLOCK))
        rows[:, TIME : TIME + TOGETHER] = np.nan
        # Before a well is reached, no position is between its saddles.
        rows[:, LEFT : LEFT + TOGETHER], rows[:, RIGHT : RIGHT + TOGETHER] = np.inf, -np.inf
        self._last = _stacked(moments, "last")
        self.tally = Tally(
            start=one.start,
            batch_length=one.batch_length,
            low=one.free[0],
            high=one.free[1],
            saddles=one.saddles,
            every=round(one.sample_interval / spacing),
            rows=rows,
            **{
                name: _stacked(moments, name)
                for name in ("integrals", "products", "histograms", "bin_widths", "first")
            },
            limits=counted[0].limits,
            core_low=counted[0].ends[0],
            core_high=counted[0].ends[1],
            energies=counted[0].energies,
            **{name: _stacked(counted, name) for name in ("times", "counts")},
            wells=np.full(count, -1),
            since=np.full(count, np.nan),
        )

    def collect(self, points: np.ndarray) -> None:
        """Copy the latest points into each realization's moments; add to its number of points."""
        tally = self.tally
        latest = tally.rows[:, :TOTALS].reshape(-1, FIELDS, TOGETHER).transpose(0, 2, 1)
        self._last[:] = latest.reshape(-1, FIELDS)[: len(self._last)]
        for realization, count in zip(self._moments, points.tolist(), strict=True):
            realization.points += count
        reached = zip(tally.wells.tolist(), self._last[:, 0].tolist(), strict=True)
        for jumps, (well, time) in zip(self._jumps, reached, strict=False):
            jumps.well, jumps.time = well, time

    @property
    def diverged(self) -> float | None:
        """Latest time (s) if some realizations have values that are not finite; else None."""
        if np.isfinite(self._last).all():
            return None
        return float(np.nanmax(self._last[:, 0]))


def _stacked(parts, name):
    """Stack an attribute of several objects; each object then refers to its row of the stack."""
    stack = np.stack([getattr(part, name) for part in parts])
    for part, row in zip(parts, stack, strict=True):
        setattr(part, name, row)
    return stack


@merged_once
def batch_of(tally: Tally, begin: float, end: float) -> int:
    """The batch of a step between two times; −1 before the start.

    A run's first step is never measured, since its beginning is not a point of a record.
    """
    if begin < tally.start or begin == 0.0:
        return -1
    batches = tally.integrals.shape[1]
    return min(int((0.5 * (begin + end) - tally.start) / tally.batch_length), batches - 1)


@uncounted
def end_batch(tally: Tally, batch: int) -> None:
    """Add the sums to a batch. Batch −1 is the time before the first batch: only its last points
    are stored.
    """
    quantities = len(QUANTITIES)
    for k in range(tally.wells.size):
        cells, lane = tally.rows[k // TOGETHER], k % TOGETHER
        if batch < 0:
            for row in range(FIELDS):
                tally.first[k, row] = cells[row * TOGETHER + lane]
        else:
            for row in range(SUMS):
                cell = TOTALS + row * TOGETHER + lane
                if row < quantities:
                    tally.integrals[k, batch, row] += cells[cell]
                else:
                    tally.products[k, row - quantities] += cells[cell]
                cells[cell] = 0.0
        # Well −1 (none reached yet) would be counted in the last row.
        if tally.wells[k] >= 0:
            tally.times[k, batch, tally.wells[k]] += cells[TIME + lane] - tally.since[k]
        tally.since[k] = cells[TIME + lane]


@merged_once
def add_point(
    cells: np.ndarray,
    k: int,
    measured: bool,
    low: float,
    high: float,
    time: float,
    x: float,
    v: float,
    voltage: float,
    load_power: float,
    input_power: float,
    loss_power: float,
    own_loss: float,
    state: float,
) -> None:
    """Add one realization's interval from the latest point to this one (trapezoidal rule).

    `cells` are a block's rows, `k` the index in them; the other parameters are as in `Record`.
    """
    before = cells[DISPLACEMENT + k]
    interval = time - cells[TIME + k] if measured else 0.0
    half = 0.5 * interval
    square, earlier_square = x * x, before * before
    squares = (voltage * voltage, cells[VOLTAGE + k] * cells[VOLTAGE + k])
    speeds = (v * v, cells[VELOCITY + k] * cells[VELOCITY + k])
    loads = (load_power, cells[LOAD_POWER + k])
    inputs = (input_power, cells[INPUT_POWER + k])
    losses = (loss_power, cells[LOSS_POWER + k])
    cells[INTERVALS + k] += interval
    cells[SQUARE_VOLTAGES + k] += half * (squares[0] + squares[1])
    cells[SQUARE_DISPLACEMENTS + k] += half * (square + earlier_square)
    cells[SQUARE_VELOCITIES + k] += half * (speeds[0] + speeds[1])
    cells[LOADS + k] += half * (loads[0] + loads[1])
    cells[INPUTS + k] += half * (inputs[0] + inputs[1])
    cells[LOSSES + k] += half * (losses[0] + losses[1])
    cells[OWN_LOSSES + k] += half * (own_loss + cells[OWN_LOSS + k])
    entered = ((x > high) | (x < low)) & (low <= before) & (before <= high) & measured
    cells[IMPACTS + k] += 1.0 if entered else 0.0
    cells[VOLTAGE_4 + k] += half * (squares[0] * squares[0] + squares[1] * squares[1])
    cells[DISPLACEMENT_4 + k] += half * (square * square + earlier_square * earlier_square)
    cells[VELOCITY_4 + k] += half * (speeds[0] * speeds[0] + speeds[1] * speeds[1])
    cells[LOAD_2 + k] += half * (loads[0] * loads[0] + loads[1] * loads[1])
    cells[INPUT_2 + k] += half * (inputs[0] * inputs[0] + inputs[1] * inputs[1])
    cells[LOSS_2 + k] += half * (losses[0] * losses[0] + losses[1] * losses[1])
    cells[INPUT_LOAD + k] += half * (inputs[0] * loads[0] + inputs[1] * loads[1])
    cells[LOAD_LOSS + k] += half * (loads[0] * losses[0] + loads[1] * losses[1])
    cells[BEFORE + k], cells[LASTING + k] = before, interval
    cells[TIME + k], cells[DISPLACEMENT + k], cells[VELOCITY + k] = time, x, v
    cells[VOLTAGE + k], cells[LOAD_POWER + k], cells[INPUT_POWER + k] = voltage, loads[0], inputs[0]
    cells[LOSS_POWER + k], cells[OWN_LOSS + k], cells[STATE + k] = losses[0], own_loss, state


@merged_once
def follow(tally: Tally, block: int, first: int, end: int, batch: int) -> None:
    """Count crossings of saddles and jumps between wells in the intervals just added."""
    cells = tally.rows[block]
    if batch >= 0:
        for saddle in tally.saddles:
            for k in range(first, end):
                crosses = (cells[BEFORE + k] - saddle) * (cells[DISPLACEMENT + k] - saddle) < 0.0
                cells[CROSSINGS + k] += 1.0 if crosses else 0.0
        if tally.integrals.shape[2] > WELLS:
            for k in range(first, end):
                integrals = tally.integrals[block * TOGETHER + k, batch]
                for x in (cells[BEFORE + k], cells[DISPLACEMENT + k]):
                    integrals[WELLS + np.searchsorted(tally.saddles, x)] += 0.5 * cells[LASTING + k]
    if tally.limits.size > 0:
        for k in range(first, end):
            x = cells[DISPLACEMENT + k]
            beside = not cells[LEFT + k] < x < cells[RIGHT + k]
            if beside and tally.core_low < x < tally.core_high:
                _reach(tally, cells, block * TOGETHER + k, k, batch)


@uncounted
def _reach(tally, cells, realization, k, batch):
    """Count a jump if a mass outside the well reached last is in another well's core."""
    x, v, time = cells[DISPLACEMENT + k], cells[VELOCITY + k], cells[TIME + k]
    nearest, well = np.searchsorted(tally.saddles, x), tally.wells[realization]
    potential = energy_at(tally.energies, tally.core_low, tally.core_high, x)
    if 0.5 * v * v + potential > tally.limits[nearest]:
        return
    if well >= 0:
        tally.times[realization, batch, well] += time - tally.since[realization]
        tally.counts[realization, batch, well, nearest] += 1.0
    tally.since[realization], tally.wells[realization] = time, nearest
    cells[LEFT + k], cells[RIGHT + k] = neighbours(tally.saddles, nearest)


@uncounted
def sample(tally: Tally, time: float) -> None:
    """Count the latest points, which have this time, in the histograms."""
    groups = tally.histograms.shape[1]
    length = tally.batch_length * tally.integrals.shape[1] / groups
    group = min(int((time - tally.start) / length), groups - 1)
    for k in range(tally.wells.size):
        cells, lane = tally.rows[k // TOGETHER], k % TOGETHER
        x, v, voltage = cells[DISPLACEMENT + lane], cells[VELOCITY + lane], cells[VOLTAGE + lane]
        # Values that are not finite have no bin.
        if abs(x) + abs(v) + abs(voltage) < np.inf:
            for row, value in enumerate((x, v, voltage)):
                count_sample(tally.histograms[k], tally.bin_widths[k], group, row, value)
