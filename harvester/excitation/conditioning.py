"""From a file's columns to evenly spaced samples: faults refused or mended, filters."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from harvester.base.errors import SceneError
from harvester.records.time_base import (
    LARGEST_JITTER,
    SPLINE_DEGREE,
    rounded_to,
    slope_of,
    time_base,
)

if TYPE_CHECKING:
    from harvester.records.columns import Columns

# Limits of a record's largest sample, in m/s² or scaled. Squares of others overflow or vanish.
SMALLEST_PEAK, LARGEST_PEAK = 1e-30, 1e12
# Faults of samples that a scene may ask to mend.
FAULTS = ("nan", "uneven", "clipped")
# Fewest samples in a record.
FEWEST_SAMPLES = 64
# Largest share of the samples that may be mended.
LARGEST_MENDED_SHARE = 0.1
# Samples are far outside the rest if they leave its middle by more than this multiple of the
# largest deviation of all others. A shock's samples differ; those of a marker are equal, or it is
# one sample alone.
FAR_RATIO, FAR_RATIO_OF_ONE, SAMPLES_PER_MARKER = 5.0, 20.0, 2
# The middle half of the samples shows where the centre is and how far the rest reaches.
SHARE_OF_REST = 0.5
# Uneven times have a spline of this degree: at 8 samples a period and a jitter of 40 % of the
# spacing it keeps 99.8 % of the power, straight lines 88 %. Shorter and longer steps than these, in
# spacings, have straight lines, where a spline would swing.
UNEVEN_DEGREE, SHORT_STEP, LONG_STEP = 5, 0.25, 1.9
# A clipped crest has this many equal extreme samples, and a clipped record two of them: one
# flat crest is a coincidence.
FLAT_SAMPLES, FLAT_CRESTS = 3, 2
# Order of the Butterworth filters.
FILTER_ORDER = 4
# Narrowest band of a filter as a share of the sampling rate. Rounding spoils narrower ones.
SMALLEST_BAND_SHARE = 1e-6
# Share of a repeated record that is cross-faded, at each end.
CROSS_FADE_SHARE = 0.05


def refuse_size(values: np.ndarray, factor: float, unit: str, file: str) -> None:
    """Refuse a record whose samples are no accelerations, whatever the unit.

    `values`: shape (n,); samples in the file's unit; NaN and infinite ones are ignored. `factor`:
    factor from the file's unit to m/s². Raises SceneError.
    """
    finite = np.isfinite(values)
    peak = max(abs(float(find(values, initial=0.0, where=finite))) for find in (np.max, np.min))
    if peak != 0.0 and not SMALLEST_PEAK <= peak * factor <= LARGEST_PEAK:
        raise SceneError(
            f"{file}: the largest sample is {peak:g} in the unit {unit}, where it must be in "
            f"[{SMALLEST_PEAK / factor:g}, {LARGEST_PEAK / factor:g}]: check excitation.column "
            "and unit"
        )


class EvenSamples(NamedTuple):
    """Samples, shape (n,), their rate (Hz), and what was mended of them, in words."""

    values: np.ndarray
    rate: float
    remarks: tuple[str, ...] = ()


def without_markers(
    values: np.ndarray, mend: Collection[str]
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Samples with markers (-9999, 65535, a rail) replaced by NaN, if `mend` asks for it.

    Loggers write such a number for what they could not measure.

    `values`: shape (n,); samples as the file has them, before units and scales. `mend`: faults to
    mend; "nan" among them takes markers for gaps. Returns the samples, shape (n,), and a remark if
    there are markers.
    """
    remark = marker_remark(values)
    if not remark:
        return values, ()
    if "nan" not in mend:
        return values, (f'{remark}, and taken as acceleration: mend = ["nan"] takes such for gaps',)
    gapped = np.where(outliers(values), np.nan, values)
    return gapped, (f"{remark}: taken for gaps",)


