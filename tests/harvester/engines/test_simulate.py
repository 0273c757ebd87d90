import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from truths import flat, interpolated_linear_means

import harvester
from harvester.base.errors import EnergyNotBalanced, HarvesterError, SimulatorTimeout
from harvester.engines.methods import engine_of
from harvester.engines.simulate import simulate
from harvester.engines.spread import useful_processes
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing
from harvester.statistics.paired import paired_difference

MEANS = (
    "mean_square_voltage",
    "mean_power",
    "power_conversion_efficiency",
    "mean_square_displacement",
    "mean_square_velocity",
)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["circuit", "monte-carlo"])
@pytest.mark.parametrize(
    "overrides",
    [
        [],
        pytest.param(
            ["oscillator.damping=0.4", "load.decay_rate=0.5", "run.seed=11"],
            marks=pytest.mark.exhaustive,
        ),
    ],
)
def test_a_linear_scene_meets_the_lyapunov_equation(pool, engine, overrides):
    """False-alarm rate 1.3 % per case: five means at three of their own standard errors."""
    scene = Scene.read("linear", ["run.realizations=2", "run.duration=10000", *overrides])
    result = simulate(scene, method=engine, runner=pool)
    exact = interpolated_linear_means(flat(scene), knot_spacing(prepared(scene)))
    for name in MEANS:
        found = result.scaled_quantities[name]
        assert abs(found.estimate - exact[name]) < 3 * found.standard_error, name
        assert found.standard_error < 0.03 * found.estimate
    assert abs(result.energy_balance_residual) < 1e-3


@pytest.mark.slow
def test_one_and_two_workers_give_the_same_numbers(pool):
    scene = Scene.read("paper", ["run.duration=200", "run.realizations=4"])
    for engine in ("circuit", "monte-carlo"):
        two = simulate(scene, method=engine, runner=pool).to_dict()
        one = simulate(scene, method=engine, workers=1).to_dict()
        assert one["quantities"] == two["quantities"]
        assert one["netlist_sha256"] == two["netlist_sha256"]


@pytest.fixture
def process_executor():
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as executor:
        yield executor


@pytest.mark.exhaustive
@pytest.mark.parametrize("kind", ["process_executor", "dask_executor"])
def test_any_executor_gives_the_same_numbers(pool, kind, request):
    scene = Scene.read("paper", ["run.duration=100", "run.realizations=3"])
    expected = simulate(scene, method="circuit", runner=pool).to_dict()["quantities"]
    executor = request.getfixturevalue(kind)
    result = simulate(scene, method="circuit", executor=executor)
    assert result.to_dict()["quantities"] == expected


def test_a_realization_that_fails_for_good_is_named_in_the_result(pool):
    scene = Scene.read("paper", ["run.duration=100", "run.realizations=3"])
    whole = simulate(scene, method="monte-carlo", runner=pool)

    class Failing:
        def map(self, *arguments):
            outcomes = pool.map(*arguments)
            return [outcomes[0], SimulatorTimeout("the limit"), outcomes[2]]

    result = simulate(scene, method="monte-carlo", keep_going=True, runner=Failing())
    assert result.outcome == "incomplete"
    assert result.failures == {1: "SimulatorTimeout: the limit"}
    assert any("1 of 3 realizations failed" in note for note in result.notes)
    assert result.realizations == 2
    assert result.simulated_time == pytest.approx(whole.simulated_time * 2 / 3)


def test_the_seed_decides_the_noise(pool):
    scene = Scene.read("paper", ["run.realizations=2", "run.duration=100"])
    one = simulate(scene, method="monte-carlo", runner=pool)
    other = simulate(scene.replace({"run.seed": 2}), method="monte-carlo", runner=pool)
    assert one.scaled_quantities != other.scaled_quantities


@pytest.mark.slow
def test_circuit_and_monte_carlo_follow_the_same_path(pool):
    """The circuit's bias by its default step, at most 1 %, paired: in a well and between the wells.

    Between the wells for as long as paths stay together. Three standard errors: 0.3 % false alarms.
    """
    runs = {0.002: (2, 3000, 200), 0.1: (32, 25, 0)}
    for intensity, (realizations, duration, settle) in runs.items():
        scene = Scene.read("paper", [f"excitation.intensity={intensity}"]).replace(
            run={"realizations": realizations, "duration": float(duration), "settle": float(settle)}
        )
        circuit = simulate(scene, method="circuit", runner=pool)
        reference = simulate(scene, method="monte-carlo", step="fine", runner=pool)
        assert abs(circuit.energy_balance_residual) < 0.01
        bias = paired_difference(circuit, reference)["mean_square_velocity"]
        assert abs(bias.estimate) < 0.01 + 3 * bias.standard_error
        assert bias.standard_error < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("name", Scene.names())
def test_the_energy_balance_closes_for_every_built_in_scene(pool, name):
    scene = Scene.read(name)
    ready = prepared(scene)
    short = scene.replace(
        {
            "run.realizations": 2,
            "run.duration": 2000 * knot_spacing(ready),
            "run.settle": 0.0,
        }
    )
    assert abs(simulate(short, method="circuit", runner=pool).energy_balance_residual) < 0.01
    brief = scene.replace(
        {
            "run.realizations": 2,
            "run.duration": 400 * knot_spacing(ready),
            "run.settle": 0.0,
        }
    )
    finest = simulate(brief, method="circuit", step="finest", runner=pool)
    assert abs(finest.energy_balance_residual) < 0.001


