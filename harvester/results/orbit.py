"""Attractor: a steady motion of a driven device that some of a run's starts reach."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from harvester.base.arguments import Named
from harvester.base.formatting import with_error
from harvester.base.serialising import plain
from harvester.statistics.attractors import Divergence
from harvester.statistics.estimate import Estimate

# Aperiodic motions: with a Lyapunov exponent that is not above 0, and with an unknown exponent.
NOT_SETTLED, UNDETERMINED = "not settled", "no period: chaotic or not settled"
NO_PERIOD = "no period"
# Starts that reach no steady motion: a store charges, the mass leaves the range, values overflow.
CHARGING, ESCAPES, DIVERGES = "still charging", "escapes", "diverges"
UNSTEADY = NOT_SETTLED, CHARGING, ESCAPES, DIVERGES
REASONS = {
    NOT_SETTLED: "no period is repeated and neighbouring paths do not diverge; follow the motion "
    "longer (raise periods or run.settle)",
    CHARGING: "a store of the load charges too slowly for the time followed; reduce its "
    "capacitance, which mainly changes the ripple, or start it within 0.1 % of its steady voltage "
    "by ic=",
    ESCAPES: "the mass leaves oscillator.restoring_force_range, where the spring is unknown",
    DIVERGES: "the values overflow: start closer to the rest position, or choose a shorter step",
}


@dataclass(frozen=True)
class Attractor:
    """One steady motion that some starts of a run reach, in the scene's units.

    Attributes
    ----------
    name : A, B, … in the order of their shares, or one of `UNSTEADY`.
    period
        Period of the motion in periods of the excitation; None for an aperiodic motion.
    periodic_drive
        Whether the excitation is periodic; otherwise starts whose paths meet form one motion.
    starts, share
        Number of starts that settled on the motion, and their share of all starts.
    share_error
        Standard error of the share, if starts are drawn randomly.
    quantities
        Means of power, voltage and displacement; empty if the motion is not steady. For a periodic
        motion, means over whole cycles of the start that converged best and of starts that settled
        before the measurement. Otherwise means over all its starts.
    points
        Displacement and velocity at the starts of the excitation's periods; shape (n, 2).
    lyapunov
        The largest Lyapunov exponent (1/s) of an aperiodic motion; None if it was not computed or
        no neighbours could be followed.
    """

    name: str
    period: int | None
    periodic_drive: bool
    starts: int
    share: float
    share_error: float | None
    quantities: dict[str, Estimate]
    points: np.ndarray = field(repr=False)
    lyapunov: Divergence | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "quantities", means_of_motion(self.name, self.quantities))

    @property
    def kind(self) -> str:
        """The kind of motion, as text."""
        if self.name in UNSTEADY:
            return self.name
        if self.period is not None:
            return f"period {self.period}"
        if not self.periodic_drive:
            return "one motion"
        if self.lyapunov is None:
            return UNDETERMINED
        return "chaotic" if self.lyapunov.chaotic else NOT_SETTLED

    def to_dict(self, unit: Callable[[str], str]) -> dict[str, Any]:
        """Plain values for JSON; `unit` returns the unit of a dimension."""
        quantities = {
            name: estimate.to_dict(unit(estimate.dimension))
            for name, estimate in self.quantities.items()
        }
        return plain({"kind": self.kind, **vars(self), "quantities": quantities})

    def sentence(self, power_unit: str) -> str:
        """A sentence with the orbit's kind, share of starts and power."""
        error = "" if self.share_error is None else f" ± {self.share_error:.1%}"
        power = self.quantities.get("mean_power")
        gives = "" if power is None else f", mean power {with_error(power, power_unit)}"
        plural = "s" if self.starts > 1 else ""
        parts = "" if self.lyapunov is None else f", largest Lyapunov exponent {self.lyapunov} 1/s"
        label = self.name if self.name in UNSTEADY else f"orbit {self.name} ({self.kind})"
        return f"{label}: {self.starts} start{plural}, {self.share:.1%}{error}{gives}{parts}"


def means_of_motion(name: str, means: Mapping[str, Estimate]) -> Named:
    """The means of a motion; an unknown name raises UnknownQuantity."""
    why = "" if means else f" ({REASONS.get(name, 'not a steady motion')})"
    return Named(f"motion {name}{why}: no", means)


def share_error(part: int, count: int) -> float:
    """Standard error of a share of independent starts, above 0 even if no or all starts count."""
    share = (part + 0.5) / (count + 1.0)
    return math.sqrt(share * (1.0 - share) / count)


def orbit_name(number: int) -> str:
    """A … Z, then A1, ….

    >>> orbit_name(0), orbit_name(27)
    ('A', 'B1')
    """
    letter, again = chr(ord("A") + number % 26), number // 26
    return f"{letter}{again}" if again else letter
