"""Draws every method's error over run time, and its run time to a given error.

The legend lists at most eight groups of methods. Stationary methods are labelled at their points,
the sampling error at its line.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.symbols import SYMBOLS
from harvester.results.palette import CLOSURE_MARKERS, LINES, OTHER_LINE, OTHER_MARKER, styles
from harvester.results.panels import Panel, Series, draw_panels
from harvester.statistics.units import unit_of
from harvester.validation import MEANS
from harvester.validation.accuracy_measurement import LIMITS, is_reference

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINTS = 200
# Smallest and largest drawn error, in percent.
LEAST, GREATEST = 1e-2, 300.0
NAME: dict[str, Any] = {"fontsize": 6.5, "zorder": 5, "textcoords": "offset points"}
NAME["bbox"] = {"facecolor": "white", "alpha": 0.6, "pad": 0.3, "lw": 0}


# A broad line behind all others, on which methods without bias lie.
SAMPLING: dict[str, Any] = {"label": "sampling error alone", "colour": "0.8", "width": 4.0}


def draw(study: Any) -> Figure:
    """Draw an `Accuracy`: strong error and bias over run time, total error over wall time."""
    marks = styles(row.method.group for row in study.rows)
    panels = [
        _strong_errors(study, marks),
        *(_biases(study, name, marks) for name in MEANS),
        *(_total_errors(study, name, marks) for name in study.errors),
    ]
    machine = study.speeds["machine"]
    load = study.scene.to_tables().get("load", {})
    device = study.scene.name + (f" with {load['netlist']}" if "netlist" in load else "")
    title = (
        f"{device}: error against run time, and the time to an error "
        f"({machine['date']}, {machine['cores']} cores)\n"
        "bars: two standard errors, none if unknown; hollow: Gear's formula; total "
        "errors are for default settings, dashed where the bias is uncertain; a bias beyond "
        f"{LEAST:g} to {GREATEST:g} % is drawn at that end"
    )
    return draw_panels(panels, title, size=(3.5, 3.1))


def _panel(series, x_label, y_label, title, named=()):
    """Logarithmic axes slightly larger than the data, with labels next to some points."""

    def cut(axes):
        for column, set_limits in (("x", axes.set_xlim), ("y", axes.set_ylim)):
            values = np.concatenate([getattr(drawn, column) for drawn in series])
            values = values[np.isfinite(values) & (values > 0.0)]
            if values.size:
                set_limits(values.min() / 2.0, values.max() * 2.0)
        for name, drawn in named:
            axes.annotate(name, (drawn.x[0], drawn.y[0]), (6, 4), color=drawn.colour, **NAME)

    return Panel(x_label, y_label, series, title, log_x=True, log_y=True, more=cut)


def _points(row, marks, x, y, **look):
    """Points of a method; hollow for Gear's formula."""
    colour, marker = marks[row.method.group]
    hollow = np.full(len(x), row.method.scheme == "gear")
    look = {"line": "", "size": 4.5, **look}
    return Series(np.array(x), np.array(y), colour=colour, marker=marker, hollow=hollow, **look)


def _strong_errors(study, marks):
    series = []
    for group in marks:
        rows = [row for row in study.rows if row.method.group == group]
        families = dict.fromkeys(row.method.family for row in rows)
        orders = [study.orders[family]["displacement"] for family in families]
        measured = ", ".join(f"{order:.1f}" for order in orders if math.isfinite(order))
        label = f"{group}: order {measured} ({rows[0].method.order})" if measured else group
        for family in families:
            ours = [row for row in rows if row.method.family == family]
            errors = [study.strong_error(row, "displacement") for row in ours]
            x = [study.run_seconds(row) for row in ours]
            series.append(_points(ours[0], marks, x, errors, line="-", label=label))
            label = None
    title = f"strong error over {study.horizon:.3g} s, {study.paths} paths"
    return _panel(
        series, _run_time(study), f"RMS error of X [{unit_of(study.scene, 'displacement')}]", title
    )


