"""Calling convention of public functions: the scene first, options by keyword."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Container, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeAlias, TypeVar, Union

from harvester.base.arguments import (
    check_known,
    check_processes,
    checked_progress,
    usual_arithmetic,
)
from harvester.base.errors import UnknownOption
from harvester.base.notebook import progress_bar
from harvester.base.plain_text import shown
from harvester.base.signatures import KEYWORD, check_options, named_as_called, options_of

if TYPE_CHECKING:
    from harvester.scene.model import Scene

# Written as text, so that importing a module with public functions imports no scene and no numba.
SceneOrName: TypeAlias = Union["Scene", str, Path]

Options = ParamSpec("Options")
Answer = TypeVar("Answer")


def scene_of(scene: SceneOrName, overrides: Any = ()) -> Scene:
    """A scene unchanged, or read from its file or by its built-in name, with `overrides`.

    Raises
    ------
    SceneError
    """
    from harvester.scene.model import Scene

    source: Any = scene
    return source if isinstance(scene, Scene) and not overrides else Scene.read(source, overrides)


@contextlib.contextmanager
def _with_progress(
    name: str, accepted: Container[str], options: dict[str, Any]
) -> Iterator[dict[str, Any]]:
    """Yield a call's options, in a notebook with a progress bar unless `progress=False`."""
    progress = options.get("progress")
    if progress is not None:
        yield {**options, "progress": None if progress is False else checked_progress(progress)}
    elif "progress" not in accepted or options.get("runner"):
        yield options
    else:
        with progress_bar(name) as bar:
            yield {**options, "progress": bar}


def _reject_misnamed(function, option, accepted):
    """Raise UnknownOption with a hint if `option` is a scene key or a command-line spelling."""
    from harvester.scene.tables import all_keys

    keys = [repr(key) for key in all_keys() if key.partition(".")[2] == option]
    value = f"; it is a value of the scene: scene.replace({{{' or '.join(keys)}: …}})"
    hints = {option: value} if keys else {}
    hints |= {item.kind.option: f" (did you mean {name}?)" for name, item in accepted.items()}
    if option in hints:
        raise UnknownOption(f"{function}: no option {option}{hints[option]}")


def checked(function: Callable[Options, Answer]) -> Callable[Options, Answer]:
    """Check the options of a public function, and show its progress in a notebook.

    An unknown option raises `UnknownOption`, which names the nearest valid option. Values are
    checked against the annotations (`harvester.base.signatures`).
    """
    name = function.__name__

    @functools.wraps(function)
    def called(*arguments: Options.args, **options: Options.kwargs) -> Answer:
        accepted = options_of(function)
        by_keyword = [n for n, item in accepted.items() if item.passing is KEYWORD]
        surplus = arguments[len(accepted) - len(by_keyword) :]
        if surplus:
            raise UnknownOption(
                f"{name}: {shown(surplus[0])} is given without its name: options are given as "
                f"{[*by_keyword, 'none'][0]}=…; there are {', '.join(by_keyword)}"
            )
        for option in options.keys() - accepted.keys():
            _reject_misnamed(name, option, accepted)
        check_known(name, options, [item for item in accepted if item != "scene"])
        with (
            usual_arithmetic(),
            named_as_called(function),
            _with_progress(name, accepted, options) as values,
        ):
            check_options(function, values)
            check_processes(values)
            return function(*arguments, **values)

    return called


def takes_scene(
    function: Callable[Concatenate[Scene, Options], Answer],
) -> Callable[Concatenate[SceneOrName, Options], Answer]:
    """Let a function also accept a scene's file path or built-in name; see `checked`."""
    of_scene = checked(function)

    @functools.wraps(function)
    def called(scene: SceneOrName, *arguments: Options.args, **options: Options.kwargs) -> Answer:
        with usual_arithmetic():
            return of_scene(scene_of(scene), *arguments, **options)

    return called
