"""Conservative orbits of one well or around both, and their integrals over a closed orbit.

Everything is an array over levels: one entry is one orbit in the potential of its own N2. The
right well stands for both wells, and of the symmetric outer orbits the quarter X, X' ≥ 0 is
followed; integrals are those of the whole closed orbit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cache
from typing import Any

import numpy as np

from harvester.averaging.symmetric import (
    SymmetricDevice,
    contact_damping,
    potential,
    restoring_force,
)
from harvester.device.values import Values

SMALLEST_SPEED = 1e-150  # a speed to divide by on pieces of no length


@dataclass(frozen=True)
class Potential:
    """U(X) = −½ω0² X² + ¼κ X⁴ + ½N2 (X − X*)² + contact (Eq. 15), at X ≥ −δ.

    N2, the `added_stiffness` of the piezo (Eq. 12), is an argument of the methods because it
    belongs to the orbit. With `anchor` X* = 0 this is Eq. 15 but for its constant; an array gives
    each orbit its own.
    """

    parameters: SymmetricDevice
    anchor: float = 0.0

    def energy(self, x: Values, added_stiffness: Values) -> Values:
        """U(x)."""
        return potential(self.parameters, x) + 0.5 * added_stiffness * (x - self._at(x)) ** 2

    def _at(self, x):
        """The anchor, for orbits' nodes as a column."""
        return self.anchor[:, None] if np.ndim(x) > np.ndim(self.anchor) > 0 else self.anchor

    def slope(self, x: Values, added_stiffness: Values) -> Values:
        """dU/dx."""
        return restoring_force(self.parameters, x) + added_stiffness * (x - self._at(x))

    def curvature(self, x: Values, added_stiffness: Values) -> Values:
        """d²U/dx² at x ≥ 0."""
        p = self.parameters
        spring = p.linear_stiffness + added_stiffness + 3.0 * p.cubic_stiffness * x * x
        if not p.has_stoppers:
            return spring
        return spring + 1.5 * p.contact_stiffness * np.sqrt(np.maximum(x - p.gap, 0.0))

    def rise(self, x: Values, step: Values, added_stiffness: Values) -> Values:
        """U(x + step) − U(x) without cancellation."""
        p = self.parameters
        linear, cubic = p.linear_stiffness + added_stiffness, p.cubic_stiffness
        first = (linear + cubic * x * x) * x - added_stiffness * self._at(x)
        second = 0.5 * (linear + 3.0 * cubic * x * x)
        spring = step * (first + step * (second + step * cubic * (x + 0.25 * step)))
        for side in (1.0, -1.0):
            ahead, way = side * x, side * step
            if p.has_stoppers and (np.any(ahead > p.gap) or np.any(ahead + way > p.gap)):
                spring = spring + self._contact_rise(ahead, way)
        return spring

    def _contact_rise(self, x, step):
        gap = self.parameters.gap
        before, after = np.maximum(x - gap, 0.0), np.maximum(x + step - gap, 0.0)
        change = np.where((before > 0.0) & (after > 0.0), step, after - before)
        a, b = np.sqrt(before), np.sqrt(after)  # b⁵ − a⁵ = (b² − a²) (…)/(a + b)
        powers = before**2 + after**2 + a * b * (before + a * b + after)
        return 0.4 * self.parameters.contact_stiffness * change * powers / (a + b + SMALLEST_SPEED)

    def bottom(self, added_stiffness: np.ndarray) -> np.ndarray:
        """Position of the minimum at X ≥ 0."""
        p = self.parameters
        if self.anchor > 0.0 or p.linear_stiffness >= 0.0:
            return np.full_like(added_stiffness, self.anchor)
        if p.cubic_stiffness > 0.0:
            free = np.sqrt(-(p.linear_stiffness + added_stiffness) / p.cubic_stiffness)
        else:
            free = np.full_like(added_stiffness, np.inf)
        if not p.has_stoppers or np.all(free <= p.gap):
            return free
        start = np.full_like(added_stiffness, p.gap)
        pressed = root_beyond(self.slope, self.curvature, start, 0.1 * start, added_stiffness)
        return np.where(free <= p.gap, free, pressed)

    def well_end(self, added_stiffness: np.ndarray) -> np.ndarray:
        """Where the well gives way: its saddle; without one, where the pull back is weakest.

        Middle root of κx³ − (ω0² − N2) x − N2 X* = 0. For N2 X* so large that it has gone, the
        clipped formula gives the point of zero curvature. A far stopper ends the well as well.
        """
        p = self.parameters
        softening = -(p.linear_stiffness + added_stiffness)
        offset = added_stiffness * self.anchor
        if p.cubic_stiffness > 0.0:
            third = np.sqrt(softening / (3.0 * p.cubic_stiffness))
            ratio = 1.5 * offset / (softening * third)
            end = 2.0 * third * np.cos((np.arccos(np.minimum(ratio, 1.0)) - 2.0 * np.pi) / 3.0)
        else:
            end = -offset / softening
        return np.maximum(end, -p.gap)


