"""The stationary state on one grid, and the work that all grids of an answer may take."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import RectBivariateSpline

from harvester.averaging.grid_density import GridDensity
from harvester.averaging.propagator import Propagator, mirrored, shares
from harvester.averaging.stationary import stationary
from harvester.averaging.wells import between_wells
from harvester.device import system as systems
from harvester.device import timescales
from harvester.errors import AveragingError

if TYPE_CHECKING:
    from harvester.averaging.propagator import Grid
    from harvester.device.system import System

MOST_WORK = 2e8  # amplitudes moved by a step, on all grids together: about ten seconds
LEAST_VECTORS = 10  # of GMRES on a grid
FEWER = 0.5  # vectors on the next grid, as a share of those on one
LARGEST_PUSHES = 2e8  # of the noise's pushes on a grid (bytes)
DECAY = 2.8  # greatest λ dt, times the steps of a period
PERIODS = 1.0  # between two vectors of GMRES
RESIDUAL = 6e-3  # of them, in tolerances, as a share of what the load moves between them


class Work:
    """How much work an answer may take: amplitudes of a state times steps, over all its grids."""

    def __init__(self, tolerance):
        self.left, self.tolerance = MOST_WORK, tolerance

    def take(self, work: float) -> None:
        """Take this much of what is left, or refuse."""
        self.spare(work)
        self.left -= work

    def spare(self, work: float) -> None:
        """Refuse where less than this is left."""
        if self.left < work:
            raise AveragingError(
                "the density is so narrow, or its slowest part so slow, that the tolerance of "
                f"{self.tolerance:g} takes more nodes and steps than fokker_planck has: raise it, "
                "or simulate"
            )


class Solution:
    """Stationary state on one grid, from that on a coarser one or from a Gibbs density.

    Attributes
    ----------
    grid : harvester.averaging.propagator.Grid
    state : ndarray
        Mass at each node, where a step is symmetric in time.
    totals : dict of str to float
        Means that are sums over the state, and `power_in`.
    density : harvester.averaging.grid_density.GridDensity
    steps : int
        Of about a period.
    cost : int
        Work of so many steps.
    """

    def __init__(self, device, region, level, coarser, tolerance, work):
        self.device, self.region, self.level, self.work = device, region, level, work
        self.grid, self.steps, self.cost = grid, _, _ = _laid(device, region, level)
        self.vectors = 0
        work.spare(LEAST_VECTORS * self.cost)
        if grid.push_bytes > LARGEST_PUSHES:
            raise AveragingError(
                f"noise remembered over {grid.modes} modes on {len(grid.x)} by {len(grid.v)} nodes "
                f"takes {grid.push_bytes / 1e9:.2g} GB, more than {LARGEST_PUSHES / 1e9:g} GB: "
                "simulate"
            )
        self.propagator = Propagator(device, grid)
        start = _gibbs(device, region, grid) if coarser is None else coarser.on(grid)
        # Of what a slow load leaves undone, only so small a share of the density changes at a time.
        slow = device.transducer.decay_rate() or np.inf
        allowed = tolerance * RESIDUAL * min(1.0, slow * self.steps * grid.step)
        state = stationary(self._change, start, allowed)
        if state is None:
            raise AveragingError("the stationary density was not reached: simulate")
        self.before_flow = state / state[..., 0].sum()
        state = self.propagator.centred(self.before_flow)
        self.state = state / state[..., 0].sum()
        self.density = GridDensity.of_state(
            device.transducer, grid, self.state, region.well is not None
        )
        self.totals = self._totals()

    @property
    def unresolved(self) -> bool:
        """Whether contacts at the rms speed are less deep than the nodes of X are apart."""
        energy = 0.5 * max(self.totals["mean_square_velocity"], 0.0)
        apart = self.grid.x[1] - self.grid.x[0]
        return any(each.law.greatest_depth(energy) < apart for each in self.device.contacts)

    def refined(self, respect: str, tolerance: float) -> Solution:
        """On the next finer grid: of more "steps", or of more "nodes"."""
        level = self.level.more(respect)
        return Solution(self.device, self.region, level, self, tolerance, self.work)

    def affords(self, respect: str) -> bool:
        """Whether there is work left for the next finer grid."""
        _, _, cost = _laid(self.device, self.region, self.level.more(respect))
        return FEWER * self.vectors * cost <= self.work.left

    def _change(self, state):
        """What a period takes off a state."""
        self.work.take(self.cost)
        self.vectors += 1
        return state - self.propagator.repeated(state, self.steps)

    def on(self, grid: Grid) -> np.ndarray:
        """Its state before the flow on the nodes of another grid."""
        old, state = self.grid, self.before_flow
        moved = np.zeros((*grid.shape[:3], max(grid.modes, state.shape[-1])))
        if len(grid.z) > 1:
            if old.mirrored:
                state = np.concatenate([mirrored(state), state], axis=1)
            across = shares(np.clip(old.z, grid.z[0], grid.z[-1]), grid.z)
            state = np.einsum("ij,xjvm->xivm", across[len(grid.z) - len(grid.kept) :], state)
        inside = (np.abs(grid.v) <= old.v[-1]) * ((grid.x >= old.x[0]) & (grid.x <= old.x[-1]))[
            :, None
        ]
        for z in range(state.shape[1]):
            for mode in range(min(state.shape[-1], grid.modes)):
                spline = RectBivariateSpline(old.x, old.v, state[:, z, :, mode])
                moved[:, z, :, mode] = spline(grid.x, grid.v) * inside
        moved = moved[..., : grid.modes]
        return moved / moved[..., 0].sum()

    def _totals(self):
        mass, grid, transducer = self.state[..., 0], self.grid, self.device.transducer
        both = mass.sum(axis=1)
        charge = grid.x[:, None, None] - grid.kept[:, None]
        voltage = transducer.voltage(grid.v, charge)
        current = transducer.current(grid.v, charge)
        totals = {
            "power_in": self._power_in(),
            "mean_square_voltage": np.sum(mass * voltage**2),
            "mean_power": np.sum(mass * transducer.load_power(grid.v, charge)),
            "mean_transducer_loss": np.sum(mass * transducer.loss(grid.v, charge, current)),
            "mean_square_velocity": np.sum(both * grid.v**2),
            "mean_square_displacement": np.sum(both * grid.x[:, None] ** 2),
        }
        totals |= between_wells(self.device, self.density)
        return {name: float(total) for name, total in totals.items()}

    def _power_in(self):
        """What the noise adds to ½X'² in a step, over the step.

        That is known far better than what the contacts take, in times shorter than a step.
        """
        before = self.before_flow
        gained = np.sum((before - self.propagator.flowed(before))[..., 0] * self.grid.v**2)
        return 0.5 * gained / self.grid.step


def _laid(device, region, level):
    """The grid of a level, its steps in about a period, and the work that these take."""
    rate = device.transducer.decay_rate()
    step = min(period(device), DECAY / rate if rate > 0.0 else np.inf) / level.steps
    grid = region.grid(device, level, step)
    steps = int(np.ceil(PERIODS * period(device) / step))
    return grid, steps, int(np.prod(grid.shape)) * steps


def _gibbs(device, region, grid):
    """A Gibbs density with the region's spread of X', its charge about that of the nearest well."""
    wells = np.array(timescales.wells(device)) if region.well is None else np.array([region.well])
    coupling = getattr(device.transducer, "coupling", 0.0)
    nearest = wells[np.abs(grid.x[:, None] - wells).argmin(axis=1)]
    energy = systems.potential(device, grid.x) + 0.5 * coupling * (grid.x - nearest) ** 2
    energy = energy[:, None] + 0.5 * grid.v**2
    density = np.exp((energy.min() - energy) / region.core_speed**2)
    width = 0.25 * np.ptp(grid.z) or 1.0
    charges = np.exp(-(((grid.kept[None, :] - nearest[:, None]) / width) ** 2))
    if grid.kept.size == 1:
        charges[:] = 1.0
    state = np.zeros(grid.shape)
    state[..., 0] = charges[:, :, None] * density[:, None, :]
    return state / state[..., 0].sum()


def period(device: System) -> float:
    """Of small oscillations (s)."""
    return 2.0 * np.pi / timescales.angular_frequency(device)
