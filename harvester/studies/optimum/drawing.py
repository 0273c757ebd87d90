"""Figure of an optimum: a panel for each parameter."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

from harvester.show.numbers import prefixed
from harvester.show.palette import CIRCUIT, MONTE_CARLO
from harvester.show.panels import Panel, Series, draw_panels
from harvester.show.symbols import key_label
from harvester.studies.optimum.axis import INTERVAL
from harvester.studies.optimum.flat_region import FLAT_SHARE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from harvester.studies.optimum.result import Optimum

# Points of print from a place searched to the maximum that was found at it.
APART = 6.0
SEARCHED, MAXIMUM, OWN = "0.6", MONTE_CARLO, CIRCUIT


def draw(found: Optimum) -> Figure:
    """Places searched, the maximum, how far it is flat.

    Over several parameters places differ in the others too, so that the highest of them are the
    outline.
    """
    panels = [_panel(found, parameter) for parameter in found.parameters]
    title = (
        f"{found.scene.name}: {len(found.searched)} places searched, by {found.method} "
        "(bars: two standard errors)"
    )
    return draw_panels(panels, title, size=(3.0, 2.4), sharey=True)


def _panel(found, each):
    key = each.axis.key
    factor, unit = prefixed(found.value.estimate, found.unit.split()[0])
    places = [location[key] for location, _ in found.searched]
    searched = [value.times(factor) for _, value in found.searched]
    values = [value.estimate for value in searched]
    bars = [INTERVAL * (value.standard_error or 0.0) for value in searched]
    top = found.value.times(factor)
    height = INTERVAL * (top.standard_error or 0.0)
    # Beside the place searched there, which it would hide.
    maximum = Series(
        x=[each.place],
        y=[top.estimate],
        label="maximum",
        colour=MAXIMUM,
        line="",
        marker="*",
        bars=[height],
        size=8.0,
        shift=APART,
    )
    return Panel(
        x_label=key_label(key, found.scene.units),
        y_label=f"{found.quantity.replace('_', ' ')} [{unit or '1'}]",
        series=[Series(places, values, "searched", SEARCHED, "", ".", bars=bars), maximum],
        log_x=each.axis.logarithmic,
        more=partial(_draw_bounds, found, each, factor),
    )


def _draw_bounds(found, each, factor, axes):
    """Draw the interval of the place, or the flat region, and the scene's own value."""
    low, high, label = each.flat_low, each.flat_high, f"within {FLAT_SHARE:.0%}, the others held"
    if each.standard_error is not None:
        (low, high), label = found.interval, "interval of the place"
    if not math.isnan(low + high):
        axes.axvspan(low, high, color=MAXIMUM, alpha=0.15, lw=0, label=label)
    if found.own is not None:
        axes.axhline(
            factor * found.own.estimate, color=OWN, linestyle=":", label="the scene itself"
        )
