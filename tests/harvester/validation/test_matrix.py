import itertools
import json
import math
import re

import pytest
import worker_calls
from truths import drop_scene, flat

from harvester.base.errors import SceneError
from harvester.cli.command_line import main
from harvester.device.timescales import fastest_angular_frequency, wells
from harvester.engines.opening import open_runner
from harvester.engines.simulate import simulate
from harvester.results.page import all_facts, table_in_pages
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing, steps_per_sample
from harvester.validation import MEANS
from harvester.validation import stability as module
from harvester.validation.formulas import rebound_speed
from harvester.validation.public import stability
from harvester.validation.stability import StabilityMatrix
from harvester.validation.stability_cases import (
    STEP_BUDGET,
    Case,
    changed,
    default_cases,
    run_length,
)
from harvester.validation.verdicts import REFUSED, RIGHT, CaseRow, CaseVerdict

pytestmark = pytest.mark.usefixtures("shared_workers")

CASE = Case("scene", "as it is", {})
# Without coupling: none of a scene in SI units.
UNCOUPLED = {"β = 0", "β = 0, e = 1, c = 1, τ1 = 0.01"}


@pytest.fixture
def briefly(monkeypatch):
    """Both engines and the fastest closure, on short runs."""
    monkeypatch.setattr(module, "METHODS", ("circuit", "monte-carlo", "consistent"))
    monkeypatch.setattr("harvester.validation.stability_cases.STEP_BUDGET", 20_000)


@pytest.mark.slow
def test_cases_hold_the_same_scaled_values_in_both_units():
    scaled, si = Scene.read("paper"), Scene.read("paper_si")
    for case in default_cases():
        if case.values.get("coupling") == 0.0:
            with pytest.raises(SceneError, match="coupling"):
                changed(si, case)
            continue
        ours, theirs = flat(changed(scaled, case)), flat(changed(si, case))
        assert theirs == pytest.approx(ours, rel=1e-9), case.title


@pytest.mark.slow
def test_cases_fit_scenes_without_stoppers_or_wells():
    for name in ("device", "linear", "duffing"):
        for case in default_cases():
            try:
                scene = changed(Scene.read(name), case)
            except SceneError:
                continue
            steps = (scene.run.duration + scene.run.settle) / knot_spacing(prepared(scene))
            total = (
                steps
                * steps_per_sample(prepared(scene), engine="monte-carlo")
                * scene.run.realizations
            )
            assert total <= STEP_BUDGET * (1 + 1e-9), case.title


STOPPERS = "stoppers=[{side='left', gap=0.9, stiffness=9, restitution=0.4, exponent=2.0}]"


@pytest.mark.parametrize(
    ("name", "overrides", "refused"),
    [
        ("asymmetric", [], UNCOUPLED | {"v0 held"}),
        ("one_sided", [], UNCOUPLED),
        ("tristable", [], UNCOUPLED | {"v0 held"}),
        ("paper", [STOPPERS], set()),
        ("device", ["load.netlist=resistor"], UNCOUPLED | {"v0 held"}),
    ],
)
def test_cases_are_made_of_any_parts(name, overrides, refused):
    scene = Scene.read(name, overrides)
    found = set()
    for case in default_cases():
        try:
            system = prepared(changed(scene, case)).system
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
    scene = Scene.read("electromagnetic")
    for values in ({"decay_rate": 1.0}, {"coupling": 1.0}):
        with pytest.raises(SceneError, match=r"need a \[piezo\]"):
            changed(scene, Case("", "", values))
    settle, duration = run_length(prepared(changed(scene, Case("", "", {"intensity": 1.0}))))
    assert 0.0 < settle < duration < math.inf


def test_the_default_step_follows_the_amplitude_that_the_noise_drives():
    weak, strong = (
        Scene.read("paper", [f"excitation.intensity={d}", "stoppers=none"]) for d in (0.02, 100)
    )
    ready = prepared(strong)
    assert steps_per_sample(prepared(weak), engine="monte-carlo") == 1
    assert steps_per_sample(ready, engine="monte-carlo") >= 3
    assert steps_per_sample(ready) == pytest.approx(
        2 * steps_per_sample(ready, engine="monte-carlo"), abs=1
    )
    fastest = fastest_angular_frequency(ready.system)
    result = simulate(
        strong.replace({"run.realizations": 2, "run.duration": 400.0, "run.settle": 50.0}),
        method="monte-carlo",
        workers=1,
    )
    # Mean square velocity over mean square displacement: the frequency that the motion has.
    means = result.scaled_quantities
    ratio = means["mean_square_velocity"].estimate / means["mean_square_displacement"].estimate
    assert 0.6 * fastest < math.sqrt(ratio) < fastest


