"""Conditioning of a record's samples: detrending, filtering, upsampling, cross-fading."""

from __future__ import annotations

import numpy as np

from harvester.base.errors import SceneError
from harvester.records.samples import SMALLEST_PEAK
from harvester.records.time_base import SPLINE_DEGREE

# Order of the Butterworth filters.
FILTER_ORDER = 4
# Narrowest band of a filter as a share of the sampling rate, limited by rounding errors.
SMALLEST_BAND_SHARE = 1e-6
# Share of a repeated record that is cross-faded, at each end.
CROSS_FADE_SHARE = 0.05


def conditioned(
    values: np.ndarray, rate: float, detrend: str, band: tuple[float, float] | None, file: str
) -> np.ndarray:
    """Samples without trend, within a band.

    `values`: shape (n,). `detrend`: "none", "mean" or "linear". `band`: Hz: Butterworth filter of
    fourth order, forward and backward (zero phase, eighth order in total, −6 dB at both ends); a
    lower end of 0 gives a low-pass. Raises SceneError if the band is not below half the sampling
    rate, or the result is zero.
    """
    from scipy import signal

    if detrend != "none":
        values = signal.detrend(values, type="constant" if detrend == "mean" else "linear")
    if band is not None:
        values = signal.sosfiltfilt(_filter(*band, rate, file), values)
    if np.abs(values).max() < SMALLEST_PEAK:
        raise SceneError(f"{file}: excitation.detrend and band remove the whole record")
    return values


def _filter(low, high, rate, file):
    """Second-order sections of the band's filter."""
    from scipy import signal

    least = SMALLEST_BAND_SHARE * rate
    if not low + least <= high < 0.5 * rate or 0.0 < low < least:
        raise SceneError(
            f"{file}: excitation.band = [{low:g}, {high:g}]: must be at least {least:.2g} Hz wide, "
            f"begin at 0 or at least {least:.2g} Hz, and end below {0.5 * rate:g} Hz (half the "
            "sampling rate)"
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
    """A smooth path through the samples, with `factor` times as many knots, linear between knots.

    A spline reproduces a sine of five samples per period to 1e-5, up to the record's ends. Several
    records, shape (n, records), are interpolated separately.
    """
    from scipy.interpolate import make_interp_spline

    spline = make_interp_spline(np.arange(len(values)), values, SPLINE_DEGREE)
    places = np.arange(factor * (len(values) - 1) + 1) / factor
    # Straight lines between knots weaken a sine by the factor 1 − (ω h)²/12, h = 1/factor. The
    # second derivative compensates this.
    return spline(places) - spline.derivative(2)(places) / (12.0 * factor**2)


def closed(values: np.ndarray) -> np.ndarray:
    """A record that can be repeated: its ends are cross-faded.

    The cross-fade preserves the power of uncorrelated ends.
    """
    fade = max(1, round(CROSS_FADE_SHARE * values.size))
    angle = 0.5 * np.pi * np.arange(fade) / fade
    loop = values[: values.size - fade].copy()
    loop[:fade] = np.sin(angle) * values[:fade] + np.cos(angle) * values[values.size - fade :]
    return loop
