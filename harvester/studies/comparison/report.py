"""The figure of a comparison, and its HTML page for `validate --report`."""

from __future__ import annotations

import platform
from collections.abc import Callable
from importlib import metadata
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.errors import MissingLibrary
from harvester.base.symbols import definitions
from harvester.results import joint_drawing
from harvester.results.drawing import axis_label, density_label, draw_density, draw_result, frame
from harvester.results.page import (
    LEAST_SCALE,
    Verdict,
    facts,
    figure_of,
    listing,
    page,
    table_of,
    verdict_list,
    wide,
)
from harvester.results.palette import CIRCUIT, LINES, MONTE_CARLO, OTHER_LINE
from harvester.results.panels import legend_below, set_title
from harvester.results.view import Picture
from harvester.scene.described import scene_rows
from harvester.statistics.estimate import RESOLVED_SHARE
from harvester.studies.comparison.excitation_drawing import draw_spectrum

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEGEND = (
    "± one standard error, or a stationary method's numerical error; in brackets its deviation "
    "from Monte Carlo, as a share and in standard errors of Monte Carlo alone. Difference: circuit "
    "minus Monte Carlo in combined standard errors σ. Paired relative bias: (circuit − Monte "
    "Carlo)/Monte Carlo on common noise."
)
JOINT_CAPTION = (
    "Displacement and velocity together, on the same grid and colour scale; dots: wells, crosses: "
    "saddles."
)
LIBRARIES = ("numpy", "scipy", "numba", "PySpice")
# Line widths of the reference (drawn first) and of the stationary methods (drawn above it).
WIDTHS = (3.0, 1.0)


def report(comparison: Any, verdicts: list[Verdict]) -> str:
    """A comparison as a self-contained HTML page, including styles and pictures."""
    from circuits.equivalent.assembly import assemble

    scene = comparison.scene
    header, rows = comparison.table()
    legend = [LEGEND, *definitions(comparison.compared)]
    netlist = listing(
        assemble(comparison.circuit.prepared_scene).text,
        "netlist as ngspice reads it; an external source supplies the noise",
    )
    return page(
        f"{scene.name}: circuit, Monte Carlo and averaging",
        f"seed {scene.run.seed}; scene {scene.digest()[:12]}",
        {
            "Verdict": verdict_list(verdicts),
            "Quantities": wide(table_of(header, rows)) + "".join(map(facts, legend)),
            "Figures": _figures(comparison),
            "Scene": wide(table_of(("key", "value"), scene_rows([scene]), "text")),
            "Schematic": _schematic(scene),
            "Netlist": netlist,
            "Evidence": wide(table_of(("what", "fact"), _evidence(comparison), "text")),
        },
    )


def _figures(comparison):
    scene = comparison.scene.name
    drawn: list[tuple[Callable, Any, str]] = [
        (draw_comparison, comparison, "Densities by every method; one noise path."),
        (draw_result, comparison.circuit, "Densities by the circuit."),
        (draw_spectrum, comparison.scene, "Spectrum of the excitation, of one realization."),
    ]
    both = [*comparison.closures.values(), comparison.monte_carlo]
    if any(result.joint_density is not None for result in both):
        drawn.insert(1, (joint_drawing.draw, both, JOINT_CAPTION))
    return "\n".join(
        Picture(draw, content).html(f"{scene}: {caption}", caption)
        for draw, content, caption in drawn
    )


def _schematic(scene):
    from circuits.equivalent.schematic.drawing import schematic

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


def draw_comparison(comparison: Any) -> Figure:
    """Draw densities by every method, waveforms on one path, and their difference."""
    from matplotlib.figure import Figure

    names = list(comparison.monte_carlo.densities)
    figure = Figure(figsize=(9.0, 7.2))
    rows = figure.add_gridspec(2, 1, height_ratios=(1.0, 1.0))
    across = rows[0].subgridspec(1, len(names))
    panels = [figure.add_subplot(across[column]) for column in range(len(names))]
    for panel, name in zip(panels, names, strict=True):
        _draw_densities(panel, comparison, name)
        panel.set_ylabel(density_label(comparison.circuit, name))
    below = rows[1].subgridspec(3, 1, height_ratios=(1.4, 1.4, 1.0))
    top = figure.add_subplot(below[0])
    middle, bottom = (figure.add_subplot(below[k], sharex=top) for k in (1, 2))
    _draw_waveforms(top, middle, bottom, comparison)
    figure.align_ylabels([top, middle, bottom])
    compared = "circuit, Monte Carlo and averaging" if comparison.closures else "both engines"
    set_title(figure, f"{comparison.scene.name}: {compared} (bands: two standard errors)")
    # Stationary methods have different densities, so one legend serves all panels.
    legend_below(figure, panels)
    return figure


def _draw_densities(axes, comparison, name):
    # Thin lines over thick ones show both where they coincide.
    thick, thin = WIDTHS
    style = {"colour": MONTE_CARLO, "width": thick}
    draw_density(axes, comparison.monte_carlo, name, "Monte Carlo", **style)
    draw_density(axes, comparison.circuit, name, "circuit", colour=CIRCUIT, line="--")
    # Stationary methods are drawn above the simulations, whose error bands are broad under noise.
    for closure, result in comparison.closures.items():
        colour, line = LINES.get(closure, OTHER_LINE)
        if name in result.densities:
            style = {"colour": colour, "line": line, "width": thin}
            draw_density(axes, result, name, f"averaging, {closure}", **style)
    simulated = comparison.monte_carlo.densities[name]
    frame(axes, [comparison.circuit, comparison.monte_carlo], name)
    peak = simulated.density.max() / comparison.monte_carlo.scales.of(name)
    # A stationary method with far too high a peak would flatten the others.
    axes.set_ylim(0.0, min(axes.get_ylim()[1], 2.5 * peak))
    axes.set_xlabel(axis_label(comparison.circuit, name))


def _draw_waveforms(top, middle, bottom, comparison):
    circuit, reference = comparison.circuit.waveform, comparison.monte_carlo.waveform
    for axes, name in ((top, "displacement"), (middle, "voltage")):
        axes.plot(reference.time, reference[name], color=MONTE_CARLO, linewidth=WIDTHS[0])
        axes.plot(circuit.time, circuit[name], "--", color=CIRCUIT)
        axes.set_ylabel(axis_label(comparison.circuit, name).replace(" ", "\n"))
        axes.tick_params(labelbottom=False)
    top.set_title("the same noise path")
    # Both records contain every knot of the noise.
    difference = np.interp(reference.time, circuit.time, circuit.displacement)
    knots = np.isin(np.round(reference.time, 9), np.round(circuit.time, 9))
    difference = (difference - reference.displacement)[knots]
    bottom.plot(reference.time[knots], difference, color="0.2", linewidth=0.8)
    # A difference below the solver's tolerance is drawn as zero.
    resolved = RESOLVED_SHARE * float(np.abs(reference.displacement).max(initial=0.0))
    if float(np.abs(difference).max(initial=0.0)) < resolved:
        bottom.set_ylim(-resolved, resolved)
    unit = axis_label(comparison.circuit, "displacement").partition(" ")[2]
    bottom.set_ylabel(f"difference\n{unit}")
    bottom.set_title("displacement, circuit − Monte Carlo")
    bottom.set_xlabel("time [s]")
