"""Conservative orbits of the source paper's device, and their integrals (Eqs. 10–17, 23, 24).

The device is symmetric, so that the quarter of the phase plane with X, X' ≥ 0 is enough, or all of
a well's upper half. There an orbit runs from its left end, a turning point inside a well or X = 0
outside, to its right turning point, and every integral is over that part alone. Arrays are over
orbits, or, where documented, over orbits × nodes of a quadrature.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize.elementwise import find_root

from harvester.base.errors import AveragingError
from harvester.device import contact as contacts
from harvester.device import spring as springs
from harvester.device import timescales
from harvester.device.dispatch import Values
from harvester.device.system import System, elastic_force, potential

# Replacement for a divisor of 0.
SMALLEST = 1e-150
# Spacing of the levels in the first scan of orbits, and nodes of an orbit on either side of the
# stopper.
SCAN_STEP, SCAN_NODES = 0.25, 24
# First and last level of this scan in a well.
WELL_LEVELS = -15.0, 11.5
# A well's orbits begin where ln g, with the density g, has fallen by this from the bottom.
NEGLIGIBLE = 1e-8
# Orbits of a well below this level have the frequency of its bottom.
SMALL_ORBIT = -5.0
# Range of the outer levels, ln of the energy in units of D over the loss rate.
OUTER_LEVELS = -20.0, 32.0
# The outer orbits end where ln g has fallen by this much.
OUTER_EXPONENT = 45.0


def stiffnesses(system: System) -> tuple[float, float]:
    """(−ω0², κ) of a symmetric spring of first and third power."""
    coefficients: Any = system.spring.odd_cubic
    return coefficients


@dataclass(frozen=True)
class Edge:
    """All orbits of one kind: inside the right well, or around both wells.

    A monostable device has orbits around X = 0 alone, treated like those around both wells. An
    orbit is labelled by its `level`: inside a well ln(r/(1 − r)), r the relative position of its
    left turning point from the bottom (0) to the well's end (1), and else ln(H − U(0)). Both are
    logarithmic where orbits change on every scale.

    Attributes
    ----------
    inside
        Whether the orbits lie inside the right well, which represents both symmetric wells.
    anchor : float
        X* of the potential U(X) = −½ω0² X² + ¼κ X⁴ + ½N2 (X − X*)² + contact (Eq. 15 with X* = 0).
        Methods take N2, the `added` stiffness of the piezo (Eq. 12), with the orbits.
    """

    system: System
    inside: bool = False
    anchor: float = 0.0

    def energy(self, x: Values, added: Values) -> Values:
        """The potential U(x)."""
        return potential(self.system, x) + 0.5 * added * (x - self.anchor) ** 2

    def rise(self, start: Values, end: Values, added: Values) -> Values:
        """U(end) − U(start), without cancellation in the terms of spring and piezo."""
        linear, cubic = stiffnesses(self.system)
        both = start + end
        spring = both * (0.5 * linear + 0.25 * cubic * (start * start + end * end))
        piezo = 0.5 * added * (both - 2.0 * self.anchor)
        before, after = (contacts.energy(self.system.contacts, x) for x in (start, end))
        return (end - start) * (spring + piezo) + after - before

    def slope(self, x: Values, added: Values) -> Values:
        """Slope of the potential, dU/dx."""
        return elastic_force(self.system, x) + added * (x - self.anchor)

    def bottom(self, added: np.ndarray) -> np.ndarray:
        """Position of the minimum at X ≥ 0."""
        rest_position = np.full_like(added, timescales.rest(self.system))
        if self.anchor == rest_position[0]:
            return rest_position
        laws = [(stop.law, stop.gap) for stop in self.system.contacts]

        def curvature(x):
            contact = sum(law.elastic_stiffness(np.maximum(x - gap, 0.0)) for law, gap in laws)
            return self.system.spring.slope(x) + added + contact

        return _root_of_convex(lambda x: self.slope(x, added), curvature, rest_position)

    def well_end(self, added: np.ndarray) -> np.ndarray:
        """Inner end of a well: its saddle or, without one, the point of weakest restoring force.

        Middle root of κx³ − (ω0² − N2) x − N2 X* = 0. If N2 X* is so large that there is no such
        root, the clipped formula gives the point of zero curvature. A distant stopper also ends the
        well.
        """
        linear, cubic = stiffnesses(self.system)
        softening, offset = -(linear + added), added * self.anchor
        end = -offset / softening
        if cubic > 0.0:
            third = np.sqrt(softening / (3.0 * cubic))
            angle = np.arccos(np.minimum(-1.5 * end / third, 1.0))
            end = 2.0 * third * np.cos((angle - 2.0 * np.pi) / 3.0)
        return np.maximum(end, timescales.free_zone(self.system)[0])

    def ends(self, level: np.ndarray, added: np.ndarray) -> tuple[np.ndarray, ...]:
        """(left end, ½X'² there, right end, distance over which the speed near the left end
        varies).
        """
        bottom, left, excess = self.bottom(added), np.zeros_like(level), np.zeros_like(level)
        if self.inside:
            depth = bottom - self.well_end(added)
            left, way = bottom - depth / (1.0 + np.exp(-level)), depth / (1.0 + np.exp(level))
        else:
            excess, linear = np.exp(level), stiffnesses(self.system)[0]
            way = np.sqrt(0.5 * excess / np.maximum(np.abs(linear + added), SMALLEST))

        def height(x):
            return self.rise(left, x, added) - excess

        step = np.maximum(bottom - left, 1e-9 * np.sqrt(excess))
        while np.any(short := height(bottom + step) < 0.0):
            step = np.where(short, 2.0 * step, step)
        right = _root_of_convex(height, lambda x: self.slope(x, added), bottom + step)
        return left, excess, right, way


class OrbitFamily:
    """Orbits of one edge at given levels, each in the potential with its own N2.

    Nodes are Gauss–Legendre nodes in an angle θ from 0 to π/2, on either side of the stopper.
    Before it x = left + 2d sinh²(s sin θ): smooth at turning points, and where a saddle at the
    distance d slows the mass. Beyond it x grows as sin² θ.

    `level`: levels, evenly spaced and ascending if they are integrated over; `added`: N2.

    Attributes
    ----------
    energy, left, right : H = ½X'² + U and the ends.
    x, speed : X and X' at the nodes (orbits × nodes).
    time
        ∫dt, half of the period T (Eq. 16) inside a well and a quarter outside.
    frequency, gain
        ω (Eq. 17, rad/s) and ω²/(λ² + ω²), which is N2/β of Eq. 12.
    """

    def __init__(self, edge: Edge, level: np.ndarray, added: np.ndarray, nodes: int) -> None:
        self.edge, self.level, self.added = edge, level, added
        self.left, self._excess, self.right, way = edge.ends(level, added)
        self.energy = self._excess + edge.energy(self.left, added)
        angle, weights = _quarter_turn(nodes)
        touch = np.clip(timescales.free_zone(edge.system)[1], self.left, self.right)
        span = np.arcsinh(np.sqrt(0.5 * (touch - self.left) / way))[:, None]
        turn, twice, beyond = (
            span * np.sin(angle),
            2.0 * way[:, None],
            (self.right - touch)[:, None],
        )
        before = self.left[:, None] + twice * np.sinh(turn) ** 2
        self.x = np.hstack([before, touch[:, None] + beyond * np.sin(angle) ** 2])
        before = twice * np.sinh(2.0 * turn) * span * np.cos(angle)
        self._weight = np.hstack([before * weights, beyond * np.sin(2.0 * angle) * weights])
        kinetic = self._excess[:, None] - edge.rise(self.left[:, None], self.x, added[:, None])
        self.speed = np.maximum(np.sqrt(2.0 * np.maximum(kinetic, 0.0)), SMALLEST)
        self.time = np.sum(self._weight / self.speed, axis=1)
        self.frequency = (1.0 if edge.inside else 0.5) * np.pi / self.time
        self.gain = 1.0 / (1.0 + (edge.system.transducer.decay_rate() / self.frequency) ** 2)

    def loop(self, values: Values) -> np.ndarray:
        """∫ values X' dX = ∫ values X'² dt of each orbit; values of 1 give the area J (Eq. 23)."""
        return np.sum(self._weight * self.speed * values, axis=1)

    @property
    def enclosed(self) -> dict[str, np.ndarray]:
        """∬ 1, X, X² and X'² dX dX' over the area within each orbit."""
        values = {"1": 1.0, "X": self.x, "X²": self.x**2, "X'²": self.speed**2 / 3.0}
        return {name: self.loop(integrand) for name, integrand in values.items()}

    @property
    def contact_work(self) -> np.ndarray:
        """∫(contact damping) X'² dt (Eq. 24); a held impact speed is the speed at the gap."""
        system, damping = self.edge.system, 0.0
        for stop in system.contacts:
            kinetic = self._excess - self.edge.rise(self.left, stop.gap, self.added)
            held = np.sqrt(2.0 * np.maximum(kinetic, 0.0))[:, None]
            gain = springs.energy(system.spring, self.x) - springs.energy(system.spring, stop.gap)
            depth = np.maximum(self.x - stop.gap, 0.0)
            damping = damping + stop.law.damping(depth, self.speed, gain, held)
        return self.loop(damping)

    @property
    def height(self) -> np.ndarray:
        """H above the minimum of U at X ≥ 0."""
        bottom = self.edge.bottom(self.added)
        return np.maximum(self.energy - self.edge.energy(bottom, self.added), 0.0)

    @property
    def spectrum(self) -> np.ndarray:
        """Relative spectrum of the noise, S(ω)/S(0) = 1/(1 + ω² τ1²) of Eq. 6."""
        return 1.0 / (1.0 + (self.frequency * self.edge.system.noise.correlation_time) ** 2)

    def exponent(self) -> np.ndarray:
        """∫ B/(πSJ) dH from the first level: loss B, spectrum S, area J (Eqs. 21, 22), dH = dJ/T.

        dJ/T is the energy from one orbit to the next; the constant of Eq. 15 and the saddle of
        each N2 do not enter, so that a thin layer of changing N2 adds no range of energy.
        """
        system = self.edge.system
        damping = system.damper.damping + system.transducer.loss_rate(self.frequency)
        loss = damping + self.contact_work / self.loop(1.0)
        rate = loss / (system.noise.intensity * self.spectrum)
        area = CubicSpline(self.level, self.loop(1.0)).derivative()(self.level)
        return CubicSpline(self.level, rate * area / self.time).antiderivative()(self.level)


