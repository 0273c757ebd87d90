"""Stationary densities of the closure `fokker_planck`, between the nodes of its grid."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.interpolate import CubicSpline, RectBivariateSpline
from scipy.ndimage import convolve1d

from harvester.averaging.propagator import mirrored, shares

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from harvester.averaging.propagator import Grid

JOINT_POINTS = 321  # displacements, and velocities, at which the joint density is tabulated
# Takes off what changes sign from node to node, and keeps moments up to the third.
SMOOTHING = np.array([-1.0, 4.0, 10.0, 4.0, -1.0]) / 16.0
VOLTAGE_POINTS = 241  # at which that density is known
COUNTED_MASS = 1e-6  # share of the greatest mass from which a place tells of Z
SPREAD_OUT = 0.15  # standard deviation of Z at its X, as a share of its reach
NORMAL_TAIL = 5.0  # standard deviations of a normal density


class GridDensity:
    """Stationary probability densities; methods are vectorised.

    Parameters
    ----------
    x, v, voltage : ndarray
        Evenly spaced displacements, velocities and terminal voltages.
    joint : ndarray
        Density at (x, v).
    of_voltage : ndarray
    paired : bool
        The nodes hold one well alone, of two alike.
    """

    names = ("displacement", "velocity", "voltage")

    def __init__(self, x, v, voltage, joint, of_voltage, paired):
        self.x, self.v, self.paired = x, v, paired
        self.values, self.of_voltage = joint, of_voltage
        self._joint = RectBivariateSpline(x, v, joint)
        marginals = {
            "displacement": (x, joint.sum(axis=1) * (v[1] - v[0])),
            "velocity": (v, joint.sum(axis=0) * (x[1] - x[0])),
            "voltage": (voltage, of_voltage),
        }
        self._marginals = {name: CubicSpline(*each) for name, each in marginals.items()}

    @classmethod
    def of_state(cls, transducer: Any, grid: Grid, state: np.ndarray, paired: bool) -> GridDensity:
        """From the mass at each node."""
        mass = state[:, :, 0]
        if grid.mirrored:
            mass = 0.5 * np.concatenate([mirrored(state)[:, :, 0], mass], axis=1)
        step_x, step_v = grid.x[1] - grid.x[0], grid.v[1] - grid.v[0]
        joint = mass.sum(axis=1) / (step_x * step_v)
        if len(grid.z) == 1:
            voltage = transducer.voltage(grid.v, 0.0)
            of_voltage = joint.sum(axis=0) * step_x * step_v / (voltage[1] - voltage[0])
            return cls(grid.x, grid.v, voltage, joint, of_voltage, paired)
        charge, density = _of_charge(grid, mass.sum(axis=2))
        share = transducer.voltage(0.0, 1.0)
        return cls(grid.x, grid.v, share * charge, joint, density / share, paired)

    def joint(self, x: ArrayLike, v: ArrayLike) -> np.ndarray:
        """p(X, X').

        Parameters
        ----------
        x, v : array_like
            Scaled displacement and velocity, of shapes that broadcast.
        """
        return self._mirrored(self._joint, x, v)

    def displacement(self, x: ArrayLike) -> np.ndarray:
        """p(X), the integral of `joint` over velocity."""
        return self._marginal("displacement", x)

    def velocity(self, v: ArrayLike) -> np.ndarray:
        """p(X'), the integral of `joint` over displacement."""
        return self._marginal("velocity", v)

    def voltage(self, voltage: ArrayLike) -> np.ndarray:
        """p(V) of the terminal voltage."""
        return self._marginal("voltage", voltage)

    def below(self, x: float) -> float:
        """Probability of a displacement below x."""
        spline, first, last = self._marginals["displacement"], self.x[0], self.x[-1]
        here, there = (spline.integrate(first, np.clip(end, first, last)) for end in (x, -x))
        whole = spline.integrate(first, last)
        return float(0.5 * (here + whole - there) if self.paired else here)

    def tabulated(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Places where a density is known as far out as it reaches, and it there: two ndarrays."""
        nodes = self._marginals[name].x
        if self.paired:
            far = np.abs(nodes).max()
            count = int(np.ceil(2.0 * far / (nodes[1] - nodes[0]))) + 1
            nodes = np.linspace(-far, far, count)
        return nodes, self._marginal(name, nodes)

    def tabulated_joint(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Displacements and velocities, evenly spaced, and p(X, X') there, as far as it reaches.

        Without what alternates from node to node: in a contact the mass is shared unevenly.
        """
        x, v = (self._evenly(nodes) for nodes in (self.x, self.v))
        smooth = self.values
        for axis in (0, 1):
            smooth = convolve1d(smooth, SMOOTHING, axis=axis, mode="constant")
        spline = RectBivariateSpline(self.x, self.v, smooth)
        return x, v, self._mirrored(spline, x[:, None], v)

    def _evenly(self, nodes):
        """Places as far out as the nodes, of a density that is mirrored on either side."""
        far = np.abs(nodes).max()
        first, last = (-far, far) if self.paired else (nodes[0], nodes[-1])
        return np.linspace(first, last, JOINT_POINTS)

    def _marginal(self, name, place):
        spline, place = self._marginals[name], np.asarray(place, dtype=float)
        values = np.nan_to_num(spline(place, extrapolate=False))
        if self.paired:
            values = 0.5 * (values + np.nan_to_num(spline(-place, extrapolate=False)))
        # Between steep nodes the shares of a mass undershoot.
        return np.maximum(values, 0.0)

    def _mirrored(self, spline, x, v):
        x, v = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(v, dtype=float))
        values = self._here(spline, x, v)
        return 0.5 * (values + self._here(spline, -x, -v)) if self.paired else values

    def _here(self, spline, x, v):
        inside = (x >= self.x[0]) & (x <= self.x[-1]) & (np.abs(v) <= self.v[-1])
        return np.where(inside, np.maximum(spline.ev(x, v), 0.0), 0.0)


def _of_charge(grid, mass):
    """Values of X − Z and their density, from the moments of Z that the nodes hold at each X.

    Where Z is spread over its nodes, the polynomial through them; else a normal density.
    """
    held = mass.sum(axis=1)
    counts = held > COUNTED_MASS * held.max()
    x, mass, held = grid.x[counts], mass[counts], held[counts]
    mean = mass @ grid.z / held
    spread = np.sqrt(np.maximum(mass @ grid.z**2 / held - mean**2, (0.5 * (x[1] - x[0])) ** 2))
    unit, weights = np.polynomial.legendre.leggauss(grid.z.size)
    reach = (grid.z[-1] - grid.z[0]) / (unit[-1] - unit[0])
    centre = 0.5 * (grid.z[0] + grid.z[-1])
    if held @ spread > SPREAD_OUT * reach * held.sum():
        charge = np.linspace(x[0] - centre - reach, x[-1] - centre + reach, VOLTAGE_POINTS)
        place = x[:, None] - charge
        inside = np.abs(place - centre) <= reach
        polynomial = shares(place, grid.z) * inside / (weights * reach)[:, None, None]
        return charge, np.einsum("xj,jxq->q", mass, polynomial)
    charge = np.linspace(
        (x - mean - NORMAL_TAIL * spread).min(),
        (x - mean + NORMAL_TAIL * spread).max(),
        VOLTAGE_POINTS,
    )
    away = (charge - (x - mean)[:, None]) / spread[:, None]
    return charge, (held / spread) @ np.exp(-0.5 * away**2) / np.sqrt(2.0 * np.pi)
