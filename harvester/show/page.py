"""`validate --report`: one page that holds all of a comparison and loads nothing from elsewhere."""

from __future__ import annotations

import base64
import html
import json
import platform
import re
from collections.abc import Iterable, Sequence
from datetime import datetime
from importlib import metadata, resources
from string import Template
from typing import TYPE_CHECKING

from harvester import __version__
from harvester.errors import MissingLibrary
from harvester.files.plain_text import one_line
from harvester.show.verdicts import Verdict, verdicts

if TYPE_CHECKING:
    from harvester.studies.comparison import Comparison

# Below these widths a picture scrolls in its frame instead of becoming unreadable.
NARROWEST_FIGURE, NARROWEST_SCHEMATIC = "36rem", "64rem"
# Of its own size, that a picture is drawn at most.
LARGEST_SCALE = 1.3
LEGEND = (
    "± one standard error; beside a closure its deviation from Monte Carlo, as a share and in "
    "standard errors. Difference: circuit minus Monte Carlo in joint standard errors. Paired bias: "
    "the same as a share, on common noise."
)
JOINT_CAPTION = (
    "Displacement and velocity together, in the same places and colours; dots: wells, crosses: "
    "saddles."
)
LIBRARIES = ("numpy", "scipy", "numba", "PySpice")


def report(comparison: Comparison) -> str:
    """A comparison as a page of HTML.

    Parameters
    ----------
    comparison : harvester.studies.comparison.Comparison

    Returns
    -------
    str
        Self-contained: style and pictures are in it.
    """
    from harvester.simulation.circuit import netlist_of

    scene = comparison.scene
    header, rows = comparison.table()
    rows = [[name, unit.replace("^2", "²"), *values] for name, unit, *values in rows]
    netlist = (
        "<details><summary>the elements as ngspice reads them, the noise fed in from outside"
        f'</summary>\n<div class="wide" tabindex="0"><pre>{html.escape(netlist_of(scene).text)}'
        "</pre></div></details>"
    )
    return page(
        f"{scene.name}: circuit, Monte Carlo and averaging",
        f"seed {scene.run.seed}; scene {scene.digest()[:12]}",
        {
            "Verdict": verdict_list(verdicts(comparison)),
            "Quantities": wide(table_of(header, rows)) + facts(LEGEND),
            "Figures": _figures(comparison),
            "Scene": wide(table_of(("key", "value"), _scene_rows(scene), "text")),
            "Schematic": _schematic(scene),
            "Netlist": netlist,
            "Evidence": wide(table_of(("what", "fact"), _evidence(comparison), "text")),
        },
    )


def page(title: str, about: str, sections: dict[str, str]) -> str:
    """A self-contained page of HTML.

    Parameters
    ----------
    title : str
    about : str
        Stands below it, behind date and version.
    sections : dict of str to str
        HTML by its heading.
    """
    template = resources.files("harvester.show").joinpath("page.html").read_text(encoding="utf-8")
    date = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    return Template(template).substitute(
        title=_escaped(title),
        facts=_escaped(f"{date}; harvester {__version__}; {about}"),
        sections="\n".join(f"<h2>{_escaped(name)}</h2>\n{s}" for name, s in sections.items()),
    )


def verdict_list(found: Iterable[Verdict]) -> str:
    """Sentences with their colours."""
    items = "\n".join(map(_verdict, found))
    return f'<ul class="verdict">\n{items}\n</ul>'


def wide(content: str) -> str:
    """What scrolls in its frame where the page is narrow."""
    return f'<div class="wide" tabindex="0">{content}</div>'


def facts(text: str) -> str:
    """A paragraph in small print."""
    return f'\n<p class="facts">{_escaped(text)}</p>'


def _escaped(text):
    return html.escape(one_line(text))


def _verdict(verdict):
    kind = {True: "agrees", False: "differs", None: "neutral"}[verdict.good]
    return f'<li class="{kind}">{_escaped(verdict.text)}</li>'


def table_of(header: Sequence[str], rows: Iterable[Sequence[str]], kind: str = "numbers") -> str:
    """A table; of the kind "text" its cells wrap."""
    head = "".join(f'<th scope="col">{_escaped(cell)}</th>' for cell in header)
    body = "\n".join(
        "<tr>" + "".join(f"<td>{_escaped(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return (
        f'<table class="{kind}"><thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody></table>'
    )


def _figures(comparison):
    from harvester.results import joint_drawing as joint_figure
    from harvester.show import figures

    scene = comparison.scene.name
    drawn = [
        (figures.draw_comparison, comparison, "Densities by every method; one noise path."),
        (figures.draw_result, comparison.circuit, "Densities by the circuit."),
    ]
    both = [*comparison.closures.values(), comparison.monte_carlo]
    if any(each.joint_density is not None for each in both):
        drawn.insert(1, (joint_figure.draw, both, JOINT_CAPTION))
    return "\n".join(
        figure_of(figures.picture(draw, content), f"{scene}: {caption}", caption)
        for draw, content, caption in drawn
    )


def figure_of(svg: bytes, alternative: str, caption: str, narrowest: str = NARROWEST_FIGURE) -> str:
    """A picture within the page; a small one is not made as wide as the page."""
    data = base64.b64encode(svg).decode()
    size = f"min-width: {narrowest}"
    own = re.search(rb'<svg[^>]* width="([\d.]+)pt"', svg)
    if own:
        widest = f"{LARGEST_SCALE * float(own[1]):.0f}pt"
        size = f"min-width: min({narrowest}, {widest}); max-width: {widest}"
    return (
        f'<figure><div class="wide" tabindex="0"><img style="{size}" '
        f'alt="{_escaped(alternative)}" src="data:image/svg+xml;base64,{data}"></div>'
        f"<figcaption>{_escaped(caption)}</figcaption></figure>"
    )


def _schematic(scene):
    from harvester.simulation.circuit import schematic

    try:
        drawing = schematic(scene)
    except MissingLibrary as error:
        return f'<p class="facts">Not drawn: {_escaped(str(error))}</p>'
    caption = "Element names as in the netlist; nodes in blue."
    return figure_of(drawing.image(), f"Schematic of {scene.name}", caption, NARROWEST_SCHEMATIC)


def _scene_rows(scene):
    rows = []
    for table, values in scene.to_tables().items():
        if not isinstance(values, dict):
            rows.append((table, _value(values)))
            continue
        rows += [(f"{table}.{key}", _value(value)) for key, value in values.items()]
    return rows


def _value(value):
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _evidence(comparison):
    engines = (comparison.circuit, comparison.monte_carlo)
    rows = [(engine.engine, "; ".join(engine.evidence())) for engine in engines]
    rows += [
        (closure.engine, "; ".join((*closure.evidence(), *closure.notes)))
        for closure in comparison.closures.values()
    ]
    notes = dict.fromkeys((*engines[0].notes, *engines[1].notes))
    versions = [f"{name} {metadata.version(name)}" for name in LIBRARIES]
    return [
        *rows,
        *(("note", note) for note in notes),
        ("seed", str(comparison.scene.run.seed)),
        ("scene", f"sha256 {comparison.scene.digest()}"),
        ("versions", ", ".join([f"Python {platform.python_version()}", *versions])),
    ]
