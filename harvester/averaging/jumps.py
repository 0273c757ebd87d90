"""Rates of jumps between wells, and the slowest rate at which the initial well is forgotten.

Both are computed on each grid of a solution; a finer grid starts from the values of the coarser
grid.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

from harvester.averaging.flow import PhaseGrid
from harvester.averaging.inverse import Inverse, moved
from harvester.averaging.propagator import Propagator
from harvester.averaging.solution import Solution
from harvester.averaging.wells import alike, well_at
from harvester.base.errors import AveragingError
from harvester.device.cores import core_energies, jump_rates
from harvester.device.system import System, potential

# The slowest state is accepted if a period changes it, apart from its decay, by less than the first
# value, or by less than the second times the saddle crossings per period, which are about 1 −
# eigenvalue if jumps are rare.
STATE_TOLERANCE, CROSSINGS_TOLERANCE = 1e-6, 2e-4
# A corrected state may miss that limit by this factor; otherwise it is corrected again.
MOST_LEFT = 3.0
# Relative tolerance of Arnoldi's eigenvalue, about the rounding error of single precision.
START_TOLERANCE = 1e-5
# Vectors of Arnoldi's method between two restarts.
VECTORS = 20
# If jumps are rare, the iteration stops when this share of the mass is not assigned to a core.
REACHED = 1e-7
# Largest work on one grid (amplitudes moved), for the slowest state and for the jumps separately.
MOST_WORK = 2e8
# Each node's cell is divided into 5 by 5 points, which give the share of it that lies in a core.
PARTS_OF_NODE = 5


class _RateSolver:
    """Computes rates on one grid, within a budget of work.

    Attributes
    ----------
    inverses
        Inverses by the parity of the states; a finer grid uses them as preconditioners.
    """

    def __init__(self, solution: Solution, coarser: _RateSolver | None) -> None:
        self.solution, self.coarser, self.left = solution, coarser, MOST_WORK
        self.inverses: dict[float, Inverse] = {}

    def take(self) -> None:
        """Subtract one period from the remaining work; raise if none remains."""
        self.left -= self.solution.cost
        if self.left < 0.0:
            raise AveragingError("rates of jumps take too many steps")

    def inverse(self, later: Callable, parity: float, decayed: float = 1.0) -> Inverse:
        """The inverse of a map of states with this parity."""
        preconditioner = self.coarser.inverses[parity] if self.coarser else None
        inverse = Inverse(self.solution.grid, later, preconditioner, decayed=decayed, parity=parity)
        self.inverses[parity] = inverse
        return inverse


class _SlowestDecay(_RateSolver):
    """The slowest decaying state after the stationary one, and its rate."""

    state: np.ndarray

    def __init__(self, solution: Solution, coarser: _SlowestDecay | None) -> None:
        super().__init__(solution, coarser)
        grid, exact = solution.grid, Propagator(solution.task.device, solution.grid)
        parity = -1.0 if grid.mirrored else 1.0
        if grid.mirrored:
            exact = exact.odd()
        if coarser is None:
            state, self.decayed = self._by_arnoldi(exact.single())
        else:
            state = moved(coarser.state, coarser.solution.grid, grid, parity)
            self.decayed = coarser.decayed
        # If jumps are rare, the sum of a state with these signs is the mass that has changed wells.
        self._signs = np.sign(state[:, :, 0])
        self._exact, self._single = exact, exact.single()
        self.state, time = self._later(state, exact), solution.steps * grid.step
        crossings = solution.means["well_crossing_rate"] * time
        tolerance = min(STATE_TOLERANCE, CROSSINGS_TOLERANCE * crossings)
        left = np.inf
        while left > MOST_LEFT * tolerance:
            before, left = left, self._corrected(tolerance, parity)
            if not left < before:
                raise AveragingError("the rate of jumps between the wells was not found: simulate")
        self.rate = -np.log(abs(self.decayed)) / time

    def _corrected(self, tolerance, parity):
        """Correct the state; returns its relative change in a period, apart from its decay.

        The eigenvalue's correction acts on the old state, not on the solution: the error of a poor
        state may not decay as expected.
        """
        self.state = self._start = self.state / self._part(self.state)
        allowed = tolerance * float(np.linalg.norm(self._start))
        inverse = self.inverse(self._later_remainder, parity, self.decayed)
        self.state = inverse.settled(self._start, self._left, allowed)
        return float(np.linalg.norm(self._left(self.state)) / np.linalg.norm(self.state))

    def _left(self, state):
        change = self._later(state, self._exact)
        self.decayed = self._part(change) / self._part(state)
        return change - self.decayed * state

    def _later(self, state, propagator):
        """State one period later, without its stationary part."""
        self.take()
        state = propagator.repeated(state, self.solution.steps)
        if not self.solution.grid.mirrored:
            state = state - state[:, :, 0].sum() * self.solution.state
        return state

    def _later_remainder(self, change):
        """A change of the state one period later, corrected so that its sum over the signs is 0."""
        change = self._later(change, self._single)
        return change - self._part(change) * self._start

    def _part(self, state):
        return float(np.sum(self._signs * state[:, :, 0]))

    def _by_arnoldi(self, propagator):
        """The slowest decay by Arnoldi's method; raises if the state oscillates."""
        shape = self.solution.grid.shape
        start = self.solution.before_flow * self.solution.grid.x[:, None, None, None]
        operator = LinearOperator(
            (start.size, start.size),
            matvec=lambda flat: self._later(flat.reshape(shape), propagator).ravel(),
            dtype=float,
        )
        try:
            values, vectors = eigs(operator, 1, v0=start.ravel(), ncv=VECTORS, tol=START_TOLERANCE)
        except ArpackNoConvergence as failure:
            raise AveragingError(
                "the rate of jumps between the wells was not found: simulate"
            ) from failure
        if values[0].imag:
            raise AveragingError(
                "the slowest decay oscillates, so it is not a rate of jumps between wells: simulate"
            )
        return np.real(vectors[:, 0]).reshape(shape), values[0].real


