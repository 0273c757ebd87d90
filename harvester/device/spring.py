"""Springs: a restoring force F(x) and its energy U = ∫F, scaled: per mass and length unit.

A spring is a named tuple of numbers: `harvester.device.polynomial.Polynomial`,
`harvester.device.force_table.ForceTable`, or a `Ranged` spring within a range. All have the
same methods and properties. Compiled code calls `force`, `energy` and `greatest_stiffness` through
the functions of this module; formulas are expressions of circuits and Verilog-A, whose argument
`number` turns (name, value, meaning, range of Verilog-A) into the text of a number.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from harvester.device.dispatch import Values, equation
from harvester.device.force_table import ForceTable
from harvester.device.polynomial import Polynomial

# Functions of (spring, x): the force F(x), the energy U(x) = ∫F dx from 0, and a bound of |F'| at
# all displacements up to |x|. x is a float or, if called by Python, an array of any shape.
force = equation("force")
energy = equation("energy")
greatest_stiffness = equation("greatest_stiffness")
# Number of points of the range at which the stiffness is evaluated to find the greatest.
STIFFNESS_POINTS = 201


class Ranged(NamedTuple):
    """A spring with a limited range of validity, such as a softening one.

    Beyond the range the force continues as a restoring straight line: a mass that leaves the range
    is detected before numbers overflow, and every engine ends the run with an error.

    Attributes
    ----------
    spring
        The spring within the range.
    low, high
        Ends of the range.
    stiffness
        Stiffness of the straight lines beyond the range.
    """

    spring: Any
    low: float
    high: float
    stiffness: float

    @property
    def symmetric(self) -> bool:
        return self.spring.symmetric and self.low == -self.high

    @property
    def straight(self) -> bool:
        """False: F has a corner at both ends of the range."""
        return False

    @property
    def linear(self) -> float:
        """The stiffness at x = 0."""
        return self.spring.linear

    @property
    def line(self) -> tuple[float, float]:
        """Constant and linear part of the force: both 0, since `nonlinear_formula` has it all."""
        return 0.0, 0.0

    @property
    def odd_cubic(self) -> None:
        """None: there is no closed form."""
        return

    @property
    def range(self) -> tuple[float, float]:
        """Displacements between which the force is valid."""
        return self.low, self.high

    def force(self, x: Values) -> Values:
        inside = np.minimum(np.maximum(x, self.low), self.high)
        return force(self.spring, inside) + self.stiffness * (x - inside)

    def energy(self, x: Values) -> Values:
        inside = np.minimum(np.maximum(x, self.low), self.high)
        beyond = x - inside
        rise = force(self.spring, inside) + 0.5 * self.stiffness * beyond
        return energy(self.spring, inside) + rise * beyond

    def greatest_stiffness(self, x: Values) -> Values:
        return greatest_stiffness(self.spring, x) + self.stiffness

    def slope(self, x: Values) -> Values:
        inside = (self.low <= np.asarray(x)) & (np.asarray(x) <= self.high)
        return np.where(inside, self.spring.slope(x), self.stiffness)[()]

    def taylor(self, x: float) -> tuple[float, float, float]:
        """Coefficients of the first three powers of F about a displacement in the range."""
        return self.spring.taylor(x)

    def roots(self) -> np.ndarray:
        """Displacements without a force in the range, ascending."""
        roots = self.spring.roots()
        return roots[(self.low <= roots) & (roots <= self.high)]

    def turning_points(self, energy: float) -> tuple[float, float]:
        """The outermost displacements within the range that are reached with this energy."""
        x = np.linspace(self.low, self.high, STIFFNESS_POINTS)
        bottom = min((float(self.energy(root)) for root in self.roots()), default=0.0)
        reached = x[self.energy(x) <= bottom + energy]
        return (float(reached.min()), float(reached.max())) if reached.size > 1 else self.range

    def nonlinear_formula(self, x: str, rate: float, number: Callable) -> str:
        """A formula of F(x)/rate² for netlists."""
        tilt, linear = self.spring.line
        parts = [
            number("tilt", tilt / rate**2, "F(0)/rate^2") if tilt else "",
            f"{number('linear_stiffness', linear / rate**2, 'k1/rate^2')}*{x}" if linear else "",
            self.spring.nonlinear_formula(x, rate, number),
        ]
        inside = "+".join(filter(None, parts)) or "0"
        lines = [
            [float(self.spring.force(end)) / rate**2, self.stiffness / rate**2]
            for end in (self.low, self.high)
        ]
        return self._chosen(x, "force", f"({inside})", lines, number)

    @property
    def gain_is_product(self) -> bool:
        return False

    def gain_formula(self, x: str, gap: float, rate: float, number: Callable) -> str:
        """A formula of 2 [U(x) − U(gap)]/rate² for netlists."""
        inside = self.spring.gain_formula(x, gap, rate, number)
        parabolas = []
        for end in (self.low, self.high):
            rise = float(self.spring.energy(end)) - float(self.energy(gap))
            rising = rise, float(self.spring.force(end)), 0.5 * self.stiffness
            parabolas.append([2.0 * coefficient / rate**2 for coefficient in rising])
        return self._chosen(x, "gain", f"({inside})", parabolas, number)

    def _chosen(self, x, name, inside, beyond, number):
        """The formula within the range, and the polynomials of the distance beyond both ends."""

        def outside(side, end, coefficients):
            texts = [
                number(f"{name}_{side}{n}", value, f"/rate^2 beyond the range, power {n}")
                for n, value in enumerate(coefficients)
            ]
            inner = texts.pop()
            for text in reversed(texts):
                inner = f"({text}+({x}-{end})*{inner})"
            return inner

        low = number(f"{name}_lowest", self.low, "end of the range")
        high = number(f"{name}_highest", self.high, "end of the range")
        above = f"(({x}>{high}) ? {outside('above', high, beyond[1])} : {inside})"
        return f"(({x}<{low}) ? {outside('below', low, beyond[0])} : {above})"


def ranged(spring: Any, low: float, high: float) -> Ranged:
    """A spring within a range; the stiffness beyond is the greatest within the range."""
    x = np.linspace(low, high, STIFFNESS_POINTS)
    stiffness = float(np.abs(spring.slope(x)).max())
    # A mass that leaves the range must turn back within about the length of the range.
    pull = max(abs(float(spring.force(low))), abs(float(spring.force(high))))
    return Ranged(spring, float(low), float(high), max(stiffness, pull / (high - low)) or 1.0)


Spring = Polynomial | ForceTable | Ranged
