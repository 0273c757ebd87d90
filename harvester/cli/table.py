"""The table of commands. A new command is a function with a docstring, and an entry here."""

from __future__ import annotations

import inspect
import re
from collections.abc import Collection

from cyclopts import App, Group

from harvester.cli.command import Command
from harvester.studies import TIME_BUDGET
from harvester.validation import TIME_LIMIT
from harvester.version import __version__

ABOUT = """\
Vibration energy harvesters as circuits: ngspice, Monte Carlo and stochastic averaging of one scene,
with error bars. Each command has an example in its own --help."""
EPILOG = """\
exit codes:
  0    done
  1    a run or a check failed, or ngspice is missing
  2    a mistake in the call, the scene or a file, or a method that is not valid for the scene
  130  interrupted

Colours appear on a terminal only, and never with NO_COLOR set.
example: harvester validate paper --output results"""
# First section heading in a docstring.
SECTION = r"\n\n[A-Z][\w ]+\n---"
# All commands, in the groups of `harvester --help`.
GROUPS = {
    "getting started": (
        Command("harvester:average", title=lambda result: result.engine, stem="{method}"),
        Command("harvester:validate", title="one scene, the same noise"),
        Command("harvester.cli.new:new"),
        Command(
            "harvester:simulate",
            title=lambda result: result.engine,
            stem="{method}",
            is_run=True,
            failed=lambda result: result.outcome != "complete",
        ),
        Command(
            "harvester:load_study",
            failed=lambda study: not any(evaluation.estimates for evaluation in study.evaluations),
            running=lambda options: (
                {"time_budget": TIME_BUDGET} if options.get("precision") else {}
            ),
        ),
        Command("harvester:optimum", title=lambda result: f"optimum over {', '.join(result.keys)}"),
        Command("harvester.cli.circuit:schematic"),
        Command("harvester:identify", title=lambda result: result.headline(), stem="identified"),
    ),
    "more commands": (
        Command("harvester.cli.new:schema"),
        Command("harvester.cli.beam:beam", title="from its drawing"),
        Command("harvester:frequency_response"),
        Command("harvester:spectrum", title=lambda result: f"spectrum of {result.name}"),
        Command("harvester:basins", title=lambda result: f"orbits of {result.scene.name}"),
        Command(
            "harvester:bifurcation",
            failed=lambda result: len(result.failures) == len(result.values) * len(result.branches),
        ),
        Command("harvester:residence", title="residence times"),
        Command(
            "harvester:sweep",
            failed=lambda swept: not any(cell.estimates for _, cell in swept.places()),
        ),
        Command("harvester:sensitivity"),
        Command("harvester.cli.circuit:load"),
        Command("harvester.cli.circuit:netlist"),
        Command("harvester.cli.circuit:export"),
        Command("harvester.cli.cite:cite"),
        Command("harvester.cli.circuit:engine"),
        Command("harvester.cli.completion:completion"),
    ),
    "verification": (
        Command("harvester:verify", title="known results", failed=lambda result: result.failed),
        Command("harvester.cli.reproduce:reproduce"),
        Command("harvester:accuracy", title="error against run time"),
        Command(
            "harvester:stability",
            title="stiff and extreme cases",
            failed=lambda matrix: matrix.wrong,
            running=lambda options: {"time_limit": TIME_LIMIT},
        ),
    ),
}
COMMANDS = {command.name: command for group in GROUPS.values() for command in group}


def app_of(names: Collection[str], listed: bool = False, scenes: Collection[str] = ()) -> App:
    """The command line with a selection of commands.

    Parameters
    ----------
    names : collection of str
        Names of commands; only their functions are imported.
    listed : bool
        List the commands without their options.
    scenes : collection of str
        Names of scenes that completion offers.
    """
    app = App(
        name="harvester",
        help=ABOUT,
        help_epilogue=EPILOG,
        help_format="plaintext",
        version=f"harvester {__version__}",
    )
    for number, (title, commands) in enumerate(GROUPS.items()):
        group = Group(title, sort_key=number)
        for position, command in enumerate(commands):
            if command.name in names:
                text = inspect.getdoc(command.target) or ""
                paragraphs = re.split(SECTION, text)[0].split("\n\n")
                example = re.search(rf"^ +(harvester {command.name}( .+)?(\n +.+)*)$", text, re.M)
                subcommand = App(
                    name=command.name,
                    help="\n\n".join(" ".join(lines.split()) for lines in paragraphs),
                    help_epilogue=f"example: {' '.join(example[1].split())}" if example else None,
                    group=group,
                    sort_key=position,
                    default_command=None if listed else command.callback(scenes),
                )
                app.command(subcommand)
    return app
