"""Evenly spaced samples of a record: trend, band, finer knots, ends faded into each other."""

from __future__ import annotations

import numpy as np

from harvester.base.errors import SceneError
from harvester.records.samples import SMALLEST_PEAK
from harvester.records.time_base import SPLINE_DEGREE

# Order of the Butterworth filters.
FILTER_ORDER = 4
# Narrowest band of a filter as a share of the sampling rate. Rounding spoils narrower ones.
SMALLEST_BAND_SHARE = 1e-6
# Share of a repeated record that is cross-faded, at each end.
CROSS_FADE_SHARE = 0.05


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
