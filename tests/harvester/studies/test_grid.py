import numpy as np
import pytest

from harvester.base.errors import HarvesterError
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing
from harvester.studies.grid import make_grid

RESISTANCE = "load.parameters.resistance"


@pytest.fixture
def device():
    return Scene.read("device")


def test_several_sweeps_make_a_grid(device):
    sweeps = {RESISTANCE: [1e5, 1e6], "excitation.intensity": [0.1, 0.2, 0.3]}
    grid = make_grid(device, ["bridge", "resistor"], sweeps)
    assert len(grid.points) == 12
    last = grid.points[-1]
    assert (last.load, last.place) == ("resistor", (1e6, 0.3))
    assert last.scene.load.circuit.resistance == 1e6
    assert last.scene.excitation.intensity == 0.3
    assert list(grid.sweeps)[grid.curve] == "excitation.intensity"


@pytest.mark.parametrize("key", [RESISTANCE, "load.resistance"])
def test_either_name_means_the_loads_resistor(device, key):
    own = make_grid(device, [], {key: [2e5]}).points[0].scene
    grid = make_grid(device, ["bridge"], {key: [2e5]})
    mapped = "load.resistance sets load.parameters.resistance of bridge"
    assert (mapped in grid.notes) == (key != RESISTANCE)
    netlist = grid.points[0].scene
    assert own.load.resistance == 2e5
    assert netlist.load.parameters["resistance"] == 2e5


def test_all_points_share_the_finest_knots(device):
    grid = make_grid(device, ["resistor"], {"oscillator.mass": [0.001, 0.022]})
    alone = device.replace({"oscillator.mass": 0.001})
    ready = prepared(alone)
    assert knot_spacing(ready) < knot_spacing(prepared(device))
    assert {knot_spacing(prepared(p.scene)) for p in grid.points} == {knot_spacing(ready)}


def test_storage_charges_while_the_run_settles(device):
    grid = make_grid(device, ["bridge"], {RESISTANCE: [1e3, 1e7]})
    quick, slow = (p.scene.load.parameters for p in grid.points)
    assert "storage" not in quick
    assert slow["storage"] * 1e7 == pytest.approx(device.run.settle / 5.0)
    assert "storage" in grid.notes[0]
    own = make_grid(device, ["bridge"], {RESISTANCE: [1e7], "load.parameters.storage": [1e-5]})
    assert own.points[0].scene.load.parameters["storage"] == 1e-5
    assert own.notes == ()


@pytest.mark.parametrize(
    ("loads", "sweeps", "said"),
    [
        (["bridge"], {"excitation.intensty": [1.0]}, "did you mean excitation.intensity"),
        (["bridge"], {"run.duration": [1.0]}, "not a number of this scene"),
        (["bridge"], {"storage": [1e-6]}, "did you mean load.parameters.storage"),
        (
            ["resistor", "bridge", "doubler"],
            {"load.parameters.storage": [1e-6]},
            r"bridge, doubler have this parameter, but not resistor \(it has resistance\): give",
        ),
        (["resistor", "bridge"], {"load.parameters.x": [1.0]}, "resistor.lib has no such"),
        (["bridge"], {RESISTANCE: [-5.0]}, "resistance, -5 Ω, must be above 0"),
        (["bridge"], {"load.parameters.resistence": [1.0]}, "did you mean resistance"),
        (["bridg"], {}, "did you mean bridge"),
        (["bridge", "bridge"], {}, "occurs twice"),
        (["bridge"], {RESISTANCE: [1.0, 1.0]}, "none twice"),
    ],
)
def test_mistakes_are_refused_before_anything_runs(device, loads, sweeps, said):
    with pytest.raises(HarvesterError, match=said):
        make_grid(device, loads, sweeps)


def test_points_of_a_smooth_record_keep_its_knots(device, tmp_path):
    """Its knots are the record's own, the same at all points."""
    samples = np.random.default_rng(1).standard_normal(4000)
    rows = "\n".join(f"{k * 0.002:.6g},{value:.6g}" for k, value in enumerate(samples))
    (tmp_path / "shaker.csv").write_text(f"time [s],acceleration [m/s^2]\n{rows}\n")
    record = {"kind": "record", "file": str(tmp_path / "shaker.csv"), "interpolation": "smooth"}
    run = {"run.duration": 4.0, "run.settle": 1.0}
    scene = device.replace({"excitation": record, **run})
    grid = make_grid(scene, [], {"load.resistance": [1e4, 1e6]})
    assert [point.scene.load.resistance for point in grid.points] == [1e4, 1e6]
    assert all(point.scene.excitation == scene.excitation for point in grid.points)


def test_an_unknown_key_names_only_parameters_that_the_load_has(device, tmp_path):
    path = tmp_path / "mine.lib"
    path.write_text(".subckt mine p n rload=1k\nR1 p n {rload}\n.ends\n")
    with pytest.raises(HarvesterError, match=r"load\.parameters\.rload") as caught:
        make_grid(device, [str(path)], {"rload": [1e3]})
    assert "load.parameters.resistance" not in str(caught.value)


def test_the_scene_of_a_grid_keeps_its_own_values(device):
    grid = make_grid(device, ["bridge"], {RESISTANCE: [1e5, 1e6], "oscillator.mass": [0.01, 0.02]})
    assert grid.scene.load == device.load
    assert grid.scene.oscillator == device.oscillator
    knots = {knot_spacing(prepared(p.scene)) for p in grid.points}
    assert knots == {knot_spacing(prepared(grid.scene))}
