"""Figures of a tolerance study: the tornado with the indices, and the distribution."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.show.numbers import prefixed
from harvester.show.palette import CIRCUIT, MONTE_CARLO
from harvester.show.panels import entitle, legend_below
from harvester.show.symbols import key_words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = CIRCUIT, MONTE_CARLO
BINS = 30


def draw_tornado(study: Any) -> Figure:
    """A figure of each parameter's effect on the quantity, with its Sobol indices."""
    from matplotlib.figure import Figure

    order = study.order()[::-1]
    names = [key_words(study.tolerances[k].key, study.scene.units)[0] for k in order]
    figure = Figure(figsize=(8.0, 1.5 + 0.5 * len(names)))
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(1.3, 1.0))
    _draw_effects(left, study, order)
    left.set_yticks(range(len(names)), names)
    left.set_ylim(-0.7, len(names) - 0.3)
    _draw_indices(right, study, order)
    legend_below(figure, [left, right])
    entitle(
        figure,
        f"{study.scene.name}: {study.quantity.replace('_', ' ')} by {study.method}, bars: 95 % "
        "intervals",
    )
    return figure


def _draw_effects(axes, study, order):
    # If the mean is 0, all changes are 0 too.
    mean = abs(study.population.mean.estimate) or 1.0
    for end, (colour, label) in enumerate(
        zip(COLOURS, ("low: 5 % of devices are below", "high: 95 % are below"), strict=True)
    ):
        effects = [study.effects[k][end] for k in order]
        widths = 100.0 * np.array([effect.estimate for effect in effects]) / mean
        ends = 100.0 * np.array([[effect.low, effect.high] for effect in effects]).T / mean
        # The two bars stand one above the other, since both may point the same way.
        heights = np.arange(len(order)) + (0.14, -0.14)[end]
        axes.barh(heights, widths, height=0.26, color=colour, label=label)
        axes.errorbar(widths, heights, xerr=_bars(widths, ends), fmt="none", color="0.2", capsize=2)
    axes.axvline(0.0, color="0.2", linewidth=0.8)
    axes.set_xlabel("change of the mean where a parameter is low or high [%]")


def _draw_indices(axes, study, order):
    axes.set_xlim(0.0, 1.0)
    axes.set_xlabel("share of the variance")
    if study.indices.first is None:
        axes.text(0.5, 0.5, "hidden by noise", transform=axes.transAxes, ha="center")
        return
    pairs = (
        ("first-order", study.indices.first, "o", 0.12),
        ("total", study.indices.total, "s", -0.12),
    )
    for name, intervals, marker, height in pairs:
        values = np.array([intervals[k].estimate for k in order])
        ends = np.array([[intervals[k].low, intervals[k].high] for k in order]).T
        axes.errorbar(
            values,
            np.arange(len(order)) + height,
            xerr=_bars(values, ends),
            fmt=marker,
            markersize=4,
            capsize=2,
            color="0.1" if name == "total" else "0.55",
            label=f"{name} Sobol index",
        )
    axes.set_xlim(min(0.0, axes.dataLim.x0) - 0.02, max(1.0, axes.dataLim.x1) + 0.02)


def _bars(values, ends):
    """Lengths of error bars; 0 on a side where a resampled interval does not reach its estimate."""
    low, high = np.minimum(*ends), np.maximum(*ends)
    return np.maximum([values - low, high - values], 0.0)


def draw_distribution(study: Any) -> Figure:
    """The quantity among devices, its quantiles, the scene's own value and the limit."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.0, 3.2))
    axes = figure.add_subplot()
    values = study.population.values
    hidden = study.indices.first is None
    factor, unit = prefixed(float(np.abs(values).max()), study.unit.split()[0])
    if hidden:
        # If the variance without noise is not above 0, the histogram shows the measured values,
        # noise included.
        values = study.values.mean(axis=0)[:, :2].ravel()
    values = factor * values
    axes.hist(values, bins=min(BINS, max(5, values.size // 6)), density=True, color="0.8")
    for share, quantile in () if hidden else study.population.quantiles.items():
        centre, ends = factor * quantile.estimate, (factor * quantile.low, factor * quantile.high)
        axes.axvline(centre, color=COLOURS[0], linewidth=1.0)
        axes.axvspan(*ends, color=COLOURS[0], alpha=0.15, linewidth=0)
        axes.text(
            centre, 1.0, f"{share:.0%}", transform=axes.get_xaxis_transform(),
            fontsize=7, ha="center", va="bottom", color=COLOURS[0],
        )  # fmt: skip
    axes.axvline(
        factor * study.nominal.estimate, color="0.1", linestyle=":", label="the scene itself"
    )
    if study.yield_above is not None:
        share = study.yield_above.share
        axes.axvline(
            factor * study.yield_above.limit,
            color=COLOURS[1],
            linestyle="--",
            label=f"limit: {share.estimate:.1%} above ({share.low:.1%} … {share.high:.1%})",
        )
    axes.set_xlabel(f"{study.quantity.replace('_', ' ')} [{unit}]")
    axes.set_ylabel("probability density")
    legend_below(figure, [axes])
    entitle(
        figure,
        f"{study.scene.name}: {study.devices} devices by {study.method}, "
        + ("as measured, noise and all" if hidden else "the noise's part of the spread taken out"),
    )
    return figure
