"""Find a scene by a built-in name or a file, and resolve the paths of its files."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from harvester.base.errors import SceneError
from harvester.base.plain_text import named, nearest, shown
from harvester.base.reading import read_input
from harvester.device.keys import every_key
from harvester.scene.overrides import parsed, put_all, texts
from harvester.scene.tables import all_tables
from harvester.scene.toml import LARGEST_SCENE, parts_of, read_toml

# Keys that may name a file.
FILES = {
    name for cls in all_tables().values() for name, spec in every_key(cls).items() if spec.file
}
BUILT_IN = Path(__file__).parent / "scenes"


def built_in_names() -> list[str]:
    """Names of the built-in scenes, sorted."""
    return sorted(path.stem for path in BUILT_IN.glob("*.toml"))


def tables_of(
    source: str | Path, overrides: Iterable[str] | dict[str, Any]
) -> tuple[dict[str, Any], Path]:
    """Read a scene's tables, apply the overrides, and return them with the scene's path.

    `source`, `overrides`: see `harvester.scene.model.Scene.read`. Raises SceneError.
    """
    path = _find(source)
    where = named(str(path))
    try:
        text = read_input(path, "scene", LARGEST_SCENE).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SceneError(f"{where}: not a TOML file: {error}; save it as UTF-8") from None
    tables = read_toml(text, where)
    for name in ("excitation", "oscillator"):
        for _, table in parts_of(tables.get(name)):
            # Files that a scene names are relative to its own folder.
            for key in FILES & {*table}:
                if isinstance(table[key], str):
                    table[key] = str(path.parent / table[key])
    changes = overrides if isinstance(overrides, dict) else dict(map(parsed, texts(overrides)))
    put_all(tables, changes, "--set")
    return tables, path


def _find(source):
    """Path of a scene's file. A file of the same name does not replace a built-in scene."""
    if not isinstance(source, (str, Path)):
        tables = ", or Scene.from_tables(…)" * isinstance(source, Mapping)
        raise SceneError(
            f"{shown(source)}: not a scene; give a name or a path{tables}: {_listed()}"
        )
    if str(source) in built_in_names():
        return BUILT_IN / f"{source}.toml"
    path, where = Path(source), named(str(source))
    if os.path.exists(path):
        return path
    hint = nearest(path.name, [*built_in_names(), *_neighbouring_scenes(path)])
    noun = "scene file" if path.suffix == ".toml" else "scene"
    raise SceneError(f"{where}: no such {noun}{hint}; built in are {_listed()}")


def _neighbouring_scenes(path):
    """Names of the scene files in a path's folder."""
    try:
        return sorted(file.name for file in path.parent.glob("*.toml"))
    except (OSError, ValueError):
        return []


def _listed():
    return ", ".join(built_in_names())
