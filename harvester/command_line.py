"""The `harvester` command."""

import argparse
import sys

from harvester import __version__
from harvester.commands import (
    average,
    cite,
    claims,
    completion,
    engine,
    frequency_response,
    load_study,
    netlist,
    optimum,
    reproduce,
    schematic,
    simulate,
    stability,
    validate,
    work_precision,
)
from harvester.errors import EngineNotFound, HarvesterError, SimulationError
from harvester.quiet import quiet

COMMANDS = (
    validate,
    simulate,
    average,
    frequency_response,
    work_precision,
    stability,
    optimum,
    load_study,
    reproduce,
    claims,
    schematic,
    netlist,
    cite,
    engine,
    completion,
)

EPILOG = """\
exit codes:
  0    done
  1    a run failed or was judged wrong, or ngspice is missing
  2    a mistake in the call, the scene or a file, or a method that does not hold for the scene
  130  interrupted

Colours appear on a terminal only, and never with NO_COLOR set.
example: harvester validate paper --output results"""


def main(arguments=None):
    """Run the command line; returns the exit code."""
    options = build_parser()[0].parse_args(arguments)
    try:
        with quiet(options.quiet):
            return options.command(options) or 0
    except SimulationError as error:
        _complain(f"harvester: {type(error).__name__}: {error}")
        _keep_partial(options, error)
        return 1
    except EngineNotFound as error:
        _complain(f"harvester: {error}")
        return 1
    except HarvesterError as error:
        _complain(f"harvester: {error}")
        return 2
    except KeyboardInterrupt:
        kept = getattr(options, "kept_when_interrupted", "nothing was written")
        _complain(f"harvester: interrupted; {kept}")
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 0
    except (MemoryError, ImportError, OSError) as error:
        # Of the machine: too little memory, too few files, a library that does not load.
        said = str(error).partition("\n")[0] or "no memory left"
        _complain(f"harvester: {type(error).__name__}: {said}")
        return 1


def build_parser():
    """The parser of the command line, and its sub-parsers' action."""
    parser = argparse.ArgumentParser(
        prog="harvester",
        description="Vibration energy harvesters as circuits: ngspice, Monte Carlo and\n"
        "stochastic averaging of one scene, with error bars.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"harvester {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for command in COMMANDS:
        command.add(commands)
    for command in commands.choices.values():
        command.add_argument(
            "--quiet", action="store_true", help="show errors only, and what goes to -"
        )
    return parser, commands


def _complain(text):
    print(text, file=sys.stderr)


def _keep_partial(options, error):
    """Write what a failed run had, with its outcome named, where JSON was asked for."""
    if error.partial is None or not getattr(options, "json", None):
        return
    from harvester.output import write_json

    write_json(options.json, error.partial.to_dict())
