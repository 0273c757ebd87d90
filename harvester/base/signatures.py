"""Derives the options of a public function from its signature: unit, spelling and check.

A parameter's annotation defines its option at the command line (`harvester.cli.options`) and its
check in Python (`harvester.scene.calling`). An `Annotated` alias such as `Seconds` adds to the
Python type: the unit, the range, the notation of a list.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
import math
import numbers
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple, TypedDict, get_args, get_type_hints

from harvester.base.arguments import real_numbers
from harvester.base.errors import HarvesterError
from harvester.base.method import Method
from harvester.base.numbers import is_real, is_whole, number, on_quotes
from harvester.base.plain_text import named, shown

KEYWORD = inspect.Parameter.KEYWORD_ONLY
# Whether a command runs: its errors name options ("--step") instead of parameters.
AT_COMMAND_LINE: ContextVar[bool] = ContextVar("at_command_line", default=False)
# Longest list of numbers from a grid such as 1:10:log:50.
MOST_NUMBERS = 100_000
LIST = "0.1:2:log:40, 0.1:2:linear:40, -8m:8m:40 or 0.1,0.2,0.5"
BY_KEY = f"written as TABLE.KEY=LIST, the list as {LIST}"


class OutOfRange(ValueError):
    """A text has the required form, but its numbers are not allowed; the message says why."""


@dataclass(frozen=True)
class Kind:
    """Properties of an option that its annotation adds to its Python type.

    Attributes
    ----------
    metavar : str
        Placeholder of the value in a command's help; FILE and DIR are completed by the shell.
    required : str
        Description of valid values.
    holds : callable or None
        Function that returns whether a value is allowed; None: all are.
    option : str
        Name of the option if it differs from the parameter's.
    read : callable or None
        Function that converts a text of the command line; a ValueError or LookupError rejects it.
        With `words` its argument is a list of texts. None: a number or the text, by the Python
        type.
    join : callable or None
        Function of a list of values and the option's spelling that returns one value; the option
        may then be given several times.
    words : bool
        Whether the option takes several words each time.
    """

    metavar: str = ""
    required: str = ""
    holds: Callable[[Any], bool] | None = None
    option: str = ""
    read: Callable[[Any], Any] | None = None
    join: Callable[[list[Any], str], Any] | None = None
    words: bool = False


def grid_of(text: str) -> list[float]:
    """Numbers from their short form: 0.1:2:log:40, -8m:8m:40 (evenly spaced) or 0.1,0.2,0.5.

    Raises ValueError or LookupError.
    """
    import numpy as np

    first, *others = text.split(":")
    if not others:
        return [number(part) for part in text.split(",")]
    last, *words, points = others
    (spacing,) = words or ["linear"]
    grid: Any = {"log": np.geomspace, "linear": np.linspace}[spacing]
    low, high, count = number(first), number(last), int(points)
    if spacing == "log" and not low > 0.0:
        raise OutOfRange(f"log needs values above 0: {first} is not")
    if not low < high < math.inf:
        raise OutOfRange(f"{first} must be below {last}, the last value")
    if not 1 < count <= MOST_NUMBERS:
        raise OutOfRange(f"the number of values must be from 2 to {MOST_NUMBERS}")
    return [float(value) for value in grid(low, high, count)]


def pair_of(read: Callable[[str], Any], alone: bool = False) -> Callable[[str], tuple[str, Any]]:
    """Return a parser of TABLE.KEY=VALUE to (key, value); `alone`: a missing value is None."""

    def pair(text: str) -> tuple[str, Any]:
        key, separator, value = (part.strip() for part in text.partition("="))
        if not value and (separator or not alone):
            raise ValueError(text)
        return key, read(value) if value else None

    return pair


def key_or_grid_of(text: str) -> dict[str, list[float]] | str:
    """Return the key of TABLE.KEY, or the dictionary of TABLE.KEY=LIST."""
    key, grid = pair_of(grid_of, alone=True)(text)
    return {key: grid} if grid else key


def range_of(text: str) -> tuple[float, float]:
    low, high = map(number, text.split(":"))
    return low, high


def window_of(text: str) -> tuple[float, float]:
    """Return two times in seconds from START:END; "all" means the whole run."""
    start, stop = (0.0, math.inf) if text == "all" else map(float, text.split(":"))
    return start, stop


def as_list(values: list[Any], option: str) -> list[Any]:
    return values


def by_key(pairs: list[tuple[str, Any]], option: str) -> dict[str, Any]:
    """Keys and their values; raises if a key is given twice."""
    keys = [key for key, _ in pairs]
    for key in keys:
        if keys.count(key) > 1:
            raise HarvesterError(f"{option} {named(key)}: is given twice; keep one")
    return dict(pairs)


def _positive(value: Any) -> bool:
    return is_real(value) and float(value) > 0.0


def _share(value: Any) -> bool:
    return is_real(value) and 0.0 < float(value) < 1.0


# Description and test of valid values, by type, for annotations without a test.
BY_TYPE: dict[Any, tuple[str, Callable[[Any], bool]]] = {
    bool: ("True or False", lambda value: type(value).__name__ in ("bool", "bool_")),
    int: ("a whole number", lambda value: is_real(value) and isinstance(value, numbers.Integral)),
    float: ("a number", lambda value: is_real(value) and math.isfinite(value)),
    str: ("a text", lambda value: isinstance(value, str)),
    str | os.PathLike: ("a path", lambda value: isinstance(value, (str, os.PathLike))),
    str | Method: ("a name or a method", lambda value: isinstance(value, (str, Method))),
}
# At the command line a name; in Python also an object.
MethodOrName = Annotated[str | Method, Kind("NAME")]
Step = Annotated[
    str | float,
    Kind(
        "STEP",
        "default, fine, finest or a number of seconds > 0",
        lambda value: isinstance(value, (str, numbers.Real)) or getattr(value, "ndim", None) == 0,
        read=lambda text: float(text) if on_quotes(text) else text,
    ),
]
Seed = Annotated[int, Kind("SEED")]
Seconds = Annotated[float, Kind("SECONDS", "a number of seconds > 0", _positive)]
Hertz = Annotated[float, Kind("HERTZ", "a number of hertz > 0", _positive)]
Metres = Annotated[float, Kind("METRES", "a number of metres > 0", _positive)]
Share = Annotated[float, Kind("SHARE", "a number in (0, 1), 0.01 for 1 %", _share)]
File = Annotated[str, Kind("FILE")]
Folder = Annotated[str | os.PathLike, Kind("DIR")]
Grid = Annotated[Sequence[float], Kind("LIST", f"written as {LIST}", read=grid_of)]
Count = Annotated[int, Kind("N", "a whole number ≥ 1", lambda value: is_whole(value, 1))]
Grids = Annotated[
    Mapping[str, Sequence[float]],
    Kind("TABLE.KEY=LIST", BY_KEY, option="sweep", read=pair_of(grid_of), join=by_key),
]
OneKey = Annotated[
    Mapping[str, Sequence[float]] | str, Kind("TABLE.KEY[=LIST]", BY_KEY, read=key_or_grid_of)
]
Over = Annotated[
    Mapping[str, Sequence[float | str]],
    Kind(
        "TABLE.KEY=LIST",
        BY_KEY,
        read=pair_of(lambda text: text.split(",") if text[:1].isalpha() else grid_of(text)),
        join=by_key,
    ),
]
Methods = Annotated[Sequence[str | Method], Kind("NAME", option="method", join=as_list)]
Quantities = Annotated[Sequence[str], Kind("NAME", option="quantity", join=as_list)]
Distributions = Annotated[
    Mapping[str, str],
    Kind("TABLE.KEY=DISTRIBUTION", "written as TABLE.KEY=±10%", read=pair_of(str), join=by_key),
]
Ranges = Annotated[
    str | Mapping[str, tuple | None],
    Kind(
        "TABLE.KEY[=LOW:HIGH]",
        "written as TABLE.KEY=LOW:HIGH, such as load.resistance=10k:1meg",
        read=pair_of(range_of, alone=True),
        join=by_key,
    ),
]
Window = Annotated[
    tuple[float, float] | str,
    Kind("START:END|all", "written as START:END, in s, or all", read=window_of),
]
Nodes = Annotated[Sequence[str], Kind("NAME", option="node", join=as_list)]
Faults = Annotated[Sequence[str], Kind("FAULT", join=as_list)]
Loads = Annotated[Sequence[str], Kind("NAME|PATH", option="load", join=as_list)]
Overrides = Annotated[Sequence[str] | dict, Kind("TABLE.KEY=VALUE", option="set", join=as_list)]


class RunnerOptions(TypedDict, total=False):
    """Keyword arguments of every study: see `harvester.open_runner`.

    Parameters
    ----------
    time_budget : float or None
        Start no task after this number of seconds, and end running tasks 5 % later; repeat the call
        to continue.
    workers : int or None
        Number of processes (default: one per core).
    scheduler : str or None
        Address of a Dask cluster, used instead of local processes.
    output : str or Path or None
        Folder for results and all finished tasks: repeat the same command to continue an
        interrupted run.

    Other Parameters
    ----------------
    executor : concurrent.futures.Executor, WorkerPool, ExecutorPool or None
    time_limit : float
        Wall-clock limit of one realization (s).
    progress : callable or False or None
        Called with the finished share, 0 … 1, and a description. None shows a bar in a notebook,
        False none.
    runner : Runner or None
    """

    time_budget: Seconds | None
    workers: Count | None
    scheduler: Annotated[str, Kind("ADDRESS")] | None
    output: Folder | None
    # `open_runner` annotates these two with types that this package does not import.
    executor: Any
    time_limit: Seconds
    progress: Callable[[float, str], object] | Literal[False] | None
    runner: Any


class Option(NamedTuple):
    """One parameter of a public function.

    Attributes
    ----------
    name : str
    type : object
        Type of the value, without the None of an omitted value; None if only a type checker can
        evaluate it.
    kind : Kind
    default : object
        `inspect.Parameter.empty` if the parameter is required.
    passing : object
        `inspect.Parameter.kind`: positional-only parameters are words at the command line.
    may_be_none : bool
    """

    name: str
    type: Any
    kind: Kind
    default: Any
    passing: Any
    may_be_none: bool

    @classmethod
    def of(cls, name: str, annotation: Any, default: Any = None, passing: Any = KEYWORD) -> Option:
        """The option of an evaluated annotation."""
        parts = get_args(annotation)
        may_be_none = type(None) in parts
        if may_be_none and len(parts) == 2:
            (annotation,) = (part for part in parts if part is not type(None))
        kinds = [part for part in get_args(annotation) if isinstance(part, Kind)]
        value_type = get_args(annotation)[0] if kinds else annotation
        kind = kinds[0] if kinds else Kind("NAME" if value_type is str else "N")
        return cls(name, value_type, kind, default, passing, may_be_none)

    @property
    def spelling(self) -> str:
        """Name at the command line."""
        return f"--{self.kind.option or self.name.replace('_', '-')}"

    def check(self, value: Any) -> None:
        """Raise if a value is out of range.

        Raises
        ------
        HarvesterError
        """
        if value is None and self.may_be_none:
            return
        required, holds = self.kind.required, self.kind.holds
        if not holds:
            required, holds = BY_TYPE.get(self.type, (required, None))
        if holds and not holds(value):
            raise HarvesterError(
                f"{self.spelling} {shown(value)}: must be {required}{on_quotes(value)}"
            )


@functools.cache
def options_of(function: Callable) -> dict[str, Option]:
    """A function's parameters by name, including the keys of its `**options: Unpack[…]`."""
    function = inspect.unwrap(function)
    options: dict[str, Option] = {}
    for name, parameter in inspect.signature(function).parameters.items():
        annotation = _evaluated(parameter.annotation, function.__globals__)
        if parameter.kind is parameter.VAR_KEYWORD:
            (collected,) = get_args(annotation)
            hints = get_type_hints(collected, include_extras=True)
            options |= {n: Option.of(n, hint) for n, hint in hints.items() if n not in options}
        else:
            options[name] = Option.of(name, annotation, parameter.default, parameter.kind)
    return options


