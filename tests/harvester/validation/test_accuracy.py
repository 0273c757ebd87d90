"""One measurement of every method: orders, biases, the time to an error, and the figure of both."""

import dataclasses
import json
import math
import time
from types import SimpleNamespace

import numpy as np
import pytest
import worker_calls
from matplotlib import style
from truths import reference_path as independent_path

from circuits.equivalent.export import longest_in_contact
from harvester.averaging.closures import NOISE_CLOSURES
from harvester.averaging.of_scene import average
from harvester.base.errors import HarvesterError, LoadError, OutOfTime
from harvester.cli.command_line import main
from harvester.engines.methods import Circuit, MonteCarlo
from harvester.engines.opening import open_runner
from harvester.engines.simulate import simulate
from harvester.engines.task import Task
from harvester.results import figures, palette
from harvester.results.files import save
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.statistics.estimate import Estimate
from harvester.statistics.moments import QUANTITIES
from harvester.statistics.paired import paired_difference
from harvester.validation import MEANS, STATES, exact_paths
from harvester.validation import accuracy_measurement as measurement
from harvester.validation.accuracy import duration, reached
from harvester.validation.accuracy_drawing import draw
from harvester.validation.accuracy_measurement import Timed, TotalError, bias_of
from harvester.validation.accuracy_methods import (
    COMPILED_METHODS,
    LOAD_METHODS,
    METHODS,
    REFERENCE,
    THOROUGH_METHODS,
    ComparedMethod,
)
from harvester.validation.public import accuracy

SQUARE = "mean_square_voltage"
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
        patch.setattr(measurement, "NOISE_CLOSURES", ("consistent",))
        patch.setattr("harvester.validation.throughput.KNOTS", 200)
        patch.setattr("harvester.validation.throughput.REPEATS", 1)
        yield


@pytest.fixture
def every_closure(monkeypatch):
    monkeypatch.setattr(measurement, "NOISE_CLOSURES", NOISE_CLOSURES)


@pytest.fixture(scope="module")
def diagram(pool):
    return accuracy(Scene.read("paper", SHORT), methods=[*FEW, "consistent"], executor=pool)


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
    run = Timed(prepared(diagram.scene), answers)
    row = measurement.MethodRow(FEW[0], run)
    # Two realizations of 55 s in each task, 50 s of them measured.
    assert row.seconds_per_unit == pytest.approx(5.0 / 220.0, rel=1e-3)
    assert run.cost == pytest.approx(2.0 / 100.0, rel=1e-3)
    # The scene's own run settles for half of its time, and its error is that of this run.
    own = SimpleNamespace(simulated_time=200.0, quantities=run.quantities())
    found = measurement._row(FEW[0], run, (0.1, {}), run, own, {SQUARE: 1.0}, 2.0)
    assert found.errors[SQUARE].cost == pytest.approx(2.0 / 110.0 * 2.0, rel=1e-3)


def test_table_sentences_and_json_tell_the_same(diagram):
    header, cells = diagram.table()
    assert len(cells) == len(FEW) + len(diagram.closures)
    assert {len(line) for line in cells} == {len(header)}
    content = json.loads(json.dumps(diagram.to_dict(), allow_nan=False))
    assert len(content["methods"]) == len(FEW)
    assert {"date", "cores", "processor"} <= set(content["machine"])
    assert [line["mean_step"] > 0.0 for line in content["methods"]] == [True] * len(FEW)


@pytest.mark.slow
def test_the_sentences_judge_the_default_step(pool, monkeypatch):
    scene = Scene.read("linear", ["run.realizations=2", "run.duration=200", "run.settle=20"])
    diagram = accuracy(scene, methods=METHODS[5:6], executor=pool)
    (judged,) = [line for line in diagram.sentences() if "the circuit's default step" in line]
    assert "E[V²]" in judged
    assert "PCE" in judged
    begin = "<Accuracy of linear: bias of the circuit's default step: "
    assert repr(diagram) == f"{begin}every mean below 1 %>"
    uncertain = Estimate(0.0, 0.02, None, "1")
    monkeypatch.setitem(diagram.rows[0].bias, SQUARE, uncertain)
    assert repr(diagram) == f"{begin}E[V²] not shown to be below 1 %>"


def test_the_reference_is_that_of_an_independent_integration():
    scene = Scene.read(
        "paper",
        ["run.realizations=2", "run.duration=10", "run.settle=0", "excitation.intensity=0.1"],
    )
    for index in (0, 1):
        states = exact_paths.run(prepared(scene), index, report=None)
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


