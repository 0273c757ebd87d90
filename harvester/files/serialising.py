"""Frozen dataclasses as plain values for JSON: their fields say what there is.

>>> from dataclasses import dataclass, field
>>> @dataclass(frozen=True)
... class Cell:
...     word: str = field(metadata=key("verdict"))
...     share: float
...     notes: tuple = field(default=(), metadata=LEFT_OUT)
>>> fields_of(Cell("right", float("nan")))
{'verdict': 'right', 'share': None}
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from harvester.files.writing import finite

_KEY = "key in JSON"
# Metadata of a field that JSON does not hold.
LEFT_OUT = {_KEY: None}


def key(name: str) -> dict[str, str]:
    """Metadata of a field that has another name in JSON."""
    return {_KEY: name}


def fields_of(instance: Any, units: Callable[[str], str] | None = None) -> dict[str, Any]:
    """The fields of a dataclass by their keys, each as a plain value.

    Parameters
    ----------
    instance : dataclass instance
    units : callable or None
        Gives the unit of a dimension; every dataclass with a field `dimension` then tells its
        `unit` instead.
    """
    content = {}
    for each in dataclasses.fields(instance):
        name, value = each.metadata.get(_KEY, each.name), getattr(instance, each.name)
        if units is not None and each.name == "dimension":
            name, value = "unit", units(value)
        if name is not None:
            content[name] = plain(value, units)
    return content


def plain(value: Any, units: Callable[[str], str] | None = None) -> Any:
    """A value as JSON takes it: NaN and infinity become null, arrays and tuples become lists.

    What has a `to_dict` of its own is asked for it; other dataclasses tell their fields.
    """
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return finite(value)
    if isinstance(value, Mapping):
        return {str(name): plain(each, units) for name, each in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(each, units) for each in value]
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if dataclasses.is_dataclass(value):
        return fields_of(value, units)
    raise TypeError(f"{type(value).__name__} has no plain value for JSON")