def key_and_values(
    over: Mapping[str, Sequence[float]] | str, values: Sequence[float] | None
) -> tuple[str, tuple[float, ...]]:
    """The key and the values of a grid over one key; raises HarvesterError."""
    if isinstance(over, Mapping) and len(over) == 1 and values is None:
        ((key, levels),) = over.items()
        return key, real_numbers(levels, f"over[{key!r}]", "[0.1, 0.2]")
    if isinstance(over, str) and values is not None:
        return over, real_numbers(values, "values", "[0.1, 0.2]")
    written = "over={'excitation.amplitude': [1.0, 2.0]}"
    if AT_COMMAND_LINE.get():
        written = "--over excitation.amplitude=1:2:linear:5, or without the list and with --values"
    raise HarvesterError(f"--over {shown(over)}: give one key with its values, {written}")


def check_options(function: Callable, values: Mapping[str, Any]) -> None:
    """Raise if values of a function's options are out of range.

    Raises
    ------
    HarvesterError
    """
    options = options_of(function)
    with named_as_called(function):
        for name, value in values.items():
            options[name].check(value)


@contextlib.contextmanager
def named_as_called(function: Callable) -> Iterator[None]:
    """Make errors within the block name parameters of the function instead of command options.

    It has no effect while a command runs.
    """
    try:
        yield
    except HarvesterError as error:
        if not AT_COMMAND_LINE.get():
            names = {option.spelling: name for name, option in options_of(function).items()}
            text = re.sub(
                r"--([a-z][a-z-]*)",
                lambda word: names.get(word[0], word[1].replace("-", "_")),
                str(error),
            )
            error.args = (text, *error.args[1:])
        raise


def _evaluated(annotation, names):
    """Evaluate an annotation's text; None if only type checkers import its names."""
    try:
        return eval(annotation, names) if isinstance(annotation, str) else annotation
    except NameError:
        return None