@dataclass(frozen=True)
class Orbits:
    """Orbits of one edge and their closed-orbit integrals, arrays over levels.

    Attributes
    ----------
    added_stiffness, energy, left, right, bottom : ndarray
        N2, ½X'² + U, turning points (`left` is 0 for outer orbits), minimum of U.
    period, area : ndarray
        T (Eq. 16) and J = ∮X'² dt, the enclosed area of the phase plane (Eq. 23).
    contact_work : ndarray
        ∮(contact damping) X'² dt (Eq. 24).
    first_moment, second_moment, speed_moment : ndarray
        Integrals over the enclosed area of X − pivot, (X − pivot)² and X'².
    """

    added_stiffness: np.ndarray
    energy: np.ndarray
    left: np.ndarray
    right: np.ndarray
    bottom: np.ndarray
    period: np.ndarray
    area: np.ndarray
    contact_work: np.ndarray
    first_moment: np.ndarray
    second_moment: np.ndarray
    speed_moment: np.ndarray

    def take(self, selection: slice | np.ndarray) -> Orbits:
        """The same for some of the levels (slice or index array)."""
        return Orbits(*(getattr(self, field.name)[selection] for field in fields(self)))


class WellEdge:
    """Orbits inside the right well.

    The level coordinate is ln(r/(1 − r)), r the inner turning point's way from the bottom (0)
    to the well's end (1): logarithmic at both ends, where the orbits change on every scale.
    """

    lobes = 2  # left and right well
    widest = (-15.0, 11.5)

    def __init__(self, potential):
        self.potential = potential

    def path(self, level: np.ndarray, added_stiffness: np.ndarray, nodes: int) -> Path:
        """Nodes along the orbits, as `Path`."""
        u, n2 = self.potential, added_stiffness
        bottom, end = u.bottom(n2), u.well_end(n2)
        left = bottom - (bottom - end) / (1.0 + np.exp(-level))
        distance = (bottom - end) / (1.0 + np.exp(level))
        zero = np.zeros_like(level)
        right = turning_point(u, left, zero, bottom, bottom - left, n2)
        return path_between(u, n2, left, zero, distance, bottom, right, nodes)

    def period(self, level: np.ndarray, added_stiffness: np.ndarray, nodes: int) -> np.ndarray:
        """T of the closed orbits (Eq. 16)."""
        return self.path(level, added_stiffness, nodes).half_period * 2.0

    def orbits(
        self, level: np.ndarray, added_stiffness: np.ndarray, nodes: int, pivot: float
    ) -> Orbits:
        """`Orbits` at these levels and N2, moments about `pivot`."""
        path = self.path(level, added_stiffness, nodes)
        energy = self.potential.energy(path.left, added_stiffness)
        bottom = self.potential.bottom(added_stiffness)
        return _integrals(self.potential, path, added_stiffness, energy, bottom, pivot)


