"""A load study as an xarray Dataset: the same study gives the same content."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.estimates.units import unit_of
from harvester.files.plain_text import json_text
from harvester.files.tables import xarray_or_say
from harvester.record.record import Record
from harvester.studies.loads.evaluation import WAVEFORM
from harvester.studies.sweep import variables_of

if TYPE_CHECKING:
    from xarray import Dataset


def dataset_of(study: Any) -> Dataset:
    """The study as an xarray Dataset in the scene's units.

    Returns
    -------
    xarray.Dataset
        Dimensions: load, one per sweep by its dotted key, and `better`, `worse` for paired
        differences at the optima, `sample` for waveforms. Every quantity stands beside its
        `…_standard_error`. No time of day and no duration: equal studies are equal.
    """
    xarray = xarray_or_say()
    grid = study.grid
    dimensions = ("load", *grid.sweeps)
    coordinates = {"load": list(grid.loads), **{k: list(v) for k, v in grid.sweeps.items()}}
    variables = variables_of(study.scene, study.cells, dimensions)
    variables |= _proofs(study, dimensions)
    variables |= _optima(study) | _differences(study) | _waveforms(study)
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


def _proofs(study, dimensions):
    """(circuit − Monte Carlo)/Monte Carlo of the output power; nan where there is no proof."""
    attributes = {
        "difference": "difference",
        "difference_standard_error": "standard_error",
        "early_difference": "early_difference",
        "early_difference_standard_error": "early_standard_error",
    }
    values = np.full((len(attributes), len(study.evaluations)), math.nan)
    for proof in study.proofs:
        values[:, proof.place] = [getattr(proof, name) for name in attributes.values()]
    shape = study.cells.shape
    return {
        f"circuit_{name}": (dimensions, row.reshape(shape), {"unit": "1"})
        for name, row in zip(attributes, values, strict=True)
    }


def _optima(study):
    key, others = study.curve_keys
    if key is None:
        return {}
    places = np.array(study.grid.sweeps[key])
    dimensions = ("load", *others)
    shape = study.optima.shape

    def array(value, kind=float):
        return np.array([value(optimum) for optimum in study.optima.ravel()], kind).reshape(shape)

    attributes = {"along": key}
    return {
        "highest_at": (dimensions, array(lambda o: math.nan if o[1] is None else places[o[1]])),
        "optimum": (dimensions, array(lambda o: o[0].place), attributes),
        "optimum_low": (dimensions, array(lambda o: o[0].low), attributes),
        "optimum_high": (dimensions, array(lambda o: o[0].high), attributes),
        "optimum_note": (dimensions, array(lambda o: o[0].note or "inside", str)),
    }


def _differences(study):
    """P(better)/P(worse) − 1 of the loads at their optima, nan where the order is the other."""
    _, others = study.curve_keys
    loads = study.grid.loads
    shape = (len(loads), len(loads), *study.optima.shape[1:])
    values, errors = np.full(shape, math.nan), np.full(shape, math.nan)
    for other, (_, differences) in study.rankings.items():
        for difference in differences:
            where = (loads.index(difference.better), loads.index(difference.worse), *other)
            values[where], errors[where] = difference.estimate, difference.standard_error
    dimensions = ("better", "worse", *others)
    return {
        "relative_difference": (dimensions, values, {"unit": "1"}),
        "relative_difference_standard_error": (dimensions, errors, {"unit": "1"}),
    }


def _waveforms(study):
    """A few periods at each load's highest point, where there are any."""
    _, others = study.curve_keys
    best = {where: study.best(where) for where in np.ndindex(study.optima.shape)}
    drawn = {where: e.waveform for where, e in best.items() if e and e.waveform is not None}
    if not drawn:
        return {}
    count = next(iter(drawn.values())).shape[1]
    variables = {}
    for name, dimension in WAVEFORM.items():
        values = np.full((*study.optima.shape, count), math.nan)
        row = Record._fields.index(name)
        for where, waveform in drawn.items():
            values[where] = waveform[row]
        unit = {"unit": unit_of(study.scene, dimension)}
        variables[f"waveform_{name}"] = (("load", *others, "sample"), values, unit)
    return variables
