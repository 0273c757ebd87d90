"""Windows of multiple shooting: joined while errors stay small in them, split where they do not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harvester.identification.shooting import Fit, Shooting

# By what an error at the start of a window may grow within it.
LARGEST_GROWTH = 5.0
# Samples in the shortest window, for three unknown states.
FEWEST_SAMPLES = 12


def equal_windows(samples: int, width: float) -> np.ndarray:
    """Edges of equal windows of about so many samples, from the beginning to the end."""
    count = max(1, round(samples / max(width, FEWEST_SAMPLES)))
    return np.unique(np.linspace(0, samples, count + 1).round().astype(int))


def lengthened(fit: Fit, most: Sequence[int]) -> Fit | None:
    """The fit with neighbouring windows joined as far as errors stay small; None: none can be.

    Parameters
    ----------
    fit : Fit
        Linearized.
    most : sequence of int
        Samples in a window at most, by experiment.
    """
    edges, starts, joined = [], [], False
    for number, old in enumerate(fit.edges):
        kept = _kept(fit.transitions[number], fit.growth[number], old, most[number])
        joined |= kept.size < old.size - 1
        edges.append(np.append(old[kept], old[-1]))
        starts.append(fit.starts[number][kept])
    return Fit(fit.values, edges, starts, fit.noise) if joined else None


def _kept(transitions, growth, edges, most):
    """Numbers of the windows at which joined ones begin."""
    kept, total = [0], transitions[0]
    for window in range(1, len(transitions)):
        grown = growth[window] * np.linalg.norm(total, 2)
        long = edges[window + 1] - edges[kept[-1]] > most
        if long or not grown <= LARGEST_GROWTH:
            kept.append(window)
            total = transitions[window]
        else:
            total = transitions[window] @ total
    return np.array(kept)


def shortened(shooting: Shooting, fit: Fit, where: Sequence[np.ndarray]) -> Fit:
    """The fit with some windows cut in half, the second half beginning where the first ends.

    Parameters
    ----------
    shooting : Shooting
    fit : Fit
    where : sequence of ndarray of bool
        The windows to cut, by experiment.
    """
    edges, starts = [], []
    for number, old in enumerate(fit.edges):
        states, _, _ = shooting.responses.states(number, fit.values, old, fit.starts[number])
        cut = where[number] & (np.diff(old) >= 2 * FEWEST_SAMPLES)
        middles = ((old[:-1] + old[1:]) // 2)[cut]
        new = np.concatenate([old[:-1], middles])
        order = np.argsort(new, kind="stable")
        begun = np.concatenate([fit.starts[number], states[middles - old[0]]])
        edges.append(np.append(new[order], old[-1]))
        starts.append(begun[order])
    return Fit(fit.values, edges, starts, fit.noise)
