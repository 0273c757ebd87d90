"""The `harvester` command."""

from __future__ import annotations

import _thread
import argparse
import re
import sys
import threading
import warnings
from typing import Any, NoReturn

from harvester.commands.parsing import about
from harvester.commands.quiet import complain, quiet
from harvester.commands.table import COMMANDS, FIRST, PROOF
from harvester.errors import EngineNotFound, HarvesterError, LoadChatters, SimulationError
from harvester.files.plain_text import nearest, one_line
from harvester.files.streams import guarded_streams
from harvester.version import __version__

# Former names of options, with the present ones.
FORMER_OPTIONS = {"--engine": "--method", "--closure": "--method"}
# Most words of a call. argparse's time grows with the square of their number.
MOST_ARGUMENTS = 2000
# After so many seconds an interrupt that C code lost is repeated.
LOST_INTERRUPT_SECONDS = 0.1
WELCOME = """\
harvester simulates vibration energy harvesters. What to try first:

  harvester average paper       densities and power of a built-in device, in seconds
  harvester validate paper      the same by circuit, Monte Carlo and theory, side by side
  harvester new beam.toml       a commented scene of your own, to change and run like `paper`
  harvester simulate device     power and densities by one engine, with any load
  harvester load-study device   the best load, or a ranking of loads
  harvester optimum device      where a parameter makes the power largest
  harvester schematic device    the circuit that a scene builds, drawn
  harvester identify device     a scene from measured records

What proves the program: verify, claims, stability, accuracy, work-precision, time-to-accuracy,
reproduce. `harvester --help` lists all commands; each has an example in its own --help."""
EPILOG = """\
exit codes:
  0    done
  1    a run failed or was judged wrong, or ngspice is missing
  2    a mistake in the call, the scene or a file, or a method that does not hold for the scene
  130  interrupted

Colours appear on a terminal only, and never with NO_COLOR set.
example: harvester validate paper --output results"""


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    arguments = sys.argv[1:] if arguments is None else arguments
    hook, sys.unraisablehook = sys.unraisablehook, _interrupt_again
    with guarded_streams() as exit_code, warnings.catch_warnings():
        # The check of the result reports overflows in its own words.
        warnings.simplefilter("ignore", RuntimeWarning)
        try:
            return exit_code(_run(arguments))
        except SystemExit as end:
            raise SystemExit(exit_code(end.code)) from None
        finally:
            sys.unraisablehook = hook


def _interrupt_again(lost):
    """Interrupt the main thread once more if C code lost the interrupt.

    Python handles a signal in the next Python function. During LLVM's work this is a callback of
    llvmlite, from which no exception can pass through LLVM.
    """
    if not issubclass(lost.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(lost)
        return
    # An interrupt from here would be lost within this hook.
    again = threading.Timer(LOST_INTERRUPT_SECONDS, _thread.interrupt_main)
    again.daemon = True
    again.start()


def _run(arguments):
    if len(arguments) > MOST_ARGUMENTS:
        complain(f"{len(arguments)} arguments, and {MOST_ARGUMENTS} are the most")
        return 2
    if sys.flags.optimize > 1:
        complain("python -OO leaves out the texts that the options are read from: use python -O")
        return 2
    if not arguments:
        print(WELCOME)
        return 0
    options = _parsed(arguments)
    try:
        with quiet(options.quiet):
            return options.command.run(options) or 0
    except SimulationError as error:
        complain(f"{type(error).__name__}: {error}")
        return 2 if isinstance(error, LoadChatters) else 1
    except EngineNotFound as error:
        complain(error)
        return 1
    except HarvesterError as error:
        complain(error)
        return 2
    except KeyboardInterrupt as interrupt:
        complain(f"interrupted; {str(interrupt) or 'nothing was written'}")
        return 130
    except (MemoryError, ImportError, OSError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and "thread" not in str(error):
            raise
        # A limit of the machine: no memory, too few files, a library that does not load, no thread.
        reason = str(error).partition("\n")[0] or "no memory left"
        if isinstance(error, RuntimeError):
            reason = "a thread cannot be started; raise the limit (ulimit -a shows it)"
        complain(f"{type(error).__name__}: {reason}")
        return 1


def _parsed(arguments):
    """The options; one that a command does not have is refused with the nearest."""
    if arguments[0] == "help":
        arguments = [*arguments[1:2], "--help"]
    # Only this command's function is imported for its options.
    parser, commands = build_parser(arguments[0])
    options, unknown = parser.parse_known_args(arguments)
    if unknown:
        command = commands.choices[options.command.name]
        spellings = [word for action in command._actions for word in action.option_strings]
        word = unknown[0].partition("=")[0]
        if word in spellings:
            command.error(f"argument {word} goes behind {options.command.name}")
        former = FORMER_OPTIONS.get(word)
        hint = f" (did you mean {former}?)" if former in spellings else nearest(word, spellings)
        command.error(f"unknown argument {word}{hint}")
    return options


class Parser(argparse.ArgumentParser):
    """Says what is wrong with a call in printable text."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        # A range such as -0.02:0.02:60 is a value and not an option.
        self._negative_number_matcher = re.compile(r"^-\.?\d")

    def error(self, message: str) -> NoReturn:
        """End with the usage and the mistake."""
        super().error(one_line(message))


def build_parser(wanted: str | None = None) -> tuple[Parser, Any]:
    """The parser of the command line, and its sub-parsers' action.

    Parameters
    ----------
    wanted : str or None
        A command: only it gets its options. Of another word or None: all get them. None is for
        scripts of shells: each command has its help then.
    """
    parser = Parser(
        prog="harvester",
        description="Vibration energy harvesters as circuits: ngspice, Monte Carlo and\n"
        "stochastic averaging of one scene, with error bars.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"harvester {__version__}")
    title = "commands, each with an example in its own --help"
    commands = parser.add_subparsers(title=title, required=True, metavar="COMMAND")
    summaries: dict[str, str] = {}
    only = wanted if wanted in {command.name for command in COMMANDS} else None
    for command in COMMANDS:
        if only not in (None, command.name):
            commands.add_parser(command.name)
            continue
        first, text = about(command.found)
        summaries[command.name] = first
        # Completion scripts list the commands that have a help text. `--help` lists all of them in
        # groups.
        listed: dict[str, Any] = {"help": first.replace("%", "%%")} if wanted is None else {}
        subparser = commands.add_parser(
            command.name,
            **listed,
            description=text,
            epilog=f"example: harvester {command.example}",
        )
        command.fill(subparser)
        subparser.add_argument(
            "--quiet", action="store_true", help="show errors only, and what goes to -"
        )
        subparser.set_defaults(command=command)
    # argparse can print one list of commands only; the groups stand in its epilog.
    parser.epilog = f"{_in_groups(summaries)}\n\n{EPILOG}"
    return parser, commands


def _in_groups(summaries):
    """The commands with what each does: the newcomer's, the others, and what proves the program."""
    between = [name for name in summaries if name not in (*FIRST, *PROOF)]
    groups = {"to begin with": FIRST, "further": between, "what proves the program": PROOF}
    width = max(map(len, summaries)) + 2
    return "\n\n".join(
        "\n".join(
            [f"{title}:", *(f"  {n:<{width}}{summaries[n]}" for n in names if n in summaries)]
        )
        for title, names in groups.items()
    )
