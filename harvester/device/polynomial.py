"""A polynomial spring: F(x) = F0 + k1 x + k2 x² + … up to degree 7, and its energy U = ∫F.

Scaled: F is a force per mass over the length unit l, so k_n = (SI coefficient) l^(n−1)/M.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from harvester.base.compilation import overload
from harvester.device.dispatch import Values


class Polynomial(NamedTuple):
    """A polynomial restoring force, with even and odd powers separate.

    Without even powers, their tuples are empty and cost no time. See `harvester.device.spring` for
    the equations.

    Attributes
    ----------
    even, odd : tuple of float
        (F0, k2, k4, k6) and (k1, k3, k5, k7), without trailing zeros.
    even_energy, odd_energy : tuple of float
        U = x Σ even_energy x^2m + x² Σ odd_energy x^2m.
    even_slope, odd_slope : tuple of float
        |F'| ≤ |x| Σ even_slope x^2m + Σ odd_slope x^2m.
    """

    even: tuple
    odd: tuple
    even_energy: tuple
    odd_energy: tuple
    even_slope: tuple
    odd_slope: tuple

    @property
    def coefficients(self) -> tuple[float, ...]:
        """(F0, k1, k2, …) without trailing zeros, as a tuple of float."""
        padded = [0.0] * 8
        padded[0 : 2 * len(self.even) : 2] = self.even
        padded[1 : 2 * len(self.odd) : 2] = self.odd
        return _trimmed(padded)

    @property
    def symmetric(self) -> bool:
        """Whether F(−x) = −F(x)."""
        return not self.even

    @property
    def straight(self) -> bool:
        """Whether F is linear in x."""
        return len(self.coefficients) <= 2

    @property
    def linear(self) -> float:
        """k1, the stiffness at x = 0."""
        return self.odd[0] if self.odd else 0.0

    @property
    def line(self) -> tuple[float, float]:
        """(F0, k1), the part of the force that circuits build from linear elements."""
        tilt, linear = (*self.coefficients, 0.0, 0.0)[:2]
        return tilt, linear

    @property
    def odd_cubic(self) -> tuple[float, float] | None:
        """(k1, k3) if the spring has no other terms; None for other springs."""
        if not self.symmetric or len(self.odd) > 2:
            return None
        linear, cubic = (*self.odd, 0.0, 0.0)[:2]
        return linear, cubic

    @property
    def range(self) -> tuple[float, float]:
        """Range of the force: all displacements."""
        return -math.inf, math.inf

    def force(self, x: Values) -> Values:
        """The force F(x)."""
        if len(self.even) == 0:
            return in_powers(self.odd, x) * x
        return in_powers(self.even, x) + in_powers(self.odd, x) * x

    def energy(self, x: Values) -> Values:
        """U(x) = ∫F dx from 0."""
        square = x * x
        if len(self.even) == 0:
            return in_squares(self.odd_energy, square) * square
        return (
            in_squares(self.even_energy, square) * x + in_squares(self.odd_energy, square) * square
        )

    def greatest_stiffness(self, x: Values) -> Values:
        """A bound of |F'| at all displacements up to |x|."""
        if len(self.even) == 0:
            return in_powers(self.odd_slope, x)
        return in_powers(self.odd_slope, x) + np.abs(x) * in_powers(self.even_slope, x)

    def slope(self, x: Values) -> Values:
        """The stiffness F'(x)."""
        odd = in_powers([(2 * m + 1) * k for m, k in enumerate(self.odd)], x)
        if not self.even:
            return odd
        return odd + x * in_powers([2 * m * k for m, k in enumerate(self.even)][1:], x)

    def taylor(self, x: float) -> tuple[float, float, float]:
        """Coefficients of the first three powers of F about a displacement."""
        force = np.polynomial.Polynomial(self.coefficients)
        linear, square, cube = (force.deriv(n)(x) / math.factorial(n) for n in (1, 2, 3))
        return linear, square, cube

    def roots(self) -> np.ndarray:
        """Displacements without a force, ascending."""
        return _real_roots(self.coefficients, 1e-7)

    def turning_points(self, energy: float) -> tuple[float, float]:
        """The outermost displacements that this energy above the deepest well reaches."""
        level = [-(_deepest(self) + energy)]
        real = _real_roots(level + [k / (n + 1) for n, k in enumerate(self.coefficients)], 1e-6)
        return float(real.min()), float(real.max())

    def nonlinear_formula(self, x: str, rate: float, number: Callable) -> str:
        """F(x) − F0 − k1 x, over rate²; empty where it is zero."""
        coefficients = self.coefficients[2:]
        if not coefficients:
            return ""
        named = [
            k and number(f"k{n}", k / rate**2, f"k{n}/rate^2")
            for n, k in enumerate(coefficients, start=2)
        ]
        if coefficients[:1] == (0.0,) and len(coefficients) == 2:
            return f"({named[1]}*{x})*({x}*{x})"
        inner = named[-1]
        for text in named[-2::-1]:
            inner = f"({text}+({inner})*{x})" if text else f"({inner})*{x}"
        return f"({x}*{x})*({inner})"

    @property
    def gain_is_product(self) -> bool:
        """Whether `gain_formula` is a product, so that rounding cannot change its sign."""
        return self.odd_cubic is not None

    def gain_formula(self, x: str, gap: float, rate: float, number: Callable) -> str:
        """2 [U(x) − U(gap)]/rate².

        For a spring of first and third power it is a product, since simulators differentiate term
        by term.
        """
        if self.odd_cubic is not None:
            linear, cubic = self.odd_cubic
            half = 0.5 * cubic / rate**2
            constant = linear / rate**2 + half * gap**2
            slope = number("gain_constant", constant, "(k1 + k3 gap^2/2)/rate^2")
            if half != 0.0:
                bounds = ["[0:inf)"] if half > 0.0 else []
                slope += f"+{number('gain_slope', half, 'k3/(2 rate^2)', *bounds)}*({x}*{x})"
            return f"({x}*{x}-{number('gap_square', gap**2, 'gap^2', '(0:inf)')})*({slope})"
        powers = [2.0 * k / (n + 1) / rate**2 for n, k in enumerate(self.coefficients)]
        named = [
            number(f"gain{n}", k, f"2 k{n - 1}/({n} rate^2)") for n, k in enumerate(powers, start=1)
        ]
        inner = named.pop()
        for text in reversed(named):
            inner = f"({text}+({inner})*{x})"
        below = number("gain_below", 2.0 * float(self.energy(gap)) / rate**2, "2 U(gap)/rate^2")
        return f"({x}*{inner}-({below}))"


