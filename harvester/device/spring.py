"""Springs: F(x) = F0 + k1 x + k2 x² + … up to degree 7, and its energy U = ∫F.

Scaled: F is a force per mass over the length unit l, so k_n = (SI coefficient) l^(n−1)/M.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from harvester.compilation import overload, register_jitable
from harvester.device.values import Values


class Spring(NamedTuple):
    """A polynomial restoring force, its even and odd powers apart.

    Where a device has only odd powers the even ones are an empty tuple and cost nothing.

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
        whole = [0.0] * 8
        whole[0 : 2 * len(self.even) : 2] = self.even
        whole[1 : 2 * len(self.odd) : 2] = self.odd
        return _trimmed(whole)

    @property
    def symmetric(self) -> bool:
        """Whether F(−x) = −F(x)."""
        return not self.even


def spring(coefficients: list[float] | tuple[float, ...]) -> Spring:
    """The spring of F(x) = Σ coefficients[n] x^n.

    Parameters
    ----------
    coefficients : sequence of float
        (F0, k1, k2, …), at most eight.

    Returns
    -------
    Spring
    """
    even = _trimmed(coefficients[0::2])
    odd = _trimmed(coefficients[1::2])
    return Spring(
        even=even,
        odd=odd,
        even_energy=tuple(k / (2 * m + 1) for m, k in enumerate(even)),
        odd_energy=tuple(k / (2 * m + 2) for m, k in enumerate(odd)),
        even_slope=tuple(2 * m * abs(k) for m, k in enumerate(even))[1:],
        odd_slope=tuple((2 * m + 1) * abs(k) for m, k in enumerate(odd)),
    )


def _trimmed(coefficients):
    kept = [float(k) for k in coefficients]
    while kept and kept[-1] == 0.0:
        kept.pop()
    return tuple(kept)


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
    """Σ coefficients[m] x^2m, each power by two products: what the force and its slope use."""
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


@register_jitable
def force(part: Spring, x: Values) -> Values:
    """F(x); `x` a float or an array of any shape."""
    if len(part.even) == 0:
        return in_powers(part.odd, x) * x
    return in_powers(part.even, x) + in_powers(part.odd, x) * x


@register_jitable
def energy(part: Spring, x: Values) -> Values:
    """U(x) = ∫F dx from 0; `x` a float or an array of any shape."""
    square = x * x
    if len(part.even) == 0:
        return in_squares(part.odd_energy, square) * square
    return in_squares(part.even_energy, square) * x + in_squares(part.odd_energy, square) * square


@register_jitable
def greatest_stiffness(part: Spring, x: np.ndarray) -> np.ndarray:
    """A bound of |F'| at all displacements up to |x|."""
    if len(part.even) == 0:
        return in_powers(part.odd_slope, x)
    return in_powers(part.odd_slope, x) + np.abs(x) * in_powers(part.even_slope, x)


def slope(part: Spring, x: float) -> float:
    """F'(x), the stiffness; `x` a float or an array of any shape."""
    odd = in_powers([(2 * m + 1) * k for m, k in enumerate(part.odd)], x)
    if not part.even:
        return odd
    return odd + x * in_powers([2 * m * k for m, k in enumerate(part.even)][1:], x)


def roots(part: Spring) -> np.ndarray:
    """Displacements without a force, ascending: ndarray of float."""
    coefficients = part.coefficients
    if len(coefficients) < 2:
        return np.empty(0)
    found = np.polynomial.Polynomial(coefficients).roots()
    real = found.real[np.abs(found.imag) < 1e-7 * (1.0 + np.abs(found.real))]
    return np.unique(real)


def rest_stiffness(coefficients: list[float] | tuple[float, ...]) -> float:
    """F' at the stiffest rest position of F(x) = Σ coefficients[n] x^n; 0 without any.

    Parameters
    ----------
    coefficients : sequence of float
        In any units.
    """
    part = spring(coefficients)
    return max([float(slope(part, float(x))) for x in roots(part)], default=0.0)


def nonlinear_formula(part: Spring, x: str, number: Callable) -> str:
    """F(x) − F0 − k1 x as an expression of circuits and Verilog-A; empty where it is zero.

    Parameters
    ----------
    x : str
        The displacement.
    number : callable
        Turns (name, value, meaning) into the text of a number.
    """
    coefficients = part.coefficients[2:]
    if not coefficients:
        return ""
    named = [k and number(f"k{n}", k, f"k{n}/rate^2") for n, k in enumerate(coefficients, start=2)]
    if coefficients[:1] == (0.0,) and len(coefficients) == 2:
        return f"({named[1]}*{x})*({x}*{x})"
    inner = named[-1]
    for text in named[-2::-1]:
        inner = f"({text}+({inner})*{x})" if text else f"({inner})*{x}"
    return f"({x}*{x})*({inner})"


def gain_is_product(part: Spring) -> bool:
    """Whether rounding leaves `gain_formula` its sign: that of a product, not of a difference."""
    return part.symmetric and len(part.odd) <= 2


def gain_formula(part: Spring, x: str, place: float, rate: float, number: Callable) -> str:
    """2 [U(x) − U(place)]/rate² as an expression of circuits and Verilog-A.

    For a spring of first and third power a product, because simulators differentiate term by term.
    """
    if gain_is_product(part):
        linear, cubic = (*part.odd, 0.0, 0.0)[:2]
        half = 0.5 * cubic / rate**2
        constant = linear / rate**2 + half * place**2
        slope = number("gain_constant", constant, "(k1 + k3 gap^2/2)/rate^2")
        if half > 0.0:
            slope += f"+{number('gain_slope', half, 'k3/(2 rate^2)', '[0:inf)')}*({x}*{x})"
        return f"({x}*{x}-{number('gap_square', place**2, 'gap^2', '(0:inf)')})*({slope})"
    powers = [2.0 * k / (n + 1) / rate**2 for n, k in enumerate(part.coefficients)]
    named = [
        number(f"gain{n}", k, f"2 k{n - 1}/({n} rate^2)") for n, k in enumerate(powers, start=1)
    ]
    inner = named.pop()
    for text in reversed(named):
        inner = f"({text}+({inner})*{x})"
    below = number("gain_below", 2.0 * float(energy(part, place)) / rate**2, "2 U(gap)/rate^2")
    return f"({x}*{inner}-({below}))"
