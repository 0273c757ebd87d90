import json
import math

import numpy as np
import pytest
import worker_calls
from truths import reference_path as independent_path

from harvester.averaging.closures import NOISE_CLOSURES
from harvester.base.errors import LoadError, OutOfTime
from harvester.cli.command_line import main
from harvester.engines.opening import open_runner
from harvester.engines.simulate import simulate
from harvester.engines.task import Task
from harvester.results import figures
from harvester.results.paired import paired_difference
from harvester.scene.model import Scene
from harvester.validation import MEANS, STATES, exact_paths, timed
from harvester.validation import accuracy_measurement as measurement
from harvester.validation.accuracy_drawing import draw_work_precision
from harvester.validation.accuracy_methods import (
    COMPILED_METHODS,
    LOAD_METHODS,
    METHODS,
    THOROUGH_METHODS,
    ComparedMethod,
)
from harvester.validation.work_precision import work_precision

FAMILIES = {
    # At the default step contacts ask for shorter ones: orders are those of uniform steps.
    "trapezoidal": ("circuit", 2, None, (2, 4, 8)),
    "gear": ("circuit", 2, "gear", (4, 8, 16)),
    "runge-kutta": ("monte-carlo", 4, None, (1, 2, 4)),
    "heun": ("monte-carlo", 2, "heun", (1, 2, 4)),
}
FEW = [
    ComparedMethod(family, engine, order, refinement, scheme=scheme)
    for family, (engine, order, scheme, refinements) in FAMILIES.items()
    for refinement in refinements
]
SHORT = ["run.realizations=2", "run.duration=50", "run.settle=5", "excitation.intensity=0.03"]


