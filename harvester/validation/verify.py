"""`verify`: compares exact, published and measured results with this project's; two pages."""

from __future__ import annotations

import datetime
import itertools
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from harvester.base.errors import HarvesterError, ProgramNotFound
from harvester.base.formatting import Printed, written
from harvester.base.serialising import plain
from harvester.base.tables import markdown_table
from harvester.engines.request import Request, told
from harvester.engines.runner import Runner
from harvester.engines.task import Task
from harvester.results.view import ResultBase, View
from harvester.statistics.agreement import SIGNIFICANT_SIGMAS, differ
from harvester.validation import entries
from harvester.validation.known_results import Truth, catalogue, measured, scatter_of
from harvester.version import __version__

# Largest relative error of a result for which agreement is meaningful.
SHARPEST_NEEDED = 0.15
HOLDS, FAILS, BLUNT, REFUSED, NOT_HERE, UNFINISHED = (
    "holds", "FAILS", "not known well enough", "refused", "not here", "unfinished",
)  # fmt: skip
# Verdict if a prediction for a measured device, with partly inferred values, exceeds the limit.
MISSES = "misses"


@dataclass(frozen=True)
class TruthRow:
    """One method compared with one known result.

    Attributes
    ----------
    value, standard_error : float
        nan without a result.
    reason : str
        Why there is no result.
    ended : str
        The verdict without a result.
    """

    truth: Truth
    method: str
    value: float = math.nan
    standard_error: float = math.nan
    reason: str = ""
    ended: str = ""

    @property
    def limit(self) -> float:
        """Largest difference that counts as agreement."""
        return SIGNIFICANT_SIGMAS * self.standard_error + self.truth.allowance

    @property
    def verdict(self) -> str:
        """holds, FAILS, misses, not known well enough, refused, not here or unfinished."""
        if self.ended:
            return self.ended
        off, allowance = self.value - self.truth.exact, self.truth.allowance
        if math.isnan(off) or differ(off, self.standard_error, allowance=allowance):
            return MISSES if self.truth.device else FAILS
        blunt = SIGNIFICANT_SIGMAS * self.standard_error > SHARPEST_NEEDED * abs(self.truth.exact)
        return BLUNT if blunt else HOLDS

    @property
    def deviation(self) -> float:
        return self.value / self.truth.exact - 1.0

    def cells(self) -> list[str]:
        """Cells of the table: result, by, verdict, exact, ours, difference, allowed."""
        exact, unit = self.truth.exact, self.truth.unit
        named = [self.truth.title, self.method, self.verdict, written(exact, ".5g", unit)]
        if self.reason:
            return [*named, "", "", ""]
        error = f" ± {self.standard_error:.1g}" if self.standard_error else ""
        ours = Printed(f"{self.value:.5g}{error}", self.value, self.standard_error, unit)
        off, allowed = self._of_exact(self.value - exact, "+"), self._of_exact(self.limit)
        return [*named, ours, off, Printed(f"± {allowed}", allowed.value)]

    def _of_exact(self, difference, sign=""):
        if not self.truth.exact:
            return written(difference, f"{sign}.1g")
        return written(difference / abs(self.truth.exact), f"{sign}.2%")

    def to_dict(self) -> dict[str, Any]:
        ours = ("method", "value", "standard_error", "verdict", "reason")
        theirs = ("source", "unit", "exact", "allowance", "device")
        return {
            "result": self.truth.title,
            **{name: getattr(self.truth, name) for name in theirs},
            **{name: plain(getattr(self, name)) for name in ours},
        }


def row_of(truth: Truth, method: str, outcome: Any) -> TruthRow:
    """Row of a known result and a method's outcome: an answer, an error, or None."""
    if outcome is None:
        return TruthRow(truth, method, reason=UNFINISHED, ended=UNFINISHED)
    if isinstance(outcome, ProgramNotFound):
        return TruthRow(truth, method, reason=str(outcome), ended=NOT_HERE)
    if isinstance(outcome, HarvesterError):
        return TruthRow(truth, method, reason=told(outcome), ended=REFUSED)
    if isinstance(outcome, (tuple, list)):
        return TruthRow(truth, method, *outcome)
    estimate = outcome.in_units()[truth.quantity]
    error = estimate.standard_error if outcome.scene.excitation.random else 0.0
    if error is None:
        reason = f"no error bar: {'; '.join(outcome.notes)}"
        return TruthRow(truth, method, reason=reason, ended=REFUSED)
    return TruthRow(truth, method, estimate.estimate, error)


