"""What can be asked of a statement: each test turns answers into findings, one method at a time.

A test lists the changes of the scene that it needs at a condition (`scenes`), and judges them
(`findings`) from `read(changes)`, which gives the method's answer there, or None where it has
none. Differences of two simulations are paired batch by batch on their common noise, which is
valid whether or not the paths stay together: the error is that of the difference itself.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from harvester.results.paired import paired_difference
from harvester.running import Answer
from harvester.scene.model import Scene
from harvester.verification.paper.density_features import FEATURES, middle_of, peak_of
from harvester.verification.paper.figures_list import SYMBOLS, Changes

# A method's answer under some changes, None where there is none.
Read: TypeAlias = Callable[[Changes], Answer | None]


@dataclass(frozen=True)
class Finding:
    """One comparison.

    Attributes
    ----------
    where : str
    effect : float
        A share, with the sign of what was found.
    error : float
        Its standard error, or numerical error.
    favours : int
        Sign of an effect that speaks for the statement.
    decisive : bool
        Whether the statement needs it; steps of a trend only may speak against it.
    margin : float or None
        What decides instead of the effect: how far it stays below a limit.
    """

    where: str
    effect: float
    error: float
    favours: int = 1
    decisive: bool = True
    margin: float | None = None

    @property
    def sigmas(self) -> float:
        """For the statement (> 0) or against it, in standard errors."""
        signed = self.favours * (self.effect if self.margin is None else self.margin)
        return signed / self.error if self.error > 0.0 else math.copysign(math.inf, signed)


def name_of(changes: Changes) -> str:
    """ "δr = 1.1, D = 0.02"; "as it is" without changes."""
    return ", ".join(f"{SYMBOLS[k]} = {v:g}" for k, v in changes) or "defaults"


@dataclass(frozen=True)
class Trend:
    """A quantity rises (or falls) along values of one key."""

    quantity: str
    swept: str
    values: tuple
    rises: bool = True

    def scenes(self, condition: Changes) -> list[Changes]:
        """Changes of the scene."""
        return [with_value(condition, self.swept, value) for value in self.values]

    def findings(self, condition: Changes, read: Read) -> list[Finding]:
        """Every step between neighbours, and the whole."""
        known = _known(self, condition, read)
        favours = 1 if self.rises else -1
        steps = list(itertools.pairwise(known))
        found = [
            self._finding(condition, a, b, favours, decisive=False)
            for a, b in (steps if len(known) > 2 else [])
        ]
        if len(known) > 1:
            found.append(self._finding(condition, known[0], known[-1], favours, decisive=True))
        return [finding for finding in found if finding]

    def _finding(self, condition, a, b, favours, decisive):
        change = relative_change(a[1], b[1], self.quantity)
        if change is None:
            return None
        where = _range(condition, self.swept, a[0], b[0])
        return Finding(where, *change, favours, decisive)


@dataclass(frozen=True)
class InteriorMaximum:
    """A quantity is higher somewhere inside a range than at both ends.

    The highest interior point is chosen from the same data, which favours the statement by less
    than a standard error.
    """

    quantity: str
    swept: str
    values: tuple

    def scenes(self, condition: Changes) -> list[Changes]:
        """Changes of the scene."""
        return [with_value(condition, self.swept, value) for value in self.values]

    def findings(self, condition: Changes, read: Read) -> list[Finding]:
        """The best interior point against either end."""
        known = _known(self, condition, read)
        if len(known) < 3:
            return []
        best = max(known[1:-1], key=lambda point: point[1].quantities[self.quantity].estimate)
        changes = [
            (end, relative_change(end[1], best[1], self.quantity)) for end in (known[0], known[-1])
        ]
        return [
            Finding(_range(condition, self.swept, end[0], best[0]), *change)
            for end, change in changes
            if change
        ]


@dataclass(frozen=True)
class SingleHump(InteriorMaximum):
    """A quantity rises from the first value on to one maximum and falls after it."""

    def findings(self, condition: Changes, read: Read) -> list[Finding]:
        """Every step, in the direction it should have."""
        known = _known(self, condition, read)
        if len(known) < 3:
            return []
        values = [answer.quantities[self.quantity].estimate for _, answer in known]
        top = int(np.argmax(values))
        found = []
        for k, (a, b) in enumerate(itertools.pairwise(known)):
            # Monotone to an edge is no hump either: the last step before it should fall.
            rising = k < min(max(top, 1), len(known) - 2)
            change = relative_change(a[1], b[1], self.quantity)
            if change:
                where = _range(condition, self.swept, a[0], b[0])
                found.append(Finding(where, *change, 1 if rising else -1))
        return found


@dataclass(frozen=True)
class _Pairs:
    """Tests that compare end-to-end changes over ranges of several keys."""

    def _change(self, condition, read, quantity, swept, ends):
        answers = [read(with_value(condition, swept, value)) for value in ends]
        return None if None in answers else relative_change(*answers, quantity)


@dataclass(frozen=True)
class Stronger(_Pairs):
    """Each key of one group changes a quantity more than each of another, over given ranges."""

    quantity: str
    strong: tuple
    weak: tuple

    def scenes(self, condition: Changes) -> list[Changes]:
        """Changes of the scene."""
        ranges = (*self.strong, *self.weak)
        return [with_value(condition, key, v) for key, ends in ranges for v in ends]

    def findings(self, condition: Changes, read: Read) -> list[Finding]:
        """Every strong one against every weak one: difference of the sizes of their changes."""
        found = []
        for strong, ends in self.strong:
            for weak, others in self.weak:
                ours = self._change(condition, read, self.quantity, strong, ends)
                theirs = self._change(condition, read, self.quantity, weak, others)
                if ours and theirs:
                    where = f"{SYMBOLS[strong]} against {SYMBOLS[weak]}"
                    where += f" at {name_of(condition)}" if condition else ""
                    effect = abs(ours[0]) - abs(theirs[0])
                    found.append(Finding(where, effect, math.hypot(ours[1], theirs[1])))
        return found


class _Ranges(_Pairs):
    """A statement on the two ends of the `ranges` of some keys."""

    def scenes(self, condition):
        """Changes of the scene."""
        return [with_value(condition, key, v) for key, ends in self.ranges for v in ends]


@dataclass(frozen=True)
class Unchanged(_Ranges):
    """A quantity changes by less than a share over the ranges of some keys."""

    quantity: str
    ranges: tuple
    limit: float

    def findings(self, condition: Changes, read: Read) -> list[Finding]:
        """Each key's change, by how far it stays below the limit."""
        found = []
        for key, ends in self.ranges:
            change = self._change(condition, read, self.quantity, key, ends)
            if change:
                where, (effect, error) = _range(condition, key, *ends), change
                found.append(Finding(where, effect, error, margin=self.limit - abs(effect)))
        return found