class OuterEdge:
    """Orbits around both wells, or all orbits of a monostable device.

    The level coordinate is ln(E − U(0)).
    """

    lobes = 1

    def __init__(self, potential, energy_scale):
        self.potential = potential
        self.bistable = potential.parameters.linear_stiffness < 0.0
        self.widest = (np.log(energy_scale) - 32.0, np.log(energy_scale) + 32.0)

    def path(self, level: np.ndarray, added_stiffness: np.ndarray, nodes: int) -> Path:
        """Nodes along a quarter of the orbits, as `Path`."""
        u, n2 = self.potential, added_stiffness
        excess, zero = np.exp(level), np.zeros_like(level)
        bottom = u.bottom(n2)
        first_step = bottom if self.bistable else 1e-9 * np.sqrt(excess)
        right = turning_point(u, zero, excess, bottom, first_step, n2)
        distance = 1e3 * right
        if self.bistable:
            distance = 0.5 * np.sqrt(-2.0 * excess / (u.parameters.linear_stiffness + n2))
        return path_between(u, n2, zero, excess, distance, 0.5 * right, right, nodes)

    def period(self, level: np.ndarray, added_stiffness: np.ndarray, nodes: int) -> np.ndarray:
        """T of the closed orbits (Eq. 16)."""
        return self.path(level, added_stiffness, nodes).half_period * 4.0

    def orbits(
        self, level: np.ndarray, added_stiffness: np.ndarray, nodes: int, pivot: float
    ) -> Orbits:
        """`Orbits` at these levels and N2; the first moment is not that of the whole orbit."""
        path = self.path(level, added_stiffness, nodes)
        energy = np.exp(level) + self.potential.energy(0.0, added_stiffness)
        bottom = self.potential.bottom(added_stiffness)
        half = _integrals(self.potential, path, added_stiffness, energy, bottom, pivot)
        doubled = {
            name: 2.0 * getattr(half, name)
            for name in ("period", "area", "contact_work", "second_moment", "speed_moment")
        }
        moments = {"first_moment": np.zeros_like(energy)}
        return Orbits(**{**vars(half), **doubled, **moments})


@dataclass(frozen=True)
class Path:
    """x, speed and weight dx at the nodes (levels × nodes) from `left` to `right`."""

    x: np.ndarray
    speed: np.ndarray
    weight: np.ndarray
    left: np.ndarray
    right: np.ndarray

    @property
    def half_period(self) -> np.ndarray:
        """Time from left to right."""
        return np.sum(self.weight / self.speed, axis=1)