def marker_remark(values: np.ndarray) -> str:
    """The markers among samples, shape (n,), in words; "" where there are none."""
    far = outliers(values)
    if not far.any():
        return ""
    count, others = int(np.count_nonzero(far)), values[np.isfinite(values) & ~far]
    written = ", ".join(f"{value:g}" for value in np.unique(values[far])[:3])
    noun, verb = ("sample", "is") if count == 1 else ("samples", "are")
    return (
        f"{count} of {values.size} {noun} {verb} {written}, far outside the rest "
        f"({others.min():.3g} to {others.max():.3g})"
    )


def outliers(values: np.ndarray) -> np.ndarray:
    """Where a few equal samples, or a single one, stand far outside all others: bool (n,)."""
    far = np.zeros(values.size, dtype=bool)
    finite = np.isfinite(values)
    if np.count_nonzero(finite) < FEWEST_SAMPLES:
        return far
    deviation = np.abs(values - np.median(values[finite]))
    ordered = np.sort(deviation[finite])
    first = int(SHARE_OF_REST * ordered.size)
    below, above = ordered[first:-1], ordered[first + 1 :]
    jumps = np.flatnonzero((below > 0.0) & (above / FAR_RATIO > below))
    if not jumps.size:
        return far
    reach = below[jumps[0]]
    far[finite] = deviation[finite] > reach
    count, markers = int(np.count_nonzero(far)), np.unique(values[far]).size
    alone = count == 1 and deviation[far][0] > FAR_RATIO_OF_ONE * reach
    return far if alone or count >= SAMPLES_PER_MARKER * markers else np.zeros_like(far)


def even_samples(columns: Columns, mend: Collection[str], file: str, most: int) -> EvenSamples:
    """Evenly spaced finite samples, and their rate.

    `columns`: columns with a sampling rate or with times. `mend`: faults to mend: "nan" by straight
    lines over the gap, "uneven" by straight lines onto an even grid, "clipped" by a cubic spline
    through what was not clipped. `most`: samples that the even grid may have. Raises SceneError for
    a fault that was not to be mended, or cannot be. The samples have the unit of the columns.
    """
    values = np.array(columns.values)
    # A record without times has a sampling rate.
    rate: Any = columns.sampling_rate
    if values.size < FEWEST_SAMPLES:
        raise SceneError(
            f"{file}: the record is too short: {values.size} samples, and {FEWEST_SAMPLES} are "
            "the fewest"
        )
    times = np.arange(values.size) / rate if columns.times is None else columns.times
    remarks: tuple[str, ...] = ()
    good = np.isfinite(values) & np.isfinite(times)
    lost = int(np.count_nonzero(~good))
    if lost:
        first = int(np.flatnonzero(~good)[0])
        _refuse(file, "nan", mend, lost, values.size, f"the first is sample {first}")
        edges = np.flatnonzero(np.diff(np.concatenate([[False], ~good, [False]]).astype(int)))
        longest = int((edges[1::2] - edges[::2]).max())
        remarks = (
            f"{lost} of {values.size} samples were without a number and are on straight lines: the "
            f"largest gap has {longest} sample{'s' if longest > 1 else ''}",
        )
        # Bad samples are interpolated over their indices, and so are their times.
        values[~good] = np.interp(np.flatnonzero(~good), np.flatnonzero(good), values[good])
        if columns.times is not None:
            times = np.interp(np.arange(values.size), np.flatnonzero(good), times[good])
    clipped = clipped_samples(values)
    if clipped.any():
        level = float(np.abs(values[clipped]).max())
        _refuse(file, "clipped", mend, int(clipped.sum()), values.size, f"at {level:g}")
        values = _unclip(values, clipped)
    if np.ptp(values) == 0.0:
        raise SceneError(f"{file}: the record is constant: every sample is {values[0]:g}")
    if columns.times is None:
        return EvenSamples(values, rate, remarks)
    even = _even(values, times, rate, mend, file, most)
    return even._replace(remarks=remarks + even.remarks)


