"""The recipe for a load in CONTRIBUTING: one file, and no change in Python."""

import shutil
from importlib import resources

import pytest

import harvester
from harvester.base.errors import NetlistError
from harvester.scene.source import BUILT_IN

pytestmark = pytest.mark.usefixtures("shared_workers")

# Two resistors in series, together other than the scene's own: ignored, they would be noticed.
TOY = """* lead of 1 kohm, then a resistor
.subckt toy p n resistance=100k
Rlead p middle 1k
Rload middle n {resistance-1k}
.ends
"""


@pytest.fixture
def folder(tmp_path):
    """A scene with a netlist as its load, and nothing else."""
    text = (BUILT_IN / "device.toml").read_text(encoding="utf-8")
    resistor = 'kind = "resistor"\nresistance = 306e3'
    assert resistor in text
    (tmp_path / "mine.toml").write_text(text.replace(resistor, 'netlist = "toy.lib" #'))
    return tmp_path


@pytest.mark.slow
def test_one_file_beside_the_scene_is_a_load(folder):
    (folder / "toy.lib").write_text(TOY)
    short = {"run.duration": 2.0, "run.settle": 0.5, "run.realizations": 2}
    toy = harvester.simulate(harvester.Scene.read(folder / "mine.toml").replace(short), workers=1)
    resistor = harvester.Scene.read("device").replace({**short, "load.resistance": 100e3})
    built_in = harvester.simulate(resistor, workers=1)
    for name in ("mean_square_voltage", "mean_power"):
        # The same resistance on the same noise, in another netlist.
        assert toy.quantity(name).estimate == pytest.approx(
            built_in.quantity(name).estimate, rel=1e-6
        )


def test_one_file_in_netlists_is_a_load_by_its_name(tmp_path, monkeypatch):
    shutil.copytree(resources.files("netlists"), tmp_path, dirs_exist_ok=True)
    (tmp_path / "toy.lib").write_text(TOY)
    monkeypatch.setattr("circuits.netlist.subcircuits.resources.files", lambda package: tmp_path)
    scene = harvester.Scene.read("device", ["load.netlist=toy", "load.parameters.resistance=50k"])
    assert scene.load.parameters == {"resistance": "50k"}
    with pytest.raises(NetlistError, match="did you mean toy"):
        harvester.Scene.read("device", ["load.netlist=toyy"])
