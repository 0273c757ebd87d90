"""Frequency pre-warping of TR-BDF2: exact for a linear device at one frequency.

A step of length h has a relative frequency error of 0.040 (ωh)² and a damping ratio of 0.018 (ωh)³.
This is irrelevant for noise, but at 40 steps per period it is half the width of a resonance with
Q = 500. Both follow from the method's stability function R(z) = (1 + (1 − 2d) z)/(1 − d z)². With z
the root of R(z) = exp(iωh) near iωh, the method solves

    X' = p V,   V' = η − p (forces + γ V),   p = Im z/(ωh),   γ = p ω Im z²/Re z²

so that X and V oscillate as in the exact equations at ω. The charge moved by the mass is
proportional to X, as p V. At other frequencies ω' the share (ω'² − ω²)/ω'² of the error remains.
"""

from __future__ import annotations

import numpy as np

from circuits.kernel.stage import State
from circuits.kernel.tables import Tables
from harvester.base.compilation import compiled, merged

# The coefficient δ of a stage, relative to the step.
DIAGONAL = 1.0 - 0.5 * np.sqrt(2.0)


@compiled
def tr_bdf2_prewarp_factor(angle: float) -> tuple[float, float]:
    """Return the factor p, and the damping over ω that cancels the method's numerical damping.

    See `circuits.equivalent.elements.trapezoidal_prewarp_factor` for ngspice.

    Parameters
    ----------
    angle : float
        ω h > 0, less than 1.
    """
    turn = np.exp(1j * angle) - 1.0
    d = DIAGONAL
    b = 2.0 * d * turn + 1.0
    root = 2.0 * turn / (b + np.sqrt(b * b - 4.0 * (turn + 1.0) * d * d * turn)) / angle
    pace = root.imag
    square = root * root
    return pace, pace * square.imag / square.real


@merged
def retime(tables: Tables, state: State, h: float) -> None:
    """Set the pre-warping for a step of length h if the excitation has a sine; h = 0: none."""
    scalars = state.scalars[0]
    if scalars.line > 0.0 and scalars.timed_for != h:
        scalars.timed_for = h
        scalars.pace, scalars.cancelled = 1.0, 0.0
        if h > 0.0:
            scalars.pace, cancelled = tr_bdf2_prewarp_factor(scalars.line * h)
            scalars.cancelled = scalars.line * cancelled
        mass = tables.retimed[0]
        state.capacity[mass] = tables.capacity[mass] / scalars.pace
        for k in range(1, tables.retimed.size):
            row = tables.retimed[k]
            state.conductance[row] = tables.conductance[row] * scalars.pace
