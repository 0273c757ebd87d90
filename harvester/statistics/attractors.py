"""Identify the steady motions of a driven device from stroboscopic samples of many starts.

A motion is periodic if its samples repeat after an integer number of forcing periods. Starts with
the same cycle are on one attractor, whatever their phase. Aperiodic motions are compared by their
Poincaré sections: two starts are on one attractor if their samples fill the same cells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from harvester.scene.steps import faintness
from harvester.statistics.batch_means import standard_error
from harvester.statistics.stroboscope import STATE

# Longest period that is tested, in forcing periods, and the number of its repetitions that the
# samples must cover.
LONGEST_PERIOD, SEEN = 24, 2.0
# A motion repeats if its samples differ by at most the first share of their maximum. Two cycles are
# the same if they differ by at most the second share, since unsettled starts differ by several
# times their change per period.
REPEATS, SAME_CYCLE = 1e-4, 1e-2
# A shorter period replaces its multiple if it repeats to within this share: a decaying spiral that
# turns by a third of a circle per period nearly repeats after three periods.
STILL_SETTLING = 3e-3
# A start joins a cycle if it stays within `SAME_CYCLE` of it for two periods and this many further
# samples. Of 1681 starts of the scene `device` under a sine, one reached its orbit too late for
# `REPEATS`.
STAYS = 6
# A start has converged if its remaining transient is below the first share of its largest samples,
# or if these change by less than the second share, the round-off of a period. The change is
# measured over the last stretch and the one before, each this share of the samples.
CONVERGED, ROUNDING, STRETCH = 1e-6, 1e-9, 0.375
# A cycle counts if its remaining transient is below this share of its size, a tenth of the distance
# that separates cycles. Its error bars include the remaining transient.
NEARLY_CONVERGED = 1e-3
# The results of `means_of`, with their dimensions. Divisors of 0 are replaced by SMALLEST.
QUANTITIES = {"mean_power": "power", "rms_voltage": "voltage", "rms_displacement": "displacement"}
SMALLEST = 1e-150
# For a noisy path: the longest period that is tested, in forcing periods, and the correlation above
# which the path is periodic.
LONGEST_IN_NOISE, CORRELATED = 6, 0.95
# Aperiodic motions are compared on a grid of cells over the section, with CELLS √samples cells per
# side. This is 24 for 64 samples; with 24 cells for 19 samples, one chaotic motion of eight starts
# was split into two. Two starts are on one attractor if at least SAME_CELLS of one start's samples
# are in or next to cells filled by the other.
CELLS, SAME_CELLS = 3.0, 0.7


@dataclass(frozen=True)
class Group:
    """Starts that reached the same steady motion.

    Attributes
    ----------
    period
        Period in forcing periods; None for an aperiodic motion.
    members
        Numbers of the starts, ascending.
    points
        Stroboscopic section (X, X' and the transducer's state, scaled), shape (period or samples,
        3). For an aperiodic motion it contains samples of all members, at most `MOST_POINTS`.
    """

    period: int | None
    members: np.ndarray
    points: np.ndarray


# Maximum number of stored points of an aperiodic motion.
MOST_POINTS = 5000


def repetition(samples: np.ndarray, scale: np.ndarray | None = None) -> np.ndarray:
    """The period of each start's last samples, in forcing periods; 0 if they do not repeat.

    `samples` has the shape (starts, samples, 3). Differences are relative to `scale`, by default
    the largest values of the three columns.
    """
    scale = sizes_of(samples) if scale is None else scale
    periods = np.zeros(len(samples), dtype=int)
    longest = min(LONGEST_PERIOD, int(samples.shape[1] / SEEN))
    for period in range(1, longest + 1):
        open_ = np.flatnonzero(periods == 0)
        if not open_.size:
            break
        # Only the last two periods are compared, so that starts may settle late.
        back = min(samples.shape[1], max(math.ceil(SEEN * period), period + 4))
        last = samples[open_, -back:]
        repeats = _change(last, period, scale) <= REPEATS
        periods[open_[repeats]] = period
        for shorter in range(1, period // 2 + 1):
            if period % shorter == 0:
                nearly = repeats & (_change(last, shorter, scale) <= STILL_SETTLING)
                periods[open_[nearly]] = shorter
                repeats &= ~nearly
    return periods


def transients(samples: np.ndarray, memory: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Each start's period, and its remaining distance from the cycle that it approaches.

    Changes over equal stretches of whole cycles shrink by a factor r, so that Σ rᵏ of the last
    change remains. A fast decay may hide a slow store, so the full `memory` is also used as a
    bound.

    Parameters
    ----------
    samples : ndarray, shape (starts, samples, 3)
    memory : float
        The slowest relaxation time, in forcing periods.

    Returns
    -------
    (ndarray of int, ndarray, ndarray), shapes (starts,)
        Periods as in `repetition`; the change over the last stretch, and the remaining distance, as
        shares of the start's largest samples. Both are infinite if the samples do not repeat; the
        distance is also infinite if changes do not decay.
    """
    inside = np.isfinite(samples).all(axis=(1, 2))
    samples = np.where(inside[:, None, None], samples, 0.0)
    greatest = np.abs(samples).max(axis=1, keepdims=True)
    scaled = samples / np.where(
        greatest > 1e-12 * greatest.max(axis=2, keepdims=True), greatest, 1.0
    )
    periods = np.where(inside, repetition(scaled, np.ones(samples.shape[2])), 0)
    changes, remains = np.full((2, len(samples)), np.inf)
    for period in np.unique(periods[periods > 0]):
        selected, stretch = periods == period, stretch_of(period, samples.shape[1])
        if stretch:
            moved = np.abs(scaled[selected, stretch:] - scaled[selected, :-stretch]).max(axis=2)
            latest, before = moved[:, stretch:].max(axis=1), moved[:, :-stretch].max(axis=1)
            limit = np.where(
                latest < before, latest * latest / np.maximum(before - latest, SMALLEST), np.inf
            )
            limit = np.maximum(limit, latest * memory / stretch)
            changes[selected], remains[selected] = (
                latest,
                np.where(latest <= ROUNDING, latest, limit),
            )
    return periods, changes, remains


