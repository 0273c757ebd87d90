"""How public functions are called: the scene first, however it is named, options by keyword."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeAlias, TypeVar, get_args, get_type_hints

from harvester.arguments import checked_options, usual_arithmetic
from harvester.errors import UnknownOption
from harvester.files.plain_text import nearest, shown
from harvester.scene.model import Scene

SceneOrName: TypeAlias = Scene | str | Path
# What options were called before one convention held for all functions.
FORMER_NAMES = {"engine": "method", "closure": "method", "pool": "runner"}

Options = ParamSpec("Options")
Answer = TypeVar("Answer")


def scene_of(scene: SceneOrName) -> Scene:
    """A scene as it is, or read from its file or by its built-in name.

    Raises
    ------
    SceneError
    """
    return scene if isinstance(scene, Scene) else Scene.load(scene)


def takes_scene(
    function: Callable[Concatenate[Scene, Options], Answer],
) -> Callable[Concatenate[SceneOrName, Options], Answer]:
    """Let a function of a scene take a file's path or a built-in name too.

    An option it does not have is refused with the nearest one, by `UnknownOption`; those that run
    it are checked by `harvester.arguments.checked_options`.
    """
    parameters = inspect.signature(function).parameters.values()
    by_place = [each.name for each in parameters if each.kind is each.POSITIONAL_OR_KEYWORD]
    known = [*by_place, *_by_keyword(function)]
    name = function.__name__

    @functools.wraps(function)
    def called(scene: SceneOrName, *arguments: Any, **options: Any) -> Answer:
        surplus = arguments[len(by_place) - 1 :]
        if surplus:
            named = known[len(by_place)] if len(known) > len(by_place) else "none"
            raise UnknownOption(
                f"{name}: {shown(surplus[0])} stands without its name: options are given as "
                f"{named}=…; there are {', '.join(known[len(by_place) :])}"
            )
        for option in options:
            if option not in known:
                raise UnknownOption(f"{name}: no option {option}{_meant(option, known)}")
        with usual_arithmetic():
            return function(scene_of(scene), *arguments, **checked_options(options))

    return called


def _by_keyword(function: Callable) -> list[str]:
    """Names of a function's keywords, with those of the typed dictionary that collects others."""
    names: list[str] = []
    for each in inspect.signature(function).parameters.values():
        if each.kind is each.KEYWORD_ONLY:
            names.append(each.name)
        elif each.kind is each.VAR_KEYWORD:
            (collected,) = get_args(get_type_hints(function)[each.name])
            names += collected.__annotations__
    return names


def _meant(option: str, known: list[str]) -> str:
    """The option that may be meant, in words, or all of them."""
    former = FORMER_NAMES.get(option)
    hint = f" (did you mean {former}?)" if former in known else nearest(option, known)
    return hint or f"; there are {', '.join(known[1:])}"