def _run_time(study):
    return f"core seconds for {study.answer.simulated_time:.3g} simulated seconds"


def _in_percent(bias):
    """Absolute bias and error bar, each of shape (…, 1), within the drawn range."""
    size, reach = 100.0 * abs(bias.estimate), 200.0 * (bias.standard_error or 0.0)
    size = min(max(size, LEAST), GREATEST)
    return np.array([size]), np.array([[min(reach, 0.999 * size)], [reach]])


def _closures(study, deviation):
    """(name, point) of every stationary method."""
    named = []
    for closure, answer in study.closures.items():
        y, bars = _in_percent(deviation(closure))
        colour, _ = LINES.get(closure, OTHER_LINE)
        marker = CLOSURE_MARKERS.get(closure, OTHER_MARKER)
        x = np.array([answer["seconds"]])
        named.append((closure, Series(x, y, None, colour, "", marker, bars, size=7.0)))
    return named


def _biases(study, name, marks):
    """|bias| of a mean over run time, with the resolution of such a run."""
    series = []
    for row in study.rows:
        if name in row.bias and not is_reference(row.bias[name]):
            y, bars = _in_percent(row.bias[name])
            series.append(_points(row, marks, [study.run_seconds(row)], y, bars=bars))
    named = _closures(study, lambda closure: study.deviation(closure, name))
    series += [drawn for _, drawn in named]
    seconds = [drawn.x[0] for drawn in series] or [1.0]
    level = np.full(2, 100.0 * study.sampling_error(name))
    series.insert(0, Series(np.array([min(seconds), max(seconds)]), level, **SAMPLING))
    return _panel(series, _run_time(study), "|bias| [%]", f"bias of {SYMBOLS[name]}", named)


def _defaults(rows):
    """Row of each family at its default step, or at the first of its tolerances."""
    first: dict[str, Any] = {}
    for row in rows:
        if row.errors and row.method.refinement == 1:
            first.setdefault(row.method.family, row)
    return list(first.values())


def _total_errors(study, name, marks):
    """Total error over wall time: solid where the bias is resolved, marked at the limits."""
    rows = [row for row in _defaults(study.rows) if math.isfinite(row.errors[name].resolved_bias)]
    errors = [*(row.errors[name] for row in rows), study.errors[name]]
    times = [error.seconds_to(limit) for error in errors for limit in LIMITS]
    times += [answer["seconds"] for answer in study.closures.values()]
    times = [seconds for seconds in times if math.isfinite(seconds) and seconds > 0.0] or [1.0]
    seconds = np.geomspace(min(times), max(times), POINTS)

    def total_of(error):
        """Total error in percent; values below the smallest limit are cut off."""
        total = 100.0 * error.after(seconds)
        return np.where(total >= 100.0 * LIMITS[-1], total, np.nan)

    named = _closures(study, lambda closure: study.deviation(closure, name))
    series = [Series(seconds, total_of(study.errors[name]), **SAMPLING)]
    series += [drawn for _, drawn in named]
    for row in rows:
        error, colour = row.errors[name], marks[row.method.group][0]
        total = total_of(error)
        is_exact = error.bias.estimate == error.bias.standard_error == 0.0
        uncertainty = 0.0 if is_exact else 200.0 * (error.bias.standard_error or math.inf)
        for line, selected in (("-", total >= uncertainty), ("--", total < uncertainty)):
            series.append(Series(seconds, np.where(selected, total, np.nan), None, colour, line))
        read = [(error.seconds_to(limit), 100.0 * limit) for limit in LIMITS]
        read = [point for point in read if point[0] < math.inf]
        series.append(_points(row, marks, *np.reshape(read, (-1, 2)).T))
    title = f"√(bias² + sampling variance) of {SYMBOLS[name]}"
    return _panel(series, "wall time of one core [s]", "total error [%]", title, named)
