"""Commands of the documentation run as printed and give the numbers that stand beside them.

A line is run where its files are there: what the page shows under "Save this as", and what an
earlier line wrote. Commands that take more than a minute are only parsed (`test_documentation.py`).
"""

import math
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [
    page
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
    if re.search(r"^harvester ", page.read_text(encoding="utf-8"), re.MULTILINE)
]
# Commands of more than a minute, by their first word or first two.
LONGER = re.compile(
    r"harvester (accuracy|stability|verify|reproduce|"
    r"sensitivity|load-study|identify|bifurcation|residence|"
    r"optimum (paper|device --max|mine.toml --over beam.tip_mass))"
)
INPUT = re.compile(r"[\w./-]+\.(?:csv|mat|s1p|net|lib|toml|json|cir)")
# A kill after this (s) ends a command that hangs.
HANGS = 900.0
PREFIXES = {"": 1.0, "n": 1e-9, "µ": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6}
# An estimate with its error and its unit, if it has one; a table has the unit in a column before.
DIGITS = r"\d+(?:\.\d+)?(?:e-?\d+)?"
NUMBER = re.compile(rf"([+\-−]?{DIGITS}) ± ({DIGITS})\s?([nµmkM]?)((?:W|V|%)²?|Ω)?(?!\w)")
COLUMN = re.compile(r"\s([nµmkM]?)((?:W|V|%)²?|Ω)\s")


def lines_of(block):
    """The commands of a block, each on one line."""
    joined = block.replace("\\\n", " ").splitlines()
    return [line for line in joined if line.startswith("harvester ")]


def parts_of(text):
    """(name to save it under or "", language, code, the text that speaks of it) of each block."""
    for block in re.finditer(r"^```(\w+)\n(.*?)^```\n", text, re.MULTILINE | re.DOTALL):
        saved = re.search(r"as\s+`([\w.]+)`:\s*\Z", text[: block.start()])
        after = re.split(r"^(?:```sh|#)", text[block.end() :], maxsplit=1, flags=re.MULTILINE)[0]
        yield saved[1] if saved else "", block[1], block[2], after


def numbers(text):
    """(estimate, error, unit) of a text, in units without a prefix."""
    found = []
    for line in text.splitlines():
        column = COLUMN.search(line)
        for value, error, *own in NUMBER.findall(line):
            prefix, unit = own if own[1] or not column else column.groups()
            factor = PREFIXES[prefix] ** (2 if unit.endswith("²") else 1)
            found.append((float(value.replace("−", "-")) * factor, float(error) * factor, unit))
    return found


def is_there(line, folder):
    """Whether the files that a line reads are in the folder."""
    words = shlex.split(line, comments=True)
    written = {
        words[k + 1]
        for k, word in enumerate(words[:-1])
        if word in ("--output", "--json", "--report", "--waveform", "new")
    }
    named = {name for word in words for name in INPUT.findall(word)} - written
    return all((folder / name).exists() for name in named)


def run(line, folder):
    """Standard output of a command."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        ["bash", "-c", line],
        cwd=folder,
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        timeout=HANGS,
    )
    assert done.returncode == 0, (line, done.stderr[-2000:])
    return done.stdout


@pytest.mark.exhaustive
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_run_and_give_the_numbers_printed(page, tmp_path):
    """Numbers agree within three joint errors. By chance one number in 370 does not."""
    for name, language, code, after in parts_of(page.read_text(encoding="utf-8")):
        if name:
            (tmp_path / name).write_text(code, encoding="utf-8")
        if language != "sh":
            continue
        ready = [
            line for line in lines_of(code) if not LONGER.match(line) and is_there(line, tmp_path)
        ]
        ready = [line for line in ready if "harvester new" not in line or "--from" in line]
        given = numbers("".join(run(line, tmp_path) for line in ready))
        if not ready or len(ready) < len(lines_of(code)):
            continue
        for value, error, unit in numbers(after):
            near = [
                abs(value - other) <= 3.0 * math.hypot(error, own)
                for other, own, its in given
                if unit in ("", its)
            ]
            assert any(near), (page.name, value, error, unit, given)
