import csv
import math
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from truths import flat, interpolated_linear_means

from harvester.averaging.of_scene import average
from harvester.base.errors import HarvesterError
from harvester.cli.command_line import main
from harvester.cli.console import show_view
from harvester.engines.methods import Circuit, MonteCarlo
from harvester.engines.simulate import simulate
from harvester.results.files import save
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing
from harvester.studies.loads import drawing
from harvester.studies.loads import proof as proof_module
from harvester.studies.loads.proof import Proof, proving
from harvester.studies.public import load_study

pytestmark = pytest.mark.usefixtures("shared_workers")

RESISTANCE = "load.parameters.resistance"
BRIEF = {"run.duration": 20.0, "run.settle": 5.0}
# Two resistors, so that Monte Carlo refuses it and ngspice runs it.
LOAD = ".subckt two p n resistance=1\nR1 p m {resistance}\nR2 m n 0.01\n.ends\n"
TOLD = "HarvesterError: it stopped"


@pytest.fixture
def linear():
    return Scene.read("linear").replace(BRIEF)


@pytest.fixture(scope="module")
def study(pool):
    """Monte Carlo of the linear device, long enough for 3 %."""
    scene = Scene.read("linear").replace({"run.settle": 50.0})
    places = np.geomspace(0.05, 5.0, 9)
    return load_study(
        scene,
        loads=["resistor"],
        over={RESISTANCE: places},
        method="monte-carlo",
        precision=0.03,
        executor=pool,
    )


def power_of(scene, resistance):
    parameters = flat(scene.replace({"load.decay_rate": 1.0 / resistance}))
    return interpolated_linear_means(parameters, knot_spacing(prepared(scene)))["mean_power"]


def test_the_optimum_is_that_of_the_closed_form(study):
    scene = Scene.read("linear")
    best = minimize_scalar(
        lambda x: -power_of(scene, math.exp(x)), bounds=(-3.0, 1.0), method="bounded"
    )
    optimum, _ = study.optima[0]
    assert optimum.low < math.exp(best.x) < optimum.high
    assert optimum.high / optimum.low < 1.6


def test_every_point_has_the_power_of_the_closed_form(study):
    for point, evaluation in zip(study.grid.points, study.evaluations, strict=True):
        assert evaluation.relative_error <= 0.03
        error = evaluation.relative_error * evaluation.power
        # 9 points within 4 standard errors: false alarm in 1 of 1800 seeds.
        assert abs(evaluation.power - power_of(Scene.read("linear"), point.place[0])) < 4.0 * error


def test_what_several_points_share_is_said_once(study):
    noted = [
        replace(each, notes=("a node (bare; the pin b) floats",)) for each in study.evaluations
    ]
    said = replace(study, evaluations=noted).sentences()
    assert [line for line in said if "bare" in line] == [
        "resistor: a node (bare; the pin b) floats"
    ]
    noted[2:] = [replace(each, outcome="SimulatorTimeout: 1 s") for each in noted[2:]]
    said = replace(study, evaluations=noted).sentences()
    assert "resistor at 0.05; 0.088914: a node (bare; the pin b) floats" in said
    assert sum("SimulatorTimeout" in line for line in said) == 1


def test_loads_are_compared_on_the_same_noise(linear, pool):
    study = load_study(
        linear,
        loads=["resistor", "scene"],
        over={RESISTANCE: [0.4]},
        precision=0.5,
        executor=pool,
    )
    _, (difference,) = study.rankings[()]
    # The same resistor twice.
    assert difference.standard_error < 1e-5
    assert abs(difference.estimate) < 1e-5
    # Only a significant lead ranks: a tenth at ten standard errors, not at two.
    for error, sign in ((0.01, ">"), (0.05, "="), (math.nan, "?")):
        lead = replace(difference, estimate=0.1, standard_error=error)
        ranked = [lead.better, lead.worse], [lead]
        vars(study).update(rankings={(): ranked}, ranked_curves=ranked)
        ranking, sentence = study.sentences()[:2]
        assert ranking == f"ranking at the optima: {lead.better} {sign} {lead.worse}"
        assert sentence.endswith("no significant difference") == (sign == "=")
        assert sentence.endswith("+10 % (no error bar)") == (sign == "?")
        equal = f", not significantly more than from {lead.worse}"
        assert study.view().headline.endswith(equal) == (sign == "=")
        unknown = f", with a difference of unknown error to {lead.worse}"
        assert study.view().headline.endswith(unknown) == (sign == "?")
    assert all(e.relative_error > 0.02 for e in study.evaluations)