@dataclass(frozen=True)
class Changed(Unchanged):
    """A quantity changes by more than a share over the ranges of some keys."""

    def findings(self, condition: Changes, read: Read) -> list[Finding]:
        """The same, in which staying below the limit speaks against the statement."""
        return [replace(finding, favours=-1) for finding in super().findings(condition, read)]


@dataclass(frozen=True)
class Opposed(_Ranges):
    """One quantity rises where another falls, over ranges of some keys."""

    quantity: str
    other: str
    ranges: tuple

    def findings(self, condition: Changes, read: Read) -> list[Finding]:
        """The other's change, for the statement when it is against the first one's.

        As sure as the less sure of the two signs.
        """
        found = []
        for key, ends in self.ranges:
            one = self._change(condition, read, self.quantity, key, ends)
            other = self._change(condition, read, self.other, key, ends)
            if one and other:
                sure = min(abs(Finding("", *one).sigmas), abs(Finding("", *other).sigmas))
                error = abs(other[0]) / sure if sure > 0.0 else math.inf
                favours = -1 if one[0] > 0.0 else 1
                found.append(Finding(_range(condition, key, *ends), other[0], error, favours))
        return found


@dataclass(frozen=True)
class Bimodal:
    """The density of X is lower at 0 than at its peak."""

    quantity = "peak"

    def scenes(self, condition: Changes) -> list[Changes]:
        """Changes of the scene."""
        return [condition]

    def findings(self, condition: Changes, read: Read) -> list[Finding]:
        """What the density lacks at 0, as a share of its peak."""
        answer = read(condition)
        if answer is None or answer.density is None:
            return []
        (peak, error), (middle, its_error) = peak_of(answer.density), middle_of(answer.density)
        return [
            Finding(name_of(condition), 1.0 - middle / peak, math.hypot(error, its_error) / peak)
        ]


