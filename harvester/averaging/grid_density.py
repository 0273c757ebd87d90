"""Stationary densities of the method `fokker_planck`, between the nodes of its grid."""

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline, RectBivariateSpline
from scipy.ndimage import convolve1d

from harvester.averaging.flow import PhaseGrid
from harvester.averaging.propagator import whole
from harvester.averaging.voltage_density import SMOOTHING, density_of_charge

# Points per axis of the tabulated joint density of displacement and velocity.
JOINT_POINTS = 321


class GridDensity:
    """Stationary probability densities; methods are vectorised.

    Parameters
    ----------
    transducer
        The transducer's equations.
    state
        Mass at each node.
    paired
        Whether the nodes cover one of two symmetric wells.

    Attributes
    ----------
    x, v
        Evenly spaced displacements and velocities.
    values
        Density at (x, v).
    """

    names = ("displacement", "velocity", "voltage")

    def __init__(self, transducer: Any, grid: PhaseGrid, state: np.ndarray, paired: bool) -> None:
        self.x, self.v, self.paired = grid.x, grid.v, paired
        self._transducer, self._grid = transducer, grid
        mass = whole(state, grid)[:, :, 0]
        self._mass = mass / mass.sum()
        step_x, step_v = self.x[1] - self.x[0], self.v[1] - self.v[0]
        self.values = self._mass.sum(axis=1) / (step_x * step_v)
        self._joint = RectBivariateSpline(self.x, self.v, self.values)
        self._displacement = CubicSpline(self.x, self.values.sum(axis=1) * step_v)
        self._velocity = CubicSpline(self.v, self.values.sum(axis=0) * step_x)

    @cached_property
    def _voltage(self):
        """Density of the voltage, computed on demand: it takes as long as all other densities."""
        if len(self._grid.z) == 1:
            voltage = self._transducer.voltage(self.v, 0.0)
            return CubicSpline(voltage, self._velocity(self.v) * self.v[-1] / voltage[-1])
        charge, density = density_of_charge(self._grid, self._mass)
        share = self._transducer.voltage(0.0, 1.0)
        return CubicSpline(share * charge, density / share)

    def joint(self, x: ArrayLike, v: ArrayLike) -> np.ndarray:
        """p(X, X').

        `x`, `v`: scaled displacement and velocity, of shapes that broadcast.
        """
        return self._either_side(self._joint.ev, x, v)

    def displacement(self, x: ArrayLike) -> np.ndarray:
        """p(X), the integral of `joint` over velocity."""
        return self._either_side(self._displacement, x)

    def velocity(self, v: ArrayLike) -> np.ndarray:
        """p(X'), the integral of `joint` over displacement."""
        return self._either_side(self._velocity, v)

    def voltage(self, voltage: ArrayLike) -> np.ndarray:
        """p(V) of the terminal voltage."""
        return self._either_side(self._voltage, voltage)

    def below(self, x: float) -> float:
        """Probability of a displacement below x."""
        places, density = self.tabulated("displacement")
        end = np.clip(x, places[0], places[-1])
        return float(CubicSpline(places, density).integrate(places[0], end))

    def tabulated(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Points over the whole range of a density, and its values there: two ndarrays."""
        places = self._evenly(getattr(self, f"_{name}").x)
        return places, getattr(self, name)(places)

    def tabulated_joint(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Evenly spaced displacements and velocities, and p(X, X') there, over its relevant range.

        The part that alternates from node to node is removed: it stems from the sharing of mass in
        a contact.
        """
        x, v = (self._evenly(nodes, JOINT_POINTS) for nodes in (self.x, self.v))
        smooth = self.values
        for axis in (0, 1):
            smooth = convolve1d(smooth, SMOOTHING, axis=axis, mode="constant")
        spline = RectBivariateSpline(self.x, self.v, smooth)
        return x, v, self._either_side(spline.ev, x[:, None], v)

    def _evenly(self, nodes, count=0):
        """Evenly spaced positions over a density's range; by default spaced like its nodes."""
        far = np.abs(nodes).max()
        low, high = (-far, far) if self.paired else (nodes[0], nodes[-1])
        spacing = (nodes[-1] - nodes[0]) / (nodes.size - 1)
        return np.linspace(low, high, count or 1 + round((high - low) / spacing))

    def _either_side(self, spline, *places):
        """Evaluate a density; two symmetric wells get half each; 0 beyond the nodes."""
        ends = [self.x, self.v] if len(places) == 2 else [spline.x]
        places = np.broadcast_arrays(*(np.asarray(axis, dtype=float) for axis in places))
        total = np.zeros(places[0].shape)
        for side in (1.0, -1.0)[: 1 + self.paired]:
            mirrored = [side * coordinate for coordinate in places]
            inside = [(e[0] <= p) & (p <= e[-1]) for e, p in zip(ends, mirrored, strict=True)]
            # Between steep nodes the interpolated density falls below zero.
            total += np.where(np.all(inside, axis=0), np.maximum(spline(*mirrored), 0.0), 0.0)
        return total / (1 + self.paired)
