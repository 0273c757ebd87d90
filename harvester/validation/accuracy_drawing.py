"""One measurement, two pictures: every method's error over its run time, and over that to an error.

Legend entries are groups of methods, at most eight; closures are named at their points, and the
sampling error at its line.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.symbols import SYMBOLS
from harvester.results.palette import CLOSURE_MARKERS, LINES, styles
from harvester.results.panels import thin_ticks
from harvester.validation import MEANS
from harvester.validation.accuracy_measurement import LIMITS, is_reference

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINTS = 200
# Smallest and largest error that is drawn, in percent.
LEAST, GREATEST = 1e-2, 300.0
# Opacity of a point without an error bar.
FADED = 0.4
TICKS = {1e-6: "1 µs", 1e-3: "1 ms", 1.0: "1 s", 60.0: "1 min", 3600.0: "1 h", 86400.0: "1 d"}
SAMPLING = {"color": "0.3", "linewidth": 0.9, "linestyle": "-."}
LABEL: dict[str, Any] = {"fontsize": 6.5, "zorder": 5}
LABEL["bbox"] = {"facecolor": "white", "alpha": 0.6, "pad": 0.3, "lw": 0}


def draw(study: Any) -> Figure:
    """Draw an `Accuracy`: strong error and bias over run time, total error over wall time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 6.6))
    grid = figure.add_gridspec(6, 3, width_ratios=(1.0, 1.0, 1.15))
    marks = styles(row.method.group for row in study.rows)
    _draw_strong_errors(figure.add_subplot(grid[:, 0]), study, marks)
    axes: Any = None
    for number, name in enumerate(MEANS):
        axes = figure.add_subplot(grid[2 * number : 2 * number + 2, 1], sharex=axes)
        _draw_biases(axes, study, name, marks)
        axes.tick_params(labelbottom=name == MEANS[-1])
    _label_seconds(axes, study)
    for number, name in enumerate(study.errors):
        last = number == len(study.errors) - 1
        axes = figure.add_subplot(grid[3 * number : 3 * number + 3, 2])
        _draw_total_errors(axes, study, name, marks)
        axes.set_xlabel("wall time of one core" if last else "")
    machine = study.speeds["machine"]
    load = study.scene.to_tables().get("load", {})
    device = study.scene.name + (f" with {load['netlist']}" if "netlist" in load else "")
    figure.suptitle(
        f"{device}: error against run time, and the time to an error "
        f"({machine['date']}, {machine['cores']} cores)\n"
        "bars and bands: two standard errors; hollow: Gear's formula; faded: no error bar; on the "
        "right default settings, dashed where the bias is not known so well",
        x=0.01,
        ha="left",
        fontsize=9,
    )
    _add_legend(figure, study, marks)
    return figure


def _add_legend(figure, study, marks):
    from matplotlib.lines import Line2D

    handles = []
    for group, (colour, marker) in marks.items():
        families = dict.fromkeys(r.method.family for r in study.rows if r.method.group == group)
        theory = next(row.method.order for row in study.rows if row.method.group == group)
        orders = [study.orders[family]["displacement"] for family in families]
        found = ", ".join(f"{order:.1f}" for order in orders if math.isfinite(order))
        label = f"{group}: order {found} ({theory})" if found else group
        handles.append(Line2D([], [], color=colour, marker=marker, markersize=5, label=label))
    if study.closures:
        handles.append(Line2D([], [], ls="none", color="0.4", marker="*", label="averaging"))
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=8)


def _cut(axes, xs, ys):
    """Logarithmic axes that end a little beyond the study."""
    axes.set(xscale="log", yscale="log")
    for values, set_limits in ((xs, axes.set_xlim), (ys, axes.set_ylim)):
        finite = [value for value in values if math.isfinite(value) and value > 0.0]
        if finite:
            set_limits(min(finite) / 2.0, max(finite) * 2.0)
    thin_ticks(axes)


def _mark(row, marks):
    """Look of a method's points."""
    colour, marker = marks[row.method.group]
    face = "white" if row.method.scheme == "gear" else colour
    return {"color": colour, "marker": marker, "markersize": 4.5, "markerfacecolor": face}


def _label_seconds(axes, study):
    axes.set_xlabel(f"core seconds for {study.answer.simulated_time:.3g} simulated ones")


def _draw_strong_errors(axes, study, marks):
    for family in dict.fromkeys(row.method.family for row in study.rows):
        rows = [row for row in study.rows if row.method.family == family]
        seconds = [study.run_seconds(row) for row in rows]
        axes.plot(seconds, [r.strong["displacement"] for r in rows], **_mark(rows[0], marks))
    errors = [row.strong["displacement"] for row in study.rows]
    _cut(axes, map(study.run_seconds, study.rows), errors)
    axes.grid(alpha=0.2)
    _label_seconds(axes, study)
    axes.set_ylabel("RMS error of X [scaled]")
    axes.set_title(f"strong error over {study.horizon:.3g} s, {study.paths} paths")


