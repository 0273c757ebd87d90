"""Faults of samples: gaps, markers, clipped crests, impossible sizes; refused or mended."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from harvester.base.errors import SceneError

# Limits of a record's largest sample, in m/s² or scaled. Squares of others overflow or vanish.
SMALLEST_PEAK, LARGEST_PEAK = 1e-30, 1e12
# Faults that a scene may ask to mend: the first and the last here, the second by `time_base`.
FAULTS = ("nan", "uneven", "clipped")
# Fewest samples in a record.
FEWEST_SAMPLES = 64
# Largest share of the samples that may be mended.
LARGEST_MENDED_SHARE = 0.1
# A sample is an outlier if its distance from the median exceeds the largest distance of all other
# samples by this factor. A shock's samples differ; the samples of a marker are equal, or it is
# one sample alone.
FAR_RATIO, FAR_RATIO_OF_ONE, SAMPLES_PER_MARKER = 5.0, 20.0, 2
# The middle half of the samples shows where the centre is and how far the rest reaches.
SHARE_OF_REST = 0.5
# A clipped crest has this many equal extreme samples, and a clipped record two of them: one
# flat crest is a coincidence.
FLAT_SAMPLES, FLAT_CRESTS = 3, 2


def refuse_size(values: np.ndarray, where: str, factor: float = 1.0, unit: str = "") -> None:
    """Refuse samples that no sensor measures, whatever the unit.

    `values`: shape (n,); NaN and infinite ones are ignored. `factor`: to SI from the unit. Raises
    SceneError.
    """
    peak = np.abs(values).max(initial=0.0, where=np.isfinite(values))
    if peak != 0.0 and not SMALLEST_PEAK <= peak * factor <= LARGEST_PEAK:
        raise SceneError(
            f"{where}: the largest sample is {peak:g}{f' in the unit {unit}' if unit else ''}, "
            f"where it must be in [{SMALLEST_PEAK / factor:g}, {LARGEST_PEAK / factor:g}]: check "
            "the column and its unit"
        )


def without_markers(
    values: np.ndarray, mend: Collection[str]
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Samples with markers (-9999, 65535, a rail) replaced by NaN, if `mend` asks for it.

    Loggers write such a number for a missing measurement.

    `values`: shape (n,); samples as the file has them, before units and scales. `mend`: faults to
    mend; "nan" among them takes markers for gaps. Returns the samples, shape (n,), and a remark if
    there are markers.
    """
    remark = marker_remark(values)
    if not remark:
        return values, ()
    if "nan" not in mend:
        return values, (
            f'{remark}, and taken as acceleration: excitation.mend = ["nan"] takes such for gaps',
        )
    return np.where(outliers(values), np.nan, values), (f"{remark}: taken for gaps",)


def marker_remark(values: np.ndarray) -> str:
    """The markers among samples, shape (n,), in words; "" where there are none."""
    far = outliers(values)
    if not far.any():
        return ""
    count, others = int(np.count_nonzero(far)), values[np.isfinite(values) & ~far]
    written = ", ".join(f"{value:g}" for value in np.unique(values[far])[:3])
    return (
        f"{count} of {values.size} {'sample is' if count == 1 else 'samples are'} {written}, far "
        f"outside the rest ({others.min():.3g} to {others.max():.3g})"
    )


def outliers(values: np.ndarray) -> np.ndarray:
    """Samples that are markers: a few equal ones, or one, far outside all others: bool (n,)."""
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


def mended(
    values: np.ndarray,
    times: np.ndarray | None,
    where: str,
    mend: Collection[str] | None = None,
) -> tuple[np.ndarray, np.ndarray | None, tuple[str, ...]]:
    """Finite samples that are not clipped, their times, and the repairs, in words.

    `values`, `times`: shape (n,). `mend`: faults to mend: "nan" by straight lines over the gap,
    "clipped" by a cubic spline through the other samples; None: no repair. Raises SceneError
    for too few samples, and for a fault that was not to be mended, or cannot be.
    """
    refuse_short(values, where)
    remarks: tuple[str, ...] = ()
    lost = ~np.isfinite(values)
    if times is not None:
        lost |= ~np.isfinite(times)
    if lost.any():
        gaps, good = np.flatnonzero(lost), np.flatnonzero(~lost)
        _refuse("nan", lost, f"the first is sample {gaps[0]}", where, mend)
        longest = int(np.diff(good, prepend=-1, append=lost.size).max()) - 1
        remarks = (
            f"{gaps.size} of {values.size} samples had no value and were interpolated "
            f"linearly: the largest gap has {longest} sample{'s' if longest > 1 else ''}",
        )
        # Bad samples are interpolated over their indices, and so are their times.
        numbers = np.arange(values.size)
        values = np.interp(numbers, good, values[good])
        times = None if times is None else np.interp(numbers, good, times[good])
    clipped = clipped_samples(values)
    if clipped.any():
        _refuse("clipped", clipped, f"at {np.abs(values[clipped]).max():g}", where, mend)
        values = _unclip(values, clipped)
    return values, times, remarks


def _refuse(fault, samples, detail, where, mend):
    """Raise for faulty samples, unless `mend` names the fault and they are few."""
    name, cure = {
        "nan": ("without a number", "cut the record there"),
        "clipped": ("clipped", "measure in a wider range"),
    }[fault]
    count = int(np.count_nonzero(samples))
    message = f"{where}: {count} of {samples.size} samples are {name} ({detail})"
    if mend is None:
        raise SceneError(f"{message}: {cure}")
    if count > LARGEST_MENDED_SHARE * samples.size:
        raise SceneError(
            f"{message}: more than {LARGEST_MENDED_SHARE:.0%} cannot be mended: {cure}"
        )
    if fault not in mend:
        raise SceneError(f'{message}; excitation.mend = ["{fault}"] interpolates them')


def refuse_short(values: np.ndarray, where: str) -> None:
    """Refuse too few samples or times, shape (n,). Raises SceneError."""
    if values.size < FEWEST_SAMPLES:
        raise SceneError(
            f"{where}: the record is too short: {values.size} samples, and {FEWEST_SAMPLES} are "
            "the fewest"
        )


def refuse_constant(values: np.ndarray, where: str) -> None:
    """Refuse samples, shape (n,), that are all the same. Raises SceneError."""
    if np.ptp(values) == 0.0:
        raise SceneError(f"{where}: the record is constant: every sample is {values[0]:g}")


def clipped_samples(values: np.ndarray) -> np.ndarray:
    """Samples that stay at an extreme value at several crests: bool of the same shape."""
    clipped = np.zeros(values.size, dtype=bool)
    for extreme in (values.max(), values.min()):
        flat = values == extreme
        starts, stops = np.flatnonzero(np.diff(flat, prepend=False, append=False)).reshape(-1, 2).T
        if np.count_nonzero(stops - starts >= FLAT_SAMPLES) >= FLAT_CRESTS:
            clipped |= flat
    return clipped


def _unclip(values, clipped):
    from scipy.interpolate import CubicSpline

    good = np.flatnonzero(~clipped)
    crests = CubicSpline(good, values[good])(np.arange(values.size))
    # The true crest cannot lie inside the clipped value, whatever the spline gives.
    return np.where(clipped & (np.abs(crests) >= np.abs(values)), crests, values)
