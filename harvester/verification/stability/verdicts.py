"""Verdicts of `harvester stability`: *right*, *refused* or *wrong*, from what was computed."""

import math
from dataclasses import dataclass, field

from harvester.averaging import AVERAGED
from harvester.engines.protocol import ENGINES
from harvester.errors import AveragingError, SceneError
from harvester.scene.model import Scene
from harvester.verification.stability.cases import Case

RIGHT, REFUSED, WRONG = "right", "refused", "wrong"
REFUSALS = (SceneError, AveragingError)
JUDGED = ("mean_square_voltage", "mean_square_velocity", "power_conversion_efficiency")
# Largest difference of the engines in joint standard errors, or as a share where they follow the
# same path; largest share of the energy that is not found again. Three means of some sixty cases,
# were they all independent, would give one false alarm in ten matrices.
LARGEST_SIGMAS = 3.5
SAME_PATH = 2e-3
SAME_VALUE = 1e-9
LARGEST_RESIDUAL = 0.01
# Of a closure's answer against its own coarser grid.
LARGEST_NUMERICAL_ERROR = 1e-3


@dataclass(frozen=True)
class Answer:
    """What one engine or closure says of one case, in scaled units.

    Attributes
    ----------
    estimates : dict of str to Estimate
    residual : float or None
        Of the energy balance; None for a closure.
    seconds : float
        Wall time.
    steps, realizations : int
        0 for a closure.
    duration, settle, step : float or None
        Of each realization, as it was run, and its longest step (s); None for a closure.
    """

    estimates: dict
    residual: float | None
    seconds: float
    steps: int = 0
    realizations: int = 0
    duration: float | None = None
    settle: float | None = None
    step: float | None = None


@dataclass(frozen=True)
class Verdict:
    """`RIGHT`, `REFUSED` or `WRONG`, and why."""

    word: str
    reason: str = ""


@dataclass(frozen=True)
class Row:
    """One case: verdicts on the simulation and on each closure, and what they rest on.

    Attributes
    ----------
    case : Case
    scene : Scene or None
        None where the case is none for the scene.
    answers : dict of str to Answer or HarvesterError
        By engine and closure.
    simulation : Verdict
    closures : dict of str to Verdict
    differences : dict of str to float
        Circuit minus Monte Carlo in joint standard errors, by quantity.
    """

    case: Case
    scene: Scene | None
    answers: dict
    simulation: Verdict
    closures: dict
    differences: dict = field(default_factory=dict)

    def residual(self, engine):
        """Energy balance residual, nan without one."""
        answer = self.answers[engine]
        return answer.residual if isinstance(answer, Answer) else math.nan

    def seconds(self, method):
        """Wall time of one engine or closure, nan without an answer."""
        answer = self.answers[method]
        return answer.seconds if isinstance(answer, Answer) else math.nan

    def numerical_error(self, closure):
        """Largest error of a closure against its coarser grid, as a share; nan without any."""
        answer = self.answers[closure]
        if not isinstance(answer, Answer):
            return math.nan
        return max(_share(estimate) for estimate in answer.estimates.values())

    @property
    def worst_difference(self):
        """Largest difference in size, in joint standard errors; nan without any."""
        sizes = [abs(d) for d in self.differences.values() if not math.isnan(d)]
        return max(sizes, default=math.nan)

    def resolution(self, name):
        """Joint standard error as a share of Monte Carlo's mean; nan without answers."""
        pair = [self.answers[engine] for engine in ENGINES]
        if not all(isinstance(answer, Answer) for answer in pair):
            return math.nan
        mean = pair[1].estimates[name].estimate
        return _joint_error(*pair, name) / abs(mean) if mean else math.nan


def judged(case, scene, answers):
    """The row of one case from what engines and closures said.

    Parameters
    ----------
    case : Case
    scene : Scene or None
    answers : dict of str to Answer or HarvesterError
        By engine and closure.
    """
    circuit, monte_carlo = (answers[engine] for engine in ENGINES)
    closures = {name: _judge_closure(answers[name]) for name in AVERAGED if name in answers}
    failed = _judge_failures({engine: answers[engine] for engine in ENGINES})
    if failed:
        return Row(case, scene, answers, failed, closures)
    differences = {name: _difference(circuit, monte_carlo, name) for name in JUDGED}
    verdict = _judge_simulation(circuit, monte_carlo, differences)
    return Row(case, scene, answers, verdict, closures, differences)


def _judge_failures(answers):
    """Verdict where an engine gave no answer; None where both did."""
    for word, refusal in ((WRONG, False), (REFUSED, True)):
        for engine, outcome in answers.items():
            if isinstance(outcome, Answer) or isinstance(outcome, REFUSALS) != refusal:
                continue
            name = type(outcome).__name__
            return Verdict(word, str(outcome) if refusal else f"{engine}: {name}: {outcome}")
    return None


def _judge_simulation(circuit, monte_carlo, differences):
    for engine, outcome in zip(ENGINES, (circuit, monte_carlo), strict=True):
        if not abs(outcome.residual) < LARGEST_RESIDUAL:
            return Verdict(WRONG, f"{engine}: energy balance residual {outcome.residual:.2%}")
    for name, sigmas in differences.items():
        ours, theirs = circuit.estimates[name].estimate, monte_carlo.estimates[name].estimate
        same_path = abs(ours - theirs) <= SAME_PATH * abs(theirs)
        if not (same_path or abs(sigmas) <= LARGEST_SIGMAS):
            label = name.replace("_", " ")
            return Verdict(
                WRONG, f"{label}: circuit {ours:.4g}, Monte Carlo {theirs:.4g}, {sigmas:+.1f} σ"
            )
    return Verdict(RIGHT)


def _judge_closure(outcome):
    if isinstance(outcome, REFUSALS):
        return Verdict(REFUSED, str(outcome))
    if not isinstance(outcome, Answer):
        return Verdict(WRONG, f"{type(outcome).__name__}: {outcome}")
    for name, estimate in outcome.estimates.items():
        if not (math.isfinite(estimate.estimate) and _share(estimate) <= LARGEST_NUMERICAL_ERROR):
            label = name.replace("_", " ")
            return Verdict(
                WRONG, f"{label}: {estimate.estimate:.4g} ± {estimate.standard_error:.2g}"
            )
    return Verdict(RIGHT)


def _share(estimate):
    """Error as a share of the estimate; 0 where both vanish."""
    if estimate.standard_error == 0.0:
        return 0.0
    return abs(estimate.standard_error / estimate.estimate) if estimate.estimate else math.inf


def _difference(circuit, monte_carlo, name):
    """Circuit minus Monte Carlo in joint standard errors; nan without an error bar."""
    difference = circuit.estimates[name].estimate - monte_carlo.estimates[name].estimate
    error = _joint_error(circuit, monte_carlo, name)
    if error == 0.0:
        share = abs(difference) / (abs(monte_carlo.estimates[name].estimate) or 1.0)
        return 0.0 if share <= SAME_VALUE else math.inf
    return difference / error


def _joint_error(circuit, monte_carlo, name):
    """As of independent means: the same noise makes it conservative.

    Monte Carlo has more realizations, so that it knows of rare events, jumps between wells above
    all, which the circuit's own few may not hold: its error bar, at their number, is the least
    that the circuit's can be.
    """
    ours, theirs = (a.estimates[name].standard_error for a in (circuit, monte_carlo))
    if ours is None or theirs is None:
        return math.nan
    least = theirs * math.sqrt(monte_carlo.realizations / circuit.realizations)
    return math.hypot(max(ours, least), theirs)
