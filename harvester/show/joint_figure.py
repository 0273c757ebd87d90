"""The joint density of displacement and velocity, methods side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from harvester.device import timescales
from harvester.scene.units import scale

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from harvester.results import Result

# Share of the peak down to which a density is coloured.
LEAST_SHARE = 1e-3
COLOURS = "viridis"
TITLES = {"averaging fokker_planck": "Fokker–Planck equation", "monte-carlo": "Monte Carlo"}


def draw(results: Sequence[Result]) -> Figure | None:
    """p(X, X') of every result that has one, on the places and the colours of the last of them.

    Wells are marked by dots, saddles by crosses.
    """
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    results = [result for result in results if result.joint_density is not None]
    if not results:
        return None
    places = results[-1].joint_density
    area = results[-1].scales.of("displacement") * results[-1].scales.of("velocity")
    values = [result.joint_density.on(places) / area for result in results]
    highest = max(each.max() for each in values)
    colours = LogNorm(LEAST_SHARE * highest, highest)
    figure = Figure(figsize=(0.9 + 3.3 * len(results), 3.1))
    axes = figure.subplots(1, len(results), sharex=True, sharey=True, squeeze=False)[0]
    mesh = None
    for panel, result, each in zip(axes, results, values, strict=True):
        mesh = _draw_panel(panel, result, places, each, colours)
    axes[0].set_ylabel(_axis(results[0], "velocity"))
    seen = np.max(values, axis=0) > LEAST_SHARE * highest
    for setting, name, along in (
        (axes[0].set_xlim, "displacement", 1),
        (axes[0].set_ylim, "velocity", 0),
    ):
        reach = getattr(places, name)[seen.any(axis=along)] * results[0].scales.of(name)
        spare = 0.05 * np.ptp(reach)
        setting(reach[0] - spare, reach[-1] + spare)
    figure.colorbar(mesh, ax=axes, label=f"probability density [{_unit(results[0])}]", pad=0.02)
    figure.suptitle(
        f"{results[0].scene.name}: joint density of displacement and velocity",
        x=0.01,
        ha="left",
        fontsize=9,
    )
    return figure


def _draw_panel(axes, result, places, values, colours):
    x, v = (getattr(places, name) * result.scales.of(name) for name in ("displacement", "velocity"))
    # Outside of the colours nothing is drawn.
    shown = np.ma.masked_less(values, colours.vmin)
    mesh = axes.pcolormesh(x, v, shown.T, norm=colours, cmap=COLOURS, rasterized=True)
    system, scales = scale(result.scene)
    for found, mark in ((timescales.wells(system), "o"), (timescales.saddles(system), "x")):
        where = np.array(found) * scales.displacement
        axes.plot(where, 0.0 * where, mark, color="white", markersize=3.5, markeredgewidth=1.0)
    axes.set_title(TITLES.get(result.engine, result.engine))
    axes.set_xlabel(_axis(result, "displacement"))
    return mesh


def _axis(result, name):
    unit = result.unit(name)
    return f"{name} [{'scaled' if unit.startswith('scaled') else unit}]"


def _unit(result):
    return "scaled" if result.scene.units != "SI" else "s/m²"
