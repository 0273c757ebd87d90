"""Stationary densities of the averaging methods (Eqs. 26 and 27)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from harvester.averaging.orbits import OrbitFamily

# Number of parts into which interpolation divides the interval between two computed orbits.
FINER = 10
# Number of points in one half of a density table: evenly spaced ones, and ones at turning points of
# orbits.
EVEN, TURNING = 100, 100
# Number of even intervals for the integral of a density of X', added to intervals between orbits.
PIECES = 1500
# Orbits whose probability density g is below this share of the greatest are not tabulated.
NEGLIGIBLE = np.log(1e-9)


class Layer:
    """A quantity that is constant on each orbit of an `Edge`, as a function of X and X'.

    Parameters
    ----------
    logarithm
        Logarithm of the value on each orbit.
    filled : bool
        Whether the area inside the innermost orbit has that orbit's value; else 0.
    floor
        Amount that is subtracted from the value.
    """

    def __init__(
        self, orbits: OrbitFamily, logarithm: np.ndarray, filled: bool = True, floor: float = 0.0
    ) -> None:
        self.orbits, self.logarithm, self._floor = orbits, logarithm, floor
        self._within = logarithm[0] if filled else -np.inf
        columns = np.stack([orbits.energy, orbits.added, logarithm])
        level = np.linspace(orbits.level[0], orbits.level[-1], FINER * (orbits.level.size - 1) + 1)
        self._energy, self._added, self._fine = CubicSpline(orbits.level, columns, axis=1)(level)

    def _kinetic(self, x):
        """½X'² of every orbit at one x, ascending; negative for orbits that do not reach x."""
        if x < self.orbits.left[-1]:
            return np.full_like(self._energy, -1.0)
        return self._energy - self.orbits.edge.energy(x, self._added)

    def _values(self, kinetic, square):
        """Values at ½X'² = `square`, interpolated between orbits with ½X'² = `kinetic`."""
        values = np.exp(np.interp(square, kinetic, self._fine, left=self._within)) - self._floor
        return np.where(square <= kinetic[-1], values, 0.0)

    def at(self, x: ArrayLike, v: ArrayLike) -> np.ndarray:
        """Value at (x, v), arrays that broadcast, with x on the side of the edge's orbits."""
        x, v = np.broadcast_arrays(x, v)
        values, order = np.zeros(x.shape), np.argsort(x, axis=None)
        for same in np.split(order, 1 + np.flatnonzero(np.diff(x.flat[order]))):
            if same.size:
                kinetic = self._kinetic(x.flat[same[0]])
                values.flat[same] = self._values(kinetic, 0.5 * v.flat[same] ** 2)
        return values

    def over_velocity(self, x: np.ndarray) -> np.ndarray:
        """Integral over all velocities at each x."""
        totals = np.zeros(x.shape)
        for k, displacement in np.ndenumerate(x):
            kinetic = self._kinetic(displacement)
            speeds = np.append(0.0, np.sqrt(2.0 * np.maximum(kinetic, 0.0)))
            v, weights = _quadrature(speeds)
            totals[k] = 2.0 * weights @ self._values(kinetic, 0.5 * v * v)
        return totals

    def over_displacement(self, v: np.ndarray) -> np.ndarray:
        """Integral over the side of the edge's orbits at each v of a one-dimensional array."""
        left, right = self.orbits.left, self.orbits.right
        even = np.linspace(left[-1], right[-1], PIECES + 1)
        x, weights = _quadrature(np.unique(np.concatenate([left[::4], right[::4], even])))
        return weights @ self.at(x[:, None], v)


def _quadrature(ends):
    """Two Gauss–Legendre nodes on every interval between ascending ends, and their weights."""
    half, middle = 0.5 * np.diff(ends), 0.5 * (ends[1:] + ends[:-1])
    return np.append(middle - half / np.sqrt(3.0), middle + half / np.sqrt(3.0)), np.tile(half, 2)


@dataclass(frozen=True)
class OrbitDensity:
    """Stationary probability densities, each a sum over layers; methods are vectorised."""

    layers: tuple[Layer, ...]

    names = ("displacement", "velocity")

    def joint(self, x: ArrayLike, v: ArrayLike) -> np.ndarray:
        """p(X, X') (Eq. 26): the sum of left well, right well and outer orbits.

        `x`, `v`: scaled displacement and velocity, of shapes that broadcast.
        """
        return self._both_sides(np.asarray(x, dtype=float), lambda layer, x: layer.at(x, v))

    def displacement(self, x: ArrayLike) -> np.ndarray:
        """p(X), the integral of `joint` over velocity (Eq. 27)."""
        return self._both_sides(np.asarray(x, dtype=float), lambda layer, x: layer.over_velocity(x))

    def velocity(self, v: ArrayLike) -> np.ndarray:
        """p(X'), the integral of `joint` over displacement (Eq. 27)."""
        v = np.asarray(v, dtype=float)
        total = sum(2.0 * layer.over_displacement(v.ravel()) for layer in self.layers)
        return np.reshape(total, v.shape)

    def _both_sides(self, x, function):
        """Sum over the layers; orbits in the right well also represent the symmetric left one."""
        sides = {True: (x, -x), False: (np.abs(x),)}
        return sum(
            function(layer, side)
            for layer in self.layers
            for side in sides[layer.orbits.edge.inside]
        )

    def tabulated(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Table of a density (points, values), finer where orbits are dense."""
        turning = self._turning(name)
        crowded = turning[np.linspace(0, turning.size - 1, TURNING).astype(int)]
        half = np.unique(np.append(crowded, np.linspace(turning[0], turning[-1], EVEN)))
        values = getattr(self, name)(half)
        mirrored = slice(None, 0 if half[0] == 0.0 else None, -1)
        return np.append(-half[mirrored], half), np.append(values[mirrored], values)

    def _turning(self, name):
        """Turning points (or greatest speeds) of the orbits: the table then misses no well."""
        least = NEGLIGIBLE + max(layer.logarithm.max() for layer in self.layers)
        points = [[] if name == "displacement" else [0.0]]
        for layer in self.layers:
            o, matters = layer.orbits, layer.logarithm > least
            if name == "displacement":
                points += [o.left[matters], o.right[matters]]
            else:
                points.append(np.sqrt(2.0 * o.height[matters]))
        return np.unique(np.abs(np.concatenate(points)))
