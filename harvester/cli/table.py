"""The commands of the command line: a new one is a function with a docstring, and an entry here."""

from __future__ import annotations

import inspect
import re
from collections.abc import Collection

from cyclopts import App, Group

from harvester.cli.command import Command, StudyCommand
from harvester.studies import LOAD_STUDY_FILES, SENSITIVITY_FILES
from harvester.validation import TIME_LIMIT
from harvester.version import __version__

ABOUT = """\
Vibration energy harvesters as circuits: ngspice, Monte Carlo and stochastic averaging of one scene,
with error bars. Each command has an example in its own --help."""
EPILOG = """\
exit codes:
  0    done
  1    a run failed or was judged wrong, or ngspice is missing
  2    a mistake in the call, the scene or a file, or a method that does not hold for the scene
  130  interrupted

Colours appear on a terminal only, and never with NO_COLOR set.
example: harvester validate paper --output results"""


# Beginning of the first section of a docstring.
SECTION = r"\n\n[A-Z][\w ]+\n---"


def _budget(options):
    """The time budget of a load study with a precision."""
    from harvester.studies.public import TIME_BUDGET

    return {"time_budget": TIME_BUDGET} if options.get("precision") else {}


# All commands, each with the example of its help, by the groups of `harvester --help`.
GROUPS = {
    "getting started": (
        StudyCommand(
            "harvester:average",
            "paper --method consistent",
            title=lambda result: result.engine,
            stem="{method}",
        ),
        StudyCommand(
            "harvester:validate",
            "paper --output results --report paper.html",
            title="one scene, the same noise",
        ),
        Command("harvester.cli.new:new", "beam.toml --from asymmetric"),
        StudyCommand(
            "harvester:simulate",
            "paper --method circuit --set excitation.intensity=0.1 --json -",
            title=lambda result: result.engine,
            stem="{method}",
            waveform=True,
            failed=lambda result: result.outcome != "complete",
            bar="simulated time",
        ),
        StudyCommand(
            "harvester:load_study",
            "device --load bridge --load sece "
            "--sweep load.parameters.resistance=1e4:1e7:log:7 --precision 0.03 --output study",
            failed=lambda study: not any(evaluation.estimates for evaluation in study.evaluations),
            json=False,
            files=LOAD_STUDY_FILES,
            running=_budget,
        ),
        StudyCommand(
            "harvester:optimum",
            "device --maximise mean_power --over load.resistance=1e4:1e7 "
            "--over oscillator.linear_stiffness=-100:-20",
            title=lambda result: f"optimum over {', '.join(result.keys)}",
            bar="function",
        ),
        Command(
            "harvester.cli.circuit:schematic",
            "device --set load.netlist=bridge --output bridge.svg",
        ),
        StudyCommand(
            "harvester:identify",
            "device --record shaker.csv load.resistance=1e5 --output identified",
            title=lambda result: result.headline(),
            stem="identified",
        ),
    ),
    "more commands": (
        Command("harvester.cli.new:schema", "scene.schema.json"),
        StudyCommand(
            "harvester.cli.beam:beam", "bimorph --output results", title="from its drawing"
        ),
        StudyCommand(
            "harvester:frequency_response",
            "device --amplitude 4 --frequencies 5:30:linear:51 --down",
        ),
        StudyCommand(
            "harvester:spectrum",
            "truck.csv --unit g --device device --breakpoints 12 --output truck",
            title=lambda result: f"spectrum of {result.name}",
            stem="spectrum",
        ),
        StudyCommand(
            "harvester:basins",
            """device --set 'excitation={kind="sine", amplitude=6.0, frequency=8.0}' """
            "--points 60 --output basins",
            title=lambda result: f"orbits of {result.scene.name}",
        ),
        StudyCommand(
            "harvester:bifurcation",
            """device --set 'excitation={kind="sine", amplitude=6.0, frequency=8.0}' """
            "--over excitation.amplitude --values 1:12:linear:100",
            failed=lambda result: len(result.failures) == len(result.values) * len(result.branches),
        ),
        StudyCommand(
            "harvester:residence",
            "duffing --over excitation.intensity --values 0.02:0.06:log:5 --precision 0.05",
            title="residence times",
        ),
        StudyCommand(
            "harvester:sweep",
            "paper --over excitation.intensity=0.005:0.1:log:7 --method monte-carlo "
            "--method fokker_planck --quantity mean_square_voltage --output swept",
            failed=lambda swept: not any(cell.estimates for _, cell in swept.places()),
        ),
        StudyCommand(
            "harvester:sensitivity",
            "paper --vary oscillator.cubic_stiffness=±10% "
            "--vary stoppers.gap=normal:2% --above 0.001 --output tolerances",
            json=False,
            files=SENSITIVITY_FILES,
        ),
        Command(
            "harvester.cli.circuit:load",
            "rectifier.net --nodes N001,N002,out,0 --output rectifier.lib",
        ),
        Command("harvester.cli.circuit:netlist", "paper --set run.duration=100 --output paper.cir"),
        Command("harvester.cli.circuit:export", "device --as deck --output block", bar="export"),
        Command("harvester.cli.cite:cite", "results/paper-validate.json"),
        Command("harvester.cli.circuit:engine", "--json -"),
        Command("harvester.cli.completion:completion", "bash"),
    ),
    "verification": (
        StudyCommand(
            "harvester.cli.verification:verify",
            "--output results",
            title="known results",
            failed=lambda result: result.failed,
        ),
        Command("harvester.cli.verification:reproduce", "fig6 fig9 --quick --output results"),
        StudyCommand(
            "harvester.cli.verification:accuracy",
            "paper --output results",
            title="error against run time",
        ),
        StudyCommand(
            "harvester.cli.verification:stability",
            "paper --output results",
            title="stiff and extreme cases",
            failed=lambda matrix: matrix.wrong,
            running=lambda options: {"time_limit": TIME_LIMIT},
        ),
    ),
}
COMMANDS = {command.name: command for group in GROUPS.values() for command in group}


def app_of(names: Collection[str], listed: bool = False, scenes: Collection[str] = ()) -> App:
    """The command line with some of its commands.

    Parameters
    ----------
    names : collection of str
        Commands; no function of another is imported.
    listed : bool
        Without their options, for the list of commands.
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
        for place, command in enumerate(commands):
            if command.name in names:
                text = re.split(SECTION, inspect.getdoc(command.target) or "")[0]
                paragraphs = (" ".join(lines.split()) for lines in text.split("\n\n"))
                subcommand = App(
                    name=command.name,
                    help="\n\n".join(paragraphs),
                    help_epilogue=f"example: harvester {command.name} {command.example}",
                    group=group,
                    sort_key=place,
                    default_command=None if listed else command.callback(scenes),
                )
                app.command(subcommand)
    return app
