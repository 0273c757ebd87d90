"""Verdicts of `harvester stability`, from independent comparisons of known accuracy.

References are independent of the compared answer: a fine path for a path, the stationary solution
or a closed form for Monte Carlo's means, a coarser grid for a stationary method. Each comparison
states its resolution. A cell is *right* if no reference disagrees and at least one is known to 2 %
or better; else it is *not judged*.
"""

import math
from dataclasses import dataclass, field
from typing import Any

from harvester.base.errors import AveragingError, LoadError, SceneError, SimulatorTimeout
from harvester.base.serialising import fields_of, key, plain
from harvester.device.piezo import BaseForcedPiezo
from harvester.engines.methods import ENGINES
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.validation import MEANS
from harvester.validation.closed_forms import closed_forms
from harvester.validation.stability_cases import Case, CaseAnswer

RIGHT, REFUSED, WRONG = "right", "refused", "wrong"
NOT_JUDGED, UNFINISHED = "not judged", "unfinished"
WORDS = (RIGHT, REFUSED, NOT_JUDGED, UNFINISHED, WRONG)
REFUSALS = (SceneError, LoadError, AveragingError)
# Largest residual of the energy balance, as a share of the energy.
LARGEST_RESIDUAL = 0.01
# Largest relative error of a comparison that counts.
SHARP_ENOUGH = 0.02
# Largest deviation of means in joint standard errors: with 200 independent normal comparisons, one
# matrix in eighty has a false alarm.
LARGEST_SIGMAS = 4.0
# Relative error (one standard deviation) of the stationary solution in addition to its stated
# numerical error, from long simulations.
SOLVER_ERROR = 5e-3
# Largest deviation of the mean squares along comparable paths at the requested step.
LARGEST_STEP_BIAS = 0.03
# Smallest comparable length of paths in periods, and share of it that an engine must follow.
FEWEST_PERIODS = 1.0
LEAST_FOLLOWED = 0.1
# Largest deviation of a stationary method from its coarser grid; fokker_planck has a separate
# limit.
LARGEST_NUMERICAL_ERROR = {"fokker_planck": 2e-2}
USUAL_NUMERICAL_ERROR = 1e-3
SOLVER = "fokker_planck"
SHORT_NAMES = {
    "coarser grid": "grid",
    "fokker_planck": "stationary",
    "the mass under the recorded voltage": "mass",
}


@dataclass(frozen=True)
class Evidence:
    """Comparison with one reference: relative deviation and its limit.

    Attributes
    ----------
    of : str
        Name of the compared quantity.
    sharpness : float
        Joint standard error of means; for a path the deviation explained by its step.
    largest : float
        Largest deviation that counts as agreement.
    """

    reference: str = field(metadata=key("judge"))
    of: str
    deviation: float
    sharpness: float
    largest: float = field(metadata=key("limit"))

    @property
    def agrees(self) -> bool:
        """Whether the deviation is within the limit; False for NaN."""
        return abs(self.deviation) <= self.largest

    @property
    def sharp(self) -> bool:
        """Whether the comparison is accurate enough to call a cell right."""
        return self.sharpness <= SHARP_ENOUGH

    def __str__(self):
        return f"{self.of} is {self.deviation:+.2%} off {self.reference} (limit {self.largest:.2%})"


@dataclass(frozen=True)
class CaseVerdict:
    """The verdict on one case by one method: one of `WORDS`, the reason, and the evidence."""

    word: str = field(metadata=key("verdict"))
    reason: str = ""
    evidence: tuple[Evidence, ...] = ()

    @property
    def references(self) -> list[Evidence]:
        """Sharp evidence, one per reference (preferably on E[V²]), most accurate first."""
        first: dict[str, Evidence] = {}
        for evidence in self.evidence:
            first.setdefault(evidence.reference, evidence)
        return sorted((e for e in first.values() if e.sharp), key=lambda e: e.sharpness)

    def text(self) -> str:
        """The verdict, or the references and their accuracy."""
        if self.word != RIGHT:
            return self.word
        return ", ".join(f"{_short(e.reference)} {_percent(e.sharpness)}" for e in self.references)


@dataclass(frozen=True)
class CaseRow:
    """One case: outcome and verdict of every engine and stationary method.

    Attributes
    ----------
    answers : dict of str to CaseAnswer, HarvesterError or None
        Answers by engine and stationary method; None if the time budget was spent before.
    cells : dict of str to CaseVerdict
    """

    case: Case
    answers: dict[str, Any]
    cells: dict[str, CaseVerdict]

    def answer(self, method: str) -> CaseAnswer | None:
        answer = self.answers[method]
        return answer if isinstance(answer, CaseAnswer) else None

    def to_dict(self) -> dict[str, Any]:
        answered = {method: self.answer(method) for method in self.answers}
        return {
            **fields_of(self.case),
            "verdicts": plain(self.cells),
            "answers": plain({method: answer for method, answer in answered.items() if answer}),
        }


def row_of_case(case: Case, scene: Scene | None, answers: dict[str, Any]) -> CaseRow:
    """The row of one case from the outcomes of all methods; `scene`: of the case."""
    cells = {method: _without_answer(outcome) for method, outcome in answers.items()}
    answered = {method: answers[method] for method, cell in cells.items() if cell is None}
    for method, answer in answered.items():
        evidence = _of_engine(answer) if method in ENGINES else _of_closure(method, answer)
        cells[method] = _weighed(answer, (*evidence, *_of_means(method, scene, answered)))
    return CaseRow(case, answers, cells)


