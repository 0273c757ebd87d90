"""A known result, what each method makes of it, and the table of all of them."""

import datetime
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Unpack

from harvester.arguments import checked_options, usual_arithmetic
from harvester.errors import HarvesterError, ProgramNotFound
from harvester.files.serialising import plain
from harvester.files.tables import markdown_table
from harvester.running import Request, RunnerOptions, Task, open_runner
from harvester.running.request import told
from harvester.verification.quantities import SIGNIFICANT_SIGMAS
from harvester.version import __version__

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
        """Plain values for JSON."""
        ours = ("method", "value", "standard_error", "verdict", "reason")
        theirs = ("source", "unit", "exact", "allowance", "device")
        return {
            "result": self.truth.title,
            **{name: getattr(self.truth, name) for name in theirs},
            **{name: plain(getattr(self, name)) for name in ours},
        }


@dataclass(frozen=True)
class Verification:
    """All rows; `harvester verify` shows it. `date` is that of the day, in ISO 8601."""

    rows: list[TruthRow]
    wall_seconds: float
    date: str

    @property
    def scene(self) -> None:
        """None: every result has a scene of its own."""

    @property
    def failed(self) -> list[TruthRow]:
        """Rows that disagree; a measured device that is missed is no fault of the program."""
        return [row for row in self.rows if row.verdict == FAILS]

    @property
    def exact(self) -> list[TruthRow]:
        """Rows of truths that were derived or computed, not measured."""
        return [row for row in self.rows if not row.truth.device]

    @property
    def measured(self) -> list[TruthRow]:
        """Rows of measured devices."""
        return [row for row in self.rows if row.truth.device]

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows of the table, as text."""
        header = ["result", "by", "verdict", "exact", "ours", "difference", "allowed"]
        return header, [row.cells() for row in self.rows]

    def sentences(self) -> list[str]:
        """How many rows hold, and everything about those that do not."""
        if not self.measured:
            return self._said_of_exact()
        from harvester.verification.known_results.measured_page import summary

        within = sum(row.verdict == HOLDS for row in self.measured)
        lines = [
            *self._said_of_exact(),
            f"measured devices: {within} of {len(self.measured)} rows within what reading and "
            "scatter of the measurement allow",
        ]
        for name in dict.fromkeys(row.truth.device for row in self.measured):
            device_rows = [row for row in self.measured if row.truth.device == name]
            reason = next((row.reason for row in device_rows if row.reason), "")
            # A set that was downloaded is one row.
            first = device_rows[0]
            single = f"{first.value:.2%} {first.truth.unit}, {first.verdict}"
            prediction = f"predicted {summary(device_rows)}" if len(device_rows) > 1 else single
            lines.append(f"{name}: {reason or prediction}")
        return lines

    def _said_of_exact(self):
        if not self.exact:
            return []
        others = [row for row in self.exact if row.verdict != HOLDS]
        count = len(self.exact) - len(others)
        return [
            f"{count} of {len(self.exact)} rows hold ({self.wall_seconds:.0f} s). A row may be "
            f"{SIGNIFICANT_SIGMAS:g} standard errors off, which one in 370 exceeds by chance, and "
            "as much more as the simulated device differs from that of the exact result.",
            *(f"{row.truth.title}, {row.method}: {row.reason or row.verdict}" for row in others),
        ]

    def markdown(self) -> str:
        """A page with the table, numbered sources and everything about rows that do not hold."""
        header, _ = self.table()
        sources = list(dict.fromkeys(row.truth.source for row in self.exact))
        lines = [[*header, "source"]]
        before = None
        for row in self.exact:
            cells = row.cells()
            # The truth is printed once if several methods are compared with it.
            named = cells if row.truth is not before else ["", *cells[1:3], "", *cells[4:]]
            lines.append([*named, str(1 + sources.index(row.truth.source))])
            before = row.truth
        parts = [
            "# Verified against others",
            "*For whoever asks why to believe a number.*",
            f"Written by `harvester verify`, harvester {__version__}, {self.date}: closed forms, "
            "exact limits, published powers and other integrators beside this project's results.",
            "\n".join(f"- {line}" for line in self._said_of_exact()),
            markdown_table(lines),
            "## Sources",
            "\n".join(f"{number}. {source}" for number, source in enumerate(sources, 1)),
        ]
        return "\n\n".join(parts) + "\n"

    def texts(self) -> dict[str, str]:
        """The page of the measured devices."""
        if not self.measured:
            return {}
        from harvester.verification.known_results.measured_page import measured_page

        return {"-measured.md": measured_page(self.measured, self.date)}

    def figure(self) -> None:
        """The table says it all."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "agreeing_sigmas": SIGNIFICANT_SIGMAS,
            "wall_seconds": self.wall_seconds,
            "version": __version__,
            "date": self.date,
            "rows": plain(self.rows),
        }


def verify(
    *, chosen: Sequence[Truth] | None = None, **running: Unpack[RunnerOptions]
) -> Verification:
    """Exact and published results beside this project's.

    Parameters
    ----------
    chosen : sequence of Truth or None
        Truths out of `harvester.verification.known_results.catalogue` and of `measured` beside it;
        None: all.
    **running
        See `harvester.running.open_runner`.
    """
    if chosen is None:
        from harvester.verification.known_results.catalogue import catalogue
        from harvester.verification.known_results.measured import measured

        chosen = [*catalogue(), *measured()]
    clock = time.perf_counter()
    asked = [
        (truth, method, question) for truth in chosen for method, question in truth.asked.items()
    ]
    requests = [question for *_, question in asked if isinstance(question, Request)]
    tasks = [question for *_, question in asked if isinstance(question, Task)]
    with usual_arithmetic(), open_runner(**checked_options(dict(running))) as runner:
        answers = iter(runner.answer(requests))
        results = iter(runner.run(tasks))
    rows = [
        row_of(truth, method, next(answers if isinstance(question, Request) else results))
        for truth, method, question in asked
    ]
    today = datetime.date.today().isoformat()
    return Verification(rows, time.perf_counter() - clock, today)


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
