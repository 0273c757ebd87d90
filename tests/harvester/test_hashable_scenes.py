"""A scene can be compared, hashed, pickled and written as tables, with every part it may have."""

import copy
import json
import pickle

import numpy as np
import pytest

from harvester.device.keys import NamedValues
from harvester.scene.model import Scene

ONE = '{{side = "{}", gap = {}, stiffness = 10.0, restitution = 0.7}}'
VARIED = [
    *((name, []) for name in Scene.names()),
    ("device", ["load.netlist=bridge", 'load.parameters.resistance="100k"']),
    ("duffing", [f"stoppers=[{ONE.format('left', 1.0)}, {ONE.format('right', 1.2)}]"]),
    ("duffing", [f"stoppers=[{ONE.format('both', 1.0)}]"]),
    ("device", ["piezo.leakage_resistance=1e6", "start.velocity=0.1"]),
    ("device", ['excitation={kind="sum", parts=[{kind="white", intensity=0.1}]}']),
]


@pytest.mark.parametrize(("name", "overrides"), VARIED)
def test_a_scene_survives_its_tables_and_is_one_key(name, overrides):
    scene = Scene.read(name, overrides)
    again = Scene.from_tables(scene.to_tables(), name=scene.name, folder=scene.folder)
    for same in (again, pickle.loads(pickle.dumps(scene)), copy.deepcopy(scene)):
        assert same == scene
        assert hash(same) == hash(scene)
        assert same.digest() == scene.digest()
    assert again.to_dict() == scene.to_dict()
    json.dumps(scene.to_dict())
    assert {scene: 1, scene.replace({"run.seed": 7}): 2}[again] == 1


def test_a_scene_with_a_record_is_one_key(tmp_path):
    np.savetxt(tmp_path / "motion.csv", np.random.default_rng(1).normal(size=(100, 1)))
    record = f'excitation={{kind="record", file="{tmp_path}/motion.csv", unit="m/s^2", '
    overrides = [record + 'sampling_rate=100.0, repetition="periodic", band=[1.0, 20.0]}']
    scene, same = (Scene.read("device", overrides) for _ in range(2))
    assert scene == same
    assert hash(scene) == hash(same)


def test_a_loads_values_cannot_be_changed():
    values = Scene.read("device", ["load.netlist=bridge", "load.parameters.resistance=1e5"])
    values = values.load.parameters
    assert values == {"resistance": 1e5} == NamedValues(resistance=1e5)
    for change in (values.clear, lambda: values.update(a=1.0), lambda: values.pop("resistance")):
        with pytest.raises(TypeError, match="fixed"):
            change()


def test_a_part_that_a_scene_lacks_has_no_key():
    assert set(Scene.read("linear").to_dict()) == {
        *("name", "sha256", "units", "oscillator", "piezo", "load", "excitation", "run")
    }
    assert set(Scene.read("linear").to_dict()["oscillator"]) == {
        *("damping", "linear_stiffness", "cubic_stiffness")
    }
    assert "piezo" not in Scene.read("electromagnetic").to_dict()
    assert "leakage_resistance" not in Scene.read("device").to_dict()["piezo"]
