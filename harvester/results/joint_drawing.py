"""Figure of the joint density of displacement and velocity, one panel per method."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.device import timescales
from harvester.results.drawing import axis_label
from harvester.results.panels import set_title
from harvester.results.view import NOT_IN_JSON

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# Densities below this share of their peak are left blank.
LEAST_SHARE = 1e-3
COLOURS = "viridis"
# What the figure needs, see `harvester.results.view.Picture`.
NEEDS = (
    'a joint density, of simulate(…, joint_density=True) or average(…, method="fokker_planck"), '
    f"{NOT_IN_JSON}"
)
TITLES = {"averaging fokker_planck": "Fokker–Planck equation", "monte-carlo": "Monte Carlo"}


def draw(results: Sequence[Any]) -> Figure | None:
    """Draw p(X, X') of every result that has it, on the last result's grid and colour scale.

    Dots mark wells, crosses mark saddles.
    """
    from matplotlib.figure import Figure

    drawn = [
        (result, result.joint_density) for result in results if result.joint_density is not None
    ]
    if not drawn:
        return None
    last, points = drawn[-1]
    area = last.scales.of("displacement") * last.scales.of("velocity")
    values = np.stack([joint.on(points) for _, joint in drawn]) / area
    figure = Figure(figsize=(0.9 + 3.3 * len(drawn), 3.1))
    axes = figure.subplots(1, len(drawn), sharex=True, sharey=True, squeeze=False)[0]
    meshes = [
        _draw_panel(panel, result, points, density, values.max())
        for panel, (result, _), density in zip(axes, drawn, values, strict=True)
    ]
    _frame(axes[0], last, points, values.max(axis=0))
    axes[0].set_ylabel(axis_label(last, "velocity"))
    unit = "s/m²" if last.scene.units == "SI" else "scaled"
    figure.colorbar(meshes[-1], ax=axes, label=f"probability density [{unit}]", pad=0.02)
    set_title(figure, f"{last.scene.name}: joint density of displacement and velocity")
    return figure


def _draw_panel(axes, result, points, values, highest):
    from matplotlib.colors import LogNorm

    least = LEAST_SHARE * highest
    x, v = _in_units(result, points)
    visible = np.ma.masked_less(values, least)
    norm = LogNorm(least, highest)
    mesh = axes.pcolormesh(x, v, visible.T, norm=norm, cmap=COLOURS, rasterized=True)
    system, scales = result.prepared_scene.system, result.scales
    for displacements, mark in ((timescales.wells(system), "o"), (timescales.saddles(system), "x")):
        where = np.array(displacements) * scales.displacement
        axes.plot(where, 0.0 * where, mark, color="white", markersize=3.5, markeredgewidth=1.0)
    axes.set_title(TITLES.get(result.engine, result.engine))
    axes.set_xlabel(axis_label(result, "displacement"))
    return mesh


def _frame(axes, result, points, values):
    """Set limits slightly beyond the drawn data."""
    seen = values > LEAST_SHARE * values.max()
    limits = (axes.set_xlim, axes.set_ylim)
    for set_limits, along, other in zip(limits, _in_units(result, points), (1, 0), strict=True):
        reach = along[seen.any(axis=other)]
        spare = 0.05 * np.ptp(reach)
        set_limits(reach[0] - spare, reach[-1] + spare)


def _in_units(result, points):
    """Displacements and velocities in the scene's units."""
    return [getattr(points, name) * result.scales.of(name) for name in ("displacement", "velocity")]
