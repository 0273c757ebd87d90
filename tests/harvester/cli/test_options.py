"""Options made from signatures, and those that the commands have."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Unpack

import pytest
from cyclopts import App

from harvester.base.errors import HarvesterError
from harvester.base.signatures import (
    File,
    Grids,
    Kind,
    RunnerOptions,
    Seconds,
    Share,
    as_list,
    options_of,
)
from harvester.cli.command import Command
from harvester.cli.command_line import main
from harvester.cli.options import described
from harvester.cli.table import COMMANDS, app_of
from harvester.identification.identify import Keys, Records

RUN = "--scheduler --time-budget --workers"
SCENE = "--seed --set SCENE"
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
    "--report --resolution --sampling-rate --set --unit",
    "beam": f"--json --output --report {SCENE}",
    "load": "FILE --nodes --output --remove",
    "average": f"--fit --json --jump-rates --method --output --report --tolerance {SCENE}",
    "frequency-response": "--amplitude --down --frequencies --json --method --output --step "
    f"--per-g --quantity --report --time-limit {RUN} {SCENE}",
    "accuracy": f"--json --method --output --report --thorough {RUN} {SCENE}",
    "stability": f"--json --output --report --step --time-limit {RUN} {SCENE}",
    "verify": f"--json --output --report {RUN}",
    "sweep": "--json --method --output --over --precision --quantity --report --step --time-limit "
    f"{RUN} {SCENE}",
    "optimum": "--closure --evaluations --from --json --maximise --method --output --over "
    f"--precision --report --to {RUN} {SCENE}",
    "sensitivity": "--above --covariance --json --method --output --precision --quantity --rows "
    f"--vary --report {RUN} {SCENE}",
    "load-study": "--json --load --method --output --precision --report --step --sweep "
    f"--time-limit {RUN} {SCENE}",
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
    assert set(COMMANDS) == set(OPTIONS)
    arguments = app_of([name])[name].assemble_argument_collection()
    spellings = [spelling for argument in arguments for spelling in argument.names]
    assert sorted(spellings) == sorted([*OPTIONS[name].split(), "--quiet"])


@pytest.mark.parametrize("name", COMMANDS)
def test_every_parameter_is_described_or_hidden(name):
    target = COMMANDS[name].target
    sections = [(target, "param"), (target, "other_param")]
    sections += [(RunnerOptions, section) for _, section in sections]
    assert set(options_of(target)) <= {name for section in sections for name in described(*section)}


def study(
    file: File,
    others: Annotated[Sequence[str], Kind("FILE", join=as_list)] = (),
    /,
    *,
    count: int,
    share: Share | None = None,
    sweeps: Grids | None = None,
    records: Records = (),
    keys: Keys = (),
    compare: Annotated[bool, Kind(option="alone")] = True,
    fast: bool = False,
    offset: float = 0.5,
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
    records : list
        Files with [settings].
    keys : list
        Names.
    compare : bool
        With --alone not.
    fast : bool
        Faster.
    offset : float
        A length.
    limit : float
        Seconds.

    Other Parameters
    ----------------
    hidden : float
        Not at the command line.
    scheduler : str or None
        Neither.
    """


class Toy(Command):
    """The command of `study`; returns the values that it is called with."""

    @property
    def target(self) -> Any:
        return study

    def run(self, values: dict[str, Any]) -> Any:
        return values


@pytest.fixture
def toy(monkeypatch):
    """Register the command `study` for a test."""
    monkeypatch.setitem(COMMANDS, "study", Toy("toy:study"))
    monkeypatch.setattr("harvester.cli.table.GROUPS", {"toys": [COMMANDS["study"]]})


def values_of(*words):
    app = App(default_command=Toy("toy:study").callback())
    function, bound, _ = app.parse_args(words, print_error=False, exit_on_error=False)
    return function(**bound.arguments)


@pytest.mark.usefixtures("toy")
def test_a_signature_is_the_options(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "120")
    assert main(["study", "--help"]) == 0
    shown = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for words in (
        "Do this. At 5 % of the cost, though.",
        "--count N How many. [required]",
        "--share SHARE A part of the whole.",
        "--sweep TABLE.KEY=LIST 100 % of them.",
        "--record FILE [SETTING=VALUE] Files with [settings].",
        "--alone With --alone not.",
        "--offset N A length. [default: 0.5]",
        "--limit SECONDS Seconds. [default: 60]",
        "--output DIR",
    ):
        assert words in shown
    assert "--hidden" not in shown
    assert "--scheduler" not in shown
    assert "--no-" not in shown


