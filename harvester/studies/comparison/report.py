"""`validate --report`: one page that holds all of a comparison."""

from __future__ import annotations

import html
import platform
from collections.abc import Callable
from importlib import metadata
from typing import Any

from harvester.errors import MissingLibrary
from harvester.prepared.prepared import prepared
from harvester.results import joint_drawing
from harvester.results.drawing import draw_result
from harvester.results.excitation_drawing import draw_spectrum
from harvester.results.headline import headline
from harvester.scene.described import scene_rows
from harvester.show import figures
from harvester.show.page import (
    LEAST_SCALE,
    Verdict,
    facts,
    figure_of,
    page,
    table_of,
    verdict_list,
    wide,
)
from harvester.show.symbols import definitions
from harvester.studies.comparison.comparison import Comparison
from harvester.studies.comparison.drawing import draw_comparison
from harvester.studies.comparison.verdicts import verdicts

LEGEND = (
    "± one standard error, of a closure the numerical error; in brackets its deviation from Monte "
    "Carlo, as a share and in standard errors of Monte Carlo alone. Difference: circuit minus "
    "Monte Carlo in joint standard errors. Paired bias: the same as a share, on common noise."
)
JOINT_CAPTION = (
    "Displacement and velocity together, in the same places and colours; dots: wells, crosses: "
    "saddles."
)
LIBRARIES = ("numpy", "scipy", "numba", "PySpice")


def report(comparison: Comparison) -> str:
    """A comparison as a page of HTML.

    Returns
    -------
    str
        Self-contained: style and pictures are in it.
    """
    from circuits.assembly import assemble

    scene = comparison.scene
    header, rows = comparison.table()
    text = html.escape(assemble(prepared(scene)).text)
    netlist = (
        "<details><summary>the elements as ngspice reads them, the noise fed in from outside"
        f'</summary>\n<div class="wide" tabindex="0"><pre>{text}'
        "</pre></div></details>"
    )
    return page(
        f"{scene.name}: circuit, Monte Carlo and averaging",
        f"seed {scene.run.seed}; scene {scene.digest()[:12]}",
        {
            "Verdict": verdict_list([Verdict(headline(comparison.circuit)), *verdicts(comparison)]),
            "Quantities": wide(table_of(header, rows)) + _legend(comparison),
            "Figures": _figures(comparison),
            "Scene": wide(table_of(("key", "value"), scene_rows(scene), "text")),
            "Schematic": _schematic(scene),
            "Netlist": netlist,
            "Evidence": wide(table_of(("what", "fact"), _evidence(comparison), "text")),
        },
    )


def _legend(comparison):
    return "".join(map(facts, [LEGEND, *definitions(comparison.compared)]))


def _figures(comparison):
    scene = comparison.scene.name
    drawn: list[tuple[Callable, Any, str]] = [
        (draw_comparison, comparison, "Densities by every method; one noise path."),
        (draw_result, comparison.circuit, "Densities by the circuit."),
        (draw_spectrum, comparison.scene, "Spectrum of the excitation, of one realization."),
    ]
    both = [*comparison.closures.values(), comparison.monte_carlo]
    if any(each.joint_density is not None for each in both):
        drawn.insert(1, (joint_drawing.draw, both, JOINT_CAPTION))
    return "\n".join(
        figure_of(figures.picture(draw, content), f"{scene}: {caption}", caption)
        for draw, content, caption in drawn
    )


def _schematic(scene):
    from circuits.schematic.drawing import schematic

    try:
        drawing = schematic(scene)
    except MissingLibrary as error:
        return facts(f"Not drawn: {error}")
    caption = "Element names as in the netlist; nodes in blue."
    return figure_of(drawing.image(), f"Schematic of {scene.name}", caption, LEAST_SCALE)


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
