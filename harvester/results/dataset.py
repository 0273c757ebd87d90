"""A result as an xarray Dataset in the scene's units."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from harvester.files.libraries import optional_library

if TYPE_CHECKING:
    from xarray import Dataset

    from harvester.results.result import Result


def dataset_of(result: Result) -> Dataset:
    """All quantities and densities, each with its `…_standard_error`; nan where there is none.

    Returns
    -------
    xarray.Dataset
        Quantities without a dimension; `displacement_density` and so on along `displacement` and
        so on, the bins' centres; `joint_density`, where there is one, along `joint_displacement`
        and `joint_velocity`. The attribute `unit` says the unit of each.

    Raises
    ------
    MissingLibrary
    """
    xarray = optional_library("xarray", "Result.to_xarray", "study")
    variables: dict[str, tuple] = {}
    coordinates: dict[str, tuple] = {}
    for name, estimate in result.quantities.items():
        unit = {"unit": result.unit(estimate.dimension)}
        error = math.nan if estimate.standard_error is None else estimate.standard_error
        variables[name] = ((), estimate.estimate, unit)
        variables[f"{name}_standard_error"] = ((), error, unit)
    for name, density in result.densities.items():
        scale, across = result.scales.of(density.dimension), result.unit(density.dimension)
        coordinates[name] = (name, density.centre * scale, {"unit": across})
        inverse = {"unit": f"1/({across})"}
        variables[f"{name}_density"] = (name, density.density / scale, inverse)
        if density.standard_error is not None:
            errors = density.standard_error / scale
            variables[f"{name}_density_standard_error"] = (name, errors, inverse)
    if result.joint_density is not None:
        _add_joint(result, variables, coordinates)
    attributes = {
        "scene": result.scene.name,
        "scene_sha256": result.scene.digest(),
        "engine": result.engine,
        "engine_version": result.engine_version,
        "outcome": result.outcome,
    }
    return xarray.Dataset(variables, coordinates, attributes)


def _add_joint(result, variables, coordinates):
    """The joint density of displacement and velocity, along coordinates of its own."""
    joint, across = result.joint_density, ("displacement", "velocity")
    names, area = [f"joint_{name}" for name in across], 1.0
    for name, axis in zip(across, names, strict=True):
        factor = result.scales.of(name)
        coordinates[axis] = (axis, getattr(joint, name) * factor, {"unit": result.unit(name)})
        area *= factor
    unit = {"unit": f"1/({result.unit('displacement')} {result.unit('velocity')})"}
    variables["joint_density"] = (names, joint.density / area, unit)
    if joint.standard_error is not None:
        variables["joint_density_standard_error"] = (names, joint.standard_error / area, unit)