def polynomial(coefficients: Sequence[float]) -> Polynomial:
    """The spring of F(x) = Σ coefficients[n] x^n.

    `coefficients`: (F0, k1, k2, …), at most eight.
    """
    even = _trimmed(coefficients[0::2])
    odd = _trimmed(coefficients[1::2])
    return Polynomial(
        even=even,
        odd=odd,
        even_energy=tuple(k / (2 * m + 1) for m, k in enumerate(even)),
        odd_energy=tuple(k / (2 * m + 2) for m, k in enumerate(odd)),
        even_slope=tuple(2 * m * abs(k) for m, k in enumerate(even))[1:],
        odd_slope=tuple((2 * m + 1) * abs(k) for m, k in enumerate(odd)),
    )


def _trimmed(coefficients):
    trimmed = [float(k) for k in coefficients]
    while trimmed and trimmed[-1] == 0.0:
        trimmed.pop()
    return tuple(trimmed)


# Cached: the search for the device's fastest motion needs the turning points of 60 energies.
@functools.lru_cache(maxsize=64)
def _deepest(spring: Polynomial) -> float:
    """Energy of the deepest well."""
    return min((float(spring.energy(x)) for x in spring.roots()), default=0.0)


def _real_roots(coefficients, tolerance):
    if len(coefficients) < 2:
        return np.empty(0)
    roots = np.polynomial.Polynomial(coefficients).roots()
    return np.unique(roots.real[np.abs(roots.imag) < tolerance * (1.0 + np.abs(roots.real))])


def in_squares(coefficients: tuple[float, ...], square: Values) -> Values:
    """Σ coefficients[m] square^m by Horner's rule; `square` a float or an array of any shape."""
    total = 0.0 * square
    for coefficient in reversed(coefficients):
        total = coefficient + total * square
    return total


@overload(in_squares)
def _in_squares(coefficients, square):
    if len(coefficients) == 0:
        return lambda coefficients, square: 0.0
    if len(coefficients) == 1:
        return lambda coefficients, square: coefficients[0]
    return lambda coefficients, square: (
        coefficients[0] + square * in_squares(coefficients[1:], square)
    )


def in_powers(coefficients: list[Any] | tuple[float, ...], x: Values) -> Values:
    """Σ coefficients[m] x^2m, two products per power, for the force and its slope."""
    total = 0.0 * x
    for coefficient in reversed(coefficients):
        total = coefficient + total * x * x
    return total


@overload(in_powers)
def _in_powers(coefficients, x):
    if len(coefficients) == 0:
        return lambda coefficients, x: 0.0
    if len(coefficients) == 1:
        return lambda coefficients, x: coefficients[0]
    return lambda coefficients, x: coefficients[0] + in_powers(coefficients[1:], x) * x * x
