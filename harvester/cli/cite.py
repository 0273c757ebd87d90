"""`harvester cite`: the literature sources of all methods, or of those that a result used."""

from __future__ import annotations

import tomllib
from importlib import resources
from typing import Any

from harvester.base.errors import HarvesterError
from harvester.base.plain_text import named
from harvester.base.reading import read_json
from harvester.base.signatures import File


def cite(result: File | None = None, /) -> None:
    """Print the literature sources of the methods that a result used.

    Parameters
    ----------
    result : str or None
        JSON of simulate, average or validate (default: the sources of all methods).

    Examples
    --------
    ::

        harvester cite results/paper-validate.json
    """
    for source in sources_of(read_json(result), named(result)) if result else all_sources():
        print(f"{source['method']}:\n    {source['reference']}")


def all_sources() -> list[dict[str, Any]]:
    """All sources: `method`, `reference` and the condition under which a result uses them."""
    text = resources.files("harvester.cli").joinpath("sources.toml").read_text("utf-8")
    return tomllib.loads(text)["source"]


def sources_of(content: Any, name: str = "the content") -> list[dict[str, Any]]:
    """Sources of the methods that the JSON of a result or a comparison used.

    `name`: of the file, for errors.

    Raises
    ------
    HarvesterError
        `content` is not such a JSON.
    """
    content = content if isinstance(content, dict) else {}
    scene, results = content.get("scene"), content.get("results")
    engines = [*results] if isinstance(results, dict) and results else [content.get("engine")]
    if not isinstance(scene, dict) or not all(isinstance(engine, str) for engine in engines):
        raise HarvesterError(
            f"{name}: contains no scene and engine; give the JSON of simulate, average or validate"
        )
    return [source for source in all_sources() if _is_used(source, scene, engines)]


def _is_used(source, scene, engines):
    """Whether a result of these engines on this scene uses a source of `sources.toml`."""
    value = scene
    for name in source["key"].split(".") if "key" in source else ():
        value = value.get(name) if isinstance(value, dict) else None
    return (
        value is not None
        and value in source.get("values", [value])
        and scene.get("name") != source.get("not_scene", "")
        and any(part in engine for part in source.get("engines", [""]) for engine in engines)
    )
