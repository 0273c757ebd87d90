"""A known result, and what a method makes of it."""

import math
from dataclasses import dataclass
from typing import Any

from harvester.base.errors import HarvesterError, ProgramNotFound
from harvester.base.serialising import plain
from harvester.engines.request import Request, told
from harvester.engines.task import Task
from harvester.validation import SIGNIFICANT_SIGMAS

# Agreement is meaningful if that error is at most this share of the exact value.
SHARPEST_NEEDED = 0.15
HOLDS, FAILS, BLUNT, REFUSED, NOT_HERE, UNFINISHED = (
    "holds", "FAILS", "not known well enough", "refused", "not here", "unfinished",
)  # fmt: skip
# Verdict on a measured device whose values are partly inferred, if a prediction lies beyond the
# limit.
MISSES = "misses"


@dataclass(frozen=True)
class Truth:
    """A result that this project did not compute.

    Attributes
    ----------
    source : str
        Who derived or published it.
    allowance : float
        How far off the simulated device may be because it is not quite that of the result
        (knots of the noise, diodes that are not ideal), in the unit of `exact`.
    asked : dict of str to Request or Task
        What to compute by each method; a task returns (value, standard error).
    quantity : str
        Quantity of an answer, in the scene's units.
    device : str
        Name of the device that was measured; empty for what was derived or computed.
    """

    title: str
    source: str
    exact: float
    allowance: float
    asked: dict[str, Request | Task]
    quantity: str = ""
    unit: str = "scaled"
    device: str = ""


@dataclass(frozen=True)
class TruthRow:
    """One method beside one truth.

    Attributes
    ----------
    value, standard_error : float
        nan where there is none.
    reason : str
        Why there is none.
    skipped : bool
        It needs another program, which is not installed.
    """

    truth: Truth
    method: str
    value: float = math.nan
    standard_error: float = math.nan
    reason: str = ""
    skipped: bool = False

    @property
    def limit(self) -> float:
        """Largest difference that is no disagreement."""
        return SIGNIFICANT_SIGMAS * self.standard_error + self.truth.allowance

    @property
    def verdict(self) -> str:
        """holds, FAILS, misses, not known well enough, refused, not here or unfinished."""
        if self.skipped:
            return NOT_HERE
        if self.reason:
            return UNFINISHED if self.reason == UNFINISHED else REFUSED
        if not abs(self.value - self.truth.exact) <= self.limit:
            return MISSES if self.truth.device else FAILS
        blunt = SIGNIFICANT_SIGMAS * self.standard_error > SHARPEST_NEEDED * abs(self.truth.exact)
        return BLUNT if blunt else HOLDS

    def cells(self) -> list[str]:
        """Cells of the table: result, by, verdict, exact, ours, difference, allowed."""
        named = [self.truth.title, self.method, self.verdict, f"{self.truth.exact:.5g}"]
        if self.reason:
            return [*named, "", "", ""]
        error = f" ± {self.standard_error:.1g}" if self.standard_error else ""
        difference = self._of_exact(self.value - self.truth.exact, "+")
        return [*named, f"{self.value:.5g}{error}", difference, f"± {self._of_exact(self.limit)}"]

    def _of_exact(self, difference, sign=""):
        if not self.truth.exact:
            return f"{difference:{sign}.1g}"
        return f"{difference / abs(self.truth.exact):{sign}.2%}"

    def to_dict(self) -> dict[str, Any]:
        ours = ("method", "value", "standard_error", "verdict", "reason")
        theirs = ("source", "unit", "exact", "allowance", "device")
        return {
            "result": self.truth.title,
            **{name: getattr(self.truth, name) for name in theirs},
            **{name: plain(getattr(self, name)) for name in ours},
        }


def row_of(truth: Truth, method: str, outcome: Any) -> TruthRow:
    """A method beside a truth: its answer, the error it ended with, or None."""
    if outcome is None:
        return TruthRow(truth, method, reason=UNFINISHED)
    if isinstance(outcome, ProgramNotFound):
        return TruthRow(truth, method, reason=str(outcome), skipped=True)
    if isinstance(outcome, HarvesterError):
        return TruthRow(truth, method, reason=told(outcome))
    if isinstance(outcome, (tuple, list)):
        return TruthRow(truth, method, *outcome)
    estimate = outcome.in_units()[truth.quantity]
    error = estimate.standard_error if outcome.scene.excitation.random else 0.0
    if error is None:
        return TruthRow(truth, method, reason=f"no error bar: {'; '.join(outcome.notes)}")
    return TruthRow(truth, method, estimate.estimate, error)
