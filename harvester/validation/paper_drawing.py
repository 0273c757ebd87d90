"""Draws the paper's figures in the paper's style: lines for theory, symbols for simulation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.averaging.closures import NOISE_CLOSURES
from harvester.results.drawing import WORTH_DRAWING
from harvester.results.panels import Panel, Series, draw_panels
from harvester.validation.paper_figures import KEY_SYMBOLS, answered

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Colours of a panel's curves: blue and red as in the paper, then green.
COLOURS = ("#0077BB", "#CC3311", "#009988")
# Line styles of the stationary methods, from the last (the default) to the first.
STYLES = dict(zip(reversed(NOISE_CLOSURES), ("-", "--", ":", "-."), strict=False))
# Name, marker and size of the two engines, chosen so that both are visible if they coincide.
MARKS = {"monte-carlo": ("Monte Carlo", "o", 3.5), "circuit": ("circuit", "+", 9.0)}
# Marker of runs that were too short for rare jumps.
SHORT = "x"
# Label and factor of each quantity.
QUANTITIES = {
    "mean_square_voltage": ("$E[V^2]$", 1.0),
    "mean_power": ("$E[P]$", 1.0),
    "power_conversion_efficiency": ("PCE [%]", 100.0),
}
TEX = {"δr": r"\delta_r", "τ1": r"\tau_1", "λ": r"\lambda", "β": r"\beta"}
LETTERS = "abc"
# Number of symbols of a density along the axis.
SYMBOLS_ACROSS = 36
# End of the axis in multiples of the highest simulated value; higher curves are clipped.
HEADROOM = 2.2


def draw(content: Any) -> Figure:
    """Figure of a `Reproduction`: a row of axes per quantity, a column per panel."""
    layout = content.layout
    rows = layout.quantities or ("",)
    panels = [
        _panel(row, letter if len(layout.panels) > 1 else "", panel, lines)
        for row in rows
        for letter, panel, lines in zip(LETTERS, layout.panels, content.lines, strict=False)
    ]
    words = "bars: two standard errors; ×: the run was too short for rare jumps"
    if content.refused:
        methods = ", ".join(dict.fromkeys(method for method, *_ in content.refused))
        words += f"\nno answer at some points ({methods}); reasons in {content.name}.json"
    title = f"Fig. {content.name.removeprefix('fig')}: {layout.title}\n{words}"
    return draw_panels(panels, title, columns=len(layout.panels), sharex="col")


def _panel(quantity, letter, panel, lines):
    name, factor = QUANTITIES.get(quantity, ("$p(X)$", 1.0))
    series = [
        drawn
        for colour, line in zip(COLOURS, lines, strict=False)
        for method, points in line.items()
        for drawn in _series(method, points, quantity, factor, colour)
    ]

    def add_legend(axes):
        from matplotlib.lines import Line2D

        handles = [
            Line2D([], [], color=colour, label=f"${_tex(key)} = {value:g}$")
            for colour, curve in zip(COLOURS, panel.curves, strict=False)
            for key, value in curve
        ]
        axes.legend(handles=handles, fontsize=8, handlelength=1.2)
        symbols = [drawn for drawn in series if drawn.marker]
        if not quantity and symbols:
            reach = 1.05 * max(np.abs(drawn.x).max() for drawn in symbols)
            highest = HEADROOM * max(drawn.y.max() for drawn in symbols)
            axes.set(xlim=(-reach, reach), ylim=(0.0, min(axes.get_ylim()[1], highest)))

    x_label = f"${_tex(panel.swept)}$" if quantity else "$X$"
    y_label = name if letter in ("", LETTERS[0]) else ""
    title = f"({letter})" if letter else ""
    return Panel(x_label, y_label, series, title, from_zero=True, more=add_legend)


def _series(method, points, quantity, factor, colour):
    """The line of a stationary method, with gaps at refused points, or the symbols of an engine."""
    if not quantity:
        return [_density(method, o.density, colour) for _, o in points if answered(o)]
    label = _label(method, colour)
    if method in STYLES:
        x = [value for value, _ in points]
        means = [o.quantities[quantity].estimate if answered(o) else np.nan for _, o in points]
        return [Series(x, factor * np.array(means), label, colour, STYLES[method])]
    _, mark, size = MARKS[method]
    series = []
    for symbol, words, is_short in ((mark, label, False), (SHORT, None, True)):
        selected = [
            (value, outcome.quantities[quantity])
            for value, outcome in points
            if answered(outcome) and outcome.misses_jumps == is_short
        ]
        values = [value for value, _ in selected]
        y = np.array([factor * estimate.estimate for _, estimate in selected])
        bars = [2.0 * factor * (estimate.standard_error or np.nan) for _, estimate in selected]
        series.append(Series(values, y, words, colour, "", symbol, bars, size=size))
    # If all runs are too short, the method's marker appears only in the legend.
    seen = any(drawn.y.size for drawn in series)
    return [drawn for drawn in series if drawn.y.size or (seen and drawn.label)]


def _density(method, density, colour):
    x, y, label = density.centre, density.density, _label(method, colour)
    if method in STYLES:
        return Series(x, y, label, colour, STYLES[method])
    seen = np.flatnonzero(y > WORTH_DRAWING * y.max())
    step = max(1, seen.size // SYMBOLS_ACROSS)
    # The two engines' symbols are at different bins, so that neither hides the other.
    selected = seen[0 if method == "monte-carlo" else step // 2 :: step]
    bars = None if density.standard_error is None else 2.0 * density.standard_error[selected]
    _, mark, size = MARKS[method]
    return Series(x[selected], y[selected], label, colour, "", mark, bars, size=size)


def _label(method, colour):
    """Label of a method, only for the first curve's colour."""
    if colour != COLOURS[0]:
        return None
    return MARKS[method][0] if method in MARKS else f"averaging, {method}"


def _tex(key):
    return TEX.get(KEY_SYMBOLS[key], KEY_SYMBOLS[key])
