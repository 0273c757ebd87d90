"""Stationary densities of the closure `fokker_planck`, between the nodes of its grid."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.interpolate import CubicSpline, RectBivariateSpline
from scipy.ndimage import convolve1d

from harvester.averaging.flow import lagrange
from harvester.averaging.propagator import whole

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
    transducer : its equations
    grid : harvester.averaging.propagator.Grid
    state : ndarray
        Mass at each node.
    paired : bool
        The nodes hold one well alone, of two alike.

    Attributes
    ----------
    x, v : ndarray
        Evenly spaced displacements and velocities.
    values : ndarray
        Density at (x, v).
    """

    names = ("displacement", "velocity", "voltage")

    def __init__(self, transducer: Any, grid: Grid, state: np.ndarray, paired: bool) -> None:
        self.x, self.v, self.paired = grid.x, grid.v, paired
        mass = whole(state, grid)[:, :, 0]
        mass = mass / mass.sum()
        step_x, step_v = self.x[1] - self.x[0], self.v[1] - self.v[0]
        self.values = mass.sum(axis=1) / (step_x * step_v)
        self._joint = RectBivariateSpline(self.x, self.v, self.values)
        along_x, along_v = self.values.sum(axis=1) * step_v, self.values.sum(axis=0) * step_x
        if len(grid.z) == 1:
            voltage = transducer.voltage(self.v, 0.0)
            of_voltage = along_v * step_v / (voltage[1] - voltage[0])
        else:
            charge, of_charge = _of_charge(grid, mass.sum(axis=2))
            share = transducer.voltage(0.0, 1.0)
            voltage, of_voltage = share * charge, of_charge / share
        marginals = {
            "displacement": (self.x, along_x),
            "velocity": (self.v, along_v),
            "voltage": (voltage, of_voltage),
        }
        self._marginals = {name: CubicSpline(*each) for name, each in marginals.items()}

    def joint(self, x: ArrayLike, v: ArrayLike) -> np.ndarray:
        """p(X, X').

        Parameters
        ----------
        x, v : array_like
            Scaled displacement and velocity, of shapes that broadcast.
        """
        return self._either_side(self._joint.ev, x, v)

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
        places, density = self.tabulated("displacement")
        end = np.clip(x, places[0], places[-1])
        return float(CubicSpline(places, density).integrate(places[0], end))

    def tabulated(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Places where a density is known as far out as it reaches, and it there: two ndarrays."""
        places = self._evenly(self._marginals[name].x)
        return places, self._marginal(name, places)

    def tabulated_joint(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Displacements and velocities, evenly spaced, and p(X, X') there, as far as it reaches.

        Without what alternates from node to node: in a contact the mass is shared unevenly.
        """
        x, v = (self._evenly(nodes, JOINT_POINTS) for nodes in (self.x, self.v))
        smooth = self.values
        for axis in (0, 1):
            smooth = convolve1d(smooth, SMOOTHING, axis=axis, mode="constant")
        spline = RectBivariateSpline(self.x, self.v, smooth)
        return x, v, self._either_side(spline.ev, x[:, None], v)

    def _evenly(self, nodes, count=0):
        """So many places as far out as a density reaches; by default as far apart as its nodes."""
        far = np.abs(nodes).max()
        low, high = (-far, far) if self.paired else (nodes[0], nodes[-1])
        apart = (nodes[-1] - nodes[0]) / (nodes.size - 1)
        return np.linspace(low, high, count or 1 + round((high - low) / apart))

    def _marginal(self, name, place):
        return self._either_side(self._marginals[name], place)

    def _either_side(self, spline, *places):
        """A density, of two wells alike half on either side; 0 beyond the nodes."""
        ends = [self.x, self.v] if len(places) == 2 else [spline.x]
        places = np.broadcast_arrays(*(np.asarray(each, dtype=float) for each in places))
        total = 0.0
        for side in (1.0, -1.0)[: 1 + self.paired]:
            there = [side * place for place in places]
            inside = [(e[0] <= p) & (p <= e[-1]) for e, p in zip(ends, there, strict=True)]
            # Between steep nodes the shares of a mass undershoot.
            total += np.where(np.all(inside, axis=0), np.maximum(spline(*there), 0.0), 0.0)
        return total / (1 + self.paired)


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
        polynomial = lagrange(place, grid.z) * inside[..., None] / (weights * reach)
        return charge, np.einsum("xj,xqj->q", mass, polynomial)
    charge = np.linspace(
        (x - mean - NORMAL_TAIL * spread).min(),
        (x - mean + NORMAL_TAIL * spread).max(),
        VOLTAGE_POINTS,
    )
    away = (charge - (x - mean)[:, None]) / spread[:, None]
    return charge, (held / spread) @ np.exp(-0.5 * away**2) / np.sqrt(2.0 * np.pi)