def conditioned(
    values: np.ndarray, rate: float, detrend: str, band: tuple[float, float] | None, file: str
) -> np.ndarray:
    """Samples without trend, within a band.

    `values`: shape (n,). `detrend`: "none", "mean" or "linear". `band`: Hz: Butterworth of fourth
    order, forward and backward (zero phase, eighth order in all, −6 dB at both ends); 0 as the
    first leaves a low-pass. Raises SceneError if the band does not lie below half the sampling
    rate, or nothing is left.
    """
    from scipy import signal

    if detrend != "none":
        values = signal.detrend(values, type="constant" if detrend == "mean" else "linear")
    if band is not None:
        values = signal.sosfiltfilt(_filter(*band, rate, file), values)
    if np.abs(values).max() < SMALLEST_PEAK:
        raise SceneError(f"{file}: nothing is left of the record after excitation.detrend and band")
    return values


def _filter(low, high, rate, file):
    """Second-order sections of the band's filter."""
    from scipy import signal

    least = SMALLEST_BAND_SHARE * rate
    if not low + least <= high < 0.5 * rate or 0.0 < low < least:
        raise SceneError(
            f"{file}: excitation.band = [{low:g}, {high:g}]: must rise by {least:.2g} Hz or more, "
            f"begin at 0 or there, and end below {0.5 * rate:g} Hz, half the sampling rate"
        )
    edges, kind = (high, "lowpass") if low == 0.0 else ([low, high], "bandpass")
    return signal.butter(FILTER_ORDER, edges, kind, fs=rate, output="sos")


def refined(values: np.ndarray, factor: int) -> np.ndarray:
    """Band-limited interpolation to `factor` times as many samples (windowed sinc)."""
    from scipy import signal

    if factor == 1:
        return values
    finer = signal.resample_poly(values, factor, 1, padtype="line")
    return finer[: (values.size - 1) * factor + 1]


def smoothed(values: np.ndarray, factor: int) -> np.ndarray:
    """A smooth path through the samples at `factor` times as many knots, linear between those.

    By a spline, which follows five samples a period to 1e-5, and to the record's ends. Of several
    records, shape (n, records), each has its own path.
    """
    from scipy.interpolate import make_interp_spline

    spline = make_interp_spline(np.arange(len(values)), values, SPLINE_DEGREE)
    places = np.arange(factor * (len(values) - 1) + 1) / factor
    # Straight lines between knots weaken a sine by the factor 1 − (ω h)²/12, h = 1/factor. The
    # second derivative restores it.
    return spline(places) - spline.derivative(2)(places) / (12.0 * factor**2)


def closed(values: np.ndarray) -> np.ndarray:
    """A record that continues at its beginning: its ends are faded into each other.

    The cross-fade keeps the power of two stretches that are not correlated.
    """
    fade = max(1, round(CROSS_FADE_SHARE * values.size))
    angle = 0.5 * np.pi * np.arange(fade) / fade
    loop = values[: values.size - fade].copy()
    loop[:fade] = np.sin(angle) * values[:fade] + np.cos(angle) * values[values.size - fade :]
    return loop


def _refuse(file, fault, mend, count, total, where):
    """Refuse faulty samples unless `mend` names the fault and they are few enough."""
    name, cure = {
        "nan": ("without a number", "cut the record there"),
        "clipped": ("clipped", "measure in a wider range"),
    }[fault]
    if count > LARGEST_MENDED_SHARE * total:
        raise SceneError(
            f"{file}: {count} of {total} samples are {name} ({where}): more than "
            f"{LARGEST_MENDED_SHARE:.0%} cannot be mended: {cure}"
        )
    if fault not in mend:
        raise SceneError(
            f'{file}: {count} of {total} samples are {name} ({where}); mend = ["{fault}"] mends '
            "them"
        )


def clipped_samples(values: np.ndarray) -> np.ndarray:
    """Where the samples stay at an extreme value, crest after crest: bool of the same shape."""
    clipped = np.zeros(values.size, dtype=bool)
    for extreme in (values.max(), values.min()):
        flat = np.concatenate([[False], values == extreme, [False]])
        edges = np.flatnonzero(flat[1:] != flat[:-1])
        starts, stops = edges[::2], edges[1::2]
        crests = stops - starts >= FLAT_SAMPLES
        if np.count_nonzero(crests) >= FLAT_CRESTS:
            clipped |= flat[1:-1]
    return clipped


