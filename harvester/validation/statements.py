"""The paper's statements on trends, from paper.toml, and their tests.

A test lists the changes of the scene that it needs at a condition (`scenes`). It evaluates them
(`findings`) from `read(changes)`, which returns the method's answer or None. Differences of two
simulations are paired batch by batch on common noise. The error is valid for the difference,
whether or not the paths stay together.
"""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, ClassVar, TypeAlias

import numpy as np

from harvester.base.serialising import LEFT_OUT, key
from harvester.engines.request import Answer
from harvester.scene.model import Scene
from harvester.statistics.estimate import Density
from harvester.statistics.paired import paired_difference
from harvester.validation import entries
from harvester.validation.orbit_maps import orbit_voltages
from harvester.validation.paper_figures import KEY_SYMBOLS, SYMBOL_KEYS, Changes, name_of

# The peak of a density is its mean over this width of X.
PEAK_WIDTH = 0.1
# Probability of |X| beyond the reach of the motion.
BEYOND = 0.01
# Returns a method's answer for changes of the scene, or None.
Read: TypeAlias = Callable[[Changes], Answer | None]
# Noise at which jumps between the wells are frequent.
JUMPING = ((SYMBOL_KEYS["D"], 0.08),)


@dataclass(frozen=True)
class Finding:
    """One comparison.

    Attributes
    ----------
    effect : float
        Signed relative effect.
    error : float
        Standard error of the effect, or its numerical error.
    favours : int
        Sign of an effect that supports the statement.
    decisive : bool
        Whether the statement needs it; steps of a trend can only contradict it.
    margin : float or None
        Margin below a limit, used instead of the effect.
    """

    where: str
    effect: float
    error: float
    favours: int = field(default=1, metadata=LEFT_OUT)
    decisive: bool = field(default=True, metadata=LEFT_OUT)
    margin: float | None = None

    IN_JSON: ClassVar = {"standard_errors": "sigmas"}

    @property
    def sigmas(self) -> float:
        """Evidence in standard errors: > 0 supports the statement, < 0 contradicts it."""
        signed = self.favours * (self.effect if self.margin is None else self.margin)
        return signed / self.error if self.error > 0.0 else math.copysign(math.inf, signed)


@dataclass(frozen=True)
class StatementTest:
    """A test applied to each method.

    Attributes
    ----------
    quantity : str
        Quantity of an answer, or one of `FEATURES` of its density.
    swept : str
        Key whose `values` the quantity is evaluated at.
    ranges, weak : tuple of (key, ends)
        Ranges of keys; the change of the quantity is from the first to the last end.
    rises : bool
        Direction of a trend.
    limit : float
        Limit of a relative change.
    other : str
        A second quantity.
    quantities : tuple of str
    compares : bool
        Whether `findings` takes a second `read` for Monte Carlo.
    of_orbits : bool
        Whether it concerns orbits without noise: `findings` takes the scene, and only the paper's
        stationary method is used.
    """

    quantity: str = ""
    swept: str = ""
    values: tuple[float, ...] = ()
    ranges: tuple = ()
    weak: tuple = ()
    rises: bool = True
    limit: float = 0.0
    other: str = ""
    quantities: tuple[str, ...] = ()
    compares, of_orbits = False, False

    def scenes(self, condition: Changes) -> list[Changes]:
        """The changes of the scene whose answers this test needs; by default the condition."""
        places = [(self.swept, value) for value in self.values]
        places += [(key, value) for key, ends in (*self.ranges, *self.weak) for value in ends]
        return [with_value(condition, *point) for point in places] or [condition]

    def findings(self, *arguments: Any) -> list[Finding]:
        """Findings from the answers of one method at a condition."""
        raise NotImplementedError

    def changes(
        self, condition: Changes, read: Read, ranges: tuple, quantity: str = ""
    ) -> Iterator[tuple[str, str, tuple[float, float]]]:
        """(key, where, (relative change, its error)) of each range with both answers."""
        for varied, ends in ranges:
            first, last = (read(with_value(condition, varied, value)) for value in ends)
            if first is not None and last is not None:
                change = relative_change(first, last, quantity or self.quantity)
                if change:
                    yield varied, _range(condition, varied, *ends), change