def test_a_short_record_does_not_rank_without_an_error_bar(linear, pool, tmp_path):
    random = np.random.default_rng(3)
    rows = [f"{0.2 * k:.1f},{value}" for k, value in enumerate(random.normal(size=600))]
    (tmp_path / "shaker.csv").write_text("t,a\n" + "\n".join(rows) + "\n")
    record = {"kind": "record", "file": str(tmp_path / "shaker.csv"), "unit": "scaled"}
    scene = linear.replace({"excitation": record, "run.duration": 30.0})
    over = {RESISTANCE: [0.3, 0.4, 0.5], "oscillator.cubic_stiffness": [0.0, 0.5]}
    study = load_study(scene, loads=["resistor"], over=over, method="monte-carlo", executor=pool)
    assert any(math.isnan(evaluation.power_error) for evaluation in study.evaluations)
    _, (difference,) = study.ranked_curves
    assert difference.standard_error != 0.0
    assert not difference.differs


@pytest.mark.parametrize("realizations", [4, 8, 64])
def test_three_standard_errors_of_few_realizations_are_as_rare_as_of_many(realizations):
    """Of normal differences: 0.27 % of 200 000 sets beyond, within four of its own errors."""
    random = np.random.default_rng(7).normal(size=(200_000, realizations))
    error = random.std(axis=1, ddof=1) / math.sqrt(realizations)
    beyond = abs(random.mean(axis=1)) > 3.0 * proof_module._of_few(realizations) * error
    chance = 0.0027
    assert beyond.mean() == pytest.approx(chance, abs=4.0 * math.sqrt(chance / len(random)))


@pytest.mark.slow
def test_the_circuit_is_the_judge(linear, pool):
    """At the highest of three places and at one of the others, on the realizations themselves."""
    sweeps = {RESISTANCE: [0.1, 0.4, 2.0]}
    study = load_study(linear, loads=["resistor"], over=sweeps, precision=0.4, executor=pool)
    assert [each.highest for each in study.proofs].count(True) == 1
    highest = next(each for each in study.proofs if each.highest)
    assert highest.place == int(np.argmax([each.power for each in study.evaluations]))
    for proof in study.proofs:
        # The means scatter by 20 % and more.
        assert abs(proof.difference) < 0.01
        assert proof.standard_error < 0.01
        assert not proof.disagrees
    assert not study.view().alarms
    assert any("agrees at 2" in line for line in study.sentences())
    found = study.to_xarray()["circuit_difference"].values.ravel()
    assert np.isfinite(found).sum() == len(study.proofs)


def test_steps_that_cost_more_than_the_precision_are_told(linear, pool, monkeypatch):
    monkeypatch.setattr("harvester.studies.loads.evaluation.step_error", lambda *of: 0.3)
    options = {"method": "monte-carlo", "precision": 0.2, "executor": pool}
    (point,) = load_study(linear, loads=["resistor"], **options).evaluations
    assert "the relative step error of a power may be 0.3" in " ".join(point.notes)


def test_a_power_without_an_error_bar_says_why(linear, pool):
    short = linear.replace({"run.settle": 50.0, "run.duration": 20.0, "run.realizations": 2})
    (point,) = load_study(
        short, loads=["resistor"], method="monte-carlo", executor=pool
    ).evaluations
    power = point.estimates["output_power"]
    assert power.standard_error is None
    assert power.note.startswith("too short for an error bar")
    assert f"output power: {power.note}" in point.notes


