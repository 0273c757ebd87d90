"""One compiled step of Eq. 4: by Runge–Kutta, by Heun's scheme, or with exact decay."""

from __future__ import annotations

import enum

from harvester.base.compilation import compiled, merged, register_jitable
from harvester.device import system
from harvester.device.decay import decayed
from harvester.device.system import System

# If voltage or velocity decay by more than exp(−1) in a step, by load or damper, the decay is
# computed exactly.
# Explicit schemes are stable up to exponents of 2 (Heun) and 2.78 (Runge–Kutta).
LARGEST_DECAY = 1.0


class Scheme(enum.Enum):
    """Schemes for a step of Eq. 4; a member's value is its name in results."""

    RUNGE_KUTTA = "Runge-Kutta 4"
    HEUN = "Heun 2"
    EXACT_DECAY = "exact decay, order 3"

    @property
    def argument(self) -> bool | None:
        """The scheme as an argument of compiled code.

        None has a separate type: the code for Runge–Kutta, the usual scheme, is compiled without
        the other two, so that LLVM vectorizes it. With an enumeration every step would branch.
        """
        return {Scheme.RUNGE_KUTTA: None, Scheme.HEUN: True, Scheme.EXACT_DECAY: False}[self]


# Schemes by their names in `harvester.MonteCarlo`.
NAMED = {"runge-kutta": Scheme.RUNGE_KUTTA, "heun": Scheme.HEUN}


def scheme_of(s: System, name: str, step: float) -> Scheme:
    """The scheme of this name, or exact decay if a decay is faster than a step (s)."""
    damping = s.damper.damping + s.transducer.damping()
    if max(s.transducer.decay_rate(), damping) * step > LARGEST_DECAY:
        return Scheme.EXACT_DECAY
    return NAMED[name]


@merged
def _acceleration(s, touching, low, high, held, x, v, voltage, noise):
    force = system.push(s, x, v, voltage, noise)
    if touching:
        force -= system.contact_force(s, x, v, held, low, high)
    return force


@merged
def one_step(
    scheme: bool | None,
    s: System,
    touching: bool,
    low: float,
    high: float,
    held: float,
    x: float,
    v: float,
    voltage: float,
    noise: float,
    slope: float,
    h: float,
    reaction: float,
) -> tuple[float, float, float]:
    """One step of Eq. 4, of length `h`; returns X, X' and the transducer's state at its end.

    Parameters
    ----------
    scheme
        `Scheme.argument` of the scheme to take.
    touching : bool
        Whether the mass is in contact throughout the step.
    low, high, held : float
        Ends of the mass's zone; impact speed that the contact's law holds constant.
    x, v, voltage : float
        X, X' and the transducer's state at the step's beginning.
    noise, slope : float
        The excitation there, and its rate of change.
    reaction : float
        The contacts' force at the step's beginning, known from the step before.
    """
    if scheme is None:
        return _runge_kutta(s, touching, low, high, held, x, v, voltage, noise, slope, h, reaction)
    if scheme:
        return _heun(s, touching, low, high, held, x, v, voltage, noise, slope, h, reaction)
    return _exponential(s, touching, low, high, held, x, v, voltage, noise, slope, h, reaction)


@register_jitable
def _exponential(s, touching, low, high, held, x, v, voltage, noise, slope, h, reaction):
    """Step of third order with exact decay of X' and V at any rate.

    X' decays driven by all other forces, V decays driven by X'. Each drive is a parabola through
    the step's beginning, middle and end: the middle is predicted twice, the end once.
    """
    half = 0.5 * h
    middle = noise + slope * half
    c, rate = (
        s.damper.damping + system.transducer_damping(s.transducer),
        system.decay_rate(s.transducer),
    )
    start = system.push(s, x, v, voltage, noise) - reaction + c * v
    force, base = start, system.base_rate(s.transducer, slope)
    v2 = voltage2 = 0.0
    for _ in range(2):
        # The drive is extrapolated along the straight line from the beginning through the middle.
        v2 = decayed(v, c, half, start, 0.5 * (start + force), force)
        x2 = x + 0.5 * half * (v + v2)
        voltage2 = decayed(voltage, rate, half, v + base, 0.5 * (v + v2) + base, v2 + base)
        force = _acceleration(s, touching, low, high, held, x2, v2, voltage2, middle) + c * v2
    v4 = decayed(v, c, h, start, force, 2.0 * force - start)
    x4 = x + h / 6.0 * (v + 4.0 * v2 + v4)
    voltage4 = decayed(voltage, rate, h, v + base, v2 + base, v4 + base)
    ahead = noise + slope * h
    end = _acceleration(s, touching, low, high, held, x4, v4, voltage4, ahead) + c * v4
    v4 = decayed(v, c, h, start, force, end)
    x4 = x + h / 6.0 * (v + 4.0 * v2 + v4)
    return x4, v4, decayed(voltage, rate, h, v + base, v2 + base, v4 + base)


@compiled
def _heun(s, touching, low, high, held, x, v, voltage, noise, slope, h, reaction):
    """Heun's step of second order: the mean of the slopes at both ends."""
    base = system.base_rate(s.transducer, slope)
    a1 = system.push(s, x, v, voltage, noise) - reaction
    u1 = system.state_rate(s.transducer, v + base, voltage)
    v2 = v + h * a1
    e2 = voltage + h * u1
    a2 = _acceleration(s, touching, low, high, held, x + h * v, v2, e2, noise + slope * h)
    u2 = system.state_rate(s.transducer, v2 + base, e2)
    half = 0.5 * h
    return x + half * (v + v2), v + half * (a1 + a2), voltage + half * (u1 + u2)


@merged
def _runge_kutta(s, touching, low, high, held, x, v, voltage, noise, slope, h, reaction):
    """Classical Runge–Kutta step of Eq. 4; a contact is active throughout the step or never."""
    half = 0.5 * h
    middle = noise + slope * half
    base = system.base_rate(s.transducer, slope)
    a1 = system.push(s, x, v, voltage, noise) - reaction
    u1 = system.state_rate(s.transducer, v + base, voltage)
    v2 = v + half * a1
    e2 = voltage + half * u1
    a2 = _acceleration(s, touching, low, high, held, x + half * v, v2, e2, middle)
    u2 = system.state_rate(s.transducer, v2 + base, e2)
    v3 = v + half * a2
    e3 = voltage + half * u2
    a3 = _acceleration(s, touching, low, high, held, x + half * v2, v3, e3, middle)
    u3 = system.state_rate(s.transducer, v3 + base, e3)
    v4 = v + h * a3
    e4 = voltage + h * u3
    a4 = _acceleration(s, touching, low, high, held, x + h * v3, v4, e4, noise + slope * h)
    u4 = system.state_rate(s.transducer, v4 + base, e4)
    sixth = h / 6.0
    return (
        x + sixth * (v + 2.0 * (v2 + v3) + v4),
        v + sixth * (a1 + 2.0 * (a2 + a3) + a4),
        voltage + sixth * (u1 + 2.0 * (u2 + u3) + u4),
    )
