"""Two pictures of every method's error: over its run time, and over the wall time of an answer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.symbols import SYMBOLS
from harvester.results.palette import CLOSURE_MARKERS, LINES, styles
from harvester.results.panels import thin_ticks

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Range of the errors that are drawn, in percent. A line begins at an error below the second.
LEAST_ERROR, GREATEST_ERROR = 0.2, 300.0
POINTS = 200
# Widths and marker sizes of the first and the last line: thin over thick shows both where they
# coincide.
WIDTHS, MARKS = (3.0, 1.0), (8.0, 4.0)
# Smallest bias that is drawn, in percent.
LEAST_BIAS = 1e-3
TICKS = {1e-3: "1 ms", 1e-2: "", 1e-1: "0.1 s", 1.0: "1 s", 10.0: "10 s", 60.0: "1 min"}
TICKS |= {600.0: "10 min", 3600.0: "1 h", 36000.0: "10 h", 864000.0: "10 d"}


def draw(results: Sequence[Any]) -> Figure:
    """Total error over wall time: one row of panels for each of some `TimeToAccuracy`."""
    from matplotlib.figure import Figure

    rows, columns = len(results), max(len(study.quantities) for study in results)
    figure = Figure(figsize=(3.6 * columns, 2.8 * rows + 1.4))
    panels = figure.subplots(rows, columns, squeeze=False)
    marks = styles(line.name for study in results for line in study.lines)
    legend: dict[str, Any] = {}
    for row, result in zip(panels, results, strict=True):
        for axes, name in zip(row, result.quantities, strict=False):
            _draw_panel(axes, result, name, marks)
            handles, labels = axes.get_legend_handles_labels()
            legend |= dict(zip(labels, handles, strict=True))
        row[0].set_ylabel("total error [%]")
    for axes in panels[-1]:
        axes.set_xlabel("wall time of one core")
    figure.suptitle(
        "How long until 1 %? Bias and sampling error together. Dashed: the bias is not known so "
        "well;\nband: two standard errors of a bias that shows",
        x=0.01,
        ha="left",
        fontsize=9,
    )
    figure.legend(list(legend.values()), list(legend), loc="outside lower center", ncols=2)
    return figure


def _draw_panel(axes, result, name, marks):
    first, last = _span(result, name)
    seconds = np.geomspace(first, last, POINTS)
    drawn = [
        line
        for line in result.lines
        if line.errors and math.isfinite(line.errors[name].resolved_bias)
    ]
    sizes = [np.linspace(*ends, len(drawn)) for ends in (WIDTHS, MARKS)]
    for line, width, size in zip(drawn, *sizes, strict=True):
        _draw_line(axes, line, name, seconds, (*marks[line.name], width, size), result.limits)
    for point in result.points:
        deviation = point.deviations[name]
        size, reach = 100.0 * abs(deviation.estimate), 200.0 * (deviation.standard_error or 0.0)
        axes.errorbar(
            point.seconds,
            max(size, LEAST_ERROR),
            [[min(reach, 0.999 * max(size, LEAST_ERROR))], [reach]],
            fmt=CLOSURE_MARKERS[point.name],
            markersize=8,
            color=LINES[point.name][0],
            elinewidth=0.8,
            label=f"averaging, {point.name}",
        )
    for limit in result.limits:
        axes.axhline(100.0 * limit, color="0.7", linewidth=0.8, zorder=0)
    axes.set(xscale="log", yscale="log", xlim=(first, last), ylim=(LEAST_ERROR, GREATEST_ERROR))
    axes.set_yticks([1.0, 3.0, 10.0, 100.0], ["1", "3", "10", "100"])
    ticks = {at: text for at, text in TICKS.items() if first <= at <= last}
    axes.set_xticks(list(ticks), list(ticks.values()))
    axes.tick_params(which="minor", bottom=False, labelbottom=False, labelleft=False)
    load = result.scene.to_tables().get("load", {})
    device = (
        f"{result.scene.name} with {load['netlist']}" if "netlist" in load else result.scene.name
    )
    axes.set_title(f"{device}: {SYMBOLS[name]}")


def _draw_line(axes, line, name, seconds, mark, limits):
    """Solid where the bias is known below the total error, dashed beyond; markers at the limits."""
    colour, marker, width, size = mark
    error = line.errors[name]
    total = 100.0 * error.after(seconds)
    uncertainty = 2.0 * (error.bias.standard_error if error.bias.standard_error else math.inf)
    if error.bias.estimate == error.bias.standard_error == 0.0:
        uncertainty = 0.0
    solid = total >= 100.0 * min(uncertainty, 1e3)
    axes.plot(seconds, np.where(solid, total, np.nan), color=colour, linewidth=width)
    dashed = {"linestyle": (0, (2, 2)), "linewidth": width}
    axes.plot(seconds, np.where(solid, np.nan, total), color=colour, **dashed)
    if abs(error.bias.estimate) > uncertainty:
        sampling = 1e4 * error.scatter**2 * error.cost / seconds
        high = np.sqrt(sampling + (100.0 * error.largest_bias) ** 2)
        low = max(abs(error.bias.estimate) - uncertainty, 0.0)
        low = np.sqrt(sampling + (100.0 * low) ** 2)
        axes.fill_between(seconds, low, high, color=colour, alpha=0.08, linewidth=0)
    read = [(error.seconds_to(limit), 100.0 * limit) for limit in limits]
    read = [pair for pair in read if math.isfinite(pair[0])]
    places = tuple(zip(*read, strict=True)) or ((), ())
    axes.plot(*places, marker, color=colour, markersize=size)
    key = {"marker": marker, "markersize": size, "linewidth": width}
    axes.plot([], [], color=colour, label=line.name, **key)


def _span(result, name):
    """The axis' range of times (s), a little beyond all times that are read off or belong to
    closures."""
    errors = [line.errors[name] for line in result.lines if line.errors]
    times = [error.seconds_to(limit) for error in errors for limit in result.limits]
    times += [point.seconds for point in result.points]
    times = [time for time in times if math.isfinite(time) and time > 0.0] or [1.0]
    return 0.3 * min(times), 5.0 * max(times)


def draw_work_precision(diagram: Any) -> Figure:
    """Strong error and bias of every method over its seconds per simulated unit."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 6.2))
    grid = figure.add_gridspec(3, 2, width_ratios=(1.0, 1.15))
    left = figure.add_subplot(grid[:, 0])
    marks = styles(row.method.family for row in diagram.rows)
    _draw_strong_errors(left, diagram, marks)
    right: Any = None
    for grid_row, name in enumerate(diagram.means):
        right = figure.add_subplot(grid[grid_row, 1], sharex=right)
        _draw_biases(right, diagram, name, marks)
        right.tick_params(labelbottom=grid_row == 2)
    right.set_xlabel("seconds per simulated second, one core")
    machine = diagram.measured.speeds["machine"]
    figure.suptitle(
        f"{diagram.scene.name}: error against run time "
        f"({machine['date']}, {machine['cores']} cores; bars: two standard errors)",
        x=0.01,
        ha="left",
        fontsize=9,
    )
    handles = [*zip(*left.get_legend_handles_labels(), strict=True)]
    handles += zip(*right.get_legend_handles_labels(), strict=True)
    figure.legend(*zip(*handles, strict=True), loc="outside lower center", ncols=2)
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
            markersize=5,
            color=colour,
            label=label,
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    thin_ticks(axes)
    axes.grid(alpha=0.2)
    axes.set_xlabel("seconds per simulated second, one core")
    axes.set_ylabel("RMS error of X [scaled]")
    measured = diagram.measured
    axes.set_title(f"strong error over {measured.horizon:.3g} s, {measured.paths} paths")


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
            # A hollow marker has no error bar.
            markerfacecolor=colour if reach else "none",
        )
    _draw_sampling_error(axes, diagram, name)
    for closure in diagram.measured.closures:
        colour, style = LINES[closure]
        deviation = 100.0 * abs(diagram.deviation(closure, name).estimate)
        axes.axhline(
            deviation, color=colour, linestyle=style, linewidth=0.9, label=f"averaging, {closure}"
        )
    axes.set_ylabel("|bias| [%]")
    axes.set_title(name.replace("_", " "))


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
