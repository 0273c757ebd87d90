"""Windows of multiple shooting: joined while errors stay small in them, split where they do not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harvester.identification.shooting import Fit, Shooting

# Windows are joined while an error of the start grows at most by the first factor, and one that
# arises within the window by the second.
LARGEST_GROWTH, LARGEST_GROWTH_WITHIN = 5.0, 1000.0
# Samples in the shortest window, which must determine three states.
FEWEST_SAMPLES = 12


def equal_windows(samples: int, width: float) -> np.ndarray:
    """Edges of equal windows of about so many samples, from the beginning to the end."""
    count = max(1, round(samples / max(width, FEWEST_SAMPLES)))
    return np.unique(np.linspace(0, samples, count + 1).round().astype(int))


def lengthened(fit: Fit, short: Fit, most: Sequence[int]) -> Fit | None:
    """The fit with neighbouring windows joined as long as errors stay small; None if none can be.

    Parameters
    ----------
    fit, short : Fit
        `short` is the same motion in the shortest windows, linearized.
    most : sequence of int
        Samples in a window at most, by experiment.
    """
    edges, starts, joined = [], [], False
    if not short.grams:
        return None
    for number, old in enumerate(short.edges):
        first_windows = _kept(short.transitions[number], short.growth[number], old, most[number])
        joined |= first_windows.size < len(fit.starts[number])
        edges.append(np.append(old[first_windows], old[-1]))
        starts.append(short.starts[number][first_windows])
    return Fit(fit.values, edges, starts, fit.noise) if joined else None


def _kept(transitions, growth, edges, most):
    """Indices of the windows at which the joined windows begin.

    An error of the start may decay, and one from an inexact value may still grow later. So `totals`
    holds the transition matrices from the start and from all places whose errors grow.
    """
    first_windows, totals = [0], transitions[:1]
    for window in range(1, len(transitions)):
        sizes = np.linalg.norm(totals, 2, axis=(1, 2)) * growth[window]
        small = sizes[0] <= LARGEST_GROWTH and sizes.max() <= LARGEST_GROWTH_WITHIN
        if not small or edges[window + 1] - edges[first_windows[-1]] > most:
            first_windows.append(window)
            totals = transitions[window : window + 1]
        else:
            totals = transitions[window] @ np.concatenate([totals, np.eye(3)[None]])
            grows = np.linalg.norm(totals, 2, axis=(1, 2)) > 1.0
            grows[0] = True
            totals = totals[grows]
    return np.array(first_windows)


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
