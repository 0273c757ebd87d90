"""Figures made of panels with data series and error bars."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.formatting import engineering, number, prefixed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Default number of panels in a row.
COLUMNS = 3
LEGEND_COLUMNS = 5
# Width (inches) of a legend entry's mark, and of one letter in the project's style.
MARK, LETTER = 0.6, 0.075
# A logarithmic axis spans at least this ratio; else it would have too few labels.
WIDE_RATIO = 4.0
# Below this ratio of its limits, a logarithmic axis also has labels between its decades.
FEW_DECADES = 100.0
# Labels between these two values are printed without a power of ten.
PLAIN = (1e-3, 1e4)


@dataclass(frozen=True)
class Series:
    """Points, optionally joined by a line.

    Attributes
    ----------
    x, y : array_like, shape (n,)
    label : str or None
        Text in the legend.
    colour : str or None
        None: the next colour of the style.
    line, marker : str
        Style and marker as in matplotlib; "" for none.
    bars : array_like or None
        Lengths of the error bars: shape (n,), or (2, n) for below and above.
    band : array_like or None, shape (n,)
        Half the height of a band about the line.
    hollow : array_like of bool or None, shape (n,)
        Points whose marker is not filled.
    size : float
        Size of a marker.
    width : float or None
        Width of a line; None: the style's width.
    shift : float
        Shift to the right in points, so that markers at the same position are side by side.
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
        Function of the axes that draws anything else.
    x_unit : str or None
        Unit of x, which gets a prefix by the size of x; "": none, and x is labelled as in SPICE.
        None: the label has the unit.
    """

    x_label: str
    y_label: str
    series: Sequence[Series]
    title: str = ""
    log_x: bool = False
    log_y: bool = False
    from_zero: bool = False
    more: Callable[[Axes], object] | None = None
    x_unit: str | None = None


def is_wide(values: Iterable[float]) -> bool:
    """Whether a logarithmic axis suits values: they are spaced geometrically over a wide range."""
    values = np.unique([*values])
    if values[0] <= 0.0 or values[-1] < WIDE_RATIO * values[0]:
        return False
    linear, logarithmic = (np.diff(places) for places in (values, np.log(values)))
    return np.ptp(logarithmic) / logarithmic.mean() <= np.ptp(linear) / linear.mean()


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
        Maximum number of panels in a row; of neighbours with equal y labels only the first has one.
    **shared
        `sharex`, `sharey` of `matplotlib.figure.Figure.subplots`.
    """
    from matplotlib.figure import Figure

    columns = min(len(panels), columns)
    rows = -(-len(panels) // columns)
    wide = max(1.2 + size[0] * columns, 5.0)
    figure = Figure(figsize=(wide, 0.6 + size[1] * rows))
    axes_grid = figure.subplots(rows, columns, squeeze=False, **shared).ravel()
    for index, (axes, panel) in enumerate(zip(axes_grid, panels, strict=False)):
        _draw_panel(axes, panel)
        if index % columns and panel.y_label == panels[index - 1].y_label:
            axes.set_ylabel("")
    for axes in axes_grid[len(panels) :]:
        axes.remove()
    legend_below(figure, axes_grid[: len(panels)])
    set_title(figure, title)
    return figure


def legend_below(figure: Figure, panels: Iterable[Axes]) -> None:
    """Draw one legend for all panels; a repeated label is shown once."""
    legend: dict[str, Any] = {}
    for axes in panels:
        handles, labels = axes.get_legend_handles_labels()
        legend |= dict(zip(labels, handles, strict=True))
    if legend:
        columns = _columns([*legend], figure.get_figwidth())
        figure.legend([*legend.values()], [*legend], loc="outside lower center", ncols=columns)


def _columns(labels, width):
    """Number of legend columns that fit into a figure of this width (inches)."""
    for columns in range(min(len(labels), LEGEND_COLUMNS), 1, -1):
        # matplotlib fills a legend column by column.
        longest = (max(map(len, part)) for part in np.array_split(labels, columns))
        if sum(MARK + LETTER * letters for letters in longest) <= width:
            return columns
    return 1


def set_title(figure: Figure, title: str) -> None:
    """Set a figure's title: small, left-aligned, wrapped at the right edge."""
    figure.suptitle(title, x=0.01, ha="left", fontsize=9, wrap=True)


def label_words(axes: Axes, words: Sequence[str]) -> None:
    """Label the positions 0, 1, … with words, tilted if they would overlap."""
    width = axes.get_window_extent().width / axes.figure.dpi
    tilted = LETTER * (2 + max(map(len, words))) > width / len(words)
    style: Any = {"rotation": 30, "ha": "right", "rotation_mode": "anchor"} if tilted else {}
    axes.set_xticks(range(len(words)), words, **style)


def _in_units(axes, unit):
    """Label the positions on the x axis in a prefixed unit; return this unit."""
    from matplotlib.ticker import FuncFormatter

    low, high = axes.dataLim.intervalx
    # Limits without data are infinite.
    is_log = axes.get_xscale() == "log" and 0.0 < low < math.inf
    factor, printed = prefixed(math.sqrt(low * high) if is_log else max(-low, high), unit)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: _position(factor * x, unit)))
    return printed


