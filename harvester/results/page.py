"""Self-contained HTML pages of results."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Iterable, Sequence
from datetime import datetime
from importlib import resources
from string import Template
from typing import TYPE_CHECKING, NamedTuple

from harvester.base.plain_text import one_line
from harvester.version import __version__

if TYPE_CHECKING:
    from harvester.results.view import View

# Below this width a picture scrolls in its frame, so that it stays readable. A schematic has a
# minimum share of its drawn size instead, at which its values are 7 points high.
NARROWEST_FIGURE, LEAST_SCALE = "36rem", 0.7
# Rows of a table per page, and sentences that are shown unfolded.
ROWS, SENTENCES = 25, 8
# Largest magnification of a picture.
LARGEST_SCALE = 1.3


class Verdict(NamedTuple):
    """A sentence, and whether it is favourable; None if it is neutral."""

    text: str
    good: bool | None = None


def page(title: str, about: str, sections: dict[str, str]) -> str:
    """A self-contained HTML page: title, date, version, `about`, and sections by heading."""
    template = resources.files("harvester.results").joinpath("page.html").read_text("utf-8")
    date = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    return Template(template).substitute(
        title=_escaped(title),
        facts=_escaped(f"{date}; harvester {__version__}; {about}"),
        sections="\n".join(f"<h2>{_escaped(name)}</h2>\n{s}" for name, s in sections.items()),
    )


def verdicts(view: View) -> list[Verdict]:
    """The first sentences of a page: the result's headline and its alarms."""
    return [Verdict(view.main_finding), *(Verdict(alarm, False) for alarm in view.alarms)]


def verdict_list(verdicts: Iterable[Verdict]) -> str:
    kinds = {True: "agrees", False: "differs", None: "neutral"}
    items = "\n".join(f'<li class="{kinds[v.good]}">{_escaped(v.text)}</li>' for v in verdicts)
    return f'<ul class="verdict">\n{items}\n</ul>'


def wide(content: str) -> str:
    """Content in a frame that scrolls horizontally if the page is narrow."""
    return f'<div class="wide" tabindex="0">{content}</div>'


def facts(text: str) -> str:
    """A paragraph in small type."""
    return f'\n<p class="facts">{_escaped(text)}</p>'


def all_facts(lines: Sequence[str]) -> str:
    """Paragraphs in small type; all after the first few are folded."""
    first, rest = lines[:SENTENCES], lines[SENTENCES:]
    folded = _folded(f"{len(rest)} more", "".join(map(facts, rest))) if rest else ""
    return "".join(map(facts, first)) + folded


def _folded(summary, content, is_open=False):
    return (
        f"<details{' open' * is_open}><summary>{_escaped(summary)}</summary>\n{content}</details>"
    )


def listing(text: str, name: str) -> str:
    """The text of a file, folded under its name."""
    return _folded(name, wide(f"<pre>{html.escape(text)}</pre>"))


def _escaped(text):
    return html.escape(one_line(text))


def table_of(header: Sequence[str], rows: Iterable[Sequence[str]], kind: str = "numbers") -> str:
    """A table; cells of the kind "text" wrap."""
    head = "".join(f'<th scope="col">{_escaped(cell)}</th>' for cell in header)
    body = "\n".join(
        "<tr>" + "".join(f"<td>{_escaped(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return (
        f'<table class="{kind}"><thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody></table>'
    )


def table_in_pages(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in a scrolling frame; a long one is split into foldable pages, the first open."""
    parts = [rows[first : first + ROWS] for first in range(0, len(rows), ROWS)]
    if len(parts) < 2:
        return wide(table_of(header, rows))
    return "\n".join(
        _folded(
            f"{part[0][0]} … {part[-1][0]} ({len(part)} of {len(rows)})",
            wide(table_of(header, part)),
            is_open=part is parts[0],
        )
        for part in parts
    )


def figure_of(svg: bytes, alternative: str, caption: str, least_scale: float = 0.0) -> str:
    """A picture in the page; small pictures are not enlarged to the page's width.

    `least_scale`: minimum displayed size as a share of the drawn size.
    """
    data = base64.b64encode(svg).decode()
    size = f"min-width: {NARROWEST_FIGURE}"
    svg_width = re.search(rb'<svg[^>]* width="([\d.]+)pt"', svg)
    if svg_width:
        widest = f"{LARGEST_SCALE * float(svg_width[1]):.0f}pt"
        least = f"{least_scale * float(svg_width[1]):.0f}pt" if least_scale else NARROWEST_FIGURE
        size = f"min-width: min({least}, {widest}); max-width: {widest}"
    return (
        f'<figure><div class="wide" tabindex="0"><img style="{size}" '
        f'alt="{_escaped(alternative)}" src="data:image/svg+xml;base64,{data}"></div>'
        f"<figcaption>{_escaped(caption)}</figcaption></figure>"
    )
