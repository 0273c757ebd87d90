"""The time base of a record: an even grid for rounded, drifting or irregular time stamps.

Loggers round their stamps (0.003, 0.006, 0.008 s at 360 Hz), and their clocks drift, although the
samples are evenly spaced. Therefore a fit of the stamps gives the rate. Interpolation at rounded
stamps would remove up to 20 % of a vibration's power.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import NamedTuple, cast

import numpy as np

from harvester.base.errors import SceneError
from harvester.records.formats import most_samples
from harvester.records.samples import LARGEST_MENDED_SHARE, check_length

# Limits of a time column, in seconds.
LARGEST_TIME, SHORTEST_STEP = 1e20, 1e-20
# Maximum deviation of a time from an even grid, in spacings.
LARGEST_JITTER = 0.1
# Rounded stamps have two step lengths, within this share of their difference, each at least this
# often: a single long step means a missing sample.
TWO_LENGTHS, FEWEST_STEPS = 0.01, 3
# Maximum relative error of a rate derived from rounded stamps.
RATE_ERROR = 1e-3
# A drifting clock is averaged over this many samples. Stamps may scatter about the average by this
# rms value, in spacings; the power loss is below 0.5 % at 5 samples per period. In enDAQ's files
# the scatter is up to 0.026.
DRIFT_SAMPLES, LARGEST_SCATTER = 257, 0.05
# Degree of the spline between samples.
SPLINE_DEGREE = 7
# Degree of the spline for uneven times: at 8 samples per period and a jitter of 40 % of the spacing
# it retains 99.8 % of the power, linear interpolation 88 %. Steps shorter or longer than these (in
# spacings) are interpolated linearly, since a spline would overshoot.
UNEVEN_DEGREE, SHORT_STEP, LONG_STEP = 5, 0.25, 1.9


class TimeBase(NamedTuple):
    """Rate (Hz) of an even grid, remarks, and a function that resamples arrays (n,) to the grid."""

    rate: float
    remarks: tuple[str, ...] = ()
    resampled: Callable[[np.ndarray], np.ndarray] = np.asarray


def time_base(
    times: np.ndarray | None,
    rate: float | None,
    where: str,
    cure: str,
    mend: Collection[str] | None = None,
) -> TimeBase:
    """The even grid of a record's samples.

    `times`: shape (n,), s, finite; None: only the rate is used. `rate`: Hz, as given. `where`,
    `cure`: file, and remedy for times that do not rise, for messages. `mend`: with "uneven",
    missing or unevenly spaced samples are interpolated; None: no repair is possible. Raises
    SceneError for too few times, times that do not rise or are not seconds, and uneven times.
    """
    if times is None:
        return TimeBase(cast(float, rate))
    check_length(times, where)
    largest = float(np.abs(times).max())
    if not largest <= LARGEST_TIME:
        raise SceneError(f"{where}: the time column reaches {largest:g} s: it must be in seconds")
    steps, numbers = np.diff(times), np.arange(times.size)
    length = times[-1] - times[0]
    spacing = length / steps.size if rate is None else 1.0 / rate
    rising = steps.min() > SHORTEST_STEP
    if rising and np.abs(times - times[0] - numbers * spacing).max() <= LARGEST_JITTER * spacing:
        return TimeBase(float(1.0 / spacing))
    rounding = rounded_to(steps)
    grid = None
    if rising or (steps.min() == 0.0 and (rate or 0.0 < rounding <= RATE_ERROR * length)):
        grid = _fitted(times, rate, steps, rounding)
    if grid is None and not rising:
        index = int(np.argmin(steps > SHORTEST_STEP))
        raise SceneError(
            f"{where}: the time column does not rise after sample {index} (t = {times[index]:g}): "
            f"{cure}"
        )
    return grid or _uneven(times, rate, steps, where, mend)


def _fitted(times, rate, steps, rounding):
    """The grid of rounded or drifting stamps; None for other stamps."""
    numbers = np.arange(times.size)
    spacing = slope_of(times, numbers) if rate is None else 1.0 / rate
    late = times - numbers * spacing
    if np.ptp(late) <= rounding * (1.0 + TWO_LENGTHS):
        remark = (
            f"times are rounded to {rounding:.3g} s: a fit of them gives {1.0 / spacing:.6g} Hz"
        )
        return TimeBase(float(1.0 / spacing), (remark,) if rate is None else ())
    return None if rate is not None else _drifting(late, spacing, rounding, steps)


def rounded_to(steps: np.ndarray) -> float:
    """Resolution of rounded stamps (s); 0 if they are not rounded.

    The steps of rounded stamps are two neighbouring multiples of it, each several times.
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
    """The spacing (s), as the least-squares slope of times over sample numbers."""
    centred = numbers - numbers.mean()
    return float(centred @ (times - times.mean()) / (centred @ centred))


