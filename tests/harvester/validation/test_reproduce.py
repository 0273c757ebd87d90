"""A figure from its declaration to its files, with tiny settings."""

import json
from dataclasses import replace

import numpy as np
import pytest
from matplotlib import style
from matplotlib.backends.backend_agg import FigureCanvasAgg

from harvester.averaging.closures import NOISE_CLOSURES
from harvester.base.errors import AveragingError, SimulationError
from harvester.cli.command_line import main
from harvester.engines.request import Answer
from harvester.engines.runner import Runner
from harvester.results import figures
from harvester.scene.model import Scene
from harvester.statistics.estimate import Density, Estimate
from harvester.validation import paper_drawing as drawing
from harvester.validation import paper_figures as figures_list
from harvester.validation import paper_figures as runs
from harvester.validation import reproduce as module
from harvester.validation.paper_figures import FIGURES
from harvester.validation.reproduce import Effort, reproduce

pytestmark = pytest.mark.usefixtures("shared_workers")

TINY = {"monte-carlo": Effort(8, 0.5, 16), "circuit": Effort(8, 0.5, 8)}
SCENE = Scene.read("paper", ["run.settle=5"])


@pytest.fixture
def tiny(monkeypatch):
    """One curve over two couplings, of which one is refused, and one density."""
    monkeypatch.setattr(module, "QUICK", TINY)
    monkeypatch.setattr(runs, "DURATIONS", {"monte-carlo": 100.0, "circuit": 15.0})
    # Coarse grids: what a closure says of its own error is told all the same.
    monkeypatch.setattr(runs, "CLOSURE_ERRORS", dict.fromkeys(runs.CLOSURE_ERRORS, 0.1))
    sweep, density = FIGURES["fig8"], FIGURES["fig5"]
    panel = replace(
        sweep.panels[1], first=0.3, last=4.5, quick=2, curves=sweep.panels[1].curves[:1]
    )
    monkeypatch.setitem(figures_list.FIGURES, "fig8", replace(sweep, panels=(panel,)))
    one = replace(density.panels[0], curves=density.panels[0].curves[:1])
    monkeypatch.setitem(figures_list.FIGURES, "fig5", replace(density, panels=(one,)))


@pytest.mark.slow
def test_a_figure_holds_every_method_and_lists_what_was_refused(tiny, pool, tmp_path):
    contents = reproduce(SCENE, ["fig5", "fig8"], quick=True, executor=pool)
    density, sweep = contents
    (line,) = sweep.lines[0]
    assert list(line) == [*NOISE_CLOSURES, "monte-carlo", "circuit"]
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
        figures.write(content.figure(), tmp_path / "figure.png")
        assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")
    assert "density" in density.to_dict()["panels"][0]["curves"][0]["methods"]["circuit"][0]


def test_figures_share_the_scenes_that_they_have_in_common():
    """Curves of Fig. 9 for δr = 1.1 and e = 0.7 are one device; so is Fig. 7's at τ1 = 0.4."""
    requests = [
        request
        for name in ("fig7", "fig9")
        for _, _, method, _, request in module.plan(name, SCENE, quick=True).points()
        if method == "monte-carlo"
    ]
    assert len(requests) == 10 + 45
    assert len(set(requests)) == len(requests) - 10


def test_the_distance_of_densities_is_that_of_two_uniform_ones():
    edges = np.linspace(-2.0, 2.0, 401)
    centre = 0.5 * (edges[1:] + edges[:-1])
    wide = Density(centre, np.where(abs(centre) < 1.0, 0.5, 0.0), None, "displacement")
    narrow = Density(centre, np.where(abs(centre) < 0.5, 1.0, 0.0), None, "displacement")
    assert module.distance(narrow, wide) == pytest.approx(1.0, abs=0.02)


def constant(value, simulated_time=0.0):
    """An answer whose means are all one value, with a normal density."""
    centre = np.linspace(-3.0, 3.0, 61)
    values = np.exp(-0.5 * centre**2) / np.sqrt(2.0 * np.pi)
    density = Density(centre, values, None, "displacement")
    names = ("mean_square_voltage", "mean_power", "power_conversion_efficiency")
    estimates = {name: Estimate(value, 0.01 * value, None, "1") for name in names}
    return Answer(SCENE, "", estimates, 0.0, simulated_time=simulated_time, density=density)


def synthetic(name, outcome=lambda method, value: constant(0.2)):
    """A whole figure without computing it; `outcome` of a method at a value."""
    planned = module.plan(name, SCENE, quick=True)
    lines = [
        [
            {m: [(v, outcome(m, v)) for v, _ in points] for m, points in line.items()}
            for line in panel
        ]
        for panel in planned.lines
    ]
    return replace(planned, lines=lines)


