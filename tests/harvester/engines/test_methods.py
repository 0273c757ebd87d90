"""Methods as objects: they stand for what their names with options did, in simulate and studies."""

import pickle

import numpy as np
import pytest

import harvester
from harvester import Circuit, MonteCarlo, Scene, Stationary
from harvester.base.errors import HarvesterError
from harvester.engines.methods import ENGINES, engine_of, method_of
from harvester.engines.realizations import Realizations
from harvester.scene.prepared import prepared

pytestmark = pytest.mark.usefixtures("shared_workers")

BRIEF = ["run.duration=20", "run.settle=2", "run.realizations=2", "stoppers=none"]


@pytest.fixture(scope="module")
def scene():
    return Scene.read("paper", BRIEF)


def power(result):
    return result.scaled_quantities["mean_power"].estimate


@pytest.mark.parametrize(
    ("method", "name", "options"),
    [
        (MonteCarlo(), "monte-carlo", {}),
        pytest.param(
            MonteCarlo(step="fine", scheme="heun"),
            "monte-carlo",
            {"step": "fine", "scheme": "heun"},
            marks=pytest.mark.exhaustive,
        ),
        (
            Circuit(step=0.05, device="behavioural", copies=2),
            "circuit",
            {"step": 0.05, "device": "behavioural", "copies": 2},
        ),
        (Circuit(tolerance=1e-4), "circuit", {"tolerance": 1e-4}),
    ],
)
def test_an_object_gives_the_numbers_of_its_name_with_options(pool, scene, method, name, options):
    by_object = harvester.simulate(scene, method=method, runner=pool)
    by_name = harvester.simulate(scene, method=name, runner=pool, **options)
    assert power(by_object) == power(by_name)
    assert by_object.engine == by_name.engine == name
    assert by_object.step == by_name.step


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: harvester.simulate("paper", method="fokker_planck"), "are for average, sweep"),
        (lambda: harvester.simulate("paper", method="fokker-planck"), "are for average, sweep"),
        (lambda: harvester.simulate("paper", method="averaging"), "consistent.* are for average"),
        (lambda: harvester.average("paper", method="circuit"), "engines are for `simulate`"),
        (
            lambda: harvester.average("paper", method=None),
            "method None: must be a name",
        ),
        (lambda: MonteCarlo(steps=3), r"MonteCarlo .*no option steps .did you mean step"),
        (lambda: MonteCarlo(seed=3), r"scene\.replace sets run\.seed, run\.realizations"),
        (lambda: Stationary(closure="fp"), "unknown method fp; there are paper"),
        (lambda: MonteCarlo(step="0.001"), r"seconds > 0; write 0\.001 without quotes"),
        (lambda: MonteCarlo(step="x"), "step x: must be one of default"),
        (lambda: Stationary(1, 2, 3, 4, 5), "has 4 settings"),
    ],
)
def test_a_wrong_method_leads_to_the_right_one(call, words):
    with pytest.raises(harvester.HarvesterError, match=words) as raised:
        call()
    assert "\n" not in str(raised.value)


def test_a_closure_as_an_object_is_averaged(scene):
    method = Stationary("consistent", tolerance=1e-2)
    by_object = harvester.simulate(scene, method=method)
    by_name = harvester.average(scene, method="consistent", tolerance=1e-2)
    assert power(by_object) == power(by_name) == power(harvester.average(scene, method=method))
    assert by_object.engine == by_name.engine


def test_the_registry_gives_the_class_and_the_class_its_name():
    for name, kind in ENGINES.items():
        assert kind().name == name
        assert engine_of(name) == kind()
        assert pickle.loads(pickle.dumps(kind(step="fine"))) == kind(step="fine")
    assert method_of("paper") == Stationary("paper")


