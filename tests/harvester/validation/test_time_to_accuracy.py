"""Error over wall time: its arithmetic, biases that were put in, and the command."""

import dataclasses
import json
import math

import pytest

from harvester.cli.command_line import main
from harvester.engines.opening import open_runner
from harvester.engines.simulate import simulate
from harvester.results import palette
from harvester.scene.model import Scene
from harvester.statistics.estimate import Estimate
from harvester.statistics.moments import QUANTITIES
from harvester.validation import accuracy_measurement as module
from harvester.validation import timed
from harvester.validation.accuracy_methods import COMPILED_METHODS, METHODS, ComparedMethod
from harvester.validation.time_to_accuracy import duration, reached, time_to_accuracy
from harvester.validation.timed import Timed
from harvester.validation.total_error import TotalError, bias_of

pytestmark = pytest.mark.usefixtures("shared_workers")

FEW = (
    ComparedMethod("circuit", "circuit", 2),
    ComparedMethod("Monte Carlo, Runge–Kutta", "monte-carlo", 4),
    ComparedMethod("Monte Carlo, Heun", "monte-carlo", 2, scheme="heun"),
)
SQUARE = "mean_square_voltage"


def total_error(bias, error, scatter=2.0, cost=1e-3):
    return TotalError(Estimate(bias, error, None, "1"), scatter, cost)


def test_the_error_falls_as_the_root_of_time_and_stays_at_the_bias():
    error = total_error(0.02, 0.001)
    early, later = error.after(1e-3), error.after(4e-3)
    assert early / later == pytest.approx(2.0, rel=1e-3)
    assert error.after(1e9) == pytest.approx(math.sqrt(0.02**2 - 0.001**2), rel=1e-6)
    for limit in (0.1, 0.03):
        assert error.after(error.seconds_to(limit)) == pytest.approx(limit)
    assert error.seconds_to(0.01) == math.inf
    assert reached(error, 0.01) == "never"


def test_a_bias_within_its_own_error_bar_is_none_but_shows_nothing():
    error = total_error(0.01, 0.02)
    assert error.resolved_bias == 0.0
    assert error.seconds_to(0.01) == pytest.approx(2.0**2 * 1e-3 / 0.01**2)
    assert [error.is_shown(limit) for limit in (0.1, 0.03, 0.01)] == [True, False, False]
    assert reached(error, 0.01) == "40 s (?)"
    assert reached(total_error(0.01, None), 0.1) == "—"


def test_durations_have_a_unit_that_fits():
    texts = [duration(seconds) for seconds in (2.2e-6, 0.034, 5.0, 90.0, 7200.0, 3e5)]
    assert texts == ["2.2 µs", "34 ms", "5 s", "1.5 min", "2 h", "3.5 d"]


@pytest.fixture(scope="module")
def runs():
    """The same realizations twice, as many as a bias needs for an error bar."""
    overrides = ["run.realizations=16", "run.duration=400", "run.settle=40"]
    scene = Scene.read("linear", overrides)
    moments = simulate(scene, method="monte-carlo", workers=1).moments
    return moments, lambda some: Timed(scene, [{"moments": some, "seconds": 1.0}])


def with_bias(moments, factor):
    integrals = moments.integrals.copy()
    integrals[:, QUANTITIES.index("square_voltage")] *= factor
    return dataclasses.replace(moments, integrals=integrals)


def test_a_bias_on_the_same_paths_is_found_far_below_the_sampling_error(runs):
    theirs, timed_run = runs
    ours = timed_run([with_bias(each, 1.003) for each in theirs[:8]])
    bias, whole = bias_of(SQUARE, ours, timed_run(theirs)), timed_run(theirs).quantities()
    assert bias.estimate == pytest.approx(0.003, abs=3.0 * bias.standard_error)
    assert bias.standard_error < 0.05 * whole[SQUARE].standard_error / whole[SQUARE].estimate


