"""Tutorials and how-to guides run as printed, from an empty folder, and give the numbers printed.

Blocks run in the order of the page. "Save this as `NAME`:" writes a block to a file. A block that
cannot run has a comment `<!-- not run: REASON -->` above it and is only parsed
(`test_documentation.py`).
"""

import math
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from harvester.cli.command_line import main

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [
    ROOT / "README.md",
    *sorted(DOCS.glob("tutorials/*.md")),
    *sorted(DOCS.glob("how-to/*.md")),
]
# Pages of a few seconds, which `make test` runs too.
QUICK = ("cite", "editor", "python")
# A kill after this (s) ends a command that hangs.
HANGS = 1800.0
EXAMPLES = tomllib.loads((DOCS / "examples.toml").read_text(encoding="utf-8"))
BLOCK = re.compile(
    r"^(<!-- not run: .+ -->\n)?```(\w+)\n(.*?)^```\n(.*?)(?=^(?:<!--|```)|^#|\Z)", re.M | re.S
)
PREFIXES = {"": 1.0, "n": 1e-9, "µ": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6}
# An estimate with its error and its unit, if it has one; a table has the unit in a column before.
DIGITS = r"\d+(?:\.\d+)?(?:e-?\d+)?"
NUMBER = re.compile(rf"([+\-−]?{DIGITS}) ± ({DIGITS})\s?([nµmkM]?)((?:W|V|%)²?|Ω)?(?!\w)")
COLUMN = re.compile(r"\s([nµmkM]?)((?:W|V|%)²?|Ω)\s")


def numbers(text):
    """(estimate, error, unit) of a text, in units without a prefix."""
    estimates = []
    for line in text.splitlines():
        column = COLUMN.search(line)
        for value, error, *unit_of_number in NUMBER.findall(line):
            use_column = column and not unit_of_number[1]
            prefix, unit = column.groups() if use_column else unit_of_number
            factor = PREFIXES[prefix] ** (2 if unit.endswith("²") else 1)
            estimates.append((float(value.replace("−", "-")) * factor, float(error) * factor, unit))
    return estimates


def run(language, code, capfd):
    """Standard output of a block, run in the working folder.

    The commands of `harvester` run in this process, on the workers of the session.
    """
    capfd.readouterr()
    if language == "python":
        exec(code, {"__name__": "__main__"})
        return capfd.readouterr().out
    for line in code.replace("\\\n", " ").splitlines():
        if line.startswith("harvester "):
            words = shlex.split(line, comments=True)[1:]
            assert main(words) == 0, (line, capfd.readouterr().err)
        else:
            path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
            subprocess.run(
                ["bash", "-c", line], env={**os.environ, "PATH": path}, check=True, timeout=HANGS
            )
    return capfd.readouterr().out


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=pytest.mark.slow if page.stem in QUICK else pytest.mark.exhaustive)
        for page in PAGES
    ],
    ids=lambda page: page.stem,
)
@pytest.mark.filterwarnings("default")
@pytest.mark.usefixtures("shared_workers")
def test_a_page_runs_from_an_empty_folder_and_gives_its_numbers(page, tmp_path, monkeypatch, capfd):
    """Numbers agree within three joint errors. By chance one number in 370 does not."""
    text = page.read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    for name in re.findall(r"\]\((files/[\w.]+)\)", text):
        shutil.copy(page.parent / name, tmp_path)
    for block in BLOCK.finditer(text):
        not_run, language, code, after = block.groups()
        saved = re.search(r"[Ss]ave this (?:\w+ )?as\s+`([\w./]+)`:\s*\Z", text[: block.start()])
        if saved:
            (tmp_path / saved[1]).parent.mkdir(exist_ok=True)
            (tmp_path / saved[1]).write_text(code, encoding="utf-8")
        elif not not_run and language in ("sh", "python"):
            computed = numbers(run(language, code, capfd))
            for value, error, unit in numbers(after):
                near = [
                    abs(value - other) <= 3.0 * math.hypot(error, other_error)
                    for other, other_error, other_unit in computed
                    if unit in ("", other_unit)
                ]
                assert any(near), (page.name, value, error, unit, computed)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", EXAMPLES)
@pytest.mark.usefixtures("shared_workers")
def test_the_example_of_a_public_name_runs(name, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    run("python", f"import harvester\n{EXAMPLES[name]}", capfd)
