"""Every notebook runs from top to bottom and ends with its answer and a figure."""

import ast
from pathlib import Path

import pytest

jupytext = pytest.importorskip("jupytext", reason="needs the extra `notebooks`")
nbclient = pytest.importorskip("nbclient", reason="needs the extra `notebooks`")
pytest.importorskip("ipykernel", reason="needs the extra `notebooks`")

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.py"))


def outputs(cell, kind):
    """Contents of one kind that a cell printed ("text") or showed (a MIME type)."""
    if kind == "text":
        return [o["text"] for o in cell.outputs if o.get("name") == "stdout"]
    return [o["data"][kind] for o in cell.outputs if kind in o.get("data", {})]


def test_the_notebooks_are_there():
    numbers = [path.name[:2] for path in NOTEBOOKS]
    assert numbers == ["01", "02", "03", "04", "05"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_opens_with_a_question_and_is_plain_python(path):
    notebook = jupytext.read(path)
    ast.parse(path.read_text(encoding="utf-8"))
    first = notebook.cells[0]
    assert first.cell_type == "markdown"
    title = first.source.splitlines()[0]
    assert title.startswith("# ")
    assert title.endswith("?")


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
# The kernel's own libraries warn about themselves.
@pytest.mark.filterwarnings("default")
def test_a_notebook_runs_and_ends_with_an_answer_and_a_figure(path, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(ROOT), prepend=":")
    notebook = jupytext.read(path)
    client = nbclient.NotebookClient(notebook, kernel_name="python3", timeout=600)
    client.execute(cwd=str(tmp_path))
    last = [cell for cell in notebook.cells if cell.cell_type == "code"][-1]
    (answer,) = outputs(last, "text")
    assert answer.endswith(".\n")
    assert any(character.isdigit() for character in answer)
    assert outputs(last, "image/png")
