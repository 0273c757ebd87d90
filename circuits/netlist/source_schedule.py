"""Time-varying loads: their jumps, and the steps that resolve them.

Sources and expressions of time vary independently of the device. Both engines query here the
longest step and the times at which steps must end. These follow from bounds of the expressions over
intervals: an interval is halved while an expression changes in it by more than a share of its
swing; such a change in the shortest interval is a jump.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from circuits.netlist.bounds import bounds, of_time_alone
from circuits.netlist.expression import Tree, parts_of
from circuits.netlist.potentials import Potentials, wave_tree, with_sources
from harvester.base.errors import LoadError

if TYPE_CHECKING:
    from circuits.netlist.elements import Element
    from circuits.netlist.waveform import Waveform

# Largest change of a source in a step, and largest deviation from a straight line, as shares of its
# peak-to-peak swing. A sine then has 31 to 62 steps per period, a ramp 10 to 20, and their mean
# squares are accurate to 0.5 %.
CHANGE, BEND = 0.1, 0.0025
# A swing below this share of the largest value is a rounding error.
ROUNDING = 1e-9
# Number of halvings of a grid step after which a remaining change is a jump.
HALVINGS = 20
# Accuracy of an engine's clock, as a share of a step of the grid. A jump at the end of an interval
# belongs to that interval.
CLOCK = 1e-8
# Number of grid steps that are examined in advance.
AHEAD = 64
# A pulse's edge shorter than this share of the adjacent constant parts counts as a jump. Steps end
# at its corners; a straight line between them misses 0.4 % of the mean square.
STEEP = 1.0 / 80.0
# Largest number of steps for a source per grid step, averaged over the examined steps.
MOST_STEPS = 5000


class Breakpoints(NamedTuple):
    """The steps prescribed by a load's sources over a time interval.

    Attributes
    ----------
    ends : ndarray, shape (n,)
        Times at which steps must end, ascending (s).
    longest : ndarray, shape (n,)
        Longest step before each of these times (s).
    jumps : ndarray, shape (n,)
        1 if the interval before it contains a jump, else 0.
    """

    ends: np.ndarray
    longest: np.ndarray
    jumps: np.ndarray


NO_BREAKPOINTS = Breakpoints(np.zeros(0), np.zeros(0), np.zeros(0))


class SourceSchedule:
    """The sources and expressions of a load that depend on time alone."""

    def __init__(self, elements: Iterable[Element]) -> None:
        elements = tuple(elements)
        potentials = Potentials(
            element for element in elements if not (element.wave and steep(element.wave))
        )
        element_of_tree: dict[Tree, Element] = {}
        for source in elements:
            if source.wave is not None and not steep(source.wave):
                element_of_tree.setdefault(tree_of(source.wave), source)
            if source.expression is not None:
                for tree in _moving(with_sources(source.expression, potentials)):
                    element_of_tree.setdefault(tree, source)
        self._elements = element_of_tree

    def __bool__(self) -> bool:
        return bool(self._elements)

    def steps(self, step: float) -> Steps:
        """Plan a run's steps, for a grid with this step (s)."""
        return Steps(self._elements, step)