def settled_orbits(edge: Edge, level: np.ndarray, nodes: int) -> OrbitFamily:
    """The orbits at these levels, each in the potential of N2 at its own frequency (Eq. 12).

    Raises AveragingError if the fixed point of ω and N2 is not found.
    """
    coupling, added = edge.system.transducer.coupling, np.zeros_like(level)
    if coupling > 0.0:
        limits = {"xatol": 1e-15 * coupling, "fatol": 1e-13 * coupling, "xrtol": 0.0}
        bracket = added, np.full_like(level, coupling)
        solution = find_root(
            lambda added, level: added - coupling * OrbitFamily(edge, level, added, nodes).gain,
            bracket, args=(level,), tolerances=limits,
        )  # fmt: skip
        if not solution.success.all():
            raise AveragingError(
                "the iteration for the orbits' frequency ω and added stiffness N2 did not "
                "converge; change coupling or load, or use the method fokker_planck"
            )
        added = solution.x
    return OrbitFamily(edge, level, added, nodes)


def edges(system: System, closure: str) -> list[tuple[Edge, float, float]]:
    """The edges of `paper` or `consistent`, the wells first, with their first and last levels.

    Near the separatrix ω → 0 takes N2 away and shifts the barrier, so that neighbouring orbits
    would cross each other there. An edge therefore extends from its regular end (the well's bottom,
    high energy) only as far as its orbits are nested.

    Raises AveragingError if the energy is not bounded.
    """
    outer = Edge(system)
    first, last = _outer_range(outer)
    if stiffnesses(system)[0] >= 0.0:
        return [(outer, first, last)]
    if closure == "consistent" and system.transducer.coupling > 0.0:
        wells, reach = Edge(system, inside=True, anchor=timescales.rest(system)), np.inf
    else:
        # All edges share one potential here, so that no orbit of a well extends beyond the first
        # outer orbit.
        wells = Edge(system, inside=True)
        reach = settled_orbits(outer, np.array([first]), SCAN_NODES).right[0]
    return [(wells, *_well_range(wells, reach)), (outer, first, last)]


