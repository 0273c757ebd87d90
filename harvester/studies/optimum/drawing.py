"""Figure of a maximum over several parameters."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from harvester.studies.optimum.several import OptimumOfSeveral

# Panels in one row.
COLUMNS = 3
PROPOSED, MAXIMUM, OWN = "0.6", "#D55E00", "#0072B2"


def draw(found: OptimumOfSeveral) -> Figure:
    """A panel for each parameter: places proposed, the maximum, how far it is flat.

    Places differ in the other parameters too, so that the highest of them are the outline.
    """
    from matplotlib.figure import Figure

    columns = min(len(found.ranges), COLUMNS)
    rows = -(-len(found.ranges) // columns)
    figure = Figure(figsize=(1.0 + 3.0 * columns, 0.9 + 2.4 * rows))
    panels = figure.subplots(rows, columns, sharey=True, squeeze=False).ravel()
    for axes, each in zip(panels, found.ranges, strict=False):
        _draw_parameter(axes, found, each)
    for axes in panels[len(found.ranges) :]:
        axes.remove()
    for axes in panels[::columns][:rows]:
        axes.set_ylabel(f"{found.quantity.replace('_', ' ')} [{found.unit.split()[0]}]")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    figure.suptitle(
        f"{found.scene.name}: {len(found.searched)} places proposed, by {found.method} "
        "(bar: two standard errors)",
        x=0.01,
        ha="left",
        fontsize=9,
    )
    return figure


def _draw_parameter(axes, found, each):
    from harvester.studies.optimum.flat_region import FLAT_SHARE

    key = each.axis.key
    axes.plot(
        [place[key] for place, _ in found.searched],
        [value for _, value in found.searched],
        ".",
        color=PROPOSED,
        markersize=4,
        label="proposed",
    )
    if not math.isnan(each.flat_low + each.flat_high):
        axes.axvspan(
            each.flat_low,
            each.flat_high,
            color=MAXIMUM,
            alpha=0.15,
            lw=0,
            label=f"within {FLAT_SHARE:.0%}, the others held",
        )
    axes.axhline(found.own.estimate, color=OWN, linestyle=":", label="the scene itself")
    axes.errorbar(
        each.place,
        found.value.estimate,
        2.0 * (found.value.standard_error or 0.0),
        fmt="*",
        color=MAXIMUM,
        markersize=8,
        capsize=2,
        label="maximum",
    )
    if each.axis.logarithmic:
        axes.set_xscale("log")
    axes.set_xlabel(key)
