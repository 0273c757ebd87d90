"""A study as an xarray Dataset and as a table: the same study gives the same content."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.estimates.units import unit_of
from harvester.files.plain_text import json_text
from harvester.files.tables import xarray_or_say
from harvester.record.record import Record
from harvester.studies.evaluation import WAVEFORM

if TYPE_CHECKING:
    from xarray import Dataset

    from harvester.studies.outcome import Report


def to_dataset(report: Report) -> Dataset:
    """The study as an xarray Dataset in the scene's units.

    Parameters
    ----------
    report : harvester.studies.outcome.Report

    Returns
    -------
    xarray.Dataset
        Dimensions: load, one per sweep by its dotted key, and `better`, `worse` for paired
        differences at the optima, `sample` for waveforms. Every quantity stands beside its
        `…_standard_error`. No time of day and no duration: equal studies are equal.
    """
    xarray = xarray_or_say()
    study = report.study
    grid = study.grid
    dimensions = ("load", *grid.sweeps)
    coordinates = {"load": list(grid.loads), **{k: list(v) for k, v in grid.sweeps.items()}}
    variables: dict[str, tuple] = {
        name: (dimensions, values, {"unit": unit}) for name, values, unit in _quantities(report)
    }
    variables |= {
        "realizations": (dimensions, _each(report, lambda e: e.realizations, np.int32)),
        "outcome": (dimensions, _each(report, lambda e: e.outcome, str)),
    }
    variables |= _proofs(report, dimensions)
    variables |= _optima(report) | _differences(report) | _waveforms(report)
    coordinates |= {"better": list(grid.loads), "worse": list(grid.loads)}
    attributes = {
        "scene": json_text(grid.scene.to_dict()),
        "method": study.method,
        "version": study.version,
        "precision": math.nan if study.precision is None else study.precision,
        "out_of_time": int(study.out_of_time),
        "notes": "\n".join(grid.notes) or "none",
    }
    return xarray.Dataset(variables, coordinates, attributes)


def table_of(report: Report) -> tuple[list[str], list[list[Any]]]:
    """Header and rows, one a point: load, swept values, every quantity with its standard error."""
    grid = report.study.grid
    quantities = list(_quantities(report))
    header = ["load", *grid.sweeps, *(f"{name} [{unit}]" for name, _, unit in quantities)]
    rows = []
    for place in np.ndindex(report.evaluations.shape):
        evaluation: Any = report.evaluations[place]
        swept = [v[k] for v, k in zip(grid.sweeps.values(), place[1:], strict=True)]
        values = [values[place] for _, values, _ in quantities]
        row = [grid.loads[place[0]], *swept, *values, evaluation.realizations]
        rows.append([*row, evaluation.outcome])
    return [*header, "realizations", "outcome"], rows


def _each(report, value, kind):
    flat = [value(evaluation) for evaluation in report.evaluations.ravel()]
    return np.array(flat, dtype=kind).reshape(report.evaluations.shape)


def _quantities(report):
    """(name, array, unit) of every quantity that any point has, and of its standard error."""
    found = {}
    for evaluation in report.evaluations.ravel():
        for name, estimate in evaluation.estimates.items():
            found.setdefault(name, estimate.dimension)
    for name in sorted(found):
        unit = unit_of(report.scene, found[name])
        yield name, _each(report, lambda e, n=name: _value(e, n, "estimate"), float), unit
        errors = _each(report, lambda e, n=name: _value(e, n, "standard_error"), float)
        yield f"{name}_standard_error", errors, unit


def _value(evaluation, name, attribute):
    estimate = evaluation.estimates.get(name)
    value = None if estimate is None else getattr(estimate, attribute)
    return math.nan if value is None else value


def _proofs(report, dimensions):
    """(circuit − Monte Carlo)/Monte Carlo of the output power; nan where there is no proof."""
    attributes = ("difference", "standard_error", "early_difference", "early_standard_error")
    names = (
        "difference",
        "difference_standard_error",
        "early_difference",
        "early_difference_standard_error",
    )
    found = np.full((len(names), len(report.study.evaluations)), math.nan)
    for each in report.study.proofs:
        found[:, each.place] = [getattr(each, name) for name in attributes]
    shape = report.evaluations.shape
    return {
        f"circuit_{name}": (dimensions, row.reshape(shape), {"unit": "1"})
        for name, row in zip(names, found, strict=True)
    }


def _optima(report):
    key, others = report.curve_keys
    if key is None:
        return {}
    places = np.array(report.study.grid.sweeps[key])
    dimensions = ("load", *others)
    shape = report.optima.shape

    def array(value, kind=float):
        return np.array([value(each) for each in report.optima.ravel()], kind).reshape(shape)

    attributes = {"along": key}
    return {
        "highest_at": (dimensions, array(lambda o: math.nan if o[1] is None else places[o[1]])),
        "optimum": (dimensions, array(lambda o: o[0].place), attributes),
        "optimum_low": (dimensions, array(lambda o: o[0].low), attributes),
        "optimum_high": (dimensions, array(lambda o: o[0].high), attributes),
        "optimum_note": (dimensions, array(lambda o: o[0].note or "inside", str)),
    }


def _differences(report):
    """P(better)/P(worse) − 1 of the loads at their optima, nan where the order is the other."""
    _, others = report.curve_keys
    loads = report.study.grid.loads
    shape = (len(loads), len(loads), *report.optima.shape[1:])
    values, errors = np.full(shape, math.nan), np.full(shape, math.nan)
    for other, (_, differences) in report.rankings.items():
        for each in differences:
            where = (loads.index(each.better), loads.index(each.worse), *other)
            values[where], errors[where] = each.estimate, each.standard_error
    dimensions = ("better", "worse", *others)
    return {
        "relative_difference": (dimensions, values, {"unit": "1"}),
        "relative_difference_standard_error": (dimensions, errors, {"unit": "1"}),
    }


def _waveforms(report):
    """A few periods at each load's highest point, where there are any."""
    _, others = report.curve_keys
    best = {where: report.best(where) for where in np.ndindex(report.optima.shape)}
    drawn = {where: e.waveform for where, e in best.items() if e and e.waveform is not None}
    if not drawn:
        return {}
    count = next(iter(drawn.values())).shape[1]
    variables = {}
    for name, dimension in WAVEFORM.items():
        values = np.full((*report.optima.shape, count), math.nan)
        row = Record._fields.index(name)
        for where, waveform in drawn.items():
            values[where] = waveform[row]
        unit = {"unit": unit_of(report.scene, dimension)}
        variables[f"waveform_{name}"] = (("load", *others, "sample"), values, unit)
    return variables
