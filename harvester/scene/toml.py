"""Read a scene's TOML text as plain Python values, within size limits."""

from __future__ import annotations

import itertools
import numbers
import tomllib
from collections.abc import Iterator
from typing import Any

import numpy as np

from harvester.base.errors import SceneError
from harvester.base.plain_text import named, shown

# Largest scene in bytes. A scene contains no data.
LARGEST_SCENE = 2**18
# Deepest nesting of tables and lists.
DEEPEST = 16
MOST_VALUES = 10_000
LONGEST_TEXT = 4096
# Largest sum over all lines of (number of dots)². The time to read a dotted key grows with the
# square of the number of its parts.
MOST_DOTS_SQUARED = 4_000_000


class NotToml(SceneError):
    """A text is not valid TOML."""


def read_toml(text: str, origin: str) -> dict[str, Any]:
    """Nested dictionaries of a TOML text. Raises SceneError."""
    if len(text) > LARGEST_SCENE:
        raise SceneError(
            f"{origin}: too long: {len(text)} characters; must be at most {LARGEST_SCENE}"
        )
    if sum(line.count(".") ** 2 for line in text.split("\n")) > MOST_DOTS_SQUARED:
        raise SceneError(f"{origin}: not a TOML file: a line with too many dots")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise NotToml(f"{origin}: not a TOML file: {named(' '.join(str(error).split()))}") from None
    except RecursionError:
        raise SceneError(
            f"{origin}: tables or lists are nested too deeply: must be at most {DEEPEST} levels"
        ) from None
    # Python limits the length of integers.
    except ValueError:
        raise SceneError(f"{origin}: a number has too many digits: write fewer") from None


def plain_tables(tables: dict[str, Any], origin: str) -> dict[str, Any]:
    """Copy nested dictionaries and convert numpy's numbers to Python's.

    Values of other types are kept; the check of their key rejects them.

    Raises SceneError for tables nested too deeply, too many values, a text that is too long, or a
    key that is not a text.
    """
    if not isinstance(tables, dict):
        raise SceneError(f"{origin}: a scene must be a dictionary of tables, not {shown(tables)}")
    count = itertools.count(1)

    def copy(value, where, depth):
        if next(count) > MOST_VALUES or depth > DEEPEST:
            limit = f"more than {MOST_VALUES} values" if depth <= DEEPEST else "nested too deeply"
            raise SceneError(f"{origin}: {limit}, at {named(where)}: shorten the scene")
        if isinstance(value, dict):
            for key in value:
                if not isinstance(key, str) or named(key) != key:
                    owner = named(where) if where else "the scene"
                    raise SceneError(
                        f"{origin}: {owner} has the key {shown(key)}, which is not a name"
                    )
            return {
                str(name): copy(item, f"{where}.{name}" if where else name, depth + 1)
                for name, item in value.items()
            }
        if isinstance(value, (list, tuple)):
            return [copy(item, f"{where}[{k}]", depth + 1) for k, item in enumerate(value)]
        if not isinstance(value, str):
            return _plain_number(value)
        if len(value) > LONGEST_TEXT or "\0" in value:
            fault = "holds a NUL character" if "\0" in value else f"is longer than {LONGEST_TEXT}"
            raise SceneError(f"{origin}: {named(where)} = {shown(value)}: the text {fault}")
        return str(value)

    return copy(tables, "", 0)


def parts_of(table: Any, where: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield a table and its name, then its `parts` recursively; skip invalid values."""
    if isinstance(table, dict):
        yield where, table
        parts = table.get("parts")
        for index, part in enumerate(parts if isinstance(parts, list) else ()):
            yield from parts_of(part, f"{where}.parts[{index}]")


def _plain_number(value):
    """Convert a number of numpy or fractions to Python's; return other values unchanged."""
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    try:
        if isinstance(value, numbers.Integral):
            return int(value)
        if isinstance(value, numbers.Real):
            return float(value)
    except (OverflowError, ZeroDivisionError):
        pass
    return value