@dataclass(frozen=True, repr=False)
class Verification(ResultBase):
    """All rows; the result of `harvester verify`. `date`: the current date, in ISO 8601."""

    rows: list[TruthRow]
    wall_seconds: float
    date: str

    agreeing_sigmas, version = SIGNIFICANT_SIGMAS, __version__
    IN_JSON: ClassVar = {"agreeing_sigmas": "agreeing_sigmas", "version": "version"}

    @property
    def scene(self) -> None:
        """None: every row has its own scene."""

    @property
    def failed(self) -> list[TruthRow]:
        """Rows that disagree, without measured devices."""
        return [row for row in self.rows if row.verdict == FAILS]

    @property
    def exact(self) -> list[TruthRow]:
        """Rows of derived or computed results, without measured ones."""
        return [row for row in self.rows if not row.truth.device]

    @property
    def measured(self) -> list[TruthRow]:
        return [row for row in self.rows if row.truth.device]

    def view(self) -> View:
        """Table, findings and pictures."""
        return View(self._table(), self._findings(), texts=self.texts)

    def _table(self) -> tuple[list[str], list[list[str]]]:
        header = ["result", "by", "verdict", "exact", "ours", "difference", "allowed"]
        return header, [row.cells() for row in self.rows]

    def _findings(self) -> list[str]:
        """Number of agreeing rows, and details of the others."""
        lines = self._exact_sentences()
        if self.measured:
            within = sum(row.verdict == HOLDS for row in self.measured)
            lines.append(
                f"measured devices: {within} of {len(self.measured)} rows within the error that "
                "reading and scatter of the measurement allow"
            )
        for name, rows in _by_device(self.measured).items():
            reason = next((row.reason for row in rows if row.reason), "")
            # A downloaded data set is one row.
            single = f"{rows[0].value:.2%} {rows[0].truth.unit}, {rows[0].verdict}"
            prediction = f"predicted {summary(rows)}" if len(rows) > 1 else single
            lines.append(f"{name}: {reason or prediction}")
        return lines

    def _exact_sentences(self):
        if not self.exact:
            return []
        others = [row for row in self.exact if row.verdict != HOLDS]
        count = len(self.exact) - len(others)
        return [
            f"{count} of {len(self.exact)} rows hold ({self.wall_seconds:.0f} s). A row may be "
            f"{SIGNIFICANT_SIGMAS:g} standard errors off, which one in 370 exceeds by chance, plus "
            "the known difference between the simulated and the exact device.",
            *(f"{row.truth.title}, {row.method}: {row.reason or row.verdict}" for row in others),
        ]

    def markdown(self) -> str:
        """A page with the table, numbered sources and details of rows that do not agree."""
        sources = list(dict.fromkeys(row.truth.source for row in self.exact))
        lines, before = [[*self._table()[0], "source"]], None
        for row in self.exact:
            cells = row.cells()
            # A result is printed once if several methods are compared with it.
            named = cells if row.truth is not before else ["", *cells[1:3], "", *cells[4:]]
            lines.append([*named, str(1 + sources.index(row.truth.source))])
            before = row.truth
        return _page(
            "# Known results",
            "*The evidence for the correctness of the numbers.*",
            f"Written by `harvester verify`, harvester {__version__}, {self.date}: closed forms, "
            "exact limits, published powers and other integrators, next to this project's results.",
            entries("known_results")["page"]["symbols"],
            _listed(self._exact_sentences()),
            markdown_table(lines),
            "## Sources",
            "\n".join(f"{number}. {source}" for number, source in enumerate(sources, 1)),
        )

    def texts(self) -> dict[str, str]:
        """The pages of the known results and, if present, of the measured devices."""
        devices = {"-measured.md": measured_page(self.measured, self.date)} if self.measured else {}
        return {".md": self.markdown(), **devices}


