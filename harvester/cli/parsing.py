"""The options of a command, made from the signature and the docstring of its function.

- A parameter that the docstring's section "Parameters" describes is an option, with that text as
  its help; "Other Parameters" are for callers from Python alone.
- `--name` is the parameter's name, or that in its annotation (`harvester.base.signatures`).
- A positional-only parameter is a word of the call. So is the scene, which brings --set and --seed.
- What is left out is not handed on: the function's own default holds.
"""

from __future__ import annotations

import inspect
import re
from argparse import SUPPRESS, ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable, Iterable, Sequence
from typing import Any, get_args, get_origin

from harvester.base.numbers import NotANumber, number
from harvester.base.signatures import Kind, Option, Overrides, RunnerOptions, Seed, options_of

SCENE_HELP = "a TOML file or the name of a built-in scene"
SET_HELP = "override a value of the scene; TABLE=none removes a table"
SEED_HELP = "same as --set run.seed=SEED"
_EMPTY = inspect.Parameter.empty


def about(function: Callable) -> tuple[str, str]:
    """The first sentence of a docstring, and all that stands above its sections."""
    text = re.split(r"^[A-Z][A-Za-z ]+\n-+$", inspect.getdoc(function) or "", flags=re.M)[0]
    first, _, details = text.partition("\n\n")
    return _small(first), ". ".join(filter(None, (_small(first), " ".join(details.split()))))


def described(documented: Any, section: str = "Parameters") -> dict[str, str]:
    """Names in a section of a numpydoc docstring, each with its text on one line."""
    text = (inspect.getdoc(documented) or "") + "\n"
    match = re.search(rf"^{section}\n-+\n(.*?)(?=^[A-Z][A-Za-z ]+\n-+$|\Z)", text, re.M | re.S)
    entries = re.findall(r"^(\S[^\n]*)\n((?:(?: .*)?\n?)*)", match[1] if match else "", re.M)
    return {
        name.strip(): _small(body)
        for names, body in entries
        for name in names.partition(" :")[0].split(",")
    }


def _small(text):
    """Text as argparse writes its own help: small at first, without a full stop."""
    words = " ".join(text.split()).rstrip(".")
    return words if words[1:2].isupper() else words[:1].lower() + words[1:]


def options_shown(function: Callable) -> list[tuple[Option, str]]:
    """Options that a command has, each with its help, in the docstring's order."""
    options, documented = options_of(function), described(function)
    hidden = described(function, "Other Parameters")
    texts = described(RunnerOptions) | documented
    names = [
        *documented,
        *(name for name in texts if name not in documented and name not in hidden),
    ]
    return [(options[name], texts[name]) for name in names if name in options]


def add_options(parser: ArgumentParser, function: Callable) -> None:
    for option, text in options_shown(function):
        if is_scene(option):
            _add_scene(parser, option)
        else:
            add_option(parser, option, text)


def add_extra(parser: ArgumentParser, name: str, kind: Any, text: str) -> None:
    """Give a parser an option that is the command's own, not its function's."""
    value, properties = get_args(kind)
    add_option(
        parser, Option(name, value, properties, None, inspect.Parameter.KEYWORD_ONLY, True), text
    )


def is_scene(option: Option) -> bool:
    return option.name == "scene" and option.passing is not inspect.Parameter.KEYWORD_ONLY


def _add_scene(parser, option):
    default = "" if option.default is _EMPTY else f" (default: {option.default})"
    words = {"nargs": "?", "default": option.default} if default else {}
    parser.add_argument("scene", help=SCENE_HELP + default, **words)
    add_extra(parser, "overrides", Overrides, SET_HELP)
    add_extra(parser, "seed", Seed, SEED_HELP)


def add_option(parser: ArgumentParser, option: Option, text: str) -> None:
    # argparse replaces a percent sign by values, so that it is doubled.
    words: dict[str, Any] = {"default": SUPPRESS, "help": _with_default(option, text)}
    kind = option.kind or Kind("NAME" if option.type is str else "N")
    if option.type is bool:
        # A setting that is on by default has an option that turns it off.
        action = "store_false" if option.default is True else "store_true"
        parser.add_argument(f"--{option.spelling}", dest=option.name, action=action, **words)
        return
    words |= {"metavar": kind.metavar}
    if option.type in (int, float):
        # No suffixes for a time, since 5m may mean five minutes.
        words["type"] = (
            _number if option.type is float and kind.metavar != "SECONDS" else option.type
        )
    if option.passing is inspect.Parameter.POSITIONAL_ONLY:
        several = get_origin(option.type) in (list, Sequence)
        if option.default is not _EMPTY:
            words["nargs"] = "*" if several else "?"
        parser.add_argument(option.name, **words)
        return
    if kind.words:
        words["nargs"] = "+"
    if kind.again:
        words["action"] = "extend" if kind.words and not kind.read else "append"
    words |= {"dest": option.name, "required": option.default is _EMPTY}
    parser.add_argument(f"--{option.spelling}", **words)


def _number(text):
    """A number with or without a suffix; an error is raised as argparse expects it."""
    try:
        return number(text)
    except NotANumber as reason:
        raise ArgumentTypeError(f"{text!r}: {reason}") from None


def _with_default(option, text):
    """The help, with the default where there is one that the text does not name."""
    plain = isinstance(option.default, (str, int, float)) and not isinstance(option.default, bool)
    if plain and option.default != "" and "default" not in text.replace(f'"{option.default}"', ""):
        default_text = option.default if isinstance(option.default, str) else f"{option.default:g}"
        text += f" (default: {default_text})"
    return text.replace("%", "%%")


def values_of(options: Namespace, function: Callable) -> dict[str, Any]:
    """Values of a function's options in a call, read and checked by the annotations.

    Raises
    ------
    HarvesterError
    """
    values = {}
    for option, _ in options_shown(function):
        if not is_scene(option) and hasattr(options, option.name):
            value = getattr(options, option.name)
            read = option.kind and option.kind.read
            values[option.name] = read(value, f"--{option.spelling}") if read else value
            option.check(values[option.name])
    return values


def overrides_of(overrides: Iterable[str] = (), seed: int | None = None) -> list[str]:
    """The overrides of a scene that --set and --seed give."""
    return [*overrides, *([] if seed is None else [f"run.seed={seed}"])]
