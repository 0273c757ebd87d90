import dataclasses
import json
import math

import pytest
import worker_calls
from truths import drop_scene, flat, rebound_speed

from harvester.averaging import AVERAGED
from harvester.command_line import main
from harvester.device.timescales import fastest_angular_frequency, wells
from harvester.engines.steps import knot_spacing, steps_per_knot
from harvester.errors import (
    AveragingError,
    EnergyNotBalanced,
    HarvesterError,
    LoadError,
    SceneError,
)
from harvester.estimates.estimate import Estimate
from harvester.scene.model import Scene
from harvester.scene.units import scale
from harvester.simulation import simulate
from harvester.verification.stability.cases import (
    STEP_BUDGET,
    Case,
    changed,
    default_cases,
    run_length,
)
from harvester.verification.stability.matrix import StabilityMatrix, stability
from harvester.verification.stability.verdicts import JUDGED, Answer, judged

CASE = Case("scene", "as it is", {})


def said(value=1.0, error=0.01, residual=1e-4):
    estimates = {name: Estimate(value, error, None, "1") for name in JUDGED}
    return Answer(estimates, residual, 1.0, 100, 16)


def row(circuit=None, monte_carlo=None, paper=None, consistent=None):
    answers = {
        "circuit": circuit or said(),
        "monte-carlo": monte_carlo or said(),
        "paper": paper or said(error=1e-5),
        "consistent": consistent or said(error=1e-5),
        "slow_load": said(error=1e-5),
    }
    return judged(CASE, Scene.load("paper"), answers)


def test_agreement_within_error_bars_is_right():
    found = row(said(1.03), said(1.0))
    assert found.simulation.word == "right"
    assert found.worst_difference == pytest.approx(0.03 / math.hypot(0.01, 0.01))
    assert [verdict.word for verdict in found.closures.values()] == ["right"] * len(AVERAGED)


@pytest.mark.parametrize(
    ("circuit", "monte_carlo", "reason"),
    [
        (said(1.06), said(), "joint standard errors|σ"),
        (said(math.nan), said(), "mean square voltage"),
        (said(1.01, error=None), said(error=None), "mean square voltage"),
        (said(residual=0.02), said(), "circuit: energy balance"),
        (said(), said(residual=-0.02), "monte-carlo: energy balance"),
        (said(residual=math.nan), said(), "circuit: energy balance"),
        (EnergyNotBalanced("half is gone"), said(), "EnergyNotBalanced: half is gone"),
        (said(), HarvesterError("RuntimeWarning: overflow"), "monte-carlo: .*overflow"),
        (SceneError("no"), EnergyNotBalanced("half is gone"), "half is gone"),
    ],
)
def test_a_wrong_one_is_called_wrong(circuit, monte_carlo, reason):
    import re

    found = row(circuit, monte_carlo).simulation
    assert found.word == "wrong"
    assert re.search(reason, found.reason)


def test_short_runs_that_follow_the_same_path_need_no_error_bar():
    assert row(said(1.001, error=None), said(error=None)).simulation.word == "right"


def test_rare_events_that_only_the_longer_run_met_widen_the_circuits_error_bar():
    few = said(1.06, error=0.001)
    many = dataclasses.replace(said(1.0, error=0.01), realizations=64)
    assert row(few, many).simulation.word == "right"
    assert row(few, said(1.0, error=0.001)).simulation.word == "wrong"


def test_refusals_and_failures_of_closures():
    refused = row(paper=AveragingError("no double well"), consistent=said(error=0.01))
    assert refused.closures["paper"].word == "refused"
    assert refused.closures["paper"].reason == "no double well"
    assert refused.closures["consistent"].word == "wrong"
    assert row(paper=said(math.nan)).closures["paper"].word == "wrong"
    assert row(paper=HarvesterError("IndexError")).closures["paper"].word == "wrong"
    assert row(SceneError("none"), SceneError("none")).simulation.word == "refused"


def test_every_wrong_and_refused_cell_is_named_with_its_reason():
    rows = [row(), row(said(2.0)), row(paper=AveragingError("no double well"))]
    matrix = StabilityMatrix(Scene.load("paper"), rows, 1.0)
    assert len(matrix.wrong) == len(matrix.refused) == 1
    text = "\n".join(matrix.sentences())
    assert "10 right, 1 refused, 1 wrong" in text
    assert "WRONG scene: as it is, simulation" in text
    assert "refused by paper for scene: as it is: no double well" in text
    json.dumps(matrix.to_dict(), allow_nan=False)