class Steps:
    """Plans a run's steps in successive intervals; see `SourceSchedule.steps`."""

    def __init__(self, elements: dict[Tree, Element], step: float) -> None:
        self._elements, self._step = elements, step
        self._least = {tree: math.inf for tree in elements}
        self._most = {tree: -math.inf for tree in elements}

    def plan(self, first: int, count: int) -> Breakpoints:
        """The plan of `count` steps of the grid, from number `first` on.

        Raises
        ------
        LoadError
            A source changes too fast to be resolved.
        """
        edges = np.arange(first, first + count + 1) * self._step
        smooth, jumps = self._halved(edges[:-1], edges[1:])
        pieces = [(*smooth, np.zeros(smooth[0].size))]
        if jumps[0].size:
            pieces = list(self._between(edges, smooth, jumps))
        low, high, leaps = (np.concatenate(column) for column in zip(*pieces, strict=True))
        order = np.argsort(low)
        return _joined(low[order], high[order], leaps[order], self._step)

    def _between(self, edges, smooth, jumps):
        """Halve steps with jumps again, after cutting them at the jumps.

        Yields the other smooth intervals, the jumps, and the new intervals.
        """
        holds = np.zeros(edges.size - 1, dtype=bool)
        holds[_cells(edges, jumps)] = True
        uncovered = ~holds[_cells(edges, smooth)]
        yield smooth[0][uncovered], smooth[1][uncovered], np.zeros(np.count_nonzero(uncovered))
        low, high = _merged(*jumps)
        low, high = np.maximum(low, edges[0]), np.minimum(high, edges[-1])
        yield low, high, np.ones(low.size)
        cuts = np.unique(np.concatenate([edges[:-1][holds], edges[1:][holds], low, high]))
        middle = 0.5 * (cuts[:-1] + cuts[1:])
        inside = holds[np.clip(np.searchsorted(edges, middle, "right") - 1, 0, holds.size - 1)]
        index = np.searchsorted(low, middle, "right") - 1
        inside &= (index < 0) | (middle > high[index])
        (low, high), (left, right) = self._halved(cuts[:-1][inside], cuts[1:][inside])
        yield np.append(low, left), np.append(high, right), np.zeros(low.size + left.size)

    def _halved(self, low, high):
        """Intervals halved until they are short enough, and intervals still too long at the end."""
        done, total, count = [], 0, low.size
        for _ in range(HALVINGS):
            fine, element = self._fine(low, high)
            done.append((low[fine], high[fine]))
            total += int(np.count_nonzero(fine))
            low, high = low[~fine], high[~fine]
            if low.size == 0:
                break
            if total + low.size > MOST_STEPS * count:
                raise LoadError(
                    f"{element.where}: {element.name}: from {low[0]:.4g} s on it changes "
                    f"within less than a {MOST_STEPS}th of the device's steps of {self._step:.3g} "
                    "s: too fast for a run; slow it down, or replace it by its mean"
                )
            middle = 0.5 * (low + high)
            low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
        return tuple(np.concatenate(column) for column in zip(*done, strict=True)), (low, high)

    def _fine(self, low, high):
        """Which intervals are short enough, and the element that needs most further halvings."""
        fine, worst, element = np.ones(low.size, dtype=bool), -1, None
        middle, rounding = 0.5 * (low + high), CLOCK * self._step
        for tree, source in self._elements.items():
            values = [np.mean(bounds(tree, t, t), axis=0) for t in (low, middle, high)]
            finite = np.concatenate([value[np.isfinite(value)] for value in values])
            self._least[tree] = min(self._least[tree], finite.min(initial=math.inf))
            self._most[tree] = max(self._most[tree], finite.max(initial=-math.inf))
            swing = self._most[tree] - self._least[tree]
            swing += ROUNDING * max(abs(self._most[tree]), abs(self._least[tree]))
            least, most = bounds(tree, np.maximum(low - rounding, 0.0), high + rounding)
            bent = np.abs(values[1] - 0.5 * (values[0] + values[2]))
            good = (most - least <= CHANGE * swing) & (bent <= BEND * swing)
            fine &= good
            if np.count_nonzero(~good) > worst:
                worst, element = int(np.count_nonzero(~good)), source
        return fine, element


def _cells(edges, intervals):
    """Indices of the grid steps that contain the intervals."""
    return np.searchsorted(edges, 0.5 * (intervals[0] + intervals[1]), "right") - 1


def _merged(low, high):
    """Jumps, with adjacent ones merged and slightly widened, so that no step ends at a jump."""
    order = np.argsort(low)
    low, high = low[order], high[order]
    separate = low[1:] > high[:-1] + 0.5 * (high[:-1] - low[:-1])
    low, high = low[np.append(True, separate)], high[np.append(separate, True)]
    wider = 0.25 * (high - low)
    return low - wider, high + wider


def _joined(low, high, jumps, step):
    """A plan of ordered intervals, with successive equal ones merged."""
    widths = high - low
    last = np.ones(low.size, dtype=bool)
    alike = np.abs(widths[1:] - widths[:-1]) < 0.25 * widths[1:]
    last[:-1] = ~alike | (jumps[1:] != jumps[:-1])
    if not (jumps.any() or (widths < 0.75 * step).any()):
        return NO_BREAKPOINTS
    return Breakpoints(high[last], widths[last] * (1.0 + 1e-6), jumps[last])


def _moving(tree: Tree) -> Iterable[Tree]:
    """The largest subtrees that depend on time alone."""
    waiting = [tree]
    while waiting:
        tree_now = waiting.pop()
        if of_time_alone(tree_now):
            yield tree_now
        else:
            waiting += parts_of(tree_now)


def tree_of(wave: Waveform) -> Tree:
    """A source's waveform as an expression of time."""
    time: Tree = ("time",)
    if wave.kind == "pwl":
        return ("call", "pwl", time, *(("number", value) for value in wave.numbers))
    if wave.kind != "sffm":
        return wave_tree(wave)
    offset, amplitude, carrier, index, signal = (("number", value) for value in wave.numbers)
    turn: Tree = ("*", ("number", 2.0 * math.pi), time)
    swing = ("*", index, ("sin", ("*", turn, signal)))
    return ("+", offset, ("*", amplitude, ("sin", ("+", ("*", turn, carrier), swing))))


def steep(wave: Waveform) -> bool:
    """Whether a source is constant except for steep edges, at whose corners steps end."""
    numbers = wave.numbers
    if wave.kind == "pulse":
        rise, fall, width, every = numbers[3:]
        return max(rise, fall) <= STEEP * min(width, every - rise - fall - width)
    if wave.kind != "pwl":
        return False
    times, values = np.array(numbers[::2]), np.array(numbers[1::2])
    lengths, changes = np.diff(times), np.diff(values) != 0.0
    around = np.concatenate([[math.inf], np.where(changes, 0.0, lengths), [math.inf]])
    shortest = np.minimum(around[:-2], around[2:])
    return bool(np.all(~changes | (lengths <= STEEP * shortest)))
