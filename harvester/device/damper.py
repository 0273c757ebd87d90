"""Dampers: c x' and air drag C2 |x'| x'. Scaled: c = C/M, C2 l/M, forces per mass."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np


class Damper(NamedTuple):
    """A linear damper, c x' (Eq. 4a).

    Attributes
    ----------
    damping
        Damping coefficient c (1/s).
    """

    damping: float

    def rate(self, v: float) -> float:
        """Damping force over velocity (1/s); its product with v² is the loss."""
        return self.damping

    def force(self, v: float) -> float:
        """Force against the velocity."""
        return self.damping * v


class QuadraticDamper(NamedTuple):
    """A linear damper and drag that grows with the square of the velocity.

    Attributes
    ----------
    damping
        Damping coefficient c (1/s).
    quadratic_damping : C2 l/M, per scaled displacement.
    """

    damping: float
    quadratic_damping: float

    def rate(self, v: float) -> float:
        """Damping force over velocity (1/s); its product with v² is the loss."""
        return self.damping + self.quadratic_damping * np.abs(v)

    def force(self, v: float) -> float:
        """Force against the velocity."""
        return (self.damping + self.quadratic_damping * np.abs(v)) * v


def damper(damping: float, quadratic_damping: float = 0.0) -> Damper | QuadraticDamper:
    """The damper with these coefficients; without drag a `Damper`."""
    if quadratic_damping:
        return QuadraticDamper(float(damping), float(quadratic_damping))
    return Damper(float(damping))


def drag_formula(part: Damper | QuadraticDamper, u: str, number: Callable) -> str:
    """The drag as an expression of circuits and Verilog-A; empty without drag.

    `u` is the text of X'/rate and `number` turns (name, value, meaning, range of Verilog-A) into
    the text of a number.
    """
    quadratic = getattr(part, "quadratic_damping", 0.0)
    if not quadratic:
        return ""
    return f"{number('quadratic_damping', quadratic, 'C2', '[0:inf)')}*abs({u})*{u}"
