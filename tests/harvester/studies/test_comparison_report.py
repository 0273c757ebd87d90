import dataclasses
import re
import sys
from html.parser import HTMLParser

import pytest

from circuits.equivalent.assembly import assemble
from harvester.averaging.of_scene import average
from harvester.cli.command_line import main
from harvester.engines.simulate import simulate
from harvester.results.result import with_error
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.statistics.paired import paired_difference
from harvester.studies.comparison.comparison import Comparison

EMPTY = {"meta", "img", "br"}


class Page(HTMLParser):
    """Checks that tags nest, and collects what a page says and refers to."""

    def __init__(self, text):
        super().__init__()
        self.open, self.references, self.words, self.depth = [], [], [], 0
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.references += [value for name, value in attrs if name in ("src", "href", "srcset")]
        if tag not in EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


@pytest.fixture(scope="module")
def comparison(pool):
    scene = Scene.read("duffing", ["run.realizations=4", "run.duration=600", "run.settle=10"])
    results = [
        simulate(scene, method=engine, runner=pool, window=(0.0, 20.0))
        for engine in ("circuit", "monte-carlo")
    ]
    closures = {"consistent": average(scene, method="consistent")}
    refused = {"consistent": "noise <script>that</script> outlasts"}
    return Comparison(*results, closures, refused, paired_difference(*results))


@pytest.mark.slow
def test_the_page_is_whole_and_loads_nothing(comparison):
    text = comparison.page()
    page = Page(text)
    assert page.open == []
    assert len(page.references) == 4
    assert all(link.startswith("data:image/svg+xml;base64,") for link in page.references)
    assert "<script" not in text
    assert not re.search(r"@import|url\(|\$\w", text)
    words = "".join(page.words)
    assert "noise <script>that</script> outlasts" in words
    assert assemble(prepared(comparison.scene)).text in words
    assert with_error(comparison.circuit.quantity("mean_power")) in words
    assert comparison.scene.digest() in words
    for fact in ("seed", "harvester 0", "ngspice-", "numpy", "oscillator.damping"):
        assert fact in words


@pytest.mark.slow
def test_without_schemdraw_the_page_says_so(comparison, monkeypatch):
    monkeypatch.setitem(sys.modules, "schemdraw", None)
    page = Page(comparison.page())
    assert len(page.references) == 3
    assert "pip install 'vibration-harvester[schematic]'" in "".join(page.words)


def test_a_place_that_cannot_be_written_is_refused_before_the_run(capsys):
    assert main(["validate", "paper", "--report", "/dev/null/a.html"]) == 2
    assert "cannot be written" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.usefixtures("shared_workers")
def test_the_command_writes_the_page(tmp_path, capsys):
    """Of a load that no closure takes: closures would take most of the time."""
    sets = ["run.realizations=2", "run.duration=4", "run.settle=1", "load.netlist=bridge"]
    brief = [word for each in sets for word in ("--set", each)]
    assert main(["validate", "device", *brief, "--report", str(tmp_path / "a.html")]) == 0
    assert Page((tmp_path / "a.html").read_text()).open == []


@pytest.mark.slow
def test_the_table_says_why_an_error_bar_is_missing(comparison):
    name, reason = next(iter(comparison.compared)), "the record is too short"
    circuit = comparison.circuit
    estimates = circuit.scaled_quantities
    bare = dataclasses.replace(estimates[name], standard_error=None, note=reason)
    circuit = dataclasses.replace(circuit, scaled_quantities={**estimates, name: bare})
    header, rows = dataclasses.replace(comparison, circuit=circuit).table()
    assert header[-1] == "no error bar because"
    assert {len(row) for row in rows} == {len(header)}
    assert [row[0] for row in rows if row[-1] == reason] == [name.replace("_", " ")]


@pytest.mark.slow
def test_every_column_of_the_table_has_its_own_unit_and_roots_are_compared_too(comparison):
    header, rows = comparison.table()
    assert header[4:6] == ["difference [σ]", "paired relative bias"]
    assert len(rows) == len(comparison.compared) + 1
    by_name = {row[0]: row for row in rows}
    square, root = by_name["mean square displacement"], by_name["rms displacement"]
    # To first order in the errors, of about 10 %.
    assert root[4].value == pytest.approx(square[4].value, abs=0.1)
    assert root[6].endswith("σ)")
    frame = comparison.to_dataframe().set_index("quantity")
    assert frame["unit"]["mean power"] == "scaled power"
    assert frame["difference [σ]"]["rms displacement"] == root[4].value
    assert repr(comparison).startswith("<Comparison of duffing: Circuit and Monte Carlo ")
    assert "…" not in repr(comparison)
