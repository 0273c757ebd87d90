"""Ornstein–Uhlenbeck noise fitted to a record's spectrum, and the record's deviation from it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.errors import AveragingError
from harvester.base.serialising import plain, read
from harvester.excitation.recorded import one_pass

if TYPE_CHECKING:
    from harvester.excitation.recorded import RecordedMotion

# Number of averaged segments, not counting segments that overlap two others by half.
STRETCHES = 16
# Upper limits of fit and comparison, as shares of half the sampling rate. Aliasing of the noise's
# tail raises the density there by 5 % and 23 %.
FITTED_SHARE, COMPARED_SHARE = 0.25, 0.5
# The fitted band excludes this share of the variance at each end. In a logarithmic fit a stop band
# would have as much weight as other bands, although the device does not respond to it.
LEFT_OUT_SHARE = 0.01
# Fewest frequencies in the fitted band.
FEWEST_FREQUENCIES = 8
# If ω τ1 at the lowest frequency exceeds this, the record determines only D/τ1².
FALLING_CORNER_RATIO = 10.0
# Deviation in dB above which the record is called far from Ornstein–Uhlenbeck noise.
FAR_DECIBELS = 1.0
# Limit of the unexplained share of the variance, and of the excess kurtosis.
FAR_SHARE = 0.25
FAR_KURTOSIS = 1.0
# The parameters with an error, and the other keys in JSON.
_PARAMETERS = ("intensity", "correlation_time")
_KEYS = {
    "lowest_frequency": "lowest",
    "highest_frequency": "highest",
    "device_frequency": "device_frequency",
    "decibels_at_device_frequency": "decibels",
    "unexplained_share_of_variance": "unexplained",
    "excess_kurtosis": "excess_kurtosis",
}


@dataclass(frozen=True)
class SpectrumFit:
    """The fit and its quality; densities are one-sided, (m/s²)²/Hz in SI.

    Attributes
    ----------
    intensity, correlation_time : D (m²/s³ in SI) and τ1 (s) of S(ω) = D/(π (1 + ω² τ1²)).
    intensity_error, correlation_time_error
        Standard errors for stationary Gaussian noise of this spectrum; infinite if the fitted band
        does not determine the parameter.
    frequency, density, fitted
        Shape (n,); Hz; the record's density and the fit, over the compared
        band.
    lowest, highest
        Hz; the fitted band, which contains nearly all of the variance.
    device_frequency : Hz, of small oscillations.
    decibels
        The record's density relative to the fit in the octave around the device's frequency; nan if
        the compared band does not contain it.
    unexplained
        ∫|P − S| / ∫max(P, S) over the band, in thirds of octaves, with the record's density P and
        the fit S: the share of variance that record and fit do not have in common.
    excess_kurtosis
        Excess kurtosis of the samples: 0 for Gaussian noise, high for a record with
        an envelope.
    """

    intensity: float
    correlation_time: float
    intensity_error: float
    correlation_time_error: float
    frequency: np.ndarray
    density: np.ndarray
    fitted: np.ndarray
    lowest: float
    highest: float
    device_frequency: float
    decibels: float
    unexplained: float
    excess_kurtosis: float

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons why the record is far from Ornstein–Uhlenbeck noise; empty if it is close."""
        differences = []
        if math.isnan(self.decibels):
            differences.append(
                f"the device's {self.device_frequency:.3g} Hz lie outside the record's band"
            )
        elif abs(self.decibels) > FAR_DECIBELS:
            differences.append(
                f"its density around the device's {self.device_frequency:.3g} Hz is "
                f"{self.decibels:+.1f} dB from the fit"
            )
        if self.unexplained > FAR_SHARE:
            differences.append(
                f"record and fit have only {1.0 - self.unexplained:.0%} of their variance in common"
            )
        if abs(self.excess_kurtosis) > FAR_KURTOSIS:
            differences.append(
                f"its excess kurtosis is {self.excess_kurtosis:.1f}; Gaussian noise has 0"
            )
        return tuple(differences)

    def notes(self) -> tuple[str, ...]:
        """The fit and the record's deviation from it, one line each."""
        fit = (
            "noise fitted to the record's spectrum from "
            f"{self.lowest:.3g} to {self.highest:.3g} Hz: "
            f"D = {_with_error(self.intensity, self.intensity_error)}, "
            f"τ1 = {_with_error(self.correlation_time, self.correlation_time_error)} s"
        )
        if not self.reasons:
            return (
                fit,
                f"the record is close to it: {self.decibels:+.1f} dB around the device's "
                f"{self.device_frequency:.3g} Hz, {1.0 - self.unexplained:.0%} of the variance in "
                f"common with the fit, excess kurtosis {self.excess_kurtosis:.1f}",
            )
        return (fit, f"the record is FAR from Ornstein–Uhlenbeck: {'; '.join(self.reasons)}")

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        values = vars(self)
        parameters = {
            name: {"estimate": values[name], "standard_error": values[f"{name}_error"]}
            for name in _PARAMETERS
        }
        others = {key: values[name] for key, name in _KEYS.items()}
        return plain({**parameters, **others, "far": bool(self.reasons)})

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> SpectrumFit:
        """Rebuild a fit, without its spectra, from the values of `to_dict`.

        Raises NotAValue, KeyError or TypeError for other values.
        """
        values: dict[str, Any] = dict.fromkeys(("frequency", "density", "fitted"), np.empty(0))
        for name in _PARAMETERS:
            values[name] = read(float, content[name]["estimate"], name)
            error = read(float | None, content[name]["standard_error"], name)
            values[f"{name}_error"] = math.inf if error is None else error
        others = {name: read(float, content[key], key) for key, name in _KEYS.items()}
        return cls(**values, **others)


