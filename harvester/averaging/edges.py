"""Self-consistent families of orbits, and the stationary density along them (Eqs. 20–25).

N1 and N2 belong to the orbit through ω(H), which depends on N2: each level of an edge has its
own fixed point. Near the separatrix ω → 0 takes N2 away and shifts the barrier, so that
neighbouring levels cross each other there. An edge is therefore followed from its regular end
(the well's bottom, high energy) only as far as its orbits lie inside one another.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize.elementwise import find_root

from harvester.averaging.orbits import Orbits
from harvester.errors import AveragingError

if TYPE_CHECKING:
    from harvester.averaging.orbits import OuterEdge, WellEdge
    from harvester.averaging.symmetric import SymmetricDevice

SCAN_STEP = 0.25  # of the level coordinate
SCAN_NODES = 16
OUTER_EXPONENT = 45.0  # ln g falls by this much up to the outer end
NEGLIGIBLE = 1e-8  # and by this much inside the innermost orbit of a well


@dataclass(frozen=True)
class Stretch:
    """One edge between two levels: orbits and coefficients of Eqs. 11, 21, 22, arrays.

    Attributes
    ----------
    level : ndarray
        Level coordinate of the edge, evenly spaced.
    orbits : Orbits
    pivot : float
        Of the orbits' moments.
    frequency, spectrum : ndarray
        ω = 2π/T and 1/(1 + ω² τ1²) = S(ω)/S(0).
    gain : ndarray
        ω²/(λ² + ω²) = N2/β of Eq. 10.
    loss : ndarray
        (c + N1) ∮X'² dt + ∮(contact damping) X'² dt.
    """

    edge: object
    level: np.ndarray
    orbits: Orbits
    pivot: float
    frequency: np.ndarray
    spectrum: np.ndarray
    gain: np.ndarray
    loss: np.ndarray

    def derivative(self, values: np.ndarray) -> np.ndarray:
        """d/d(level)."""
        return CubicSpline(self.level, values).derivative()(self.level)

    def integral(self, rate: np.ndarray) -> np.ndarray:
        """∫ rate dH from the first level on, with dH = dJ/T.

        dJ/T is the energy from one orbit to the next; the constant of Eq. 15 and the saddle of
        each N2 do not enter, so that a thin layer of changing N2 adds no range of energy.
        """
        steps = rate * self.derivative(self.orbits.area) / self.orbits.period
        return CubicSpline(self.level, steps).antiderivative()(self.level)

    def exponent(self, parameters: SymmetricDevice) -> np.ndarray:
        """∫ B/(πS J) dH from the first level on."""
        return self.integral(self.loss / (parameters.intensity * self.spectrum * self.orbits.area))


def follow(
    edge: WellEdge | OuterEdge, parameters: SymmetricDevice, level: np.ndarray, nodes: int
) -> Stretch:
    """The edge at these levels.

    Raises
    ------
    AveragingError
        The fixed point of ω and N2 was not found.
    """
    p = parameters

    def mismatch(n2, level):
        frequency = 2.0 * np.pi / edge.period(level, n2, nodes)
        return n2 - p.coupling / (1.0 + (p.decay_rate / frequency) ** 2)

    n2 = np.zeros_like(level)
    if p.coupling > 0.0:
        bracket = n2, np.full_like(level, p.coupling)
        limits = {"xatol": 1e-15 * p.coupling, "fatol": 1e-13 * p.coupling, "xrtol": 0.0}
        found = find_root(mismatch, bracket, args=(level,), tolerances=limits)
        if not found.success.all():
            raise AveragingError(
                "N2 and ω of the orbits found no fixed point; change coupling or load"
            )
        n2 = found.x
    pivot = float(edge.potential.bottom(n2[:1])[0]) if edge.lobes == 2 else 0.0
    orbits = edge.orbits(level, n2, nodes, pivot)
    frequency = 2.0 * np.pi / orbits.period
    spectrum = 1.0 / (1.0 + (frequency * p.correlation_time) ** 2)
    gain = 1.0 / (1.0 + (p.decay_rate / frequency) ** 2)
    damping = p.damping + p.coupling * p.decay_rate * gain / frequency**2
    loss = damping * orbits.area + orbits.contact_work
    return Stretch(edge, level, orbits, pivot, frequency, spectrum, gain, loss)


def well_range(edge: WellEdge, parameters: SymmetricDevice, reach: float) -> tuple[float, float]:
    """First and last level of the wells, which end at the latest where they come to `reach`."""
    scan = follow(edge, parameters, _scan_levels(edge), SCAN_NODES)
    level, exponent = scan.level, scan.exponent(parameters)
    first = _crossing(level, exponent - exponent[0] - NEGLIGIBLE, level[0])
    fold = _first_fold(level, np.where(_middle(level) > first, _growth(scan), np.inf))
    last = min(fold, _crossing(level, scan.orbits.right - reach, level[-1]))
    return min(first, last - 1.0), last


def outer_range(edge: OuterEdge, parameters: SymmetricDevice) -> tuple[float, float]:
    """First and last level of the outer edge.

    Raises
    ------
    AveragingError
        Nothing holds the energy back.
    """
    scan = follow(edge, parameters, _scan_levels(edge), SCAN_NODES)
    first = -_first_fold(-scan.level[::-1], _growth(scan)[::-1])  # inwards from the regular end
    scan = follow(edge, parameters, scan.level[scan.level >= first], SCAN_NODES)
    level, exponent = scan.level, scan.exponent(parameters)
    if not edge.bistable:
        first = max(first, _crossing(level, exponent - NEGLIGIBLE, level[-1]))
    last = _crossing(level, exponent - OUTER_EXPONENT, np.inf)
    if not np.isfinite(last):
        raise AveragingError(
            f"damping={parameters.damping:g} with coupling={parameters.coupling:g} does not bound "
            "the energy; raise one of them or let the stoppers dissipate (restitution < 1)"
        )
    return first, last


def _scan_levels(edge):
    low, high = edge.widest
    return np.linspace(low, high, int(np.ceil((high - low) / SCAN_STEP)) + 1)


def _growth(scan):
    """Least increase of ½X'² at fixed X from one orbit to the next, at `level`'s midpoints.

    It is dE − dN2 · ½(X − X*)², monotone in |X − X*|, so three points tell.
    """
    orbits, anchor = scan.orbits, scan.edge.potential.anchor
    left, right = _middle(orbits.left), _middle(orbits.right)
    lever = [0.5 * (x - anchor) ** 2 for x in (left, right, np.clip(anchor, left, right))]
    gain, change = np.diff(orbits.energy), np.diff(orbits.added_stiffness)
    return np.min([gain - change * arm for arm in lever], axis=0) / gain.clip(min=1e-300)


def _first_fold(level, growth):
    """Level at which the growth first turns negative; the last level where it never does."""
    negative = np.flatnonzero(growth <= 0.0)
    if len(negative) == 0 or negative[0] == 0:
        return level[-1]
    pair = slice(negative[0] - 1, negative[0] + 1)
    return np.interp(0.0, growth[pair][::-1], _middle(level)[pair][::-1])


def _middle(level):
    return 0.5 * (level[1:] + level[:-1])


def _crossing(level, values, otherwise):
    """Level at which the values first rise through zero."""
    positive = np.flatnonzero(values > 0.0)
    if len(positive) == 0:
        return otherwise
    after = positive[0]
    if after == 0:
        return level[0]
    return np.interp(0.0, values[after - 1 : after + 1], level[after - 1 : after + 1])
