"""Effects of sensors on their signals, and the true quantities that cause the signals.

A sensor that blocks constants (AC coupling) shows a(s) s/(s + ω); the true quantity is the signal
plus ω times its integral. This correction is applied to the acceleration that drives a model. The
integral of offset and noise is a slow drift, on which the sensor has no information, so a fitted
parabola is removed.

An output is compared after its sensor: the simulated output passes through the sensor's filters.
Correcting the measured output instead would integrate its noise, and bias a free corner frequency
downwards. A filter's unknown state at the beginning of a window is the one that fits the window
best.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from harvester.base.errors import SceneError
from harvester.base.plain_text import named, nearest, shown
from harvester.records.time_base import SPLINE_DEGREE

OUTPUT_UNITS = {"voltage": "V", "displacement": "m", "velocity": "m/s"}
OUTPUTS = tuple(OUTPUT_UNITS)
# Effects of sensors. A high-pass has a corner frequency (Hz), and is of first order or second order
# (Butterworth). The resistance (Ω) is that of the input, in parallel with the load. `NEUTRAL`
# contains nonzero values without effect.
HIGHPASSES = ("highpass", "highpass2")
NEUTRAL = {"scale": 1.0, "resistance": math.inf}
OUTPUT_EFFECTS = ("offset", "scale", "delay", "filter")
# The base's sensor has no delay, since it equals the opposite delay of all outputs.
BASE_EFFECTS = ("offset", "scale", *HIGHPASSES)
VOLTAGE_EFFECTS = (*HIGHPASSES, "resistance")
# Between samples an output is a polynomial of fifth degree through six of them. With twelve samples
# per period its error is 1e-4 of the amplitude. For each position of the step among the six, one
# matrix gives each sample's polynomial from the step's beginning.
STENCILS = np.array(
    [np.linalg.inv(np.vander(np.arange(6.0) - n, increasing=True)) for n in range(5)]
)
# Input resistance of a typical probe (Ω), the initial value of a free resistance.
PROBE = 1e7
VELOCITY_SCALE = "sensor.velocity_scale"
# Valid values of each effect, as text and as a check.
REQUIRED = {
    "scale": ("a number other than 0", lambda value: math.isfinite(value) and value != 0.0),
    "resistance": ("a number > 0", lambda value: value > 0.0),
    **dict.fromkeys(
        ("filter", *HIGHPASSES), ("a number ≥ 0", lambda value: 0.0 <= value < math.inf)
    ),
}


def sensor_keys(outputs: Sequence[str]) -> list[str]:
    """Keys of the sensors of a record."""
    keys = [f"sensor.acceleration_{effect}" for effect in BASE_EFFECTS]
    for output in outputs:
        effects = OUTPUT_EFFECTS + (VOLTAGE_EFFECTS if output == "voltage" else ())
        keys += [f"sensor.{output}_{effect}" for effect in effects]
    return keys


def checked_sensors(
    values: Mapping[str, object], outputs: Sequence[str], where: str
) -> dict[str, float]:
    """Check the given effects of sensors, and return them as numbers by key.

    Raises
    ------
    SceneError
        An effect is unknown, not a number, or not physical.
    """
    names, numbers = sensor_keys(outputs), {}
    for key, value in values.items():
        if key not in names:
            raise SceneError(f"{where}: unknown setting {named(key)}{nearest(key, names)}")
        number = float(value) if isinstance(value, (int, float)) else math.nan
        effect = key.rpartition("_")[2]
        requirement, holds = REQUIRED.get(effect, ("a number", math.isfinite))
        if math.isnan(number) or not holds(number):
            raise SceneError(f"{where}: {key} = {shown(value)}: must be {requirement}")
        numbers[key] = number
    return numbers


def integrals(
    samples: np.ndarray, rate: float, positions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """First and second integral of a sampled series without drift.

    Parameters
    ----------
    samples : ndarray, shape (n,)
    rate : float
        Hz.
    positions : ndarray
        Positions of the requested values, in samples.
    """
    from scipy.interpolate import make_interp_spline

    spline = make_interp_spline(np.arange(samples.size), samples - samples.mean(), SPLINE_DEGREE)
    once = _without_drift(spline.antiderivative()(positions), 1) / rate
    # A straight line was removed from the first integral; a cubic is removed from the second.
    return once, _without_drift(spline.antiderivative(2)(positions), 3) / rate**2


def _without_drift(values, degree):
    """A series without its least-squares polynomial of this degree."""
    along = np.linspace(-1.0, 1.0, values.size)
    return values - np.polynomial.Legendre.fit(along, values, degree)(along)


def invert_high_pass(
    values: np.ndarray, integral: tuple[np.ndarray, np.ndarray], corner: float, second_corner: float
) -> np.ndarray:
    """The true signal, from the signal of a sensor with these high-passes.

    Parameters
    ----------
    values : ndarray
        The sensor's signal.
    integral : (ndarray, ndarray)
        Its first and second integral.
    corner, second_corner : float
        Corner frequencies of the high-pass of first and second order (Hz); 0: none.
    """
    once = 2.0 * math.pi * corner
    twice = 2.0 * math.pi * second_corner
    first, second = integral
    return values + (once + math.sqrt(2.0) * twice) * first + twice**2 * second


def filtered(
    values: np.ndarray, edges: np.ndarray, time_constant: float, corner: float, second_corner: float
) -> np.ndarray:
    """Windows of a series after a first-order low-pass and high-passes, from any state.

    The time constant is in samples (0: no low-pass); corners are in radians per sample.
    """
    if time_constant > 0.0:
        values = _convolved(values, edges, -1.0 / time_constant, 1.0 / time_constant)
    if corner:
        values = values - _convolved(values, edges, -corner, corner)
    if second_corner:
        # Butterworth: 1 − s²/(s² + √2 ω s + ω²) has the residue ω/√2 at both of its poles.
        share = second_corner / math.sqrt(2.0)
        away = _convolved(values, edges, share * complex(-1.0, 1.0), share)
        values = values - 2.0 * away.real
    return values


def _convolved(values, edges, pole, residue):
    """A series filtered by residue/(s − pole), interpolated by polynomials within each window."""
    from scipy.signal import lfilter

    size = STENCILS.shape[1]
    if values.size < size:
        return 0.0 * values
    cuts = edges - edges[0]
    positions = np.arange(values.size - 1)
    window = np.searchsorted(cuts, positions, "right") - 1
    first = np.maximum(np.minimum(positions - size // 2 + 1, cuts[window + 1] - size), cuts[window])
    first = np.clip(first, 0, values.size - size)
    weights = residue * (_moments(pole, size) @ STENCILS)
    near = np.lib.stride_tricks.sliding_window_view(values, size)[first]
    drive = np.sum(near * weights[np.clip(positions - first, 0, size - 2)], axis=1)
    # A diverging window must not affect later ones, nor must the step between windows.
    drive[~np.isfinite(drive)] = 0.0
    drive[cuts[1:-1] - 1] = 0.0
    filtered = lfilter([1.0], [1.0, -np.exp(pole)], np.concatenate([[0.0], drive]))
    filtered[~np.isfinite(values)] = np.nan
    return filtered


def _moments(pole, count):
    """∫ exp(pole (1 − τ)) τⁿ dτ from 0 to 1, n = 0 … count − 1: Kummer's function."""
    from scipy.special import hyp1f1

    powers = np.arange(count) + 1.0
    return hyp1f1(1.0, powers + 1.0, pole) / powers


