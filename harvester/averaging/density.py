"""Stationary densities of displacement and velocity (Eqs. 26 and 27)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.interpolate import CubicSpline

from harvester.averaging.symmetric import potential

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

STRIDE = 3  # levels from one boundary of the marginals' quadrature to the next
NODES = 6  # Gauss–Legendre nodes between boundaries
# Points of half a table: evenly spaced, and where orbits crowd.
EVEN, LANDMARKS = 100, 100
NEGLIGIBLE = 1e-6  # share of the peak beyond which a density is not tabulated
BATCH = 128  # points whose quadrature is held in memory together


class Branch:
    """Phase-space density g of one edge, constant along each of its orbits.

    Parameters
    ----------
    stretch : harvester.averaging.edges.Stretch
    logarithm : ndarray
        ln g at its levels.
    filled : bool
        What the innermost orbit encloses has that orbit's g; else it is left out.
    floor : float
        Taken off g: the density of a filled edge that these orbits lie in.
    """

    def __init__(self, stretch, logarithm, filled, floor=0.0):
        self.edge = stretch.edge
        self.filled, self.floor = filled, floor
        self.orbits = stretch.orbits
        columns = np.stack([stretch.orbits.energy, stretch.orbits.added_stiffness, logarithm])
        # Cubics of each interval in its own t in [0, 1], highest power first.
        width = stretch.level[1] - stretch.level[0]
        cubics = CubicSpline(stretch.level, columns, axis=1).c
        cubics = cubics * (width ** np.arange(3, -1, -1))[:, None, None]
        self._energy, self._stiffness, self._logarithm = np.moveaxis(cubics, 2, 0)
        last = len(stretch.level) - 1
        orbits_at = np.unique(np.append(np.arange(0, last, STRIDE), last))
        self._boundary_orbits = stretch.orbits.take(orbits_at)

    def joint(self, x: ArrayLike, v: ArrayLike) -> np.ndarray:
        """g at (x, v), x on the edge's own side; 0 where the edge has no orbit."""
        x, v = np.broadcast_arrays(x, v)
        orbits, u = self.orbits, self.edge.potential
        arm = 0.5 * (x - u.anchor) ** 2
        bare = potential(u.parameters, x) + 0.5 * v * v

        def excess(k):
            return orbits.energy[k] - orbits.added_stiffness[k] * arm - bare

        last = len(orbits.energy) - 1
        low, high = np.zeros(x.shape, dtype=np.intp), np.full(x.shape, last)
        for _ in range(last.bit_length()):
            middle = (low + high) // 2
            below = excess(middle) < 0.0
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        low = np.minimum(low, last - 1)
        cubic = self._energy[:, low] - self._stiffness[:, low] * arm
        cubic[3] -= bare
        density = np.exp(_value(self._logarithm[:, low], _unit_root(cubic)))
        inside = (excess(last) >= 0.0) & (x >= orbits.left[-1])
        if not self.filled:
            inside &= excess(0) <= 0.0
        return np.where(inside, density - self.floor, 0.0)

    def over_velocity(self, x: np.ndarray) -> np.ndarray:
        """∫ g dX' at each x of a one-dimensional array."""
        orbits, u = self._boundary_orbits, self.edge.potential
        arm = 0.5 * (x - u.anchor)[:, None] ** 2
        kinetic = orbits.energy - orbits.added_stiffness * arm - potential(u.parameters, x)[:, None]
        speeds = np.sqrt(2.0 * np.maximum(kinetic, 0.0))
        if self.filled:
            speeds = np.insert(speeds, 0, 0.0, axis=1)
        return 2.0 * _quadrature(lambda v: self.joint(x[:, None, None], v), speeds)

    def over_displacement(self, v: np.ndarray) -> np.ndarray:
        """∫ g dX over the edge's own side at each v of a one-dimensional array."""
        orbits = self._boundary_orbits
        height = orbits.energy - 0.5 * v[:, None] ** 2
        left = self._cross(height, orbits.left)
        right = self._cross(height, orbits.right)

        def density(x):
            return self.joint(x, v[:, None, None])

        total = _quadrature(density, right) - _quadrature(density, left)
        if self.filled:
            innermost = np.stack([left[:, 0], right[:, 0]], axis=1)
            total += _quadrature(density, innermost)
        return total

    def _cross(self, height, turning):
        """Where U comes to `height` between bottom and turning point, by bisection.

        Above `height` at the bottom: the bottom; below it at the turning point: that point.
        """
        orbits, u = self._boundary_orbits, self.edge.potential
        inner = np.broadcast_to(orbits.bottom, height.shape)
        outer = np.broadcast_to(turning, height.shape)
        for _ in range(50):
            middle = 0.5 * (inner + outer)
            below = u.energy(middle, orbits.added_stiffness) < height
            inner, outer = np.where(below, middle, inner), np.where(below, outer, middle)
        return inner


