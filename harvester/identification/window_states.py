"""States at the beginnings of windows, the device's numbers being as they are.

A voltage determines velocity and charge, but not the well in which the mass is: displacements are
tried.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from harvester.identification.reconstruction import motion
from harvester.identification.response import side_by_side
from harvester.identification.shooting import DIFFERENCE, Shooting, ShootingFit

if TYPE_CHECKING:
    from harvester.identification.reconstruction import Motion

DISPLACEMENTS = 15
# Number of displacements per window, the best of those tried, from which its states are fitted.
MOST_TRIED = 2
ITERATIONS = 8
# A window's fit ends when a step promises to lower its cost by less than this share.
SETTLED = 1e-4


def weighted_residuals(
    shooting: Shooting, number: int, fit: ShootingFit, starts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Weighted residuals of windows with these starts, and each window's sum of squares.

    Where a solution runs away residuals are 0, and the sum is inf.
    """
    edges = fit.edges[number]
    _, _, outputs = shooting.responses.states(number, fit.values, edges, starts)
    if outputs is None:
        outputs = np.nan
    residuals = (outputs - shooting.seen(number, edges)) / fit.noise[number]
    costs = np.add.reduceat(np.sum(residuals**2, axis=1), edges[:-1] - edges[0])
    costs[~np.isfinite(costs)] = np.inf
    return np.nan_to_num(residuals, posinf=0.0, neginf=0.0), costs


def settled(
    shooting: Shooting,
    number: int,
    fit: ShootingFit,
    starts: np.ndarray,
    iterations: int = ITERATIONS,
) -> tuple[np.ndarray, np.ndarray]:
    """Starts at the minimum of each window's own cost, and those costs.

    Windows whose starts are NaN stay as they are.
    """
    sizes, lengths = shooting.state_sizes[number], np.diff(fit.edges[number])
    residuals, costs = weighted_residuals(shooting, number, fit, starts)
    damping = np.full(len(starts), 1e-2)
    moving = np.isfinite(starts).all(axis=1)
    for _ in range(iterations):
        begun = np.where(moving[:, None], starts, np.nan)
        step, promised = _step(shooting, number, fit, begun, residuals, damping)
        trial = begun + step * sizes
        trial_residuals, tried = weighted_residuals(shooting, number, fit, trial)
        better = tried < costs
        starts = np.where(better[:, None], trial, starts)
        residuals = np.where(np.repeat(better, lengths)[:, None], trial_residuals, residuals)
        moving &= promised > SETTLED * costs
        costs = np.where(better, tried, costs)
        damping = np.where(better, 0.1 * damping, np.minimum(10.0 * damping, 1e6))
        if not moving.any():
            break
    return starts, costs


def _step(shooting, number, fit, starts, residuals, damping):
    """Damped step of each window's start, in sizes, and the least decrease of the cost expected."""
    sizes = shooting.state_sizes[number]
    columns = np.zeros((*residuals.shape, 3))

    def of_state(k):
        moved = starts.copy()
        moved[:, k] += DIFFERENCE * sizes[k]
        shifted, _ = weighted_residuals(shooting, number, fit, moved)
        columns[..., k] = (shifted - residuals) / DIFFERENCE

    side_by_side(of_state, np.flatnonzero(shooting.states_there[number]))
    cuts = fit.edges[number][:-1] - fit.edges[number][0]
    normal = np.add.reduceat(np.einsum("nok,nol->nkl", columns, columns), cuts, axis=0)
    gradient = np.add.reduceat(np.einsum("nok,no->nk", columns, residuals), cuts, axis=0)
    diagonal = np.einsum("wii->wi", normal)
    ridge = damping[:, None] * diagonal + 1e-9 * diagonal.max(axis=1, keepdims=True) + 1e-300
    normal[:, range(3), range(3)] += ridge
    step = -np.linalg.solve(normal, gradient[..., None])[..., 0]
    return step, -np.einsum("wk,wk->w", gradient, step)


