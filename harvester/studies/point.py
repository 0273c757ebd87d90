"""One point of a load study: realizations are added until its power is precise enough."""

import math
from collections.abc import Generator
from dataclasses import dataclass, replace

from harvester.prepared.prepared import prepared
from harvester.prepared.steps import step_error
from harvester.running.realizations import Realizations, averaging, is_closure
from harvester.running.request import (
    FIRST_REALIZATIONS,
    aim_beside_steps,
    good_ones,
    next_count,
    note_on_steps,
)
from harvester.running.task import Wanted
from harvester.scene.model import Scene
from harvester.studies.evaluation import Evaluation, evaluate

# With a precision, of one point.
MOST_REALIZATIONS = 4000


@dataclass(frozen=True)
class Point:
    """What a point's realizations are, and when they are enough.

    Attributes
    ----------
    scene : Scene
    method : str
        Engine or closure.
    step : str or float
    version : str
        See `harvester.running.runner.Runner.version`.
    precision : float or None
        Relative error of the output power, what the steps may cost included; None: the scene's own
        run.
    """

    scene: Scene
    method: str
    step: str | float
    version: str
    precision: float | None

    def plan(self) -> Generator[Wanted, list, Evaluation]:
        """For `Runner.follow`; returns an Evaluation."""
        if is_closure(self.method):
            answers = yield Wanted([averaging(self.scene, self.method)])
            return evaluate(self.scene, *good_ones(answers))
        cut = Realizations.of(self.scene, self.method, self.step, self.version, waveform=True)
        most = MOST_REALIZATIONS if self.precision else self.scene.run.realizations
        cost = step_error(prepared(self.scene), self.step, self.method)
        # Without a precision the first round is the whole run.
        aim = aim_beside_steps(self.precision, cost) if self.precision else math.inf
        found: list = []
        had, count, ahead = 0, FIRST_REALIZATIONS if self.precision else most, 0.0
        while True:
            found += yield Wanted(cut.tasks(had, count, most), ahead)
            evaluation = evaluate(self.scene, *good_ones(found), cost)
            # Ended early, as long as can be, or precise enough.
            if evaluation.realizations < count or count >= most or evaluation.relative_error <= aim:
                return self._with_note(evaluation, cost)
            reached = evaluation.relative_error
            had, count = count, next_count(count, reached, aim, cut, most)
            needed = min(had * (reached / aim) ** 2, most)
            ahead = max(needed - count, 0.0) / cut.size

    def _with_note(self, evaluation, cost):
        note = note_on_steps(self.precision, cost) if self.precision else ""
        if not note or not evaluation.realizations:
            return evaluation
        return replace(evaluation, outcome=f"{evaluation.outcome}; {note}")