def fit_spectrum(record: RecordedMotion, device_frequency: float) -> SpectrumFit:
    """Fit D and τ1 by Whittle's likelihood to an averaged periodogram.

    Raises AveragingError if the record is too short or the band too narrow.

    Notes
    -----
    Minimises Σ [log S + P/S] (P. Whittle, Ark. Mat. 2, 423 (1953)) for the fitted density S and
    Welch's estimate P with Hann windows that overlap by half; errors follow from the expected
    information, with the record's number of independent values in the band. Aliasing of the noise's
    tail makes τ1 some percent too short.
    """
    from scipy import optimize, signal, stats

    values, interval, _ = one_pass(record)
    length = values.size // STRETCHES
    frequency, density = signal.welch(values, 1.0 / interval, nperseg=max(length, 8))
    in_band = _band(record, frequency, FITTED_SHARE * 0.5 / interval)
    below = np.cumsum(density * in_band) / max(np.sum(density * in_band), 1e-300)
    in_band &= (below > LEFT_OUT_SHARE) & (below < 1.0 - LEFT_OUT_SHARE)
    if np.count_nonzero(in_band) < FEWEST_FREQUENCIES:
        raise AveragingError(
            f"the record shows only {np.count_nonzero(in_band)} frequencies to fit; at least "
            f"{FEWEST_FREQUENCIES} are needed: use a longer record or a wider excitation.band"
        )
    compared = _band(record, frequency, COMPARED_SHARE * 0.5 / interval)
    in_band, frequency, density = in_band[compared], frequency[compared], density[compared]
    # Independent values in the band per frequency of the periodogram: the weight of each frequency
    # in the likelihood.
    weight = values.size * interval * (frequency[1] - frequency[0])

    def misfit(logarithms):
        share = density[in_band] / _model(frequency[in_band], *np.exp(logarithms))
        return weight * float(np.sum(share - np.log(share)))

    strongest = density.max() / 4.0
    start = np.log([strongest, strongest / np.mean(values**2)])
    options = {"xatol": 1e-8, "fatol": 1e-8, "maxiter": 4000, "maxfev": 4000}
    minimum = optimize.minimize(misfit, start, method="Nelder-Mead", options=options)
    intensity, time = np.exp(minimum.x)
    fitted = _model(frequency, intensity, time)
    if 2.0 * np.pi * frequency[in_band][0] * time > FALLING_CORNER_RATIO:
        raise AveragingError(
            "the record's density falls over its whole band, so that it does not determine D: use "
            "a longer record, or simulate with the record itself"
        )
    # ∫|P − S| / ∫max(P, S): record P and fit S are first averaged over thirds of octaves.
    thirds = np.floor(3.0 * np.log2(frequency / frequency[0])).astype(int)
    measured, modelled = np.bincount(thirds, density), np.bincount(thirds, fitted)
    apart = np.abs(measured - modelled).sum() / np.maximum(measured, modelled).sum()
    errors = _relative_errors(frequency[in_band], time, weight)
    return SpectrumFit(
        intensity=float(intensity),
        correlation_time=float(time),
        intensity_error=float(intensity * errors[0]),
        correlation_time_error=float(time * errors[1]),
        frequency=frequency,
        density=density,
        fitted=fitted,
        lowest=float(frequency[in_band][0]),
        highest=float(frequency[in_band][-1]),
        device_frequency=device_frequency,
        decibels=_decibels(frequency, density, fitted, device_frequency),
        unexplained=float(apart),
        excess_kurtosis=float(stats.kurtosis(values)),
    )


def _band(record, frequency, high):
    """The fitted frequencies: above the segments' trend, within the record's band."""
    low = 2.0 * frequency[1]
    if record.band is not None:
        low, high = max(low, record.band[0]), min(high, record.band[1])
    return (frequency >= low) & (frequency <= high)


def _model(frequency, intensity, time):
    """One-sided density per hertz, 4 π S(ω), of the noise in Eq. 6."""
    return 4.0 * intensity / (1.0 + (2.0 * np.pi * frequency * time) ** 2)


def _relative_errors(frequency, time, weight):
    """The relative errors of D and τ1, from the expected information of their logarithms."""
    square = (2.0 * np.pi * frequency * time) ** 2
    slopes = np.stack([np.ones_like(square), -2.0 * square / (1.0 + square)])
    information = weight * slopes @ slopes.T
    if np.linalg.cond(information) > 1e12:
        return np.array([1.0 / math.sqrt(information[0, 0]), math.inf])
    return np.sqrt(np.diag(np.linalg.inv(information)))


def _decibels(frequency, density, fitted, centre):
    near = (frequency >= centre / math.sqrt(2.0)) & (frequency <= centre * math.sqrt(2.0))
    if not frequency[0] <= centre <= frequency[-1] or not near.any():
        return math.nan
    return 10.0 * math.log10(density[near].mean() / fitted[near].mean())


def _with_error(value, error):
    if math.isfinite(error):
        from harvester.base.formatting import value_and_error

        return value_and_error(value, error)
    return f"{value:.2g} (too short to show)"
