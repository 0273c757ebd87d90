"""Converts frozen dataclasses to plain values for JSON and back, by the types of their fields.

>>> from dataclasses import dataclass, field
>>> @dataclass(frozen=True)
... class Cell:
...     word: str = field(metadata=key("verdict"))
...     share: float
...     notes: tuple = field(default=(), metadata=LEFT_OUT)
>>> fields_of(Cell("right", float("nan")))
{'verdict': 'right', 'share': None}
>>> read(Cell, {"verdict": "right", "share": None}, "cell")
Cell(word='right', share=nan, notes=())
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from types import NoneType
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np

from harvester.base.numbers import is_real, is_whole
from harvester.base.plain_text import shown
from harvester.base.writing import finite

_KEY = "key in JSON"
# Metadata of a field that is omitted in JSON.
LEFT_OUT = {_KEY: None}


def key(name: str) -> dict[str, str]:
    """Metadata of a field that has another name in JSON."""
    return {_KEY: name}


def fields_of(instance: Any) -> dict[str, Any]:
    """The fields of a dataclass by their keys, each as a plain value.

    `IN_JSON` of a class: further keys, with the names of their properties.
    """
    names = {f.metadata.get(_KEY, f.name): f.name for f in dataclasses.fields(instance)}
    names |= getattr(type(instance), "IN_JSON", {})
    return {
        name: plain(getattr(instance, field)) for name, field in names.items() if name is not None
    }


def plain(value: Any) -> Any:
    """A value for JSON: NaN and infinity become null, arrays and tuples become lists.

    An object with `to_dict` is converted by it; of other dataclasses all fields are written.
    """
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return finite(value)
    if isinstance(value, Mapping):
        return {str(name): plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if dataclasses.is_dataclass(value):
        return fields_of(value)
    raise TypeError(f"{type(value).__name__} has no plain value for JSON")


# For each plain type: a test of a value, and the type's name for messages.
_PLAIN: dict[Any, tuple[Callable[[Any], bool], str]] = {
    str: (lambda value: isinstance(value, str), "a text"),
    float: (is_real, "a number"),
    int: (lambda value: is_whole(value, 0), "a whole number ≥ 0"),
}


class NotAValue(Exception):
    """A value does not have the required type; the message names its key."""


def read(kind: Any, value: Any, where: str) -> Any:
    """A value of an annotated type from its plain form, the inverse of `plain`.

    For a number, null is read as NaN. Dataclass fields that are omitted in JSON or missing have
    their defaults.

    `kind`: str, bool, int, float, a dataclass, a dict or a tuple of one kind, or one of these or
    None. Raises NotAValue.
    """
    if NoneType in get_args(kind):
        (inner,) = set(get_args(kind)) - {NoneType}
        return None if value is None else read(inner, value, where)
    if dataclasses.is_dataclass(kind):
        return kind(**values_of(kind, value, where))  # type: ignore[operator]
    if get_origin(kind) is dict:
        key_kind, value_kind = get_args(kind)
        _require(isinstance(value, Mapping), value, where, "a table")
        # In JSON all keys are texts.
        for name in value:
            fits = isinstance(name, str) and (key_kind is str or name.isdecimal())
            _require(fits, name, where, _PLAIN[key_kind][1])
        return {key_kind(n): read(value_kind, item, f"{where}.{n}") for n, item in value.items()}
    if get_origin(kind) is tuple:
        _require(isinstance(value, list | tuple), value, where, "a list")
        return tuple(read(get_args(kind)[0], item, where) for item in value)
    if kind is float and value is None:
        return math.nan
    if kind in _PLAIN:
        is_one, noun = _PLAIN[kind]
        _require(is_one(value), value, where, noun)
    return value


def values_of(kind: Any, content: Any, where: str) -> dict[str, Any]:
    """The fields of a dataclass that JSON holds, by their names; see `read`."""
    _require(isinstance(content, Mapping), content, where, "a table")
    hints, values = get_type_hints(kind), {}
    for field in dataclasses.fields(kind):
        name = field.metadata.get(_KEY, field.name)
        if name in content:
            values[field.name] = read(hints[field.name], content[name], f"{where}.{name}")
        elif name and field.default is field.default_factory is dataclasses.MISSING:
            raise NotAValue(f"{where}.{name} is missing")
    return values


def _require(fits, value, where, expected):
    if not fits:
        raise NotAValue(f"{where} = {shown(value)}: must be {expected}")