@dataclass(frozen=True)
class Agreement:
    """Quantities are within a share of Monte Carlo's."""

    quantities: tuple
    limit: float
    compares = True

    def scenes(self, condition: Changes) -> list[Changes]:
        """Changes of the scene."""
        return [condition]

    def findings(self, condition: Changes, read: Read, reference: Read) -> list[Finding]:
        """The deviations, by how far they stay below the limit."""
        ours, theirs = read(condition), reference(condition)
        if ours is None or theirs is None:
            return []
        found = []
        for name in self.quantities:
            change = independent_change(theirs, ours, name)
            if change is None:
                continue
            share, error = change
            where = f"{name.replace('_', ' ')} at {name_of(condition)}"
            found.append(Finding(where, share, error, margin=self.limit - abs(share)))
        return found


@dataclass(frozen=True)
class WiderBand:
    """Orbits up to one energy reach higher frequencies with stoppers than without: Fig. 3."""

    of_orbits = True

    def scenes(self, condition: Changes) -> list[Changes]:
        """None: no noise enters."""
        return []

    def findings_of_orbits(self, scene: Scene) -> list[Finding]:
        """Highest frequency of the orbits around both wells."""
        from harvester.verification.paper.orbit_maps import frequency_response

        responses = frequency_response(scene).responses
        highest = [responses[d]["outer"].frequency.max() for d in ("with stoppers", "without")]
        return [Finding("outer orbits", highest[0] / highest[1] - 1.0, 0.0)]


def with_value(condition: Changes, key: str, value: float) -> Changes:
    """The condition with one key set, sorted: equal changes are equal."""
    return tuple(sorted({**dict(condition), key: value}.items()))


def relative_change(first: Answer, second: Answer, quantity: str) -> tuple[float, float] | None:
    """(change from the first answer to the second as a share of the first, its error), or None."""
    return _paired_change(first, second, quantity) or independent_change(first, second, quantity)


def _paired_change(first, second, quantity):
    """The same on the common noise, or None without moments or an error bar."""
    if not (first.moments and second.moments):
        return None
    paired = paired_difference(second, first).get(quantity)
    if paired is None or paired.standard_error is None:
        return None
    return paired.estimate, paired.standard_error


def independent_change(first: Answer, second: Answer, quantity: str) -> tuple[float, float] | None:
    """The same with the two errors taken as independent."""
    (a, error_a), (b, error_b) = _value(first, quantity), _value(second, quantity)
    if not a:
        return None
    return b / a - 1.0, math.hypot(error_b, error_a * b / a) / abs(a)


def _known(test, condition, read):
    """(value, answer) where there is one that has the quantity."""
    points = [(value, read(with_value(condition, test.swept, value))) for value in test.values]
    return [(value, answer) for value, answer in points if _has(answer, test.quantity)]


def _has(answer, quantity):
    if answer is None:
        return False
    return quantity in answer.quantities or (quantity in FEATURES and answer.density is not None)


def _value(answer, quantity):
    if quantity in FEATURES:
        return FEATURES[quantity](answer.density)
    estimate = answer.quantities[quantity]
    return (
        estimate.estimate,
        math.inf if estimate.standard_error is None else estimate.standard_error,
    )


def _range(condition, key, first, last):
    text = f"{SYMBOLS[key]} {first:g} → {last:g}"
    return f"{text} at {name_of(condition)}" if condition else text
