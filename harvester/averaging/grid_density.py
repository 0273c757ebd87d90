"""Stationary densities of the closure `fokker_planck`, between the nodes of its grid."""

import numpy as np
from scipy.interpolate import CubicSpline, RectBivariateSpline


class GridDensity:
    """Stationary probability densities; methods are vectorised.

    Parameters
    ----------
    x, v : ndarray
        Evenly spaced displacements and velocities.
    joint : ndarray
        Density at (x, v).
    paired : bool
        The nodes hold one well alone, of two alike.
    """

    names = ("displacement", "velocity")

    def __init__(self, x, v, joint, paired):
        joint = np.maximum(joint, 0.0)
        joint /= joint.sum() * (x[1] - x[0]) * (v[1] - v[0])
        self._x, self._v, self._paired = x, v, paired
        self._joint = RectBivariateSpline(x, v, joint)
        self._displacement = CubicSpline(x, joint.sum(axis=1) * (v[1] - v[0]))
        self._velocity = CubicSpline(v, joint.sum(axis=0) * (x[1] - x[0]))

    def joint(self, x, v):
        """p(X, X').

        Parameters
        ----------
        x, v : array_like
            Scaled displacement and velocity, of shapes that broadcast.
        """
        x, v = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(v, dtype=float))
        inside = np.abs(v) <= self._v[-1]
        return self._both(lambda side, sign: self._joint.ev(side, sign * v) * inside, x)

    def displacement(self, x):
        """p(X), the integral of `joint` over velocity."""
        return self._both(lambda side, _: self._displacement(side), np.asarray(x, dtype=float))

    def velocity(self, v):
        """p(X'), the integral of `joint` over displacement."""
        v = np.asarray(v, dtype=float)
        inside = np.abs(v) <= self._v[-1]
        values = self._velocity(v)
        if self._paired:
            values = 0.5 * (values + self._velocity(-v))
        return np.where(inside, np.maximum(values, 0.0), 0.0)

    def landmarks(self, name):
        """Where the density is known, at or above 0."""
        return np.unique(np.abs(self._x if name == "displacement" else self._v))

    def _both(self, function, x):
        """A function of X and the sign of X', over the well at X and, of two, that at −X."""

        def within(side, sign):
            inside = (side >= self._x[0]) & (side <= self._x[-1])
            return np.where(inside, np.maximum(function(side, sign), 0.0), 0.0)

        if not self._paired:
            return within(x, 1.0)
        return 0.5 * (within(x, 1.0) + within(-x, -1.0))