def _drifting(late, spacing, rounding, steps):
    """The grid of stamps of a drifting clock without missing samples; None for other stamps."""
    from scipy.interpolate import make_interp_spline
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
        f"the clock drifts by {np.ptp(drift) / spacing:.2g} spacings over the file: resampled at "
        f"{1.0 / spacing:.6g} Hz"
    )
    positions = np.interp(grid, clock, numbers)
    return TimeBase(
        float(1.0 / spacing),
        (remark,),
        lambda values: make_interp_spline(numbers, values, SPLINE_DEGREE)(positions),
    )


def _uneven(times, rate, steps, where, mend):
    """The grid of uneven times, with the spacing of their fit or of the given rate."""
    from scipy.interpolate import make_interp_spline

    # Means are used, since the median step of rounded stamps differs from their mean.
    single = steps[steps <= LONG_STEP * np.median(steps)]
    usual = float(single.mean())
    remark = "" if mend is None else _bridged(times, steps, usual, where)
    if mend is None or "uneven" not in mend:
        cure = 'excitation.mend = ["uneven"] interpolates'
        if mend is None:
            cure = "resample the record, or cut it at its gaps"
        raise SceneError(
            f"{where}: unevenly sampled: the time steps vary by {np.ptp(steps) / usual:.2g} "
            f"times their mean of {usual:.6g} s; {cure}"
        )
    if rate is None:
        # If only whole samples are missing, the others keep their values.
        positions = np.append(0.0, np.cumsum(np.maximum(np.round(steps / usual), 1.0)))
        spacing = slope_of(times, positions)
        scatter = np.ptp(times - positions * spacing)
        if scatter <= max(1.01 * rounded_to(single), 2.0 * LARGEST_JITTER * spacing):
            grid = np.arange(positions[-1] + 1.0)
            return TimeBase(
                1.0 / spacing, (remark,), lambda values: np.interp(grid, positions, values)
            )
    spacing = usual if rate is None else 1.0 / rate
    knots = (times[-1] - times[0]) / spacing
    if knots >= most_samples():
        raise SceneError(
            f"{where}: the time column covers {knots:.3g} spacings of {spacing:.6g} s, but this "
            f"machine's memory allows {most_samples()}: cut the record at its gaps"
        )
    grid = times[0] + np.arange(int(knots + 1e-9) + 1) * spacing
    # Spline between usual steps; linear interpolation over gaps and short steps.
    odd = (steps < SHORT_STEP * usual) | (steps > LONG_STEP * usual)
    inside = np.clip(np.searchsorted(times, grid, side="right") - 1, 0, steps.size - 1)
    return TimeBase(
        1.0 / spacing,
        (remark,),
        lambda values: np.where(
            odd[inside],
            np.interp(grid, times, values),
            make_interp_spline(times, values, UNEVEN_DEGREE)(grid),
        ),
    )


def _bridged(times, steps, spacing, where):
    """Remark on linearly interpolated gaps; raise above `LARGEST_MENDED_SHARE`."""
    missing = float(np.sum(np.maximum(np.round(steps / spacing) - 1.0, 0.0)))
    share = missing / (missing + times.size)
    longest = int(np.argmax(steps))
    largest = (
        f"the largest step is {steps[longest]:.4g} s, after t = {times[longest] - times[0]:.6g} s"
    )
    if share > LARGEST_MENDED_SHARE:
        raise SceneError(
            f"{where}: {share:.0%} of the samples are missing between the times ({largest}): more "
            f"than {LARGEST_MENDED_SHARE:.0%} cannot be repaired: cut the record at its gaps, or "
            "choose a part by excitation.start"
        )
    return f"interpolated to even steps: {share:.1%} of the samples were missing, {largest}"