class _Jumps(_RateSolver):
    """Mass by the well whose core it last visited, and the part of it that jumps.

    The stationary mass p is split: q_w = outside · P q_w + core_w · p for a step P. The mass of P
    q_w in another core has jumped.
    """

    coarser: _Jumps | None

    def __init__(self, solution: Solution, coarser: _Jumps | None) -> None:
        super().__init__(solution, coarser)
        grid, device = solution.grid, solution.task.device
        p = solution.before_flow.astype(float)
        cores = _shares_in_cores(device, grid)
        outside = (1.0 - cores.sum(axis=0))[:, None, None, :]
        sides = well_at(device, grid.x) == np.arange(len(cores))[:, None]
        combinations, parities = _combinations(len(cores), grid.mirrored)
        exact = Propagator(device, grid)
        exacts = {1.0: exact, -1.0: exact.odd()}
        for parity in dict.fromkeys(parities[1:]):
            single = self._later(exacts[parity].single(), outside.astype(np.float32))
            self.inverse(single, parity)
        self.masses = [p]
        # A period conserves all mass, and the mass that enters each core.
        entering = [np.einsum("xzv,uxv->u", p[:, :, 0], cores)]
        for weights, parity in zip(combinations[1:], parities[1:], strict=True):
            later = self._later(exacts[parity], outside)
            source = np.tensordot(weights, cores, 1)[:, None, None, :] * p
            self.masses.append(self._last_in_cores(later, source, weights @ sides, parity))
            after = exacts[parity].step(self.masses[-1])
            entering.append(np.einsum("xzv,uxv->u", after[:, :, 0], cores))
        wells = np.linalg.inv(combinations)
        self.times = wells @ [mass[:, :, 0].sum() for mass in self.masses]
        self.counts = wells @ entering / grid.step
        if grid.mirrored:
            self.times = self.times + self.times[::-1]
            self.counts = self.counts + self.counts[::-1, ::-1]

    def _later(self, propagator, outside):
        """State one period later, without mass that has been in a core, plus a source at each step.

        After about a period, oscillating mass has returned.
        """

        def later(state, source=0.0):
            self.take()
            for _ in range(self.solution.steps):
                state = outside * propagator.step(state) + source
            return state

        return later

    def _last_in_cores(self, later, source, guess, parity):
        """Mass by the core it last visited, starting from the coarser grid's or the wells' mass."""
        coarser, p = self.coarser, self.masses[0]
        if coarser is None:
            start = guess[:, None, None, None] * p
        else:
            coarse_mass = coarser.masses[len(self.masses)]
            start = moved(coarse_mass, coarser.solution.grid, self.solution.grid, parity)
        allowed = REACHED * np.linalg.norm(later(np.zeros(p.shape), source))
        inverse = self.inverses[parity]
        return inverse.settled(start, lambda state: later(state, source) - state, allowed)


