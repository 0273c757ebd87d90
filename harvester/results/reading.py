"""A result from its plain values, each of the type that it must have."""

from __future__ import annotations

import dataclasses
import math
import numbers
from typing import Any

from harvester.estimates.estimate import Estimate
from harvester.estimates.units import SI_UNITS
from harvester.excitation.spectrum_fit import SpectrumFit
from harvester.files.plain_text import shown
from harvester.results.result import Result
from harvester.scene.model import Scene
from harvester.scene.units import Scales

TEXTS = ("engine", "engine_version", "outcome", "error_kind")


class NotAValue(Exception):
    """A value is of another type than a result's; the message names it."""


def result_of(content: dict[str, Any], folder: str | None) -> Result:
    """See `Result.from_dict`.

    Raises
    ------
    SceneError
    NotAValue, KeyError, TypeError, AttributeError
        Something is missing, or is something else.
    """
    fit = content.get("spectrum_fit")
    digest = content["netlist_sha256"]
    return Result(
        **{name: _text(content[name], name) for name in TEXTS},
        scene=Scene.from_dict(content["scene"], folder),
        scaled_quantities={
            _text(name, "scaled_quantities"): _estimate(entry, f"scaled_quantities.{name}")
            for name, entry in content["scaled_quantities"].items()
        },
        scales=_scales(content["scales"]),
        energy_balance_residual=_maybe(
            content["energy_balance_residual"], "energy_balance_residual"
        ),
        wall_seconds=_or_nan(content["wall_seconds"], "wall_seconds"),
        engine_seconds=_or_nan(content["engine_seconds"], "engine_seconds"),
        simulated_time=_number(content["simulated_time"], "simulated_time"),
        steps=_count(content["steps"], "steps"),
        step=_maybe(content["step"], "step"),
        step_error=_maybe(content.get("step_error"), "step_error"),
        realizations=_count(content["realizations"], "realizations"),
        netlist_sha256=None if digest is None else _text(digest, "netlist_sha256"),
        notes=tuple(_text(each, "notes") for each in _list(content["notes"], "notes")),
        failures={
            int(index): _text(reason, "failures") for index, reason in content["failures"].items()
        },
        spectrum_fit=_fit(fit) if fit else None,
    )


def _estimate(entry, where):
    return Estimate(
        _or_nan(entry["estimate"], f"{where}.estimate"),
        _maybe(entry["standard_error"], f"{where}.standard_error"),
        _maybe(entry["effective_sample_size"], f"{where}.effective_sample_size"),
        _dimension(entry["dimension"], f"{where}.dimension"),
        _text(entry.get("note", ""), f"{where}.note"),
    )


def _scales(values):
    scales = {each.name: values[each.name] for each in dataclasses.fields(Scales)}
    for name, value in scales.items():
        if not 0.0 < _number(value, f"scales.{name}") < math.inf:
            raise NotAValue(f"scales.{name} = {shown(value)}: must be a number > 0")
    return Scales(**scales)


def _fit(content):
    fit = SpectrumFit.from_dict(content)
    for field in dataclasses.fields(fit):
        if field.type == "float":
            _or_nan(getattr(fit, field.name), f"spectrum_fit.{field.name}")
    return fit


def _dimension(value, where):
    """Such as "voltage^2": a known unit, and a whole power of it."""
    base, power, exponent = _text(value, where).partition("^")
    if base not in SI_UNITS or (power and not exponent.removeprefix("-").isdecimal()):
        raise NotAValue(f"{where} = {shown(value)}: is no dimension")
    return value


def _number(value, where):
    if not isinstance(value, numbers.Real) or isinstance(value, bool):
        raise NotAValue(f"{where} = {shown(value)}: must be a number")
    return value


def _maybe(value, where):
    return None if value is None else _number(value, where)


def _or_nan(value, where):
    """What `finite` made null is not a number."""
    return math.nan if value is None else _number(value, where)


def _count(value, where):
    if not isinstance(value, numbers.Integral) or isinstance(value, bool) or value < 0:
        raise NotAValue(f"{where} = {shown(value)}: must be a whole number ≥ 0")
    return value


def _text(value, where):
    if not isinstance(value, str):
        raise NotAValue(f"{where} = {shown(value)}: must be a text")
    return value


def _list(value, where):
    if not isinstance(value, (list, tuple)):
        raise NotAValue(f"{where} = {shown(value)}: must be a list")
    return value
