"""Reject or repair faulty samples: gaps, markers, clipping, impossible values."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from harvester.base.errors import SceneError

# Limits of a record's largest sample, in m/s² or scaled; beyond them its square over- or
# underflows.
SMALLEST_PEAK, LARGEST_PEAK = 1e-30, 1e12
# Faults that a scene may request to repair: "nan" and "clipped" here, "uneven" in `time_base`.
FAULTS = ("nan", "uneven", "clipped")
# Minimum number of samples in a record.
FEWEST_SAMPLES = 64
# Maximum share of repaired samples.
LARGEST_MENDED_SHARE = 0.1
# A sample is an outlier if its distance from the median exceeds the largest distance of all other
# samples by this factor. The samples of a shock differ, while markers are equal or a single sample.
FAR_RATIO, FAR_RATIO_OF_ONE, SAMPLES_PER_MARKER = 5.0, 20.0, 2
# The middle half of the samples determines the centre and the spread of ordinary samples.
SHARE_OF_REST = 0.5
# A clipped peak has this many equal extreme samples, and a clipped record two such peaks: one flat
# peak is a coincidence.
FLAT_SAMPLES, FLAT_CRESTS = 3, 2


def check_size(values: np.ndarray, where: str, factor: float = 1.0, unit: str = "") -> None:
    """Raise SceneError for samples that no sensor measures in any unit.

    `values`: shape (n,); NaN and infinite values are ignored. `factor`: from the unit to SI.
    """
    peak = np.abs(values).max(initial=0.0, where=np.isfinite(values))
    if peak != 0.0 and not SMALLEST_PEAK <= peak * factor <= LARGEST_PEAK:
        raise SceneError(
            f"{where}: the largest sample is {peak:g}{f' in the unit {unit}' if unit else ''}, "
            f"which must be in [{SMALLEST_PEAK / factor:g}, {LARGEST_PEAK / factor:g}]: check "
            "the column and its unit"
        )


def without_markers(
    values: np.ndarray, mend: Collection[str]
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Samples with markers (-9999, 65535, a saturation value) replaced by NaN if `mend` requests
    it.

    Loggers write such a number for a missing measurement.

    `values`: shape (n,); samples with the file's values, before units and scales. `mend`: faults to
    repair; "nan" treats markers as gaps. Returns the samples, shape (n,), and a remark if there are
    markers.
    """
    remark = marker_remark(values)
    if not remark:
        return values, ()
    if "nan" not in mend:
        return values, (
            f'{remark}; they are used unless excitation.mend = ["nan"] treats them as gaps',
        )
    return np.where(outliers(values), np.nan, values), (f"{remark}: treated as gaps",)


def marker_remark(values: np.ndarray) -> str:
    """Text on the markers among samples, shape (n,); "" if there are none."""
    far = outliers(values)
    if not far.any():
        return ""
    count, ordinary = int(np.count_nonzero(far)), values[np.isfinite(values) & ~far]
    written = ", ".join(f"{value:g}" for value in np.unique(values[far])[:3])
    return (
        f"{count} of {values.size} {'sample is' if count == 1 else 'samples are'} {written}, far "
        f"outside all others ({ordinary.min():.3g} to {ordinary.max():.3g})"
    )


def outliers(values: np.ndarray) -> np.ndarray:
    """Samples that are markers, bool (n,): a single one, or a few equal ones, far outside all
    others.
    """
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


def repaired(
    values: np.ndarray,
    times: np.ndarray | None,
    where: str,
    mend: Collection[str] | None = None,
) -> tuple[np.ndarray, np.ndarray | None, tuple[str, ...]]:
    """Repaired samples, their times, and texts on the repairs.

    `values`, `times`: shape (n,). `mend`: faults to repair: "nan" by linear interpolation over the
    gap, "clipped" by a cubic spline through the other samples; None: no repair. Raises SceneError
    for too few samples, and for a fault that is not in `mend` or cannot be repaired.
    """
    check_length(values, where)
    remarks: tuple[str, ...] = ()
    lost = ~np.isfinite(values)
    if times is not None:
        lost |= ~np.isfinite(times)
    if lost.any():
        gaps, valid = np.flatnonzero(lost), np.flatnonzero(~lost)
        _refuse("nan", lost, f"the first is sample {gaps[0]}", where, mend)
        longest = int(np.diff(valid, prepend=-1, append=lost.size).max()) - 1
        remarks = (
            f"{gaps.size} of {values.size} samples had no value and were interpolated "
            f"linearly: the largest gap has {longest} sample{'s' if longest > 1 else ''}",
        )
        # Invalid samples and their times are interpolated over the sample number.
        numbers = np.arange(values.size)
        values = np.interp(numbers, valid, values[valid])
        times = None if times is None else np.interp(numbers, valid, times[valid])
    clipped = clipped_samples(values)
    if clipped.any():
        _refuse("clipped", clipped, f"at {np.abs(values[clipped]).max():g}", where, mend)
        values = _unclip(values, clipped)
    return values, times, remarks


def _refuse(fault, samples, detail, where, mend):
    """Raise SceneError for faulty samples, unless `mend` names the fault and they are few."""
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
            f"{message}: more than {LARGEST_MENDED_SHARE:.0%} cannot be repaired: {cure}"
        )
    if fault not in mend:
        raise SceneError(f'{message}; excitation.mend = ["{fault}"] interpolates them')


def check_length(values: np.ndarray, where: str) -> None:
    """Raise SceneError if there are too few samples or times, shape (n,)."""
    if values.size < FEWEST_SAMPLES:
        raise SceneError(
            f"{where}: the record is too short: {values.size} samples: must be at "
            f"least {FEWEST_SAMPLES}"
        )


def check_variation(values: np.ndarray, where: str) -> None:
    """Raise SceneError if all samples, shape (n,), are equal."""
    if np.ptp(values) == 0.0:
        raise SceneError(
            f"{where}: the record is constant: every sample is {values[0]:g}: check the column"
        )


def clipped_samples(values: np.ndarray) -> np.ndarray:
    """Samples that stay at an extreme value in several peaks: bool of the same shape."""
    clipped = np.zeros(values.size, dtype=bool)
    for extreme in (values.max(), values.min()):
        flat = values == extreme
        starts, stops = np.flatnonzero(np.diff(flat, prepend=False, append=False)).reshape(-1, 2).T
        if np.count_nonzero(stops - starts >= FLAT_SAMPLES) >= FLAT_CRESTS:
            clipped |= flat
    return clipped


def _unclip(values, clipped):
    from scipy.interpolate import CubicSpline

    unclipped = np.flatnonzero(~clipped)
    crests = CubicSpline(unclipped, values[unclipped])(np.arange(values.size))
    # The true peak is at least as high as the clipped value, even if the spline is lower.
    return np.where(clipped & (np.abs(crests) >= np.abs(values)), crests, values)
