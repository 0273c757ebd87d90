"""Checks of arguments that many public functions share."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import TYPE_CHECKING, Any

from harvester.base.errors import HarvesterError, UnknownOption, UnknownQuantity
from harvester.base.numbers import is_real, is_whole, on_quotes
from harvester.base.plain_text import named, nearest, shown

if TYPE_CHECKING:
    import numpy as np

# Largest number of values taken from an iterator, which may be endless.
MOST_VALUES = 100_000
# If the last of three values is at least this, they may be meant as a range with a number of
# points.
FEWEST_POINTS = 3
# Most names listed in a message, and most rows of a table.
MOST_NAMED, FEW_ROWS = 60, 2
# Numbers that differ by at most this share are the same key.
ROUNDING = 1e-9
# numpy's defaults for floating-point errors.
USUAL: dict[str, Any] = {"divide": "warn", "over": "warn", "under": "ignore", "invalid": "warn"}


def usual_arithmetic() -> np.errstate:
    """Use numpy's default floating-point warnings within the block, even if the caller set "raise".

    `np.seterr(all="raise")` is meant for the caller's arithmetic: here a density may underflow to
    0.
    """
    import numpy as np

    lenient = {name: kind for name, kind in np.geterr().items() if kind in ("ignore", "warn")}
    return np.errstate(**(USUAL | lenient))


def listed(values: Any, where: str, example: str, kind: type = object) -> tuple[Any, ...]:
    """The values of a list, generator or array as a tuple.

    `example`: a valid list, for messages; `kind`: class of all values. Raises HarvesterError for a
    text or another object that is not a list, a value of another kind, and an endless list.
    """
    if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
        raise HarvesterError(f"{where} = {shown(values)}: must be a list; write {example}")
    items = tuple(itertools.islice(values, MOST_VALUES + 1))
    if len(items) > MOST_VALUES:
        raise HarvesterError(f"{where}: has more than {MOST_VALUES} values; give fewer")
    wrong = [item for item in items if not isinstance(item, kind)]
    if wrong:
        raise HarvesterError(f"{where}: {shown(wrong[0])}: is no {kind.__name__}; write {example}")
    if len(items) == 3 and all(map(is_real, items)) and is_whole(items[2], FEWEST_POINTS):
        low, high, count = items
        # A tuple of whole numbers, or a whole number after two others, may be meant as a range.
        mixed = isinstance(values, tuple) or not all(is_whole(item, item) for item in items)
        if mixed and not math.isclose(high - low, count - high):
            read = f"{low:g}, {high:g}, {count}"
            raise HarvesterError(
                f"{where} = {shown(values)}: three values or a range? write [{read}.0], or "
                f"numpy.linspace({read})"
            )
    return items


def real_numbers(values: Any, where: str, example: str) -> tuple[float, ...]:
    """At least one finite number; `values`, `where`, `example`: see `listed`."""
    items = listed(values, where, example)
    for item in items:
        if not (is_real(item) and math.isfinite(item)):
            raise HarvesterError(f"{where}: {shown(item)}: must be a number{on_quotes(item)}")
    if not items:
        raise HarvesterError(f"{where}: is empty; write {example}")
    return tuple(map(float, items))


def table(values: Any, where: str, example: str) -> dict[Any, Any]:
    """A copy of a dictionary.

    `values`, `where`, `example`: see `listed`. Raises HarvesterError if it is not a dictionary.
    """
    if not isinstance(values, Mapping):
        raise HarvesterError(f"{where} = {shown(values)}: must be a dictionary; write {example}")
    return dict(values)


def unknown(text: str, name: object, known: Iterable[Any], kind: type = HarvesterError) -> Any:
    """An error about an unknown name, with the nearest valid name and a list of all."""
    names = [str(item) for item in itertools.islice(known, MOST_NAMED + 1)]
    listed_names = ", ".join([*names[:MOST_NAMED], *["…"] * (len(names) > MOST_NAMED)]) or "none"
    return kind(f"{text} {named(name)}{nearest(name, names)}; there are {listed_names}")


def no_attribute(text: str, name: str, known: Iterable[str]) -> AttributeError:
    """The error about a missing attribute; `text`, `known`: see `unknown`.

    Python, numpy and notebooks look up names with an underscore: these get no suggestion.
    """
    private = name.startswith("_")
    return AttributeError(name) if private else unknown(text, name, known, AttributeError)


def check_known(function: str, options: Iterable[str], known: Collection[str]) -> None:
    """Raise UnknownOption for the first option that a function does not have."""
    for option in options:
        if option not in known:
            raise unknown(f"{function}: no option", option, known, UnknownOption)


class Named(dict):
    """Values by name; an unknown name raises UnknownQuantity with a list of all names.

    Numbers in keys match within rounding; a message names the nearest rows.

    `where`: beginning of the message, such as "paper: no density of". `address`: the expression
    that is indexed to get a value, if the names are rows of numbers.
    """

    def __init__(self, where: str, values: Mapping[Any, Any], address: str = "") -> None:
        super().__init__(values)
        self.where, self.address = where, address

    def __getitem__(self, name: Any) -> Any:
        try:
            return super().__getitem__(name)
        except TypeError:
            raise UnknownQuantity(
                f"{self.where} {shown(name)}: a row is one key; list(…) gives all of them"
            ) from None

    def __missing__(self, name: object) -> Any:
        distances = {key: _distance(key, name) for key in self if not isinstance(key, str)}
        ordered = sorted(distances, key=lambda key: distances[key])
        if ordered and distances[ordered[0]] <= ROUNDING:
            return self[ordered[0]]
        rows = [repr(key).strip("()") for key in ordered]
        if rows and self.address:
            some = " or ".join(f"{self.address}[{row}]" for row in rows[:FEW_ROWS])
            raise UnknownQuantity(f"{self.where} {named(name)}: write {some} ({len(rows)} rows)")
        raise unknown(self.where, name, self, UnknownQuantity)


def _distance(key, name):
    """Relative distance of two keys; texts and keys of different lengths have at least 1."""
    ours, theirs = (value if isinstance(value, tuple) else (value,) for value in (key, name))
    total = float(abs(len(ours) - len(theirs)))
    # A shorter key lacks the first parts, such as the method.
    for one, other in zip(reversed(ours), reversed(theirs), strict=False):
        if is_real(one) and is_real(other) and one != other:
            total += abs(one - other) / max(abs(one), abs(other))
        else:
            total += float(one != other)
    return total


def check_name(what: str, name: str, known: Collection[str]) -> str:
    """Return a valid name; otherwise raise HarvesterError with the nearest valid one."""
    if name not in known:
        raise unknown(f"unknown {what}", name, known)
    return name


def check_processes(options: Mapping[str, Any]) -> None:
    """Raise HarvesterError if an executor or runner does not have the required methods."""
    executor, runner = options.get("executor"), options.get("runner")
    if executor is not None and not hasattr(executor, "submit"):
        raise HarvesterError(f"executor = {shown(executor)}: give a concurrent.futures.Executor")
    runs = hasattr(runner, "answer") or hasattr(getattr(runner, "pool", runner), "map")
    if runner is not None and not runs:
        raise HarvesterError(f"runner = {shown(runner)}: give a WorkerPool or a Runner")


def checked_progress(progress: Callable[[float, str], object]) -> Callable[[float, str], None]:
    """Wrap the caller's progress function: an exception in it becomes a HarvesterError."""
    if not callable(progress):
        raise HarvesterError(
            f"progress = {shown(progress)}: must be a function of two arguments, or omitted"
        )

    def follow(share: float, words: str) -> None:
        try:
            progress(share, words)
        except HarvesterError:
            raise
        except Exception as error:
            raise HarvesterError(
                f"progress: the given function raised {type(error).__name__}: {error}; "
                "correct it, or omit progress"
            ) from error

    return follow
