"""Fit from several starts: first with short windows, then with longer ones from the best.

The starts of windows whose motion was not measured are searched, each window on its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from harvester.identification.linear_start import motion, starts_from
from harvester.identification.response import side_by_side
from harvester.identification.shooting import Shooting, ShootingFit, grams_of, state_inverse

if TYPE_CHECKING:
    from harvester.identification.measurement import Measurement

SHORT_PERIODS = 2.0
# Maximum number of iterations: with the first short windows, at each longer length, and in the last
# fit.
FIRST, ON_THE_WAY, LAST = 12, 6, 40
# A fit ends if a step would lower its cost by less than this share: COARSE, except FINE in the last
# fit.
COARSE, FINE = 1e-3, 1e-6
# Maximum number of windows of the first fit.
MOST_FIRST_WINDOWS = 2000
# A window's start is doubtful if the mean square of its residuals exceeds this multiple of the
# median.
DOUBTFUL = 4.0
# Maximum number of rounds in which doubtful windows get new starts.
MENDINGS = 4
# A fit is abandoned if its cost exceeds this multiple of a rival model's cost.
HOPELESS = 1.25
# Windows are joined while the error of a start grows at most by the first factor, and an error that
# arises in a window by the second.
LARGEST_GROWTH, LARGEST_GROWTH_WITHIN = 5.0, 1000.0
# Progress at which all starts have been tried, and at which the windows are long.
STARTS_SHARE, WINDOWS_SHARE = 0.4, 0.8
# Number of samples in the shortest window, which must determine three states.
FEWEST_SAMPLES = 12


def searched(
    problem: Shooting, lengths: Sequence[int], follow: Callable[[float], object]
) -> tuple[Shooting, ShootingFit] | None:
    """The best fit; None if no start leads to one.

    Parameters
    ----------
    lengths : sequence of int
        Number of samples of each experiment, from its beginning, that are fitted.
    follow : callable
        Function of the completed share.
    """
    best, starts = None, starts_from(problem)
    for number, start in enumerate(starts):
        follow(STARTS_SHARE * number / len(starts))
        tried = _short(problem, start, lengths)
        if tried and (best is None or tried[1].cost < best[1].cost):
            best = tried
    if best is None:
        return None
    shooting, fit = best
    most = np.array(lengths)

    def follow_windows(longest: np.ndarray) -> None:
        # Windows double in length, up to the record's length.
        done = 1.0 - float(np.max(np.log2(most / longest) / np.log2(most)))
        follow(STARTS_SHARE + (WINDOWS_SHARE - STARTS_SHARE) * done)

    fit = followed(shooting, fit, follow=follow_windows)
    return (shooting, fit) if fit.grams else None


def _short(problem, start, lengths):
    """A fit with short windows."""
    sizes = [
        np.array([np.std(path.x), np.std(path.v), np.std(path.state)]) for path in start.motions
    ]
    sized = [
        unknown.begun(float(value))
        for unknown, value in zip(problem.unknowns, start.values, strict=True)
    ]
    shooting = replace(problem, unknowns=sized, state_sizes=sizes)
    records = [record.measurement for record in problem.experiments]
    edges = [
        short_windows(record, 0, length) for record, length in zip(records, lengths, strict=True)
    ]
    begun = [path.states(cut[:-1]) for path, cut in zip(start.motions, edges, strict=True)]
    noise = [record.assumed_noise for record in records]
    everywhere = [np.ones(len(states), bool) for states in begun]
    fit, _ = repaired(shooting, ShootingFit(start.values.copy(), edges, begun, noise), everywhere)
    fit = shooting.minimized(fit, FIRST, COARSE)
    return (shooting, fit) if fit.grams else None


def followed(
    shooting: Shooting,
    fit: ShootingFit,
    rival: float = np.inf,
    follow: Callable[[np.ndarray], object] = lambda longest: None,
) -> ShootingFit:
    """Continue a fit with windows that double in length while errors in them stay small.

    Longer windows do not improve a fit, so a hopeless fit keeps its short windows.

    Parameters
    ----------
    fit : ShootingFit
        A linearized fit with short windows.
    rival : float
        Cost of a rival model.
    follow : callable, optional
        Function of the number of samples in each experiment's longest window.
    """
    fit = refit_doubtful(shooting, fit)
    most, hopeless = _longest(fit), HOPELESS * rival
    # The loop continues while a window is longer than previously allowed.
    while fit.cost < hopeless and (2 * _longest(fit) > most).any():
        most = 2 * most
        follow(_longest(fit))
        short = split_windows(shooting, fit)
        # The linearization is with respect to the windows' starts alone.
        replace(shooting, fixed=True).linearized(short)
        longer = lengthened(fit, short, most)
        if longer is None:
            continue
        longer = shooting.minimized(longer, ON_THE_WAY, COARSE)
        if not longer.grams:
            break
        fit = refit_doubtful(shooting, longer)
    for _ in range(MENDINGS):
        if not fit.cost < hopeless or not any(doubtful.any() for doubtful in _doubtful(fit)):
            break
        fit = refit_doubtful(shooting, fit)
    if not fit.cost < hopeless:
        return fit
    return shooting.minimized(shooting.reweighted(fit), ON_THE_WAY, FINE)


def _longest(fit):
    """Number of samples in each experiment's longest window."""
    return np.array([np.diff(edges).max() for edges in fit.edges])