def stretch_of(period: int, count: int) -> int:
    """Length in samples of the stretches that `transients` compares; 0: too few samples."""
    return int(STRETCH * (count - 1)) // period * period


def means_of(
    samples: np.ndarray, seconds: float, steps: float, memory: float, reactive: float = 0.0
) -> np.ndarray:
    """`QUANTITIES` of one motion, and their errors; shape (2, 3), in the units of the samples.

    Means of a periodic motion are over its last whole cycles, with errors that include the
    remaining transient. Otherwise all samples are used; errors are NaN if these are too few.

    Parameters
    ----------
    samples : ndarray, shape (starts, samples, columns)
        One start of a periodic motion, or all starts of an aperiodic one.
    seconds : float
        Period of the excitation.
    steps : float
        Relative error of a mean due to the step.
    memory : float
        As in `transients`.
    reactive : float
        Apparent power over the mean-square voltage, see `harvester.scene.steps.susceptance`.
    """
    rates = np.diff(samples[:, :, STATE:], axis=1) / seconds
    (period, *_), (change, *_), (remains, *_) = transients(samples[:, :, :STATE], memory)
    if len(samples) == 1 and np.isfinite(remains):
        stretch = stretch_of(period, samples.shape[1])
        last, before = rates[0, -stretch:], rates[0, -2 * stretch : -stretch]
        means = last.mean(axis=0)
        errors = np.abs(means - before.mean(axis=0)) * remains / max(change, SMALLEST)
    else:
        means = rates.mean(axis=(0, 1))
        scatters = [standard_error(rates[:, :, k]) for k in range(means.size)]
        errors = np.array([math.nan if scatter is None else scatter for scatter in scatters])
    costs = steps * means
    costs[0] *= faintness(reactive * means[1], means[0])
    errors = np.hypot(errors, costs)
    roots = np.sqrt(means[1:])
    errors[1:] /= 2.0 * np.maximum(roots, SMALLEST)
    return np.array([[means[0], *roots], errors])


