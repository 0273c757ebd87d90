"""A harvester with a converter and a node behind it, whole: energy stage by stage, both engines."""

import pytest

from circuits.netlist.kinds import LOSS, OUTPUT
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene

SUFFIX = {LOSS: "loss", OUTPUT: "power"}
# Small enough to stay in a well: paths of both engines stay together.
QUIET = ["run.duration=6", "run.settle=0", "run.realizations=2", "excitation.intensity=0.004"]
# Charged so far that the converter starts within the run, and the node with it.
LOADS = {
    "node_buck": ["buffer=10u", "buffer_initial=5.04", "storage=10u", "period=0.5"],
    "node_boost": ["capacitance=100u", "capacitor_initial=2.9", "storage=4.7u", "period=0.5"],
}


def scene_of(load, *more):
    parameters = [f"load.parameters.{each}" for each in LOADS[load]]
    return Scene.read("device", [f"load.netlist={load}", *parameters, *more])


def stages(scene, result):
    """Sum of what every stage loses and gives and all stores, over what leaves the piezo."""
    parts = [
        result[f"{name}_{SUFFIX[kind]}"].estimate
        for kind, name in scene.load.circuit.measured
        if kind in SUFFIX
    ]
    total = sum(parts) + result["mean_storage_power"].estimate
    return total / result["mean_power"].estimate


@pytest.mark.slow
@pytest.mark.parametrize("load", LOADS)
def test_both_engines_run_the_node_and_every_stage_accounts_for_its_energy(pool, load):
    """On the same noise: what the node gets and each stage loses within 2 %, the same events."""
    scene = scene_of(load, *QUIET)
    ours = simulate(scene, method="monte-carlo", step="fine", runner=pool)
    theirs = simulate(scene, method="circuit", runner=pool)
    for result in (ours, theirs):
        assert stages(scene, result) == pytest.approx(1.0, abs=5e-3)
        assert abs(result.energy_balance_residual) < 5e-3
    names = ["node_power", "bridge_loss", "buck_loss", "burst_energy", "node_time_share"]
    for name in names:
        assert ours[name].estimate == pytest.approx(theirs[name].estimate, rel=0.02), name
    for name in ("burst_starts_per_hour", "node_stops_per_hour", "node_starts_per_hour"):
        assert ours[name].estimate == pytest.approx(theirs[name].estimate, rel=1e-6), name
    assert ours["burst_starts_per_hour"].estimate > 0.0


@pytest.mark.slow
def test_ten_minutes_conserve_energy(pool):
    """The balance of the whole within 0.5 %, of the stages behind the piezo within 0.2 %."""
    scene = scene_of("node_buck", "run.duration=600", "run.settle=0", "run.realizations=1")
    result = simulate(scene, method="monte-carlo", runner=pool)
    assert abs(result.energy_balance_residual) < 5e-3
    assert stages(scene, result) == pytest.approx(1.0, abs=2e-3)
    share = result["node_time_share"]
    assert 0.9 < share.estimate <= 1.0
