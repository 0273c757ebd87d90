"""The site is built without a warning; every notebook in it ends with its answer and a figure."""

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import harvester
from harvester.cli.table import COMMANDS

jupytext = pytest.importorskip("jupytext", reason="needs the extra `notebooks`")
jupyter_cache = pytest.importorskip("jupyter_cache", reason="needs the extra `docs`")
pytest.importorskip("myst_nb", reason="needs the extra `docs`")
pytest.importorskip("sphinx_copybutton", reason="needs the extra `docs`")

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.py"))

# As `make docs` makes the site.
MADE_BY = ("-c", "docs", "-b", "html", "--fail-on-warning", "--keep-going")
# What the last sentence of each notebook says, and what holds of its numbers: error bars of at most
# a fifth, engines within four joint standard errors (false alarm one in 16 000).
ANSWERS = {
    "01": (
        r"gives ([\d.]+) ± ([\d.]+) scaled.* at most ([\d.]+) joint.*paper is ([+-]\d+)%",
        lambda power, error, apart, printed: (
            0.0 < error < 0.2 * power
            and abs(power - 0.0011) < 4.0 * error
            and apart < 4.0
            and printed > 100.0
        ),
    ),
    "02": (
        r"gives ([\d.]+) ± ([\d.]+) mW at (\d+) kΩ.*resistor is (\d+)% ± (\d+)% ahead",
        lambda power, error, place, ahead, margin: (
            0.0 < error < 0.2 * power
            and abs(power - 2.09) < 4.0 * error
            and 100.0 <= place <= 5000.0
            and ahead > 2.0 * margin
        ),
    ),
    "03": (
        r"longest circuit step .* is ([\d.]+) s; it costs ([\d.]+) times .*default, ([\d.]+) s",
        lambda step, price, default: step <= default and price >= 0.5,
    ),
    "04": (
        r"circuit is ([\d.]+)% from.*fokker_planck ([\d.]+)% and the method as printed ([\d.]+)%.*"
        r"E\[P\] rises with β held, and E\[V²\] rises with β did not",
        lambda circuit, slow, printed: max(circuit, slow) < 15.0 < printed,
    ),
    "05": (
        r"gives ([\d.]+) ± ([\d.]+) µW;.* are ([\d.]+) joint",
        lambda power, error, apart: 0.0 < error < 0.2 * power and apart < 4.0,
    ),
    "06": (
        r"power to ([+-][\d.]+) ± ([\d.]+) %,.*loads (\d+) kΩ gives most, ([\d.]+) ± ([\d.]+) mW",
        lambda off, spread, place, power, error: (
            abs(off) < 3.0 + 4.0 * spread and 50 <= place <= 2000 and 0.0 < error < 0.2 * power
        ),
    ),
    "07": (
        r"is up (\d+) ± (\d+) % .* sends (\d+) ± (\d+) bursts .* up after (\d+) ± \d+ s: .* "
        r"([\d.]+)% gets to the node; .* is up (\d+) ± (\d+) % .* up after (\d+) ± (\d+) s",
        lambda up, error, bursts, spread, first, share, large, margin, later, doubt: (
            abs(up - 93.0) < 4.0 * max(error, 1.0)
            and 0.0 < spread < 0.2 * bursts
            and 1.0 < share < 20.0
            and abs(large - up) < 4.0 * max(margin, 1.0)
            and later - 4.0 * doubt > 2.0 * first
        ),
    ),
    "08": (
        r"(\d) other tools follow the circuit's path .* by (\d\.\de-\d+) of the rms",
        lambda tools, off: tools >= 1 and off < 1e-3,
    ),
}


def outputs(cell, kind):
    """Contents of one kind that a cell printed ("text") or showed (a MIME type)."""
    if kind == "text":
        return [o["text"] for o in cell.outputs if o.get("name") == "stdout"]
    return [o["data"][kind] for o in cell.outputs if kind in o.get("data", {})]


def test_the_notebooks_are_there():
    numbers = [path.name[:2] for path in NOTEBOOKS]
    assert numbers == ["01", "02", "03", "04", "05", "06", "07", "08"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_opens_with_a_question_and_is_plain_python(path):
    notebook = jupytext.read(path)
    ast.parse(path.read_text(encoding="utf-8"))
    first = notebook.cells[0]
    assert first.cell_type == "markdown"
    title = first.source.splitlines()[0]
    assert title.startswith("# ")
    assert title.endswith("?")


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_uses_public_names_alone(path):
    """Of this project's packages it imports `harvester`, and reads names out of its `__all__`."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    modules = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            modules.add(node.module)
        elif isinstance(node, ast.Import):
            modules.update(alias.name for alias in node.names)
        elif isinstance(node, ast.Attribute) and getattr(node.value, "id", "") == "harvester":
            assert node.attr in harvester.__all__, node.attr
    assert {name for name in modules if name.startswith(("harvester", "circuits"))} == {"harvester"}


def build(folder, *options):
    """The site made anew in a folder, and what Sphinx said of it."""
    return subprocess.run(
        [sys.executable, "-m", "sphinx", *MADE_BY, *options, ".", str(folder / "docs")],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Folder of a site with every notebook executed, and what Sphinx said of it."""
    folder = tmp_path_factory.mktemp("site")
    return folder, build(folder)


def check_pages(folder, made):
    assert made.returncode == 0, made.stderr
    theory = (folder / "docs" / "docs" / "explanation" / "theory.html").read_text("utf-8")
    assert theory.count("<math ") > 40
    assert "<merror" not in theory
    api = folder / "docs" / "docs" / "reference" / "api"
    simulate = (api / "harvester.simulate.html").read_text("utf-8")
    assert 'id="harvester.simulate"' in simulate
    assert '<p class="rubric">Example</p>' in simulate
    commands = (folder / "docs" / "docs" / "reference" / "commands.html").read_text("utf-8")
    assert not [name for name in COMMANDS if f"harvester {name} " not in commands]
    # Nothing is fetched to show a page.
    pages = list((folder / "docs").rglob("*.html"))
    assert len(pages) > 20
    fetched = re.compile(r'<(?:script|img|link)[^>]*(?:src|href)="(?:https?:)?//[^"]*"')
    assert not [page.name for page in pages if fetched.search(page.read_text("utf-8"))]
    # Every figure has an alternative text; without one, Sphinx writes the file's path.
    silent = re.compile(r'<img(?![^>]*\balt="[^".][^"]*")')
    assert not [page.name for page in pages if silent.search(page.read_text("utf-8"))]


@pytest.mark.slow
def test_the_site_is_built_without_a_warning(tmp_path):
    """Its notebooks are shown and not executed."""
    check_pages(tmp_path, build(tmp_path, "-D", "nb_execution_mode=off"))


@pytest.mark.exhaustive
def test_the_site_is_built_without_a_warning_and_its_notebooks_are_executed(site):
    check_pages(*site)


@pytest.mark.exhaustive
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_of_the_site_ends_with_an_answer_and_a_figure(path, site):
    cache = jupyter_cache.get_cache(site[0] / ".jupyter_cache")
    (record,) = (each for each in cache.list_cache_records() if Path(each.uri).stem == path.stem)
    notebook = cache.get_cache_bundle(record.pk).nb
    last = [cell for cell in notebook.cells if cell.cell_type == "code"][-1]
    (answer,) = outputs(last, "text")
    assert answer.endswith(".\n")
    said, holds = ANSWERS[path.name[:2]]
    numbers = [float(text) for text in re.search(said, answer).groups()]
    assert holds(*numbers), answer
    assert outputs(last, "image/png")
