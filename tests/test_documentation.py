"""Names in the documentation exist: files, functions, commands, keys; loads on pages are read."""

import importlib
import re
import shlex
import tomllib
from pathlib import Path

import pytest

import harvester
import harvester.base.errors
from circuits.netlist.expression import FUNCTIONS
from circuits.netlist.subcircuits import read_load
from harvester.cli.command_line import main, parsed
from harvester.cli.table import COMMANDS
from harvester.scene.tables import KINDS, Top, all_tables

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]


def blocks(text, language):
    """Contents of fenced code blocks of one language."""
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def found(dotted):
    """Whether a dotted name leads to a module or to a member of one."""
    module, _, name = dotted.rpartition(".")
    try:
        if hasattr(importlib.import_module(module), name):
            return True
        importlib.import_module(dotted)
    except ImportError:
        return False
    return True


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files(page):
    links = re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8"))
    missing = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_names_lead_to_functions(page):
    names = re.findall(r"`((?:harvester|circuits)\.[\w.]+)`", page.read_text(encoding="utf-8"))
    assert not [name for name in names if not found(name)]


def source():
    """Text of all Python sources: where a name that the documentation uses must occur."""
    folders = ("harvester", "circuits", "tests")
    return "\n".join(p.read_text("utf-8") for each in folders for p in (ROOT / each).rglob("*.py"))


def in_code(page):
    """What stands between backticks outside code blocks."""
    text = re.sub(
        r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL
    )
    return re.findall(r"`([^`\n]+)`", text)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_are_named_exist(page):
    """Names with capitals, as NAME.lib, and what a page tells to save are the reader's own."""
    named = re.compile(
        r"(?:harvester|circuits|netlists|tests|notebooks|docs)/[\w./]*|[\w/.]+\.(?:md|py)"
    )
    saved = re.findall(r"[Ss]ave this (?:\w+ )?as\s+`([\w./]+)`", page.read_text(encoding="utf-8"))
    paths = [
        word
        for word in in_code(page)
        if named.fullmatch(word) and not re.search("[A-Z]{2}_", word) and word not in saved
    ]
    assert not [path for path in paths if not (ROOT / path).exists()]


@pytest.mark.slow
def test_the_names_of_the_recipes_are_in_the_code():
    """Classes, tables, functions and keys; a call is named with its arguments."""
    words = [re.sub(r"\(.*", "", word) for word in in_code(ROOT / "CONTRIBUTING.md")]
    names = [word for word in words if re.fullmatch(r"[A-Za-z_]\w*", word)]
    assert len(names) > 20
    assert not [name for name in names if not re.search(rf"\b{name}\b", source())]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_make_targets_and_commands_that_are_named_exist(page):
    text = page.read_text(encoding="utf-8")
    rules = re.findall(
        r"^(\w[\w-]*):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE
    )
    lines = [line for block in blocks(text, "sh") for line in block.splitlines()]
    words = [words.split() for words in (*in_code(page), *lines)]
    assert {each[1] for each in words if each[:1] == ["make"] and each[1:]} <= set(rules)
    said = {each[1] for each in words if each[:1] == ["harvester"] and each[1:]}
    said.discard("COMMAND")
    assert {name for name in said if not name.startswith("-")} <= set(COMMANDS)
    ran = re.findall(r"-m pytest (\S+\.py)(?:::\w+)?", text)
    assert not [path for path in ran if not (ROOT / path).exists()]


def test_the_reference_has_every_public_name_once():
    text = (DOCS / "reference" / "python.md").read_text(encoding="utf-8")
    named = re.findall(r"^   (\w+)$", text, re.MULTILINE)
    kinds = [name for name in vars(harvester.base.errors) if not name.startswith("_")]
    assert sorted(named) == sorted(set(harvester.__all__) - {"__version__", *kinds})


def test_every_page_is_on_the_site():
    text = (DOCS / "index.md").read_text(encoding="utf-8")
    listed = [line for block in blocks(text, "{toctree}") for line in block.split()]
    pages = {str(path.relative_to(DOCS).with_suffix("")) for path in DOCS.rglob("*.md")} - {"index"}
    notebooks = {f"../notebooks/{path.stem}" for path in (ROOT / "notebooks").glob("*.py")}
    assert {line for line in listed if not line.startswith(":")} >= pages | notebooks


def test_the_gallery_shows_every_notebook():
    text = (DOCS / "gallery.md").read_text(encoding="utf-8")
    names = [path.name for path in sorted((ROOT / "notebooks").glob("*.py"))]
    pictures = re.findall(r"\[!\[.+?\]\((\S+)\)\]\(../notebooks/(\S+)\)", text)
    assert pictures == [(f"thumbnails/{name[:2]}.png", name) for name in names]


def test_the_readme_keeps_its_two_commands():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert re.findall(r"^make \w+", text, re.MULTILINE) == ["make run", "make test"]


def test_the_theory_names_functions():
    text = (DOCS / "explanation" / "theory.md").read_text(encoding="utf-8")
    assert len(set(re.findall(r"`((?:harvester|circuits)\.[\w.]+)`", text))) > 30


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_are_accepted(page):
    for block in blocks(page.read_text(encoding="utf-8"), "sh"):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line.split("&&")[0], comments=True)
            if words[:1] == ["harvester"] and words[1:]:
                assert parsed(words[1:])


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_a_command_holds_an_example_that_is_accepted(name, capsys):
    assert main([name, "--help"]) == 0
    example = capsys.readouterr().out.partition("example: ")[2]
    words = shlex.split(example)
    assert words[:2] == ["harvester", name]
    assert parsed(words[1:])


@pytest.mark.parametrize("page", ["how-to/rectifier", "tutorials/first-hour", "how-to/node"])
def test_the_load_on_a_page_is_read(page, tmp_path):
    text, *_ = blocks((DOCS / f"{page}.md").read_text(encoding="utf-8"), "spice")
    path = tmp_path / "my_rectifier.lib"
    path.write_text(text)
    load = read_load(path)
    assert load.has_output
    assert {element.letter for element in load.across_output} >= {"r"}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_keys_in_fragments_of_scenes_exist(page):
    text = page.read_text(encoding="utf-8")
    for block in blocks(text, "toml"):
        for name, table in tomllib.loads(block).items():
            cls = all_tables().get(name)
            if cls is KINDS:
                cls = KINDS[table.get("kind", "ornstein-uhlenbeck")]
            if cls is None:
                assert name in Top.KEYS or page.stem in ("CONTRIBUTING", "editor")
                continue
            assert set(table) <= {*cls.KEYS, "kind"}, (name, table)


def test_the_reference_lists_every_function_of_expressions():
    text = (DOCS / "reference" / "netlists.md").read_text(encoding="utf-8")
    listed = text.partition("## Functions\n")[2].partition("Their meaning")[0]
    assert sorted(re.findall(r"`(\w+)`", listed)) == sorted(FUNCTIONS)


@pytest.mark.parametrize("page", sorted(DOCS.glob("how-to/*.md")), ids=lambda page: page.stem)
def test_a_guide_is_short(page):
    assert len(page.read_text(encoding="utf-8").split()) <= 900


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_line_of_text_is_a_comment(page):
    """MyST omits lines that begin with a percent sign."""
    assert not re.findall("^%.*", page.read_text(encoding="utf-8"), re.MULTILINE)


def test_the_citation_has_the_programs_version():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {harvester.__version__}\n" in text
