"""How often motion passes between wells, how long it stays, and how fast it forgets."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs, gmres

from harvester.averaging.propagator import Propagator
from harvester.device import timescales
from harvester.device.cores import core_energies, jump_rates
from harvester.device.system import potential

if TYPE_CHECKING:
    from harvester.averaging.grid_density import GridDensity
    from harvester.averaging.propagator import Grid
    from harvester.averaging.solution import Solution
    from harvester.device.system import System

EIGENVALUE_TOLERANCE = 1e-4  # of an eigenvalue, as a share of it
LEAST_VECTORS = 20  # of Arnoldi's method, between two restarts
# Of the mass in the cores, as a share: left to be found, for rare jumps; and the most vectors.
REACHED, MOST_VECTORS = 1e-6, 200
MOST_WORK = 1e8  # vectors times steps times the amplitudes of a state
PARTS_OF_NODE = 5  # in X and in X' that tell how much of a node's surroundings lies in a core


def between_wells(device: System, density: GridDensity) -> dict[str, float]:
    """Rate of crossings of all saddles, and shares of time from the left; empty for one well.

    The rate is the flux Σ ∫ |X'| p(saddle, X') dX', both ways, as Monte Carlo counts it; shares
    are given where symmetry does not tell them. A density of one well alone tells no rate.
    """
    saddles, v, answer = sorted(timescales.saddles(device)), density.v, {}
    if not saddles:
        return {}
    if density.x[0] < saddles[0] and saddles[-1] < density.x[-1]:
        flux = sum(float(density.joint(x, v) @ np.abs(v)) * (v[1] - v[0]) for x in saddles)
        answer["well_crossing_rate"] = flux
    if not _alike(device):
        shares = np.diff([0.0, *(density.below(x) for x in saddles), density.below(np.inf)])
        for number, share in enumerate(shares / shares.sum(), start=1):
            answer[f"share_of_time_in_well_{number}"] = float(share)
    return answer


def slowest_decay_rate(device: System, solution: Solution) -> dict[str, float] | None:
    """Rate at which the last memory of the well, or of the charge it left, decays (1/s).

    Of two wells that exchange mass at the rates k12 and k21, faster than nothing else decays, it is
    k12 + k21. On a mirrored grid this is an odd state. None where it takes too many steps.
    """
    grid, steps = solution.grid, solution.steps
    propagator = Propagator(device, grid, odd=grid.mirrored)
    start = solution.before_flow * grid.x[:, None, None, None]
    operator = LinearOperator(
        (start.size, start.size),
        matvec=lambda flat: propagator.repeated(flat.reshape(start.shape), steps).ravel(),
        dtype=float,
    )
    wanted = 1 if grid.mirrored else 2
    vectors = int(min(MOST_VECTORS, MOST_WORK / solution.cost))
    if vectors < LEAST_VECTORS:
        return None
    try:
        values = eigs(
            operator,
            k=wanted,
            v0=start.ravel(),
            ncv=LEAST_VECTORS,
            maxiter=vectors // LEAST_VECTORS,
            tol=EIGENVALUE_TOLERANCE,
            return_eigenvectors=False,
        )
    except ArpackNoConvergence:
        return None
    # All but the stationary state's own.
    slowest = np.sort(np.abs(values))[0]
    return {"slowest_decay_rate": float(-np.log(slowest) / (steps * grid.step))}


def rates_of_jumps(device: System, solution: Solution) -> dict[str, float] | None:
    """Rates of jumps from one well's core to another's, as Monte Carlo counts them (1/s).

    The stationary mass p is divided by the well whose core it was in last: q_w, which obeys
    q_w = outside · P q_w + core_w · p for a step P. What P q_w has in another core has jumped.
    None where it takes too many steps.
    """
    grid = solution.grid
    cores = _shares_in_cores(device, grid)
    sides = _well_at(device, grid.x) == np.arange(len(cores))[:, None]
    combinations, odd = _combinations(len(cores), grid.mirrored)
    propagators = {each: Propagator(device, grid, odd=each) for each in set(odd)}
    held, moved = [], []
    for weights, is_odd in zip(combinations, odd, strict=True):
        propagator = propagators[is_odd]
        found = _last_in_cores(propagator, cores, weights, weights @ sides, solution)
        if found is None:
            return None
        held.append(found[:, :, 0].sum())
        moved.append(propagator.step(found)[:, :, 0].sum(axis=1))
    single = np.linalg.inv(combinations)
    times = single @ held
    counts = np.einsum("wc,cxv,uxv->wu", single, moved, cores)
    if grid.mirrored:
        times, counts = times + times[::-1], counts + counts[::-1, ::-1]
    return {
        name: float(
            sum(counts[pair] for pair in pairs)
            / (grid.step * sum(times[well] for well in {well for well, _ in pairs}))
        )
        for name, pairs in jump_rates(len(cores), _alike(device)).items()
    }


def _alike(device):
    """Whether symmetry makes two wells alike."""
    return len(timescales.wells(device)) == 2 and device.symmetric


def _well_at(device, x):
    """Number of the well between whose saddles each displacement lies."""
    return np.searchsorted(sorted(timescales.saddles(device)), x)


def unlike_wells(device: System, grid: Grid) -> np.ndarray:
    """Which displacements lie in each well, of two alike in either: (wells, X) of 0 and 1."""
    number = _well_at(device, grid.x)
    if grid.mirrored:
        number = np.minimum(number, number[::-1])
    return (number == np.unique(number)[:, None]).astype(float)


def _shares_in_cores(device: System, grid: Grid) -> np.ndarray:
    """How much of the surroundings of each node lies in each core: (wells, X, X')."""
    limits = core_energies(device)[:, None, None]
    within = (np.arange(PARTS_OF_NODE) + 0.5) / PARTS_OF_NODE - 0.5
    x = grid.x[:, None] + within * (grid.x[1] - grid.x[0])
    v = grid.v[:, None] + within * (grid.v[1] - grid.v[0])
    here = _well_at(device, x) == np.arange(limits.size)[:, None, None]
    left = np.where(here, limits - potential(device, x), -np.inf)
    return (0.5 * v[:, None, :] ** 2 <= left[:, :, None, :, None]).mean(axis=(3, 4))


def _combinations(wells, mirrored):
    """Sums of wells that a grid can hold: an invertible matrix, and whether each is odd.

    The first is all mass. On a mirrored grid even and odd sums of wells that mirror each other.
    """
    single = np.eye(wells)
    if not mirrored:
        return np.array([np.ones(wells), *single[:-1]]), [False] * wells
    pairs = [(single[w], single[wells - 1 - w]) for w in range((wells + 1) // 2)]
    even = [np.ones(wells), *(np.maximum(a, b) for a, b in pairs[1:])]
    odd = [a - b for a, b in pairs[: wells // 2]]
    return np.array([*even, *odd]), [False] * len(even) + [True] * len(odd)


def _last_in_cores(propagator, cores, weights, guess, solution):
    """The mass q that was last in some cores, with a weight for each, by GMRES.

    So many steps at a time, about a period: what has turned round is then where it was. It starts
    from the mass between the saddles beside each core, `guess` along X. None if it was not reached.
    """
    p, steps = solution.before_flow, solution.steps
    outside = (1.0 - cores.sum(axis=0))[:, None, None, :]
    source = np.tensordot(weights, cores, 1)[:, None, None, :] * p
    start = guess[:, None, None, None] * p

    def later(state, added):
        for _ in range(steps):
            state = outside * propagator.step(state) + added
        return state

    operator = LinearOperator(
        (p.size, p.size),
        matvec=lambda flat: flat - later(flat.reshape(p.shape), 0.0).ravel(),
        dtype=float,
    )
    right = later(np.zeros(p.shape), source).ravel()
    vectors = int(min(MOST_VECTORS, MOST_WORK / solution.cost))
    if vectors == 0:
        return None
    found, failed = gmres(operator, right, start.ravel(), rtol=REACHED, restart=vectors, maxiter=1)
    return None if failed else found.reshape(p.shape)