def verification(runner: Runner, chosen: Sequence[Truth] | None = None) -> Verification:
    """See `harvester.verify`."""
    clock = time.perf_counter()
    truths = [*catalogue(), *measured()] if chosen is None else chosen
    questions = [(truth, *question) for truth in truths for question in truth.asked.items()]
    outcomes: dict[type, Iterator] = {
        Request: iter(runner.answer([q for *_, q in questions if isinstance(q, Request)])),
        Task: iter(runner.run([q for *_, q in questions if isinstance(q, Task)])),
    }
    # An entry that is neither a request nor a task is the reason why it cannot be computed.
    rows = [
        row_of(truth, method, next(outcomes.get(type(question), iter([question]))))
        for truth, method, question in questions
    ]
    today = datetime.date.today().isoformat()
    return Verification(rows, time.perf_counter() - clock, today)


def measured_page(rows: Sequence[TruthRow], date: str) -> str:
    """Markdown page of measured devices: every point, inferred values, and deviations."""
    tables, by_device = entries("known_results"), _by_device(rows)
    parts = []
    for device in tables["device"]:
        device_rows, name = by_device.get(device["name"], []), device["name"]
        if device_rows:
            scatters = ", ".join(f"{scatter_of(device, f):.2%} at {f} Hz" for f in device["series"])
            remarks = [*device["remarks"], f"Scatter: {scatters}.", f"Source: {device['source']}."]
            parts.append(f"## {name[0].upper()}{name[1:]}")
            parts.append(_listed([*remarks, f"Predicted: {summary(device_rows)}"]))
            parts.append(markdown_table(_points(device_rows)))
    cures = {entry["device"]: entry["cure"] for entry in tables["set"]}
    lines = []
    for row in (row for name in cures for row in by_device.get(name, ())):
        # The exact share, or the largest published share.
        exact, most = row.truth.exact, row.truth.allowance
        expected = f"{exact:.0%}" if exact else f"{most:.2%} and below"
        value = "" if row.reason else f"{row.value:.2%}"
        lines.append([row.truth.device, row.truth.title, row.method, expected, value, row.verdict])
    if lines:
        head = ["set", "result", "method", "expected", "computed", "verdict"]
        parts += [
            "## Sets to download",
            tables["page"]["downloaded"],
            markdown_table([head, *lines]),
        ]
        parts.append(_listed(f"{name}: {cure}" for name, cure in cures.items()))
    return _page(
        "# Comparison with measurements",
        "*Deviations of predictions from measurements, with the misses.*",
        f"Written by `harvester verify --output DIR`, harvester {__version__}, {date}.",
        tables["page"]["opening"],
        *parts,
    )


def _points(rows):
    """The table of one device, one line per point."""
    methods = list(dict.fromkeys(row.method for row in rows))
    lines = [["point", "measured, mean power [µW]", *methods, "allowed", "verdict"]]
    for title, group in itertools.groupby(rows, lambda row: row.truth.title):
        point_rows = list(group)
        truth = point_rows[0].truth
        cells = [
            row.verdict if row.reason else f"{1e6 * row.value:.4g} ({row.deviation:+.1%})"
            for row in point_rows
        ]
        named = [title.partition(", ")[2], f"{1e6 * truth.exact:.4g}", *cells]
        verdicts = ", ".join(dict.fromkeys(row.verdict for row in point_rows))
        lines.append([*named, f"± {truth.allowance / truth.exact:.1%}", verdicts])
    return lines


def summary(rows: Sequence[TruthRow]) -> str:
    """Mean and range of one device's deviations, and the number of missed points."""
    deviations = [row.deviation for row in rows if not row.reason]
    if not deviations:
        return "nothing yet."
    missed = sum(row.verdict == MISSES for row in rows)
    return (
        f"from {min(deviations):+.1%} to {max(deviations):+.1%}, "
        f"{sum(deviations) / len(deviations):+.1%} in the mean; {missed} of {len(rows)} miss."
    )


def _by_device(rows):
    """The rows by device, in their original order."""
    grouped: dict[str, list[TruthRow]] = {}
    for row in rows:
        grouped.setdefault(row.truth.device, []).append(row)
    return grouped


def _page(*parts):
    return "\n\n".join(parts) + "\n"


def _listed(lines):
    return "\n".join(f"- {line}" for line in lines)
