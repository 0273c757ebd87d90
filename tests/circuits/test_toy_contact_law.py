"""The recipe of CONTRIBUTING for a contact law: one module and one entry in a table."""

import numpy as np
import pytest
import worker_calls
from device_truths import Written, written_path
from spring_dashpot import DASHPOT, spring_dashpot

from circuits.equivalent.assembly import assemble
from circuits.equivalent.compact_model import module
from harvester.averaging.closures import NOISE_CLOSURES
from harvester.averaging.of_scene import average
from harvester.base.errors import AveragingError, SceneError
from harvester.device import system
from harvester.device.contact import LAWS
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing, stop_time

TABLES = {
    "units": "scaled",
    "oscillator": {"damping": 0.1, "restoring_force": [0.0, 2.0]},
    "stoppers": [
        {"gap": 0.3, "stiffness": 60.0, "restitution": 0.5, "side": "right", "law": "dashpot"}
    ],
    "piezo": {"coupling": 0.4},
    "load": {"decay_rate": 0.3},
    "excitation": {"kind": "ornstein-uhlenbeck", "intensity": 0.15, "correlation_time": 0.4},
    "run": {"duration": 60.0, "seed": 3},
}


@pytest.fixture
def scene(monkeypatch):
    monkeypatch.setitem(LAWS, "dashpot", spring_dashpot)
    return Scene.from_tables(TABLES, name="toy")


def test_a_law_is_known_by_its_entry_alone(scene):
    assert scene.stoppers[0].law == "dashpot"
    assert Scene.from_tables(scene.to_tables(), name="toy") == scene
    with pytest.raises(SceneError, match=r"dashpots.*hertz-damp.*dashpot"):
        scene.replace({"stoppers[0].law": "dashpots"})


@pytest.mark.parametrize(
    ("engine", "largest"),
    [
        pytest.param("monte-carlo", 1e-5, marks=pytest.mark.exhaustive),
        pytest.param("circuit", 1e-3, marks=pytest.mark.slow),
    ],
)
def test_both_engines_follow_scipys_path(scene, worker, monkeypatch, engine, largest):
    """A dashpot's force jumps where it begins: the circuit then keeps one order less."""

    def force(self, s, stopper, x, v, held):
        depth = s * x - stopper["gap"]
        return stopper["stiffness"] * (s * depth + DASHPOT * v) if depth > 0.0 else 0.0

    monkeypatch.setattr(Written, "contact", force)
    ready = prepared(scene)
    reference = written_path(scene, round(stop_time(ready) / knot_spacing(ready)))[1:]
    arguments = {"tables": TABLES, "engine": engine, "step": "finest"}
    states = worker.call(worker_calls.run_with_law, arguments, time_limit=60.0)
    assert reference[:, 0].max() > 0.35
    assert np.abs(states[:, 0] - reference[:, 0]).max() < largest


def test_netlist_and_verilog_hold_its_formula(scene):
    s = prepared(scene).system
    assert "Bstopper_right velocity" in assemble(prepared(scene)).text
    _, text, values = module(s, 2.0)
    assert "stopper_right_dashpot*u" in text
    assert values["stopper_right_stiffness"] == 60.0 / 2.0**2
    assert system.potential(s, 0.5) == pytest.approx(0.5**2 + 0.5 * 60.0 * 0.2**2)


@pytest.mark.parametrize("closure", NOISE_CLOSURES)
def test_averaging_refuses_it_by_name(scene, closure):
    with pytest.raises(AveragingError, match="simulate"):
        average(scene, method=closure)