def test_a_difference_is_named_and_red(study, capsys):
    proofs = [Proof(4, True, 0.05, 0.01), Proof(2, False, 0.005, 1e-4), Proof(1, False, 0.05, 0.02)]
    proofs.append(Proof(0, False, 0.05, 0.1, early_difference=-0.02, early_standard_error=0.002))
    report = replace(study, proofs=proofs)
    assert [each.disagrees for each in proofs] == [True, False, False, True]
    line, early = report.view().alarms
    assert "DISAGREE: resistor at 0.5 (optimum): circuit over Monte Carlo" in line
    assert line.endswith("paired, +5.0 ± 1.0 % (5.0 σ) settled")
    assert "paired, -2.00 ± 0.20 % (10.0 σ) in the first 6 periods, +5 ± 10 % (0.5 σ)" in early
    assert any(line.endswith("DISAGREES at 2, agrees at 2") for line in report.sentences())
    show_view(report.view(), "load study")
    assert line in capsys.readouterr().out


@pytest.mark.slow
def test_a_device_between_its_wells_is_judged_to_a_tenth_of_a_percent(pool):
    """Its paths part: eight settled ones know the same difference twenty times worse."""
    scene = Scene.read("device", ["run.duration=4", "run.settle=1"])
    study = load_study(scene, loads=["bridge"], executor=pool)
    (proof,) = study.proofs
    assert 0.0 < proof.early_standard_error < 0.002
    # 0.2 % is the step of both engines; false alarms are one in 370.
    assert abs(proof.early_difference) < 0.002 + 3.0 * proof.early_standard_error
    assert proof.standard_error > 5.0 * proof.early_standard_error


@pytest.mark.parametrize(("failing", "trouble"), [(1, TOLD), (3, f"from rest: {TOLD}"), (None, "")])
def test_a_part_that_fails_is_told_and_the_other_judges(linear, monkeypatch, failing, trouble):
    """Parts: settled by Monte Carlo and by the circuit, and both from rest."""
    scene = linear.replace({"run.realizations": 1})
    monkeypatch.setattr(
        proof_module, "answers_before_failure", lambda found: (found, HarvesterError("it stopped"))
    )
    monkeypatch.setattr(proof_module, "series_of", lambda _, good: good[0])
    plan = proving(0, True, scene, (MonteCarlo(), ""), (Circuit(), ""))
    assert len(next(plan).tasks) == 4
    power = np.random.default_rng(1).uniform(1.0, 2.0, (1, 64))
    answers = [None if part == failing else power for part in range(4)]
    with pytest.raises(StopIteration) as end:
        plan.send(answers)
    proof = end.value.value
    assert proof.trouble == trouble
    assert proof.checks == (failing is None)
    assert math.isnan(proof.standard_error) == (failing == 1)
    assert math.isnan(proof.early_standard_error) == (failing == 3)


def test_on_one_path_only_the_steps_of_the_engines_differ(linear, monkeypatch):
    """A single batch has no scatter: under noise no error, on a deterministic path the steps'."""
    monkeypatch.setattr(proof_module, "answers_before_failure", lambda found: (found, ""))
    monkeypatch.setattr(proof_module, "series_of", lambda _, good: good)
    sine = linear.replace({"excitation": {"kind": "sine", "amplitude": 1.0, "frequency": 0.2}})
    ours = np.ones((1, 1))
    for scene, error, reason in (
        (sine, 5e-3, ""),
        (linear, math.nan, "too short for an error bar"),
    ):
        found = proof_module._difference(prepared(scene), (3e-3, 4e-3), ours, 1.01 * ours)
        assert found[:2] == pytest.approx((0.01, error), nan_ok=True)
        assert found[2] == reason
    (task,) = proof_module._tasks(prepared(sine), 64, MonteCarlo(), "")
    assert len(task.arguments["indices"]) == 1