class _Followed(StatementTest):
    """Base of tests of a quantity along at least `fewest` values of one key."""

    fewest = 3

    def findings(self, condition: Changes, read: Read) -> list[Finding]:
        """A finding per step in `steps`, from the values whose answers have the quantity."""
        answers = [read(changes) for changes in self.scenes(condition)]
        pairs = zip(self.values, answers, strict=True)
        points = [(v, answer) for v, answer in pairs if answer and _has(answer, self.quantity)]
        findings = []
        for first, last, *options in self.steps(points) if len(points) >= self.fewest else ():
            change = relative_change(first[1], last[1], self.quantity)
            if change:
                where = _range(condition, self.swept, first[0], last[0])
                findings.append(Finding(where, *change, *options))
        return findings

    def steps(self, points: list[tuple[float, Answer]]) -> list[tuple]:
        """(first point, last point, sign of a supporting change, whether decisive)."""
        raise NotImplementedError


class Trend(_Followed):
    """A quantity rises (or falls) along values of one key: in every step, and in total."""

    fewest = 2

    def steps(self, points: list[tuple[float, Answer]]) -> list[tuple]:
        """Every step between neighbours, and the total change."""
        favours = 1 if self.rises else -1
        inner = itertools.pairwise(points) if len(points) > 2 else ()
        steps = [(*step, favours, False) for step in inner]
        return [*steps, (points[0], points[-1], favours, True)]


class InteriorMaximum(_Followed):
    """A quantity is higher somewhere inside a range than at both ends.

    Choosing the highest interior point from the same data biases the test towards the statement by
    less than a standard error.
    """

    def steps(self, points: list[tuple[float, Answer]]) -> list[tuple]:
        """The best interior point compared with each end."""
        best = max(points[1:-1], key=lambda point: point[1].quantities[self.quantity].estimate)
        return [(end, best, 1, True) for end in (points[0], points[-1])]


class SingleHump(_Followed):
    """A quantity rises from the first value to one maximum and then falls."""

    def steps(self, points: list[tuple[float, Answer]]) -> list[tuple]:
        """Every step, with its expected direction."""
        values = [answer.quantities[self.quantity].estimate for _, answer in points]
        # A maximum at an end does not count: the last step must fall.
        top = min(max(int(np.argmax(values)), 1), len(points) - 2)
        pairs = enumerate(itertools.pairwise(points))
        return [(*pair, 1 if k < top else -1, True) for k, pair in pairs]


class LargerEffect(StatementTest):
    """Each key of `ranges` changes a quantity more than each of `weak`."""

    def findings(self, condition: Changes, read: Read) -> list[Finding]:
        """For every pair of strong and weak keys: the difference of their absolute changes."""
        both = (self.changes(condition, read, ranges) for ranges in (self.ranges, self.weak))
        findings = []
        for (strong, _, ours), (weak, _, theirs) in itertools.product(*both):
            where = f"{KEY_SYMBOLS[strong]} against {KEY_SYMBOLS[weak]}{_at(condition)}"
            effect = abs(ours[0]) - abs(theirs[0])
            findings.append(Finding(where, effect, math.hypot(ours[1], theirs[1])))
        return findings


class Unchanged(StatementTest):
    """A quantity changes by less than a share over the ranges of some keys."""

    favours = 1

    def findings(self, condition: Changes, read: Read) -> list[Finding]:
        """A finding per key, with the margin of its change below the limit."""
        return [
            Finding(where, *change, self.favours, margin=self.limit - abs(change[0]))
            for _, where, change in self.changes(condition, read, self.ranges)
        ]