def test_settings_are_checked_where_the_object_is_made():
    for wrong, said in (
        (lambda: Circuit(device="compile"), "unknown device compile .did you mean compiled"),
        (lambda: Circuit(source="pvl"), "unknown source"),
        (lambda: Circuit(scheme="heun"), "unknown scheme"),
        (lambda: Circuit(copies=0), "copies 0"),
        (lambda: Circuit(copies=True), "copies True: must be a whole number"),
        (lambda: Circuit(gmin=-1e-12), "gmin -1e-12: must be a number"),
        (lambda: Circuit(gmin=True), "gmin True: must be a number"),
        (lambda: Circuit(ramp=float("nan")), "ramp nan: must be a number"),
        (lambda: MonteCarlo(step=-1.0), "step -1.0"),
        (lambda: MonteCarlo(step=True), "step True"),
        (lambda: MonteCarlo(step="superfine"), "mean fine.*finest, or the longest step in seconds"),
        (lambda: method_of(Stationary("fokker")), "unknown method fokker"),
    ):
        with pytest.raises(HarvesterError, match=said):
            wrong()
    with pytest.raises(HarvesterError, match="copies 2: only the circuit"):
        Circuit(copies=2).check(Scene.read("device", ["load.netlist=bridge"]))


def test_an_option_beside_an_object_warns_where_it_says_the_same_and_is_refused_else(pool, scene):
    with pytest.warns(DeprecationWarning, match="step= is given twice"):
        harvester.simulate(scene, method=MonteCarlo(step="fine"), step="fine", runner=pool)
    for option in ({"step": "finest"}, {"device": "compiled"}, {"tolerance": 1e-3}):
        (name,) = option
        with pytest.raises(HarvesterError, match=f"{name} = .*: not allowed with a method"):
            harvester.simulate(scene, method=MonteCarlo(), runner=pool, **option)
    with pytest.raises(HarvesterError, match=r"fit is for harvester\.average alone"):
        harvester.load_study(scene, method=Stationary(fit=True), executor=pool)


def test_a_sweep_tells_two_methods_of_one_name_apart(pool, scene):
    methods = [MonteCarlo(), MonteCarlo(step="fine"), Stationary("consistent")]
    found = harvester.sweep(scene, {"excitation.intensity": [0.02]}, methods=methods, executor=pool)
    assert found.methods == ("monte-carlo", "monte-carlo (step fine)", "consistent")
    values = [cell.estimates["mean_power"].estimate for cell in found.cells.ravel()]
    assert values[0] != values[1]
    assert values[1] == pytest.approx(values[0], rel=1e-2)
    with pytest.raises(HarvesterError, match="and each once"):
        harvester.sweep(scene, {}, methods=[MonteCarlo(), "monte-carlo"], executor=pool)


def test_studies_pass_the_object_on(pool, scene):
    """What each runs is told by the tasks' arguments: step and other settings."""
    method = Circuit(step="fine", device="behavioural")
    study = harvester.load_study(scene, method=method, executor=pool)
    reference = harvester.simulate(scene, method=method, runner=pool)
    assert study.evaluations[0].power == pytest.approx(power(reference), rel=1e-12)
    assert study.methods == ("circuit",)
    sine = {"amplitude": 0.1, "executor": pool}
    fine = harvester.frequency_response(scene, [0.2], method=MonteCarlo(step="fine"), **sine)
    same = harvester.frequency_response(scene, [0.2], step="fine", **sine)
    assert np.array_equal(fine.sweeps[0].mean_power, same.sweeps[0].mean_power)
    assert fine.engine == "monte-carlo"


def test_a_task_is_named_by_settings_only_where_they_differ(scene):
    def arguments(method):
        return Realizations.of(prepared(scene), method).tasks(0, 1)[0].arguments

    assert "settings" not in arguments(MonteCarlo(step="fine"))
    assert arguments(MonteCarlo(step="fine"))["step"] == "fine"
    assert arguments(Circuit(device="behavioural"))["settings"] == {"device": "behavioural"}
