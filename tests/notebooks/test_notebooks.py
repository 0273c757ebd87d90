"""Every notebook runs from top to bottom and ends with its answer and a figure."""

import ast
import re
from pathlib import Path

import pytest

jupytext = pytest.importorskip("jupytext", reason="needs the extra `notebooks`")
nbclient = pytest.importorskip("nbclient", reason="needs the extra `notebooks`")
pytest.importorskip("ipykernel", reason="needs the extra `notebooks`")

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.py"))

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
        r"circuit is ([\d.]+)% from.*fokker_planck ([\d.]+)% and the closure as printed ([\d.]+)%.*"
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
}


def outputs(cell, kind):
    """Contents of one kind that a cell printed ("text") or showed (a MIME type)."""
    if kind == "text":
        return [o["text"] for o in cell.outputs if o.get("name") == "stdout"]
    return [o["data"][kind] for o in cell.outputs if kind in o.get("data", {})]


def test_the_notebooks_are_there():
    numbers = [path.name[:2] for path in NOTEBOOKS]
    assert numbers == ["01", "02", "03", "04", "05", "06"]


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
    said, holds = ANSWERS[path.name[:2]]
    numbers = [float(text) for text in re.search(said, answer).groups()]
    assert holds(*numbers), answer
    assert outputs(last, "image/png")
