"""`--report`: one page that holds all of a study, under one headline."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from harvester.cli.shown import Shown
from harvester.results import figures
from harvester.results.page import (
    Verdict,
    all_facts,
    figure_of,
    page,
    table_in_pages,
    table_of,
    verdict_list,
    wide,
)
from harvester.scene.described import scene_rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def page_of(content: Shown, title: str) -> str:
    """A result as a page of HTML: its own `page()` where it has one."""
    own_page = getattr(content, "page", None)
    if own_page:
        return own_page()
    scene = content.scene
    sections = {
        "Result": verdict_list(_verdicts(content)),
        "Numbers": table_in_pages(*content.table()),
        "Figures": "\n".join(_pictures(content, title)),
        "How it came about": all_facts(content.sentences()),
    }
    about = ""
    if scene is not None:
        title = f"{scene.name}: {title}"
        about = f"seed {scene.run.seed}; scene {scene.digest()[:12]}"
        sections["Scene"] = wide(table_of(("key", "value"), scene_rows(scene), "text"))
    return page(title, about, {name: html for name, html in sections.items() if html})


def _verdicts(content: Any) -> list[Verdict]:
    """Sentences at the top of the page: the headline and the alarms."""
    headline = content.headline() if hasattr(content, "headline") else content.sentences()[0]
    alarms = content.alarms() if hasattr(content, "alarms") else ()
    return [Verdict(headline), *(Verdict(alarm, False) for alarm in alarms)]


def _pictures(content: Any, title: str) -> Iterator[str]:
    drawings: list[Figure | None] = content.figures() if hasattr(content, "figures") else []
    drawings = drawings or [content.figure()]
    for name in ("joint_figure", "waveform"):
        part = getattr(content, name, None)
        drawings.append(part and (part() if callable(part) else part.figure()))
    for drawing in filter(None, drawings):
        # This one is a figure already.
        yield figure_of(figures.picture(lambda drawn: drawn, drawing), title, "")
