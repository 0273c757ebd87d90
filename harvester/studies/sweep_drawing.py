"""The figure of a sweep: every quantity over the key with most values, by every method."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from harvester.averaging import CLOSURES
from harvester.estimates.units import unit_of
from harvester.show.numbers import is_share, prefixed
from harvester.show.palette import CIRCUIT, LINES, MONTE_CARLO, styles
from harvester.show.panels import Panel, Series, draw_panels, is_wide
from harvester.show.symbols import key_label
from harvester.studies.sweep import in_words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from harvester.studies.sweep import Sweep

# An error bar reaches so many standard errors to either side.
BARS = 2.0
OTHER_CLOSURE = ("0.3", "-.")
# Colour and marker of an engine with its default settings.
ENGINES = {"circuit": (CIRCUIT, "o"), "monte-carlo": (MONTE_CARLO, "s")}
# Points of print between the markers of two engines at the same place.
APART = 6.0
# Width of the first line, and by how much each further one is thinner: thin over thick shows both.
WIDEST, THINNER = 3.0, 0.6


def draw(sweep: Sweep) -> Figure:
    """A panel for each quantity and each place of the other keys."""
    lengths = [len(values) for values in sweep.values.values()]
    # An axis of numbers is preferred to one of words, which have no distances.
    ranks = [(not has_words(values), len(values)) for values in sweep.values.values()]
    along = ranks.index(max(ranks)) if ranks else None
    others = [range(length) for k, length in enumerate(lengths) if k != along]
    panels = [
        _panel(sweep, name, along, other)
        for name in sweep.quantities
        for other in itertools.product(*others)
    ]
    title = f"{sweep.scene.name}: bars of two standard errors (hollow: none)"
    return draw_panels(panels, title)


def _panel(sweep, name, along, other):
    keys = list(sweep.values)
    if along is None:
        key, x, rows = "", [0.0], sweep.cells[None]
    else:
        key, x = keys[along], sweep.values[keys[along]]
        rows = np.moveaxis(sweep.cells, along, 0)[(slice(None), *other)]
    held = [axis for axis in keys if axis != key]
    words = [
        f"{axis} = {in_words(sweep.values[axis][k])}" for axis, k in zip(held, other, strict=True)
    ]
    means = [cell.estimates[name] for cell in rows.ravel() if name in cell.estimates]
    unit = unit_of(sweep.scene, means[0].dimension) if means else ""
    if is_share(name):
        factor, unit = 100.0, "%"
    else:
        factor, unit = prefixed(max((abs(mean.estimate) for mean in means), default=0.0), unit)
    series = [_series(sweep, name, x, rows[:, k], k, factor) for k in range(len(sweep.methods))]
    label = f"{name.replace('_', ' ')} [{unit or '1'}]"
    return Panel(
        key_label(key, sweep.scene.units) if key else "",
        label,
        series,
        ", ".join(words),
        log_x=not has_words(x) and is_wide(x),
    )


def has_words(values: Sequence[object]) -> bool:
    """Whether values of a key are words."""
    return any(isinstance(value, str) for value in values)


def _series(sweep, name, x, cells, place, factor):
    """One method's estimates; those that are missing leave a gap."""
    label = sweep.methods[place]
    method = _without_settings(label)
    means = [cell.estimates.get(name) for cell in cells]
    estimates = [mean and mean.times(factor) for mean in means]
    y = [math.nan if mean is None else mean.estimate for mean in estimates]
    if method in CLOSURES:
        colour, line = LINES.get(method, OTHER_CLOSURE)
        return Series(x, y, f"averaging, {label}", colour, line, width=WIDEST * THINNER**place)
    errors = [mean and mean.standard_error for mean in estimates]
    bars = [0.0 if error is None else BARS * error for error in errors]
    engines = [other for other in sweep.methods if _without_settings(other) not in CLOSURES]
    colour, marker = ENGINES.get(label) or styles(engines)[label]
    bare = [error is None for error in errors]
    shift = APART * (engines.index(label) - 0.5 * (len(engines) - 1))
    return Series(x, y, label, colour, "", marker, bars=bars, hollow=bare, shift=shift)


def _without_settings(label):
    """A method's name; settings stand behind it where two methods have one name."""
    return label.partition(" (")[0]