def slowest_decay_rate(solutions: Iterable[Solution]) -> dict[Solution, dict[str, float]]:
    """Slowest decay rate (1/s), of the memory of the well or of the charge, by grid.

    For two wells that exchange mass at the rates k12 and k21, slower than all other decays, it is
    k12 + k21. On a mirrored grid its state is odd. Empty for grids that take too many steps.
    """
    decays = _on_each(solutions, _SlowestDecay)
    return {solution: {"slowest_decay_rate": float(one.rate)} for solution, one in decays.items()}


def rates_of_jumps(solutions: Iterable[Solution]) -> dict[Solution, dict[str, float]]:
    """Rates of jumps from one well's core to another's (1/s), as Monte Carlo counts them, by grid.

    Empty for grids that take too many steps.
    """
    jumps_on = _on_each(solutions, _Jumps)
    return {solution: _named(solution.task.device, one) for solution, one in jumps_on.items()}


def _on_each(solutions, find):
    """Results of `find` on each grid, coarser grids first; empty if it does not converge."""
    results = {}

    def on(solution):
        if solution not in results:
            results[solution] = find(solution, solution.coarser and on(solution.coarser))
        return results[solution]

    try:
        return {grid: on(grid) for grid in solutions}
    except AveragingError:
        return {}


def _named(device, jumps):
    wells = len(jumps.times)
    return {
        name: float(
            sum(jumps.counts[pair] for pair in pairs)
            / sum(jumps.times[well] for well in {well for well, _ in pairs})
        )
        for name, pairs in jump_rates(wells, alike(device)).items()
    }


def _shares_in_cores(device: System, grid: PhaseGrid) -> np.ndarray:
    """Share of each node's surroundings in each core: (wells, X, X')."""
    limits = core_energies(device)[:, None, None]
    within = (np.arange(PARTS_OF_NODE) + 0.5) / PARTS_OF_NODE - 0.5
    x = grid.x[:, None] + within * (grid.x[1] - grid.x[0])
    v = grid.v[:, None] + within * (grid.v[1] - grid.v[0])
    in_well = well_at(device, x) == np.arange(limits.size)[:, None, None]
    left = np.where(in_well, limits - potential(device, x), -np.inf)
    return (0.5 * v[:, None, :] ** 2 <= left[:, :, None, :, None]).mean(axis=(3, 4))


def _combinations(wells, mirrored):
    """Linear combinations of wells that a grid can represent: an invertible matrix, and their
    parities.

    The first is the total mass. On a mirrored grid they are even and odd sums of mirrored wells.
    """
    single = np.eye(wells)
    if not mirrored:
        return np.array([np.ones(wells), *single[:-1]]), [1.0] * wells
    pairs = [(single[w], single[wells - 1 - w]) for w in range((wells + 1) // 2)]
    even = [np.ones(wells), *(np.maximum(a, b) for a, b in pairs[1:])]
    odd = [a - b for a, b in pairs[: wells // 2]]
    return np.array([*even, *odd]), [1.0] * len(even) + [-1.0] * len(odd)