def test_a_refused_point_is_a_gap_in_its_line_and_named():
    """The first two of D's five values are answered, the third is not."""

    def outcome(method, value):
        if method == "consistent" and value == 0.065:
            return AveragingError("does not hold here")
        return constant(value)

    content = synthetic("fig7", outcome)
    with style.context(figures.STYLE):
        axes = drawing.draw(content).axes[0]
    lines = [line for line in axes.lines if line.get_linestyle() != "None"]
    assert len(lines) == 2 * len(NOISE_CLOSURES)
    gaps = [np.flatnonzero(np.isnan(line.get_ydata())).tolist() for line in lines]
    assert gaps == [[2] if method == "consistent" else [] for method in 2 * (*NOISE_CLOSURES,)]
    where = "τ1 = 0.4, D = 0.065"
    assert ("consistent", where, "does not hold here") in content.refused
    assert f"fig7: refused by consistent at {where}: does not hold here" in content.sentences()
    (curve, _) = content.to_dict()["panels"][0]["curves"]
    assert curve["methods"]["consistent"][2] == {"value": 0.065, "refused": "does not hold here"}
    assert content.failed_runs == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fig5", "fig6"])
def test_a_figure_without_any_answer_is_drawn_and_counts_its_failed_runs(name, tmp_path):
    def outcome(method, value):
        simulated = method in ("monte-carlo", "circuit")
        return SimulationError("stopped") if simulated else AveragingError("refused")

    content = synthetic(name, outcome)
    figures.write(content.figure(), tmp_path / "figure.svg")
    runs = sum(method in ("monte-carlo", "circuit") for _, _, method, *_ in content.points())
    assert content.failed_runs == runs > 0
    assert f"reasons in {name}.json" in (tmp_path / "figure.svg").read_text()


def test_the_legend_has_a_method_whose_runs_are_all_too_short():
    short = replace(constant(0.1), misses_jumps=True)
    series = drawing._series("circuit", [(0.1, short)], "mean_power", 1.0, drawing.COLOURS[0])
    assert [(one.label, one.marker, len(one.x)) for one in series] == [
        ("circuit", "+", 0),
        (None, drawing.SHORT, 1),
    ]


@pytest.mark.parametrize("name", ["fig5", "fig7", "fig8", "fig9"])
def test_the_legend_of_methods_fits_into_the_figure(name):
    """One figure of each width."""
    with style.context(figures.STYLE):
        figure = drawing.draw(synthetic(name))
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        box = figure.legends[0].get_window_extent(canvas.get_renderer())
    assert 0.0 <= box.x0 < box.x1 <= figure.bbox.width


@pytest.mark.slow
def test_an_interrupt_leaves_the_figures_that_were_done(tiny, tmp_path, capsys, monkeypatch):
    """Ctrl-C in the moment when the last point of the first two figures is there."""

    first = {request for *_, request in module.plan("fig5", SCENE, quick=True).points()}

    def interrupted(self, requests, on_answer, in_turn):
        for index, request in enumerate(requests):
            if request not in first:
                raise KeyboardInterrupt
            on_answer(index, constant(0.2, float(not request.is_averaged)))

    monkeypatch.setattr(Runner, "answer", interrupted)
    monkeypatch.setattr(Scene, "read", lambda name, overrides=(): SCENE)
    wanted = ["fig8", "fig5", "fig2", "--quick", "--workers", "1", "--output", str(tmp_path)]
    assert main(["reproduce", *wanted]) == 130
    written = {"fig2.png", "fig2.json", "fig5.png", "fig5.json"}
    assert {path.name for path in tmp_path.glob("[!.]*")} == {
        *written,
        "fig2.csv",
        "fig5.csv",
        "points",
    }
    told = json.loads((tmp_path / "fig5.json").read_text())
    assert set(told["panels"][0]["curves"][0]["methods"]) == {
        *NOISE_CLOSURES,
        "monte-carlo",
        "circuit",
    }
    shown = capsys.readouterr()
    assert f"interrupted; finished figures are in {tmp_path}: fig2, fig5" in shown.err
    assert "the paper's fig5" in shown.out


@pytest.mark.parametrize("wanted", [["fig11"], ["all", "fig11"]])
def test_the_command_names_the_nearest_figure(wanted, capsys):
    assert main(["reproduce", *wanted]) == 2
    assert "did you mean fig1" in capsys.readouterr().err


def test_a_folder_that_cannot_be_is_refused_before_anything_runs(tmp_path, capsys):
    (tmp_path / "file").touch()
    assert main(["reproduce", "fig2", "--output", str(tmp_path / "file")]) == 2
    shown = capsys.readouterr()
    assert shown.err.startswith(f"harvester: {tmp_path / 'file'}: cannot be written: ")
    assert shown.err.count("\n") == 1
    assert not shown.out


@pytest.mark.slow
def test_the_command_writes_one_png_and_one_json_each(tiny, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(Scene, "read", lambda name, overrides=(): SCENE)
    assert main(["reproduce", "fig5", "--quick", "--output", str(tmp_path)]) == 0
    assert {path.name for path in tmp_path.glob("[!.]*")} == {
        *("fig5.png", "fig5.json", "fig5.csv", "points")
    }
    assert "∫|p − p'| dX" in capsys.readouterr().out
