"""What averaging leaves out of small oscillations: the response beside the resonance.

Coloured noise moves a mass below its resonance as well, by its stiffness alone. For a linear
device the covariance is known exactly, so that what averaging lacks there is a difference: of the
solution of the Lyapunov equation of (X, X', V, η), and of the averaged energy

    E[X'²] = D/((1 + ω² τ1²)(c + N1)),  E[X²] = E[X'²]/ω²,  E[V²] = E[X'²]/(λ² + ω²),

N1 = βλ/(λ² + ω²), ω² the stiffness with β'. To first order in damping and coupling it is the finite
part of the integral over the spectrum, without the pole: for E[X²] D τ1³/(1 + ω² τ1²)².
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from harvester.forces import contact_damping

FASTEST = 10.0  # rate of damping, in units of the frequency, that still has a resonance


class Beside(NamedTuple):
    """Exact minus averaged means of the linearised device."""

    voltage: float
    velocity: float
    displacement: float
    loss: float


def beside_resonance(p, stiffness, velocity, displacement):
    """`Beside` of the small oscillations about the rest position.

    A monostable device is linearised at the frequency that its means tell, ω² = E[X'²]/E[X²].

    Parameters
    ----------
    p : harvester.parameters.ScaledParameters
    stiffness : float
        β' of the piezo in the averaged potential.
    velocity, displacement : float
        Averaged E[X'²] and E[X²].
    """
    x, damping = p.rest, p.damping
    if p.linear_stiffness >= 0.0:
        spring = velocity / displacement - stiffness
    else:
        spring = p.linear_stiffness + 3.0 * p.cubic_stiffness * x * x
        if p.preloaded:
            spring += 1.5 * p.contact_stiffness * np.sqrt(x - p.gap)
            damping += float(contact_damping(p, x, 0.0, 0.0))
    square = spring + stiffness
    rate = damping + p.coupling * p.decay_rate / (p.decay_rate**2 + square)
    # A contact that a resting mass meets at no speed damps without bound: nothing to linearise.
    if rate == 0.0 or spring <= 0.0 or rate > FASTEST * np.sqrt(square):
        return Beside(0.0, 0.0, 0.0, 0.0)
    averaged = p.intensity / ((1.0 + square * p.correlation_time**2) * rate)
    covariance = _covariance(p, spring, damping)
    change = covariance[1, 1] - averaged
    return Beside(
        voltage=covariance[2, 2] - averaged / (p.decay_rate**2 + square),
        velocity=change,
        displacement=covariance[0, 0] - averaged / square,
        loss=damping * change,
    )


def _covariance(p, spring, damping):
    """Of X, X', V and η·√(τ1/D), stationary."""
    push = np.sqrt(p.intensity / p.correlation_time)
    drift = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-spring, -damping, -p.coupling, push],
            [0.0, 1.0, -p.decay_rate, 0.0],
            [0.0, 0.0, 0.0, -1.0 / p.correlation_time],
        ]
    )
    kick = np.zeros((4, 4))
    kick[3, 3] = -2.0 / p.correlation_time
    return solve_continuous_lyapunov(drift, kick)