def test_on_other_paths_its_error_is_that_of_both_means(runs):
    moments, timed_run = runs
    ours = timed_run([with_bias(each, 1.5) for each in moments[:8]])
    theirs = timed_run(moments[8:])
    bias, few, whole = bias_of(SQUARE, ours, theirs), ours.quantities(), theirs.quantities()
    # Five standard errors: one false alarm in a million, of this seed none.
    assert abs(bias.estimate - 0.5) < 5.0 * bias.standard_error
    assert bias.standard_error > few[SQUARE].standard_error / whole[SQUARE].estimate


def test_every_method_has_a_colour_and_a_marker_of_its_own():
    families = dict.fromkeys(each.family for each in (*METHODS, *COMPILED_METHODS))
    found = palette.styles([*families, "one more", "another"])
    markers = [style[1] for style in found.values()] + list(palette.CLOSURE_MARKERS.values())
    assert len(set(markers)) == len(markers)
    colours = [style[0] for style in found.values()]
    colours += [colour for colour, _ in palette.LINES.values()]
    assert len(set(colours)) == len(colours)


@pytest.fixture
def briefly(monkeypatch):
    monkeypatch.setattr(module, "TIMED_METHODS", FEW)
    monkeypatch.setattr("harvester.validation.accuracy_methods.COMPILED_METHODS", ())
    compiled = ComparedMethod("Monte Carlo, TR-BDF2", "monte-carlo", 2)
    monkeypatch.setattr(module, "TIMED_LOAD_METHODS", (FEW[0], compiled))
    monkeypatch.setattr(timed, "NOISE_CLOSURES", ("consistent",))
    monkeypatch.setattr(module, "MOST_REALIZATIONS", 32)


SHORT = ["run.duration=200", "run.settle=20"]


@pytest.mark.slow
@pytest.mark.usefixtures("briefly")
def test_what_was_measured_is_kept_with_its_times(tmp_path, pool):
    told = []
    for computed in (True, False):
        with open_runner(tmp_path, executor=pool) as runner:
            found = time_to_accuracy(Scene.read("linear", SHORT), seconds=0.05, runner=runner)
            assert bool(runner.computed) == computed
        told.append(json.dumps(found.to_dict(), allow_nan=False))
    assert told[0] == told[1]
    header, rows = found.table()
    assert {len(row) for row in rows} == {len(header)}
    assert [row[0] for row in rows] == [*(each.family for each in FEW), "averaging, consistent"]
    for line in found.lines:
        error = line.errors[SQUARE]
        assert error.cost > 0.0
        # The linear device has no bias worth naming; five standard errors, as above.
        assert abs(error.bias.estimate) < 0.01 + 5.0 * error.bias.standard_error


@pytest.mark.slow
@pytest.mark.usefixtures("briefly")
def test_the_command_draws_and_writes(tmp_path, capsys):
    options = [f"--set={each}" for each in SHORT]
    call = ["time-to-accuracy", "linear", "--seconds", "0.05", "--output", str(tmp_path), *options]
    assert main(call) == 0
    content = json.loads((tmp_path / "time-to-accuracy.json").read_text())
    assert [each["scene"]["name"] for each in content["results"]] == ["linear"]
    assert (tmp_path / "time-to-accuracy.png").read_bytes().startswith(b"\x89PNG")
    assert "time to accuracy" in capsys.readouterr().out
    assert main(["time-to-accuracy", "linear", "--seconds", "0"]) == 2


@pytest.mark.slow
@pytest.mark.usefixtures("briefly")
def test_a_rectifier_is_timed_by_its_output_power(pool):
    overrides = ["load.netlist=bridge", "run.duration=2", "run.settle=0.5"]
    found = time_to_accuracy(Scene.read("device", overrides), seconds=0.5, executor=pool)
    assert found.quantities == ("mean_output_power", "power_conversion_efficiency")
    assert [line.name for line in found.lines] == ["circuit", "Monte Carlo, TR-BDF2"]
    assert set(found.refused) == {"consistent"}
