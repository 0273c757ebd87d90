"""The paper's figures, drawn as the paper draws them: lines for theory, symbols for simulation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.averaging.closures import NOISE_CLOSURES
from harvester.results.drawing import WORTH_DRAWING
from harvester.validation.paper_figures import KEY_SYMBOLS, answered

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Colours of a panel's curves: blue and red as in the paper, then green.
COLOURS = ("#0077BB", "#CC3311", "#009988")
# Line styles of the closures from the last, which is the default, to the first.
STYLES = ("-", "--", ":", "-.")
# Marks of the two engines. The smaller circle lies inside the square, so that both are
# visible where they agree.
MARKS = {"monte-carlo": "o", "circuit": "s"}
SIZES = {"monte-carlo": 4.0, "circuit": 6.0}
NAMES = {
    "mean_square_voltage": "$E[V^2]$",
    "mean_power": "$E[P]$",
    "power_conversion_efficiency": "PCE [%]",
}
PERCENT = ("power_conversion_efficiency",)
LETTERS = "abc"
# Number of symbols of a density across the axis.
SYMBOLS_ACROSS = 36
# Opacity of the symbols of runs that were too short for rare jumps.
FADED = 0.35
# Width of a legend entry below a figure, in inches.
LEGEND_ENTRY = 1.9
# The axis ends at this multiple of the highest simulated value; higher curves are cut off.
HEADROOM = 2.2


def draw(content: Any) -> Figure:
    """Figure of a `Reproduction`."""
    return _draw_densities(content) if content.is_density else _draw_sweeps(content)


def titled_figure(content: Any, title: str, width: float, height: float) -> Figure:
    """An empty figure of a size in inches, with the paper's number and a title."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height))
    number = content.name.removeprefix("fig")
    figure.suptitle(f"Fig. {number}: {title}", x=0.01, ha="left", fontsize=10)
    return figure


def _style(closure):
    return STYLES[(len(NOISE_CLOSURES) - 1 - list(NOISE_CLOSURES).index(closure)) % len(STYLES)]


def _draw_sweeps(content):
    """A row of axes for each quantity, a column for each panel."""
    rows, columns = len(content.layout.quantities), len(content.layout.panels)
    width = 3.3 * columns + (2.0 if columns == 1 else 0.0)
    figure = titled_figure(content, content.layout.title, width, 2.6 * rows + 1.1)
    axes = figure.subplots(rows, columns, sharex="col", squeeze=False)
    for column, (panel, lines) in enumerate(zip(content.layout.panels, content.lines, strict=True)):
        for row, quantity in enumerate(content.layout.quantities):
            _draw_curves(axes[row, column], panel, lines, quantity)
            axes[row, column].set_ylabel(NAMES[quantity] if column == 0 else "")
        if columns > 1:
            axes[0, column].set_title(f"({LETTERS[column]})")
        axes[-1, column].set_xlabel(f"${_tex(panel.swept)}$")
        _curve_legend(axes[0, column], panel)
    _method_legend(figure, content)
    return figure


def _draw_curves(axes, panel, lines, quantity):
    factor = 100.0 if quantity in PERCENT else 1.0
    for colour, line in zip(COLOURS, lines, strict=False):
        for method, points in line.items():
            if method not in MARKS:
                # A refused point leaves a gap in the line.
                y = [
                    factor * outcome.quantities[quantity].estimate if answered(outcome) else np.nan
                    for _, outcome in points
                ]
                axes.plot([value for value, _ in points], y, _style(method), color=colour)
                continue
            for value, answer in filter(lambda point: answered(point[1]), points):
                estimate = answer.quantities[quantity]
                bar = 2.0 * factor * (estimate.standard_error or np.nan)
                opacity = FADED if answer.misses_jumps else 1.0
                _symbols(axes, method, value, factor * estimate.estimate, bar, colour, opacity)
    axes.set_ylim(bottom=0.0)


