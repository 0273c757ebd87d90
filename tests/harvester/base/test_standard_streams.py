import json
import os
import subprocess
import sys

import pytest

from harvester.cli.command_line import main

AVERAGE = ["average", "linear", "--method", "paper"]
FILES = [
    "linear-paper-densities.csv", "linear-paper.csv", "linear-paper.json", "linear-paper.nc",
    "linear-paper.png",
]  # fmt: skip


def shell(tmp_path, words, after, **variables):
    """The command in a shell, with what follows it there."""
    program = f"{sys.executable} -m harvester"
    return subprocess.run(
        ["bash", "-c", f"set -o pipefail; {program} {' '.join(words)} {after}"],
        cwd=tmp_path,
        capture_output=True,
        # Other tests let workers import from tests/, where a folder is called harvester.
        env={**os.environ, "PYTHONPATH": "", **variables},
    )


@pytest.mark.parametrize("json_too", [True, False])
def test_a_finished_run_is_kept_where_standard_output_is_full(
    tmp_path, monkeypatch, capsys, json_too
):
    with open("/dev/full", "w", encoding="utf-8") as full:
        monkeypatch.setattr(sys, "stdout", full)
        extra = ["--json", "-"] if json_too else []
        assert main([*AVERAGE, "--output", str(tmp_path), *extra]) == 2
    assert sorted(os.listdir(tmp_path)) == FILES
    assert capsys.readouterr().err.splitlines()[-1] == (
        "harvester: standard output: cannot be written: No space left on device"
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("after", "code", "said"),
    [
        (">/dev/full", 2, b"standard output: cannot be written: No space left on device\n"),
        (">&-", 2, b"standard output: cannot be written: Bad file descriptor\n"),
        (">&- 2>&-", 2, b""),
        (">/dev/full 2>/dev/full", 2, b""),
        ("2>&-", 0, b""),
        ("| true", 0, b""),
    ],
)
def test_what_cannot_be_shown_is_said_in_one_line(tmp_path, after, code, said):
    # More than a pipe holds.
    ended = shell(tmp_path, ["completion", "bash"], after)
    assert ended.returncode == code
    assert ended.stderr == (b"harvester: " + said if said else b"")
    assert (after == "2>&-") == bool(ended.stdout)


@pytest.mark.slow
def test_a_closed_standard_error_does_not_fall_into_standard_output(tmp_path):
    ended = shell(tmp_path, [*AVERAGE, "--json", "-", "--output", "."], "2>&-")
    assert ended.returncode == 0
    assert json.loads(ended.stdout)["engine"] == "averaging paper"
    assert sorted(os.listdir(tmp_path)) == FILES


@pytest.mark.slow
def test_an_ascii_terminal_is_written_in_ascii(tmp_path):
    ended = shell(tmp_path, [*AVERAGE, "--json", "j"], "", PYTHONIOENCODING="ascii")
    assert ended.returncode == 0
    assert ended.stdout.isascii()
    assert b"+- " in ended.stdout
    # On a busy machine progress is written here.
    assert ended.stderr.isascii()


def test_data_on_standard_output_are_the_bytes_of_a_file(tmp_path):
    netlist = ["netlist", "linear", "--set", "run.duration=0.1"]
    ended = shell(tmp_path, netlist, "", LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0")
    assert ended.returncode == 0
    assert main([*netlist, "--output", str(tmp_path / "a.cir")]) == 0
    assert ended.stdout == (tmp_path / "a.cir").read_bytes()
