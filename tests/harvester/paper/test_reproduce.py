"""A figure from its declaration to its files, with tiny settings."""

import json
from dataclasses import replace

import numpy as np
import pytest

from harvester import figures
from harvester.averaging import CLOSURES
from harvester.command_line import main
from harvester.estimators import Density
from harvester.paper import drawing, figures_list
from harvester.paper import reproduce as module
from harvester.paper.figures_list import FIGURES
from harvester.paper.reproduce import Effort, reproduce
from harvester.scene import Scene

TINY = {"monte-carlo": Effort(400.0, 0.5, 800.0), "circuit": Effort(100.0, 0.5, 100.0)}
SCENE = Scene.load("paper", ["run.settle=20"])


@pytest.fixture
def tiny(monkeypatch):
    """One curve over two couplings, of which one is refused, and one density."""
    monkeypatch.setattr(module, "QUICK", TINY)
    sweep, density = FIGURES["fig8"], FIGURES["fig5"]
    panel = replace(
        sweep.panels[1], first=0.3, last=4.5, quick=2, curves=sweep.panels[1].curves[:1]
    )
    monkeypatch.setitem(figures_list.FIGURES, "fig8", replace(sweep, panels=(panel,)))
    one = replace(density.panels[0], curves=density.panels[0].curves[:1])
    monkeypatch.setitem(figures_list.FIGURES, "fig5", replace(density, panels=(one,)))


def test_a_figure_holds_every_method_and_lists_what_was_refused(tiny, pool, tmp_path):
    contents = reproduce(SCENE, ["fig5", "fig8"], quick=True, pool=pool)
    density, sweep = contents
    (line,) = sweep.lines[0]
    assert list(line) == [*CLOSURES, "monte-carlo", "circuit"]
    assert [value for value, _ in line["monte-carlo"]] == [0.3, 4.5]
    # β = 4.5 ≥ ω0² leaves no double well to the first two closures.
    assert {(m, where) for m, where, _ in sweep.refused} >= {
        ("paper", "τ1 = 0.4, β = 4.5"),
        ("consistent", "τ1 = 0.4, β = 4.5"),
    }
    assert any("refused by paper at τ1 = 0.4, β = 4.5" in text for text in sweep.sentences())
    for content in contents:
        header, rows = content.table()
        assert {len(row) for row in rows} == {len(header)}
        told = json.loads(json.dumps(content.to_dict(), allow_nan=False))
        methods = told["panels"][0]["curves"][0]["methods"]
        for point in methods["monte-carlo"]:
            assert point["seed"] == SCENE.run.seed
            assert point["seconds"] > 0.0
            assert point["quantities"]["mean_square_voltage"]["standard_error"] != 0.0
        figures.save(drawing.draw, content, tmp_path / "figure.png")
        assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")
    assert "density" in density.to_dict()["panels"][0]["curves"][0]["methods"]["circuit"][0]


def test_figures_share_the_scenes_that_they_have_in_common():
    """Curves of Fig. 9 for δr = 1.1 and e = 0.7 are one device; so is Fig. 7's at τ1 = 0.4."""
    requests = [
        request
        for name in ("fig7", "fig9")
        for lines in module._plan(SCENE, FIGURES[name], quick=True)
        for line in lines
        for _, request in line["monte-carlo"]
    ]
    assert len(requests) == 12 + 54
    assert len(set(requests)) == len(requests) - 12


def test_the_distance_of_densities_is_that_of_two_uniform_ones():
    edges = np.linspace(-2.0, 2.0, 401)
    centre = 0.5 * (edges[1:] + edges[:-1])
    wide = Density(centre, np.where(abs(centre) < 1.0, 0.5, 0.0), None, "displacement")
    narrow = Density(centre, np.where(abs(centre) < 0.5, 1.0, 0.0), None, "displacement")
    assert module._distance(narrow, wide) == pytest.approx(1.0, abs=0.02)


def test_the_command_names_the_nearest_figure(capsys):
    assert main(["reproduce", "fig11"]) == 2
    assert "did you mean fig1" in capsys.readouterr().err


def test_the_command_writes_one_png_and_one_json_each(tiny, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(Scene, "load", lambda name: SCENE)
    assert main(["reproduce", "fig5", "--quick", "--output", str(tmp_path)]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"fig5.png", "fig5.json"}
    assert "∫|p − p'| dX" in capsys.readouterr().out
