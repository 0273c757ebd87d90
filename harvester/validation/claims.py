"""Tests the paper's statements by Monte Carlo, by the circuit and by each stationary method."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Unpack

from harvester.averaging.closures import NOISE_CLOSURES
from harvester.base.serialising import fields_of, key, plain
from harvester.base.tables import markdown_table
from harvester.engines.opening import RunnerOptions, open_runner
from harvester.results.view import ResultBase, View
from harvester.scene.calling import takes_scene
from harvester.scene.model import Scene
from harvester.scene.steps import with_knots
from harvester.statistics.agreement import SIGNIFICANT_SIGMAS
from harvester.validation.paper_figures import (
    answered,
    costly_first,
    name_of,
    reason,
    request,
    told_of,
)
from harvester.validation.statements import CLAIMS, FEATURES, JUMPING, Claim, Finding, Trend

HOLDS, IN_PART, FAILS = "holds", "holds in part", "does not hold"
UNDECIDED, UNTESTED = "not significant", "not tested"
# Realizations per scene: equal for all scenes, since their batches are paired.
REALIZATIONS = {"monte-carlo": 48, "circuit": 16}
THOROUGH = {"monte-carlo": 640, "circuit": 104}
METHODS = ("monte-carlo", "circuit", *NOISE_CLOSURES)
# An effect of this number of standard errors is certain, and the number is not printed.
DETERMINISTIC_NOTE = 1e3


@dataclass(frozen=True)
class Opinion:
    """Verdict of one method on a statement, with evidence or the reason why it was not tested."""

    word: str = field(metadata=key("verdict"))
    findings: tuple[Finding, ...] = ()
    reason: str = ""

    IN_JSON: ClassVar = {"where": "where"}

    @property
    def speaking(self) -> tuple[list[Finding], list[Finding], list[Finding]]:
        """Findings (for, against, undecided); undecided includes only decisive findings."""
        pro = [f for f in self.findings if f.sigmas >= SIGNIFICANT_SIGMAS]
        contra = [f for f in self.findings if f.sigmas <= -SIGNIFICANT_SIGMAS]
        open_ = [f for f in self.findings if f.decisive and abs(f.sigmas) < SIGNIFICANT_SIGMAS]
        return pro, contra, open_

    def text(self) -> str:
        """Cell of the table: the verdict and the significance of the weakest finding."""
        pro, contra, open_ = self.speaking
        pro = [f for f in pro if f.decisive]
        undecided = self.word == UNDECIDED
        sigmas = [abs(f.sigmas) for f in (open_ if undecided else pro + contra)]
        finite = [sigma for sigma in sigmas if sigma < DETERMINISTIC_NOTE]
        words = []
        if finite and self.word != UNTESTED:
            words.append(f"≤ {max(finite):.0f} σ" if undecided else f"≥ {min(finite):.0f} σ")
        if self.word == IN_PART and not contra:
            # Nothing contradicts the statement: it may hold with more data.
            words.append(f"{len(open_)} of {len(pro) + len(open_)} undecided")
        return f"{self.word} ({', '.join(words)})" if words else self.word

    @property
    def where(self) -> str:
        """Conditions under which the statement holds, fails or is undecided, as text."""
        pro, contra, open_ = self.speaking
        pro = [f for f in pro if f.decisive] or pro
        return "; ".join(
            f"{word}: {', '.join(f'{f.where} ({f.effect:+.1%})' for f in findings)}"
            for word, findings in (("holds", pro), ("fails", contra), ("undecided", open_))
            if findings
        )


def opinion_of(findings: Sequence[Finding]) -> Opinion:
    """The verdict from all findings."""
    pro, contra, open_ = Opinion("", tuple(findings)).speaking
    if not findings:
        word = UNTESTED
    elif contra:
        word = IN_PART if pro else FAILS
    elif not pro:
        word = UNDECIDED
    else:
        word = IN_PART if open_ else HOLDS
    return Opinion(word, tuple(findings))


@dataclass(frozen=True, repr=False)
class ReproducedStatements(ResultBase):
    """All statements with the verdict of each method; result of `harvester reproduce claims`.

    Attributes
    ----------
    opinions : list of (Claim, dict of str to Opinion)
        Opinions on each statement, by method.
    answers : dict of (str, Changes) to Answer, HarvesterError or None
        Answers by method and changes of the scene.
    """

    scene: Scene
    opinions: list[tuple[Claim, dict[str, Opinion]]]
    answers: dict
    thorough: bool
    wall_seconds: float
    name = "claims"

    def view(self) -> View:
        """Table, findings and pictures."""
        return View(self._table(), self._findings(), texts=lambda: {".md": self.markdown()})

    def _table(self) -> tuple[list[str], list[list[str]]]:
        header = ["section", "statement", *METHODS]
        return header, [[c.section, c.says, *_texts(opinions)] for c, opinions in self.opinions]

    def _findings(self) -> list[str]:
        details = self._details().items()
        return [f"{says}: {line}" if says else line for says, lines in details for line in lines]

    def _details(self):
        """Sentences by statement; "" for general ones."""
        details: dict[str, list[str]] = {}
        for claim, opinions in self.opinions:
            lines = [
                f"{method} {opinion.word}: {opinion.where}"
                for method, opinion in opinions.items()
                if opinion.word not in (HOLDS, UNTESTED)
            ]
            pairs = [f"{where}: {p:+.1%} and {s:+.1%}" for where, p, s in disagreements(opinions)]
            if pairs:
                lines.append(
                    "the printed formulas (paper) and simulation of the printed equations "
                    f"(monte-carlo) disagree: {'; '.join(pairs)}"
                )
            if lines:
                details[claim.says] = lines
        lines = [
            f"{method} refused at {name_of(changes)}: {reason(outcome)}"
            for (method, changes), outcome in self.answers.items()
            if not answered(outcome)
        ]
        if not self.thorough:
            lines.append(
                "the circuit is a hundred times slower: it tests one condition of each statement "
                "(D = 0.08 if possible) and the ends of trends. A thorough run tests all"
            )
        lines.append(
            f"a finding needs at least {SIGNIFICANT_SIGMAS:g} standard errors (by chance one in "
            f"370); seed {self.scene.run.seed}; {self.wall_seconds:.0f} s"
        )
        return {**details, "": lines}

    def markdown(self) -> str:
        """The table with the quoted sentences, and details, collapsible per statement."""
        header = ["section", "sentence", "tested", *METHODS]
        rows = [[c.section, c.sentence, c.says, *_texts(opinions)] for c, opinions in self.opinions]
        details = {
            says: "\n".join(f"- {line}" for line in v) for says, v in self._details().items()
        }
        parts = [markdown_table([header, *rows]), details.pop("")]
        parts.append("## Where a statement does not simply hold")
        parts += [
            f"<details><summary>{says}</summary>\n\n{lines}\n\n</details>"
            for says, lines in details.items()
        ]
        return "\n\n".join(parts) + "\n"

    def to_dict(self) -> dict[str, Any]:
        content = {
            "scene": self.scene,
            "seed": self.scene.run.seed,
            "thorough": self.thorough,
            "wall_seconds": self.wall_seconds,
            "significant_from": SIGNIFICANT_SIGMAS,
            "claims": [
                {
                    **fields_of(claim),
                    "conditions": [dict(condition) for condition in claim.conditions],
                    "verdicts": opinions,
                    "disagreements": [
                        {"where": where, "paper": printed, "monte-carlo": simulated}
                        for where, printed, simulated in disagreements(opinions)
                    ],
                }
                for claim, opinions in self.opinions
            ],
            "points": [
                {"method": method, "changes": dict(changes), **told_of(outcome)}
                for (method, changes), outcome in self.answers.items()
            ],
        }
        return plain(content)


def _texts(opinions):
    return [opinions[method].text() for method in METHODS]


def disagreements(opinions: dict[str, Opinion]) -> list[tuple[str, float, float]]:
    """(where, effect by `paper`, effect by Monte Carlo) where they contradict each other."""
    simulated = {f.where: f for f in opinions["monte-carlo"].findings}
    pairs = [(f, simulated[f.where]) for f in opinions["paper"].findings if f.where in simulated]
    return [
        (printed.where, printed.effect, counterpart.effect)
        for printed, counterpart in pairs
        if min(abs(printed.sigmas), abs(counterpart.sigmas)) >= SIGNIFICANT_SIGMAS
        and (printed.sigmas > 0.0) != (counterpart.sigmas > 0.0)
    ]


@takes_scene
def claims(
    scene: Scene,
    *,
    thorough: bool = False,
    chosen: Sequence[Claim] = CLAIMS,
    **running: Unpack[RunnerOptions],
) -> ReproducedStatements:
    """Test the paper's statements on its device.

    Parameters
    ----------
    scene : Scene, str or Path
    thorough : bool
        Longer runs, and the circuit at every condition.
    chosen : sequence of Claim
    **running
        See `harvester.open_runner`; the folder of the figures contains reusable answers.
    """
    clock = time.perf_counter()
    chosen = tuple(chosen)
    request_of_point = requests_by_point(with_knots(scene), chosen, thorough)
    requests = costly_first(dict.fromkeys(request_of_point.values()))
    with open_runner(**running) as runner:
        outcomes = dict(zip(requests, runner.answer(requests), strict=True))
    answers = {point: outcomes[request] for point, request in request_of_point.items()}
    usable = {point: answer for point, answer in answers.items() if answered(answer)}
    opinions = [
        (claim, {m: _opinion(scene, claim, m, usable) for m in METHODS}) for claim in chosen
    ]
    return ReproducedStatements(scene, opinions, answers, thorough, time.perf_counter() - clock)


def requests_by_point(scene: Scene, chosen: Sequence[Claim], thorough: bool) -> dict:
    """{(method, changes): Request} for all statements."""
    needed, dense = {}, set()
    for claim in chosen:
        for method in METHODS:
            for changes in _changes_of(claim, method, thorough):
                needed[method, changes] = scene.replace(dict(changes))
                if claim.test.quantity in FEATURES:
                    dense.add((method, needed[method, changes]))
    count = THOROUGH if thorough else REALIZATIONS
    requests = {}
    for (method, changes), changed in needed.items():
        # Stationary methods have no time series of moments.
        options = {"moments": True} if method in count else {}
        is_dense = (method, changed) in dense
        requests[method, changes] = request(changed, method, count, is_dense, **options)
    return requests


def _changes_of(claim, method, thorough):
    """Changes of the scene that one method computes."""
    conditions, brief = claim.conditions, method == "circuit" and not thorough
    if brief:
        # The circuit is a hundred times slower than Monte Carlo: only one condition and the ends of
        # trends.
        conditions = [c for c in conditions if c == JUMPING][:1] or conditions[:1]
    scenes = [claim.test.scenes(condition) for condition in conditions]
    if brief and isinstance(claim.test, Trend):
        scenes = [[values[0], values[-1]] for values in scenes]
    return [tuple(sorted(changes)) for values in scenes for changes in values]


def _opinion(scene, claim, method, answers):
    test = claim.test
    if test.of_orbits and method != "paper":
        return Opinion(UNTESTED, reason="a statement on the orbits of Eq. 13, without noise")
    if test.of_orbits:
        return opinion_of(test.findings(scene))
    if test.compares and method == "monte-carlo":
        return Opinion(UNTESTED, reason="Monte Carlo is the reference of the other methods")
    methods = (method, "monte-carlo") if test.compares else (method,)
    reads = [lambda changes, m=m: answers.get((m, tuple(sorted(changes)))) for m in methods]
    findings = [f for condition in claim.conditions for f in test.findings(condition, *reads)]
    if not findings:
        return Opinion(UNTESTED, reason="no answers: not run, refused, or no such quantity")
    return opinion_of(findings)
