"""The commands of the command line: a new one is a function with a docstring, and an entry here."""

from __future__ import annotations

import argparse
import re
from typing import Annotated, Any, NoReturn

from harvester.base.errors import HarvesterError
from harvester.base.plain_text import nearest, one_line
from harvester.base.signatures import Kind
from harvester.cli import circuit, verification
from harvester.cli.beam import beam
from harvester.cli.cite import cite
from harvester.cli.command import Command, StudyCommand
from harvester.cli.new import new, schema
from harvester.cli.parsing import about
from harvester.studies import LOAD_STUDY_FILES, SENSITIVITY_FILES
from harvester.studies.public import TIME_BUDGET
from harvester.validation import TIME_LIMIT
from harvester.version import __version__

SHELLS = ("bash", "zsh", "fish")
EPILOG = """\
exit codes:
  0    done
  1    a run failed or was judged wrong, or ngspice is missing
  2    a mistake in the call, the scene or a file, or a method that does not hold for the scene
  130  interrupted

Colours appear on a terminal only, and never with NO_COLOR set.
example: harvester validate paper --output results"""


def completion(shell: Annotated[str, Kind("SHELL")], /) -> None:
    """Print the completion script of a shell.

    For this session: eval it; for good: write it where the shell looks, such as
    ~/.local/share/bash-completion/completions/harvester.

    Parameters
    ----------
    shell : str
        bash, zsh, fish.
    """
    import shtab

    from harvester.scene.source import built_in_names

    if shell not in SHELLS:
        raise HarvesterError(
            f"{shell}: no such shell{nearest(shell, SHELLS)}; there are {', '.join(SHELLS)}"
        )
    parser, commands = build_parser()
    for command in commands.choices.values():
        for action in command._actions:
            if action.dest == "scene":
                action.choices = built_in_names()
            elif action.dest == "shell":
                action.choices = SHELLS
            elif action.metavar in ("FILE", "DIR"):
                action.complete = shtab.FILE if action.metavar == "FILE" else shtab.DIRECTORY
    print(shtab.complete(parser, shell))


