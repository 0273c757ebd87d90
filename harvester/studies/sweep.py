"""A scene over a grid of values by several methods, as a tidy table."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.averaging.closures import CLOSURES, notes_on_errors
from harvester.base.arguments import Named
from harvester.base.errors import HarvesterError
from harvester.base.formatting import is_share, number, prefixed, with_error, written
from harvester.base.plain_text import json_text
from harvester.base.serialising import plain
from harvester.base.tables import require_xarray
from harvester.engines.request import COMPLETE, OUT_OF_TIME, told
from harvester.results.orbit import Attractor
from harvester.results.palette import CIRCUIT, LINES, MONTE_CARLO, OTHER_LINE, styles
from harvester.results.panels import Panel, Series, draw_panels, is_wide, label_words
from harvester.results.view import Picture, ResultBase, View
from harvester.scene.model import Scene
from harvester.scene.tables import key_column, key_words, value_words
from harvester.statistics.estimate import Estimate
from harvester.statistics.units import unit_of

if TYPE_CHECKING:
    from xarray import Dataset

# Half length of an error bar, in standard errors.
BARS = 2.0
# Colour and marker of an engine with its default settings.
ENGINES = {"circuit": (CIRCUIT, "o"), "monte-carlo": (MONTE_CARLO, "s")}
# Maximum number of panels in a row, one per point of the other keys, and their size (inches).
MOST_COLUMNS, SMALL = 6, (2.3, 2.2)
# Horizontal distance in points between the markers of two engines at the same point.
APART = 6.0
# Width of the first line, and decrease for each further line, so that coinciding lines are visible.
WIDEST, THINNER = 3.0, 0.6


@dataclass(frozen=True)
class Cell:
    """The answer of one method at one point of the grid.

    Attributes
    ----------
    outcome : "complete", or the reason of the failure.
    estimates
        Estimates in the scene's units.
    orbits
        The orbits reached from the starts without noise, the followed one first.
    notes
        Notes on the estimates.
    """

    method: str
    outcome: str
    estimates: dict[str, Estimate] = field(default_factory=dict)
    realizations: int = 0
    orbits: tuple[Attractor, ...] = field(default=(), repr=False)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, repr=False)
class Sweep(ResultBase):
    """A scene at every point of a grid by every method.

    Attributes
    ----------
    scene
        The scene, with the knot spacing common to all points.
    values
        Varied keys with their values; for a load study also the names of loads.
    methods
        Names of the methods, the last axis of `cells`.
    quantities
        Quantities in the tables; `cells` contain all available ones.
    cells : array of shape (values of each key …, methods).
    out_of_time
        Whether the time budget ended the sweep: repeat the call with `output` to continue.
    seconds
        Wall-clock time of this call (s).
    scenes
        The scene of every point.
    """

    scene: Scene
    values: Mapping[str, tuple]
    methods: tuple[str, ...]
    quantities: tuple[str, ...]
    cells: np.ndarray = field(repr=False)
    notes: tuple[str, ...] = ()
    out_of_time: bool = False
    seconds: float = 0.0
    scenes: Sequence[Scene] = field(default=(), repr=False)

    def places(self) -> Iterator[tuple[tuple, Cell]]:
        """Yield (value of each key, cell), with the method varying fastest."""
        cells: Any = self.cells
        for where in np.ndindex(cells.shape):
            point = tuple(values[k] for values, k in zip(self.values.values(), where, strict=False))
            yield point, cells[where]

    def _numbers(self) -> Named:
        """All quantities of the cells by point, including those that the table omits."""
        names = {name: None for _, cell in self.places() for name in cell.estimates}
        complete = replace(self, quantities=tuple(dict.fromkeys((*self.quantities, *names))))
        return super(Sweep, complete)._numbers()

    def _records(self) -> tuple[list[str], list[list[Any]]]:
        """Header and rows of the tidy table: one per point, method and quantity."""
        header = [key_column(key, self.scene.units) for key in self.values]
        header += ["method", "quantity", "estimate", "standard_error", "unit"]
        rows = []
        for point, cell in self.places():
            for name in self.quantities:
                estimate = cell.estimates.get(name, _NOTHING)
                unit = unit_of(self.scene, estimate.dimension) if name in cell.estimates else ""
                error = math.nan if estimate.standard_error is None else estimate.standard_error
                row = [*point, cell.method, name, estimate.estimate, error, unit]
                rows.append([*row, cell.realizations, cell.outcome, "; ".join(cell.notes)])
        return [*header, "realizations", "outcome", "notes"], rows

    def _dataset(self) -> Dataset:
        """Every quantity and its `…_standard_error` over the keys and the method.

        Raises
        ------
        MissingLibrary
            xarray, of the extra `study`.
        """
        variables = variables_of(self.scene, self.cells, (*self.values, "method"))
        coordinates = {name: list(values) for name, values in self.values.items()}
        coordinates["method"] = list(self.methods)
        attributes = {"scene": json_text(self.scene.to_dict()), "notes": "\n".join(self.notes)}
        return require_xarray().Dataset(variables, coordinates, attributes)

    def view(self) -> View:
        """Table, findings and pictures."""
        return View(
            self._table(),
            self._findings(),
            headline=self._headline(),
            pictures=[Picture(_draw, self)],
            records=self._records,
            keys=1 + len(self.values),
            dataset=self._dataset,
        )

    def _table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows as text: one per point and method."""
        units = {
            name: unit_of(self.scene, cell.estimates[name].dimension)
            for _, cell in self.places()
            for name in self.quantities
            if name in cell.estimates
        }
        header = ["method", *(key_column(key, self.scene.units) for key in self.values)]
        header += [quantity.replace("_", " ") for quantity in self.quantities]
        rows = []
        # Errors of stationary methods and of engines share a column of a data frame.
        mixed = 0 < sum(method in CLOSURES for method in self.methods) < len(self.methods)
        for point, cell in self.places():
            estimates = [cell.estimates.get(name, _NOTHING) for name in self.quantities]
            texts = [
                with_error(estimate, units.get(name, ""))
                for name, estimate in zip(self.quantities, estimates, strict=True)
            ]
            realizations = written(cell.realizations, "d") if cell.realizations else ""
            row = [cell.method, *map(in_words, point), *texts]
            kind = "numerical" if cell.method in CLOSURES else "statistical"
            rows.append([*row, realizations, cell.outcome, *[kind] * mixed])
        return [*header, "realizations", "outcome", *["kind of error"] * mixed], rows

    def _findings(self) -> list[str]:
        """Sentences on how the numbers were obtained, and caveats for citing them."""
        run = self.scene.run
        notes = placed_notes((self._where(point, ""), cell.notes) for point, cell in self.places())
        settings = f"realizations of {run.duration:g} s after {run.settle:g} s, seed {run.seed}"
        return [
            *self.notes,
            *(f"at {where}: {note}" if where else note for note, where in notes),
            *notes_on_errors(self.methods),
            f"{', '.join(self.methods)}: {settings}, the same noise for all points; "
            f"{self.seconds:.1f} s",
        ]

    def _headline(self) -> str:
        """Point with the largest first quantity, by stationary methods only if no engine ran."""
        name = self.quantities[0]
        pairs = [pair for pair in self.places() if name in pair[1].estimates]
        if not pairs:
            return f"no point has a {name.replace('_', ' ')}"
        # A stationary method is an approximation: it may be wrong where other methods are accurate.
        by_engines = [pair for pair in pairs if pair[1].method not in CLOSURES]
        point, cell = max(by_engines or pairs, key=lambda pair: pair[1].estimates[name].estimate)
        best = cell.estimates[name]
        return (
            f"highest {name.replace('_', ' ')}: "
            f"{with_error(best, unit_of(self.scene, best.dimension))} at {self._where(point)}, "
            f"by {cell.method}"
        )

    def _where(self, point, between=" = "):
        """The values of a point with units, optionally preceded by their keys."""
        return ", ".join(
            f"{key + between if between else ''}{value_words(key, value, self.scene.units)}"
            for key, value in zip(self.values, point, strict=True)
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, with all quantities of every cell."""
        return plain(
            {
                "scene": self.scene,
                "values": self.values,
                "methods": self.methods,
                "cells": [
                    {
                        "place": dict(zip(self.values, point, strict=True)),
                        "method": cell.method,
                        "outcome": cell.outcome,
                        "notes": cell.notes,
                        "realizations": cell.realizations,
                        "quantities": {
                            name: estimate.to_dict(unit_of(self.scene, estimate.dimension))
                            for name, estimate in cell.estimates.items()
                        },
                        **orbits_of(self.scene, cell.orbits),
                    }
                    for point, cell in self.places()
                ],
                "seed": self.scene.run.seed,
                "notes": self.notes,
                "seconds": self.seconds,
            }
        )


_NOTHING = Estimate(math.nan, None, None, "1")


def orbits_of(scene: Scene, orbits: Sequence[Attractor]) -> dict[str, list]:
    """JSON entry for the orbits reached from the starts; empty for a single start."""
    entries = [orbit.to_dict(lambda dimension: unit_of(scene, dimension)) for orbit in orbits]
    return {"orbits": entries} if entries else {}


def placed_notes(noted: Iterable[tuple[str, Sequence[str]]]) -> list[tuple[str, str]]:
    """(note, its points) for each note; "" for a note that all points have."""
    points: dict[str, None] = {}
    notes: dict[str, dict[str, None]] = {}
    for location, lines in noted:
        points[location] = None
        for line in lines:
            notes.setdefault(line, {})[location] = None
    return [
        (note, "" if len(locations) == len(points) else "; ".join(locations))
        for note, locations in notes.items()
    ]


def cells_of(labels: Sequence[str], answers: Sequence, quantities: Sequence[str]) -> np.ndarray:
    """The cells of a sweep from the answers for every point and method (varying fastest).

    They contain the answers' quantities, and the requested roots of mean squares.
    """
    cells = np.empty(len(answers), dtype=object)
    for k, answer in enumerate(answers):
        cells[k] = _cell(labels[k % len(labels)], answer, quantities)
    return cells


def _cell(method, answer, quantities):
    """The cell of an answer, of an error, or of None if the time budget was spent."""
    if answer is None:
        return Cell(method, OUT_OF_TIME)
    if isinstance(answer, HarvesterError):
        return Cell(method, told(answer))
    names = {*answer.quantities, *quantities}
    estimates = {name: mean for name, mean in answer.in_units().items() if name in names}
    missing = [f"{method} computes no {name}" for name in quantities if name not in estimates]
    notes = (*answer.notes, *missing) if answer.outcome == COMPLETE else ()
    return Cell(method, answer.outcome, estimates, answer.realizations, answer.orbits, notes)


def variables_of(scene: Scene, cells: np.ndarray, dimensions: Sequence[str]) -> dict[str, tuple]:
    """Variables of an xarray Dataset: every quantity, its error, realizations, outcome and notes.

    `cells`: cells with one axis for each dimension.
    """
    variables: dict[str, tuple] = {
        name: (dimensions, values, {"unit": unit}) for name, values, unit in columns(scene, cells)
    }
    variables["realizations"] = (dimensions, _array_of(cells, lambda c: c.realizations, np.int32))
    variables["outcome"] = (dimensions, _array_of(cells, lambda c: c.outcome, str))
    variables["notes"] = (dimensions, _array_of(cells, lambda c: "; ".join(c.notes), str))
    return variables


def columns(scene: Scene, cells: np.ndarray) -> Iterator[tuple[str, np.ndarray, str]]:
    """Yield (name, values, unit) of every quantity in any cell, and of its standard error."""
    dimensions_of: dict[str, str] = {}
    for cell in cells.ravel():
        for name, estimate in cell.estimates.items():
            dimensions_of.setdefault(name, estimate.dimension)
    for name in sorted(dimensions_of):
        unit = unit_of(scene, dimensions_of[name])
        yield name, _array_of(cells, lambda c, n=name: _value(c, n, "estimate"), float), unit
        errors = _array_of(cells, lambda c, n=name: _value(c, n, "standard_error"), float)
        yield f"{name}_standard_error", errors, unit


def in_words(value: float | str) -> str:
    """A swept value, or the name of a load, as text."""
    return value if isinstance(value, str) else number(value, 5)


def _array_of(cells, value, kind):
    return np.array([value(cell) for cell in cells.ravel()], dtype=kind).reshape(cells.shape)


def _value(cell, name, attribute):
    value = getattr(cell.estimates.get(name, _NOTHING), attribute)
    return math.nan if value is None else value


def _draw(sweep):
    """Draw a row of panels for each quantity, with a panel for each point of the other keys."""
    lengths = [len(values) for values in sweep.values.values()]
    # Numeric axes are preferred to text axes, which have no distances.
    ranks = [(not _has_words(values), len(values)) for values in sweep.values.values()]
    along = ranks.index(max(ranks)) if ranks else None
    ranges = [range(length) for k, length in enumerate(lengths) if k != along]
    others = [*itertools.product(*ranges)]
    panels = [_panel(sweep, name, along, other) for name in sweep.quantities for other in others]
    title = f"{sweep.scene.name}: bars of two standard errors (hollow: none)"
    if not 1 < len(others) <= MOST_COLUMNS:
        return draw_panels(panels, title, sharey=len(sweep.quantities) == 1)
    first, last = len(others), len(panels) - len(others)
    panels = [
        replace(
            panel,
            title=panel.title if k < first else "",
            x_label=panel.x_label if k >= last else "",
        )
        for k, panel in enumerate(panels)
    ]
    return draw_panels(panels, title, SMALL, first, sharex=True, sharey="row")


def _panel(sweep, name, along, other):
    keys = list(sweep.values)
    if along is None:
        key, x, rows = "", [0.0], sweep.cells[None]
    else:
        key, x = keys[along], sweep.values[keys[along]]
        rows = np.moveaxis(sweep.cells, along, 0)[(slice(None), *other)]
    held = [axis for axis in keys if axis != key]
    words = [
        f"{axis}\n= {value_words(axis, sweep.values[axis][k], sweep.scene.units)}"
        for axis, k in zip(held, other, strict=True)
    ]
    # All panels of a quantity have one unit.
    means = [cell.estimates[name] for _, cell in sweep.places() if name in cell.estimates]
    unit = unit_of(sweep.scene, means[0].dimension) if means else ""
    if is_share(name):
        factor, unit = 100.0, "%"
    else:
        factor, unit = prefixed(max((abs(mean.estimate) for mean in means), default=0.0), unit)
    named = _has_words(x)
    places = range(len(x)) if named else x
    series = [
        _series(sweep, name, places, rows[:, k], k, factor) for k in range(len(sweep.methods))
    ]
    label = f"{name.replace('_', ' ')} [{unit or '1'}]"
    x_label, x_unit = key_words(key, sweep.scene.units) if key else ("", None)
    return Panel(
        x_label,
        label,
        series,
        ", ".join(words),
        log_x=not named and is_wide(x),
        more=partial(label_words, words=[*map(in_words, x)]) if named else None,
        x_unit=None if named else x_unit,
    )


def _has_words(values):
    return any(isinstance(value, str) for value in values)


def _series(sweep, name, x, cells, number, factor):
    """One method's estimates; missing ones leave a gap."""
    label = sweep.methods[number]
    method = _without_settings(label)
    means = [cell.estimates.get(name) for cell in cells]
    estimates = [mean and mean.times(factor) for mean in means]
    y = [math.nan if mean is None else mean.estimate for mean in estimates]
    if method in CLOSURES:
        colour, line = LINES.get(method, OTHER_LINE)
        return Series(x, y, f"averaging, {label}", colour, line, width=WIDEST * THINNER**number)
    errors = [mean and mean.standard_error for mean in estimates]
    bars = [0.0 if error is None else BARS * error for error in errors]
    engines = [other for other in sweep.methods if _without_settings(other) not in CLOSURES]
    colour, marker = ENGINES.get(label) or styles(engines)[label]
    bare = [error is None for error in errors]
    shift = APART * (engines.index(label) - 0.5 * (len(engines) - 1))
    return Series(x, y, label, colour, "", marker, bars=bars, hollow=bare, shift=shift)


def _without_settings(label):
    """A method's name without the settings that distinguish methods of the same name."""
    return label.partition(" (")[0]
