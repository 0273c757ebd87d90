"""What the documentation names is there: files, functions, commands, the load it shows."""

import importlib
import re
import shlex
from pathlib import Path

import pytest

from circuits.subcircuits import read_load
from harvester.command_line import COMMANDS, build_parser

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(text, language):
    """Contents of fenced code blocks of one language."""
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def found(dotted):
    """Whether a dotted name leads to something."""
    module, _, name = dotted.rpartition(".")
    try:
        return hasattr(importlib.import_module(module), name)
    except ImportError:
        return False


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files(page):
    links = re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8"))
    missing = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_names_lead_to_functions(page):
    names = re.findall(r"`((?:harvester|circuits)\.[\w.]+)`", page.read_text(encoding="utf-8"))
    assert not [name for name in names if not found(name)]


def test_the_theory_names_functions():
    text = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
    assert len(set(re.findall(r"`((?:harvester|circuits)\.[\w.]+)`", text))) > 30


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_are_accepted(page):
    for block in blocks(page.read_text(encoding="utf-8"), "sh"):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line.split("&&")[0], comments=True)
            if words[:1] == ["harvester"]:
                assert build_parser()[0].parse_args(words[1:]).command


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.__name__)
def test_the_help_of_a_command_holds_an_example_that_is_accepted(command, capsys):
    name = command.__name__.rpartition(".")[2].replace("_", "-")
    with pytest.raises(SystemExit):
        build_parser()[0].parse_args([name, "--help"])
    example = capsys.readouterr().out.partition("example: ")[2]
    words = shlex.split(example)
    assert words[:2] == ["harvester", name]
    assert build_parser()[0].parse_args(words[1:]).command is command.run


def test_the_load_of_the_readme_is_one(tmp_path):
    (text,) = blocks((ROOT / "README.md").read_text(encoding="utf-8"), "spice")
    path = tmp_path / "my_rectifier.lib"
    path.write_text(text)
    load = read_load(path)
    assert load.has_output
    assert load.output_resistors
    assert load.storage
