"""The figure of a result: its densities, and the fit to a record."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.arguments import check_known
from harvester.results.palette import CIRCUIT
from harvester.results.panels import Panel, Series, draw_panels, draw_series
from harvester.statistics.estimate import Density

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Densities are drawn where they exceed this share of their peak.
WORTH_DRAWING = 1e-3
# Maximum number of tick intervals on a density's axis, since labels of SI scenes are long.
MOST_TICKS = 5
# Bins per axis of the density in a section.
SECTION_BINS = 60
# Minimum number of bins of a density even with few effective samples, so that its shape is visible.
FEWEST_BINS = 40


def draw_result(result: Any) -> Figure | None:
    """Draw the densities of a `harvester.results.result.Result` and the fit to a record."""
    panels = [
        Panel(
            axis_label(result, name),
            density_label(result, name),
            [density_series(result, name, colour=CIRCUIT)],
            from_zero=True,
            more=partial(frame, results=[result], name=name),
        )
        for name in result.densities
    ]
    if result.spectrum_fit is not None and result.spectrum_fit.frequency.size:
        panels.append(_fit_panel(result))
    if result.stroboscope is not None and result.stroboscope.shape[1]:
        x_label, y_label = (axis_label(result, name) for name in ("displacement", "velocity"))
        draw = partial(_draw_section, result)
        panels.append(Panel(x_label, y_label, (), "stroboscopic section", more=draw))
    title = f"{result.scene.name}: {result.engine}"
    return draw_panels(panels, title, (3.0, 2.6), columns=len(panels)) if panels else None


def _draw_section(result, axes):
    """Draw the stroboscopic section: points coloured by orbit, or under noise a density."""
    x, v = result.section().reshape(-1, 2).T
    if result.scene.excitation.random:
        axes.hist2d(x, v, bins=SECTION_BINS, density=True, cmin=1e-300, cmap="viridis")
    elif result.attractors:
        for orbit in result.attractors:
            label = f"{orbit.name}: {orbit.share:.1%}"
            axes.plot(*orbit.points.T, "o" if orbit.period else ".", markersize=3.0, label=label)
    else:
        axes.plot(x, v, ".", color=CIRCUIT, markersize=2.0)
    axes.locator_params(axis="x", nbins=MOST_TICKS)


def _fit_panel(result):
    """The record's spectral density, the noise fitted to it, and the device's frequency."""
    fit = result.spectrum_fit
    label = f"fit: D = {fit.intensity:.3g}, τ1 = {fit.correlation_time:.3g} s"
    return Panel(
        "frequency [Hz]",
        f"density [{'(m/s²)²/Hz' if result.scene.units == 'SI' else 'scaled'}]",
        [
            Series(fit.frequency, fit.density, "record", "0.6", width=0.8),
            Series(fit.frequency, fit.fitted, label, CIRCUIT),
        ],
        log_x=True,
        log_y=True,
        more=partial(mark_frequency, frequency=fit.device_frequency, label="device"),
    )


def mark_frequency(axes: Axes, frequency: float, label: str) -> None:
    """Draw a dotted vertical line at a frequency of the device."""
    axes.axvline(frequency, color="0.3", linestyle=":", linewidth=0.9, label=label)


def density_series(result: Any, name: str, **style: Any) -> Series:
    """One density in the scene's units, with a band of two standard errors; see `Series`."""
    density = _merged(result, name)
    unit = result.scales.of(density.dimension)
    error = density.standard_error
    band = None if error is None else 2.0 * error / unit
    return Series(density.centre * unit, density.density / unit, band=band, **style)


def draw_density(axes: Axes, result: Any, name: str, label: str | None, **style: Any) -> None:
    """Draw one density into axes; see `density_series`."""
    check_known("draw_density", style, ("colour", "line", "width", "marker", "size"))
    draw_series(axes, density_series(result, name, label=label, **style))


def _merged(result, name):
    """A density with fewer bins: 2 n^⅓ for n effective samples (Rice), or `FEWEST_BINS`."""
    density = result.densities[name]
    about = result.scaled_quantities.get(f"mean_square_{name}")
    samples = about.effective_sample_size if about else None
    random = result.scene.excitation.random
    if random and (density.standard_error is None or not samples):
        return density
    held = int(np.count_nonzero(density.density > WORTH_DRAWING * density.density.max()))
    # A periodic motion has samples at few positions, so that narrow bins would show gaps.
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
    """Limit the axis to the range in which the densities are visible."""
    ends = []
    for result in results:
        density = result.densities[name]
        drawn = density.centre[density.density > WORTH_DRAWING * density.density.max()]
        ends += list(drawn[[0, -1]] * result.scales.of(density.dimension))
    margin = 0.05 * (max(ends) - min(ends))
    axes.set_xlim(min(ends) - margin, max(ends) + margin)
    axes.locator_params(axis="x", nbins=MOST_TICKS)


def axis_label(result: Any, name: str) -> str:
    """Label of an axis: a dimension and its unit."""
    unit = result.unit(name)
    return f"{name} [{'scaled' if unit.startswith('scaled') else unit}]"


def density_label(result: Any, name: str) -> str:
    """Label of a density's axis, such as "probability density [1/m]"."""
    unit = result.unit(name)
    inverse = f"1/{f'({unit})' if '/' in unit else unit}"
    return f"probability density [{'scaled' if unit.startswith('scaled') else inverse}]"