def _unclip(values, clipped):
    from scipy.interpolate import CubicSpline

    good = np.flatnonzero(~clipped)
    mended = values.copy()
    mended[clipped] = CubicSpline(good, values[good])(np.flatnonzero(clipped))
    # The true crest cannot lie inside the clipped value, whatever the spline gives.
    inside = clipped & (np.abs(mended) < np.abs(values))
    mended[inside] = values[inside]
    return mended


def _even(values, times, rate, mend, file, most):
    """The samples on an even grid, with the spacing of the times' fit or the given rate."""
    cure = "correct it, or leave it out and give excitation.sampling_rate"
    base = time_base(times, rate, file, cure)
    if base is not None:
        return EvenSamples(base.resampled(values), 1.0 / base.spacing, base.remarks)
    steps = np.diff(times)
    # Stamps that are rounded have a median step that is another than their mean.
    single = steps[steps <= LONG_STEP * np.median(steps)]
    usual = float(single.mean())
    spacing = usual if rate is None else 1.0 / rate
    knots = (times[-1] - times[0]) / spacing
    if knots >= most:
        raise SceneError(
            f"{file}: the time column covers {knots:.3g} spacings of {spacing:.6g} s, and this "
            f"machine's memory allows {most}: cut the record at its gaps"
        )
    remark = _bridged(times, steps, usual, file)
    if "uneven" not in mend:
        raise SceneError(
            f"{file}: the time column leaves an even grid: its steps differ by "
            f'{np.ptp(steps) / usual:.2g} spacings of {usual:.6g} s; mend = ["uneven"] interpolates'
        )
    if rate is None:
        # Where only whole samples are missing, the others keep their values.
        places = np.append(0.0, np.cumsum(np.maximum(np.round(steps / usual), 1.0)))
        fitted = slope_of(times, places)
        scatter = np.ptp(times - places * fitted)
        if scatter <= max(1.01 * rounded_to(single), 2.0 * LARGEST_JITTER * fitted):
            values = np.interp(np.arange(places[-1] + 1.0), places, values)
            return EvenSamples(values, 1.0 / fitted, (remark,))
    grid = times[0] + np.arange(int(knots + 1e-9) + 1) * spacing
    return EvenSamples(_between(grid, times, values, usual), 1.0 / spacing, (remark,))


def _between(grid, times, values, usual):
    """Values at times of a grid: by a spline, in gaps and short steps by straight lines."""
    from scipy.interpolate import make_interp_spline

    steps = np.diff(times)
    odd = (steps < SHORT_STEP * usual) | (steps > LONG_STEP * usual)
    inside = np.clip(np.searchsorted(times, grid, side="right") - 1, 0, steps.size - 1)
    return np.where(
        odd[inside],
        np.interp(grid, times, values),
        make_interp_spline(times, values, UNEVEN_DEGREE)(grid),
    )


def _bridged(times, steps, spacing, file):
    """A remark on gaps bridged by straight lines; refused above `LARGEST_MENDED_SHARE`."""
    missing = float(np.sum(np.maximum(np.round(steps / spacing) - 1.0, 0.0)))
    share = missing / (missing + times.size)
    longest = int(np.argmax(steps))
    largest = (
        f"the largest step is {steps[longest]:.4g} s, after t = {times[longest] - times[0]:.6g} s"
    )
    if share > LARGEST_MENDED_SHARE:
        raise SceneError(
            f"{file}: {share:.0%} of the samples are missing between the times ({largest}): more "
            f"than {LARGEST_MENDED_SHARE:.0%} cannot be mended: cut the record at its gaps, or "
            "choose a part by excitation.start"
        )
    return (
        f"interpolation brings it to even steps: {share:.1%} of the samples were missing, {largest}"
    )
