"""Figures, drawn with matplotlib when asked for."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.files.writing import whole_file
from harvester.show.figure_settings import figure_settings
from harvester.show.palette import CIRCUIT, LINES, MONTE_CARLO

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from harvester.results.result import Result
    from harvester.studies.comparison import Comparison

STYLE = Path(__file__).parent / "house.mplstyle"
# Share of its peak down to which a density is drawn.
WORTH_DRAWING = 1e-3
# Intervals between ticks on a density's axis: the labels of an SI scene are long.
MOST_TICKS = 5


def save(draw: Callable, result: Any, path: str | Path) -> None:
    """Draw a result into a file, whole; the suffix chooses the format.

    Parameters
    ----------
    draw : callable
        `draw_result`, `draw_comparison` or another function of a result.
    result : Result, Comparison or what else `draw` takes
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


def draw_result(result: Result) -> Figure | None:
    """Densities of displacement, velocity and voltage of one result; the fit to a record."""
    from matplotlib.figure import Figure

    fitted = result.spectrum_fit is not None and result.spectrum_fit.frequency.size > 0
    panels = len(result.densities) + fitted
    if not panels:
        return None
    figure = Figure(figsize=(3.0 * panels, 2.6))
    for place, name in enumerate(result.densities):
        axes = figure.add_subplot(1, panels, place + 1)
        draw_density(axes, result, name, CIRCUIT, "-", None)
        axes.set_xlabel(axis_label(result, name))
        axes.set_ylabel("probability density" if place == 0 else "")
        axes.set_ylim(bottom=0.0)
        frame(axes, [result], name)
    if fitted:
        _draw_fit(figure.add_subplot(1, panels, panels), result)
    figure.suptitle(f"{result.scene.name}: {result.engine}", x=0.01, ha="left", fontsize=9)
    return figure


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
    axes.legend(fontsize=6)


def draw_comparison(comparison: Comparison) -> Figure:
    """Densities by every engine and closure; waveforms on one path; their difference."""
    from matplotlib.figure import Figure

    names = list(comparison.monte_carlo.densities)
    figure = Figure(figsize=(9.0, 6.4))
    rows = figure.add_gridspec(2, 1, height_ratios=(1.3, 1.0))
    across = rows[0].subgridspec(1, len(names))
    panels = [figure.add_subplot(across[place]) for place in range(len(names))]
    for panel, name in zip(panels, names, strict=True):
        _draw_densities(panel, comparison, name)
    panels[0].set_ylabel("probability density")
    below = rows[1].subgridspec(2, 1, height_ratios=(1.6, 1.0))
    top = figure.add_subplot(below[0])
    _draw_waveforms(top, figure.add_subplot(below[1], sharex=top), comparison)
    compared = "circuit, Monte Carlo and averaging" if comparison.closures else "both engines"
    figure.suptitle(
        f"{comparison.scene.name}: {compared} (bands: two standard errors)",
        x=0.01,
        ha="left",
        fontsize=9,
    )
    # A closure may have fewer densities than another.
    handles: dict[str, Any] = {}
    for panel in panels:
        found, labels = panel.get_legend_handles_labels()
        handles |= dict(zip(labels, found, strict=True))
    figure.legend([*handles.values()], [*handles], loc="outside lower center", ncols=5)
    return figure


def _draw_densities(axes, comparison, name):
    draw_density(axes, comparison.monte_carlo, name, MONTE_CARLO, "-", "Monte Carlo")
    draw_density(axes, comparison.circuit, name, CIRCUIT, "--", "circuit")
    # Above the simulations, which are broad where they are noisy.
    for closure, result in comparison.closures.items():
        colour, style = LINES[closure]
        if name in result.densities:
            draw_density(axes, result, name, colour, style, f"averaging, {closure}")
    simulated = comparison.monte_carlo.densities[name]
    frame(axes, [comparison.circuit, comparison.monte_carlo], name)
    peak = simulated.density.max() / comparison.monte_carlo.scales.of(name)
    # A closure that is far off must not flatten the others.
    axes.set_ylim(0.0, min(axes.get_ylim()[1], 2.5 * peak))
    axes.set_xlabel(axis_label(comparison.circuit, name))


def _draw_waveforms(top, bottom, comparison):
    circuit, reference = comparison.circuit.waveform, comparison.monte_carlo.waveform
    unit = comparison.circuit.scales.displacement
    top.plot(reference.time, reference.displacement * unit, color=MONTE_CARLO)
    top.plot(circuit.time, circuit.displacement * unit, "--", color=CIRCUIT)
    top.set_ylabel(axis_label(comparison.circuit, "displacement"))
    top.set_title("the same noise path")
    # Both have every knot of the noise among their points.
    difference = np.interp(reference.time, circuit.time, circuit.displacement)
    knots = np.isin(np.round(reference.time, 9), np.round(circuit.time, 9))
    difference = (difference - reference.displacement)[knots] * unit
    bottom.plot(reference.time[knots], difference, color="0.2", linewidth=0.8)
    bottom.set_ylabel("difference")
    bottom.set_title("circuit − Monte Carlo")
    bottom.set_xlabel("time [s]")


def draw_density(
    axes: Axes, result: Result, name: str, colour: str, style: str, label: str | None
) -> None:
    """One density in the scene's units, with a band of two standard errors."""
    density = result.densities[name]
    unit = result.scales.of(density.dimension)
    centre, values = density.centre * unit, density.density / unit
    if density.standard_error is not None:
        band = 2.0 * density.standard_error / unit
        axes.fill_between(centre, values - band, values + band, color=colour, alpha=0.25, lw=0)
    axes.plot(centre, values, style, color=colour, label=label)


def frame(axes: Axes, results: Sequence[Result], name: str) -> None:
    """Limit the axis to where the densities are worth drawing."""
    ends = []
    for result in results:
        density = result.densities[name]
        drawn = density.centre[density.density > WORTH_DRAWING * density.density.max()]
        ends += list(drawn[[0, -1]] * result.scales.of(density.dimension))
    margin = 0.05 * (max(ends) - min(ends))
    axes.set_xlim(min(ends) - margin, max(ends) + margin)
    axes.locator_params(axis="x", nbins=MOST_TICKS)


def axis_label(result: Result, name: str) -> str:
    """A dimension and its unit."""
    unit = result.unit(name)
    return f"{name} [{'scaled' if unit.startswith('scaled') else unit}]"


def __getattr__(name: str) -> Any:
    if name == "draw_work_precision":
        from harvester.show import accuracy_figure

        new = f"{accuracy_figure.__name__}.{name}"
        warnings.warn(f"{__name__}.{name} is now {new}", DeprecationWarning, stacklevel=2)
        return accuracy_figure.draw_work_precision
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
