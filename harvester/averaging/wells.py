"""How often motion passes between wells, how long it stays, and how fast it forgets."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

from harvester.averaging.propagator import Propagator
from harvester.device import timescales

if TYPE_CHECKING:
    from harvester.averaging.fokker_planck import Solution
    from harvester.averaging.grid_density import GridDensity
    from harvester.device.system import System

SETTLED = 1e-4  # of an eigenvalue, as a share of it
LEAST_VECTORS, MOST_VECTORS = 20, 200  # of Arnoldi's method
MOST_WORK = 1e8  # vectors times steps times the amplitudes of a state


def between_wells(device: System, density: GridDensity) -> dict[str, float]:
    """Rate of crossings of all saddles, and shares of time from the left; empty for one well.

    The rate is the flux Σ ∫ |X'| p(saddle, X') dX', both ways, as Monte Carlo counts it; shares
    are given where symmetry does not tell them. Empty as well where a density holds one well alone.
    """
    saddles = sorted(timescales.saddles(device))
    if not saddles or density.paired:
        return {}
    v = density.v
    flux = sum(float(density.joint(x, v) @ np.abs(v)) * (v[1] - v[0]) for x in saddles)
    answer = {"well_crossing_rate": flux}
    if len(saddles) > 1 or not device.symmetric:
        shares = np.diff([0.0, *(density.below(x) for x in saddles), density.below(np.inf)])
        for number, share in enumerate(shares / shares.sum(), start=1):
            answer[f"share_of_time_in_well_{number}"] = float(share)
    return answer


def slowest_decay_rate(device: System, solution: Solution) -> float | None:
    """Rate at which the last memory of the well, or of the charge it left, decays (1/s).

    Of two wells that exchange mass at the rates k12 and k21, faster than nothing else decays, it is
    k12 + k21. On a mirrored grid this is an odd state. None where it takes too many steps.
    """
    grid, steps = solution.grid, solution.steps
    propagator = Propagator(device, grid, odd=True) if grid.mirrored else solution.propagator
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
            tol=SETTLED,
            return_eigenvectors=False,
        )
    except ArpackNoConvergence:
        return None
    # All but the stationary state's own.
    slowest = np.sort(np.abs(values))[0]
    return float(-np.log(slowest) / (steps * grid.step))
