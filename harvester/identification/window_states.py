"""States at the beginnings of windows, the device's numbers being as they are.

A voltage tells velocity and charge, but not in which well the mass is: displacements are tried.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from harvester.identification.reconstruction import motion
from harvester.identification.shooting import DIFFERENCE, Fit, Shooting

if TYPE_CHECKING:
    from harvester.identification.reconstruction import Motion

DISPLACEMENTS = 15
# Of all displacements tried in a window, those whose states are fitted.
MOST_TRIED = 2
ITERATIONS = 8


def window_costs(shooting: Shooting, number: int, fit: Fit, starts: np.ndarray) -> np.ndarray:
    """Sum of squares of each window with these starts; inf where a solution runs away."""
    edges, noise = fit.edges[number], fit.noise[number]
    _, _, outputs = shooting.responses.states(number, fit.values, edges, starts)
    if outputs is None:
        return np.full(len(starts), np.inf)
    found = (outputs - shooting.seen(number, edges)) / noise
    squares = np.sum(found**2, axis=1)
    costs = np.add.reduceat(squares, edges[:-1] - edges[0])
    return np.where(np.isfinite(costs), costs, np.inf)


def settled(
    shooting: Shooting, number: int, fit: Fit, starts: np.ndarray, iterations: int = ITERATIONS
) -> tuple[np.ndarray, np.ndarray]:
    """Starts at the minimum of each window's own cost, and those costs."""
    sizes, there = shooting.state_sizes[number], shooting.states_there[number]
    edges, noise = fit.edges[number], fit.noise[number]
    cuts = edges[:-1] - edges[0]
    costs = window_costs(shooting, number, fit, starts)
    damping = np.full(len(starts), 1e-2)

    def weighted(begun):
        _, _, outputs = shooting.responses.states(number, fit.values, edges, begun)
        return np.nan_to_num((outputs - shooting.seen(number, edges)) / noise, posinf=0, neginf=0)

    for _ in range(iterations):
        base = weighted(starts)
        columns = np.zeros((*base.shape, 3))
        for k in np.flatnonzero(there):
            moved = starts.copy()
            moved[:, k] += DIFFERENCE * sizes[k]
            columns[..., k] = (weighted(moved) - base) / DIFFERENCE
        products = np.einsum("nok,nol->nkl", columns, columns)
        normal = np.add.reduceat(products, cuts, axis=0)
        gradient = np.add.reduceat(np.einsum("nok,no->nk", columns, base), cuts, axis=0)
        diagonal = np.einsum("wii->wi", normal)
        ridge = damping[:, None] * diagonal + 1e-9 * diagonal.max(axis=1, keepdims=True) + 1e-300
        normal[:, range(3), range(3)] += ridge
        step = -np.linalg.solve(normal, gradient[..., None])[..., 0]
        trial = starts + step * sizes
        tried = window_costs(shooting, number, fit, trial)
        better = tried < costs
        done = np.all(~better | (costs - tried < 1e-4 * costs))
        starts = np.where(better[:, None], trial, starts)
        costs = np.where(better, tried, costs)
        damping = np.where(better, 0.1 * damping, np.minimum(10.0 * damping, 1e6))
        if done and not (damping < 1.0).all():
            break
    return starts, costs


def measured_motion(shooting: Shooting, number: int, values: np.ndarray) -> Motion:
    """The motion that a record shows if the device has these numbers."""
    system, scales = shooting.responses.known_device(number, values)
    return motion(system, scales, shooting.responses.experiments[number].measurement)


def placed(
    shooting: Shooting, number: int, fit: Fit, seen: Motion, reach: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """The best starts with the displacement anywhere within reach, settled, and their costs."""
    places = fit.edges[number][:-1]
    known = states_of(seen, places)
    if seen.measured:
        return settled(shooting, number, fit, known)
    tried, costs = [], []
    for x in np.linspace(*reach, DISPLACEMENTS):
        begun = known.copy()
        begun[:, 0] = x
        tried.append(begun)
        costs.append(window_costs(shooting, number, fit, begun))
    order = np.argsort(costs, axis=0)
    best, least = known, np.full(places.size, np.inf)
    for rank in range(MOST_TRIED):
        begun = np.array(tried)[order[rank], np.arange(places.size)]
        found, cost = settled(shooting, number, fit, begun)
        better = cost < least
        best, least = np.where(better[:, None], found, best), np.where(better, cost, least)
    return best, least


def repaired(shooting: Shooting, fit: Fit) -> Fit:
    """The fit with each window's start at the best place that can be found for it."""
    starts = []
    for number, edges in enumerate(fit.edges):
        own, costs = settled(shooting, number, fit, fit.starts[number], ITERATIONS // 2)
        states, ends, _ = shooting.responses.states(number, fit.values, edges, own)
        if np.isfinite(states[:, 0]).any():
            reach = reach_of(states[:, 0])
            seen = measured_motion(shooting, number, fit.values)
            other, other_costs = placed(shooting, number, fit, seen, reach)
            going_on = np.vstack([own[:1], np.where(np.isfinite(ends[:-1]), ends[:-1], own[1:])])
            last, last_costs = settled(shooting, number, fit, going_on)
            for found, cost in ((other, other_costs), (last, last_costs)):
                better = cost < costs
                own = np.where(better[:, None], found, own)
                costs = np.where(better, cost, costs)
        starts.append(own)
    return Fit(fit.values, fit.edges, starts, fit.noise)


def reach_of(x: np.ndarray) -> tuple[float, float]:
    """A little more than where the mass mostly was."""
    low, high = np.nanquantile(x, [0.01, 0.99])
    more = 0.1 * (high - low)
    return float(low - more), float(high + more)


def states_of(seen: Motion, places: np.ndarray) -> np.ndarray:
    """A motion's states at some samples, shape (places, 3)."""
    return np.column_stack([seen.x[places], seen.v[places], seen.state[places]])
