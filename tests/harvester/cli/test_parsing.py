"""Options made from signatures, and those that the commands have."""

from __future__ import annotations

from argparse import SUPPRESS, ArgumentParser
from collections.abc import Sequence
from typing import Annotated, Unpack

import pytest

from harvester.base.errors import HarvesterError
from harvester.base.signatures import File, Grids, Kind, RunnerOptions, Seconds, Share, options_of
from harvester.cli.parsing import about, add_options, described, values_of
from harvester.cli.table import COMMANDS, build_parser

RUN = "--scheduler --time-budget --workers"
SCENE = "--seed --set scene"
# Scripts of users name these.
OPTIONS = {
    "new": "--from FILE",
    "validate": f"--json --output --report --step --time-limit --workers {SCENE}",
    "simulate": "--copies --device --json --keep-going --method --node --output --report --source "
    f"--step --stroboscope --time-limit --waveform --window --workers {SCENE}",
    "basins": "--displacement --json --method --output --periods --points --report --step "
    f"--velocity {RUN} {SCENE}",
    "bifurcation": "--json --method --output --over --periods --report --step --up-only --values "
    f"{RUN} {SCENE}",
    "residence": "--json --method --output --over --precision --report --step --values "
    f"{RUN} {SCENE}",
    "spectrum": "FILE --breakpoints --column --device --duration --json --mend --output "
    "--report --resolution --sampling-rate --unit",
    "beam": f"--json --output --report {SCENE}",
    "load": "FILE --nodes --output --remove",
    "average": f"--fit --json --jump-rates --method --output --report --tolerance {SCENE}",
    "frequency-response": "--amplitude --down --frequencies --json --method --output --step "
    f"--per-g --quantity --report --time-limit {RUN} {SCENE}",
    "accuracy": f"--json --output --report --thorough {RUN} {SCENE}",
    "stability": f"--json --output --report --step --time-limit {RUN} {SCENE}",
    "verify": f"--json --output --report {RUN}",
    "sweep": "--json --method --output --over --precision --quantity --report --step --time-limit "
    f"{RUN} {SCENE}",
    "optimum": "--closure --evaluations --from --json --maximise --method --output --over "
    f"--precision --report --to {RUN} {SCENE}",
    "sensitivity": "--above --covariance --method --output --precision --quantity --rows --vary "
    f"--report {RUN} {SCENE}",
    "load-study": "--load --method --output --precision --report --step --sweep --time-limit "
    f"{RUN} {SCENE}",
    "identify": "--alone --free --impedance --json --keep-aside --output --posterior --record "
    f"--report {SCENE}",
    "reproduce": f"--output --precision --quick --seed --thorough {RUN} FIGURE",
    "schematic": f"--output {SCENE}",
    "netlist": f"--dialect --output --realization --step {SCENE}",
    "export": "--as --data --dialect --displacement-unit --duration --output --rate "
    f"--realization --step {SCENE}",
    "cite": "FILE",
    "schema": "FILE",
    "engine": "--json",
    "completion": "SHELL",
}


@pytest.mark.parametrize("name", OPTIONS)
def test_a_command_has_its_options(name):
    commands = build_parser()[1].choices
    assert set(commands) == set(OPTIONS)
    found = [
        action.option_strings[-1] if action.option_strings else action.metavar or action.dest
        for action in commands[name]._actions
    ]
    assert sorted(found) == sorted([*OPTIONS[name].split(), "--help", "--quiet"])


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_every_parameter_is_described_or_hidden(command):
    places = (command.target, RunnerOptions)
    sections = ("Parameters", "Other Parameters")
    told = {name for each in places for section in sections for name in described(each, section)}
    assert set(options_of(command.target)) <= told


def study(
    file: File,
    others: Sequence[str] = (),
    /,
    *,
    count: int,
    share: Share | None = None,
    sweeps: Grids | None = None,
    compare: Annotated[bool, Kind(option="alone")] = True,
    hidden: float = 1.0,
    limit: Seconds = 60.0,
    **running: Unpack[RunnerOptions],
) -> None:
    """Do this.

    At 5 % of the cost, though.

    Parameters
    ----------
    file, others : str
        What is read.
    count : int
        How many.
    share : float or None
        A part of
        the whole.
    sweeps : dict
        100 % of them.
    compare : bool
        With --alone not.
    limit : float
        Seconds.

    Other Parameters
    ----------------
    hidden : float
        Not at the command line.
    scheduler : str or None
        Neither.
    """


def parsed(*words):
    parser = ArgumentParser(prog="toy")
    add_options(parser, study)
    return values_of(parser.parse_args(words), study)


def test_a_signature_is_the_options():
    parser = ArgumentParser(prog="toy")
    add_options(parser, study)
    flags = {action.option_strings[-1] for action in parser._actions if action.option_strings}
    own = {"--count", "--share", "--sweep", "--alone", "--limit"}
    assert flags == own | {"--help", "--time-budget", "--workers", "--output"}
    assert all(action.default is SUPPRESS for action in parser._actions)
    shown = " ".join(parser.format_help().split())
    for words in (
        "--count N how many",
        "--share SHARE a part of the whole",
        "--sweep TABLE.KEY=LIST 100 % of them",
        "--limit SECONDS seconds (default: 60)",
        "--output DIR",
    ):
        assert words in shown
    assert about(study) == ("do this", "do this. At 5 % of the cost, though.")


def test_what_is_left_out_is_not_handed_on():
    assert parsed("a", "--count", "2") == {"file": "a", "count": 2}
    sweeps = ("--sweep", "x=1,2", "--sweep", "y=3")
    given = parsed("a", "b", "c", "--count", "2", "--alone", *sweeps)
    assert given == {
        "file": "a",
        "others": ["b", "c"],
        "count": 2,
        "sweeps": {"x": [1.0, 2.0], "y": [3.0]},
        "compare": False,
    }


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--share 1.5", r"--share 1\.5: must be a number in \(0, 1\)"),
        ("--limit -1", r"--limit -1\.0: must be a number of seconds > 0"),
        ("--workers 0", "--workers 0: must be a whole number"),
        ("--sweep x", "--sweep x: write it as table.key=LIST"),
        ("--sweep x=1:2", "--sweep x 1:2: write it as 0.1:2:log:40"),
    ],
)
def test_a_value_that_the_annotation_excludes_is_refused(words, message):
    with pytest.raises(HarvesterError, match=message):
        parsed("a", "--count", "2", *words.split())


@pytest.mark.parametrize("words", ["", "--count x", "--count 1 --hidden 2", "--count"])
def test_what_is_no_call_is_refused(words, capsys):
    with pytest.raises(SystemExit):
        parsed("a", *words.split())
    assert "toy: error" in capsys.readouterr().err
