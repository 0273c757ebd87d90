"""The stationary state on one grid, and the work limit of all grids of an answer."""

from __future__ import annotations

import numpy as np

from harvester.averaging.grid_density import GridDensity
from harvester.averaging.inverse import Inverse, moved
from harvester.averaging.propagator import Propagator
from harvester.averaging.region import Level, Region
from harvester.averaging.wells import between_wells, unlike_wells
from harvester.base.errors import AveragingError
from harvester.device import system as systems
from harvester.device import timescales
from harvester.device.system import System

# Largest work on all grids together, amplitudes times steps: five to ten seconds.
MOST_WORK = 4e8
# Smallest number of periods that the work limit must allow on a grid.
LEAST_PERIODS = 6
# Largest memory of the matrices of the noise on a grid, in bytes.
LARGEST_PUSHES = 2e8
# A load whose charge decays by an exponent above this in a period needs more steps in proportion.
LARGEST_LOAD_DECAY = 2.8
# Relative growth of the number of steps per share of the stiffness that comes from the coupling.
STEPS_OF_STRONG_COUPLING = 3.0
# If the spring stiffens, the number of steps grows by this times the share by which the fastest
# motion exceeds the frequency of small oscillations.
STEPS_OF_STIFFENING = 1.25
# If a contact lasts less than the share CONTACTS_OF_A_STEP of a period, steps are shorter, by at
# most the factor MOST_STEPS_FOR_CONTACTS: shorter ones are not needed, since the noise hardly
# changes the motion during a very short contact.
CONTACTS_OF_A_STEP, MOST_STEPS_FOR_CONTACTS = 1.0 / 6.0, 2.0
# Largest residual of a period, in tolerances, relative to the slowest mode's change in a period.
RESIDUAL_OVER_TOLERANCE = 2e-2
# If jumps between unequal wells per period are rarer than RARE_JUMPS, each well with at least the
# share LEAST_SHARE_OF_WELL of the time gets a separate search direction.
RARE_JUMPS, LEAST_SHARE_OF_WELL = 1e-2, 1e-9
# Smallest residual that rounding allows.
LEAST_RESIDUAL = 1e-8
# Residuals below this share of the density are computed in double precision.
LEAST_SINGLE_SHARE = 1e-6


class StationaryProblem:
    """The problem that is solved on all grids of one answer.

    Parameters
    ----------
    tolerance
        Quoted in the error message if the work limit is exceeded.
    share
        Work limit relative to the usual one.
    read : transducer's equations, optional
        Transducer whose voltage and power are computed from the state; the device's own by default.
    """

    def __init__(self, device, tolerance, share=1.0, read=None):
        self.device, self.tolerance = device, tolerance
        self.transducer, self.left = read or device.transducer, share * MOST_WORK

    def take(self, work: float, ahead: float = 0.0) -> None:
        """Subtract work (amplitudes times steps) from the budget; raise if it is spent."""
        if self.left < work + ahead:
            raise AveragingError(
                "the density is so narrow, or its slowest part so slow, that the tolerance of "
                f"{self.tolerance:g} needs more nodes and steps than are allowed: raise the "
                "tolerance, or simulate"
            )
        self.left -= work