def without_memory(
    shown: np.ndarray,
    seen: np.ndarray,
    edges: np.ndarray,
    time_constant: float | None,
    corner: float | None,
    second_corner: float | None,
) -> np.ndarray:
    """A simulated series, with filter states at the windows' starts that fit best.

    Parameters
    ----------
    shown : ndarray, shape (n,)
        Simulated output after the filters, from any filter states.
    seen : ndarray, shape (n,)
        Measured output.
    edges : ndarray of int, shape (windows + 1,)
    time_constant, corner, second_corner : float or None
        Time constant in samples, corners in radians per sample; None: there is no such filter. A
        free filter without effect is kept, so that the cost is continuous when its effect begins.
    """
    positions = np.concatenate([np.arange(count) for count in np.diff(edges)])
    modes = []
    if time_constant is not None:
        modes.append((math.exp(-1.0 / time_constant) if time_constant > 0.0 else 0.0) ** positions)
    if corner is not None:
        modes.append(np.exp(-corner * positions))
    if second_corner is not None:
        turned = second_corner / math.sqrt(2.0) * positions
        modes.append(np.exp(-turned) * np.cos(turned))
        modes.append(np.exp(-turned) * positions * np.sinc(turned / math.pi))
    if not modes:
        return shown
    off, states = (shown - seen)[:, None, None], np.column_stack(modes)[:, None]
    return seen + without_states(off, states, edges - edges[0])[:, 0, 0]


def without_states(series: np.ndarray, states: np.ndarray, cuts: np.ndarray) -> np.ndarray:
    """Series without the part that the states at the starts of their windows explain.

    Windows whose series are not finite are unchanged.

    Parameters
    ----------
    series : ndarray, shape (samples, outputs, n)
    states : ndarray, shape (samples, outputs, states)
        Derivatives of the outputs by the states at the start of the window of a sample.
    cuts : ndarray of int, shape (windows + 1,)
    """
    remainder = series.copy()
    for begin, end in pairwise(cuts):
        effects = states[begin:end].reshape(-1, states.shape[-1])
        effects = effects[:, np.abs(effects).max(axis=0) > 0.0]
        block = series[begin:end].reshape(effects.shape[0], -1)
        if np.isfinite(block).all():
            explained = effects @ np.linalg.lstsq(effects, block, rcond=1e-10)[0]
            remainder[begin:end] = (block - explained).reshape(remainder[begin:end].shape)
    return remainder


def parallel(resistance: float, beside: float) -> float:
    """Resistance (Ω) of two parallel resistances."""
    return resistance / (1.0 + resistance / beside)
