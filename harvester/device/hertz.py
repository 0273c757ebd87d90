"""The Hertz-damp contact law of Eq. 5: K d^n (1 + b d'), b = ¾ (1 − e²)/v0, d the depth.

v0 is the speed at which the contact began. It is computed from the state during the contact,
v0² = d'² + 2 [max(U(x) − U(gap), 0) + E], with the spring's energy U and the contact's energy
E = K d^(n+1)/(n+1): |d'|/v0 ≤ 1 always, even if the stopper is inside the well. With `event`, v0 is
instead held constant from the moment of contact.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from harvester.device.dispatch import Values, equation

# An elastic Hertz contact lasts 2.943 times the ratio of its greatest depth to the approach speed.
HERTZ_EXPONENT, HERTZ_DURATION = 1.5, 2.9432752
# Compiled code finds a part's other equations by name.
elastic_energy, impact_speed, duration, power_below = map(
    equation, ("elastic_energy", "impact_speed", "duration", "power_below")
)


class HertzDamp(NamedTuple):
    """One contact's law; depth and speed in scaled units.

    Attributes
    ----------
    stiffness : K l^(n−1)/M.
    exponent
        Exponent n of the depth in the elastic force.
    damping_factor
        ¾ (1 − e²), dimensionless.
    holds
        1 if v0 is held from the moment of contact (`event`), else 0.
    duration_factor
        Duration of an elastic contact in units of greatest depth / approach speed.
    """

    stiffness: float
    exponent: float
    damping_factor: float
    holds: float
    duration_factor: float

    def power_below(self, depth: Values) -> Values:
        """Return d^(n−1), one power below the force."""
        return depth ** (self.exponent - 1.0)

    def elastic_force(self, depth: Values) -> Values:
        """K d^n; `depth` ≥ 0, a float or an array of any shape."""
        return self.stiffness * depth * power_below(self, depth)

    def elastic_energy(self, depth: Values) -> Values:
        """K d^(n+1)/(n+1) (Eq. 15)."""
        share = self.stiffness / (self.exponent + 1.0)
        return share * depth * depth * power_below(self, depth)

    def elastic_stiffness(self, depth: float) -> float:
        """n K d^(n−1), the slope of the elastic force."""
        return self.exponent * self.stiffness * power_below(self, depth)

    def greatest_depth(self, energy: float) -> float:
        """Depth at which the contact holds this energy per mass."""
        order = self.exponent + 1.0
        return (order * energy / self.stiffness) ** (1.0 / order)

    def impact_speed(self, depth: Values, v: Values, spring_energy: Values) -> Values:
        """Impact speed v0, computed from the state; `spring_energy` is U(x) − U(gap)."""
        energy = elastic_energy(self, depth) + np.maximum(spring_energy, 0.0)
        return np.sqrt(v * v + 2.0 * energy)

    def damping(
        self, depth: Values, v: Values, spring_energy: Values, held_speed: Values
    ) -> Values:
        """Damping force over velocity (1/s).

        `held_speed` is v0 if it is held; at least |v| is used.
        """
        if self.holds != 0.0:
            speed = np.maximum(held_speed, np.abs(v))
        else:
            speed = impact_speed(self, depth, v, spring_energy)
        factor = self.damping_factor * self.stiffness
        return factor * depth * power_below(self, depth) / np.maximum(speed, 1e-300)

    def force_formula(
        self, depth: str, sign: str, u: str, gain: str, number: Callable, held: str, rate: float
    ) -> str:
        """The force over rate² as an expression of circuits and Verilog-A, in contact only.

        Parameters
        ----------
        depth, sign, u : str
            The depth, the side s as 1, −1 or an expression, and X'/rate.
        gain : str
            2 [U(x) − U(gap)]/rate², bounded by 0 if it may be negative.
        number : callable
            Turns (name, value, meaning, range of Verilog-A) into the text of a number.
        held : str
            The node voltage of v0/rate if v0 is held, else empty.
        rate : float
            1/s.
        """
        stiffness = number("stiffness", self.stiffness / rate**2, "K/rate^2", "[0:inf)")
        push = f"{stiffness}*pow({depth},{number('exponent', self.exponent, 'n', '[1:inf)')})"
        if self.damping_factor == 0.0:
            return f"{push}*{sign}"
        if self.holds:
            share = f"((abs({u})<{held}) ? {u}/{held} : sgn({u}))"
        else:
            order = self.exponent + 1.0
            twice = 2.0 / order * self.stiffness / rate**2
            twice = number("energy", twice, "2 K/((n + 1) rate^2)", "[0:inf)")
            energy = f"{twice}*pow({depth},{number('order', order, 'n + 1', '[2:inf)')})"
            # The term 1e-30 only avoids 0/0 at the instant of contact.
            share = f"{u}*pow({u}*{u}+{gain}+{energy}+1e-30,-0.5)"
        factor = number("damping_factor", self.damping_factor, "3 (1 - e^2)/4", "[0:0.75]")
        return f"{push}*({sign}+{factor}*{share})"

    def duration(self, speed: float) -> float:
        """Duration of an elastic contact that starts with this speed (s)."""
        order = self.exponent + 1.0
        greatest = (0.5 * order * speed * speed / self.stiffness) ** (1.0 / order)
        return self.duration_factor * greatest / speed

    def shortened(self, square_speed: float, steps: int, longest: float) -> float:
        """Step (s), at most `longest`: a contact with this squared impact speed takes `steps`."""
        if self.exponent == HERTZ_EXPONENT:
            # The comparison with `longest` for the common case of a soft contact, without a power
            # function.
            bound = HERTZ_DURATION / (steps * longest)
            bound = bound * bound * bound * bound * bound
            soft = 1.25 / self.stiffness
            if square_speed <= bound * bound * soft * soft * soft * soft:
                return longest
        if square_speed == 0.0:
            return longest
        return min(longest, duration(self, np.sqrt(square_speed)) / steps)


class Hertz(HertzDamp):
    """The law with Hertz's exponent n = 3/2: a separate type, compiled with a square root."""

    __slots__ = ()

    def power_below(self, depth: Values) -> Values:
        """√d, one power below the force."""
        return np.sqrt(depth)


def hertz_damp(
    stiffness: float, restitution: float, exponent: float = HERTZ_EXPONENT, event: bool = False
) -> HertzDamp:
    """The law with this stiffness (scaled), restitution e and exponent n ≥ 1."""
    factor = HERTZ_DURATION
    law: type[HertzDamp] = Hertz
    if exponent != HERTZ_EXPONENT:
        law = HertzDamp
        # Duration factor: 2 ∫ du/√(1 − u^(n+1)) from 0 to 1.
        share = 1.0 / (exponent + 1.0)
        factor = 2.0 * math.sqrt(math.pi) * math.gamma(1.0 + share) / math.gamma(0.5 + share)
    return law(
        stiffness=float(stiffness),
        exponent=float(exponent),
        damping_factor=0.75 * (1.0 - restitution * restitution),
        holds=float(bool(event)),
        duration_factor=factor,
    )
