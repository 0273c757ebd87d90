"""`verify`: exact, published and measured results beside this project's, with their two pages."""

from __future__ import annotations

import datetime
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Unpack

from harvester.base.arguments import checked_options, usual_arithmetic
from harvester.base.serialising import plain
from harvester.base.tables import markdown_table
from harvester.engines.opening import RunnerOptions, open_runner
from harvester.engines.request import Request
from harvester.engines.task import Task
from harvester.validation import SIGNIFICANT_SIGMAS
from harvester.validation.downloaded import HOW_TO_GET
from harvester.validation.measured import DEVICES
from harvester.validation.truth import FAILS, HOLDS, MISSES, Truth, TruthRow, row_of
from harvester.version import __version__

OPENING = (
    "Devices that others built and measured, and what this program predicts of them. Nothing is "
    "fitted but what is said. A point that lies beyond its limit is a miss and stays here. The "
    "limit is the error of reading the point and three times the measurement's own scatter. At one "
    "frequency every linear device, whatever its numbers, gives a resistor R the power "
    "R/(a + b R + c R²). The points' deviations from the best such curve are their scatter."
)
DOWNLOADED = (
    "Sets that are not ours to ship. A variable of the environment names the place; `harvester "
    "verify` then has its row, and says *not here* without it."
)


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
        return [row for row in self.rows if row.truth.device]

    def table(self) -> tuple[list[str], list[list[str]]]:
        header = ["result", "by", "verdict", "exact", "ours", "difference", "allowed"]
        return header, [row.cells() for row in self.rows]

    def sentences(self) -> list[str]:
        """How many rows hold, and everything about those that do not."""
        if not self.measured:
            return self._exact_sentences()
        within = sum(row.verdict == HOLDS for row in self.measured)
        lines = [
            *self._exact_sentences(),
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

    def _exact_sentences(self):
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
            "\n".join(f"- {line}" for line in self._exact_sentences()),
            markdown_table(lines),
            "## Sources",
            "\n".join(f"{number}. {source}" for number, source in enumerate(sources, 1)),
        ]
        return "\n\n".join(parts) + "\n"

    def texts(self) -> dict[str, str]:
        """The page of the measured devices."""
        if not self.measured:
            return {}
        return {"-measured.md": measured_page(self.measured, self.date)}

    def figure(self) -> None:
        """The table says it all."""

    def to_dict(self) -> dict[str, Any]:
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
        Truths out of `harvester.validation.known_results` and of `measured` beside it;
        None: all.
    **running
        See `harvester.engines.open_runner`.
    """
    if chosen is None:
        from harvester.validation.known_results import catalogue
        from harvester.validation.measured import measured

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


def measured_page(rows: Sequence[TruthRow], date: str) -> str:
    """Markdown of the rows of measured devices: every point, what is inferred, and the misses."""
    parts = [
        "# Measured against",
        "*For whoever asks how far predictions lie from measurements. Misses stay on the page.*",
        f"Written by `harvester verify --output DIR`, harvester {__version__}, {date}.",
        OPENING,
    ]
    for device in DEVICES:
        device_rows = [row for row in rows if row.truth.device == device.name]
        if not device_rows:
            continue
        scatters = ", ".join(
            f"{device.own_scatter(frequency):.2%} at {frequency:g} Hz"
            for frequency in device.series
        )
        remarks = [*device.remarks, f"Scatter: {scatters}.", f"Source: {device.source}."]
        parts += [
            f"## {device.name[0].upper()}{device.name[1:]}",
            "\n".join(f"- {remark}" for remark in (*remarks, f"Predicted: {summary(device_rows)}")),
            markdown_table(_lines(device_rows)),
        ]
    downloaded = [row for row in rows if row.truth.device in HOW_TO_GET]
    if downloaded:

        def expected(truth):
            """An exact share, or no more than what others published."""
            return f"{truth.exact:.0%}" if truth.exact else f"{truth.allowance:.2%} and below"

        head = ["set", "result", "by", "expected", "ours", "verdict"]
        lines = [
            [row.truth.device, row.truth.title, row.method, expected(row.truth),
             "" if row.reason else f"{row.value:.2%}", row.verdict]
            for row in downloaded
        ]  # fmt: skip
        parts += ["## Sets to download", DOWNLOADED, markdown_table([head, *lines])]
        parts.append("\n".join(f"- {name}: {cure}" for name, cure in HOW_TO_GET.items()))
    return "\n\n".join(parts) + "\n"


def _lines(rows):
    """The table of one device, a line for each point."""
    methods = list(dict.fromkeys(row.method for row in rows))
    lines = [["point", "measured, mean power [µW]", *methods, "allowed", "verdict"]]
    for title in dict.fromkeys(row.truth.title for row in rows):
        by_method = {row.method: row for row in rows if row.truth.title == title}
        truth = next(iter(by_method.values())).truth
        cells = [_found(by_method[method]) for method in methods if method in by_method]
        verdicts = dict.fromkeys(row.verdict for row in by_method.values())
        share = f"± {truth.allowance / truth.exact:.1%}"
        point = title.partition(", ")[2]
        lines.append([point, f"{1e6 * truth.exact:.4g}", *cells, share, ", ".join(verdicts)])
    return lines


def _found(row):
    if row.reason:
        return row.verdict
    return f"{1e6 * row.value:.4g} ({row.value / row.truth.exact - 1.0:+.1%})"


def summary(rows: Sequence[TruthRow]) -> str:
    """Mean and range of the deviations of one device, and how many of its points are missed."""
    deviations = [row.value / row.truth.exact - 1.0 for row in rows if not row.reason]
    if not deviations:
        return "nothing yet."
    missed = sum(row.verdict == MISSES for row in rows)
    return (
        f"from {min(deviations):+.1%} to {max(deviations):+.1%}, "
        f"{sum(deviations) / len(deviations):+.1%} in the mean; {missed} of {len(rows)} miss."
    )
