"""Stroboscopic samples of a record: its state at equally spaced times, and means between them."""

from __future__ import annotations

import math

import numpy as np

from harvester.device import timescales
from harvester.device.record import Record
from harvester.scene.prepared import Prepared
from harvester.scene.steps import stop_time

# Columns of `Stroboscope.samples`. The last three are time integrals, so that their differences
# give means over a period.
COLUMNS = (
    "displacement", "velocity", "state", "load_energy", "square_voltage", "square_displacement",
)  # fmt: skip
# Number of leading columns that are the state of the motion.
STATE = 3


class Stroboscope:
    """Sample one realization's record at `first`, `first + period`, … (s).

    Samples are interpolated linearly between the record's points. Engines have points at the
    excitation's knots, and a period is an integer number of knot spacings. `samples` has the shape
    (count, len(COLUMNS)), scaled; NaN at times not reached yet. `corrected`: whether the sums of
    trapezoids are corrected at contacts, as in the means of Monte Carlo with a resistor.
    """

    def __init__(self, first: float, period: float, count: int, corrected: bool = False) -> None:
        # Round-off may put a record's last time before its end. All times are reduced by the same
        # amount, since a shift that grows with time would look like a transient.
        times = first + period * np.arange(count)
        self.times = times - 5e-10 * times[-1:]
        self.samples = np.full((count, len(COLUMNS)), np.nan)
        self._next, self._corrected = 0, corrected
        self._last: np.ndarray | None = None

    def add(self, record: Record) -> None:
        """Sample one chunk of a record; chunks must be consecutive."""
        if record.time.size == 0 or self._next == self.times.size:
            return
        if record.time[-1] < self.times[0]:
            last = (column[-1] for column in (record.time, *_motion(record)))
            self._last = np.array([*last, 0.0, 0.0, 0.0, *(rate[-1] for rate in _rates(record))])
            return
        points = np.empty((record.time.size + 1, 1 + len(COLUMNS)))
        points[1:, 0] = record.time
        points[1:, 1:4] = np.array(_motion(record)).T
        rates = np.array(_rates(record))
        start = self._last
        if start is None:
            # A record lacks the initial point: times before its first point have that point's
            # values.
            start = np.array([*points[1, :4], 0.0, 0.0, 0.0, *rates[:, 0]])
        points[0] = start[: 1 + len(COLUMNS)]
        rates = np.concatenate([start[-3:, None], rates], axis=1)
        steps = 0.5 * np.diff(points[:, 0]) * (rates[:, 1:] + rates[:, :-1])
        if self._corrected:
            steps[:, :-1] += _corrections(points[:, 0], rates)
        points[1:, 4:] = points[0, 4:] + np.cumsum(steps, axis=1).T
        until = int(np.searchsorted(self.times, points[-1, 0], side="right"))
        times = self.times[self._next : until]
        for column in range(len(COLUMNS)):
            self.samples[self._next : until, column] = np.interp(
                times, points[:, 0], points[:, 1 + column]
            )
        self._next = until
        self._last = np.concatenate([points[-1], rates[:, -1]])


def _corrections(time, rates):
    """Corrections of the trapezoidal rule at inner points, where the length of steps changes.

    Trapezoids of the length h miss h²/12 times the change of the integrand's slope (Euler and
    Maclaurin). This sums to 0 over a cycle except where h changes, as at contacts: without it
    powers of a device with stoppers were 0.15 % too large. There is no slope at a jump.
    """
    length = np.maximum(np.diff(time), np.finfo(np.float32).tiny)
    slope = np.diff(rates, axis=1) / length
    before, after = slope[:, :-1], slope[:, 1:]
    mean = (before * length[1:] + after * length[:-1]) / (length[1:] + length[:-1])
    smooth = 2.0 * np.abs(after - before) <= np.abs(after + before)
    return np.where(smooth, mean, 0.0) * (length[1:] ** 2 - length[:-1] ** 2) / 12.0


def _motion(record):
    return record.displacement, record.velocity, record.transducer_state


def _rates(record):
    """Integrands of the means: load power, squared voltage, squared displacement."""
    return record.load_power, record.voltage**2, record.displacement**2


def strobe_period(prepared_scene: Prepared) -> float:
    """Sampling interval (s): the period of the excitation or its lowest line, else the device's."""
    excitation = prepared_scene.scene.excitation
    if excitation.period is not None and not excitation.random:
        return excitation.period
    if excitation.lines and not excitation.drifts:
        return 1.0 / min(frequency for frequency, _ in excitation.lines)
    return 2.0 * math.pi / timescales.angular_frequency(prepared_scene.system)


def strobe_times(prepared_scene: Prepared) -> tuple[float, float, int]:
    """First time (s) after settling, sampling interval (s) and number of samples of a run."""
    period = strobe_period(prepared_scene)
    first = max(math.ceil(prepared_scene.scene.run.settle / period - 1e-9), 1) * period
    count = math.floor((stop_time(prepared_scene) - first) / period + 1e-6) + 1
    return first, period, max(count, 0)
