"""JSON Schema (draft 2020-12) of scene files, for editors and other programs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import Any

from harvester.device.contact import LAWS
from harvester.device.keys import LARGEST, NAMED_VALUES, SCALED, SI, SMALLEST, Key, OneOf
from harvester.excitation.base import Excitation
from harvester.scene.drawn import DRAWN
from harvester.scene.tables import KINDS, SEVERAL, TRANSDUCERS, Top, all_tables
from harvester.scene.toml import LONGEST_TEXT

TEXT = {"type": "string", "maxLength": LONGEST_TEXT, "pattern": r"^[^\x00]*$"}
# Numbers with a suffix, such as "4.7k", are in quotes.
SUFFIXED = r"(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})? ?([kKuUµμnNpPm]|[mM][eE][gG])$"


def json_schema() -> dict[str, Any]:
    """The JSON Schema of a scene's TOML file.

    It contains keys, types, ranges, words, alternatives and conditions on `units`, including those
    of installed plug-ins. Only the program itself rejects physically inconsistent values.
    """
    for registry in (KINDS, LAWS, TRANSDUCERS):
        registry.load_all()
    content = {name: _object(cls.KEYS) for name, cls in all_tables().items() if cls is not KINDS}
    content["excitation"] = {"$ref": "#/$defs/excitation"}
    for name, most in SEVERAL.items():
        several = {"type": "array", "minItems": 1, "maxItems": most, "items": content[name]}
        content[name] = {"anyOf": [content[name], several]}
    kinds = [_kind(name) for name in KINDS]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Scene of a vibration energy harvester",
        **_object(Top.KEYS, content),
        "required": ["units", "load", "excitation"],
        "if": {"properties": {"units": {"const": SI}}},
        "then": _rules_of_scenes(SI),
        "else": _rules_of_scenes(SCALED),
        "anyOf": [
            {"properties": {"run": {"required": ["duration"]}}, "required": ["run"]},
            {"properties": {"excitation": {"properties": {"kind": {"enum": _ending()}},
                                           "required": ["kind"]}}},
        ],
        "$defs": {"excitation": {"type": "object", "oneOf": kinds}},
    }  # fmt: skip


def _ending():
    """Kinds of excitation with a finite duration."""
    return [name for name, cls in KINDS.items() if cls.own_duration is not Excitation.own_duration]


def _rules_of_scenes(units):
    """Rules on required and forbidden keys of scenes in `units`, with and without a drawing."""
    tables = {name: cls for name, cls in all_tables().items() if name != "excitation"}
    drawable = {"oscillator", *TRANSDUCERS}
    rules = {name: _rules(cls, units) for name, cls in tables.items()}
    for name in SEVERAL:
        rules[name] = {"items": rules[name], **rules[name]}
    top = {key: False for key, spec in Top.KEYS.items() if units not in spec.units}
    drawn = {name: {"properties": dict.fromkeys(keys, False)} for name, keys in DRAWN.items()}
    return {
        "properties": top | {name: rules[name] for name in rules if name not in drawable},
        "if": {"required": ["beam"]},
        "then": {"properties": dict.fromkeys(TRANSDUCERS, False) | drawn},
        "else": {
            "properties": {"magnets": False} | {name: rules[name] for name in drawable},
            "required": ["oscillator"],
            "oneOf": [{"required": [name]} for name in TRANSDUCERS],
        },
    }


def _rules(cls, units):
    """Rules on required and forbidden keys of a table in scenes with these `units`."""
    usable = [name for name, spec in cls.KEYS.items() if units in spec.units]
    if not usable:
        return False
    return {
        "properties": {name: False for name in cls.KEYS if name not in usable},
        "required": [name for name in usable if cls.KEYS[name].required],
        "allOf": [True] + [rule for group in cls.ALTERNATIVES for rule in _one_of(group, usable)],
    }


def _one_of(group: OneOf, usable: list[str]) -> Iterator[dict]:
    """Rules on alternative keys (at most or exactly one), and on keys that need one of them."""
    keys = [name for name in group.keys if name in usable]
    if group.required:
        yield {"anyOf": [{"required": [name]} for name in keys]}
    yield from ({"not": {"required": list(pair)}} for pair in combinations(keys, 2))
    for name, needed in group.needs.items():
        yield {
            "if": {"required": [name]},
            "then": {"anyOf": [{"required": [other]} for other in needed if other in usable]},
        }


def _kind(name):
    """Schema of one kind of excitation; the first kind is the default and needs no `kind`."""
    cls, named = KINDS[name], name != next(iter(KINDS))
    rules = _rules(cls, SI)
    rules["required"] += ["kind"] if named else []
    return _object(cls.KEYS, {"kind": {"const": name}}) | {
        key: rule for key, rule in rules.items() if key != "properties"
    }


def _object(keys: Mapping[str, Key], extra: Mapping[str, Any] = {}) -> dict[str, Any]:
    """Schema of a table with these keys, all optional."""
    properties = {n: _value(spec) | _description(spec) for n, spec in keys.items() if spec.written}
    return {
        "type": "object", "properties": {**properties, **extra}, "additionalProperties": False
    }  # fmt: skip


def _description(spec):
    """The description of a key with its units, and its default if it has one."""
    units = [f"{spec.unit} in SI"] if spec.unit not in ("", "1") else []
    units += [f"{spec.scaled} in scaled scenes"] if spec.scaled else []
    default = spec.default if isinstance(spec.default, (str, int, float)) else ""
    return {"description": "; ".join([spec.text, *units])} | (
        {} if default == "" else {"default": default}
    )


def _value(spec: Key) -> dict[str, Any]:
    """Schema of a key's values."""
    if spec.element:
        fewest, many = spec.count
        items = _value(spec.element)
        listed = {"type": "array", "minItems": fewest, "maxItems": many, "items": items}
        return {"anyOf": [listed, TEXT]} if spec.file else listed
    if spec.words:
        return {"enum": [*spec.words]}
    if spec.kind is NAMED_VALUES:
        sized = {"type": "number", "minimum": -LARGEST, "maximum": LARGEST}
        return {"type": "object", "additionalProperties": {"anyOf": [sized, TEXT]}}
    if spec.kind is dict:
        return {"$ref": "#/$defs/excitation"}
    if spec.kind is int:
        return {"type": "integer", "minimum": spec.low, "maximum": spec.high}
    if spec.kind is not float:
        named = {"type": "integer", "minimum": 0}
        return TEXT if spec.kind is str else {"anyOf": [TEXT, named]}
    least, most = spec.likely[:2] if spec.likely else (SMALLEST, LARGEST)
    low = max(spec.low, -most) if spec.low_allowed else max(spec.low, least)
    sign = r"^\+?" if spec.low >= 0.0 else "^[+-]?"
    return {
        "anyOf": [
            {"type": "number", "minimum": low, "maximum": min(spec.high, most)},
            {"type": "string", "pattern": sign + SUFFIXED},
        ]
    }