@pytest.mark.slow
def test_leakage_of_a_closed_converter_is_no_early_power(pool):
    """Its lockout opens after the first periods; until then a resistor's picowatts pass."""
    scene = Scene.read("device", ["run.duration=4", "run.settle=2", "run.realizations=4"])
    study = load_study(scene, loads=["bridge_buck"], executor=pool)
    (proof,) = study.proofs
    assert math.isnan(proof.early_standard_error)
    assert proof.standard_error > 0.0


def test_what_only_the_circuit_takes_is_run_by_it(linear, tmp_path, pool):
    (tmp_path / "mine.lib").write_text(LOAD.replace("R1", "M1 p n n n nm\n.model nm nmos\nR1"))
    short = linear.replace({"run.realizations": 1, "run.duration": 20.0})
    loads = ["resistor", str(tmp_path / "mine.lib")]
    study = load_study(short, loads=loads, over={RESISTANCE: [1.0]}, executor=pool)
    assert study.methods == ("monte-carlo", "circuit")
    assert [each.place for each in study.proofs] == [0]
    with pytest.raises(HarvesterError, match="letter M"):
        load_study(short, loads=loads, method="monte-carlo", executor=pool)


def test_a_load_that_fails_is_the_outcome_of_its_point(linear, tmp_path, pool):
    (tmp_path / "two.lib").write_text(LOAD)
    sweeps = {RESISTANCE: [-0.02, 1.0]}
    short = linear.replace({"run.realizations": 1})
    options = {"method": "circuit", "output": tmp_path, "executor": pool}
    study = load_study(short, loads=[str(tmp_path / "two.lib")], over=sweeps, **options)
    broken, whole = study.evaluations
    assert math.isnan(broken.power)
    assert broken.outcome.split(":")[0] in ("SolutionDiverged", "SimulatorAborted")
    # It is too short for an error bar, which the outcome adds.
    assert whole.outcome == "complete"
    assert whole.power > 0.0
    again = load_study(short, loads=[str(tmp_path / "two.lib")], over=sweeps, **options)
    assert (again.computed, again.reused) == (0, 2)
    assert again.evaluations[0].outcome == broken.outcome


@pytest.mark.slow
def test_closures_make_a_study_too(pool):
    scene = Scene.read("device")
    sweeps = {"load.resistance": [1e6]}
    study = load_study(scene, loads=["resistor"], over=sweeps, method="consistent", executor=pool)
    expected = scene.replace({"load.resistance": 1e6})
    value = average(expected, method="consistent").quantity("mean_power").estimate
    assert study.evaluations[0].power == pytest.approx(value, rel=1e-12)
    with pytest.raises(HarvesterError, match="bridge"):
        load_study(scene, loads=["bridge"], method="consistent")


COMMAND = ["linear", "--load", "resistor", "--method", "monte-carlo", "--precision", "0.03"]
COMMAND += ["--sweep", f"{RESISTANCE}=0.1:2:log:4", "--set", "run.settle=60", "--workers", "1"]


