"""The figure of a comparison: densities by every method, waveforms on one noise path."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from harvester.results.drawing import axis_label, density_label, draw_density, frame
from harvester.show.palette import CIRCUIT, LINES, MONTE_CARLO
from harvester.show.panels import entitle, legend_below

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from harvester.studies.comparison import Comparison


# Line widths of the reference below all others, and of the closures above them.
WIDTHS = (3.0, 1.0)


def draw_comparison(comparison: Comparison) -> Figure:
    """Densities by every engine and closure; waveforms on one path; their difference."""
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
    entitle(figure, f"{comparison.scene.name}: {compared} (bands: two standard errors)")
    # Closures differ in the densities that they have: one legend for all panels.
    legend_below(figure, panels)
    return figure


def _draw_densities(axes, comparison, name):
    # Thin lines over thick ones show both where they coincide.
    thick, thin = WIDTHS
    draw_density(axes, comparison.monte_carlo, name, MONTE_CARLO, "-", "Monte Carlo", thick)
    draw_density(axes, comparison.circuit, name, CIRCUIT, "--", "circuit")
    # Closures are drawn above the simulations, whose bands are broad where they are noisy.
    for closure, result in comparison.closures.items():
        colour, style = LINES[closure]
        if name in result.densities:
            draw_density(axes, result, name, colour, style, f"averaging, {closure}", thin)
    simulated = comparison.monte_carlo.densities[name]
    frame(axes, [comparison.circuit, comparison.monte_carlo], name)
    peak = simulated.density.max() / comparison.monte_carlo.scales.of(name)
    # A closure that is far too high would flatten the others.
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
    unit = axis_label(comparison.circuit, "displacement").partition(" ")[2]
    bottom.set_ylabel(f"difference\n{unit}")
    bottom.set_title("displacement, circuit − Monte Carlo")
    bottom.set_xlabel("time [s]")
