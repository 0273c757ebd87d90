"""The figure of a waveform: a panel for each column, one above the other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from harvester.show.numbers import prefixed
from harvester.show.palette import CIRCUIT
from harvester.show.panels import entitle

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from harvester.results.waveform import Waveform

# Width and height of a panel, in inches.
WIDTH, HEIGHT = 7.0, 1.3
# An envelope has this number of bins and replaces a line of more points per bin than `MOST_IN_BIN`,
# whose oscillations would fill the panel. A bin then holds a period of 50 points.
BINS, MOST_IN_BIN = 150, 50


def draw(waveform: Waveform) -> Figure:
    """Every column over time; the velocity is left out, which the displacement shows."""
    from matplotlib.figure import Figure

    names = [name for name in waveform.columns if name != "velocity"]
    figure = Figure(figsize=(WIDTH, 0.7 + HEIGHT * len(names)))
    panels = figure.subplots(len(names), 1, sharex=True, squeeze=False).ravel()
    for axes, name in zip(panels, names, strict=True):
        values = waveform.columns[name]
        factor, unit = prefixed(float(abs(values).max(initial=0.0)), waveform.units[name])
        _draw_column(axes, waveform.time, factor * values)
        words = name.replace("_", " ") if "(" not in name else name
        axes.set_ylabel(f"{words}\n[{'scaled' if unit.startswith('scaled') else unit}]")
    panels[-1].set_xlabel("time [s]")
    figure.align_ylabels(panels)
    entitle(figure, f"{waveform.scene.name}: one realization by {waveform.engine}")
    return figure


def _draw_column(axes, time, values):
    """Draw values over time; of many points the smallest and the largest of each bin."""
    if time.size <= BINS * MOST_IN_BIN:
        axes.plot(time, values, color=CIRCUIT, linewidth=0.8)
        return
    edges = np.searchsorted(time, np.linspace(time[0], time[-1], BINS, endpoint=False))
    # A bin without a point would repeat its neighbour.
    edges = np.unique(edges)
    low, high = np.minimum.reduceat(values, edges), np.maximum.reduceat(values, edges)
    axes.fill_between(time[edges], low, high, color=CIRCUIT, alpha=0.25, linewidth=0)
    for bound in (low, high):
        axes.plot(time[edges], bound, color=CIRCUIT, linewidth=0.6)
