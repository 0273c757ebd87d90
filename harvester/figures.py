"""Figures, drawn with matplotlib when asked for."""

from pathlib import Path

import numpy as np

from harvester.output import whole_file

STYLE = Path(__file__).parent / "house.mplstyle"
LINES = {"paper": ("0.55", "--"), "consistent": ("#009E73", "-")}
# Share of its peak down to which a density is drawn.
WORTH_DRAWING = 1e-3
CIRCUIT, MONTE_CARLO = "#0072B2", "#D55E00"


def save(draw, result, path):
    """Draw a result into a file, whole; the suffix chooses the format.

    Parameters
    ----------
    draw : callable
        `draw_result` or `draw_comparison`.
    result : Result or Comparison
    path : Path

    Raises
    ------
    OutputError
    """
    from matplotlib import style
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with style.context(STYLE), whole_file(path) as temporary:
        figure = draw(result)
        FigureCanvasAgg(figure)
        figure.savefig(temporary)


def draw_result(result):
    """Densities of displacement, velocity and voltage of one result."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.0 * len(result.densities), 2.6))
    for place, name in enumerate(result.densities):
        axes = figure.add_subplot(1, len(result.densities), place + 1)
        _density(axes, result, name, CIRCUIT, "-", None)
        axes.set_xlabel(_axis(result, name))
        axes.set_ylabel("probability density" if place == 0 else "")
        axes.set_ylim(bottom=0.0)
        axes.set_xlim(-_reach(result, name), _reach(result, name))
    figure.suptitle(f"{result.scene.name}: {result.engine}", x=0.01, ha="left", fontsize=9)
    return figure


def draw_comparison(comparison):
    """Density of X by every engine and closure; waveforms on one path; their difference."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.6))
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.4), height_ratios=(1.6, 1.0))
    left = figure.add_subplot(grid[:, 0])
    _draw_densities(left, comparison)
    top = figure.add_subplot(grid[0, 1])
    _draw_waveforms(top, figure.add_subplot(grid[1, 1], sharex=top), comparison)
    figure.suptitle(
        f"{comparison.scene.name}: circuit, Monte Carlo and averaging (bands: two standard errors)",
        x=0.01,
        ha="left",
        fontsize=9,
    )
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _draw_densities(axes, comparison):
    for name, result in comparison.closures.items():
        colour, style = LINES[name]
        _density(axes, result, "displacement", colour, style, f"averaging, {name}")
    _density(axes, comparison.monte_carlo, "displacement", MONTE_CARLO, "-", "Monte Carlo")
    _density(axes, comparison.circuit, "displacement", CIRCUIT, "--", "circuit")
    simulated = comparison.monte_carlo.densities["displacement"]
    reach = max(_reach(engine, "displacement") for engine in _simulations(comparison))
    axes.set_xlim(-reach, reach)
    peak = simulated.density.max() / comparison.monte_carlo.scales.displacement
    # A closure that is far off must not flatten the others.
    axes.set_ylim(0.0, min(axes.get_ylim()[1], 2.5 * peak))
    axes.set_xlabel(_axis(comparison.circuit, "displacement"))
    axes.set_ylabel("probability density")


def _draw_waveforms(top, bottom, comparison):
    circuit, reference = comparison.circuit.waveform, comparison.monte_carlo.waveform
    unit = comparison.circuit.scales.displacement
    top.plot(reference.time, reference.displacement * unit, color=MONTE_CARLO)
    top.plot(circuit.time, circuit.displacement * unit, "--", color=CIRCUIT)
    top.set_ylabel(_axis(comparison.circuit, "displacement"))
    top.set_title("the same noise path")
    # Both have every knot of the noise among their points.
    difference = np.interp(reference.time, circuit.time, circuit.displacement)
    knots = np.isin(np.round(reference.time, 9), np.round(circuit.time, 9))
    difference = (difference - reference.displacement)[knots] * unit
    bottom.plot(reference.time[knots], difference, color="0.2", linewidth=0.8)
    bottom.set_ylabel("difference")
    bottom.set_title("circuit − Monte Carlo")
    bottom.set_xlabel("time [s]")


def _density(axes, result, name, colour, style, label):
    """One density in the scene's units, with a band of two standard errors."""
    density = result.densities[name]
    unit = result.scales.of(density.dimension)
    centre, values = density.centre * unit, density.density / unit
    if density.standard_error is not None:
        band = 2.0 * density.standard_error / unit
        axes.fill_between(centre, values - band, values + band, color=colour, alpha=0.25, lw=0)
    axes.plot(centre, values, style, color=colour, label=label)


def _simulations(comparison):
    return comparison.circuit, comparison.monte_carlo


def _reach(result, name):
    """How far out a density is worth drawing, in the scene's units."""
    density = result.densities[name]
    drawn = np.abs(density.centre[density.density > WORTH_DRAWING * density.density.max()])
    return 1.1 * drawn.max() * result.scales.of(density.dimension)


def _axis(result, name):
    unit = result.unit(name)
    return f"{name} [{'scaled' if unit.startswith('scaled') else unit}]"
