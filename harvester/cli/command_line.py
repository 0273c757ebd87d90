"""The `harvester` command."""

from __future__ import annotations

import _thread
import sys
import threading
import warnings
from collections.abc import Callable
from typing import Any

from cyclopts import (
    CoercionError,
    CycloptsError,
    MissingArgumentError,
    UnknownCommandError,
)

from harvester.base.errors import HarvesterError, SimulationError
from harvester.base.plain_text import named, nearest
from harvester.base.signatures import AT_COMMAND_LINE
from harvester.base.standard_streams import guarded_streams
from harvester.cli.options import WORD
from harvester.cli.shown import print_error
from harvester.cli.table import COMMANDS, app_of

# Options of the same meaning: former names, and names in other commands.
SYNONYMS = (
    ("--method", "--engine", "--closure"),
    ("--over", "--sweep", "--vary", "--values"),
    ("--output", "--csv"),
)
# Maximum number of arguments. The time to parse them grows with the square of their number.
MOST_ARGUMENTS = 2000
# Seconds after which an interrupt that C code discarded is repeated.
LOST_INTERRUPT_SECONDS = 0.1
WELCOME = """\
harvester simulates vibration energy harvesters. First commands to try:

  harvester average paper       densities and power of a built-in device, in seconds
  harvester validate paper      the same by circuit, Monte Carlo and theory, side by side
  harvester new beam.toml       a commented scene of your own, to change and run like `paper`
  harvester simulate device     power and densities by one engine, with any load
  harvester load-study device   the best load, or a ranking of loads
  harvester optimum device      where a parameter makes the power largest
  harvester schematic device    the circuit that a scene builds, drawn
  harvester identify device     a scene from measured records

Checks of the program: verify, stability, accuracy, reproduce.
`harvester --help` lists all commands; each has an example in its own --help."""


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    arguments = sys.argv[1:] if arguments is None else arguments
    hook, sys.unraisablehook = sys.unraisablehook, _interrupt_again
    with guarded_streams() as exit_code, warnings.catch_warnings():
        # The check of the result reports overflows itself.
        warnings.simplefilter("ignore", RuntimeWarning)
        try:
            return exit_code(_run(arguments))
        finally:
            sys.unraisablehook = hook


def _interrupt_again(lost):
    """Interrupt the main thread again if C code discarded the interrupt.

    Python handles a signal in the next Python function. During LLVM's work this is a callback of
    llvmlite, from which no exception can propagate through LLVM.
    """
    if not issubclass(lost.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(lost)
        return
    # An interrupt raised here would be discarded in this hook.
    again = threading.Timer(LOST_INTERRUPT_SECONDS, _thread.interrupt_main)
    again.daemon = True
    again.start()


def _run(arguments):
    if len(arguments) > MOST_ARGUMENTS:
        print_error(f"{len(arguments)} arguments: must be at most {MOST_ARGUMENTS}")
        return 2
    if sys.flags.optimize > 1:
        print_error("python -OO removes the docstrings that define the options: use python -O")
        return 2
    if not arguments:
        print(WELCOME)
        return 0
    token = AT_COMMAND_LINE.set(True)
    try:
        function, values = parsed(arguments)
        return function(**values) or 0
    except HarvesterError as error:
        kind = f"{type(error).__name__}: " if isinstance(error, SimulationError) else ""
        print_error(f"{kind}{error}")
        return error.exit_code
    except KeyboardInterrupt as interrupt:
        print_error(f"interrupted; {str(interrupt) or 'nothing was written'}")
        return 130
    except (MemoryError, ImportError, OSError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and "thread" not in str(error):
            raise
        # A limit of the system: memory, open files, threads, or a library that does not load.
        reason = str(error).partition("\n")[0] or "no memory left"
        if isinstance(error, RuntimeError):
            reason = "a thread cannot be started; raise the limit (ulimit -a shows it)"
        print_error(f"{type(error).__name__}: {reason}")
        return 1
    finally:
        AT_COMMAND_LINE.reset(token)


def parsed(words: list[str]) -> tuple[Callable[..., int | None], dict[str, Any]]:
    """The function of a call, and its arguments.

    Raises
    ------
    HarvesterError
    """
    if words[0] == "help":
        words = [*words[1:2], "--help"]
    # An option before the command's name belongs to the command.
    candidates = words if words[0].startswith("-") else words[:1]
    called = next((word for word in candidates if word in COMMANDS), None)
    app = app_of([called]) if called else app_of(COMMANDS, listed=True)
    try:
        function, bound, _ = app.parse_args(words, print_error=False, exit_on_error=False)
    except CycloptsError as error:
        raise HarvesterError(_refusal(error, words, called)) from None
    return function, bound.arguments


def _refusal(error, words, called):
    """Return a one-line message about a mistake in a call."""
    if called is None:
        return (
            f"{named(words[0])}: no such command{nearest(words[0], COMMANDS)}; "
            "harvester --help lists them"
        )
    shown = [option for option, _ in COMMANDS[called].options() if option.passing is not WORD]
    options = ["--help", *(option.spelling for option in shown)]
    unused = sorted(error.unused_tokens or (), key=lambda word: not word.startswith("-"))
    if isinstance(error, MissingArgumentError):
        # A missing option that is present was read as the value of the option before it.
        missing = error.keyword or (error.argument.name if error.argument else "")
        before = error.keyword or (missing in words and words[words.index(missing) - 1])
        if before:
            return f"{called}: {before} needs a value"
        if not unused or not unused[0].startswith("-"):
            return f"{called}: {missing} is missing; see harvester {called} --help"
    token = getattr(error, "token", None)
    word = (token.keyword or token.value) if token else "".join(unused[:1])
    word = word.partition("=")[0]
    if isinstance(error, CoercionError) or not (token or unused):
        return f"{called}: {error}"
    if isinstance(error, UnknownCommandError) and word in options:
        return f"write {word} after {called}"
    same = [option for group in SYNONYMS if word in group for option in group if option in options]
    hint = f" (did you mean {same[0]}?)" if same else nearest(word, options)
    return f"{called}: unknown argument {named(word)}{hint}"
