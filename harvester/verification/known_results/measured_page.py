"""The page of the measured devices: every point, what is inferred, and the misses."""

from __future__ import annotations

from collections.abc import Sequence

from harvester.files.tables import markdown_table
from harvester.verification.known_results.downloaded import how_to_get
from harvester.verification.known_results.measured import DEVICES
from harvester.verification.known_results.truth import MISSES, TruthRow
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


def measured_page(rows: Sequence[TruthRow], date: str) -> str:
    """Markdown of the rows of measured devices.

    Parameters
    ----------
    rows : sequence of TruthRow
    date : str
    """
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
        remarks = [*device.said, f"Scatter: {scatters}.", f"Source: {device.source}."]
        parts += [
            f"## {device.name[0].upper()}{device.name[1:]}",
            "\n".join(f"- {remark}" for remark in (*remarks, f"Predicted: {summary(device_rows)}")),
            markdown_table(_lines(device_rows)),
        ]
    cures = how_to_get()
    downloaded = [row for row in rows if row.truth.device in cures]
    if downloaded:
        head = ["set", "result", "by", "expected", "ours", "verdict"]
        lines = [
            [row.truth.device, row.truth.title, row.method, _expected(row.truth),
             "" if row.reason else f"{row.value:.2%}", row.verdict]
            for row in downloaded
        ]  # fmt: skip
        parts += ["## Sets to download", DOWNLOADED, markdown_table([head, *lines])]
        parts.append("\n".join(f"- {name}: {cures[name]}" for name in cures))
    return "\n\n".join(parts) + "\n"


def _expected(truth):
    """What a set's row should be: an exact share, or no more than what others published."""
    return f"{truth.exact:.0%}" if truth.exact else f"{truth.allowance:.2%} and below"


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
