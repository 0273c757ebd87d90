"""Densities as lines of letters, for a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harvester.results.result import Result

# Bars in steps of an eighth of the height.
HEIGHTS = " ▁▂▃▄▅▆▇█"
# Characters of a line, and samples of the density within each.
WIDTH, FINER = 56, 32
# Ends where the density is below this share of its peak are left out.
SHOWN_SHARE = 0.01


def densities(results: Mapping[str, Result], quantity: str = "displacement") -> list[str]:
    """A line for each method that knows the density of a quantity, and one with the range.

    All lines have the same range and the same height. A density that is known by more points than
    there are letters is averaged within each letter.

    Parameters
    ----------
    results : mapping of str to Result
        Results of one scene, by the name that a line gets.
    quantity : str
        A key of `Result.densities`.
    """
    known = {name: result for name, result in results.items() if quantity in result.densities}
    if not known:
        return []
    curves = {name: result.densities[quantity] for name, result in known.items()}
    used = [
        curve.centre[curve.density >= SHOWN_SHARE * curve.density.max()]
        for curve in curves.values()
    ]
    low, high = min(each[0] for each in used), max(each[-1] for each in used)
    rows = {name: _averages(curve, low, high) for name, curve in curves.items()}
    top = max(row.max() for row in rows.values())
    letters = max(map(len, rows))
    lines = [
        f"  {name:{letters}}  {''.join(HEIGHTS[round(8 * share)] for share in row / top)}"
        for name, row in rows.items()
    ]
    one = next(iter(known.values()))
    scale, unit = one.scales.of(quantity), one.unit(quantity)
    ends = f"{low * scale:.3g}", f"{high * scale:.3g} {unit}"
    axis = f"{ends[0]}{f'density of {quantity}':^{WIDTH - len(ends[0]) - len(ends[1])}}{ends[1]}"
    return [*lines, f"  {'':{letters}}  {axis}"]


def _averages(curve, low, high):
    """Mean density within each letter, shape (WIDTH,)."""
    import numpy as np

    places = low + (high - low) * (np.arange(WIDTH * FINER) + 0.5) / (WIDTH * FINER)
    return np.interp(places, curve.centre, curve.density).reshape(WIDTH, FINER).mean(axis=1)