def test_cases_hold_the_same_scaled_values_in_both_units():
    scaled, si = Scene.load("paper"), Scene.load("paper_si")
    for case in default_cases():
        if case.values.get("coupling") == 0.0:
            with pytest.raises(SceneError, match="coupling"):
                changed(si, case)
            continue
        ours, theirs = flat(changed(scaled, case)), flat(changed(si, case))
        assert theirs == pytest.approx(ours, rel=1e-9), case.title


def test_cases_fit_scenes_without_stoppers_or_wells():
    for name in ("device", "linear", "duffing"):
        for case in default_cases():
            try:
                scene = changed(Scene.load(name), case)
            except SceneError:
                continue
            steps = (scene.run.duration + scene.run.settle) / knot_spacing(scene)
            total = steps * steps_per_knot(scene) * scene.run.realizations
            assert total <= STEP_BUDGET * (1 + 1e-9), case.title


STOPPERS = "stoppers=[{side='left', gap=0.9, stiffness=9, restitution=0.4, exponent=2.0}]"


@pytest.mark.parametrize(
    ("name", "overrides", "refused"),
    [
        ("asymmetric", [], {"v0 held", "β = 0"}),
        ("one_sided", [], {"β = 0"}),
        ("tristable", [], {"v0 held", "β = 0"}),
        ("paper", [STOPPERS], set()),
        ("device", ["load.netlist=resistor"], {"v0 held", "β = 0"}),
    ],
)
def test_cases_are_made_of_any_parts(name, overrides, refused):
    scene = Scene.load(name, overrides)
    found = set()
    for case in default_cases():
        try:
            system, _ = scale(changed(scene, case))
        except SceneError:
            found.add(case.name)
            continue
        laws = [each.law for each in system.contacts]
        if "stiffness" in case.values:
            expected = [pytest.approx(case.values["stiffness"], rel=1e-9)] * len(laws)
            assert laws
            assert [law.stiffness for law in laws] == expected
        if "monostable" in case.values:
            assert len(wells(system)) == 1
        if "decay_rate" in case.values:
            assert system.transducer.load_rate == pytest.approx(case.values["decay_rate"])
        if "stoppers" in case.values:
            assert system.contacts == ()
    assert found == refused


def test_cases_of_a_piezo_are_refused_by_name_on_a_coil():
    scene = Scene.load("electromagnetic")
    for values in ({"decay_rate": 1.0}, {"coupling": 1.0}):
        with pytest.raises(SceneError, match="want a piezo, and this is a coil"):
            changed(scene, Case("", "", values))
    settle, duration = run_length(changed(scene, Case("", "", {"intensity": 1.0})))
    assert 0.0 < settle < duration < math.inf


def test_a_load_that_is_no_resistor_is_refused_at_once():
    with pytest.raises(LoadError, match="stability"):
        stability(Scene.load("device", ["load.netlist=bridge"]))


def test_the_default_step_follows_the_amplitude_that_the_noise_drives():
    weak, strong = (
        Scene.load("paper", [f"excitation.intensity={d}", "stoppers=none"]) for d in (0.02, 100)
    )
    assert steps_per_knot(weak, engine="monte-carlo") == 1
    assert steps_per_knot(strong, engine="monte-carlo") >= 3
    assert steps_per_knot(strong) == pytest.approx(
        2 * steps_per_knot(strong, engine="monte-carlo"), abs=1
    )
    fastest = fastest_angular_frequency(scale(strong)[0])
    result = simulate(
        strong.replace({"run.realizations": 2, "run.duration": 400.0, "run.settle": 50.0}),
        "monte-carlo",
        workers=1,
    )
    # Mean square velocity over mean square displacement: the frequency that the motion has.
    means = result.scaled_quantities
    ratio = means["mean_square_velocity"].estimate / means["mean_square_displacement"].estimate
    assert 0.6 * fastest < math.sqrt(ratio) < fastest