def _symbols(axes, method, x, y, errors, colour, opacity=1.0):
    """Hollow circles for Monte Carlo, filled squares for the circuit, bars of ± `errors`."""
    look: dict[str, Any] = {"fmt": MARKS[method], "markersize": SIZES[method], "color": colour}
    if method == "circuit":
        look |= {"markerfacecolor": colour, "markeredgecolor": "black", "zorder": 3}
    else:
        look |= {"markerfacecolor": "white", "markeredgecolor": colour, "zorder": 4}
    axes.errorbar(x, y, errors, elinewidth=0.9, capsize=2, alpha=opacity, **look)


def _draw_densities(content):
    columns = len(content.layout.panels)
    figure = titled_figure(content, content.layout.title, 3.4 * columns, 3.6)
    axes = figure.subplots(1, columns, squeeze=False)[0]
    for column, (panel, lines) in enumerate(zip(content.layout.panels, content.lines, strict=True)):
        highest, reach = 0.0, 0.0
        for colour, line in zip(COLOURS, lines, strict=False):
            for method, ((_, outcome),) in line.items():
                if not answered(outcome):
                    continue
                density: Any = outcome.density
                if method in MARKS:
                    _density_symbols(axes[column], method, density, colour)
                    seen = density.density > WORTH_DRAWING * density.density.max()
                    reach = max(reach, np.abs(density.centre[seen]).max())
                    highest = max(highest, density.density.max())
                else:
                    style = _style(method)
                    axes[column].plot(density.centre, density.density, style, color=colour)
        if highest > 0.0:
            axes[column].set_xlim(-1.05 * reach, 1.05 * reach)
            axes[column].set_ylim(0.0, min(axes[column].get_ylim()[1], HEADROOM * highest))
        axes[column].set_title(f"({LETTERS[column]})")
        axes[column].set_xlabel("$X$")
        axes[column].set_ylabel("$p(X)$" if column == 0 else "")
        _curve_legend(axes[column], panel)
    _method_legend(figure, content)
    return figure


def _density_symbols(axes, method, density, colour):
    seen = int(np.count_nonzero(density.density > WORTH_DRAWING * density.density.max()))
    step = max(1, seen // SYMBOLS_ACROSS)
    # The symbols of the two engines stand on different bins, so that neither hides the other.
    every = slice(0 if method == "monte-carlo" else step // 2, None, step)
    errors = density.standard_error
    bars = np.full(density.centre.shape, np.nan) if errors is None else 2.0 * errors
    _symbols(axes, method, density.centre[every], density.density[every], bars[every], colour)


def _curve_legend(axes, panel):
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=colour, label=f"${_tex(key)} = {value:g}$")
        for colour, curve in zip(COLOURS, panel.curves, strict=False)
        for key, value in curve
    ]
    axes.legend(handles=handles, fontsize=8, handlelength=1.2)


def _method_legend(figure, content):
    from matplotlib.lines import Line2D

    handles = []
    for method in content.lines[0][0]:
        if method in MARKS:
            label = "circuit" if method == "circuit" else "Monte Carlo"
            mark: dict[str, Any] = {"marker": MARKS[method], "linestyle": "none"}
            mark["markerfacecolor"] = "0.2" if method == "circuit" else "white"
        else:
            label, mark = f"averaging, {method}", {"linestyle": _style(method)}
        handles.append(Line2D([], [], color="0.2", label=label, **mark))
    words = ["bars: two standard errors; faded: the run was too short for rare jumps"]
    if content.refused:
        methods = ", ".join(dict.fromkeys(method for method, *_ in content.refused))
        words.append(f"no answer at some points ({methods}): why is in {content.name}.json")
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=min(len(handles), int(figure.get_figwidth() / LEGEND_ENTRY)),
        title="\n".join(words),
        title_fontsize=8,
    )


def _tex(key):
    return {"δr": r"\delta_r", "τ1": r"\tau_1", "λ": r"\lambda", "β": r"\beta"}.get(
        KEY_SYMBOLS[key], KEY_SYMBOLS[key]
    )