@dataclass(frozen=True)
class Density:
    """Stationary probability densities; methods are vectorised.

    `energy` maps each edge ("wells", both together, and "outer"; "outer" alone when monostable)
    to arrays H, the energy of its orbits above its potential's minimum at X ≥ 0, and p(H).
    """

    branches: tuple
    norm: float
    energy: dict

    names = ("displacement", "velocity")

    def joint(self, x: ArrayLike, v: ArrayLike) -> np.ndarray:
        """p(X, X') (Eq. 26): the sum of left well, right well and outer orbits.

        Parameters
        ----------
        x, v : array_like
            Scaled displacement and velocity, of shapes that broadcast.
        """
        x, v = np.asarray(x, dtype=float), np.asarray(v, dtype=float)
        total: Any = 0.0
        for branch in self.branches:
            if branch.edge.lobes == 2:
                total = total + branch.joint(x, v) + branch.joint(-x, v)
            else:
                total = total + branch.joint(np.abs(x), v)
        return total / self.norm

    def displacement(self, x: ArrayLike) -> np.ndarray:
        """p(X), the integral of `joint` over velocity (Eq. 27)."""
        return self._marginal(x, self._displacement)

    def velocity(self, v: ArrayLike) -> np.ndarray:
        """p(X'), the integral of `joint` over displacement (Eq. 27)."""
        return self._marginal(v, self._velocity)

    def tabulated(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Places as far out as a density matters, finer where orbits crowd, and it there."""
        density, landmarks = getattr(self, name), self._landmarks(name)
        rough = landmarks[np.linspace(0, landmarks.size - 1, LANDMARKS).astype(int)]
        values = density(rough)
        matters = np.flatnonzero(values > NEGLIGIBLE * values.max())
        # One point further to either side, where it no longer matters.
        first, last = rough[max(matters[0] - 1, 0)], rough[min(matters[-1] + 1, LANDMARKS - 1)]
        landmarks = landmarks[(landmarks >= first) & (landmarks <= last)]
        landmarks = landmarks[np.linspace(0, landmarks.size - 1, LANDMARKS).astype(int)]
        half = np.unique(np.concatenate([np.linspace(first, last, EVEN), landmarks]))
        values = density(half)
        mirrored = slice(None, 0 if half[0] == 0.0 else None, -1)
        return np.append(-half[mirrored], half), np.append(values[mirrored], values)

    def _landmarks(self, name):
        """Where orbits turn, or their greatest speeds: none is missed between them, how narrow
        its well may be."""
        points = []
        for branch in self.branches:
            o = branch.orbits
            if name == "displacement":
                points += [o.left, o.right]
            else:
                bottom = branch.edge.potential.energy(o.bottom, o.added_stiffness)
                points.append(np.sqrt(2.0 * np.maximum(o.energy - bottom, 0.0)))
        return np.unique(np.abs(np.concatenate(points)))

    def _marginal(self, values, function):
        values = np.asarray(values, dtype=float)
        flat = values.ravel()
        parts = [function(flat[k : k + BATCH]) for k in range(0, flat.size, BATCH)]
        return np.concatenate(parts or [flat]).reshape(values.shape) / self.norm

    def _displacement(self, x):
        total = np.zeros_like(x)
        for branch in self.branches:
            if branch.edge.lobes == 2:
                total += branch.over_velocity(x) + branch.over_velocity(-x)
            else:
                total += branch.over_velocity(np.abs(x))
        return total

    def _velocity(self, v):
        return sum(2.0 * branch.over_displacement(v) for branch in self.branches)


def _quadrature(function, boundaries):
    """∫ over each row's boundaries of a function of an array (rows, pieces, nodes)."""
    points, weights = np.polynomial.legendre.leggauss(NODES)
    low, width = boundaries[:, :-1, None], np.diff(boundaries, axis=1)[:, :, None]
    values = function(low + width * 0.5 * (points + 1.0))
    return 0.5 * np.sum(values * weights * width, axis=(1, 2))


def _value(cubic, t):
    return ((cubic[0] * t + cubic[1]) * t + cubic[2]) * t + cubic[3]


def _unit_root(cubic):
    """Root in [0, 1] of a rising cubic; the nearer end where there is none."""
    t = np.clip(-cubic[3] / np.where(cubic[2] > 0.0, cubic[2], 1.0), 0.0, 1.0)
    for _ in range(5):
        slope = (3.0 * cubic[0] * t + 2.0 * cubic[1]) * t + cubic[2]
        t = np.clip(t - _value(cubic, t) / np.where(slope > 0.0, slope, 1.0), 0.0, 1.0)
    return t
