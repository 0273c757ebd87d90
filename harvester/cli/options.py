"""Options of a command for cyclopts, from the signature and docstring of its function.

- A parameter in the docstring's section "Parameters" is an option, with its description as help;
  "Other Parameters" are available from Python alone.
- `--name` is the parameter's name, or the name in its annotation (`harvester.base.signatures`).
- A positional-only parameter is a positional argument. So is the scene, which adds --set and
  --seed.
- Omitted options are not passed: the default of the function applies.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, get_origin

from cyclopts import MissingArgumentError, Parameter, Token, UnknownOptionError
from cyclopts.argument import ArgumentCollection
from docstring_parser import DocstringStyle, parse

from harvester.base.errors import HarvesterError
from harvester.base.numbers import NotANumber, number
from harvester.base.plain_text import named
from harvester.base.signatures import (
    BY_TYPE,
    Kind,
    Option,
    OutOfRange,
    Overrides,
    RunnerOptions,
    Seed,
    options_of,
)

SCENE_HELP = "A TOML file or the name of a built-in scene."
SET_HELP = "Override a value of the scene; TABLE=none removes a table."
SEED_HELP = "Same as --set run.seed=SEED."
WORD = inspect.Parameter.POSITIONAL_ONLY
REQUIRED = inspect.Parameter.empty


def described(documented: Any, section: str = "param") -> dict[str, str]:
    """Names and descriptions in a section ("param" or "other_param") of a numpydoc docstring."""
    parameters = parse(inspect.getdoc(documented) or "", DocstringStyle.NUMPYDOC).params
    return {
        name.strip(): " ".join((parameter.description or "").split())
        for parameter in parameters
        if parameter.args[0] == section
        for name in parameter.arg_name.split(",")
    }


def options_shown(function: Callable) -> Iterator[tuple[Option, str]]:
    """Yield the options of a command, each with its help, in the docstring's order."""
    options, documented = options_of(function), described(function)
    hidden = described(function, "other_param").keys() - documented.keys()
    inherited = {n: text for n, text in described(RunnerOptions).items() if n not in documented}
    for name, text in (documented | inherited).items():
        if name == "scene" and is_scene(options[name]):
            yield options[name]._replace(kind=Kind("SCENE"), type=str, passing=WORD), SCENE_HELP
            yield Option.of("overrides", Overrides), SET_HELP
            yield Option.of("seed", Seed), SEED_HELP
        elif name in options and name not in hidden:
            yield options[name], text


def is_scene(option: Option) -> bool:
    return option.name == "scene" and option.passing is not inspect.Parameter.KEYWORD_ONLY


class _Words(str):
    """Text that `_reader` converts to a value of any type.

    If pydantic is imported, cyclopts lets it compare the value with the annotation. Pydantic has no
    schema for this class, and therefore does not change the value.
    """


def parameter_of(option: Option, text: str, scenes: Collection[str] = ()) -> inspect.Parameter:
    """The parameter that cyclopts reads; `scenes`: names that completion offers."""
    kind, hint = option.kind, option.type
    if option.name == "scene" and scenes:
        hint = Literal[tuple(scenes)] | str
    elif hint is not bool and not (scenes and get_origin(hint) is Literal):
        # Shells complete file names for parameters of type Path.
        text_type: Any = Path if scenes and kind.metavar.startswith(("FILE", "DIR")) else _Words
        hint = list[text_type] if kind.join else text_type
    is_spelling = kind.required.startswith("written")
    settings = Parameter(
        name=kind.metavar if option.passing is WORD else option.spelling,
        help=text + f" On the command line {kind.required}." * is_spelling,
        metavar=kind.metavar,
        converter=_reader(option),
        show_default=_shown_default(option, text),
        show_choices=False,
        # Values such as the range -0.02:0.02:60 begin with a hyphen; `_reader` rejects options.
        allow_leading_hyphen=not kind.words,
        consume_multiple=(1, None) if kind.words else None,
        allow_repeating=True,
        negative=(),
        json_list=False,
    )
    default = REQUIRED if option.default is REQUIRED else None
    passing = WORD if option.passing is WORD else inspect.Parameter.KEYWORD_ONLY
    # If pydantic is imported, cyclopts lets it check the default. For completion, None is omitted.
    annotation: Any = Annotated[hint | None, settings]
    if scenes or default is REQUIRED:
        annotation = Annotated[hint, settings]
    return inspect.Parameter(option.name, passing, default=default, annotation=annotation)


def _shown_default(option, text):
    """Return the default, or False if there is none or the help names it."""
    default = option.default
    plain = isinstance(default, (str, int, float)) and not isinstance(default, bool)
    if not plain or default == "" or "default" in text.replace(f'"{default}"', ""):
        return False
    return default if isinstance(default, str) else f"{default:g}"


def _reader(option):
    """Return a function that converts and checks the words of an option's value."""
    kind = option.kind
    # Times take no suffixes, since 5m may mean five minutes.
    real = float if kind.metavar == "SECONDS" else number
    usual_read = {int: int, float: real}.get(option.type, str)
    required = kind.required or BY_TYPE.get(option.type, BY_TYPE[str])[0]
    convert: Callable[[Any], Any] = kind.read or usual_read

    def read(hint: Any, tokens: Sequence[Token]) -> Any:
        groups: list[list[str]] = []
        for token in tokens:
            if re.match(r"--?[^\W\d]", token.value):
                if token.keyword is None:
                    raise UnknownOptionError(token=token, argument_collection=ArgumentCollection())
                raise MissingArgumentError(keyword=token.keyword)
            # The words after each occurrence of an option are counted from 0.
            if token.index == 0 or not kind.words:
                groups.append([])
            groups[-1].append(token.value)
        values = []
        for words in groups:
            try:
                values.append(convert(words if kind.words else words[0]))
            except (ValueError, LookupError) as error:
                reason = f" ({error})" if isinstance(error, NotANumber) else ""
                fault = error if isinstance(error, OutOfRange) else f"must be {required}{reason}"
                raise HarvesterError(
                    f"{option.spelling} {named(' '.join(words))}: {fault}"
                ) from None
        value = kind.join(values, option.spelling) if kind.join else values[-1]
        option.check(value)
        return value

    return read