def repeats_in_noise(path: np.ndarray, period: float) -> bool:
    """Whether a measured path is periodic with a small multiple of the forcing period.

    Samples with sensor noise never agree as `repetition` requires. Instead, the path is correlated
    with the path some periods later. `path` is evenly spaced; its first third is excluded as the
    initial transient. `period` is in samples.
    """
    late = path[path.size // 3 :] - np.mean(path[path.size // 3 :])
    times = np.arange(late.size)
    for count in range(1, LONGEST_IN_NOISE + 1):
        moved = times[: int(late.size - count * period) - 1] + count * period
        if moved.size < 2:
            return True
        later = np.interp(moved, times, late)
        if np.corrcoef(late[: moved.size], later)[0, 1] > CORRELATED:
            return True
    return False


def _change(samples, period, scale):
    """Largest change of each start's samples over a period, relative to `scale`."""
    change = np.abs(samples[:, period:] - samples[:, :-period]) / scale
    return change.max(axis=(1, 2))


def sizes_of(samples: np.ndarray) -> np.ndarray:
    """Largest |X|, |X'| and |state| of all samples, 1 if all are 0; shape (3,)."""
    greatest = np.nanmax(np.abs(samples), axis=(0, 1), initial=0.0)
    # A variable that is zero except for round-off has no scale.
    return np.where(greatest > 1e-12 * greatest.max(initial=0.0), greatest, 1.0)


def groups_of(samples: np.ndarray) -> list[Group]:
    """Group starts by the steady motion that they reached, the largest group first.

    `samples` are stroboscopic, after the initial transient; shape (starts, samples, 3).
    """
    scale = sizes_of(samples)
    periods = repetition(samples, scale)
    groups = [
        group
        for period in np.unique(periods[periods > 0])
        for group in _cycles(samples, scale, int(period), np.flatnonzero(periods == period))
    ]
    groups, wandering = _with_late_starts(groups, samples, scale, np.flatnonzero(periods == 0))
    groups += _aperiodic_groups(samples, wandering)
    return sorted(groups, key=lambda group: (-group.members.size, group.members[0]))


def synchronized_clusters(samples: np.ndarray) -> list[Group]:
    """Group starts by the path that they reached under the same record.

    `samples` of all starts are from the same times at the end; shape (starts, samples, 3).
    """
    scale, remaining, groups = sizes_of(samples), np.arange(len(samples)), []
    while remaining.size:
        apart = np.abs(samples[remaining] - samples[remaining[0]]) / scale
        joining = apart.max(axis=(1, 2)) <= SAME_CYCLE
        groups.append(Group(None, remaining[joining], samples[remaining[0]]))
        remaining = remaining[~joining]
    return sorted(groups, key=lambda group: (-group.members.size, group.members[0]))


def _cycles(samples, scale, period, members):
    """Group starts of the same period by the cycle that they reach."""
    last = samples[members, -period:]
    remaining, groups = np.arange(members.size), []
    while remaining.size:
        cycle = last[remaining[0]]
        apart = np.full(remaining.size, np.inf)
        for shift in range(period):
            turned = np.roll(cycle, shift, axis=0)
            distance = (np.abs(last[remaining] - turned) / scale).max(axis=(1, 2))
            apart = np.minimum(apart, distance)
        same = apart <= SAME_CYCLE
        groups.append(Group(period, members[remaining[same]], cycle))
        remaining = remaining[~same]
    return groups


def _with_late_starts(cycles, samples, scale, members):
    """Add starts that reached a cycle late, and return the cycles and the remaining starts."""
    extended = []
    for cycle in cycles:
        back = min(samples.shape[1], 2 * cycle.period + STAYS)
        last = samples[members, -back:]
        # Each row shifts the cycle by one sample: a start may end anywhere on the cycle.
        turns = (np.arange(-back, 0)[None, :] + np.arange(cycle.period)[:, None]) % cycle.period
        apart = np.abs(last[:, None] - cycle.points[turns]) / scale
        late = apart.max(axis=(2, 3)).min(axis=1) <= SAME_CYCLE
        extended.append(replace(cycle, members=np.union1d(cycle.members, members[late])))
        members = members[~late]
    return extended, members


def _aperiodic_groups(samples, members):
    """Group aperiodic starts by the cells of the section that they fill."""
    if not members.size:
        return []
    section = samples[members][:, :, :2]
    low, high = section.min(axis=(0, 1)), section.max(axis=(0, 1))
    span = np.where(high > low, high - low, 1.0)
    count = round(CELLS * math.sqrt(section.shape[1]))
    cells = np.minimum(((section - low) / span * count).astype(int), count - 1)
    # For each group: its filled cells, and the filled cells with their neighbours.
    filled: list[tuple[np.ndarray, np.ndarray]] = []
    groups: list[list[int]] = []
    for index in range(members.size):
        x, v = cells[index].T
        shares = [float(near[x, v].mean()) for _, near in filled]
        best = int(np.argmax(shares)) if shares else -1
        if best < 0 or shares[best] < SAME_CELLS:
            nothing = np.zeros((count, count), dtype=bool)
            filled.append((nothing, nothing))
            groups.append([])
            best = len(filled) - 1
        visited = filled[best][0]
        visited[x, v] = True
        filled[best] = (visited, _with_neighbours(visited))
        groups[best].append(index)
    return [_aperiodic_group(samples, members, united) for united in _merged_groups(filled, groups)]


def _merged_groups(filled, groups):
    """Merge groups if most cells of one belong to another."""
    order = sorted(range(len(groups)), key=lambda k: -int(filled[k][0].sum()))
    separate: list[int] = []
    for k in order:
        for other in separate:
            visited, near = filled[k][0], filled[other][1]
            if (visited & near).sum() >= SAME_CELLS * visited.sum():
                groups[other] += groups[k]
                break
        else:
            separate.append(k)
    return [sorted(groups[k]) for k in separate]


def _with_neighbours(filled):
    """Filled cells and their neighbours."""
    near = filled.copy()
    for axis in (0, 1):
        before = near.copy()
        for shift in (1, -1):
            moved = np.roll(before, shift, axis=axis)
            edge = [slice(None), slice(None)]
            edge[axis] = slice(0, 1) if shift == 1 else slice(-1, None)
            moved[tuple(edge)] = False
            near |= moved
    return near


def _aperiodic_group(samples, members, indices):
    some = members[np.array(indices)]
    points = samples[some].reshape(-1, samples.shape[2])
    every = max(1, math.ceil(len(points) / MOST_POINTS))
    return Group(None, some, points[::every])


@dataclass(frozen=True)
class Divergence:
    """Largest Lyapunov exponent (1/s) and its error, from the divergence of neighbouring paths."""

    exponent: float
    standard_error: float

    @property
    def chaotic(self) -> bool:
        """Whether neighbouring paths diverge significantly (exponent > 0)."""
        return self.exponent > 3.0 * self.standard_error

    def __str__(self) -> str:
        return f"{self.exponent:.3g} ± {self.standard_error:.2g}"


# The exponent is measured while the distance of two neighbours is below the first number, in units
# of the motion's size, since growth saturates beyond it. Measurement begins when the distance has
# grown by the second factor and points in the direction of fastest growth.
LARGEST_DISTANCE, TURNED = 1e-2, 10.0
# After this many periods the distance points in that direction even if it has not grown.
TURNED_PERIODS = 8


def divergence(pairs: np.ndarray, scale: np.ndarray, period: float) -> Divergence | None:
    """The exponent from pairs of neighbouring starts; None if none could be followed.

    `pairs` contains samples of both starts of each pair, one per forcing period (s); shape (pairs,
    2, samples, 3). `scale` has the sizes of the three columns.
    """
    apart = np.sqrt((((pairs[:, 1] - pairs[:, 0]) / scale) ** 2).sum(axis=2))
    growth, lasting = [], []
    for distance in apart:
        far = np.flatnonzero(distance > LARGEST_DISTANCE)
        stop = int(far[0]) if far.size else distance.size - 1
        grown = np.flatnonzero(distance > TURNED * distance[0])
        begin = min(int(grown[0]) if grown.size else TURNED_PERIODS, TURNED_PERIODS)
        inside = distance[begin : stop + 1]
        if inside.size < 3 or not (inside > 0.0).all():
            continue
        growth.append(math.log(inside[-1] / inside[0]))
        lasting.append((inside.size - 1) * period)
    if len(growth) < 2:
        return None
    # The total growth per time of all pairs, and its error from their scatter.
    up, time = np.array(growth), np.array(lasting)
    exponent = up.sum() / time.sum()
    off = up - exponent * time
    error = math.sqrt(off.size / (off.size - 1) * (off**2).sum()) / time.sum()
    return Divergence(float(exponent), float(error))