@pytest.mark.slow
def test_killed_and_run_again_it_comes_to_the_same_file(tmp_path):
    xarray = pytest.importorskip("xarray")
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    assert main(["load-study", *COMMAND, "--output", str(whole)]) == 0
    pieces = {path.name for path in (whole / "points").iterdir()}
    for count in (2, 5):
        process = subprocess.Popen(
            [sys.executable, "-m", "harvester", "load-study", *COMMAND, "--output", str(broken)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        deadline = time.monotonic() + 60.0
        while len(list(broken.glob("points/[!.]*.npz"))) < count and time.monotonic() < deadline:
            time.sleep(0.005)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    kept = {path: path.stat().st_mtime_ns for path in broken.glob("points/[!.]*.npz")}
    assert 5 <= len(kept) < len(pieces)
    assert not (broken / "linear-load-study.nc").exists()
    assert main(["load-study", *COMMAND, "--output", str(broken)]) == 0
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    # What was being written at the kill is gone too.
    assert {path.name for path in (broken / "points").iterdir()} == pieces
    first, second = (
        xarray.load_dataset(folder / "linear-load-study.nc", engine="scipy")
        for folder in (whole, broken)
    )
    assert first.identical(second)
    rows = list(csv.DictReader((whole / "linear-load-study.csv").read_text().splitlines()))
    assert [float(row["output_power [scaled power]"]) for row in rows] == pytest.approx(
        first.output_power.values.ravel().tolist(), rel=1e-8
    )


def test_the_time_budget_ends_a_study_and_the_next_call_goes_on(linear, tmp_path, pool):
    options = {"method": "monte-carlo", "precision": 0.05, "output": tmp_path, "executor": pool}
    sweeps = {RESISTANCE: [0.3, 0.5, 1.0]}
    first = load_study(linear, loads=["resistor"], over=sweeps, time_budget=1e-3, **options)
    assert first.out_of_time
    assert first.computed == 0
    assert re.search(r"one takes longer: try a time budget of \S+ s$", first.warnings[-1])
    last = load_study(linear, loads=["resistor"], over=sweeps, **options)
    assert not last.out_of_time


def test_a_time_limit_raised_later_runs_the_point_again(linear, tmp_path):
    # Long against the limit, on a busy machine too.
    short = linear.replace({"run.realizations": 1, "run.duration": 1e5})
    options = {"method": "monte-carlo", "output": tmp_path, "workers": 1}
    first = load_study(short, loads=["resistor"], time_limit=1e-3, **options)
    assert first.evaluations[0].outcome.startswith("SimulatorTimeout")
    assert "run the same command to compute them again" in first.warnings[-1]
    last = load_study(short, loads=["resistor"], **options)
    assert last.evaluations[0].outcome == "complete"
    assert (last.computed, last.reused, last.warnings) == (1, 0, ())


def test_a_piece_of_another_study_under_this_ones_name_is_named(linear, tmp_path, pool):
    options = {"method": "consistent", "output": tmp_path, "executor": pool}
    first = load_study(linear, loads=["resistor"], over={RESISTANCE: [1.0, 2.0]}, **options)
    one, two = (tmp_path / "points").iterdir()
    two.write_bytes(one.read_bytes())
    last = load_study(linear, loads=["resistor"], over={RESISTANCE: [1.0, 2.0]}, **options)
    assert last.warnings == (f"{two}: belongs to another task: computed again",)
    assert [e.power for e in last.evaluations] == [e.power for e in first.evaluations]
    assert (last.computed, last.reused) == (1, 1)


@pytest.mark.slow
def test_a_dask_cluster_gives_identical_numbers(linear, pool, dask_executor):
    """In a study, and in a run of which it has the realizations."""
    pytest.importorskip("xarray")
    options = {"loads": ["resistor"], "over": {RESISTANCE: [0.2, 1.0]}}
    options |= {"precision": 0.2, "time_budget": 600.0}
    expected = load_study(linear, **options).to_xarray()
    found = load_study(linear, executor=dask_executor, **options)
    assert found.to_xarray().identical(expected)
    scene = Scene.read("paper", ["run.duration=100", "run.realizations=3"])
    one, other = (
        simulate(scene, method="circuit", **place)
        for place in ({"runner": pool}, {"executor": dask_executor})
    )
    assert one.to_dict()["quantities"] == other.to_dict()["quantities"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--sweep", "excitation.intensity"], "must be written as TABLE.KEY=LIST"),
        (["--sweep", "excitation.intensity=1:2:log"], "the list as 0.1:2:log:40"),
        (["--method", "circuitt"], "did you mean circuit"),
        (["--precision", "3"], "must be a number in"),
        (["--load", "nothing"], "no such load"),
    ],
)
def test_mistakes_in_the_call_are_one_line(capsys, arguments, said):
    assert main(["load-study", "linear", *arguments]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_a_storage_that_charges_for_longer_than_the_settling_is_told(pool):
    scene = Scene.read("device").replace({"run.duration": 4.0, "run.settle": 11.0})
    scene = scene.replace({"run.realizations": 1, "load.netlist": "bridge"})
    # One store charges within 0.1 s, the other within 100 s: on no noise does it settle.
    sweeps = {RESISTANCE: [1e6], "load.parameters.storage": [1e-7, 1e-4]}
    quick, slow = load_study(scene, over=sweeps, executor=pool).evaluations
    assert quick.outcome == "complete"
    assert quick.notes[0].startswith("output power: too short for an error bar")
    assert "the store cstorage (bridge.lib:28) still charges" in " ".join(slow.notes)
    assert slow.estimates["output_power"].standard_error is None
    assert "still charges" in slow.estimates["output_power"].note


@pytest.mark.slow
def test_the_output_power_has_one_error(pool):
    """The memory of the load's store is in that of both names."""
    scene = Scene.read("device").replace({"run.duration": 8.0, "run.settle": 2.0})
    scene = scene.replace({"run.realizations": 8, "load.netlist": "bridge"})
    over = {"load.parameters.storage": [1e-7, 4e-7]}
    for point in load_study(scene, over=over, method="monte-carlo", executor=pool).evaluations:
        power = point.estimates["output_power"]
        assert power.standard_error > 0.0
        assert power == point.estimates["mean_output_power"]
        assert power.standard_error == point.power_error


@pytest.mark.slow
def test_the_headline_names_all_swept_values_and_equal_ones(linear, pool):
    """A cubic stiffness of 1e-9 changes no power."""
    over = {RESISTANCE: [0.3, 0.5, 1.0], "oscillator.cubic_stiffness": [0.0, 1e-9]}
    found = load_study(linear, over=over, method="monte-carlo", precision=0.3, executor=pool)
    (load, *_), (difference,) = found.ranked_curves
    assert difference.better == load
    assert not difference.differs
    said = found.headline()
    assert re.search(r"from scene at load resistance = [\d.]+, cubic stiffness = ", said)
    assert ", not significantly more than from scene at cubic stiffness = " in said
    # The scene of the report keeps the user's load.
    assert found.scene.load == linear.load != found.grid.points[0].scene.load


def test_points_without_an_error_bar_have_a_ring(study):
    bare = replace(study.evaluations[2].estimates["output_power"], standard_error=None)
    evaluations = list(study.evaluations)
    evaluations[2] = replace(evaluations[2], estimates={"output_power": bare})
    (axes,) = replace(study, evaluations=evaluations).figure("power").axes
    rings = [line for line in axes.lines if line.get_markersize() == drawing.RING]
    assert [list(line.get_xdata()) for line in rings] == [[study.grid.sweeps[RESISTANCE][2]], []]
    assert rings[-1].get_label() == "ring: no error bar"
    (axes,) = study.figure("power").axes
    assert not any(line.get_label() == "ring: no error bar" for line in axes.lines)


def test_its_files_hold_what_it_found(study, tmp_path):
    xarray = pytest.importorskip("xarray")
    assert len(save(study, tmp_path, "load-study")) == 6
    assert all(path.stat().st_size > 1000 for path in tmp_path.iterdir())
    found = xarray.load_dataset(tmp_path / "load-study.nc", engine="scipy")
    assert found.identical(study.to_xarray())
    powers = [evaluation.power for evaluation in study.evaluations]
    assert found["output_power"].sel(load="resistor").values.tolist() == powers
    assert float(found["optimum"][0]) == study.optima[0][0].place


def test_a_cross_check_that_failed_or_is_not_sharp_is_not_checked(study):
    """7e-16 ± 300, 0 ± 75 % and an aborted circuit show nothing, and print no difference."""
    proofs = [
        Proof(4, True, 0.0, 0.75, early_difference=7e-16, early_standard_error=300.0),
        Proof(2, False, trouble="the circuit stopped"),
        Proof(3, False, math.nan, math.nan, 0.0, 0.0038, trouble="the circuit stopped"),
    ]
    assert not any(proof.checks or proof.disagrees for proof in proofs)
    head, *lines = replace(study, proofs=proofs)._proofs()
    assert head.endswith("not checked at 3")
    assert lines[0].endswith("0.5 (optimum): not checked (uncertain by more than ± 10%)")
    assert lines[1].endswith(": not checked (the circuit stopped)")
    assert "(0.0 σ) in the first 6 periods; settled part not checked (the circuit" in lines[2]


FED = (
    ".subckt fed p n out ref initial=0\n.model d d(is=1n)\nD1 p rail d\nD2 n rail d\nD3 ref p d\n"
    "D4 ref n d\nRs rail out 10\nC1 out x 5u ic={initial}\nRx x ref 10\nR1 out ref 100k\n.ends\n"
)


@pytest.mark.slow
def test_a_point_that_its_store_feeds_is_not_ranked(tmp_path, pool):
    """A charged capacitor behind a resistance delivers most of the power of the second point."""
    path = tmp_path / "fed.lib"
    path.write_text(FED)
    scene = Scene.read("device").replace(
        {"run.duration": 2.0, "run.settle": 0.0, "run.realizations": 2}
    )
    found = load_study(
        scene,
        loads=[str(path)],
        over={"load.parameters.initial": [0.0, 40.0]},
        method="monte-carlo",
        executor=pool,
    )
    fed = found.evaluations[1]
    assert fed.power > found.evaluations[0].power
    assert fed.estimates["mean_storage_power"].estimate < -0.5 * fed.power
    optimum, place = found.optima[0]
    assert place == optimum.best == 0
    header, (row,) = found.table()
    assert "efficiency (output + store)" in header
    # The stored power is part of the efficiency, here below 0, and so its legend says.
    assert fed.estimates["end_to_end_efficiency"].estimate < fed.power / abs(
        fed.estimates["mean_input_power"].estimate
    )
    assert any("output and into its stores, over" in line for line in found.sentences())
    assert "at 40 not ranked: the load's stores supply part of the output" in row[-1]
    # Hollow in every figure is the point that is not ranked, error bar or not.
    for figure in map(found.figure, ("power", "efficiency")):
        (axes,) = figure.axes
        white = [line for line in axes.lines if line.get_markerfacecolor() in ("w", "white")]
        assert [list(line.get_xdata()) for line in white] == [[40.0], []]
        assert white[-1].get_label().startswith("hollow: not ranked")
    # Emptied within a part of the run: the scatter of batches hides no discharge.
    stored = fed.estimates["mean_storage_power"]
    wide = replace(stored, standard_error=3.0 * abs(stored.estimate))
    assert replace(fed, estimates={**fed.estimates, "mean_storage_power": wide}).unranked
    assert any(
        "of the output power comes from the load's stores, not" in line
        for line in found.sentences()
    )


@pytest.mark.slow
def test_a_point_that_sources_of_the_load_feed_is_not_ranked(tmp_path, pool):
    """A regulator that draws nothing from the rail holds 1.8 V at its resistor."""
    path = tmp_path / "fed.lib"
    path.write_text(
        ".subckt fed p n out ref resistance=100k\nR1 p n 300k\nR2 ref n 1k\n"
        "B1 ref out I=(1.8-v(out,ref))*1m\nRload out ref {resistance}\n.ends\n"
    )
    scene = Scene.read("device").replace({"run.duration": 2.0, "run.settle": 0.5})
    resistances = [1e5, 1e6]
    found = load_study(
        scene,
        loads=[str(path)],
        over={"load.parameters.resistance": resistances},
        method="monte-carlo",
        precision=0.5,
        executor=pool,
    )
    for resistance, point in zip(resistances, found.evaluations, strict=True):
        used = 1.8**2 / resistance * (resistance / (resistance + 1e3)) ** 2
        at_output = point.estimates["mean_power_used_at_output"].estimate
        assert at_output == pytest.approx(used, rel=1e-3)
        assert point.estimates["supplied_by_b1"].estimate == pytest.approx(used, rel=1e-3)
    assert found.best((0,)) is None
    _, (row,) = found.table()
    assert row[-1] == (
        "at 100 kΩ, 1 MΩ not ranked: b1 in the load supplies the output's whole power: nothing is "
        "harvested"
    )
    assert found.headline() == "no load has an output power"
