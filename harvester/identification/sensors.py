"""What sensors make of their quantities, and the true quantities behind what they show.

A sensor that does not pass constants (AC coupling) shows a(s) s/(s + ω); the true quantity is what
it shows plus ω times the integral of that. So the measured series is put right, and no filter needs
a state at the beginning of a window. What an integral gathers of offset and noise is a slow drift:
its parabola is taken out, as the sensor tells nothing of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from harvester.errors import SceneError
from harvester.excitation.conditioning import SPLINE_DEGREE
from harvester.files.plain_text import named, nearest, shown

OUTPUTS = ("voltage", "displacement", "velocity")
# Values at which an effect vanishes. A high-pass is given by its corner (Hz), of first order, or of
# second (Butterworth's); the resistance (Ω) is that of the input, in parallel with the load.
HIGHPASSES = {"highpass": 0.0, "highpass2": 0.0}
OUTPUT_EFFECTS = {"offset": 0.0, "scale": 1.0, "delay": 0.0, "filter": 0.0}
# The base's sensor has no delay: it would equal an opposite delay of all outputs.
BASE_EFFECTS = {"offset": 0.0, "scale": 1.0, **HIGHPASSES}
VOLTAGE_EFFECTS = {**HIGHPASSES, "resistance": math.inf}
# Input resistance of a usual probe (Ω), from which a free resistance begins.
PROBE = 1e7
VELOCITY_SCALE = "sensor.velocity_scale"
# What a given value of each effect must be: in words, and as a check.
REQUIRED = {
    "scale": ("a number other than 0", lambda value: math.isfinite(value) and value != 0.0),
    "resistance": ("a number > 0", lambda value: value > 0.0),
    **dict.fromkeys(
        ("filter", *HIGHPASSES), ("a number ≥ 0", lambda value: 0.0 <= value < math.inf)
    ),
}


def sensor_keys(outputs: Sequence[str]) -> dict[str, float]:
    """Keys of the sensors that a record has, to their values without effect."""
    found = {f"sensor.acceleration_{effect}": v for effect, v in BASE_EFFECTS.items()}
    for output in outputs:
        effects = OUTPUT_EFFECTS | (VOLTAGE_EFFECTS if output == "voltage" else {})
        found |= {f"sensor.{output}_{effect}": v for effect, v in effects.items()}
    return found


def neutral(key: str) -> float:
    """A sensor's value without effect."""
    return sensor_keys(OUTPUTS)[key]


def checked_sensors(
    values: Mapping[str, object], outputs: Sequence[str], where: str
) -> dict[str, float]:
    """The given effects of sensors as numbers by key, after a check.

    Raises
    ------
    SceneError
        No such effect, no number, or one that no sensor has.
    """
    known, found = sensor_keys(outputs), {}
    for key, value in values.items():
        if key not in known:
            raise SceneError(f"{where}: unknown setting {named(key)}{nearest(key, known)}")
        number = float(value) if isinstance(value, (int, float)) else math.nan
        effect = key.rpartition("_")[2]
        wanted, holds = REQUIRED.get(effect, ("a number", math.isfinite))
        if math.isnan(number) or not holds(number):
            raise SceneError(f"{where}: {key} = {shown(value)}: must be {wanted}")
        found[key] = number
    return found


def integrals(
    samples: np.ndarray, rate: float, places: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """First and second integral of a sampled series without their drift.

    Parameters
    ----------
    samples : ndarray, shape (n,)
    rate : float
        Hz.
    places : ndarray
        Where they are wanted, in samples.
    """
    from scipy.interpolate import make_interp_spline

    spline = make_interp_spline(np.arange(samples.size), samples - samples.mean(), SPLINE_DEGREE)
    once = _without_drift(spline.antiderivative()(places), 1) / rate
    # A line was taken out of the first integral, hence a parabola and its drift out of the second.
    return once, _without_drift(spline.antiderivative(2)(places), 3) / rate**2


def _without_drift(values, degree):
    """A series less the polynomial of this degree that is nearest to it."""
    along = np.linspace(-1.0, 1.0, values.size)
    table = np.polynomial.legendre.legvander(along, degree)
    # Legendre polynomials are nearly orthogonal: the normal equations are well conditioned.
    return values - table @ np.linalg.solve(table.T @ table, table.T @ values)


def put_right(
    values: np.ndarray,
    integral: tuple[np.ndarray, np.ndarray],
    corner: float,
    second_corner: float,
) -> np.ndarray:
    """What a sensor with these high-passes was shown.

    Parameters
    ----------
    values : ndarray
        That it shows.
    integral : (ndarray, ndarray)
        First and second integral of them.
    corner, second_corner : float
        Of the high-pass of first and of second order (Hz); 0: there is none.
    """
    once = 2.0 * math.pi * corner
    twice = 2.0 * math.pi * second_corner
    first, second = integral
    return values + (once + math.sqrt(2.0) * twice) * first + twice**2 * second


def parallel(resistance: float, beside: float) -> float:
    """Resistance (Ω) of two in parallel."""
    return resistance / (1.0 + resistance / beside)
