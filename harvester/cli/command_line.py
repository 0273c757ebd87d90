"""The `harvester` command."""

from __future__ import annotations

import _thread
import sys
import threading
import warnings

from harvester.base.errors import EngineNotFound, HarvesterError, LoadChatters, SimulationError
from harvester.base.plain_text import nearest
from harvester.base.standard_streams import guarded_streams
from harvester.cli.shown import print_error, quiet
from harvester.cli.table import build_parser
from harvester.scene.calling import AT_COMMAND_LINE

# Former names of options, with the present ones.
FORMER_OPTIONS = {
    "--engine": ("--method",),
    "--closure": ("--method",),
    # Commands that vary a key name the option differently.
    "--over": ("--sweep", "--vary"),
    "--sweep": ("--over", "--vary"),
    "--vary": ("--over", "--sweep"),
    "--values": ("--over", "--sweep"),
    "--csv": ("--output",),
}
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

What proves the program: verify, stability, accuracy, reproduce.
`harvester --help` lists all commands; each has an example in its own --help."""


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
        print_error(f"{len(arguments)} arguments, and {MOST_ARGUMENTS} are the most")
        return 2
    if sys.flags.optimize > 1:
        print_error("python -OO leaves out the texts that the options are read from: use python -O")
        return 2
    if not arguments:
        print(WELCOME)
        return 0
    options = _parsed(arguments)
    token = AT_COMMAND_LINE.set(True)
    try:
        with quiet(options.quiet):
            return options.command.run(options) or 0
    except SimulationError as error:
        print_error(f"{type(error).__name__}: {error}")
        return 2 if isinstance(error, LoadChatters) else 1
    except EngineNotFound as error:
        print_error(error)
        return 1
    except HarvesterError as error:
        print_error(error)
        return 2
    except KeyboardInterrupt as interrupt:
        print_error(f"interrupted; {str(interrupt) or 'nothing was written'}")
        return 130
    except (MemoryError, ImportError, OSError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and "thread" not in str(error):
            raise
        # A limit of the machine: no memory, too few files, a library that does not load, no thread.
        reason = str(error).partition("\n")[0] or "no memory left"
        if isinstance(error, RuntimeError):
            reason = "a thread cannot be started; raise the limit (ulimit -a shows it)"
        print_error(f"{type(error).__name__}: {reason}")
        return 1
    finally:
        AT_COMMAND_LINE.reset(token)


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
        former = [each for each in FORMER_OPTIONS.get(word, ()) if each in spellings]
        hint = f" (did you mean {former[0]}?)" if former else nearest(word, spellings)
        command.error(f"unknown argument {word}{hint}")
    return options