@pytest.mark.parametrize("rate", ["100", "1e4"])
def test_monte_carlo_holds_when_the_load_is_faster_than_the_step(pool, rate):
    scene = Scene.read(
        "linear", [f"load.decay_rate={rate}", "run.realizations=2", "run.duration=400"]
    )
    circuit, reference = (
        simulate(scene, method=e, runner=pool) for e in ("circuit", "monte-carlo")
    )
    for name in MEANS:
        ours = circuit.scaled_quantities[name].estimate
        assert ours == pytest.approx(reference.scaled_quantities[name].estimate, rel=5e-3)


# At K = 10 drops are rows of `verify`.
DROPS = {(0.3, "1e6"), (0.7, "1e6"), (1.0, "1e8")}


@pytest.mark.parametrize(
    ("restitution", "stiffness"),
    [
        pytest.param(*drop, marks=pytest.mark.slow if drop in DROPS else pytest.mark.exhaustive)
        for drop in itertools.product((0.3, 0.5, 0.7, 0.9, 1.0), ("1e6", "1e8"))
    ],
)
def test_a_drop_in_the_circuit_rebounds_as_the_exact_law_says(worker, restitution, stiffness):
    run = ("run.realizations=2", "run.duration=3", "run.settle=0")
    scene = drop_scene(restitution, stiffness, *run)
    record = worker.call(worker_calls.drop, {"scene": scene, "speed": 1.0, "step": "default"})
    assert -record[2, -1] == pytest.approx(rebound_speed(restitution), abs=1e-3)


def test_statistics_converge_in_the_rigid_limit(pool):
    """Contact time and depth go with K^−0.4: from 1e7 on they are below 1 % of the motion's."""
    means = {}
    for stiffness in (1e2, 1e7, 1e8):
        scene = Scene.read("paper", ["run.realizations=2", "run.duration=20000"])
        scene = scene.replace({"stoppers.stiffness": stiffness})
        result = simulate(scene, method="monte-carlo", runner=pool)
        assert abs(result.energy_balance_residual) < 0.01
        means[stiffness] = result.scaled_quantities["mean_square_velocity"]
    soft, hard, rigid = (means[k] for k in (1e2, 1e7, 1e8))
    joint = math.hypot(hard.standard_error, rigid.standard_error)
    assert joint < 0.04 * rigid.estimate
    assert abs(hard.estimate - rigid.estimate) < 3.5 * joint
    assert soft.estimate > 1.5 * rigid.estimate


@pytest.mark.slow
@pytest.mark.usefixtures("briefly")
def test_a_small_matrix_from_the_command_line(tmp_path, monkeypatch, capsys):
    wanted = ("as it is", "β = 0", "K = 1e8")
    cases = [case for case in default_cases() if case.name in wanted]
    monkeypatch.setattr(module, "default_cases", lambda: cases)
    call = ["stability", "paper_si", "--json", str(tmp_path / "a.json"), "--output", str(tmp_path)]
    assert main(call) == 0
    content = json.loads((tmp_path / "a.json").read_text())
    assert [case["case"] for case in content["cases"]] == [case.name for case in cases]
    circuits = {case["case"]: case["verdicts"]["circuit"] for case in content["cases"]}
    assert circuits.pop("β = 0")["verdict"] == "refused"
    assert {each["verdict"] for each in circuits.values()} == {"right"}
    assert all(each["evidence"][0]["sharpness"] <= 0.02 for each in circuits.values())
    assert content["counts"]["wrong"] == 0
    assert (tmp_path / "paper_si-stability.png").read_bytes().startswith(b"\x89PNG")
    assert "refused: circuit for coupling: β = 0" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.usefixtures("briefly")
def test_the_same_folder_again_computes_nothing_and_tells_the_same(tmp_path):
    told = []
    for computed in (3, 0):
        with open_runner(tmp_path, workers=2) as runner:
            found = stability(Scene.read("linear"), cases=[CASE], runner=runner).to_dict()
            assert runner.computed == computed
        told.append({name: value for name, value in found.items() if name != "wall_seconds"})
    assert told[0] == told[1]


