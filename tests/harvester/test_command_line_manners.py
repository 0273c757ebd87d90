import ctypes
import functools
import io
import re
import signal
import subprocess
import sys
import time

import pytest

import harvester
from harvester.base.errors import EngineNotFound, SceneError, SimulatorTimeout
from harvester.cli import console
from harvester.cli.command import Command
from harvester.cli.command_line import main
from harvester.cli.table import COMMANDS, GROUPS

COLOUR = re.compile(r"\x1b\[[\d;]*\b(?:3[0-7]|9[0-7]|38;[\d;]+)m")


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self):
        return True


def wait_for(words, stream):
    """Until the bar's own thread has written them, or a minute."""
    until = time.monotonic() + 60.0
    while words not in stream.getvalue() and time.monotonic() < until:
        time.sleep(0.01)


def test_every_command_is_listed_once():
    assert len(COMMANDS) == sum(map(len, GROUPS.values()))


@pytest.mark.parametrize(
    ("words", "said"), [([], "─ getting started ─"), (["load"], "harvester load")]
)
def test_help_is_a_word_too(words, said, capsys):
    for first in ("help", "--help"):
        assert main([first, *words]) == 0
        assert said in capsys.readouterr().out


def test_exit_codes_are_told(capsys):
    main(["--help"])
    said = capsys.readouterr().out
    for code in (
        "0    done",
        "1    a run or a check failed",
        "2    a mistake",
        "130  interrupted",
        "NO_COLOR",
    ):
        assert code in said


@pytest.mark.parametrize(
    ("end", "code"),
    [
        (None, 0),
        (1, 1),
        (2, 2),
        (EngineNotFound("no ngspice"), 1),
        (SimulatorTimeout("after 10 s"), 1),
        (OSError("no space left"), 1),
        (SceneError("gap"), 2),
        (KeyboardInterrupt(), 130),
    ],
    ids=repr,
)
def test_a_command_ends_with_the_code_that_is_told(monkeypatch, end, code):
    def run(self, options):
        if isinstance(end, BaseException):
            raise end
        return end

    monkeypatch.setattr(Command, "run", run)
    assert main(["cite"]) == code


def test_quiet_shows_what_was_asked_for_and_errors_only(tmp_path, capsys):
    average = ["average", "linear", "--method", "paper"]
    assert main([*average, "--quiet", "--output", str(tmp_path), "--json", "-"]) == 0
    streams = capsys.readouterr()
    assert (tmp_path / "linear-paper.png").exists()
    assert streams.out.startswith("{")
    assert streams.err == ""
    assert main(["average", "papre", "--quiet"]) == 2
    assert "did you mean paper" in capsys.readouterr().err
    assert main(average) == 0
    shown = capsys.readouterr().out
    assert "mean power" in shown
    assert "\x1b" not in shown  # not on a terminal


@pytest.mark.parametrize(
    ("terminal", "no_colour", "coloured"),
    [(True, None, True), (True, "1", False), (False, None, False)],
)
def test_colours_appear_on_a_terminal_and_never_with_no_color(
    monkeypatch, terminal, no_colour, coloured
):
    stream = Terminal() if terminal else io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(console, "SHOW_AFTER_SECONDS", 0.0)
    monkeypatch.setenv("TERM", "xterm-256color")
    for name in ("FORCE_COLOR", "COLORTERM"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.delenv("NO_COLOR", raising=False)
    if no_colour:
        monkeypatch.setenv("NO_COLOR", no_colour)
    with console.progress("run") as update:
        update(0.5)
        update(0.9)
        if terminal:
            wait_for("run", stream)
    assert bool(COLOUR.search(stream.getvalue())) == coloured
    assert bool(stream.getvalue()) == terminal


def test_a_terminal_shows_a_run_before_its_first_report(monkeypatch):
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(console, "SHOW_AFTER_SECONDS", 0.01)
    monkeypatch.setenv("TERM", "xterm-256color")
    with console.progress("a run that compiles"):
        wait_for("a run that compiles", stream)
        assert "starting" in stream.getvalue()


def completed(script, line):
    """What bash offers for the last word of a line."""
    words = line.split(" ")
    code = (
        f"{script}\nCOMP_WORDS=({' '.join(w or chr(39) * 2 for w in words)})\n"
        f"COMP_CWORD={len(words) - 1}\n"
        "$(complete -p harvester | sed 's/.*-F \\([^ ]*\\).*/\\1/')\n"
        'printf "%s\\n" "${COMPREPLY[@]}"\n'
    )
    return subprocess.run(["bash", "-c", code], capture_output=True, text=True).stdout.split()


def test_bash_completes_commands_scenes_and_options(capsys):
    assert main(["completion", "bash"]) == 0
    script = capsys.readouterr().out
    assert set(completed(script, "harvester s")) == {
        "schema",
        "schematic",
        "sensitivity",
        "simulate",
        "spectrum",
        "stability",
        "sweep",
    }
    assert {"paper", "paper_si"} <= set(completed(script, "harvester validate pap"))
    assert "--report" in completed(script, "harvester validate paper --re")


@pytest.mark.parametrize(
    ("shell", "word"), [("zsh", "compdef _cyclopts_harvester harvester"), ("fish", "complete")]
)
def test_other_shells_have_their_script(capsys, shell, word):
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert word in script
    for name in COMMANDS:
        assert name in script


def test_an_unknown_shell_is_refused(capsys):
    assert main(["completion", "bsh"]) == 2
    assert "did you mean bash" in capsys.readouterr().err


def test_help_begins_with_the_newcomers_commands_and_ends_with_the_proof(capsys):
    assert main(["--help"]) == 0
    shown = re.split(r"─ (?:getting started|more commands|verification) ─", capsys.readouterr().out)
    listed = [re.findall(r"^│ ([a-z][\w-]*)  ", part, re.MULTILINE) for part in shown[1:]]
    assert listed == [[command.name for command in group] for group in GROUPS.values()]


def test_an_interrupt_that_c_code_loses_ends_the_command(monkeypatch, capsys):
    """No exception passes through a C library from a callback: Python drops it there."""
    waited = []
    # A shell starts what runs in the background with interrupts ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)

    @functools.wraps(harvester.average)
    def interrupted(*_, **__):
        ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGINT))()
        waited.append("goes on")
        for _ in range(300):
            time.sleep(0.1)
        waited.append("was not interrupted")

    monkeypatch.setattr(harvester, "average", interrupted)
    try:
        assert main(["average", "linear"]) == 130
    finally:
        signal.signal(signal.SIGINT, before)
    assert waited == ["goes on"]
    assert capsys.readouterr().err == "harvester: interrupted; nothing was written\n"


def test_a_netlist_says_where_it_was_written(tmp_path, capsys):
    file = tmp_path / "paper.cir"
    assert main(["netlist", "paper", "--set", "run.duration=5", "--output", str(file)]) == 0
    assert f"written: {file}" in capsys.readouterr().err
    assert file.exists()
