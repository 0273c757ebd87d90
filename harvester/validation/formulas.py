"""Published closed forms, as functions of plain numbers.

They use no code of the simulated device, so a fault there shows as a difference.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import brentq

# Quadrature points over displacements: for a smooth function that vanishes at both ends the
# trapezoidal sum is exact up to rounding.
QUADRATURE_POINTS = 20_001


def power_of_spectrum(
    damping: float,
    stiffness: float,
    coupling: float,
    decay_rate: float,
    points: tuple[tuple[float, float], ...],
) -> float:
    """E[P] of a linear piezoelectric harvester under a one-sided density, scaled: β λ ∫|H|² G df.

    Parameters
    ----------
    damping, stiffness, coupling, decay_rate : float
        c, k, β and λ of Eq. 4.
    points : tuple of (float, float)
        Frequency (Hz) and density, straight between them on log–log axes.
    """
    places, density = np.log(np.array(points)).T
    frequencies = np.exp(np.linspace(places[0], places[-1], 2 * QUADRATURE_POINTS))
    s = 2j * np.pi * frequencies
    voltage = s / (s + decay_rate)
    gain = np.abs(voltage / (s**2 + damping * s + stiffness + coupling * voltage)) ** 2
    values = gain * np.exp(np.interp(np.log(frequencies), places, density))
    return coupling * decay_rate * float(np.trapezoid(values, frequencies))


def linear_piezo_power(
    damping: float,
    stiffness: float,
    coupling: float,
    decay_rate: float,
    intensity: float,
    correlation_time: float = 0.0,
) -> float:
    """E[P] of a linear piezoelectric harvester under Ornstein–Uhlenbeck noise, scaled.

    Parameters
    ----------
    damping, stiffness, coupling, decay_rate : float
        c, k, β and λ of Eq. 4.
    intensity, correlation_time : float
        D and τ1 (s); white noise at 0.
    """
    frequency = math.sqrt(stiffness)
    ratio, square = 0.5 * damping / frequency, coupling / stiffness
    alpha, t = frequency / decay_rate, frequency * correlation_time
    white = intensity * square * alpha
    white /= 2 * ratio + (4 * ratio**2 + square) * alpha + 2 * ratio * (1 + square) * alpha**2
    lower = alpha * (1 + square) * t**2 + 2 * ratio * alpha * t + alpha + t**3
    return white * (t + alpha + 2 * ratio * alpha * t) / (lower + 2 * ratio * t**2 + t)


def linear_coil_power(
    mass: float,
    damping: float,
    flux_gradient: float,
    coil_resistance: float,
    resistance: float,
    intensity: float,
) -> float:
    """E[P] (W) of a coil without inductance on any linear spring under white noise.

    All in SI; E[ηη'] = 2 D δ with D the intensity (m²/s³).
    """
    total = coil_resistance + resistance
    rate = (damping + flux_gradient**2 / total) / mass
    return flux_gradient**2 * resistance / total**2 * intensity / rate


def gibbs_mean(
    potential: Callable[[Any], Any],
    temperature: float,
    value: Callable[[Any], Any],
    reach: float = 1.0,
) -> float:
    """Mean of a function of X with the density exp(−U/T); both take arrays (scaled).

    The range of X starts at ±`reach` and grows until U is 40 T above its minimum at both ends.
    """
    while True:
        x = np.linspace(-reach, reach, QUADRATURE_POINTS)
        energy = potential(x)
        if min(energy[0], energy[-1]) >= energy.min() + 40.0 * temperature:
            break
        reach *= 1.5
    weight = np.exp((energy.min() - energy) / temperature)
    return float(np.sum(weight * value(x)) / np.sum(weight))


def double_well_square(temperature: float) -> float:
    """E[X²] under exp(−U/T) in U = −X²/2 + X⁴/4 (scaled)."""
    return gibbs_mean(lambda x: -(x**2) / 2 + x**4 / 4, temperature, lambda x: x * x)


def kramers_rate(
    damping: float, well_frequency: float, barrier_frequency: float, barrier_over_temperature: float
) -> float:
    """Kramers' escape rate from a well (1/s) at moderate damping; angular frequencies."""
    reduced = math.sqrt(damping**2 / 4.0 + barrier_frequency**2) - damping / 2.0
    attempts = reduced / barrier_frequency * well_frequency / (2.0 * math.pi)
    return attempts * math.exp(-barrier_over_temperature)


def rebound_speed(restitution: float) -> float:
    """Speed after a drop at speed 1 on a Hertz-damp stopper: h (1 + ρ) = ln[(1 + h)/(1 − h ρ)].

    h = ¾ (1 − e²), with the nominal restitution e.
    """
    h = 0.75 * (1.0 - restitution**2)
    if h == 0.0:
        return 1.0
    return brentq(lambda r: h * (1 + r) - math.log((1 + h) / (1 - h * r)), 0.0, 1.0, xtol=1e-14)


def ideal_load_power(
    kind: str, coupling: float, capacitance: float, amplitude: float, frequency: float,
    resistance: float, quality: float = 1.0,
) -> float:  # fmt: skip
    """Power of a load R on a piezo (θ, C) in the prescribed motion u sin 2πft (SI).

    Parameters
    ----------
    kind : str
        A resistor; an ideal bridge with smoothing; parallel or series SSHI at its best R,
        γ = e^(−π/2Q); lossless synchronous charge extraction (sece), whose power does not depend on
        R.
    quality : float
        Quality factor Q of the switched coil.
    """
    omega = 2.0 * math.pi * frequency
    unit = coupling**2 * amplitude**2 * omega / capacitance
    ratio, left = omega * capacitance * resistance, math.exp(-math.pi / (2.0 * quality))
    share = ratio / (0.5 * math.pi)
    return {
        "resistor": 0.5 * unit * ratio / (1.0 + ratio**2),
        "bridge": 2.0 * unit / math.pi * share / (1.0 + share) ** 2,
        "sshi_parallel": unit / (math.pi * (1.0 - left)),
        "sshi_series": unit / (2.0 * math.pi) * (1.0 + left) / (1.0 - left),
        "sece": 2.0 / math.pi * unit,
    }[kind]


# The following formulas are for mass 1 and stiffness 1 under F0 sin 2πft, with F0, η, θ, Cp (SI).
def resistor_power(
    frequency: float, resistance: float, force: float, damping: float, coupling: float,
    capacitance: float,
) -> float:  # fmt: skip
    """Power of a resistor on a driven device.

    x = F0/[1 − ω² + iω (η + θ²/(1/R + iωCp))], P = |ωθx/(1/R + iωCp)|²/2R.
    """
    omega = 2.0 * math.pi * frequency
    admittance = 1.0 / resistance + 1j * omega * capacitance
    x = force / (1.0 - omega**2 + 1j * omega * (damping + coupling**2 / admittance))
    return abs(omega * coupling * x / admittance) ** 2 / (2.0 * resistance)


def coupled_bridge_power(
    frequency: float, resistance: float, force: float, damping: float, coupling: float,
    capacitance: float,
) -> float:  # fmt: skip
    """Power of an ideal bridge on a driven device, by Shu and Lien (2006).

    The one-harmonic form that balances energy: a = ωCpR + π/2,
    u0 = F0/√{[ηω + 2ωθ²R/a²]² + [1 − ω² + ωθ²R/a]²}, P = ω²θ²R u0²/a².
    """
    omega = 2.0 * math.pi * frequency
    a = omega * capacitance * resistance + 0.5 * math.pi
    back = omega * coupling**2 * resistance
    lossy = damping * omega + 2.0 * back / a**2
    size = force / math.hypot(lossy, 1.0 - omega**2 + back / a)
    return (omega * coupling * size / a) ** 2 * resistance


def coupled_sece_power(figure_of_merit: float, force: float, damping: float) -> float:
    """SECE's power at the best frequency, Lefeuvre (2006): F0²/8η · 4x/(1 + x)².

    x = 4k²Q/π; k²Q is the figure of merit.
    """
    x = 4.0 * figure_of_merit / math.pi
    return 4.0 * x / (1.0 + x) ** 2 * force**2 / (8.0 * damping)