def _without_answer(outcome):
    """The verdict without an answer; None if there is an answer."""
    if isinstance(outcome, CaseAnswer):
        return None
    if outcome is None:
        return CaseVerdict(UNFINISHED, "the time budget was spent before this case")
    if isinstance(outcome, SimulatorTimeout):
        return CaseVerdict(UNFINISHED, str(outcome))
    if isinstance(outcome, REFUSALS):
        return CaseVerdict(REFUSED, str(outcome))
    return CaseVerdict(WRONG, f"{type(outcome).__name__}: {outcome}")


def _weighed(answer, evidence):
    if answer.residual is not None and not abs(answer.residual) < LARGEST_RESIDUAL:
        return CaseVerdict(WRONG, f"energy balance residual {answer.residual:.2%}", evidence)
    objections = [str(comparison) for comparison in evidence if not comparison.agrees]
    if objections:
        return CaseVerdict(WRONG, "; ".join(objections), evidence)
    cell = CaseVerdict(RIGHT, "", evidence)
    return (
        cell if cell.references else CaseVerdict(NOT_JUDGED, _why_not(answer, evidence), evidence)
    )


def _why_not(answer, evidence):
    if evidence:
        return f"known to {min(comparison.sharpness for comparison in evidence):.0%} only"
    if answer.path and answer.path.comparable_periods < FEWEST_PERIODS:
        return f"paths can be compared for {answer.path.comparable_periods:.1f} periods only"
    if answer.path:
        return f"its path can be compared for {answer.path.compared_periods:.1f} periods only"
    return "nothing to compare it with"


def _of_engine(answer):
    """Evidence on an engine, from the comparison of its paths with fine ones."""
    path = answer.path
    if not path.comparable_periods >= FEWEST_PERIODS:
        return ()
    reference = f"fine {path.reference} path"
    followed = path.compared_periods / path.comparable_periods
    if followed < LEAST_FOLLOWED:
        return (Evidence(reference, "length of the path followed", followed - 1.0, 1.0, 0.0),)
    if path.compared_periods < FEWEST_PERIODS:
        return ()
    limits = {reference: path.of_limit}
    if not math.isnan(path.of_mechanics):
        limits["the mass under the recorded voltage"] = path.of_mechanics
    words, allowed = "limit for short steps", path.resolution
    evidence = [Evidence(name, words, of, allowed, allowed) for name, of in limits.items()]
    squares = "mean squares along the path"
    bias = Evidence(reference, squares, path.of_mean_squares, LARGEST_STEP_BIAS, LARGEST_STEP_BIAS)
    return (*evidence, bias)


def _of_closure(closure, answer):
    """Evidence on a stationary method's numerical error, from the coarser grid."""
    largest = LARGEST_NUMERICAL_ERROR.get(closure, USUAL_NUMERICAL_ERROR)
    evidence = []
    for name in MEANS:
        estimate = answer.estimates[name]
        share = _share(estimate.standard_error, estimate.estimate)
        evidence.append(Evidence("coarser grid", _words(name), share, share, largest))
    return evidence


def _of_means(method, scene, answered):
    """Evidence on means: Monte Carlo against the stationary solution, and against closed forms.

    Only these two solve the equations without further approximation.
    """
    simulated, solved = answered.get("monte-carlo"), answered.get(SOLVER)
    model = prepared(scene)
    if isinstance(model.system.transducer, BaseForcedPiezo):
        # The stationary solution neglects the charge moved by the base.
        solved = None
    if method not in ("monte-carlo", SOLVER) or not simulated or not simulated.settled:
        return []
    if method == SOLVER:
        return list(_of_pair(simulated, solved, "Monte Carlo")) if solved else []
    evidence = [
        comparison
        for form, means in closed_forms(model, simulated.realizations).items()
        for name, (value, error) in means.items()
        for comparison in _of_mean(form, name, simulated.estimates[name], value, error)
    ]
    if solved:
        # If circuit and Monte Carlo follow the same path, the stationary solution is wrong.
        by_path = _of_engine(answered["circuit"]) if "circuit" in answered else ()
        same_path = bool(by_path) and all(comparison.agrees for comparison in by_path)
        pair = _of_pair(simulated, solved, SOLVER)
        evidence += [comparison for comparison in pair if comparison.agrees or not same_path]
    return evidence


def _of_pair(simulated, solved, reference):
    for name in MEANS:
        ours, theirs = simulated.estimates[name], solved.estimates[name]
        error = max(theirs.standard_error, SOLVER_ERROR * abs(theirs.estimate))
        yield from _of_mean(reference, name, ours, theirs.estimate, error)


def _of_mean(reference, name, ours, value, error):
    """Evidence on one mean; none without an error bar or without harvested power."""
    if ours.standard_error is None or ours.estimate == value == 0.0:
        return
    joint = _share(math.hypot(ours.standard_error, error), value)
    deviation = _share(ours.estimate - value, value)
    yield Evidence(reference, _words(name), deviation, joint, LARGEST_SIGMAS * joint)


def _share(part, total):
    """part/total; 0 if both are 0."""
    if part == 0.0:
        return 0.0
    return part / abs(total) if total else math.inf


def _words(name):
    return name.replace("_", " ")


def _short(reference):
    return "path" if reference.endswith("path") else SHORT_NAMES.get(reference, reference)


def _percent(share):
    """A percentage with two significant digits."""
    return f"{100.0 * share:.2g} %" if share >= 1e-4 else "<0.01 %"
