"""Figures, drawn with matplotlib when asked for."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.files.writing import whole_file
from harvester.show.figure_settings import figure_settings
from harvester.show.palette import LINES, styles
from harvester.verification.work_precision.diagram import MEANS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from harvester.verification.work_precision.diagram import WorkPrecision

STYLE = Path(__file__).parent / "house.mplstyle"
# Smallest bias that is drawn (%).
LEAST_BIAS = 1e-3


def save(draw: Callable, result: Any, path: str | Path) -> None:
    """Draw a result into a file, whole; the suffix chooses the format.

    Parameters
    ----------
    draw : callable
        `draw_result`, `draw_comparison` or `draw_work_precision`.
    result : Result, Comparison or WorkPrecision
    path : Path

    Raises
    ------
    OutputError
    """
    with whole_file(path) as file:
        _render(draw, result, file, format=Path(path).suffix[1:])


def picture(draw: Callable, result: Any, format: str = "svg") -> bytes:
    """Draw a result into bytes; see `save`."""
    file = io.BytesIO()
    _render(draw, result, file, format=format)
    return file.getvalue()


def drawn(draw: Callable, result: Any) -> Any:
    """What `draw` makes of a result in the project's style, whatever settings are in force."""
    with figure_settings(STYLE):
        return draw(result)


def write(figure: Figure, path: str | Path) -> None:
    """Write a figure into a file, whole; the suffix chooses the format.

    Raises
    ------
    OutputError
    """
    with whole_file(path) as file, figure_settings(STYLE):
        _print(figure, file, format=Path(path).suffix[1:])


def _render(draw, result, target, **options):
    with figure_settings(STYLE):
        _print(draw(result), target, **options)


def _print(figure, target, **options):
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure)
    figure.savefig(target, **options)


def draw_work_precision(diagram: WorkPrecision) -> Figure:
    """Strong error and bias of every method over its seconds per simulated unit."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 5.6))
    grid = figure.add_gridspec(3, 2, width_ratios=(1.0, 1.15))
    left = figure.add_subplot(grid[:, 0])
    marks = styles(row.method.family for row in diagram.rows)
    _draw_strong_errors(left, diagram, marks)
    right: Any = None
    for place, name in enumerate(MEANS):
        right = figure.add_subplot(grid[place, 1], sharex=right)
        _draw_biases(right, diagram, name, marks)
        right.tick_params(labelbottom=place == 2)
    right.set_xlabel("seconds per simulated second, one core")
    figure.suptitle(
        f"{diagram.scene.name}: error against run time "
        f"({diagram.machine['date']}, {diagram.machine['cores']} cores)",
        x=0.01,
        ha="left",
        fontsize=9,
    )
    handles = [*zip(*left.get_legend_handles_labels(), strict=True)]
    handles += zip(*right.get_legend_handles_labels(), strict=True)
    figure.legend(*zip(*handles, strict=True), loc="outside lower center", ncols=3)
    return figure


def _draw_strong_errors(axes, diagram, marks):
    for family, (colour, marker) in marks.items():
        rows = [row for row in diagram.rows if row.method.family == family]
        order, theory = diagram.orders[family]["displacement"], rows[0].method.order
        label = f"{family}: order {order:.1f} ({theory})" if np.isfinite(order) else family
        axes.plot(
            [row.seconds_per_unit for row in rows],
            [row.strong["displacement"] for row in rows],
            marker=marker,
            markersize=4,
            color=colour,
            label=label,
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.grid(alpha=0.2)
    axes.set_xlabel("seconds per simulated second, one core")
    axes.set_ylabel("RMS error of X [scaled]")
    axes.set_title(f"strong error over {diagram.horizon:.3g} s, {diagram.paths} paths")


def _draw_biases(axes, diagram, name, marks):
    """One mean's |bias| with two standard errors, over what its run's length can show."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(LEAST_BIAS, 1e3)
    for row in diagram.rows:
        bias = row.bias.get(name)
        if bias is None or bias.estimate == 0.0:
            continue
        colour, marker = marks[row.method.family]
        size, reach = 100.0 * abs(bias.estimate), 200.0 * (bias.standard_error or 0.0)
        axes.errorbar(
            row.seconds_per_unit,
            size,
            [[min(reach, 0.999 * size)], [reach]],
            fmt=marker,
            markersize=4,
            color=colour,
            elinewidth=0.8,
            # Hollow: no error bar could be given.
            markerfacecolor=colour if reach else "none",
        )
    _draw_sampling_error(axes, diagram, name)
    for closure in diagram.closures:
        colour, style = LINES[closure]
        deviation = 100.0 * abs(diagram.deviation(closure, name).estimate)
        axes.axhline(
            deviation, color=colour, linestyle=style, linewidth=0.9, label=f"averaging, {closure}"
        )
    axes.set_ylabel("|bias| [%]")
    axes.set_title(f"weak error: {name.replace('_', ' ')}, two standard errors")


def _draw_sampling_error(axes, diagram, name):
    """σ/√N of the runs of each length, over the methods that had it: below is noise."""
    for label, brief in (("sampling error σ/√N of the run", False), (None, True)):
        rows = [row for row in diagram.rows if row.method.brief == brief and row.sampling]
        if not rows:
            continue
        times = [row.seconds_per_unit for row in rows]
        span, level = [min(times) / 1.4, max(times) * 1.4], 100.0 * rows[0].sampling[name]
        axes.fill_between(span, LEAST_BIAS, level, color="0.5", alpha=0.15, lw=0)
        axes.plot(span, [level, level], color="0.3", linewidth=0.9, label=label)
