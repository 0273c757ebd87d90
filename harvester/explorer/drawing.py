"""The picture of `explore`: densities above, a stretch of the motion below."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from harvester.results.drawing import axis_label, draw_density, frame
from harvester.show.palette import CIRCUIT, LINES, MONTE_CARLO

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from harvester.explorer.explorer import View

MARGINS = {"left": 0.115, "right": 0.98, "bottom": 0.1, "top": 0.93, "hspace": 0.34}


def draw(view: View) -> Figure:
    """p(X), p(X') and p(V) by Monte Carlo and the stationary solver; X and V over time."""
    from matplotlib import rc_context

    # Setting tick labels as formulas would take as long as the rest of the drawing.
    with rc_context({"axes.formatter.use_mathtext": False}):
        return _drawn(view)


def _drawn(view):
    from matplotlib.figure import Figure

    result = view.result
    figure = Figure(figsize=(8.0, 4.8))
    figure.set_layout_engine("none")
    halves = figure.add_gridspec(2, 1, **MARGINS)
    across = halves[0].subgridspec(1, len(result.densities), wspace=0.28)
    for column, name in enumerate(result.densities):
        axes = figure.add_subplot(across[column])
        draw_density(axes, result, name, MONTE_CARLO, "-", "Monte Carlo")
        if name in view.outline:
            solver = replace(result, densities=view.outline)
            draw_density(axes, solver, name, LINES["fokker_planck"][0], ":", "stationary solver")
        axes.set_xlabel(axis_label(result, name))
        axes.set_ylim(bottom=0.0)
        axes.locator_params(axis="x", nbins=5)
        frame(axes, [result], name)
        if column == 0:
            axes.set_ylabel("probability density")
            figure.legend(*axes.get_legend_handles_labels(), loc="upper right", ncols=2)
    motion = halves[1].subgridspec(2, 1, hspace=0.18)
    above = figure.add_subplot(motion[0])
    below = figure.add_subplot(motion[1], sharex=above)
    for axes, name in ((above, "displacement"), (below, "voltage")):
        axes.plot(result.waveform.time, result.waveform[name], color=CIRCUIT, linewidth=0.8)
        axes.set_ylabel(axis_label(result, name).replace(" ", "\n"), fontsize=8)
    figure.align_ylabels((above, below))
    above.tick_params(labelbottom=False)
    below.set_xlabel("time [s]")
    return figure
