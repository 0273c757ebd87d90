"""Decide whether a fitted model can be trusted, by its validation records and its rivals.

The first matching condition determines the verdict; `RULES` has the same order.

| condition | verdict | advice |
| --- | --- | --- |
| no record shows a motion that the model explains beyond chance | nothing | measure again |
| a rival is better by three standard errors, and leaves only noise | wrong | use the rival |
| residuals of a record exceed noise, in size or by regression | incomplete | find the part |
| the records need a further term of the spring | incomplete | free it |
| the records need another gain, mass or load | incomplete | calibrate, or free it |
| a validation record contradicts a claimed prediction | incomplete | find the part |
| a validation record cannot be followed even in windows | incomplete | free its own value |
| a further term of the spring would make its values uncertain | fits | larger motions |
| none of these | predicts | use it in the covered range |

A record's residual is its validation data minus the prediction. It is noise if its size is at most
`TOO_LARGE` times a right model's, and its regression on the motion is not significant
(`validation_record`). Every record is tested separately.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

from harvester.base.formatting import share_with_error, with_error
from harvester.identification.rivals import NextPower, Rival, name_and_share
from harvester.identification.validation_record import (
    HALF_INTERVAL,
    ImpedanceRecord,
    ValidationRecord,
    WholeRecord,
)

if TYPE_CHECKING:
    from harvester.identification.identifiability import Assumption
    from harvester.identification.kept_aside import Visited


@dataclass(frozen=True)
class FitVerdict:
    """The verdict on the scene's model.

    Attributes
    ----------
    word : str
        "predicts"; "fits" if the records do not distinguish the spring from others; "wrong";
        "incomplete"; or "nothing" if there is no evidence.
    sentence : str
        The verdict, its range and its main caveat: at most 25 words.
    advice : str
        Recommended action.
    """

    word: str
    sentence: str
    advice: str

    @property
    def good(self) -> bool:
        """Whether the model may be used unchanged."""
        return self.word == "predicts"


class Rule(NamedTuple):
    """A line of the table above; the condition returns its reason as text, or None."""

    condition: Callable[[FitEvidence], str | None]
    word: str
    advice: str


def _nothing(evidence):
    if any(record.shows_motion for record in evidence.records):
        return None
    return f"about {evidence.records[0].noise():.0%} of the measured signal is noise"


def _better_rival(evidence):
    if not evidence.rivals or not (best := evidence.proposed).is_better:
        return None
    others = ", or another," if evidence.undecided else ""
    return f"{best.name}{others} has a residual of {best.fitted.nrmse:.2%} and is proposed"


def _unexplained(evidence):
    if evidence.worst.is_explained:
        return None
    return "no rival model explains the residual" if evidence.rivals[1:] else ""


def _needed_power(evidence):
    if evidence.spring is None or not evidence.spring.is_needed:
        return None
    return f"the records need a spring of power {evidence.spring.power}"


def _needed_assumption(evidence):
    needed = [entry for entry in evidence.assumptions if _is_needed(evidence, entry)]
    if not needed:
        return None
    strongest = max(needed, key=lambda assumption: abs(assumption.significance))
    return f"the records need {1.0 + strongest.change:.3g} times the {strongest.key}"


def _is_needed(evidence, assumption):
    """Whether the records determine the assumed value, need another one, and it affects others."""
    moved = [
        abs(move * assumption.change) > HALF_INTERVAL * evidence.errors[key]
        for key, move in assumption.moves.items()
    ]
    return assumption.error < TOLD and abs(assumption.significance) > CERTAIN and any(moved)


def _not_as_predicted(evidence):
    refuted = [record.name for record in evidence.kept_aside if record.claimed and not record.holds]
    return f"{refuted[0]} is not as predicted" if refuted else None


def _not_followed(evidence):
    unfollowed = [record for record in evidence.kept_aside if not record.follows]
    if not unfollowed:
        return None
    left, name = unfollowed[0].left, unfollowed[0].name
    return f"the model misses {left:.0%} of {name} even in short windows"


def _uncertain_spring(evidence):
    if evidence.spring is None or not evidence.spring.uncertain:
        return None
    key, half = max(evidence.spring.uncertain.items(), key=lambda item: item[1])
    return f"the records do not distinguish its spring from others: {name_and_share(key, half)}"


def _caveat(evidence):
    """Text on the main caveat of a model that predicts."""
    if evidence.kept_aside:
        claimed = sum(record.claimed for record in evidence.kept_aside)
        held = " and agree" if claimed else ""
        return f"{claimed} of {len(evidence.kept_aside)} validation records are claimed{held}"
    if all(isinstance(record, ImpedanceRecord) for record in evidence.records):
        return "valid for small motion with the base clamped"
    if evidence.visited is None:
        return "valid for small motion"
    values = evidence.dependent.values()
    of_gains = sum(any(name.startswith("sensor.") for name in names) for names in values)
    if of_gains:
        return f"{of_gains} values are only as accurate as the sensors' gains"
    return "valid in the covered range"


RULES = (
    Rule(
        _nothing,
        "nothing",
        "measure with a stronger excitation; check that the columns are from one test, the "
        "voltage's polarity (sensor.voltage_scale=-1 after the file) and the units of a phase",
    ),
    Rule(_better_rival, "wrong", "see the rival in the proposed scene"),
    Rule(_unexplained, "incomplete", "look for a part or a sensor that the scene lacks"),
    Rule(_needed_power, "incomplete", "give the spring one more power"),
    Rule(_needed_assumption, "incomplete", "calibrate this value, or free it (--free)"),
    Rule(_not_as_predicted, "incomplete", "look for a part or a sensor that the scene lacks"),
    Rule(
        _not_followed,
        "incomplete",
        "this record has another tilt, load or sensor: free a value for one record after its file, "
        "such as oscillator.restoring_force[0]=free",
    ),
    Rule(_uncertain_spring, "fits", "also measure larger motions, or under noise"),
    Rule(_caveat, "predicts", "use the model in the range that the records cover"),
)
OPENINGS = {
    "nothing": "no evidence: the model explains no more than chance",
    "wrong": "the model is wrong: it predicts {left}",
    "incomplete": "the model is wrong or incomplete: it predicts {left}",
    "fits": "the model fits {left}",
    "predicts": "the model predicts {left}",
}
# A fitted value depends on an assumed value if the assumed value's error that the records allow
# changes the fitted value by more than this share of the fitted value's standard error. Otherwise
# an error below `CERTAIN` changes the fitted value by at most two standard errors.
DEPENDS = 0.5
# Records determine an assumed value if its relative standard error, were it free, is below this. In
# a correct model a gain that was uncertain by 88 % seemed wrong by five standard errors: such a
# change is not of first order.
TOLD = 0.1
# Number of standard errors from which records need another assumed value. There are several assumed
# values, and noise of the base's sensor biases them: the mass of a correct model had 3.0.
CERTAIN = 4.0


def _residual_line(record, part):
    text = f"{record.name}, {record.aside}: {part.output} NRMSE {part.left:.2%}, {part.noise:.2%} "
    followed = f"; {part.systematic:.2%} depend on the motion" if record.long else ""
    return f"{text}is noise{followed}{'' if part.is_noise else ': more than noise'}"


def _power(record):
    """Text on predicted and measured power of one record."""
    measured, predicted, difference = record.powers()
    name, unit = record.compared
    text = (
        f"{record.name}: {name} measured {with_error(measured, unit)}, predicted "
        f"{with_error(predicted, unit)}, difference {share_with_error(difference)}"
    )
    if record.windows > 1:
        text += f"; from one start {with_error(record.free_power(), unit)}"
    return text


@dataclass(frozen=True)
class FitEvidence:
    """Evidence for a verdict.

    Attributes
    ----------
    records : sequence of ValidationRecord
        Validation records of the fitted measurements, with their residuals.
    rivals : sequence of Rival
        All compared models, the scene's own first.
    spring : NextPower or None
        Comparison with the model with the spring's next power.
    errors : dict of str to float
        Relative standard error of each fitted value.
    assumptions : sequence of Assumption
        Assumed gains and values, with the effects of their errors.
    kept_aside : sequence of WholeRecord
        Predictions of the measurements that were not fitted.
    visited : Visited or None
        Ranges covered by the records; None if there are only frequency responses.
    """

    records: Sequence[ValidationRecord]
    rivals: Sequence[Rival] = ()
    spring: NextPower | None = None
    errors: Mapping[str, float] = field(default_factory=dict)
    assumptions: Sequence[Assumption] = ()
    kept_aside: Sequence[WholeRecord] = ()
    visited: Visited | None = None

    @cached_property
    def verdict(self) -> FitVerdict:
        """The first of `RULES` whose condition is met."""
        rule, reason = next(
            (rule, reason) for rule in RULES if (reason := rule.condition(self)) is not None
        )
        part = self.worst.worst
        left = f"{part.output} to {part.left:.2%} (noise {part.noise:.2%})"
        opening = OPENINGS[rule.word].format(left=left)
        return FitVerdict(rule.word, f"{opening}; {reason}" if reason else opening, rule.advice)

    @property
    def worst(self) -> ValidationRecord:
        """The record with the largest residual beyond noise; unexplained records come first."""
        return max(self.records, key=lambda record: (not record.is_explained, record.worst.beyond))

    @property
    def best(self) -> list[Rival]:
        """Models that predict as well as the best model whose residuals are noise.

        If no model is better than the scene's, they are the scene's and simpler ones.
        """
        better = [model for model in self.rivals if model.is_better and model.explains]
        if better:
            best = min(better, key=lambda model: model.better)
            return [model for model in better if model.is_close(best.better, best.error)]
        own, *others = [model for model in self.rivals if model.fitted and not model.is_better]
        return [own, *(other for other in others if other.size < own.size and other.is_as_good)]

    @property
    def proposed(self) -> Rival:
        """The simplest of the best models."""
        return min(self.best, key=lambda model: (model.size, model.better))

    @property
    def undecided(self) -> list[Rival]:
        """Other models of the best that are as simple: the records cannot decide."""
        chosen = self.proposed
        return [model for model in self.best if model is not chosen and model.size == chosen.size]

    @property
    def dependent(self) -> dict[str, list[str]]:
        """Gains and other assumed values on whose accuracy each fitted value depends, by key."""
        mixed: dict[str, list[str]] = {}
        for assumption in self.assumptions:
            for key, move in assumption.moves.items():
                if not abs(move) * assumption.error <= DEPENDS * self.errors[key]:
                    mixed.setdefault(key, []).append(self._label(assumption))
        return mixed

    def _label(self, assumption):
        """Name of an assumed value, with its records unless it applies to all."""
        if len(assumption.records) == len(self.records):
            return assumption.key
        return f"{assumption.key} of {', '.join(assumption.records)}"

    def evidence(self) -> list[str]:
        """One sentence for each record, assumption and rival."""
        lines = []
        if self.visited:
            lines.append(f"covered ranges: {self.visited.ranges}")
            lines.append(f"extrapolated: {', '.join(self.visited.extrapolated)}")
        for record in self.records:
            lines += [_residual_line(record, part) for part in record.unexplained]
            lines.append(_power(record))
        mixed = {name for names in self.dependent.values() for name in names}
        lines += [str(entry) for entry in self.assumptions if self._label(entry) in mixed]
        lines += self.spring.findings() if self.spring else []
        lines += map(str, self.kept_aside)
        if claimed := [record for record in self.kept_aside if record.claimed]:
            held = sum(record.holds for record in claimed)
            rms = [record.predicted_rms for record in claimed]
            widths = [
                HALF_INTERVAL * (value.standard_error or 0.0) / value.estimate for value in rms
            ]
            lines.append(
                f"predictions of {len(claimed)} of {len(self.kept_aside)} validation records are "
                f"claimed, {held} agree within their intervals, of ± {min(widths):.1%} to "
                f"{max(widths):.1%} of rms"
            )
        return lines + self._rival_lines()

    def _rival_lines(self):
        """Residual of each rival, or the reason why it was not fitted."""
        lines: list[str] = []
        untried: dict[str, list[str]] = {}
        for rival in self.rivals[1:]:
            if rival.fitted is None:
                untried.setdefault(rival.remark, []).append(rival.name)
                continue
            end = "only noise" if rival.explains else "more than noise"
            if rival is self.proposed:
                end = "proposed"
            elif rival in self.undecided:
                end = "as good as the proposed one"
            lines.append(
                f"rival {rival.name}: {rival.size} values, residual {rival.fitted.nrmse:.2%} "
                f"NRMSE, {end}"
            )
        return lines + [f"{remark}: {', '.join(names)}" for remark, names in untried.items()]