def test_a_result_carries_its_evidence_and_shows_itself(pool):
    scene = Scene.read("paper_si", ["run.realizations=2", "run.duration=400"])
    result = simulate(scene, method="circuit", runner=pool)
    content = result.to_dict()
    assert content["quantities"]["mean_square_voltage"]["unit"] == "V^2"
    assert content["quantities"]["mean_square_velocity"]["unit"] == "(m/s)^2"
    ratio = (
        content["quantities"]["mean_power"]["estimate"]
        / content["scaled_quantities"]["mean_power"]["estimate"]
    )
    assert ratio == pytest.approx(content["scales"]["power"])
    assert content["simulated_time"] == pytest.approx(2 * 600.0)
    assert content["engine_version"].startswith("ngspice-")
    assert len(content["netlist_sha256"]) == 64
    assert "<table" in result._repr_html_()


def test_si_and_scaled_scenes_give_the_same_circuit_results(pool):
    options = ["run.realizations=2", "run.duration=200", "run.settle=0"]
    si = simulate(Scene.read("paper_si", options), method="circuit", runner=pool)
    scaled = simulate(Scene.read("paper", options), method="circuit", runner=pool)
    for name, estimate in scaled.scaled_quantities.items():
        if np.isfinite(estimate.estimate):
            other = si.scaled_quantities[name].estimate
            assert other == pytest.approx(estimate.estimate, rel=1e-5), name


@pytest.mark.slow
def test_the_time_limit_keeps_what_the_run_had(pool):
    scene = Scene.read("paper", ["run.duration=1e6", "run.realizations=1", "run.settle=10"])
    # The processes start before the clock does.
    simulate(scene.replace({"run.duration": 10.0, "run.realizations": 2}), runner=pool)
    with pytest.raises(SimulatorTimeout) as caught:
        simulate(scene, method="circuit", time_limit=2.0, runner=pool)
    partial = caught.value.partial
    assert partial.outcome == "SimulatorTimeout"
    assert 10.0 < partial.simulated_time < 1e6
    assert partial.scaled_quantities["mean_square_voltage"].estimate > 0.0


def test_an_energy_balance_that_does_not_close_is_an_error(pool):
    scene = Scene.read(
        "linear", ["oscillator.linear_stiffness=1e5", "run.realizations=2", "run.duration=400"]
    )
    with pytest.raises(EnergyNotBalanced, match="step"):
        simulate(scene, method="monte-carlo", step=0.004, runner=pool)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"method": "circus"}, "did you mean circuit"),
        ({"step": "finer"}, "did you mean fine"),
        ({"step": -1.0}, "seconds > 0"),
        ({"step": "nan"}, "seconds > 0"),
        ({"source": "PWL"}, "external, pwl"),
    ],
)
def test_unknown_names_are_refused(arguments, words):
    with pytest.raises(HarvesterError, match=words):
        simulate(Scene.read("paper"), **arguments)


@pytest.mark.slow
def test_an_interrupt_ends_the_workers_and_writes_nothing(tmp_path):
    command = [sys.executable, "-m", "harvester", "simulate", "paper"]
    command += [
        "--set",
        "run.realizations=2",
        "--set",
        "run.duration=1e7",
        "--json",
        str(tmp_path / "result.json"),
    ]
    # What runs in a shell's background is born deaf to interrupts, and so would be its children.
    process = subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    children = _children_when_busy(process.pid)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 130
    assert errors.decode().strip().endswith("interrupted; nothing was written")
    assert list(tmp_path.iterdir()) == []
    deadline = time.monotonic() + 60
    while any(_alive(child) for child in children) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(_alive(child) for child in children)


@pytest.mark.slow
def test_killing_a_worker_ends_the_run_with_a_named_error(tmp_path):
    target = tmp_path / "result.json"
    command = [sys.executable, "-m", "harvester", "simulate", "paper", "--json", str(target)]
    process = subprocess.Popen(
        [
            *command,
            "--set",
            "run.realizations=2",
            "--set",
            "run.duration=1e7",
            "--set",
            "run.settle=0",
        ],
        stderr=subprocess.PIPE,
    )
    child = _children_when_busy(process.pid)[0]
    os.kill(child, signal.SIGKILL)
    # The other worker would go on for minutes.
    _, errors = process.communicate(timeout=30)
    assert process.returncode == 1
    assert "SimulatorCrashed" in errors.decode()
    assert "signal 9" in errors.decode()
    # Killed before its first report, a realization has nothing to keep.
    if target.exists():
        assert json.loads(target.read_text())["outcome"] == "SimulatorCrashed"


def _children_when_busy(parent):
    """Process numbers of the workers, once there are two of them and they simulate."""
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline:
        lists = Path(f"/proc/{parent}/task").glob("*/children")
        children = [int(word) for each in lists for word in each.read_text().split()]
        if len(children) == 2:
            time.sleep(1.5)
            return children
        time.sleep(0.05)
    raise AssertionError("no workers")


def _alive(process):
    try:
        with open(f"/proc/{process}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_the_package_offers_its_objects_lazily():
    assert harvester.simulate is simulate
    assert "Scene" in dir(harvester)
    with pytest.raises(AttributeError, match="simulat"):
        _ = harvester.simulat


@pytest.mark.parametrize(
    ("overrides", "method", "expected"),
    [
        ([], "monte-carlo", 1),
        (["run.duration=22000"], "monte-carlo", 3),
        (["run.duration=1e9"], "monte-carlo", 64),
        ([], "circuit", 64),
    ],
)
def test_only_a_run_that_takes_longer_than_a_process_to_start_is_spread(
    overrides, method, expected
):
    prepared_scene = prepared(Scene.read("paper", overrides))
    assert useful_processes(prepared_scene, engine_of(method)) == expected
