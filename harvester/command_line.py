"""The `harvester` command. Exit codes: 0 done, 1 a run failed, 2 a mistake in the call."""

import argparse
import sys

from harvester import __version__
from harvester.commands import (
    average,
    claims,
    engine,
    frequency_response,
    load_study,
    netlist,
    optimum,
    reproduce,
    simulate,
    stability,
    validate,
    work_precision,
)
from harvester.commands.options import say
from harvester.errors import EngineNotFound, HarvesterError, SimulationError

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
    netlist,
    engine,
)


def main(arguments=None):
    """Run the command line; returns the exit code."""
    options = _parser().parse_args(arguments)
    try:
        return options.command(options) or 0
    except SimulationError as error:
        say(f"harvester: {type(error).__name__}: {error}")
        _keep_partial(options, error)
        return 1
    except EngineNotFound as error:
        say(f"harvester: {error}")
        return 1
    except HarvesterError as error:
        say(f"harvester: {error}")
        return 2
    except KeyboardInterrupt:
        kept = getattr(options, "kept_when_interrupted", "nothing was written")
        say(f"harvester: interrupted; {kept}")
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 0


def _parser():
    parser = argparse.ArgumentParser(
        prog="harvester",
        description="Vibration energy harvesters as circuits: ngspice, Monte Carlo and "
        "stochastic averaging of one scene, with error bars.",
    )
    parser.add_argument("--version", action="version", version=f"harvester {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for command in COMMANDS:
        command.add(commands)
    return parser


def _keep_partial(options, error):
    """Write what a failed run had, with its outcome named, where JSON was asked for."""
    if error.partial is None or not getattr(options, "json", None):
        return
    from harvester.output import write_json

    write_json(options.json, error.partial.to_dict())