def test_what_is_left_out_is_not_handed_on():
    assert values_of("a", "--count", "2") == {"file": "a", "count": 2}
    sweeps = ("--sweep", "x=-8m:8m:3", "--sweep", "y=3")
    assert values_of("a", "b", "c", "--count", "-2", "--alone", "--fast", *sweeps) == {
        "file": "a",
        "others": ["b", "c"],
        "count": -2,
        "sweeps": {"x": [-0.008, 0.0, 0.008], "y": [3.0]},
        "compare": False,
        "fast": True,
    }


@pytest.mark.parametrize(
    ("words", "name", "value"),
    [
        ("--offset -1m", "offset", -0.001),
        ("--offset=3k", "offset", 3000.0),
        ("--offset 1 --offset 1meg", "offset", 1e6),
        ("--output -", "output", "-"),
        ("--output a=b", "output", "a=b"),
        ("--output=a=b", "output", "a=b"),
        ("--keys a.b c.d --fast --keys e.f", "keys", ["a.b", "c.d", "e.f"]),
    ],
)
def test_a_value_is_read_as_its_annotation_says(words, name, value):
    assert values_of("a", "--count", "1", *words.split())[name] == value


def test_records_are_grouped_by_the_option_that_they_follow():
    """The first word of a group is a file, even with an equals sign in its name."""
    words = "--record a.csv load.resistance=1k voltage=v:V b.csv --record a=b.csv time=t --alone"
    values = values_of("file", "--count", "1", *words.split(), "--record=c=d.csv")
    assert values["records"] == [
        ("a.csv", {"load.resistance": 1000.0, "voltage": "v:V"}),
        ("b.csv", {}),
        ("a=b.csv", {"time": "t"}),
        ("c=d.csv", {}),
    ]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--share 1.5", r"--share 1\.5: must be a number in \(0, 1\)"),
        ("--limit -1", r"--limit -1\.0: must be a number of seconds > 0"),
        ("--limit 5m", r"--limit 5m: must be a number of seconds > 0"),
        ("--count 3k", r"--count 3k: must be a whole number"),
        ("--offset 3M", r"--offset 3M: .*write 3meg or 3m"),
        ("--workers 0", "--workers 0: must be a whole number"),
        ("--sweep x", "--sweep x: must be written as TABLE.KEY=LIST"),
        ("--sweep x=1:2", "--sweep x=1:2: must be written as .* 0.1:2:log:40"),
        ("--sweep x=-1k:10k:log:3", "--sweep x=-1k:10k:log:3: log needs values above 0: -1k is"),
        ("--sweep x=10k:1k:log:3", "--sweep x=10k:1k:log:3: 10k must be below 1k, the last value"),
        ("--sweep x=1:2:3:1", "--sweep x=1:2:3:1: must be written as"),
        ("--sweep x=1:2:log:1", "--sweep x=1:2:log:1: the number of values must be from 2 to"),
    ],
)
def test_a_value_that_the_annotation_excludes_is_refused(words, message):
    with pytest.raises(HarvesterError, match=message):
        values_of("a", "--count", "2", *words.split())


@pytest.mark.usefixtures("toy")
@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("", "FILE is missing; see harvester study --help"),
        ("a", "--count is missing; see harvester study --help"),
        ("a --count", "--count needs a value"),
        ("a --limit --count 1", "--limit needs a value"),
        ("a --record --count 1", "--record needs a value"),
        ("a --count 1 --hidden 2", "unknown argument --hidden"),
        ("a --cuont 1", "unknown argument --cuont (did you mean --count?)"),
        ("--cuont 1 a", "unknown argument --cuont (did you mean --count?)"),
        ("a --count 1 --no-fast", "unknown argument --no-fast (did you mean --fast?)"),
        ("a --count 1 --empty-keys", "unknown argument --empty-keys (did you mean --keys?)"),
        ("a --count 1 --csv=b", "unknown argument --csv (did you mean --output?)"),
        ("a --count 1 --fast=perhaps", "Invalid value for --fast"),
    ],
)
def test_a_call_that_cannot_be_read_is_refused_in_one_line(words, message, capsys):
    assert main(["study", *words.split()]) == 2
    streams = capsys.readouterr()
    assert streams.out == ""
    assert streams.err.startswith(f"harvester: study: {message}")
    assert streams.err.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("simulat", "simulat: no such command (did you mean simulate?)"),
        ("papre average", "papre: no such command"),
        ("--quiet simulate paper", "write --quiet after simulate"),
        ("--json - simulate paper", "write --json after simulate"),
        ("--jsn simulate paper", "simulate: unknown argument --jsn (did you mean --json?)"),
    ],
)
def test_a_call_without_its_command_in_front_is_refused(words, message, capsys):
    assert main(words.split()) == 2
    assert capsys.readouterr().err.startswith(f"harvester: {message}")