# All commands, each with the example of its help. A text names a public function of `harvester`.
COMMANDS = (
    Command(new, "new beam.toml --from asymmetric"),
    Command(schema, "schema scene.schema.json"),
    StudyCommand(
        "validate",
        "validate paper --output results --report paper.html",
        title="one scene, the same noise",
    ),
    StudyCommand(
        "simulate",
        "simulate paper --method circuit --set excitation.intensity=0.1 --json -",
        title=lambda result: result.engine,
        stem="{method}",
        waveform=True,
        failed=lambda result: result.outcome != "complete",
        bar="simulated time",
    ),
    StudyCommand(beam, "beam bimorph --output results", title="from its drawing"),
    StudyCommand(
        "average",
        "average paper --method consistent",
        title=lambda result: result.engine,
        stem="{method}",
    ),
    StudyCommand(
        "frequency_response",
        "frequency-response device --amplitude 4 --frequencies 5:30:linear:51 --down",
        title="frequency response",
    ),
    StudyCommand(
        "spectrum",
        "spectrum truck.csv --unit g --device device --breakpoints 12 --output truck",
        title=lambda result: f"spectrum of {result.name}",
        stem="spectrum",
    ),
    StudyCommand(
        verification.accuracy, "accuracy paper --output results", title="error against run time"
    ),
    StudyCommand(
        verification.stability,
        "stability paper --output results",
        title="stiff and extreme cases",
        failed=lambda matrix: matrix.wrong,
        running=lambda options: {"time_limit": TIME_LIMIT},
    ),
    StudyCommand(
        verification.verify,
        "verify --output results",
        title="known results",
        failed=lambda result: result.failed,
    ),
    StudyCommand(
        "basins",
        """basins device --set 'excitation={kind="sine", amplitude=6.0, frequency=8.0}' """
        "--points 60 --output basins",
        title=lambda result: f"orbits of {result.scene.name}",
    ),
    StudyCommand(
        "bifurcation",
        """bifurcation device --set 'excitation={kind="sine", amplitude=6.0, frequency=8.0}' """
        "--over excitation.amplitude --values 1:12:linear:100",
        title="bifurcation",
        failed=lambda result: len(result.failures) == len(result.values) * len(result.branches),
    ),
    StudyCommand(
        "residence",
        "residence duffing --over excitation.intensity --values 0.02:0.06:log:5 --precision 0.05",
        title="residence times",
    ),
    StudyCommand(
        "sweep",
        "sweep paper --over excitation.intensity=0.005:0.1:log:7 --method monte-carlo "
        "--method fokker_planck --quantity mean_square_voltage --output swept",
        title="sweep",
        failed=lambda swept: not any(cell.estimates for _, cell in swept.places()),
    ),
    StudyCommand(
        "optimum",
        "optimum device --maximise mean_power --over load.resistance=1e4:1e7 "
        "--over oscillator.linear_stiffness=-100:-20",
        title=lambda result: f"optimum over {', '.join(result.keys)}",
        bar="function",
    ),
    StudyCommand(
        "sensitivity",
        "sensitivity paper --vary oscillator.cubic_stiffness=±10% "
        "--vary stoppers.gap=normal:2% --above 0.001 --output tolerances",
        title="sensitivity",
        json=False,
        files=SENSITIVITY_FILES,
    ),
    StudyCommand(
        "load_study",
        "load-study device --load bridge --load sece "
        "--sweep load.parameters.resistance=1e4:1e7:log:7 --precision 0.03 --output study",
        title="load study",
        failed=lambda study: not any(evaluation.estimates for evaluation in study.evaluations),
        json=False,
        files=LOAD_STUDY_FILES,
        running=lambda options: {"time_budget": TIME_BUDGET} if options.get("precision") else {},
    ),
    StudyCommand(
        "identify",
        "identify device --record shaker.csv load.resistance=1e5 --output identified",
        title=lambda result: f"identified from {', '.join(r.name for r in result.measurements)}",
        stem="identified",
    ),
    Command(verification.reproduce, "reproduce fig6 fig9 --quick --output results"),
    Command(circuit.schematic, "schematic device --set load.netlist=bridge --output bridge.svg"),
    Command(circuit.load, "load rectifier.net --nodes N001,N002,out,0 --output rectifier.lib"),
    Command(circuit.netlist, "netlist paper --set run.duration=100 --output paper.cir"),
    Command(circuit.export, "export device --as deck --output block", bar="export"),
    Command(cite, "cite results/paper-validate.json"),
    Command(circuit.engine, "engine --json -"),
    Command(completion, "completion bash"),
)
# Commands that `harvester --help` lists first and last; the others stand between them.
FIRST = (
    "average", "validate", "new", "simulate", "load-study", "optimum", "schematic", "identify"
)  # fmt: skip
PROOF = ("verify", "reproduce", "accuracy", "stability")


class CommandParser(argparse.ArgumentParser):
    """Says what is wrong with a call in printable text."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        # A range such as -0.02:0.02:60 is a value and not an option.
        self._negative_number_matcher = re.compile(r"^-\.?\d")

    def error(self, message: str) -> NoReturn:
        super().error(one_line(message))


def build_parser(command_name: str | None = None) -> tuple[CommandParser, Any]:
    """The parser of the command line, and its sub-parsers' action.

    Parameters
    ----------
    command_name : str or None
        A command: only it gets its options. Of another word or None: all get them. None is for
        scripts of shells: each command has its help then.
    """
    parser = CommandParser(
        prog="harvester",
        description="Vibration energy harvesters as circuits: ngspice, Monte Carlo and\n"
        "stochastic averaging of one scene, with error bars.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"harvester {__version__}")
    title = "commands, each with an example in its own --help"
    commands = parser.add_subparsers(title=title, required=True, metavar="COMMAND")
    summaries: dict[str, str] = {}
    only = command_name if command_name in {command.name for command in COMMANDS} else None
    for command in COMMANDS:
        if only not in (None, command.name):
            commands.add_parser(command.name)
            continue
        first, text = about(command.target)
        summaries[command.name] = first
        # Completion scripts list the commands that have a help text. `--help` lists all of them in
        # groups.
        listed: dict[str, Any] = {"help": first.replace("%", "%%")} if command_name is None else {}
        subparser = commands.add_parser(
            command.name, **listed, description=text, epilog=f"example: harvester {command.example}"
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