@pytest.mark.exhaustive
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

    def failing(scene, method, indices, runner, function):
        if method.engine == "circuit" and function is measurement.timed:
            return Task(worker_calls.fail, {"reason": f"timestep too small at {indices[0]}"})
        return whole(scene, method, indices, runner, function)

    monkeypatch.setattr(measurement, "realizations_task", failing)
    diagram = accuracy(
        Scene.read("paper", SHORT), methods=[FEW[0], FEW[-1], *NOISE_CLOSURES], executor=pool
    )
    assert diagram.rows[0].note == "SimulatorAborted: timestep too small at 0"
    assert math.isnan(diagram.rows[0].seconds_per_unit)
    assert diagram.rows[1].bias
    assert set(diagram.closures) == set(NOISE_CLOSURES)
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
            accuracy(scene, runner=runner)
    early = runner.computed
    for computed in (True, False):
        with open_runner(tmp_path, executor=pool) as runner:
            diagram = accuracy(scene, runner=runner)
        assert diagram.speeds["rows"]
        assert bool(runner.computed) == computed
        assert runner.reused >= early > 0
        told.append(json.dumps(diagram.to_dict(), allow_nan=False))
    assert told[0] == told[1]


@pytest.mark.slow
@pytest.mark.usefixtures("every_closure")
def test_a_netlist_is_measured_against_the_compiled_engines_finest_paths(pool, tmp_path):
    """Circuit and Monte Carlo come nearer to them with shorter steps, with second order."""
    sets = ["run.realizations=2", "run.duration=0.4", "run.settle=0.1", "load.netlist=bridge"]
    scene = Scene.read("device", [*sets, "load.parameters.storage=100n"])
    families = ("external source, trapezoidal", "Monte Carlo, TR-BDF2")
    methods = [each for each in LOAD_METHODS if each.family in families]
    with open_runner(tmp_path, executor=pool) as runner:
        diagram = accuracy(scene, methods=[*methods, "fokker_planck"], runner=runner)
    for family in families:
        rows = [row for row in diagram.rows if row.method.family == family]
        rows.sort(key=lambda row: row.mean_step)
        assert rows[0].strong["voltage"] < 0.3 * rows[-1].strong["voltage"]
        assert diagram.orders[family]["displacement"] > 1.5
    assert "TR-BDF2, a 32nd of the step" in " ".join(diagram.sentences())
    assert "resistor" in diagram.refused["fokker_planck"]
    json.dumps(diagram.to_dict(), allow_nan=False)


def test_a_netlist_that_the_compiled_engine_does_not_take_is_refused(tmp_path):
    path = tmp_path / "own.lib"
    path.write_text(
        "* a transistor\n.subckt own p n out ref\n.model t npn(bf=100)\nQ1 p out n t\n"
        "Rout out ref 1k\nRref ref n 1\n.ends\n"
    )
    with pytest.raises(LoadError, match=r"own\.lib:4: q1"):
        accuracy(Scene.read("device", [f"load.netlist={path}"]))


def test_the_thorough_methods_hold_all_others():
    assert set(METHODS) < set(THOROUGH_METHODS)
    families = {method.family for method in METHODS}
    assert len(families) == 8


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


def test_a_bias_that_may_be_below_the_error_does_not_say_never():
    error = total_error(0.053, 0.029)
    assert math.isnan(error.seconds_to(0.03))
    assert reached(error, 0.03) == "unknown (bias +5.3 ± 2.9 %)"
    content = error.to_dict()
    assert (content["seconds_to"]["0.03"], content["shown"]["0.03"]) == (None, False)
    assert reached(total_error(0.09, 0.029), 0.03) == "never"


def test_a_closures_bias_within_its_error_bar_is_uncertain_also_in_a_frame(diagram, monkeypatch):
    for size, error, text in (
        (0.011, 0.013, "2 s (?)"),
        (0.02, 0.001, "never"),
        (0.02, 0.006, "unknown (bias +2.00 ± 0.60 %)"),
        (0.001, 0.001, "2 s"),
    ):
        bias = Estimate(size, error, None, "1")
        monkeypatch.setattr(type(diagram), "deviation", lambda *_, bias=bias: bias)
        monkeypatch.setitem(diagram.closures["consistent"], "seconds", 2.0)
        header, rows = diagram.table()
        assert rows[-1][header.index("E[V²] to 1%")] == text
        frame = diagram.to_dataframe()
        doubts = list(frame.get("E[V²] to 1% (?)", [False]))
        assert doubts[-1] == ("?" in text)


