"""How often motion passes between wells, how long it stays, and which well holds all of it.

Where jumps are rare, no grid tells their rates, far below what nodes share wrongly, and none is
needed: of two wells alike each holds half, and of others the one that motion leaves the least
often holds all.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs, gmres

from harvester.averaging.propagator import Propagator
from harvester.device import timescales
from harvester.device.cores import core_energies, jump_rates
from harvester.device.system import loss_power, potential

if TYPE_CHECKING:
    from harvester.averaging.grid_density import GridDensity
    from harvester.averaging.propagator import Grid
    from harvester.averaging.solution import Solution
    from harvester.device.system import System

# Of an eigenvalue, as a share of it; and of the saddles' crossings in a period, by about which the
# eigenvalue of rare jumps differs from 1.
EIGENVALUE_TOLERANCE, CROSSINGS_TOLERANCE = 1e-4, 1e-2
LEAST_VECTORS = 20  # of Arnoldi's method, between two restarts
# Of the mass in the cores, as a share: left to be found, for rare jumps; and the most vectors.
REACHED, MOST_VECTORS = 1e-6, 200
MOST_WORK = 1e8  # vectors times steps times the amplitudes of a state
HELD_BACK = 16.0  # E[X'²] in a barrier that hardly any motion passes
# Share of the exponent of the rate of jumps out of a well that is sure, and by how much that is
# above the exponent of any other: the time in the other is then below exp(−6) of the whole.
SURE_SHARE, LEAST_LEAD = 0.8, 6.0
ENERGIES, PLACES = 24, 201  # of orbits, and along each, that tell that exponent

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


def slowest_decay_rate(solution: Solution) -> dict[str, float]:
    """Rate at which the last memory of the well, or of the charge it left, decays (1/s).

    Of two wells that exchange mass at the rates k12 and k21, faster than nothing else decays, it is
    k12 + k21. On a mirrored grid this is an odd state. Empty where it takes too many steps.
    """
    grid, steps = solution.grid, solution.steps
    propagator = Propagator(solution.task.device, grid)
    if grid.mirrored:
        propagator = propagator.odd()
    start = solution.before_flow * grid.x[:, None, None, None]
    operator = LinearOperator(
        (start.size, start.size),
        matvec=lambda flat: propagator.repeated(flat.reshape(start.shape), steps).ravel(),
        dtype=float,
    )
    wanted = 1 if grid.mirrored else 2
    crossings = solution.means["well_crossing_rate"] * steps * grid.step
    vectors = int(min(MOST_VECTORS, MOST_WORK / solution.cost))
    if vectors < LEAST_VECTORS:
        return {}
    try:
        values = eigs(
            operator,
            k=wanted,
            v0=start.ravel(),
            ncv=LEAST_VECTORS,
            maxiter=vectors // LEAST_VECTORS,
            tol=min(EIGENVALUE_TOLERANCE, CROSSINGS_TOLERANCE * crossings),
            return_eigenvectors=False,
        )
    except ArpackNoConvergence:
        return {}
    # All but the stationary state's own.
    slowest = np.sort(np.abs(values))[0]
    return {"slowest_decay_rate": float(-np.log(slowest) / (steps * grid.step))}


def rates_of_jumps(solution: Solution) -> dict[str, float]:
    """Rates of jumps from one well's core to another's, as Monte Carlo counts them (1/s).

    The stationary mass p is divided by the well whose core it was in last: q_w, which obeys
    q_w = outside · P q_w + core_w · p for a step P. What P q_w has in another core has jumped.
    Empty where it takes too many steps.
    """
    grid, device = solution.grid, solution.task.device
    cores = _shares_in_cores(device, grid)
    sides = _well_at(device, grid.x) == np.arange(len(cores))[:, None]
    combinations, odd = _combinations(len(cores), grid.mirrored)
    exact, held, moved = Propagator(device, grid), [], []
    for weights, is_odd in zip(combinations, odd, strict=True):
        propagator = exact.odd() if is_odd else exact
        found = _last_in_cores(propagator, cores, weights, weights @ sides, solution)
        if found is None:
            return {}
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
    found, failed = gmres(operator, right, start.ravel(), rtol=REACHED, restart=vectors, maxiter=1)
    return None if failed else found.reshape(p.shape)


def lone_well(device: System) -> float | None:
    """The well that may hold all motion, or one of two alike; None where several share it."""
    wells = timescales.wells(device)
    if len(wells) < 2:
        return None
    well = max(wells, key=lambda well: barrier(device, well) / driven(device, well))
    alike = (well, -well) if device.symmetric else (well,)
    others = [x for x in wells if not np.isclose(x, alike).any()]
    if not others:
        return well
    if barrier(device, well) < HELD_BACK * driven(device, well):
        return None
    sure = SURE_SHARE * _exponent(device, well)
    return well if all(sure > LEAST_LEAD + _exponent(device, x) for x in others) else None


def driven(device: System, well: float) -> float:
    """E[X'²] of small oscillations about a well."""
    frequency = timescales.well_frequency(device, well)
    return timescales.driven_square_velocity(device, frequency)


def barrier(device: System, well: float) -> float:
    """Energy from a well over the lowest saddle beside it, a slow charge staying behind."""
    rate, coupling = device.transducer.decay_rate(), getattr(device.transducer, "coupling", 0.0)
    frequency = timescales.well_frequency(device, well)
    held = 0.5 * coupling / (1.0 + (2.0 * rate / frequency) ** 2)
    bottom = float(potential(device, well))
    return min(
        float(potential(device, saddle)) - bottom + held * (saddle - well) ** 2
        for saddle in timescales.beside(device, well)
    )


def _exponent(device, well):
    """∫ dH/T(H) up to the saddle, T the power of the noise over the rate of loss on the orbit H.

    The rate of jumps of weakly damped motion falls as exp(−∫ dH/T) (Eqs. 20–25).
    """
    height = timescales.barrier(device, well)
    energies = height * (np.arange(ENERGIES) + 0.5) / ENERGIES
    x = np.linspace(*_ends(device, well, height), PLACES)
    above = energies[:, None] - (potential(device, x) - float(potential(device, well)))
    v = np.sqrt(2.0 * np.maximum(above, 0.0))
    # Of what is lost at X' the integral over time is that of loss/X' over X, both ways.
    lost = np.vectorize(lambda x, v: loss_power(device, x, v, 0.0, True))(x, v)
    action = 2.0 * np.trapezoid(v, x)
    loss = 2.0 * np.trapezoid(lost / np.maximum(v, np.finfo(float).tiny), x)
    frequency = 2.0 * np.pi / np.gradient(action, energies)
    rate = loss / action + [device.transducer.loss_rate(each) for each in frequency]
    intensity, memory = device.noise
    return float(np.mean(rate * (1.0 + (frequency * memory) ** 2))) * height / intensity


def _ends(device, well, height):
    """Displacements between which a well's orbits below its lower saddle lie."""
    ends = []
    saddles = timescales.beside(device, well)
    for side in (-1.0, 1.0):
        found = [x for x in saddles if side * (x - well) > 0.0]
        end = found[0] if found else well + side * min(abs(x - well) for x in saddles)
        while not found and potential(device, end) < potential(device, well) + height:
            end += 0.2 * (end - well)
        ends.append(end)
    return ends
