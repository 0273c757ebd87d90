"""The time base of a record: an even grid that its stamps are rounded from, drift from, or leave.

Loggers round their stamps (0.003, 0.006, 0.008 s at 360 Hz), and their clocks drift. The samples
are even all the same, so a fit of the stamps gives the rate. Interpolation at rounded stamps would
take up to 20 % of a vibration's power away.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from harvester.base.errors import SceneError

# Limits of a time column, in seconds.
LARGEST_TIME, SHORTEST_STEP = 1e20, 1e-20
# Largest deviation of a time from an even grid, in spacings.
LARGEST_JITTER = 0.1
# Rounded stamps have two lengths of steps, to this share of their difference, each so many times:
# a single long step is a sample that is missing.
TWO_LENGTHS, FEWEST_STEPS = 0.01, 3
# Largest relative error of a rate that rounded stamps give.
RATE_ERROR = 1e-3
# A drifting clock is averaged over this many samples. Its stamps may scatter about the average by
# this rms value, in spacings, which takes less than 0.5 % of the power at 5 samples a period. The
# blocks of enDAQ's files scatter by up to 0.026.
DRIFT_SAMPLES, LARGEST_SCATTER = 257, 0.05
# Degree of the spline between samples.
SPLINE_DEGREE = 7


class TimeBase(NamedTuple):
    """Spacing of an even grid (s), the sample numbers at its points, and a remark on both.

    `numbers` is None where the samples themselves are the grid's.
    """

    spacing: float
    numbers: np.ndarray | None = None
    remarks: tuple[str, ...] = ()

    def resampled(self, values: np.ndarray) -> np.ndarray:
        """Samples, shape (n,), on the grid."""
        from scipy.interpolate import make_interp_spline

        if self.numbers is None:
            return values
        return make_interp_spline(np.arange(values.size), values, SPLINE_DEGREE)(self.numbers)


def time_base(times: np.ndarray, rate: float | None, where: str, cure: str) -> TimeBase | None:
    """The even grid of a record's time stamps; None where samples are missing or taken unevenly.

    `times`: shape (n,); s, finite. `rate`: Hz, as given. `where`, `cure`: for messages: the file;
    what to do about times that do not rise. Raises SceneError if they do not rise, or are no
    seconds.
    """
    largest = float(np.abs(times).max())
    if not largest <= LARGEST_TIME:
        raise SceneError(f"{where}: the time column reaches {largest:g} s: it must be in seconds")
    steps, numbers = np.diff(times), np.arange(times.size)
    length = times[-1] - times[0]
    spacing = length / steps.size if rate is None else 1.0 / rate
    rising = steps.min() > SHORTEST_STEP
    if rising and np.abs(times - times[0] - numbers * spacing).max() <= LARGEST_JITTER * spacing:
        return TimeBase(float(spacing))
    rounding = rounded_to(steps)
    grid = None
    if rising or (steps.min() == 0.0 and (rate or rounding <= RATE_ERROR * length)):
        grid = _fitted(times, rate, steps, rounding)
    if grid is None and not rising:
        index = int(np.argmin(steps > SHORTEST_STEP))
        raise SceneError(
            f"{where}: the time column does not rise after sample {index} (t = {times[index]:g}): "
            f"{cure}"
        )
    return grid


def _fitted(times, rate, steps, rounding):
    """The grid of stamps that are rounded or drift; None for others."""
    numbers = np.arange(times.size)
    spacing = slope_of(times, numbers) if rate is None else 1.0 / rate
    late = times - numbers * spacing
    if np.ptp(late) <= rounding * (1.0 + TWO_LENGTHS):
        remark = (
            f"times are rounded to {rounding:.3g} s: a fit of them gives {1.0 / spacing:.6g} Hz"
        )
        return TimeBase(float(spacing), None, (remark,) if rate is None else ())
    return None if rate is not None else _drifting(late, spacing, rounding, steps)


def rounded_to(steps: np.ndarray) -> float:
    """What the stamps are rounded to (s), 0 if they are not.

    Their steps then are two neighbouring multiples of it, each several times.
    """
    low, high = steps.min(), steps.max()
    width = float(high - low)
    scatter = np.minimum(steps - low, high - steps).max()
    long = int(np.count_nonzero(steps - low > 0.5 * width))
    if width == 0.0 or scatter > TWO_LENGTHS * width or min(long, steps.size - long) < FEWEST_STEPS:
        return 0.0
    multiple = low / width
    return width if abs(multiple - round(multiple)) <= TWO_LENGTHS * max(1.0, multiple) else 0.0


def slope_of(times: np.ndarray, numbers: np.ndarray) -> float:
    """The spacing (s) by least squares of the times over the samples' numbers."""
    centred = numbers - numbers.mean()
    return float(centred @ (times - times.mean()) / (centred @ centred))


def _drifting(late, spacing, rounding, steps):
    """The grid of stamps whose clock drifts, with no sample missing; None for others."""
    from scipy.ndimage import uniform_filter1d

    drift = uniform_filter1d(late, DRIFT_SAMPLES + 4 * int(rounding / spacing), mode="nearest")
    scatter = late - drift
    if rounding == 0.0 and not (np.abs(steps / spacing - 1.0).max() < 0.5):
        return None
    if not np.std(scatter) <= max(LARGEST_SCATTER * spacing, 0.5 * rounding):
        return None
    numbers = np.arange(late.size)
    clock = numbers * spacing + drift
    grid = np.arange(clock[0], clock[-1] + 1e-9 * spacing, spacing)
    remark = (
        f"its clock drifts by {np.ptp(drift) / spacing:.2g} spacings over the file: resampled at "
        f"{1.0 / spacing:.6g} Hz"
    )
    return TimeBase(float(spacing), np.interp(grid, clock, numbers), (remark,))
