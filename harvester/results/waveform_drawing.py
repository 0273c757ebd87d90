"""The figure of a waveform: a panel for each column, one above the other."""

from __future__ import annotations

from typing import TYPE_CHECKING

from harvester.show.numbers import prefixed
from harvester.show.palette import CIRCUIT
from harvester.show.panels import entitle

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from harvester.results.waveform import Waveform

# Width and height of a panel, in inches.
WIDTH, HEIGHT = 7.0, 1.3


def draw(waveform: Waveform) -> Figure:
    """Every column over time; the velocity is left out, which the displacement shows."""
    from matplotlib.figure import Figure

    names = [name for name in waveform.columns if name != "velocity"]
    figure = Figure(figsize=(WIDTH, 0.7 + HEIGHT * len(names)))
    panels = figure.subplots(len(names), 1, sharex=True, squeeze=False).ravel()
    for axes, name in zip(panels, names, strict=True):
        values = waveform.columns[name]
        factor, unit = prefixed(float(abs(values).max(initial=0.0)), waveform.units[name])
        axes.plot(waveform.time, factor * values, color=CIRCUIT, linewidth=0.8)
        words = name.replace("_", " ") if "(" not in name else name
        axes.set_ylabel(f"{words}\n[{'scaled' if unit.startswith('scaled') else unit}]")
    panels[-1].set_xlabel("time [s]")
    figure.align_ylabels(panels)
    entitle(figure, f"{waveform.scene.name}: one realization by {waveform.engine}")
    return figure
