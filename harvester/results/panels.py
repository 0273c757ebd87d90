"""Figures from data: panels of series with error bars."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Default number of panels in a row.
COLUMNS = 3
LEGEND_COLUMNS = 5
# Width (inches) of a legend's entry without its words, and of a letter in the house style.
MARK, LETTER = 0.6, 0.075
# An axis is logarithmic from this ratio of its values. Over less it would have too few labels.
WIDE_RATIO = 10.0
# Below this ratio of its ends a logarithmic axis has labels between the decades too, of which there
# are at most two.
FEW_DECADES = 100.0
# Labels between these two values are printed without a power of ten.
PLAIN = (1e-3, 1e4)


@dataclass(frozen=True)
class Series:
    """Points, joined by a line or not.

    Attributes
    ----------
    x, y : array_like, shape (n,)
    label : str or None
        Text in the legend.
    colour : str or None
        None: the next of the style's own.
    line, marker : str
        Style and marker as in matplotlib; "" for none.
    bars : array_like or None
        Lengths of the error bars to either side; of shape (n,), or (2, n) below and above.
    band : array_like or None, shape (n,)
        Half the height of a band about the line.
    hollow : array_like of bool or None, shape (n,)
        Points whose mark is not filled.
    size : float
        Size of a mark.
    width : float or None
        Width of a line; None: the style's own.
    shift : float
        Points of print to the right, so that marks at the same position are side by side.
    """

    x: Any
    y: Any
    label: str | None = None
    colour: str | None = None
    line: str = "-"
    marker: str = ""
    bars: Any = None
    band: Any = None
    hollow: Any = None
    size: float = 4.0
    width: float | None = None
    shift: float = 0.0


@dataclass(frozen=True)
class Panel:
    """One pair of axes.

    Attributes
    ----------
    x_label, y_label, title : str
    series : sequence of Series
    log_x, log_y : bool
    from_zero : bool
        Whether the y axis begins at 0.
    more : callable or None
        Draws everything else into the given axes.
    """

    x_label: str
    y_label: str
    series: Sequence[Series]
    title: str = ""
    log_x: bool = False
    log_y: bool = False
    from_zero: bool = False
    more: Callable[[Axes], object] | None = None


def is_wide(values: Iterable[float]) -> bool:
    """Whether values are worth a logarithmic axis."""
    values = list(values)
    return min(values) > 0.0 and max(values) >= WIDE_RATIO * min(values)


def draw_panels(
    panels: Sequence[Panel],
    title: str,
    size: tuple[float, float] = (3.2, 3.0),
    columns: int = COLUMNS,
    **shared: Any,
) -> Figure:
    """A figure of panels with one legend below.

    Parameters
    ----------
    panels : sequence of Panel
    title : str
    size : (float, float)
        Size of a panel, in inches.
    columns : int
        Most panels in a row; only the first of those with the same y axis names it.
    **shared
        `sharex`, `sharey` of `matplotlib.figure.Figure.subplots`.
    """
    from matplotlib.figure import Figure

    columns = min(len(panels), columns)
    rows = -(-len(panels) // columns)
    wide = max(1.2 + size[0] * columns, 5.0)
    figure = Figure(figsize=(wide, 0.6 + size[1] * rows))
    places = figure.subplots(rows, columns, squeeze=False, **shared).ravel()
    for index, (axes, panel) in enumerate(zip(places, panels, strict=False)):
        _draw_panel(axes, panel)
        if index % columns and panel.y_label == panels[index - 1].y_label:
            axes.set_ylabel("")
    for axes in places[len(panels) :]:
        axes.remove()
    legend_below(figure, places[: len(panels)])
    set_title(figure, title)
    return figure


def legend_below(figure: Figure, panels: Iterable[Axes]) -> None:
    """One legend for all panels; a label that several have is shown once."""
    legend: dict[str, Any] = {}
    for axes in panels:
        handles, labels = axes.get_legend_handles_labels()
        legend |= dict(zip(labels, handles, strict=True))
    if legend:
        columns = _columns([*legend], figure.get_figwidth())
        figure.legend([*legend.values()], [*legend], loc="outside lower center", ncols=columns)


def _columns(labels, width):
    """Number of a legend's columns that fit into a figure of this width (inches)."""
    for columns in range(min(len(labels), LEGEND_COLUMNS), 1, -1):
        # matplotlib fills a legend column by column.
        longest = (max(map(len, part)) for part in np.array_split(labels, columns))
        if sum(MARK + LETTER * letters for letters in longest) <= width:
            return columns
    return 1


def set_title(figure: Figure, title: str) -> None:
    """The title of a figure: small, at the left, wrapped at the right edge."""
    figure.suptitle(title, x=0.01, ha="left", fontsize=9, wrap=True)


def thin_ticks(axes: Axes) -> None:
    """Labels of logarithmic axes: decades, and 1, 2, 5 over less than two of them."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() != "log":
            continue
        low, high = axis.get_view_interval()
        axis.set_minor_formatter(NullFormatter())
        if high < FEW_DECADES * low:
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: _tick(value)))


def _tick(value):
    """A number as text: in plain form if that is short, else with a power of ten."""
    if PLAIN[0] <= value < PLAIN[1]:
        return f"{value:g}"
    first, _, power = f"{value:.0e}".partition("e")
    return rf"${first}\times10^{{{int(power)}}}$"


def _draw_panel(axes, panel):
    for series in panel.series:
        draw_series(axes, series)
    if panel.more:
        panel.more(axes)
    if panel.log_x:
        axes.set_xscale("log")
    if panel.log_y:
        axes.set_yscale("log")
    thin_ticks(axes)
    if panel.from_zero:
        axes.set_ylim(bottom=0.0)
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    axes.set_title(panel.title)


def draw_series(axes: Axes, series: Series) -> None:
    """Draw one series into axes."""
    x, y = np.asarray(series.x), np.asarray(series.y)
    # Error bars of length 0 would show as caps.
    bars = axes.errorbar(
        x,
        y,
        series.bars if np.any(series.bars) else None,
        color=series.colour,
        linestyle=series.line or "none",
        marker=series.marker,
        markersize=series.size,
        # Caps of different size stay visible where two series coincide.
        capsize=0.5 * series.size,
        linewidth=series.width,
        elinewidth=1.0,
        label=series.label,
    )
    line, caps, stems = bars.lines
    colour, empty = line.get_color(), []
    if series.band is not None:
        axes.fill_between(x, y - series.band, y + series.band, color=colour, alpha=0.25, lw=0)
    if series.hollow is not None and np.any(series.hollow):
        empty = axes.plot(
            x[series.hollow],
            y[series.hollow],
            series.marker,
            color=colour,
            markersize=series.size,
            markerfacecolor="white",
            # An error bar's own marks lie a little above its lines.
            zorder=line.get_zorder() + 0.1,
        )
    if series.shift:
        from matplotlib.transforms import ScaledTranslation

        # After the drawing: the axes' limits follow marks in their original positions only.
        shift = ScaledTranslation(series.shift / 72.0, 0.0, axes.figure.dpi_scale_trans)
        for artist in (line, *caps, *stems, *empty):
            artist.set_transform(axes.transData + shift)
