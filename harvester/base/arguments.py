"""Arguments that many public functions share, checked before anything runs."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from harvester.base.errors import HarvesterError
from harvester.base.plain_text import nearest, shown

if TYPE_CHECKING:
    import numpy as np

# Longest list taken from an iterator, which may have no end.
MOST_VALUES = 100_000
# numpy's defaults for floating-point errors.
USUAL: dict[str, Any] = {"divide": "warn", "over": "warn", "under": "ignore", "invalid": "warn"}


def usual_arithmetic() -> np.errstate:
    """Within the block, numpy's default floating-point warnings, even if the caller set "raise".

    `np.seterr(all="raise")` is meant for the caller's own arithmetic: here a density that
    underflows to 0 is right.
    """
    import numpy as np

    lenient = {name: kind for name, kind in np.geterr().items() if kind in ("ignore", "warn")}
    return np.errstate(**(USUAL | lenient))


def listed(values: Any, where: str, example: str) -> tuple[Any, ...]:
    """The values of a list, also of a generator or an array.

    `example`: a valid value, for the message. Raises HarvesterError for a text, for no list,
    and for a list without an end.
    """
    if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
        raise HarvesterError(f"{where} = {shown(values)}: must be a list; write {example}")
    items = tuple(itertools.islice(values, MOST_VALUES + 1))
    if len(items) > MOST_VALUES:
        raise HarvesterError(f"{where}: has more than {MOST_VALUES} values; give fewer")
    return items


def table(values: Any, where: str, example: str) -> dict[Any, Any]:
    """A dictionary's copy.

    `values`, `where`, `example`: see `listed`. Raises HarvesterError if it is none.
    """
    if not isinstance(values, Mapping):
        raise HarvesterError(f"{where} = {shown(values)}: must be a dictionary; write {example}")
    return dict(values)


def check_name(what: str, name: str, known: Collection[str]) -> str:
    """The name, or HarvesterError with the nearest valid one."""
    if name not in known:
        raise HarvesterError(
            f"unknown {what} {name}{nearest(name, known)}; there are {', '.join(known)}"
        )
    return name


def key_and_values(
    over: Mapping[str, Sequence[float]] | str, values: Sequence[float] | None
) -> tuple[str, Sequence[float]]:
    """The key of a grid along one key, and its values; raises HarvesterError."""
    if isinstance(over, Mapping) and len(over) == 1 and values is None:
        return next(iter(over.items()))
    if isinstance(over, str) and values is not None:
        return over, values
    raise HarvesterError(
        f"--over: {shown(over)}: give one key with its values, "
        "over={'excitation.amplitude': [1.0, 2.0]}; on the command line its name and the option "
        "`values`"
    )


def check_processes(options: Mapping[str, Any]) -> None:
    """Refuse an executor or a runner that takes no calls, by HarvesterError."""
    executor, runner = options.get("executor"), options.get("runner")
    if executor is not None and not hasattr(executor, "submit"):
        raise HarvesterError(
            f"executor = {shown(executor)}: has no method submit; give a "
            "concurrent.futures.Executor"
        )
    runs = hasattr(runner, "answer") or hasattr(getattr(runner, "pool", runner), "map")
    if runner is not None and not runs:
        raise HarvesterError(f"runner = {shown(runner)}: give a WorkerPool or a Runner")


def checked_progress(progress: Callable[[float, str], object]) -> Callable[[float, str], None]:
    """The caller's progress function; an exception in it becomes a HarvesterError that names it."""
    if not callable(progress):
        raise HarvesterError(f"progress = {shown(progress)}: must be a function of two arguments")

    def follow(share: float, words: str) -> None:
        try:
            progress(share, words)
        except HarvesterError:
            raise
        except Exception as error:
            raise HarvesterError(
                f"progress: the function that was given raised {type(error).__name__}: {error}; "
                "mend it, or leave progress out"
            ) from error

    return follow