def _well_range(edge, reach):
    """First and last level of the wells, whose orbits extend to `reach` at most."""
    scan = _scan(edge, *WELL_LEVELS)
    first = min([SMALL_ORBIT, *_zeros(scan.level, scan.exponent() - NEGLIGIBLE)])
    # Rounding alone may make smaller orbits appear to cross.
    crossings = [fold for fold in _folds(scan) if fold > first]
    return first, min([scan.level[-1], *crossings, *_zeros(scan.level, scan.right - reach)])


def _outer_range(edge):
    """First and last level of the outer edge."""
    s = edge.system
    coupling, decay_rate = s.transducer.coupling, s.transducer.decay_rate()
    rate = s.damper.damping + coupling / decay_rate or 1.0 / s.noise.correlation_time
    middle = np.log(s.noise.intensity / rate)
    scan = _scan(edge, *(middle + end for end in OUTER_LEVELS))
    exponent = scan.exponent()
    fold = max([scan.level[0], *_folds(scan)])
    followed = scan.level > fold
    level = np.append(fold, scan.level[followed])
    fall = np.append(0.0, exponent[followed] - np.interp(fold, scan.level, exponent))
    last = _zeros(level, fall - OUTER_EXPONENT)
    if last.size == 0:
        raise AveragingError(
            "damping and coupling do not bound the energy; raise one of them or let the stoppers "
            "dissipate (restitution < 1)"
        )
    return fold, last[0]


