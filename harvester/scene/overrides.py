"""Change values of a scene by dotted keys.

A key is `table.key`, `table[k].key` in a repeated table, or `table.key[k]` in a list of numbers.
"""

from __future__ import annotations

import math
import re
from typing import Any

from harvester.base.errors import SceneError
from harvester.base.plain_text import named, nearest, shown
from harvester.device.keys import NAMED_VALUES, class_of
from harvester.excitation import KINDS
from harvester.scene.tables import SEVERAL, all_tables, key_named
from harvester.scene.toml import NotToml, read_toml

# A name with an index in brackets.
PLACED = re.compile(r"([^\[\]]+)\[(\d{1,6})\]")
# Matches texts in quotes.
QUOTED = re.compile(r"""("[^"]*"|'[^']*')""")
# Match a decimal point without a digit before it, and one without a digit after it.
NO_DIGIT_BEFORE, NO_DIGIT_AFTER = (
    re.compile(r"(?<![\w.])\.(?=\d)"),
    re.compile(r"(?<=\d)\.(?![\w.])"),
)


def texts(overrides: Any) -> list[str]:
    """A list of `table.key=value`; raise SceneError if an item is not a text."""
    try:
        listed = [overrides] if isinstance(overrides, str) else list(overrides)
    except TypeError:
        listed = [overrides]
    for text in listed:
        if not isinstance(text, str):
            raise SceneError(f"--set {shown(text)}: write it as table.key=value")
    return listed


def parsed(text: str) -> tuple[str, Any]:
    """(key, value) of one override; None removes the table."""
    key, separator, value = text.partition("=")
    key, value = key.strip(), value.strip()
    if not separator or not key or not value:
        raise SceneError(f"--set {named(text)}: write it as table.key=value")
    if value.lower() == "none":
        return key, None
    refusal = None
    for spelling in (value, _with_digits(value)):
        try:
            read = read_toml(f"value = {spelling}", f"--set {named(key)}")
        except NotToml as error:
            # Otherwise a mistyped table or list would be rejected as a text of the wrong type.
            if value.startswith("{") or (value.startswith("[") and value.endswith("]")):
                refusal = SceneError(
                    str(error).replace("not a TOML file", f"{named(value)} is no TOML")
                )
            continue
        # A value that holds a line break would define further keys.
        return key, read["value"] if len(read) == 1 else value
    if refusal:
        raise refusal
    return key, _number(value)


def _with_digits(text):
    """The text with .1 and 1. outside its quotes written as TOML's 0.1 and 1.0."""
    parts = QUOTED.split(text)
    for index in range(0, len(parts), 2):
        parts[index] = NO_DIGIT_AFTER.sub(".0", NO_DIGIT_BEFORE.sub("0.", parts[index]))
    return "".join(parts)


def _number(text):
    """Read a number that TOML rejects, such as 007 or 1.e3; return other texts unchanged."""
    for kind in (int, float):
        try:
            number = kind(text)
        except ValueError:
            continue
        # "infinity" and "nan" remain texts, which no key accepts as a number.
        return number if math.isfinite(number) else text
    return text


def put_all(tables: dict[str, Any], changes: dict[str, Any], origin: str) -> None:
    """Set dotted keys one after another; raise SceneError if one removes an earlier one."""
    done: list[str] = []
    for dotted, value in changes.items():
        removed = put(tables, dotted, value, origin)
        lost = next((key for key in done if key.partition("[")[0] in removed), None)
        if lost:
            raise SceneError(
                f"{origin} {named(lost)} and {named(dotted)} exclude each other: keep one"
            )
        if value is not None:
            done.append(dotted)


def put(tables: dict[str, Any], dotted: str, value: Any, origin: str) -> set[str]:
    """Set one dotted key in nested dictionaries; None removes it.

    Returns the other dotted keys that the change removes.
    """
    removed = set()
    if not isinstance(dotted, str):
        raise SceneError(f"{origin} {shown(dotted)}: a key must be a text, table.key")
    where = f"{origin} {named(dotted)}"
    *path, last = dotted.split(".")
    nested = key_named(".".join(path)).kind is NAMED_VALUES
    if len(path) > 1 and not nested and "[" not in dotted:
        raise SceneError(f"{where}: too many dots; write it as table.key=value")
    table = tables
    for part in path:
        table = _table(table, part, where)
    is_kind = dotted == "excitation.kind" and isinstance(value, str) and value in KINDS
    if is_kind and value != table.get("kind", next(iter(KINDS))):
        # Remove the keys that the new kind does not have.
        for key in {*table} - {"kind", *KINDS[value].KEYS}:
            del table[key]
            removed.add(key)
    if value is not None and len(path) == 1:
        # Remove other keys for the same property.
        cls = class_of(all_tables()[path[0]], table) if path[0] in all_tables() else None
        groups = getattr(cls, "ALTERNATIVES", ())
        for other in set().union(*(group.replaced_by(last) for group in groups)):
            if table.pop(other, None) is not None:
                removed.add(other)
    if last == "file":
        table.pop("sha256", None)
    name, index = _placed(last)
    values = table.get(name)
    is_list = isinstance(values, (list, tuple)) and not any(isinstance(v, dict) for v in values)
    if index is not None and (value is None or is_list):
        several = _several(table, name, index, where)
        several[index : index + 1] = [] if value is None else [value]
        # A list without values is removed with its key.
        last, value = name, several or None
    if not path and isinstance(values, dict):
        removed = {*values} - {*(value if isinstance(value, dict) else ())}
    if value is None:
        table.pop(last, None)
    else:
        table[last] = value
    return {".".join([*(path or [last]), key]) for key in removed}


def _placed(part):
    """Name and index of a part of a dotted key; the index is None if there is none."""
    match = PLACED.fullmatch(part)
    return (match[1], int(match[2])) if match else (part, None)


def _table(tables, part, where):
    """The table `name` or `name[k]`; a table that is not repeated has the index 0."""
    name, index = _placed(part)
    value = tables.setdefault(name, {}) if index is None else tables.get(name)
    if index is None and isinstance(value, (list, tuple)) and value:
        if len(value) > 1:
            raise SceneError(
                f"{where}: {named(part)} is several tables, {_listed(part, len(value))}; say which"
            )
        index = 0
    if index is not None:
        tables[name] = _several(tables, name, index, where)
        value = tables[name][index]
    if not isinstance(value, dict):
        raise SceneError(f"{where}: {named(part)} is not a table{nearest(part, all_tables())}")
    return value


def _several(tables, name, index, where):
    """The list of a name's tables or values; raise SceneError if it has no such index."""
    entry = tables.get(name)
    if isinstance(entry, dict) and name in SEVERAL and index == 0:
        return [entry]
    if not isinstance(entry, (list, tuple)):
        present = f"no {named(name)} here{nearest(name, tables)}" if entry is None else "one table"
        hint = "" if entry is None else f"; write {named(name)}.key"
        raise SceneError(f"{where}: there is {present}{hint}")
    if index >= len(entry):
        raise SceneError(
            f"{where}: there are {len(entry)} of {named(name)}: {_listed(name, len(entry))}"
        )
    return [dict(item) if isinstance(item, dict) else item for item in entry]


def _listed(name, count):
    """The first and the last of the indexed names, as text."""
    first, last = f"{named(name)}[0]", f"{named(name)}[{count - 1}]"
    return first if count == 1 else f"{first} {'…' if count > 2 else 'and'} {last}"
