"""`validate --report`: one page that holds all of a comparison and loads nothing from elsewhere."""

from __future__ import annotations

import base64
import html
import json
import platform
from datetime import datetime
from importlib import metadata, resources
from string import Template
from typing import TYPE_CHECKING

from harvester import __version__
from harvester.errors import MissingLibrary
from harvester.files.plain_text import one_line
from harvester.show.verdicts import verdicts

if TYPE_CHECKING:
    from harvester.studies.comparison import Comparison

# Below these widths a picture scrolls in its frame instead of becoming unreadable.
NARROWEST_FIGURE, NARROWEST_SCHEMATIC = "36rem", "64rem"
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
    from harvester.engines.circuit import netlist_of

    scene = comparison.scene
    template = resources.files("harvester.show").joinpath("page.html").read_text(encoding="utf-8")
    digest = scene.digest()[:12]
    date = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    header, rows = comparison.table()
    rows = [[name, unit.replace("^2", "²"), *values] for name, unit, *values in rows]
    return Template(template).substitute(
        title=_escaped(f"{scene.name}: circuit, Monte Carlo and averaging"),
        facts=_escaped(f"{date}; harvester {__version__}; seed {scene.run.seed}; scene {digest}"),
        verdicts="\n".join(map(_verdict, verdicts(comparison))),
        quantities=_table(header, rows),
        legend=_escaped(LEGEND),
        figures=_figures(comparison),
        scene=_table(("key", "value"), _scene_rows(scene), "text"),
        schematic=_schematic(scene),
        netlist_summary="the elements as ngspice reads them, the noise fed in from outside",
        netlist=html.escape(netlist_of(scene).text),
        evidence=_table(("what", "fact"), _evidence(comparison), "text"),
    )


def _escaped(text):
    return html.escape(one_line(text))


def _verdict(verdict):
    kind = {True: "agrees", False: "differs", None: "neutral"}[verdict.good]
    return f'<li class="{kind}">{_escaped(verdict.text)}</li>'


def _table(header, rows, kind="numbers"):
    head = "".join(f'<th scope="col">{_escaped(cell)}</th>' for cell in header)
    body = "\n".join(
        "<tr>" + "".join(f"<td>{_escaped(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return (
        f'<table class="{kind}"><thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody></table>'
    )


def _figures(comparison):
    from harvester.show import figures, joint_figure

    scene = comparison.scene.name
    drawn = [
        (figures.draw_comparison, comparison, "Densities by every method; one noise path."),
        (figures.draw_result, comparison.circuit, "Densities by the circuit."),
    ]
    both = [*comparison.closures.values(), comparison.monte_carlo]
    if any(each.joint_density is not None for each in both):
        drawn.insert(1, (joint_figure.draw, both, JOINT_CAPTION))
    return "\n".join(
        _figure(figures.picture(draw, content), f"{scene}: {caption}", caption)
        for draw, content, caption in drawn
    )


def _figure(svg, alternative, caption, narrowest=NARROWEST_FIGURE):
    data = base64.b64encode(svg).decode()
    return (
        f'<figure><div class="wide" tabindex="0"><img style="min-width: {narrowest}" '
        f'alt="{_escaped(alternative)}" src="data:image/svg+xml;base64,{data}"></div>'
        f"<figcaption>{_escaped(caption)}</figcaption></figure>"
    )


def _schematic(scene):
    from harvester.engines.circuit import schematic

    try:
        drawing = schematic(scene)
    except MissingLibrary as error:
        return f'<p class="facts">Not drawn: {_escaped(str(error))}</p>'
    caption = "Element names as in the netlist; nodes in blue."
    return _figure(drawing.image(), f"Schematic of {scene.name}", caption, NARROWEST_SCHEMATIC)


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