@pytest.fixture(scope="module", autouse=True)
def briefly():
    """Speeds have tests of their own; one closure says what all of them would.

    Fokker–Planck takes longer than the methods that are measured here.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(timed, "NOISE_CLOSURES", ("consistent",))
        patch.setattr("harvester.validation.throughput.KNOTS", 200)
        patch.setattr("harvester.validation.throughput.REPEATS", 1)
        yield


@pytest.fixture
def every_closure(monkeypatch):
    monkeypatch.setattr(timed, "NOISE_CLOSURES", NOISE_CLOSURES)


@pytest.fixture(scope="module")
def diagram(pool):
    return work_precision(Scene.read("paper", SHORT), methods=FEW, executor=pool)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("family", "tolerance"),
    [("trapezoidal", 0.3), ("gear", 0.3), ("runge-kutta", 0.6), ("heun", 0.4)],
)
def test_the_measured_order_is_the_theoretical_one(diagram, family, tolerance):
    orders = diagram.orders[family]
    for name in STATES:
        assert orders[name] == pytest.approx(FAMILIES[family][1], abs=tolerance)


def test_a_run_for_the_means_holds_its_evidence(diagram):
    for row in diagram.rows:
        assert set(row.bias) == set(MEANS)
        assert row.seconds_per_unit > 0.0
        assert row.note == ""
    # The finest Runge–Kutta row is the reference itself.
    assert [diagram.rows[8].bias[name].estimate for name in MEANS] == [0.0, 0.0, 0.0]


def test_the_cost_of_a_method_is_that_of_its_own_tasks(diagram):
    moments = diagram.rows[0].run.moments
    answers = [{"moments": moments, "seconds": seconds} for seconds in (3.0, 2.0)]
    run = timed.Timed(diagram.scene, answers)
    row = measurement.MethodRow(FEW[0], run)
    # Two realizations of 55 s in each task, 50 s of them measured.
    assert row.seconds_per_unit == pytest.approx(5.0 / 220.0, rel=1e-3)
    assert run.cost == pytest.approx(2.0 / 100.0, rel=1e-3)


def test_table_sentences_and_json_tell_the_same(diagram):
    header, cells = diagram.table()
    assert len(cells) == len(FEW) + len(diagram.measured.closures)
    assert {len(line) for line in cells} == {len(header)}
    content = json.loads(json.dumps(diagram.to_dict(), allow_nan=False))
    assert len(content["methods"]) == len(FEW)
    assert {"date", "cores", "processor"} <= set(content["machine"])
    assert [line["mean_step"] > 0.0 for line in content["methods"]] == [True] * len(FEW)


@pytest.mark.slow
def test_the_sentences_judge_the_default_step(pool):
    scene = Scene.read("linear", ["run.realizations=2", "run.duration=200", "run.settle=20"])
    diagram = work_precision(scene, methods=METHODS[5:6], executor=pool)
    (judged,) = [line for line in diagram.sentences() if "the circuit's default step" in line]
    assert "E[V²]" in judged
    assert "PCE" in judged


def test_the_reference_is_that_of_an_independent_integration():
    scene = Scene.read(
        "paper",
        ["run.realizations=2", "run.duration=10", "run.settle=0", "excitation.intensity=0.1"],
    )
    for index in (0, 1):
        states = exact_paths.run(scene, index, report=None)
        np.testing.assert_allclose(states, independent_path(scene, 200, index)[1:], atol=1e-9)


def test_local_error_control_lands_on_knots_and_follows_its_tolerance(pool):
    scene = Scene.read("paper", ["run.duration=20", "run.settle=0", "run.realizations=1"])
    steps = []
    for tolerance in (1e-4, 1e-6):
        result = simulate(
            scene, method="circuit", tolerance=tolerance, window=(0.0, 40.0), runner=pool
        )
        knots = 0.05 * np.arange(1, 401)
        times = result.waveform.time
        nearest = np.abs(times[np.searchsorted(times, knots - 1e-9)] - knots)
        assert nearest.max() < 1e-9
        steps.append(result.steps)
    assert steps[1] > 2 * steps[0]


def test_the_paired_difference_of_efficiency_is_that_of_the_two_estimates(pool):
    """Its error lies far below that of either efficiency, whose noise is common."""
    scene = Scene.read("linear", ["run.realizations=2", "run.duration=2000", "run.settle=20"])
    fine, coarse = (
        simulate(scene, method="monte-carlo", step=step, scheme=scheme, runner=pool)
        for step, scheme in (("fine", None), ("default", "heun"))
    )
    name = "power_conversion_efficiency"
    ours, theirs = coarse.scaled_quantities[name], fine.scaled_quantities[name]
    paired = paired_difference(coarse, fine)[name]
    assert paired.estimate == pytest.approx(ours.estimate / theirs.estimate - 1.0, rel=1e-9)
    assert 0.0 < paired.standard_error < 0.2 * theirs.standard_error / theirs.estimate


@pytest.mark.slow
@pytest.mark.usefixtures("every_closure")
def test_a_method_that_fails_leaves_the_others_and_says_why(monkeypatch, pool):
    whole = measurement.realizations_task

    def failing(scene, method, indices, runner, *function):
        if method.engine == "circuit" and not function:
            return Task(worker_calls.fail, {"reason": f"timestep too small at {indices[0]}"})
        return whole(scene, method, indices, runner, *function)

    monkeypatch.setattr(measurement, "realizations_task", failing)
    diagram = work_precision(Scene.read("paper", SHORT), methods=[FEW[0], FEW[-1]], executor=pool)
    assert diagram.rows[0].note == "SimulatorAborted: timestep too small at 0"
    assert math.isnan(diagram.rows[0].seconds_per_unit)
    assert diagram.rows[1].bias
    assert set(diagram.measured.closures) == set(NOISE_CLOSURES)
    json.dumps(diagram.to_dict(), allow_nan=False)


@pytest.mark.slow
def test_what_was_measured_is_kept_with_its_times_and_goes_on_after_an_early_end(
    tmp_path, pool, monkeypatch
):
    scene, told = Scene.read("linear", SHORT), []
    monkeypatch.setattr(measurement, "METHODS", (FEW[9], FEW[-1]))
    with open_runner(tmp_path, executor=pool) as runner:
        runner.answer = lambda *_: [None]
        with pytest.raises(OutOfTime):
            work_precision(scene, runner=runner)
    early = runner.computed
    for computed in (True, False):
        with open_runner(tmp_path, executor=pool) as runner:
            diagram = work_precision(scene, runner=runner)
        assert diagram.measured.speeds["rows"]
        assert bool(runner.computed) == computed
        assert runner.reused >= early > 0
        told.append(json.dumps(diagram.to_dict(), allow_nan=False))
    assert told[0] == told[1]


@pytest.mark.slow
@pytest.mark.usefixtures("every_closure")
def test_a_netlist_is_measured_against_the_compiled_engines_finest_paths(pool, tmp_path):
    """Circuit and Monte Carlo come nearer to them with shorter steps, with second order."""
    sets = ["run.realizations=2", "run.duration=1", "run.settle=0.2", "load.netlist=bridge"]
    scene = Scene.read("device", [*sets, "load.parameters.storage=100n"])
    families = ("external source, trapezoidal", "Monte Carlo, TR-BDF2")
    methods = [each for each in LOAD_METHODS if each.family in families]
    with open_runner(tmp_path, executor=pool) as runner:
        diagram = work_precision(scene, methods=methods, runner=runner)
    for family in families:
        rows = [row for row in diagram.rows if row.method.family == family]
        rows.sort(key=lambda row: row.mean_step)
        assert rows[0].strong["voltage"] < 0.3 * rows[-1].strong["voltage"]
        assert diagram.orders[family]["displacement"] > 1.5
    assert "TR-BDF2, a 32nd of the step" in diagram.sentences()[0]
    assert "resistor" in diagram.measured.refused["fokker_planck"]
    json.dumps(diagram.to_dict(), allow_nan=False)


def test_a_netlist_that_the_compiled_engine_does_not_take_is_refused(tmp_path):
    path = tmp_path / "own.lib"
    path.write_text(
        "* a transistor\n.subckt own p n out ref\n.model t npn(bf=100)\nQ1 p out n t\n"
        "Rout out ref 1k\nRref ref n 1\n.ends\n"
    )
    with pytest.raises(LoadError, match=r"own\.lib:4: q1"):
        work_precision(Scene.read("device", [f"load.netlist={path}"]))


def test_the_thorough_methods_hold_all_others():
    assert set(METHODS) < set(THOROUGH_METHODS)
    families = {method.family for method in METHODS}
    assert len(families) == 8


@pytest.mark.exhaustive
def test_the_command_writes_json_and_figure(tmp_path, capsys):
    options = [
        "--set",
        "run.realizations=2",
        "--set",
        "run.duration=400",
        "--set",
        "run.settle=20",
        "--output",
        str(tmp_path),
    ]
    assert main(["work-precision", "linear", *options]) == 0
    shown = capsys.readouterr().out
    for word in ("PWL in the netlist, gear", "averaging, consistent", "µs per unit", "s to 1 %"):
        assert word in shown
    content = json.loads((tmp_path / "linear-work-precision.json").read_text())
    on = {each["device"] for each in content["methods"]} - {"behavioural"}
    assert len(content["methods"]) == len(METHODS) + len(COMPILED_METHODS if on else ())
    assert (tmp_path / "linear-work-precision.png").read_bytes().startswith(b"\x89PNG")


def test_the_figure_is_drawn(diagram, tmp_path):
    figures.save(draw_work_precision, diagram, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")