@cache
def unit_nodes(nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss–Legendre nodes and weights on [0, 1]."""
    points, weights = np.polynomial.legendre.leggauss(nodes)
    return 0.5 * (points + 1.0), 0.5 * weights


def path_between(
    u: Potential,
    added_stiffness: np.ndarray,
    left: np.ndarray,
    excess: np.ndarray,
    distance: np.ndarray,
    middle: np.ndarray,
    right: np.ndarray,
    nodes: int,
) -> Path:
    """Nodes between left and right, split at the gap and at `middle`.

    Speeds left of the middle are measured from the energy U(left) + `excess`, those right of it
    from U(right), so that they keep their digits at both ends. `distance` is the scale on which
    the speed varies near the left end; the map x = left + 2 · distance · sinh² makes a near saddle
    as smooth as the sin² on the other pieces makes turning points and the contact's start.
    """
    gap = u.parameters.gap
    split = np.where((left < gap) & (gap < middle), gap, middle)
    touch = np.clip(gap, middle, right)
    points, weights = unit_nodes(nodes)

    reach = np.arcsinh(np.sqrt(0.5 * (split - left) / distance))
    turn = reach[:, None] * points
    from_left: Any = [2.0 * distance[:, None] * np.sinh(turn) ** 2]
    weight = [2.0 * (distance * reach)[:, None] * np.sinh(2.0 * turn) * weights]

    sine, sine_weight = np.sin(0.5 * np.pi * points) ** 2, np.sin(np.pi * points) * weights
    lengths = [(part * 1.0)[:, None] for part in (middle - split, touch - middle, right - touch)]
    weight += [0.5 * np.pi * length * sine_weight for length in lengths]
    from_left += [(split - left)[:, None] + lengths[0] * sine]
    from_left = np.concatenate(from_left, axis=1)
    # Measured back from the right end; 1 − sin² = cos².
    cosine = 1.0 - sine
    from_right = np.concatenate([lengths[2] + lengths[1] * cosine, lengths[2] * cosine], axis=1)

    n2 = added_stiffness[:, None]
    kinetic = np.concatenate(
        [
            excess[:, None] - u.rise(left[:, None], from_left, n2),
            -u.rise(right[:, None], -from_right, n2),
        ],
        axis=1,
    )
    x = np.concatenate([left[:, None] + from_left, right[:, None] - from_right], axis=1)
    speed = np.maximum(np.sqrt(2.0 * np.maximum(kinetic, 0.0)), SMALLEST_SPEED)
    return Path(x, speed, np.concatenate(weight, axis=1), left, right)


def _integrals(u, path, added_stiffness, energy, bottom, pivot):
    """`Orbits` for a path that is half of the closed orbit."""
    element = 2.0 * path.weight * path.speed  # of the area: X' dX, upper and lower half
    offset = path.x - pivot
    return Orbits(
        added_stiffness=added_stiffness,
        energy=energy,
        left=path.left,
        right=path.right,
        bottom=bottom,
        period=2.0 * path.half_period,
        area=np.sum(element, axis=1),
        contact_work=np.sum(element * contact_damping_on(u, path, added_stiffness), axis=1),
        first_moment=np.sum(element * offset, axis=1),
        second_moment=np.sum(element * offset**2, axis=1),
        speed_moment=np.sum(element * path.speed**2, axis=1) / 3.0,
    )


def contact_damping_on(u: Potential, path: Path, added_stiffness: np.ndarray) -> np.ndarray:
    """Contact damping at the nodes; in `event` mode v0 is the orbit's speed at the gap."""
    p = u.parameters
    if not p.has_stoppers or p.damping_factor == 0.0:
        return np.zeros_like(path.x)
    right, left = (
        np.sqrt(2.0 * np.maximum(-u.rise(path.right, at - path.right, added_stiffness), 0.0))
        for at in (p.gap, -p.gap)
    )
    held = np.where(path.x > 0.0, right[:, None], left[:, None])
    return contact_damping(p, path.x, path.speed, held)


def turning_point(
    u: Potential,
    left: np.ndarray,
    excess: np.ndarray,
    start: np.ndarray,
    step: Values,
    added_stiffness: np.ndarray,
) -> np.ndarray:
    """Where U comes to U(left) + excess right of `start`, beyond which U is convex."""

    def height(x, n2):
        return u.rise(left, x - left, n2) - excess

    return root_beyond(height, u.slope, start, step, added_stiffness)


def root_beyond(
    function: Callable,
    derivative: Callable,
    start: np.ndarray,
    step: Values,
    added_stiffness: np.ndarray,
) -> np.ndarray:
    """Root right of `start` of a function convex there: Newton's method from beyond it."""
    x = start + step
    while np.any(short := function(x, added_stiffness) < 0.0):
        step = np.where(short, 2.0 * step, step)
        x = np.where(short, start + step, x)
    for _ in range(100):
        change = function(x, added_stiffness) / derivative(x, added_stiffness)
        x = x - change
        if np.all(np.abs(change) <= 1e-15 * np.abs(x)):
            break
    return x