def in_short_windows(
    shooting: Shooting,
    fit: ShootingFit,
    stretches: Sequence[tuple[int, int]],
    reach: tuple[float, float] | None = None,
) -> ShootingFit:
    """Shortest windows in other parts of the records, with the starts that fit best.

    Parameters
    ----------
    fit : ShootingFit
        The fit with the values and the noise.
    stretches : sequence of (int, int)
        First sample of the part of each experiment, or of the first ones, and the sample after its
        last one.
    reach : (float, float), optional
        Displacements in which the mass is searched; by default the range of the fitted motion.
    """
    experiments = shooting.experiments
    edges = [
        short_windows(experiment.measurement, first, last)
        for experiment, (first, last) in zip(experiments, stretches, strict=False)
    ]
    begun = ShootingFit(fit.values, edges, [], fit.noise[: len(edges)])
    for number, cut in enumerate(edges):
        everywhere = np.ones(cut.size - 1, bool)
        span = reach or reach_of(shooting.states(fit, number)[:, 0])
        begun.starts.append(placed(shooting, number, begun, everywhere, span)[0])
    return begun


def short_windows(measurement: Measurement, first: int, last: int) -> np.ndarray:
    """Edges of the shortest windows between two samples."""
    period = measurement.sampling_rate / measurement.frequencies[0]
    width = max(SHORT_PERIODS * period, (last - first) / MOST_FIRST_WINDOWS)
    count = max(1, round((last - first) / max(width, FEWEST_SAMPLES)))
    return first + np.unique(np.linspace(0, last - first, count + 1).round().astype(int))


def split_windows(shooting: Shooting, fit: ShootingFit) -> ShootingFit:
    """The fit divided into the shortest windows, whose starts are on its motion."""
    records = [record.measurement for record in shooting.experiments]
    return _divided(
        shooting,
        fit,
        [
            np.union1d(old, short_windows(record, old[0], old[-1]))
            for record, old in zip(records, fit.edges, strict=False)
        ],
    )


def _divided(shooting, fit, edges):
    """The fit with further edges of windows, whose starts are on its motion."""
    paths = (shooting.states(fit, number) for number in range(len(edges)))
    starts = [path[cut[:-1] - cut[0]] for path, cut in zip(paths, edges, strict=True)]
    return ShootingFit(fit.values, edges, starts, fit.noise)


