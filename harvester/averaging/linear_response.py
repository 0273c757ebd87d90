"""What averaging leaves out of small oscillations: the load's response beside the resonance.

For a linear device the covariance is known exactly, so that what averaging lacks there is a
difference: of the solution of the Lyapunov equation of (X, X', V, η), and of the averaged energy

    ω² E[X²] = D/((m + ω² τ1²)(c/m + βλ r)),  E[X'²] = ω² E[X²]/m,  E[V²] = r ω² E[X²],

m = 1 + τ1 c (`layers.effective_mass`), r = (ω² + λ²/m)/(ω² + λ²)², ω² the stiffness with β'.
Without a load there is none.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

FASTEST = 10.0  # rate of damping, in units of the frequency, that still has a resonance


class Beside(NamedTuple):
    """Exact minus averaged means of the linearised device."""

    voltage: float
    velocity: float
    displacement: float
    loss: float


def beside_resonance(p, stiffness, velocity, displacement, loss):
    """`Beside` of the small oscillations about the rest position.

    Linearised with the damping that the means tell, c = loss/E[X'²], and a monostable device at
    their frequency, ω² = m E[X'²]/E[X²].

    Parameters
    ----------
    p : harvester.averaging.symmetric.SymmetricDevice
    stiffness : float
        β' of the piezo in the averaged potential.
    velocity, displacement, loss : float
        Averaged E[X'²], E[X²] and mechanical loss.
    """
    x, damping = p.rest, loss / velocity
    mass = 1.0 + p.correlation_time * damping
    if p.linear_stiffness >= 0.0:
        spring = mass * velocity / displacement - stiffness
    else:
        spring = p.linear_stiffness + 3.0 * p.cubic_stiffness * x * x
        if p.preloaded:
            spring += 1.5 * p.contact_stiffness * np.sqrt(x - p.gap)
    square = spring + stiffness
    followed = (square + p.decay_rate**2 / mass) / (square + p.decay_rate**2) ** 2
    rate = damping / mass + p.coupling * p.decay_rate * followed
    if rate == 0.0 or spring <= 0.0 or rate > FASTEST * np.sqrt(square):
        return Beside(0.0, 0.0, 0.0, 0.0)
    averaged = p.intensity / ((mass + square * p.correlation_time**2) * rate)
    covariance = _covariance(p, spring, damping)
    change = covariance[1, 1] - averaged / mass
    return Beside(
        voltage=covariance[2, 2] - averaged * followed,
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
