"""Figures of a load study: power, efficiency, waveforms at the optimum."""

from __future__ import annotations

import math
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from harvester.estimates.units import unit_of
from harvester.record.record import Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from harvester.studies.outcome import Report

MARKERS = "osD^vP*X"
# Panels in one row, and cycles of small oscillations in a waveform.
COLUMNS = 3
# Standard errors that a bar spans to either side.
BARS = 2.0
PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p"))
# Axis labels of swept keys.
LABELS = {
    "load.parameters.resistance": "load resistance [Ω]",
    "load.resistance": "load resistance [Ω]",
    "excitation.intensity": "noise intensity D",
}
EFFICIENCIES = ("end_to_end_efficiency", "power_conversion_efficiency_of_input")


def draw_power(report: Report) -> Figure:
    """Output power over the swept value, one curve a load; its optimum's interval below."""
    top = max((e.power for e in report.study.evaluations if math.isfinite(e.power)), default=1.0)
    factor, prefix = _prefix(top) if report.scene.units == "SI" else (1.0, "")
    unit = f"{prefix}W" if report.scene.units == "SI" else "scaled"

    def value(evaluation):
        estimate = evaluation.estimates.get("output_power")
        return estimate and (estimate.estimate / factor, estimate.standard_error)

    figure, panels = _panels(report, f"output power [{unit}]", value, factor)
    for axes, other in panels:
        _draw_optima(axes, report, other)
    return figure


def draw_efficiency(report: Report) -> Figure:
    """Harvested power over the mechanical input."""

    def value(evaluation):
        found = [evaluation.estimates[n] for n in EFFICIENCIES if n in evaluation.estimates]
        if not found:
            found = [e for n, e in evaluation.estimates.items() if n.startswith("power_conv")]
        return (100.0 * found[0].estimate, found[0].standard_error) if found else None

    return _panels(report, "power harvested of that put in [%]", value, 0.01)[0]


def draw_waveforms(report: Report) -> Figure:
    """Displacement and piezo voltage at each load's highest point, all on the same noise."""
    from matplotlib.figure import Figure

    other = max(
        (other for other, _ in report.others()),
        key=lambda o: max((report.best((k, *o)) or _Nothing).power for k in _loads(report)),
    )
    shown = [
        (load, report.best((k, *other)), colour)
        for (k, load), colour in zip(enumerate(report.study.grid.loads), _colours(), strict=False)
    ]
    shown = [(load, e, c) for load, e, c in shown if e is not None and e.waveform is not None]
    figure = Figure(figsize=(7.0, 1.0 + 1.3 * max(len(shown), 1)))
    first = None
    for place, (load, evaluation, colour) in enumerate(shown):
        axes = figure.add_subplot(len(shown), 1, place + 1, sharex=first)
        first = first or axes
        _draw_waveform(axes, report, load, evaluation, colour)
        axes.tick_params(labelbottom=place == len(shown) - 1)
    if shown:
        axes.set_xlabel("time [s]")
    words = dict(report.others())[other]
    title = "piezo voltage (colour) and displacement (grey) where each load is best"
    title = f"{report.scene.name}: {title}{', ' * bool(words)}{words}"
    figure.suptitle(title, x=0.01, ha="left", fontsize=9)
    return figure


class _Nothing:
    """Stands for a curve without a point."""

    power = -math.inf


def _loads(report):
    return range(len(report.study.grid.loads))


def _colours():
    from matplotlib import rcParams

    return cycle(rcParams["axes.prop_cycle"].by_key()["color"])


def _prefix(value):
    """Factor and letter with which a power is written as 1 … 1000."""
    for factor, letter in PREFIXES:
        if value >= factor:
            return factor, letter
    return PREFIXES[-1]


def _panels(report, label, value, factor):
    """A panel for each place of the other sweeps; (figure, [(axes, place)])."""
    from matplotlib.figure import Figure

    others = list(report.others())
    columns = min(len(others), COLUMNS)
    rows = -(-len(others) // columns)
    figure = Figure(figsize=(max(1.2 + 3.2 * columns, 5.0), 0.6 + 3.0 * rows))
    panels = []
    for place, (other, words) in enumerate(others):
        axes = figure.add_subplot(rows, columns, place + 1)
        _draw_curves(axes, report, other, value, factor)
        axes.set_title(words)
        axes.set_ylabel(label if place % columns == 0 else "")
        panels.append((axes, other))
    handles, names = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=min(len(names), 5))
    figure.suptitle(
        f"{report.scene.name}: {report.study.method}, bars: 2 standard errors (hollow: none)",
        x=0.01,
        ha="left",
        fontsize=9,
    )
    return figure, panels


def _draw_curves(axes, report, other, value, factor):
    key, _ = report.curve_keys
    places = np.array(report.study.grid.sweeps[key]) if key else None
    for k, colour, marker in zip(_loads(report), _colours(), cycle(MARKERS), strict=False):
        row = report.curves[(k, *other)]
        shown = [(place, value(e)) for place, e in enumerate(row) if value(e)]
        if not shown:
            continue
        x = [places[place] if key else k for place, _ in shown]
        y = [estimate for _, (estimate, _) in shown]
        bars = [0.0 if error is None else BARS * error / factor for _, (_, error) in shown]
        order = np.argsort(x)
        axes.errorbar(
            np.array(x)[order],
            np.array(y)[order],
            np.array(bars)[order],
            color=colour,
            marker=marker,
            markersize=4,
            capsize=2,
            linewidth=1.0,
            label=report.study.grid.loads[k],
        )
        bare = [place for place, (_, (_, error)) in enumerate(shown) if error is None]
        if bare:
            at, height = np.array(x)[bare], np.array(y)[bare]
            axes.plot(at, height, marker, color=colour, markersize=4, markerfacecolor="white")
    axes.set_ylim(bottom=0.0)
    if key is None:
        axes.set_xticks(list(_loads(report)), report.study.grid.loads)
        return
    if places.min() > 0.0 and places.max() > 10.0 * places.min():
        axes.set_xscale("log")
    axes.set_xlabel(LABELS.get(key, key))


def _draw_optima(axes, report, other):
    """Each optimum's interval as a bar near the axis, in the load's colour."""
    for k, colour in zip(_loads(report), _colours(), strict=False):
        optimum, _ = report.optima[(k, *other)]
        if math.isfinite(optimum.low):
            height = 0.02 + 0.025 * k
            where = axes.get_xaxis_transform()
            ends = [optimum.low, optimum.high]
            axes.plot(ends, [height] * 2, color=colour, linewidth=2.0, transform=where)
            axes.plot([optimum.place], [height], "|", color=colour, transform=where)


def _draw_waveform(axes, report, load, evaluation, colour):
    time, voltage, displacement = (
        evaluation.waveform[Record._fields.index(name)]
        for name in ("time", "voltage", "displacement")
    )
    in_metres = report.scene.units == "SI"
    axes.plot(time, voltage, color=colour)
    axes.set_ylabel(f"voltage [{unit_of(report.scene, 'voltage')}]" if in_metres else "voltage")
    axes.set_title(load)
    beside = axes.twinx()
    beside.plot(time, 1e3 * displacement if in_metres else displacement, color="0.6", linewidth=0.8)
    beside.spines.right.set_visible(True)
    beside.set_ylabel("X [mm]" if in_metres else "X", color="0.5")
