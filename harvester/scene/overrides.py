"""Values of a scene by dotted keys.

`table.key`, `table[k].key` of one of several tables, or `table.key[k]` of a list of numbers.
"""

from __future__ import annotations

import math
import re
from typing import Any

from harvester.errors import SceneError
from harvester.excitation import KINDS
from harvester.files.plain_text import named, nearest, shown
from harvester.scene.schema import NESTED_TABLES, REPLACED_KEYS, SEVERAL, table_keys
from harvester.scene.toml import NotToml, read_toml

# A table's name, with an index in brackets if there are several.
PLACED = re.compile(r"([^\[\]]+)\[(\d{1,6})\]")
# Matches texts in quotes.
QUOTED = re.compile(r"""("[^"]*"|'[^']*')""")
# Match a decimal point without a digit before it, and one without a digit after it.
NO_DIGIT_BEFORE, NO_DIGIT_AFTER = (
    re.compile(r"(?<![\w.])\.(?=\d)"),
    re.compile(r"(?<=\d)\.(?![\w.])"),
)


def texts(overrides: Any) -> list[str]:
    """A list of `table.key=value`, checked to be texts."""
    try:
        found = [overrides] if isinstance(overrides, str) else list(overrides)
    except TypeError:
        found = [overrides]
    for text in found:
        if not isinstance(text, str):
            raise SceneError(f"--set {shown(text)}: write it as table.key=value")
    return found


def parsed(text: str) -> tuple[str, Any]:
    """(key, value) of one override; None stands for "take it out"."""
    key, separator, value = text.partition("=")
    key, value = key.strip(), value.strip()
    if not separator or not key or not value:
        raise SceneError(f"--set {named(text)}: write it as table.key=value")
    if value.lower() == "none":
        return key, None
    for spelling in (value, _with_digits(value)):
        try:
            read = read_toml(f"value = {spelling}", f"--set {named(key)}")
        except NotToml:
            continue
        # A value that holds a line break would define further keys.
        return key, read["value"] if len(read) == 1 else value
    return key, _number(value)


def _with_digits(text):
    """The text with 0.1 for .1 and 1.0 for 1. outside its quotes, as TOML writes them."""
    parts = QUOTED.split(text)
    for place in range(0, len(parts), 2):
        parts[place] = NO_DIGIT_AFTER.sub(".0", NO_DIGIT_BEFORE.sub("0.", parts[place]))
    return "".join(parts)


def _number(text):
    """A number in a form that TOML does not know, such as 007 or 1.e3; other words as they are."""
    for kind in (int, float):
        try:
            number = kind(text)
        except ValueError:
            continue
        # "infinity" and "nan" stay words, which no key accepts as a number.
        return number if math.isfinite(number) else text
    return text


def put(tables: dict[str, Any], dotted: str, value: Any, origin: str) -> None:
    """Set one dotted key in nested dictionaries; None removes it. `name[k]` is one of several."""
    if not isinstance(dotted, str):
        raise SceneError(f"{origin} {shown(dotted)}: a key is a text, table.key")
    where = f"{origin} {named(dotted)}"
    *path, last = dotted.split(".")
    if len(path) > 1 and ".".join(path) not in NESTED_TABLES and "[" not in dotted:
        raise SceneError(f"{where}: too many dots; write it as table.key=value")
    place = tables
    for part in path:
        place = _table(place, part, where)
    if dotted == "excitation.kind":
        _leave_out_others(place, value)
    for other in REPLACED_KEYS.get(dotted, ()) if value is not None else ():
        place.pop(other, None)
    match = PLACED.fullmatch(last)
    if match and value is None:
        _one_of(place, match.group(1), int(match.group(2)), where)
        _without(place, match.group(1), int(match.group(2)))
    elif match and _is_list_of_values(place.get(match.group(1))):
        _put_in_list(place, match.group(1), int(match.group(2)), value, where)
    elif value is None:
        place.pop(last, None)
    else:
        place[last] = value


def _leave_out_others(table, kind):
    """Remove the keys from an excitation's table that its new kind does not have."""
    if isinstance(kind, str) and kind in KINDS and kind != table.get("kind", next(iter(KINDS))):
        for key in {*table} - {"kind", *KINDS[kind].KEYS}:
            del table[key]


def _is_list_of_values(found):
    """Whether it is a list such as `restoring_force`, and not one of tables."""
    return isinstance(found, (list, tuple)) and not any(isinstance(each, dict) for each in found)


def _put_in_list(place, name, index, value, where):
    values = list(place[name])
    if index >= len(values):
        raise SceneError(
            f"{where}: there are {len(values)} of {named(name)}: {_listed(name, len(values))}"
        )
    values[index] = value
    place[name] = values


def _table(place, part, where):
    """The table of a name, or of `name[k]` the k-th of several, one table counting as the first."""
    match = PLACED.fullmatch(part)
    if match:
        return _one_of(place, match.group(1), int(match.group(2)), where)
    found = place.setdefault(part, {})
    if isinstance(found, (list, tuple)) and len(found) == 1:
        return _one_of(place, part, 0, where)
    if isinstance(found, (list, tuple)) and found:
        raise SceneError(
            f"{where}: {named(part)} is several tables, {_listed(part, len(found))}; say which"
        )
    if not isinstance(found, dict):
        raise SceneError(f"{where}: {named(part)} is not a table{nearest(part, table_keys())}")
    return found


def _one_of(place, name, index, where):
    found = place.get(name)
    if isinstance(found, dict) and name in SEVERAL and index == 0:
        return found
    if not isinstance(found, (list, tuple)):
        there = f"no {named(name)} here{nearest(name, place)}" if found is None else "one table"
        hint = "" if found is None else f"; write {named(name)}.key"
        raise SceneError(f"{where}: there is {there}{hint}")
    if index >= len(found) or not all(isinstance(each, dict) for each in found):
        raise SceneError(
            f"{where}: there are {len(found)} of {named(name)}: {_listed(name, len(found))}"
        )
    place[name] = [dict(each) for each in found]
    return place[name][index]


def _listed(name, count):
    """The names of several tables."""
    first, last = f"{named(name)}[0]", f"{named(name)}[{count - 1}]"
    return first if count == 1 else f"{first} {'…' if count > 2 else 'and'} {last}"


def _without(place, name, index):
    """Remove one of several tables; if it is the only one, the key goes too."""
    several = place.pop(name)
    if isinstance(several, dict) or len(several) == 1:
        return
    place[name] = [each for k, each in enumerate(several) if k != index]