def placed(
    shooting: Shooting, number: int, fit: ShootingFit, where: np.ndarray, reach: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """The best starts with the displacement anywhere within reach, settled, and their costs.

    Parameters
    ----------
    where : ndarray of bool, shape (windows,)
        Windows to look at; the others' starts are NaN.
    reach : (float, float)
        Least and greatest displacement.
    """
    responses = shooting.responses
    system, scales = responses.known_device(number, fit.values)
    seen = motion(system, scales, responses.shown(number, fit.values))
    places = fit.edges[number][:-1]
    states = np.where(where[:, None], states_of(seen, places), np.nan)
    if seen.measured:
        return settled(shooting, number, fit, states)

    def begun_at(x):
        return np.column_stack([np.where(where, x, np.nan), states[:, 1:]])

    tried = np.linspace(*reach, DISPLACEMENTS)
    costs = side_by_side(lambda x: weighted_residuals(shooting, number, fit, begun_at(x))[1], tried)
    order = np.argsort(costs, axis=0)
    best = states, np.full(places.size, np.inf)
    for rank in range(MOST_TRIED):
        best = _better(best, settled(shooting, number, fit, begun_at(tried[order[rank]])))
    return best


def repaired(
    shooting: Shooting, fit: ShootingFit, where: Sequence[np.ndarray]
) -> tuple[ShootingFit, list[np.ndarray]]:
    """The fit with some windows' starts at the best places that can be found for them.

    Parameters
    ----------
    where : sequence of ndarray of bool, shape (windows,)
        Which windows of each experiment are repaired.

    Returns
    -------
    ShootingFit
    list of ndarray, shape (windows,)
        Each window's sum of squares.
    """
    starts, sums = [], []
    for number, chosen in enumerate(where):
        current = fit.starts[number]
        best = current, weighted_residuals(shooting, number, fit, current)[1]
        begun = np.where(chosen[:, None], current, np.nan)
        best = _better(best, settled(shooting, number, fit, begun, ITERATIONS // 2))
        current = best[0]
        states, ends, _ = shooting.responses.states(number, fit.values, fit.edges[number], current)
        if np.isfinite(states[:, 0]).any():
            reach = reach_of(states[:, 0])
            best = _better(best, placed(shooting, number, fit, chosen, reach))
            before = np.vstack([current[:1], ends[:-1]])
            begun = np.where(chosen[:, None] & np.isfinite(before), before, begun)
            best = _better(best, settled(shooting, number, fit, begun))
        starts.append(best[0])
        sums.append(best[1])
    return ShootingFit(fit.values, fit.edges, starts, fit.noise), sums


def _better(own, other):
    """The better (starts, costs) of two, for each window."""
    better = other[1] < own[1]
    return np.where(better[:, None], other[0], own[0]), np.where(better, other[1], own[1])


def reach_of(x: np.ndarray) -> tuple[float, float]:
    """Range of displacements to search: from the 1 % to the 99 % quantile, and a tenth beyond."""
    low, high = np.nanquantile(x, [0.01, 0.99])
    margin = 0.1 * (high - low)
    return float(low - margin), float(high + margin)


def without_states(series: np.ndarray, states: np.ndarray, cuts: np.ndarray) -> np.ndarray:
    """Series less what the starts of their windows explain.

    Parameters
    ----------
    series : ndarray, shape (samples, outputs, n)
    states : ndarray, shape (samples, outputs, states)
        Outputs' derivatives by the start of the window that a sample is in.
    cuts : ndarray of int, shape (windows + 1,)
    """
    remainder = series.copy()
    for begin, end in pairwise(cuts):
        effects = states[begin:end].reshape(-1, states.shape[-1])
        effects = effects[:, np.abs(effects).max(axis=0) > 0.0]
        block = series[begin:end].reshape(effects.shape[0], -1)
        explained = effects @ np.linalg.lstsq(effects, block, rcond=1e-10)[0]
        remainder[begin:end] = (block - explained).reshape(remainder[begin:end].shape)
    return remainder


def states_of(seen: Motion, places: np.ndarray) -> np.ndarray:
    """A motion's states at some samples, shape (places, 3)."""
    return np.column_stack([seen.x[places], seen.v[places], seen.state[places]])