class Solution:
    """Stationary state on one grid: a period leaves it unchanged.

    Attributes
    ----------
    steps, cost
        Number of steps in a period, and the work of a period.
    propagator
        The propagator in single precision.
    state, before_flow
        Mass at each node, in the middle of a step, and just before the flow.
    means
        The means of the answer, `power_in`, and quantities of several wells.
    """

    def __init__(
        self, task: StationaryProblem, region: Region, level: Level, coarser: Solution | None = None
    ) -> None:
        self.task, self.region, self.level = task, region, level
        device, time = task.device, period(task.device)
        self.steps = int(np.ceil(level.steps * _hurry(device, time)))
        self.grid = grid = region.grid(device, level, time / self.steps)
        self.cost = int(np.prod(grid.shape)) * self.steps
        task.take(0.0, ahead=LEAST_PERIODS * self.cost)
        if grid.push_bytes > LARGEST_PUSHES:
            raise AveragingError(
                f"coloured noise with {grid.modes} modes on {len(grid.x)} by {len(grid.v)} nodes "
                f"takes {grid.push_bytes / 1e9:.2g} GB, more than {LARGEST_PUSHES / 1e9:g} GB: "
                "simulate"
            )
        self.coarser = coarser if coarser and coarser.region == region else None
        coarse = self.coarser._inverse if self.coarser else None
        self._inverse: Inverse = Inverse(grid, self._later, coarse, self._balanced, self._cleared)
        exact = Propagator(device, grid)
        self.propagator = exact.single()
        jumps, self._wells = np.inf, np.ones((1, grid.x.size))
        if coarser is None:
            start = _gibbs(device, region, grid)
        else:
            start = moved(coarser.state, coarser.grid, grid)
            # Number of jumps per period between unequal wells.
            if "share_of_time_in_well_1" in coarser.means:
                jumps = time * coarser.means.get("well_crossing_rate", np.inf)
        if jumps < RARE_JUMPS:
            wells = unlike_wells(device, grid)
            self._wells = wells[wells @ start[:, :, 0].sum(axis=(1, 2)) > LEAST_SHARE_OF_WELL]
        # The slower a mode, the smaller the share of its error that a period changes.
        slow = min(1.0, jumps, (device.transducer.decay_rate() or np.inf) * time)
        share = max(RESIDUAL_OVER_TOLERANCE * level.tolerance * slow, LEAST_RESIDUAL)
        self.state: np.ndarray = self._settled(start, share, exact)
        self.before_flow = self.propagator.before_flow(self.state)
        paired = region.well is not None and device.symmetric
        self.density = GridDensity(task.transducer, grid, self.state, paired)
        self.means: dict[str, float] = self._means() | between_wells(device, self.density)

    @property
    def unresolved(self) -> bool:
        """Whether contacts at the rms speed are less deep than the nodes of X are apart."""
        energy = 0.5 * max(self.means["mean_square_velocity"], 0.0)
        spacing = self.grid.x[1] - self.grid.x[0]
        return any(stop.law.greatest_depth(energy) < spacing for stop in self.task.device.contacts)

    def _settled(self, start, share, exact):
        """Iterate from `start` until a period changes at most this share of the state."""
        # The first period on a new grid removes the error of interpolation between grids.
        state = self._later(start).astype(float)
        state /= state[:, :, 0].sum()
        # Jumps are much slower than other motion: many other search directions would miss them.
        for alone in self._of_wells(state)[1:]:
            self._inverse.extend(alone - state)
        teller = exact if share < LEAST_SINGLE_SHARE else self.propagator

        def left(state):
            self.task.take(self.cost)
            return teller.repeated(state, self.steps) - state

        state = self._inverse.settled(state, left, share * np.linalg.norm(state))
        return state / state[:, :, 0].sum()

    def _later(self, state):
        """Return the state one period later."""
        self.task.take(self.cost)
        return self.propagator.repeated(state, self.steps)

    def _balanced(self, change):
        """A change of the state, corrected so that its sum is 0."""
        return change - change[:, :, 0].sum() * self.state

    def _cleared(self, change):
        """A change of the state, without its change of the total mass in each rarely left well."""
        for well, alone in zip(self._wells, self._of_wells(self.state), strict=True):
            change = change - (well @ change[:, :, 0].sum(axis=(1, 2))) * alone
        return change

    def _of_wells(self, state):
        """The parts of a state in wells between which jumps are rare, each with sum 1."""
        parts = self._wells[:, :, None, None, None] * state
        return parts / parts[:, :, :, 0].sum(axis=(1, 2, 3))[:, None, None, None, None]

    def _means(self):
        grid, transducer = self.grid, self.task.transducer
        x, v, charge = grid.x[:, None, None], grid.v, grid.x[:, None, None] - grid.kept[:, None]
        current = transducer.current(v, charge)
        # The energy that the noise adds in a step is far more accurate than the energy lost in
        # contacts, which are shorter than a step.
        flowed = self.propagator.flowed(self.before_flow)
        gained = (self.propagator.pushed(flowed) - flowed)[:, :, 0]
        power_in = float(np.sum(gained * v**2)) * 0.5 / grid.step
        squares = {
            "mean_square_voltage": transducer.voltage(v, charge) ** 2,
            "mean_power": transducer.load_power(v, charge),
            "mean_transducer_loss": transducer.loss(v, charge, current),
            "mean_square_velocity": v**2,
            "mean_square_displacement": x**2,
        }
        mass = self.state[:, :, 0]
        means = {name: float(np.sum(mass * values)) for name, values in squares.items()}
        power, lost = means["mean_power"], means["mean_transducer_loss"]
        return means | {
            "power_in": power_in,
            "mechanical_loss": power_in - power - lost,
            "power_conversion_efficiency": power / power_in,
        }


def _hurry(device, time):
    """Factor on the steps per period for a fast load, contacts or a stiffening spring."""
    stiffened = getattr(device.transducer, "coupling", 0.0) * (time / (2.0 * np.pi)) ** 2
    decay = device.transducer.decay_rate() * time * (1.0 + STEPS_OF_STRONG_COUPLING * stiffened)
    contacts = CONTACTS_OF_A_STEP * time / timescales.contact_time(device)
    faster = timescales.fastest_angular_frequency(device) / timescales.angular_frequency(device)
    stiffening = 1.0 + STEPS_OF_STIFFENING * (faster - 1.0)
    return max(stiffening, decay / LARGEST_LOAD_DECAY, min(contacts, MOST_STEPS_FOR_CONTACTS))


def _gibbs(device, region, grid):
    """Gibbs density with the region's spread of X' and the charge of the nearest well."""
    wells = np.array(timescales.wells(device)) if region.well is None else np.array([region.well])
    coupling = getattr(device.transducer, "coupling", 0.0)
    nearest = wells[np.abs(grid.x[:, None] - wells).argmin(axis=1)]
    energy = systems.potential(device, grid.x) + 0.5 * coupling * (grid.x - nearest) ** 2
    energy = energy[:, None] + 0.5 * grid.v**2
    density = np.exp((energy.min() - energy) / region.core_speed**2)
    width = 0.25 * np.ptp(grid.z) or 1.0
    charges = np.exp(-(((grid.kept[None, :] - nearest[:, None]) / width) ** 2))
    state = np.zeros(grid.shape)
    state[:, :, 0] = charges[:, :, None] * density[:, None, :]
    return state / state[:, :, 0].sum()


def period(device: System) -> float:
    """The period of small oscillations (s)."""
    return 2.0 * np.pi / timescales.angular_frequency(device)