class Changed(Unchanged):
    """A quantity changes by more than a share: a change below the limit contradicts it."""

    favours = -1


class OppositeTrends(StatementTest):
    """The quantity `other` rises if `quantity` falls, over ranges of some keys."""

    def findings(self, condition: Changes, read: Read) -> list[Finding]:
        """Change of `other`, which supports the statement if `quantity` changes in the other sense.

        The less certain of the two signs determines the significance.
        """
        changes = self.changes(condition, read, self.ranges, self.other)
        others = {where: change for _, where, change in changes}
        findings = []
        for _, where, one in self.changes(condition, read, self.ranges):
            if where in others:
                other = others[where]
                sure = min(abs(Finding("", *change).sigmas) for change in (one, other))
                error = abs(other[0]) / sure if sure > 0.0 else math.inf
                findings.append(Finding(where, other[0], error, -1 if one[0] > 0.0 else 1))
        return findings


class Bimodal(StatementTest):
    """The density of X is lower at 0 than at its peak."""

    def findings(self, condition: Changes, read: Read) -> list[Finding]:
        """Findings: the density's drop from peak to X = 0, relative to the peak."""
        answer = read(condition)
        if answer is None or answer.density is None:
            return []
        (peak, error), (middle, its_error) = peak_of(answer.density), middle_of(answer.density)
        error = math.hypot(error, its_error) / peak
        return [Finding(name_of(condition), 1.0 - middle / peak, error)]


class Agreement(StatementTest):
    """Quantities agree with Monte Carlo within a relative limit."""

    compares = True

    def findings(self, condition: Changes, read: Read, reference: Read) -> list[Finding]:
        """The deviations, with their margins below the limit."""
        ours, theirs = read(condition), reference(condition)
        if ours is None or theirs is None:
            return []
        findings = []
        for name in self.quantities:
            change = independent_change(theirs, ours, name)
            if change:
                where = f"{name.replace('_', ' ')} at {name_of(condition)}"
                findings.append(Finding(where, *change, margin=self.limit - abs(change[0])))
        return findings


class WiderBand(StatementTest):
    """Orbits up to one energy reach higher frequencies with stoppers than without: Fig. 3."""

    of_orbits = True

    def scenes(self, condition: Changes) -> list[Changes]:
        return []

    def findings(self, scene: Scene) -> list[Finding]:
        """Highest frequency of the orbits around both wells."""
        responses = orbit_voltages(scene).responses
        highest = [responses[d]["outer"].frequency.max() for d in ("with stoppers", "without")]
        return [Finding("outer orbits", highest[0] / highest[1] - 1.0, 0.0)]


@dataclass(frozen=True)
class Claim:
    """One statement of a section of the paper.

    Attributes
    ----------
    sentence : str
        Shortened quotation.
    says : str
        Short form of the tested statement.
    conditions : tuple of tuple of (key, value)
        Changes of the scene; the statement must hold under each.
    """

    section: str
    sentence: str
    says: str = field(metadata=key("tested"))
    test: StatementTest = field(metadata=LEFT_OUT)
    conditions: tuple[Changes, ...] = field(default=((),), metadata=LEFT_OUT)


TESTS = (
    Trend, InteriorMaximum, SingleHump, LargerEffect, Unchanged, Changed, OppositeTrends, Bimodal,
    Agreement, WiderBand,
)  # fmt: skip


def _claim(section, sentence, tested, test, conditions=({},), **values):
    [kind] = [kind for kind in TESTS if kind.__name__ == test]
    if isinstance(conditions, str):
        conditions = entries("paper")["conditions"][conditions]
    changes = tuple(tuple((SYMBOL_KEYS[s], v) for s, v in table.items()) for table in conditions)
    if "swept" in values:
        values["swept"] = SYMBOL_KEYS[values["swept"]]
    for name in {"ranges", "weak"} & values.keys():
        values[name] = tuple((SYMBOL_KEYS[s], tuple(ends)) for s, *ends in values[name])
    values = {n: tuple(v) if isinstance(v, list) else v for n, v in values.items()}
    return Claim(section, sentence, tested, kind(**values), changes)