@pytest.mark.parametrize("rate", ["100", "1e4"])
def test_monte_carlo_holds_when_the_load_is_faster_than_the_step(pool, rate):
    scene = Scene.load(
        "linear", [f"load.decay_rate={rate}", "run.realizations=2", "run.duration=400"]
    )
    circuit, reference = (simulate(scene, e, pool=pool) for e in ("circuit", "monte-carlo"))
    for name in JUDGED:
        ours = circuit.scaled_quantities[name].estimate
        assert ours == pytest.approx(reference.scaled_quantities[name].estimate, rel=5e-3)


@pytest.mark.parametrize("stiffness", ["10", "1e6", "1e8"])
@pytest.mark.parametrize("restitution", [0.3, 0.5, 0.7, 0.9, 1.0])
def test_a_drop_in_the_circuit_rebounds_as_the_exact_law_says(worker, restitution, stiffness):
    run = ("run.realizations=2", "run.duration=3", "run.settle=0")
    scene = drop_scene(restitution, stiffness, *run)
    record = worker.call(worker_calls.drop, {"scene": scene, "speed": 1.0, "step": "default"})
    assert -record[2, -1] == pytest.approx(rebound_speed(restitution), abs=1e-3)


def test_statistics_converge_in_the_rigid_limit(pool):
    """Contact time and depth go with K^−0.4: from 1e7 on they are below 1 % of the motion's."""
    means = {}
    for stiffness in (1e2, 1e7, 1e8):
        scene = Scene.load("paper", ["run.realizations=2", "run.duration=20000"])
        scene = scene.replace({"stoppers.stiffness": stiffness})
        result = simulate(scene, "monte-carlo", pool=pool)
        assert abs(result.energy_balance_residual) < 0.01
        means[stiffness] = result.scaled_quantities["mean_square_velocity"]
    soft, hard, rigid = (means[k] for k in (1e2, 1e7, 1e8))
    joint = math.hypot(hard.standard_error, rigid.standard_error)
    assert joint < 0.04 * rigid.estimate
    assert abs(hard.estimate - rigid.estimate) < 3.5 * joint
    assert soft.estimate > 1.5 * rigid.estimate


def test_a_small_matrix_from_the_command_line(tmp_path, monkeypatch, capsys):
    wanted = ("as it is", "β = 0", "K = 1e8", "δ = 0.95 wells", "λ = 1e4, β = 100")
    cases = [case for case in default_cases() if case.name in wanted]
    monkeypatch.setattr("harvester.verification.stability.matrix.default_cases", lambda: cases)
    monkeypatch.setattr("harvester.verification.stability.cases.STEP_BUDGET", 20_000)
    call = ["stability", "paper_si", "--json", str(tmp_path / "a.json"), "--output", str(tmp_path)]
    assert main(call) == 0
    content = json.loads((tmp_path / "a.json").read_text())
    assert [case["case"] for case in content["cases"]] == [case.name for case in cases]
    verdicts = {case["case"]: case["verdict"] for case in content["cases"]}
    assert verdicts.pop("β = 0") == "refused"
    assert set(verdicts.values()) == {"right"}
    assert content["wrong"] == 0
    assert (tmp_path / "paper_si-stability.png").read_bytes().startswith(b"\x89PNG")
    assert "refused by simulation for coupling: β = 0" in capsys.readouterr().out


def test_a_wrong_cell_is_exit_code_one(monkeypatch, capsys):
    wrong = StabilityMatrix(Scene.load("paper"), [row(said(2.0))], 1.0)
    monkeypatch.setattr(
        "harvester.verification.stability.matrix.stability", lambda scene, **_: wrong
    )
    assert main(["stability"]) == 1
    assert "WRONG" in capsys.readouterr().out


def test_a_case_that_runs_out_of_time_is_its_verdict_only(monkeypatch):
    monkeypatch.setattr("harvester.verification.stability.matrix.TIME_LIMIT", 0.01)
    matrix = stability(Scene.load("paper"), cases=[CASE])
    assert matrix.rows[0].simulation.word == "wrong"
    assert "SimulatorTimeout" in matrix.rows[0].simulation.reason


@pytest.mark.slow
def test_no_cell_of_the_default_matrix_is_wrong():
    matrix = stability(Scene.load("paper"))
    assert matrix.wrong == []
    assert len(matrix.rows) > 50