def test_a_step_longer_than_the_samples_is_not_measured_twice(monkeypatch, pool):
    """In `linear` a sample is as long as the circuit's default step."""
    asked = []
    monkeypatch.setattr(
        measurement, "_strong_errors", lambda _, methods, *__: asked.extend(methods)
    )
    monkeypatch.setattr(measurement, "_runs", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        accuracy(Scene.read("linear", SHORT), executor=pool)
    model = prepared(Scene.read("linear", SHORT))
    keys = [(method.family, *method.options(model).values()) for method in asked]
    assert len(set(keys)) == len(keys)
    assert ComparedMethod("", "circuit", 2, 0.3).step(model) == METHODS[5].step(model)


def test_the_errors_of_paths_have_the_scenes_units(diagram, monkeypatch):
    scales = diagram.answer.prepared_scene.scales
    monkeypatch.setattr(scales.__class__, "of", lambda _, name: 1e-3)
    monkeypatch.setattr("harvester.validation.accuracy.unit_of", lambda *_: "m")
    row, cells = diagram.rows[0], diagram.to_dataframe()
    assert cells["error X [m]"][0] == pytest.approx(1e-3 * row.strong["displacement"])


def test_durations_have_a_unit_that_fits():
    texts = [duration(seconds) for seconds in (2.2e-6, 0.034, 5.0, 90.0, 7200.0, 3e5)]
    assert texts == ["2.2 µs", "34 ms", "5 s", "1.5 min", "2 h", "3.5 d"]


@pytest.fixture(scope="module")
def runs():
    """The same realizations twice, as many as a bias needs for an error bar."""
    overrides = ["run.realizations=16", "run.duration=400", "run.settle=40"]
    scene = Scene.read("linear", overrides)
    moments = simulate(scene, method="monte-carlo", workers=1).moments
    return moments, lambda some: Timed(prepared(scene), [{"moments": some, "seconds": 1.0}])


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


def test_every_group_has_a_colour_and_a_marker_of_its_own():
    groups = dict.fromkeys(each.group for each in (*METHODS, *COMPILED_METHODS))
    found = palette.styles([*groups, "one more", "another"])
    markers = [style[1] for style in found.values()] + list(palette.CLOSURE_MARKERS.values())
    assert len(set(markers)) == len(markers)
    colours = [style[0] for style in found.values()]
    colours += [colour for colour, _ in palette.LINES.values()]
    assert len(set(colours)) == len(colours)


@pytest.fixture(scope="module")
def steady(pool):
    """A method and the reference itself on a linear device, long enough for error bars."""
    few = (
        ComparedMethod("Monte Carlo, Heun", "monte-carlo", 2, scheme="heun"),
        ComparedMethod("the reference", "monte-carlo", 4, REFERENCE.refinement),
    )
    sets = ["run.realizations=16", "run.duration=200", "run.settle=20"]
    return accuracy(Scene.read("linear", sets), methods=[*few, "consistent"], executor=pool)


@pytest.mark.slow
def test_both_pictures_tell_of_the_same_runs(steady):
    for row in steady.rows:
        paired, total = row.bias[SQUARE], row.errors[SQUARE]
        # On the same noise the paired difference and the control variate find the same bias.
        apart = abs(paired.estimate - total.bias.estimate)
        assert apart <= 0.5 * total.bias.standard_error + 1e-12
        # All of a run's sampling error is that of the reference over the same time.
        sampling = total.after(total.cost * row.run.measured_time) ** 2 - total.resolved_bias**2
        assert sampling**0.5 == pytest.approx(row.sampling[SQUARE], rel=0.02)
    # The reference is known by itself, and has no bias.
    exact = steady.rows[1]
    assert exact.errors[SQUARE].bias.estimate == exact.bias[SQUARE].estimate == 0.0


@pytest.mark.slow
def test_a_rectifier_is_timed_by_its_output_power(pool):
    overrides = ["load.netlist=bridge", "run.duration=2", "run.settle=0.5", "run.realizations=2"]
    found = accuracy(
        Scene.read("device", overrides), methods=[LOAD_METHODS[0], "consistent"], executor=pool
    )
    assert tuple(found.errors) == ("mean_output_power", "power_conversion_efficiency")
    assert set(found.refused) == {"consistent"}


@pytest.mark.slow
def test_the_figure_has_few_entries_names_its_lines_and_ends_at_the_data(steady):
    """All groups of methods, and the sampling error, make eight entries at most."""
    groups = dict.fromkeys(each.group for each in (*METHODS, *COMPILED_METHODS))
    assert len(groups) + 1 <= 8
    with style.context(figures.STYLE):
        figure = draw(steady)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["Monte Carlo, Heun", "the reference", "sampling error alone"]
    strong, *panels = figure.axes
    assert len(panels) == len(MEANS) + len(steady.errors)
    for axes in panels:
        assert axes.get_legend_handles_labels()[1] == ["sampling error alone"]
    texts = [text.get_text() for axes in panels for text in axes.texts]
    # Averaging is a point at its own run time, with its name.
    assert texts.count("consistent") == len(panels)
    errors = [row.strong["displacement"] for row in steady.rows]
    low, high = strong.get_ylim()
    assert min(errors) / 4.0 < low < min(errors)
    assert max(errors) < high < 4.0 * max(errors)


@pytest.mark.exhaustive
def test_the_command_writes_json_and_figure(tmp_path, capsys):
    sets = ["run.realizations=2", "run.duration=400", "run.settle=20"]
    options = [word for each in sets for word in ("--set", each)]
    assert main(["accuracy", "linear", *options, "--output", str(tmp_path)]) == 0
    # Titles of columns wrap at the terminal's width.
    shown = " ".join(capsys.readouterr().out.split())
    for word in ("PWL in the", "averaging,", "core time", "to 1%"):
        assert word in shown
    content = json.loads((tmp_path / "linear-accuracy.json").read_text())
    on = {each["device"] for each in content["methods"]} - {"behavioural"}
    assert len(content["methods"]) == len(METHODS) + len(COMPILED_METHODS if on else ())
    assert (tmp_path / "linear-accuracy.png").read_bytes().startswith(b"\x89PNG")


def test_methods_are_those_of_a_sweep(pool):
    """A name means all steps and schemes of its engine, an object its own settings."""
    scene = Scene.read("paper", SHORT)
    with pytest.raises(
        HarvesterError, match=r"circuitt \(did you mean circuit\?\); there are .*mo"
    ):
        accuracy(scene, methods=["circuitt"])
    with pytest.raises(HarvesterError, match="compares no gmin"):
        accuracy(scene, methods=[Circuit(gmin=1e-9)])
    fine = MonteCarlo(step="fine", scheme="heun")
    found = accuracy(scene, methods=["monte-carlo", fine, "consistent"], executor=pool)
    listed = [method for method in METHODS if method.engine == "monte-carlo"]
    assert [row.method for row in found.rows[:-1]] == listed
    own, same = found.rows[-1], found.rows[-2]
    assert own.method.step(found.answer.prepared_scene) == pytest.approx(0.05 / 4)
    assert own.bias == same.bias
    assert own.method.order == 2
    assert list(found.closures) == ["consistent"]


def test_methods_that_skip_contacts_have_shorter_steps_or_say_why(pool, monkeypatch):
    """A PWL source's steps are limited to what a contact allows, also for the throughput."""
    scene = Scene.read("paper", [*SHORT, "stoppers.stiffness=4000"])
    largest = longest_in_contact(prepared(scene).system)
    pwl, external = METHODS[0], METHODS[4]
    assert pwl.step(prepared(scene)) <= largest < external.step(prepared(scene))
    monkeypatch.setattr(measurement, "METHODS", METHODS[:1])
    monkeypatch.setattr(measurement, "COMPILED_METHODS", ())
    found = accuracy(scene, executor=pool)
    assert found.rows[0].note == ""
    assert found.speeds["rows"]
    assert "throughput" not in found.refused


def test_the_time_of_a_closure_is_the_processor_time_of_average():
    before = time.process_time()
    result = average(Scene.read("linear"), method="consistent")
    assert 0.0 < result.engine_seconds <= time.process_time() - before


@pytest.mark.slow
def test_a_run_too_short_for_error_bars_says_so_and_is_drawn(pool, tmp_path):
    sets = ["run.realizations=1", "run.duration=2", "run.settle=0"]
    one = [ComparedMethod("Monte Carlo, Heun", "monte-carlo", 2, scheme="heun")]
    found = accuracy(Scene.read("paper", sets), methods=one, executor=pool)
    text = " ".join(found.sentences())
    assert "inf" not in text
    assert "sampling error of the long run: too short for an error bar" in text
    save(found, tmp_path / "errors.png")


@pytest.mark.slow
def test_a_closure_of_another_package_has_a_style(steady):
    other = {"theirs": steady.closures["consistent"]}
    with style.context(figures.STYLE):
        figure = draw(dataclasses.replace(steady, closures=other))
    texts = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert "theirs" in texts
