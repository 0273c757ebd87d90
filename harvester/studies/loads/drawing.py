"""Figures of a load study: power, efficiency, waveforms at the optimum."""

from __future__ import annotations

import math
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.formatting import prefixed
from harvester.device.record import Record
from harvester.results.panels import Panel, Series, draw_panels, is_wide, label_words, set_title
from harvester.scene.tables import key_words
from harvester.statistics.units import unit_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MARKERS = "osD^vP*X"
# Size of the ring around a point without an error bar.
RING = 9.0
# Half length of an error bar, in standard errors.
BARS = 2.0
# Efficiency in figure and table: the first for a load with an output, else the second.
EFFICIENCIES = ("end_to_end_efficiency", "power_conversion_efficiency_of_input")


def draw_power(study: Any) -> Figure:
    """Draw output power over the swept value, one curve per load, with the optimum's interval."""
    top = max((e.power for e in study.evaluations if math.isfinite(e.power)), default=1.0)
    factor, unit = prefixed(top, study.unit)

    def value(evaluation):
        estimate = evaluation.estimates.get("output_power")
        return estimate and estimate.times(factor)

    return _draw(study, f"output power [{unit}]", value, _draw_optima)


def draw_efficiency(study: Any) -> Figure:
    """Draw the sum of output and storage power relative to the mechanical input."""

    def value(evaluation):
        names = [n for n in EFFICIENCIES if n in evaluation.estimates]
        names += [n for n in evaluation.estimates if n.startswith("power_conv")]
        return evaluation.estimates[names[0]].times(100.0) if names else None

    return _draw(study, "(output + store)/input [%]", value, lambda *_: None)


def draw_waveforms(study: Any) -> Figure:
    """Draw displacement and piezo voltage at each load's highest point, on the same noise."""
    from matplotlib.figure import Figure

    def highest(other):
        points = [point for k in _loads(study) if (point := study.best((k, *other)))]
        return max((point.power for point in points), default=-math.inf)

    other = max((other for other, _ in study.others()), key=highest)
    best = [
        (load, study.best((k, *other)), colour)
        for (k, load), colour in zip(enumerate(study.grid.loads), _colours(), strict=False)
    ]
    best = [(load, e, c) for load, e, c in best if e is not None and e.waveform is not None]
    figure = Figure(figsize=(7.0, 1.0 + 1.3 * max(len(best), 1)))
    first = None
    for row, (load, evaluation, colour) in enumerate(best):
        axes = figure.add_subplot(len(best), 1, row + 1, sharex=first)
        first = first or axes
        _draw_waveform(axes, study, load, evaluation, colour)
        axes.tick_params(labelbottom=row == len(best) - 1)
    if best:
        axes.set_xlabel("time [s]")
    words = dict(study.others())[other]
    title = "piezo voltage (colour) and displacement (grey) where each load is best"
    title = f"{study.scene.name}: {title}{', ' * bool(words)}{words}"
    set_title(figure, title)
    return figure


def _loads(study):
    return range(len(study.grid.loads))


def _colours():
    from matplotlib import rcParams

    return cycle(rcParams["axes.prop_cycle"].by_key()["color"])


def _draw(study, label, value, draw_extra):
    """Draw a panel for each point of the other sweeps, with a curve for each load."""
    key, _ = study.curve_keys
    positions = np.array(study.grid.sweeps[key] if key else (0.0,))
    x_label, x_unit = key_words(key, study.scene.units) if key else ("", None)
    panels = []
    for other, words in study.others():
        curves = _curves(study, other, positions, value)
        panels.append(
            Panel(
                x_label=x_label,
                y_label=label,
                series=curves,
                title=words,
                log_x=is_wide(positions),
                from_zero=True,
                more=partial(_finish, study, other, draw_extra, curves),
                x_unit=x_unit,
            )
        )
    return draw_panels(
        panels,
        f"{study.scene.name}: {' and '.join(dict.fromkeys(study.methods))}, "
        "bars: two standard errors",
        sharey=True,
    )


def _finish(study, other, draw_extra, curves, axes):
    """Label the loads if nothing is swept, ring points without an error bar, and draw more."""
    for curve in curves:
        bare = np.isnan(curve.bars)
        if bare.any():
            x, y = np.array(curve.x)[bare], np.array(curve.y)[bare]
            axes.plot(x, y, "o", color=curve.colour, mfc="none", ms=RING)
            axes.plot([], [], "o", color="0.3", mfc="none", ms=RING, label="ring: no error bar")
    if study.curve_keys[0] is None:
        label_words(axes, study.grid.loads)
    if any(evaluation.unranked for evaluation in study.evaluations):
        # Hollow points mean the same in every figure; the legend explains them.
        axes.plot([], [], "o", color="0.3", mfc="w", label="hollow: not ranked, see the table")
    draw_extra(study, other, axes)


def _curves(study, other, positions, value):
    series = []
    order = np.argsort(positions)
    for k, colour, marker in zip(_loads(study), _colours(), cycle(MARKERS), strict=False):
        row = [study.curves[(k, *other)][index] for index in order]
        means = [
            (index, mean, evaluation.unranked)
            for index, evaluation in zip(order, row, strict=True)
            if (mean := value(evaluation))
        ]
        if not means:
            continue
        errors = [mean.standard_error for _, mean, _ in means]
        series.append(
            Series(
                x=[positions[index] if study.curve_keys[0] else k for index, _, _ in means],
                y=[mean.estimate for _, mean, _ in means],
                label=study.grid.loads[k],
                colour=colour,
                marker=marker,
                bars=[math.nan if error is None else BARS * error for error in errors],
                hollow=[bool(unranked) for _, _, unranked in means],
            )
        )
    return series


def _draw_optima(study, other, axes):
    """Draw each optimum's interval as a bar near the axis, in the load's colour."""
    for k, colour in zip(_loads(study), _colours(), strict=False):
        optimum, _ = study.optima[(k, *other)]
        if math.isfinite(optimum.low):
            height = 0.02 + 0.025 * k
            where = axes.get_xaxis_transform()
            ends = [optimum.low, optimum.high]
            axes.plot(ends, [height] * 2, color=colour, linewidth=2.0, transform=where)
            axes.plot([optimum.place], [height], "|", color=colour, transform=where)
            # One entry of the legend explains all bars.
            axes.plot([], [], "-|", color="0.3", lw=2.0, label="bar at the bottom: optimum, 95 %")


def _draw_waveform(axes, study, load, evaluation, colour):
    time, voltage, displacement = (
        evaluation.waveform[Record._fields.index(name)]
        for name in ("time", "voltage", "displacement")
    )
    in_metres = study.scene.units == "SI"
    axes.plot(time, voltage, color=colour)
    axes.set_ylabel(f"voltage [{unit_of(study.scene, 'voltage')}]" if in_metres else "voltage")
    axes.set_title(load)
    beside = axes.twinx()
    beside.plot(time, 1e3 * displacement if in_metres else displacement, color="0.6", linewidth=0.8)
    beside.spines.right.set_visible(True)
    beside.set_ylabel("X [mm]" if in_metres else "X", color="0.5")


# Figures by their names, the main one first.
FIGURES = {"power": draw_power, "efficiency": draw_efficiency, "waveforms": draw_waveforms}