def _draw_biases(axes, study, name, marks):
    """One mean's |bias| over run time, and what so long a run can show of it."""
    points = [
        (study.run_seconds(row), row.bias[name], _mark(row, marks))
        for row in study.rows
        if name in row.bias and not is_reference(row.bias[name])
    ]
    xs = [seconds for seconds, *_ in points]
    ys = [_draw_point(axes, *point) for point in points]
    for closure, answer in study.closures.items():
        xs.append(answer["seconds"])
        ys.append(_draw_closure(axes, closure, xs[-1], study.deviation(closure, name)))
    level = 100.0 * study.sampling_error(name)
    _cut(axes, xs, [*ys, level])
    if math.isfinite(level):
        axes.axhspan(axes.get_ylim()[0], level, color="0.5", alpha=0.12, lw=0)
        axes.axhline(level, **SAMPLING)
        look = {"ha": "right", "va": "bottom", "transform": axes.get_yaxis_transform(), **LABEL}
        axes.text(0.99, level, "sampling error of the run", **look)
    axes.set_ylabel("|bias| [%]")
    axes.set_title(f"bias of {SYMBOLS[name]}")


def _draw_point(axes, seconds, bias, look):
    """A bias with its error bar; returns its size in percent."""
    size, reach = 100.0 * abs(bias.estimate), 200.0 * (bias.standard_error or 0.0)
    size = min(max(size, LEAST), GREATEST)
    opacity = 1.0 if reach else FADED
    bars = [[min(reach, 0.999 * size)], [reach]]
    axes.errorbar(seconds, size, bars, linestyle="none", elinewidth=0.8, alpha=opacity, **look)
    return size


def _draw_closure(axes, closure, seconds, deviation):
    look = {"color": LINES[closure][0], "marker": CLOSURE_MARKERS[closure], "markersize": 7}
    size = _draw_point(axes, seconds, deviation, look)
    look = {"textcoords": "offset points", "color": LINES[closure][0], **LABEL}
    axes.annotate(closure, (seconds, size), (6, 4), **look)
    return size


def _defaults(rows):
    """Of each family the row at its default step, or at the first of its tolerances."""
    first: dict[str, Any] = {}
    for row in rows:
        if row.errors and row.method.refinement == 1:
            first.setdefault(row.method.family, row)
    return list(first.values())


def _draw_total_errors(axes, study, name, marks):
    rows = [row for row in _defaults(study.rows) if math.isfinite(row.errors[name].resolved_bias)]
    errors = [*(row.errors[name] for row in rows), study.errors[name]]
    times = [error.seconds_to(limit) for error in errors for limit in LIMITS]
    times += [answer["seconds"] for answer in study.closures.values()]
    times = [seconds for seconds in times if math.isfinite(seconds) and seconds > 0.0] or [1.0]
    seconds = np.geomspace(min(times) / 3.0, max(times) * 3.0, POINTS)
    for row in rows:
        _draw_line(axes, row.errors[name], seconds, _mark(row, marks))
    # What is below the smallest of these errors is of no interest.
    sizes = [100.0 * limit for limit in LIMITS]
    for closure, answer in study.closures.items():
        deviation = study.total_deviation(closure, name)
        sizes.append(_draw_closure(axes, closure, answer["seconds"], deviation))
    for limit in LIMITS:
        axes.axhline(100.0 * limit, color="0.7", linewidth=0.8, zorder=0)
    _cut(axes, seconds, sizes)
    sampling = 100.0 * study.errors[name].after(seconds)
    axes.plot(seconds, sampling, zorder=1, **SAMPLING)
    line = {"arrowstyle": "-", "color": "0.3", "linewidth": 0.6}
    k = int(np.argmin(np.abs(sampling - 200.0 * LIMITS[-1])))
    look = {"textcoords": "axes fraction", "arrowprops": line, **LABEL}
    axes.annotate(
        "sampling error alone\n(reference)", (seconds[k], sampling[k]), (0.02, 0.05), **look
    )
    axes.set_yticks([1.0, 3.0, 10.0, 100.0], ["1", "3", "10", "100"])
    ticks = {at: text for at, text in TICKS.items() if seconds[0] <= at <= seconds[-1]}
    axes.set_xticks(list(ticks), list(ticks.values()))
    axes.tick_params(which="minor", labelbottom=False, labelleft=False)
    axes.set_ylabel("total error [%]")
    axes.set_title(f"√(bias² + sampling variance) of {SYMBOLS[name]}")


def _draw_line(axes, error, seconds, look):
    """Solid where the bias is known below the total error, dashed beyond; markers at the limits."""
    total = 100.0 * error.after(seconds)
    known = error.bias.estimate == error.bias.standard_error == 0.0
    uncertainty = 0.0 if known else 2.0 * (error.bias.standard_error or math.inf)
    solid = total >= 100.0 * min(uncertainty, 1e3)
    colour = look["color"]
    axes.plot(seconds, np.where(solid, total, np.nan), color=colour)
    axes.plot(seconds, np.where(solid, np.nan, total), color=colour, linestyle=(0, (2, 2)))
    if abs(error.bias.estimate) > uncertainty:
        sampling = 1e4 * error.scatter**2 * error.cost / seconds
        ends = abs(error.bias.estimate) - uncertainty, error.largest_bias
        low, high = (np.sqrt(sampling + (100.0 * end) ** 2) for end in ends)
        axes.fill_between(seconds, low, high, color=colour, alpha=0.08, linewidth=0)
    times = [error.seconds_to(limit) for limit in LIMITS]
    read = [(at, 100.0 * limit) for at, limit in zip(times, LIMITS, strict=True) if at < math.inf]
    if read:
        axes.plot(*zip(*read, strict=True), linestyle="none", **look)
