"""The figure of a result: its densities, and the fit to a record."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.results.palette import CIRCUIT
from harvester.results.panels import set_title
from harvester.statistics.estimate import Density

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Densities are drawn down to this share of their peak.
WORTH_DRAWING = 1e-3
# Most intervals between ticks on a density's axis, since labels of SI scenes are long.
MOST_TICKS = 5
# Bins per axis of the density in a section.
SECTION_BINS = 60
# Fewest bins of a density, however few its effective samples: its shape remains visible.
FEWEST_BINS = 40


def draw_result(result: Any) -> Figure | None:
    """Draw the densities of a `harvester.results.result.Result` and the fit to a record."""
    from matplotlib.figure import Figure

    fitted = result.spectrum_fit is not None and result.spectrum_fit.frequency.size > 0
    strobed = result.stroboscope is not None and result.stroboscope.shape[1] > 0
    panels = len(result.densities) + fitted + strobed
    if not panels:
        return None
    figure = Figure(figsize=(3.0 * panels, 2.6))
    for column, name in enumerate(result.densities):
        axes = figure.add_subplot(1, panels, column + 1)
        draw_density(axes, result, name, CIRCUIT, "-", None)
        axes.set_xlabel(axis_label(result, name))
        axes.set_ylabel(density_label(result, name))
        axes.set_ylim(bottom=0.0)
        frame(axes, [result], name)
    if fitted:
        _draw_fit(figure.add_subplot(1, panels, panels - strobed), result)
    if strobed:
        _draw_section(figure.add_subplot(1, panels, panels), result)
    set_title(figure, f"{result.scene.name}: {result.engine}")
    return figure


def _draw_section(axes, result):
    """Draw the stroboscopic section: points in a colour for each orbit; under noise a density."""
    x, v = result.section().reshape(-1, 2).T
    if result.scene.excitation.random:
        axes.hist2d(x, v, bins=SECTION_BINS, density=True, cmin=1e-300, cmap="viridis")
    elif result.attractors:
        for orbit in result.attractors:
            label = f"{orbit.name}: {orbit.share:.1%}"
            axes.plot(*orbit.points.T, "o" if orbit.period else ".", markersize=3.0, label=label)
        axes.legend(fontsize=6)
    else:
        axes.plot(x, v, ".", color=CIRCUIT, markersize=2.0)
    axes.set_xlabel(axis_label(result, "displacement"))
    axes.set_ylabel(axis_label(result, "velocity"))
    axes.set_title("stroboscopic section", fontsize=8)
    axes.locator_params(axis="x", nbins=MOST_TICKS)


def _draw_fit(axes, result):
    """The record's spectral density, the noise fitted to it, and the device's frequency."""
    fit = result.spectrum_fit
    axes.loglog(fit.frequency, fit.density, color="0.6", linewidth=0.8, label="record")
    label = f"fit: D = {fit.intensity:.3g}, τ1 = {fit.correlation_time:.3g} s"
    axes.loglog(fit.frequency, fit.fitted, color=CIRCUIT, label=label)
    axes.axvline(fit.device_frequency, color="0.3", linestyle=":", linewidth=0.9, label="device")
    axes.set_xlabel("frequency [Hz]")
    unit = "(m/s²)²/Hz" if result.scene.units == "SI" else "scaled"
    axes.set_ylabel(f"density [{unit}]")
    # The legend stands above the axes, since a spectrum fills them.
    axes.legend(fontsize=6, loc="lower left", bbox_to_anchor=(0.0, 1.0))


def draw_density(
    axes: Axes,
    result: Any,
    name: str,
    colour: str,
    style: str,
    label: str | None,
    width: float | None = None,
) -> None:
    """One density in the scene's units, with a band of two standard errors."""
    density = _merged(result, name)
    unit = result.scales.of(density.dimension)
    centre, values = density.centre * unit, density.density / unit
    if density.standard_error is not None:
        band = 2.0 * density.standard_error / unit
        axes.fill_between(centre, values - band, values + band, color=colour, alpha=0.25, lw=0)
    axes.plot(centre, values, style, color=colour, label=label, linewidth=width)


def _merged(result, name):
    """A density of so few bins as its effective samples fill: Rice's 2 n^⅓ of them, or more."""
    density = result.densities[name]
    about = result.scaled_quantities.get(f"mean_square_{name}")
    samples = about.effective_sample_size if about else None
    random = result.scene.excitation.random
    if random and (density.standard_error is None or not samples):
        return density
    held = int(np.count_nonzero(density.density > WORTH_DRAWING * density.density.max()))
    # A periodic motion is sampled at the same few places again and again: narrow bins would show
    # only gaps.
    size = held // max(FEWEST_BINS, math.ceil(2.0 * (samples or 0.0) ** (1.0 / 3.0)))
    if size < 2:
        return density
    bins = density.centre.size // size

    def means(values):
        return values[: bins * size].reshape(bins, size).mean(axis=1)

    # Neighbouring bins have correlated errors, so that the mean of their errors is an upper bound.
    error = None if density.standard_error is None else means(density.standard_error)
    return Density(means(density.centre), means(density.density), error, density.dimension)


def frame(axes: Axes, results: Sequence[Any], name: str) -> None:
    """Limit the axis to where the densities are worth drawing."""
    ends = []
    for result in results:
        density = result.densities[name]
        drawn = density.centre[density.density > WORTH_DRAWING * density.density.max()]
        ends += list(drawn[[0, -1]] * result.scales.of(density.dimension))
    margin = 0.05 * (max(ends) - min(ends))
    axes.set_xlim(min(ends) - margin, max(ends) + margin)
    axes.locator_params(axis="x", nbins=MOST_TICKS)


def axis_label(result: Any, name: str) -> str:
    """A dimension and its unit."""
    unit = result.unit(name)
    return f"{name} [{'scaled' if unit.startswith('scaled') else unit}]"


def density_label(result: Any, name: str) -> str:
    """ "probability density [1/m]" of a dimension."""
    unit = result.unit(name)
    if unit.startswith("scaled"):
        return "probability density [scaled]"
    return f"probability density [1/{f'({unit})' if '/' in unit else unit}]"
