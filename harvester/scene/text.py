"""A scene as a TOML file, each value with a comment."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from harvester.base.plain_text import one_line
from harvester.scene.tables import key_named, rows_of

if TYPE_CHECKING:
    from harvester.scene.model import Scene

# Column at which comments begin.
COMMENTS = 34


def scene_text(scene: Scene, comments: dict[str, str], heading: list[str]) -> str:
    """TOML of a scene.

    Parameters
    ----------
    comments : dict of str to str
        Comments on numbers by their keys: `table.key`, `table[n].key` or `table.key[n]`.
    heading : list of str
        Comment lines at the top.
    """
    from circuits.netlist.subcircuits import load_names

    tables = scene.to_tables()
    # The text may be written into any folder, so the path must be absolute. A record's is.
    if scene.load.netlist and scene.load.netlist not in load_names():
        tables["load"]["netlist"] = str(scene.load.circuit.source[0].absolute())
    lines = [f"# {one_line(text)}" for text in heading]
    lines += [f"{key} = {_value(v)}" for key, v in tables.items() if not _is_table(v)]
    for name, table in tables.items():
        if isinstance(table, dict):
            lines += ["", f"[{name}]", *_entries(name, table, comments)]
        elif _is_table(table):
            for index, row in enumerate(table):
                lines += ["", f"[[{name}]]", *_entries(f"{name}[{index}]", row, comments)]
    return "\n".join(lines) + "\n"


def key_comments(scene: Scene) -> dict[str, str]:
    """Comments on all keys of a scene: unit and description."""
    comments = {}
    for table, cls, values in rows_of(scene.to_tables()):
        for key in values:
            spec = cls.KEYS.get(key) or key_named(f"{table}.{key}")
            unit = spec.unit_in(scene.units)
            words = ("" if unit == "1" else unit, spec.text.replace(":", ",", 1))
            comments[f"{table}.{key}"] = "  ".join(filter(None, words))
    return comments


def _is_table(value):
    return isinstance(value, dict) or (
        isinstance(value, (list, tuple)) and bool(value) and isinstance(value[0], dict)
    )


def _entries(table, values, comments):
    lines = []
    for key, value in values.items():
        name = f"{table}.{key}"
        if isinstance(value, (list, tuple)) and any(f"{name}[{n}]" in comments for n in range(8)):
            lines.append(f"{key} = [")
            lines += [
                _commented(f"    {_value(item)},", comments.get(f"{name}[{n}]", ""))
                for n, item in enumerate(value)
            ]
            lines.append("]")
        else:
            lines.append(_commented(f"{key} = {_value(value)}", comments.get(name, "")))
    return lines


def _commented(text, comment):
    return f"{text:<{COMMENTS}} # {one_line(comment)}" if comment else text


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        # JSON strings are valid TOML strings, except for the character DEL.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {_value(v)}" for k, v in value.items()) + "}"
    return repr(value)