def restarted(shooting: Shooting, begun: ShootingFit, rival: float) -> ShootingFit | None:
    """Restart a fit in short windows and complete it; None if no motion fits the records."""
    fit = shooting.minimized(begun, ON_THE_WAY, COARSE)
    if fit.grams:
        fit = followed(shooting, fit, rival)
    return fit if fit.grams else None


def refit_doubtful(shooting: Shooting, fit: ShootingFit) -> ShootingFit:
    """The fit with better starts of doubtful windows, or with these divided in half.

    Windows in which an error of the start grows beyond the limit are also divided. Returns the same
    fit if no window is doubtful or no better fit is found.
    """
    better, cut = fit, _doubtful(fit)
    if any(windows.any() for windows in cut):
        better, sums = repaired(shooting, fit, cut)
        cut = _doubtful(fit, sums)
    cut = [
        doubtful | (growth > 2.0 * LARGEST_GROWTH)
        for doubtful, growth in zip(cut, fit.growth, strict=True)
    ]
    if any(windows.any() for windows in cut):
        halves = []
        for old, where in zip(better.edges, cut, strict=True):
            long = np.diff(old) >= 2 * FEWEST_SAMPLES
            halves.append(np.union1d(old, ((old[:-1] + old[1:]) // 2)[where & long]))
        better = _divided(shooting, better, halves)
    if better is not fit:
        better = shooting.minimized(better, ON_THE_WAY, COARSE)
    return better if better.grams else fit


def _doubtful(fit, sums=None):
    """Windows whose residuals are far larger than the others'.

    `sums`: the windows' sums of squares, by default from the fit.
    """
    sums = sums or [grams[:, -1, -1] for grams in fit.grams]
    means = [part / np.diff(edges) for part, edges in zip(sums, fit.edges, strict=True)]
    return [part > DOUBTFUL * np.median(part) for part in means]


def lengthened(fit: ShootingFit, short: ShootingFit, most: Sequence[int]) -> ShootingFit | None:
    """Join neighbouring windows while errors stay small; return None if none can be joined.

    Parameters
    ----------
    fit, short : ShootingFit
        `short` is the same motion in the shortest windows, linearized.
    most : sequence of int
        Maximum number of samples per window, by experiment.
    """
    if not short.grams:
        return None
    parts = zip(short.transitions, short.growth, short.edges, most, strict=True)
    begins = [_window_begins(*part) for part in parts]
    if all(begin.size >= len(starts) for begin, starts in zip(begins, fit.starts, strict=True)):
        return None
    edges = [np.append(old[at], old[-1]) for at, old in zip(begins, short.edges, strict=True)]
    starts = [states[at] for at, states in zip(begins, short.starts, strict=True)]
    return ShootingFit(fit.values, edges, starts, fit.noise)


def _window_begins(transitions, growth, edges, most):
    """Indices of the windows at which the joined windows start.

    An error of the start may decay while an error from an inexact value grows later. Therefore
    `totals` contains transition matrices from the start and from all samples whose errors grow.
    """
    first_windows, totals = [0], transitions[:1]
    for window in range(1, len(transitions)):
        sizes = _norms(totals) * growth[window]
        small = sizes[0] <= LARGEST_GROWTH and sizes.max() <= LARGEST_GROWTH_WITHIN
        if not small or edges[window + 1] - edges[first_windows[-1]] > most:
            first_windows.append(window)
            totals = transitions[window : window + 1]
        else:
            totals = transitions[window] @ np.concatenate([totals, np.eye(3)[None]])
            grows = _norms(totals) > 1.0
            grows[0] = True
            totals = totals[grows]
    return np.array(first_windows)


def _norms(matrices):
    """Spectral norms of matrices; infinite if an entry is not finite."""
    norms, finite = np.full(len(matrices), np.inf), np.isfinite(matrices).all(axis=(1, 2))
    norms[finite] = np.linalg.norm(matrices[finite], 2, axis=(1, 2))
    return norms


# Number of displacements to try for each window's start.
DISPLACEMENTS = 15
# Number of displacements per window, the best ones, from which its states are fitted.
MOST_TRIED = 2
ITERATIONS = 8
# A window's fit ends if a step would lower its cost by less than this share.
SETTLED = 1e-4


def settled(
    shooting: Shooting,
    number: int,
    fit: ShootingFit,
    starts: np.ndarray,
    iterations: int = ITERATIONS,
) -> tuple[np.ndarray, np.ndarray]:
    """Starts at the minimum of each window's cost, and these costs.

    Windows whose starts are NaN are unchanged.
    """
    sizes, edges = shooting.state_units(number), fit.edges[number]
    residuals, ends, costs = shooting.residuals(fit, number, starts=starts)
    damping = np.full(len(starts), 1e-2)
    moving = np.isfinite(starts).all(axis=1)
    for _ in range(iterations):
        begun = np.where(moving[:, None], starts, np.nan)
        columns, _ = shooting.by_states(fit, number, begun, residuals, ends)
        grams = grams_of(np.concatenate([columns, residuals[..., None]], axis=2), edges - edges[0])
        gradient = grams[:, :3, 3]
        inverse = state_inverse(grams[:, :3, :3], damping[:, None])
        step = -np.einsum("wij,wj->wi", inverse, gradient)
        moving &= -np.einsum("wk,wk->w", gradient, step) > SETTLED * costs
        trial = begun + step * sizes
        trial_left, _, tried = shooting.residuals(fit, number, starts=trial)
        better = tried < costs
        starts = np.where(better[:, None], trial, starts)
        residuals = np.where(np.repeat(better, np.diff(edges))[:, None], trial_left, residuals)
        costs = np.where(better, tried, costs)
        damping = np.where(better, 0.1 * damping, np.minimum(10.0 * damping, 1e6))
        if not moving.any():
            break
    return starts, costs


def placed(
    shooting: Shooting, number: int, fit: ShootingFit, where: np.ndarray, reach: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """The best starts, fitted from displacements within `reach`, and their costs.

    Parameters
    ----------
    where : ndarray of bool, shape (windows,)
        Windows to process; the others' starts are NaN.
    reach : (float, float)
        Minimum and maximum displacement.
    """
    seen = motion(shooting.at(number, fit.values))
    begins = fit.edges[number][:-1]
    states = np.where(where[:, None], seen.states(begins), np.nan)
    if seen.measured:
        return settled(shooting, number, fit, states)

    def begun_at(x):
        return np.column_stack([np.where(where, x, np.nan), states[:, 1:]])

    tried = np.linspace(*reach, DISPLACEMENTS)
    costs = side_by_side(lambda x: shooting.residuals(fit, number, starts=begun_at(x))[2], tried)
    order = np.argsort(costs, axis=0)
    best = states, np.full(begins.size, np.inf)
    for rank in range(MOST_TRIED):
        best = _better(best, settled(shooting, number, fit, begun_at(tried[order[rank]])))
    return best


def repaired(
    shooting: Shooting, fit: ShootingFit, where: Sequence[np.ndarray]
) -> tuple[ShootingFit, list[np.ndarray]]:
    """The fit with some windows' starts replaced by the best states.

    Parameters
    ----------
    where : sequence of ndarray of bool, shape (windows,)
        Windows to repair, by experiment.

    Returns
    -------
    ShootingFit
    list of ndarray, shape (windows,)
        Each window's sum of squares.
    """
    starts, sums = [], []
    for number, chosen in enumerate(where):
        current = fit.starts[number]
        best = current, shooting.residuals(fit, number)[2]
        begun = np.where(chosen[:, None], current, np.nan)
        best = _better(best, settled(shooting, number, fit, begun, ITERATIONS // 2))
        current = best[0]
        states, ends, _ = shooting.at(number, fit.values).states(fit.edges[number], current)
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
    """Range of displacements to search: from the 1 % to the 99 % quantile, extended by a tenth."""
    low, high = np.nanquantile(x, [0.01, 0.99])
    margin = 0.1 * (high - low)
    return float(low - margin), float(high + margin)