def _position(value, unit):
    text = number(value, 6) if unit else engineering(value)
    return text.replace("-", "\N{MINUS SIGN}")


def thin_ticks(axes: Axes) -> None:
    """Label a logarithmic axis at decades, over less than two also at 2 and 5, of one also at 3.

    Values on an x axis have the suffixes of component values: 20k, 10u.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for axis, text in ((axes.xaxis, engineering), (axes.yaxis, _tick)):
        if axis.get_scale() != "log":
            continue
        low, high = axis.get_view_interval()
        axis.set_minor_formatter(NullFormatter())
        if high < FEW_DECADES * low:
            subs = (1.0, 2.0, 3.0, 5.0) if high < 10.0 * low else (1.0, 2.0, 5.0)
            axis.set_major_locator(LogLocator(subs=subs))
            axis.set_major_formatter(FuncFormatter(lambda x, _, text=text: text(x)))


def _tick(value):
    """A number as text: plain if that is short, else with a power of ten."""
    if PLAIN[0] <= value < PLAIN[1]:
        return f"{value:g}"
    first, _, power = f"{value:.0e}".partition("e")
    return rf"${first}\times10^{{{int(power)}}}$"


def _draw_panel(axes, panel):
    for series in panel.series:
        draw_series(axes, series)
    if panel.more:
        panel.more(axes)
    # A logarithmic axis without a positive value cannot be drawn.
    if panel.log_x and any(map(_is_positive, (series.x for series in panel.series))):
        axes.set_xscale("log")
    if panel.log_y and any(map(_is_positive, (series.y for series in panel.series))):
        axes.set_yscale("log")
    thin_ticks(axes)
    if panel.from_zero:
        axes.set_ylim(bottom=0.0)
    label = panel.x_label
    if panel.x_unit is not None:
        unit = _in_units(axes, panel.x_unit.removeprefix("1"))
        label += f" [{unit}]" if label and unit else ""
    axes.set_xlabel(label)
    axes.set_ylabel(panel.y_label)
    axes.set_title(panel.title)


def _is_positive(values):
    """Whether one of some values is finite and positive."""
    numbers = np.asarray(values, float)
    return bool((np.isfinite(numbers) & (numbers > 0.0)).any())


def draw_series(axes: Axes, series: Series) -> None:
    """Draw one series."""
    x, y = np.asarray(series.x), np.asarray(series.y)
    # Error bars of length 0 would appear as caps.
    bars = axes.errorbar(
        x,
        y,
        series.bars if np.any(series.bars) else None,
        color=series.colour,
        linestyle=series.line or "none",
        marker=series.marker,
        markersize=series.size,
        # Caps of different sizes remain visible if two series coincide.
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
            # Caps are drawn slightly above their line.
            zorder=line.get_zorder() + 0.1,
        )
    if series.shift:
        from matplotlib.transforms import ScaledTranslation

        # The shift is applied after drawing, so that limits depend on the original positions only.
        shift = ScaledTranslation(series.shift / 72.0, 0.0, axes.figure.dpi_scale_trans)
        for artist in (line, *caps, *stems, *empty):
            artist.set_transform(axes.transData + shift)
