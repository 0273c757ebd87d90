"""How public functions are called: the scene first, however it is named, options by keyword."""

from __future__ import annotations

import contextlib
import functools
import inspect
from collections.abc import Callable, Container, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeAlias, TypeVar, Union

from harvester.base.arguments import checked_options, usual_arithmetic
from harvester.base.errors import UnknownOption
from harvester.base.notebook import progress_bar
from harvester.base.plain_text import nearest, shown
from harvester.base.signatures import check_options, named_as_called, options_of

if TYPE_CHECKING:
    from harvester.scene.model import Scene

# Written as text, so that importing a module with public functions imports no scene and no numba.
SceneOrName: TypeAlias = Union["Scene", str, Path]
KEYWORD_ONLY = inspect.Parameter.KEYWORD_ONLY

Options = ParamSpec("Options")
Answer = TypeVar("Answer")


def scene_of(scene: SceneOrName) -> Scene:
    """A scene as it is, or read from its file or by its built-in name.

    Raises
    ------
    SceneError
    """
    from harvester.scene.model import Scene

    return scene if isinstance(scene, Scene) else Scene.read(scene)


@contextlib.contextmanager
def shown_progress(
    name: str, accepted: Container[str], options: dict[str, Any]
) -> Iterator[dict[str, Any]]:
    """The options of a call, in a notebook with a progress bar; `progress=False` leaves it out."""
    if options.get("progress") is False:
        yield {key: value for key, value in options.items() if key != "progress"}
    elif "progress" not in accepted or options.get("progress") or options.get("runner"):
        yield options
    else:
        with progress_bar(name) as bar:
            yield {**options, "progress": bar} if bar else options


def takes_scene(
    function: Callable[Concatenate[Scene, Options], Answer],
) -> Callable[Concatenate[SceneOrName, Options], Answer]:
    """Let a function of a scene take a file's path or a built-in name too.

    An option that it does not have is refused with the nearest one, by `UnknownOption`. Values are
    checked by what the annotations say (`harvester.base.signatures`).
    """
    name = function.__name__

    @functools.wraps(function)
    def called(scene: SceneOrName, *arguments: Any, **options: Any) -> Answer:
        accepted = options_of(function)
        by_keyword = [
            n for n, item in accepted.items() if item.passing is inspect.Parameter.KEYWORD_ONLY
        ]
        by_place = len(accepted) - len(by_keyword)
        surplus = arguments[by_place - 1 :]
        if surplus:
            raise UnknownOption(
                f"{name}: {shown(surplus[0])} stands without its name: options are given as "
                f"{[*by_keyword, 'none'][0]}=…; there are {', '.join(by_keyword)}"
            )
        for option in options:
            if option not in accepted:
                names = [*accepted][1:]
                same = [n for n in names if accepted[n].kind.option == option]
                hint = f" (did you mean {same[0]}?)" if same else nearest(option, names)
                hint = hint or f"; there are {', '.join(names)}"
                raise UnknownOption(f"{name}: no option {option}{hint}")
        with (
            usual_arithmetic(),
            named_as_called(function),
            shown_progress(name, accepted, options) as options,
        ):
            scene = scene_of(scene)
            check_options(function, options)
            return function(scene, *arguments, **checked_options(options))

    return called