CLAIMS = tuple(_claim(**entry) for entry in entries("paper")["statement"])


def with_value(condition: Changes, key: str, value: float) -> Changes:
    """The condition with one key set, sorted so that equal changes compare equal."""
    return tuple(sorted({**dict(condition), key: value}.items()))


def relative_change(first: Answer, second: Answer, quantity: str) -> tuple[float, float] | None:
    """Relative change from the first answer to the second, and its error.

    Paired on common noise if both have moments; None if the first value is 0 or missing.
    """
    if first.moments and second.moments:
        paired = paired_difference(second, first).get(quantity)
        if paired is not None and paired.standard_error is not None:
            return paired.estimate, paired.standard_error
    return independent_change(first, second, quantity)


def independent_change(first: Answer, second: Answer, quantity: str) -> tuple[float, float] | None:
    """Relative change and its error, for independent errors."""
    (a, error_a), (b, error_b) = _value(first, quantity), _value(second, quantity)
    if not a:
        return None
    return b / a - 1.0, math.hypot(error_b, error_a * b / a) / abs(a)


def _has(answer, quantity):
    return quantity in answer.quantities or (quantity in FEATURES and answer.density is not None)


def _value(answer, quantity):
    if quantity in FEATURES:
        return FEATURES[quantity](answer.density)
    estimate = answer.quantities[quantity]
    error = estimate.standard_error
    return estimate.estimate, math.inf if error is None else error


def _range(condition, key, first, last):
    return f"{KEY_SYMBOLS[key]} {first:g} → {last:g}{_at(condition)}"


def _at(condition):
    return f" at {name_of(condition)}" if condition else ""


def _smooth(density):
    """Moving averages over `PEAK_WIDTH`."""
    reach, step = max(np.abs(density.centre).max(), 2.0 * PEAK_WIDTH), PEAK_WIDTH / 16
    centre = np.arange(-reach, reach + step, step)
    errors = density.standard_error
    errors = np.zeros_like(density.density) if errors is None else errors
    window = np.full(16, 1.0 / 16)
    return centre, *(
        np.convolve(np.interp(centre, density.centre, column, 0.0, 0.0), window, "same")
        for column in (density.density, errors)
    )


# Features of a density p(X) for statements, with errors. Summed bins count as fully correlated,
# which is conservative.
def peak_of(density: Density) -> tuple[float, float]:
    """(highest average of p(X) over `PEAK_WIDTH`, its error), for any grid."""
    centre, values, errors = _smooth(density)
    top = int(np.argmax(np.where(centre >= 0.0, values, 0.0)))
    return values[top], errors[top]


def middle_of(density: Density) -> tuple[float, float]:
    """(average of p(X) about X = 0, its error)."""
    centre, values, errors = _smooth(density)
    middle = int(np.argmin(np.abs(centre)))
    return values[middle], errors[middle]


def reach_of(density: Density) -> tuple[float, float]:
    """(distance from X = 0 that is exceeded for the share `BEYOND` of the time, its error)."""
    centre = density.centre
    order = np.argsort(-np.abs(centre))
    width = np.gradient(centre)[order]
    beyond = np.cumsum(density.density[order] * width)
    last = int(np.searchsorted(beyond, BEYOND))
    distance = np.interp(BEYOND, beyond, np.abs(centre[order]))
    if density.standard_error is None:
        return distance, 0.0
    error = (density.standard_error[order] * width)[: last + 1].sum()
    # Both sides together give the slope of the tail's probability.
    return distance, error / (2.0 * density.density[order][last])


FEATURES = {"peak": peak_of, "reach": reach_of}