def test_a_wrong_cell_is_exit_code_one(monkeypatch, capsys):
    row = CaseRow(CASE, {"circuit": None}, {"circuit": CaseVerdict("wrong", "far off")})
    wrong = StabilityMatrix(Scene.read("paper"), [row], 1.0)
    monkeypatch.setattr(module, "matrix_of", lambda *_: wrong)
    assert main(["stability"]) == 1
    assert "WRONG scene: as it is, circuit: far off" in capsys.readouterr().out


def test_a_long_table_comes_in_pages_and_its_refusals_are_folded():
    rows = [
        CaseRow(
            Case("scene", f"case {k}", {}),
            {"paper": None},
            {"paper": CaseVerdict(REFUSED, f"no {k}")},
        )
        for k in range(67)
    ]
    matrix = StabilityMatrix(Scene.read("paper"), rows, 1.0)
    shown = [
        {cell.get_text().get_text() for cell in figure.axes[0].tables[0].get_celld().values()}
        for figure in (picture.figure() for picture in matrix.view().pictures)
    ]
    assert [sum("case" in text for text in page) for page in shown] == [30, 30, 7]
    page = table_in_pages(*matrix.table()) + all_facts(matrix.sentences())
    assert re.findall(r"<details( open|)><summary>(.*?)</summary>", page) == [
        (" open", "scene: case 0 … scene: case 24 (25 of 67)"),
        ("", "scene: case 25 … scene: case 49 (25 of 67)"),
        ("", "scene: case 50 … scene: case 66 (17 of 67)"),
        ("", "61 more"),
    ]
    assert "no 66" in page.partition("61 more")[2]


def test_a_case_that_runs_out_of_time_is_unfinished(monkeypatch, capsys):
    monkeypatch.setattr(module, "METHODS", ("circuit",))
    monkeypatch.setattr(module, "default_cases", lambda: [CASE])
    assert main(["stability", "paper", "--time-limit", "0.01"]) == 0
    assert "unfinished: circuit for scene: as it is" in capsys.readouterr().out


# Of the default cases of `paper`: what refuses there; all else is right.
REFUSING = {
    "as it is": set(),
    "K = 1e8, δ = 1 well, e = 0": {"fokker_planck"},
    "D = 1e-6": set(),
    "β = 0": set(),
    "β = 0, e = 1, c = 1, τ1 = 0.01": set(),
    "λ = 1e-4, β = 100": {"paper", "consistent", "fokker_planck"},
    "τ1 = 1e3": {"paper", "consistent", "fokker_planck"},
    "D = 100, no stoppers": set(),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", REFUSING)
def test_a_case_is_right_by_all_that_take_it(name, monkeypatch):
    monkeypatch.setattr("harvester.validation.stability_cases.STEP_BUDGET", 400_000)
    chosen = [case for case in default_cases() if case.name == name]
    (row,) = stability(Scene.read("paper"), cases=chosen, workers=1).rows
    words = {method: verdict.word for method, verdict in row.cells.items()}
    refusing = REFUSING[name]
    assert words == {method: REFUSED if method in refusing else RIGHT for method in words}


@pytest.mark.slow
def test_means_are_judged_by_closed_forms_and_the_stationary_solution(monkeypatch):
    monkeypatch.setattr("harvester.validation.stability_cases.STEP_BUDGET", 3_000_000)
    (row,) = stability(Scene.read("linear"), cases=[CASE], workers=1).rows
    verdict = row.cells["monte-carlo"]
    assert verdict.word == RIGHT
    assert {each.reference for each in verdict.references} >= {"small motion", "fokker_planck"}


@pytest.mark.exhaustive
def test_no_cell_of_the_default_matrix_is_wrong(monkeypatch):
    """With a quarter of Monte Carlo's steps, by which it judges half as sharply."""
    monkeypatch.setattr("harvester.validation.stability_cases.STEP_BUDGET", 3_000_000)
    matrix = stability(Scene.read("paper"))
    assert matrix.wrong == []
    assert len(matrix.rows) > 50
    judged = sum(len(matrix.cells(word)) for word in ("right", "wrong"))
    assert judged > 5 * len(matrix.cells("not judged"))
