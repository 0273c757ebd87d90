"""`claims`: the paper's statements, judged by Monte Carlo, by the circuit and by each closure."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Unpack

from harvester.averaging import CLOSURES
from harvester.calling import takes_scene
from harvester.files.tables import markdown_table
from harvester.files.writing import finite
from harvester.prepared.steps import with_knots
from harvester.running import RunnerOptions, open_runner
from harvester.scene.model import Scene
from harvester.verification.paper.claim_tests import Finding, name_of
from harvester.verification.paper.claims_list import CLAIMS, JUMPING, Claim
from harvester.verification.paper.density_features import FEATURES
from harvester.verification.paper.reproduce import answered, reason
from harvester.verification.paper.runs import costly_first, request

# Standard errors from which on a finding counts; by chance alone one in 370 does.
SIGNIFICANT_SIGMAS = 3.0
HOLDS, IN_PART, FAILS = "holds", "holds in part", "does not hold"
UNDECIDED, UNTESTED = "not significant", "not tested"
# Realizations of each scene: of one number, for their batches are paired.
REALIZATIONS = {"monte-carlo": 48, "circuit": 16}
THOROUGH = {"monte-carlo": 640, "circuit": 104}
METHODS = ("monte-carlo", "circuit", *CLOSURES)


@dataclass(frozen=True)
class Verdict:
    """What one method says of one statement.

    Attributes
    ----------
    word : str
    findings : tuple of Finding
    reason : str
        Why it was not tested; empty otherwise.
    """

    word: str
    findings: tuple = ()
    reason: str = ""

    @property
    def speaking(self) -> tuple[list[Finding], list[Finding], list[Finding]]:
        """(for, against, undecided): of those that the statement needs, what is undecided."""
        pro = [f for f in self.findings if f.sigmas >= SIGNIFICANT_SIGMAS]
        contra = [f for f in self.findings if f.sigmas <= -SIGNIFICANT_SIGMAS]
        open_ = [f for f in self.findings if f.decisive and abs(f.sigmas) < SIGNIFICANT_SIGMAS]
        return pro, contra, open_

    def text(self) -> str:
        """Cell of the table: the verdict, and the significance of its weakest finding."""
        pro, contra, open_ = self.speaking
        pro = [f for f in pro if f.decisive]
        sigmas = [abs(f.sigmas) for f in (open_ if self.word == UNDECIDED else pro + contra)]
        finite_ones = [s for s in sigmas if s < 1e3]
        words = []
        if finite_ones and self.word != UNTESTED:
            most = max(finite_ones) if self.word == UNDECIDED else min(finite_ones)
            words.append(f"{'≤' if self.word == UNDECIDED else '≥'} {most:.0f} σ")
        if self.word == IN_PART and not contra:
            # Nothing speaks against it: more data may make it hold.
            words.append(f"{len(open_)} of {len(pro) + len(open_)} undecided")
        return f"{self.word} ({', '.join(words)})" if words else self.word

    def where(self) -> str:
        """Where it holds, where not, and where nothing can be said, in words."""
        pro, contra, open_ = self.speaking
        pro = [f for f in pro if f.decisive] or pro
        parts = (("holds", pro), ("fails", contra), ("undecided", open_))
        return "; ".join(
            f"{word}: {', '.join(f'{f.where} ({f.effect:+.1%})' for f in findings)}"
            for word, findings in parts
            if findings
        )


def judge(findings: Sequence[Finding]) -> Verdict:
    """The verdict that some findings add up to."""
    verdict = Verdict("", tuple(findings))
    pro, contra, open_ = verdict.speaking
    if not findings:
        word = UNTESTED
    elif contra:
        word = IN_PART if pro else FAILS
    elif not pro:
        word = UNDECIDED
    else:
        word = IN_PART if open_ else HOLDS
    return Verdict(word, verdict.findings)


@dataclass(frozen=True)
class Judgement:
    """All statements with all verdicts; `harvester claims` shows it."""

    scene: Scene
    claims: tuple
    verdicts: list
    answers: dict
    thorough: bool
    wall_seconds: float

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows of the table, as text."""
        header = ["section", "statement", *METHODS]
        rows = [
            [claim.section, claim.says, *(verdicts[m].text() for m in METHODS)]
            for claim, verdicts in zip(self.claims, self.verdicts, strict=True)
        ]
        return header, rows

    def sentences(self) -> list[str]:
        """Details of everything that does not simply hold."""
        lines = []
        for claim, verdicts in zip(self.claims, self.verdicts, strict=True):
            for method, verdict in verdicts.items():
                if verdict.word in (HOLDS, UNTESTED):
                    continue
                lines.append(f"{claim.says}: {method} {verdict.word}: {verdict.where()}")
        for claim, verdicts in zip(self.claims, self.verdicts, strict=True):
            parted = disagreements(verdicts)
            if parted:
                pairs = (f"{where}: {p:+.1%} and {s:+.1%}" for where, p, s in parted)
                lines.append(
                    f"{claim.says}: the printed formulas (paper) and simulation of the printed "
                    f"equations (monte-carlo) disagree: {'; '.join(pairs)}"
                )
        lines += [
            f"{method} refused at {name_of(changes)}: {reason(outcome)}"
            for (method, changes), outcome in self.answers.items()
            if not answered(outcome)
        ]
        if not self.thorough:
            lines.append(
                "the circuit is a hundred times as slow: it judges one condition of each statement "
                "(D = 0.08 where that is one) and the ends of trends; all with --thorough"
            )
        lines.append(
            f"a finding counts from {SIGNIFICANT_SIGMAS:g} standard errors on (by chance one in "
            f"370); seed {self.scene.run.seed}; {self.wall_seconds:.0f} s"
        )
        return lines

    def markdown(self) -> str:
        """The table with the sentences quoted, and the details, as Markdown."""
        header = ["section", "sentence", "tested", *METHODS]
        rows = [
            [claim.section, claim.sentence, claim.says, *(v[m].text() for m in METHODS)]
            for claim, v in zip(self.claims, self.verdicts, strict=True)
        ]
        return (
            markdown_table([header, *rows])
            + "\n\n"
            + "".join(f"- {line}\n" for line in self.sentences())
        )

    def figure(self) -> None:
        """Statements have none."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "scene": self.scene.to_dict(),
            "seed": self.scene.run.seed,
            "thorough": self.thorough,
            "wall_seconds": self.wall_seconds,
            "significant_from": SIGNIFICANT_SIGMAS,
            "claims": [
                {
                    "section": claim.section,
                    "sentence": claim.sentence,
                    "tested": claim.says,
                    "conditions": [dict(condition) for condition in claim.conditions],
                    "verdicts": {m: _verdict_to_dict(v) for m, v in verdicts.items()},
                    "disagreements": [
                        {"where": where, "paper": finite(p), "monte-carlo": finite(s)}
                        for where, p, s in disagreements(verdicts)
                    ],
                }
                for claim, verdicts in zip(self.claims, self.verdicts, strict=True)
            ],
            "points": [
                {"method": method, "changes": dict(changes)}
                | (a.to_dict() if answered(a) else {"refused": reason(a)})
                for (method, changes), a in self.answers.items()
            ],
        }


def disagreements(verdicts: dict[str, Verdict]) -> list[tuple[str, float, float]]:
    """(where, effect by `paper`, effect by Monte Carlo) where one is for and one against it."""
    simulated = {f.where: f for f in verdicts["monte-carlo"].findings}
    pairs = [(f, simulated[f.where]) for f in verdicts["paper"].findings if f.where in simulated]
    return [
        (printed.where, printed.effect, found.effect)
        for printed, found in pairs
        if min(abs(printed.sigmas), abs(found.sigmas)) >= SIGNIFICANT_SIGMAS
        and (printed.sigmas > 0.0) != (found.sigmas > 0.0)
    ]


@takes_scene
def claims(
    scene: Scene,
    *,
    thorough: bool = False,
    chosen: Sequence[Claim] = CLAIMS,
    **running: Unpack[RunnerOptions],
) -> Judgement:
    """Judge the paper's statements on its device.

    Parameters
    ----------
    scene : Scene, str or Path
    thorough : bool
        Longer runs, and the circuit at every condition.
    chosen : sequence of Claim
    **running
        See `harvester.running.open_runner`; in the folder of `reproduce` its answers are found.

    Returns
    -------
    Judgement
    """
    clock = time.perf_counter()
    chosen = tuple(chosen)
    wanted = _wanted(with_knots(scene), chosen, thorough)
    requests = costly_first(dict.fromkeys(wanted.values()))
    with open_runner(**running) as runner:
        outcomes = dict(zip(requests, runner.answer(requests), strict=True))
    answers = {key: outcomes[request] for key, request in wanted.items()}
    verdicts = [{m: _verdict(scene, claim, m, answers) for m in METHODS} for claim in chosen]
    return Judgement(scene, chosen, verdicts, answers, thorough, time.perf_counter() - clock)


def _wanted(scene, chosen, thorough):
    """{(method, changes): Request} of everything that the statements need."""
    needed, dense = {}, set()
    for claim in chosen:
        for method in METHODS:
            for changes in _needed(claim, method, thorough):
                changed = scene.replace(dict(changes))
                needed[method, changes] = changed
                if getattr(claim.test, "quantity", None) in FEATURES:
                    dense.add((method, changed))
    count = THOROUGH if thorough else REALIZATIONS
    return {
        (method, changes): _request(changed, method, (method, changed) in dense, count)
        for (method, changes), changed in needed.items()
    }


def _needed(claim, method, thorough):
    """Changes of the scene that one method is asked for."""
    conditions = claim.conditions
    if method == "circuit" and not thorough:
        # A hundred times as slow as Monte Carlo: one condition, where it says most, and ends.
        conditions = [c for c in conditions if c == JUMPING][:1] or conditions[:1]
    scenes = [claim.test.scenes(condition) for condition in conditions]
    if method == "circuit" and not thorough and hasattr(claim.test, "rises"):
        scenes = [[values[0], values[-1]] for values in scenes]
    return [tuple(sorted(changes)) for values in scenes for changes in values]


def _request(scene, method, density, count):
    options = {"moments": True} if method in count else {}
    return request(scene, method, count, density, **options)


def _verdict(scene, claim, method, answers):
    if hasattr(claim.test, "findings_of_orbits"):
        if method != "paper":
            return Verdict(UNTESTED, reason="a statement on the orbits of Eq. 13, without noise")
        return judge(claim.test.findings_of_orbits(scene))
    if getattr(claim.test, "compares", False) and method == "monte-carlo":
        return Verdict(UNTESTED, reason="Monte Carlo is what the others are compared with")

    def read(changes, of=method):
        answer = answers.get((of, tuple(sorted(changes))))
        return answer if answered(answer) else None

    arguments = []
    if getattr(claim.test, "compares", False):
        arguments.append(lambda changes: read(changes, "monte-carlo"))
    findings = [f for c in claim.conditions for f in claim.test.findings(c, read, *arguments)]
    if not findings:
        return Verdict(UNTESTED, reason="no answers: not run, refused, or not a quantity of it")
    return judge(findings)


def _verdict_to_dict(verdict):
    return {
        "verdict": verdict.word,
        "where": verdict.where(),
        "reason": verdict.reason,
        "findings": [
            {
                "where": finding.where,
                "effect": finite(finding.effect),
                "error": finite(finding.error),
                "margin": finite(finding.margin),
                "standard_errors": finite(finding.sigmas),
            }
            for finding in verdict.findings
        ],
    }
