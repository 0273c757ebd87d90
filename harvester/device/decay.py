"""Exact solution of a driven linear decay, for decay times shorter than a step."""

from __future__ import annotations

import numpy as np

from harvester.base.compilation import compiled

# Below this exponent the recursion for the drive's coefficients runs downwards: upwards it would
# lose digits by cancellation.
SMALL_EXPONENT = 0.5
LAST_TERM = 14


@compiled
def decayed(
    value: float, rate: float, time: float, start: float, middle: float, end: float
) -> float:
    """Solution y of y' = −rate y + drive after a time; the drive is a parabola through 3 values.

    Exact for any rate; at a large rate y tends to end/rate, the equilibrium with the drive.

    `value`: y at the beginning. `rate`, `time`: 1/s ≥ 0, and s. `start`, `middle`, `end`: the drive
    at the beginning, half-way and at the end.
    """
    z = rate * time
    constant, linear, square = _shares(z)
    bend = 2.0 * (start - 2.0 * middle + end)
    slope = end - start - bend
    return value * np.exp(-z) + time * (constant * start + linear * slope + square * bend)


@compiled
def _shares(z):
    """Integrals I_k = ∫₀¹ exp(−z (1 − u)) uᵏ du for k = 0, 1, 2, by z I_k = 1 − k I_{k−1}."""
    if z >= SMALL_EXPONENT:
        constant = -np.expm1(-z) / z
        linear = (1.0 - constant) / z
        return constant, linear, (1.0 - 2.0 * linear) / z
    share = 1.0 / (LAST_TERM + 1.0)
    for k in range(LAST_TERM, 3, -1):
        share = (1.0 - z * share) / k
    square = (1.0 - z * share) / 3.0
    linear = 0.5 * (1.0 - z * square)
    return 1.0 - z * linear, linear, square