def _scan(edge: Edge, low: float, high: float) -> OrbitFamily:
    return settled_orbits(edge, np.arange(low, high + SCAN_STEP, SCAN_STEP), SCAN_NODES)


def _folds(scan):
    """Levels at which orbits begin or cease to cross the next one.

    Orbits cross if ½X'² at some X decreases from one orbit to the next. Its change is dE − dN2 ·
    ½(X − X*)², monotone in |X − X*|, so three points suffice.
    """
    anchor = scan.edge.anchor
    left, right = _middle(scan.left), _middle(scan.right)
    places = np.array([left, right, np.clip(anchor, left, right)])
    gain = np.diff(scan.energy)
    least = np.min(gain - np.diff(scan.added) * 0.5 * (places - anchor) ** 2, axis=0)
    return _zeros(_middle(scan.level), least / gain.clip(min=1e-300))


def _middle(values):
    return 0.5 * (values[1:] + values[:-1])


def _zeros(level, values):
    """Levels at which the values change sign, ascending."""
    before, after = values[:-1], values[1:]
    k = np.flatnonzero((before < 0.0) != (after < 0.0))
    return level[k] + np.diff(level)[k] * before[k] / (before[k] - after[k])


@cache
def _quarter_turn(nodes):
    """Gauss–Legendre nodes and weights on [0, π/2]."""
    points, weights = np.polynomial.legendre.leggauss(nodes)
    return 0.25 * np.pi * (points + 1.0), 0.25 * np.pi * weights


def _root_of_convex(function: Callable, derivative: Callable, x: np.ndarray) -> np.ndarray:
    """Root below x of a convex, rising function, by Newton's method."""
    converged = np.zeros(x.shape, dtype=bool)
    for _ in range(100):
        change = function(x) / derivative(x)
        # The iteration approaches from above the root, so that every change except rounding is
        # positive.
        converged |= change <= 1e-15 * np.abs(x)
        if converged.all():
            break
        x = np.where(converged, x, x - change)
    return x
