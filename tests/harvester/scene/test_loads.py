"""[load] with a netlist: keys, overrides, places, round trip."""

import pickle

import numpy as np
import pytest
from truths import flat

import harvester
from harvester.base.errors import NetlistError, SceneError
from harvester.cli.command_line import main
from harvester.scene.model import Scene
from harvester.scene.source import BUILT_IN

RESISTOR = ".subckt mine p n resistance=1k\nR1 p n {resistance}\n.ends\n"


def test_overrides_reach_the_loads_parameters():
    scene = Scene.read(
        "device", ["load.netlist=resistor", "load.parameters.resistance=1e5", "run.seed=3"]
    )
    assert scene.load.parameters == {"resistance": 1e5}
    p = flat(scene)
    assert p.decay_rate == pytest.approx(1.0 / (1e5 * 4.3e-8))
    changed = scene.replace({"load.parameters.resistance": "2Meg"})
    assert changed.load.circuit.resistance == 2e6
    assert changed.digest() != scene.digest()
    assert changed.replace({"load.parameters.resistance": None}).load.parameters == {}
    with pytest.raises(SceneError, match="too many dots"):
        scene.replace({"load.parameters.resistance.deep": 1.0})
    with pytest.raises(SceneError, match="too many dots"):
        scene.replace({"stoppers.gap.deep": 1.0})


def test_the_netlist_and_the_built_in_resistor_take_each_others_place():
    built_in = Scene.read("device")
    netlist = built_in.replace({"load.netlist": "resistor"})
    assert netlist.load.resistance is None
    assert netlist.load.kind is None
    back = netlist.replace({"load.resistance": 306e3})
    assert back == built_in
    assert back.digest() == built_in.digest()


def test_a_scene_with_a_netlist_survives_tables_and_processes():
    scene = Scene.read("paper", ["load.netlist=resistor", "load.parameters.resistance=20"])
    assert "circuit" not in scene.to_tables()["load"]
    again = Scene.from_tables(scene.to_tables(), name="paper")
    assert again == scene
    assert pickle.loads(pickle.dumps(scene)) == scene
    assert flat(scene).decay_rate == pytest.approx(0.05)


def test_a_file_is_found_beside_the_scene_and_then_here(tmp_path, monkeypatch):
    folder = tmp_path / "study"
    folder.mkdir()
    tables = (BUILT_IN / "device.toml").read_text()
    tables = tables.replace('kind = "resistor"', 'netlist = "mine.lib"')
    tables = tables.replace("resistance = 306e3", "parameters = { resistance = 5e4 } #")
    (folder / "scene.toml").write_text(tables)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(NetlistError, match=r"mine\.lib.*study and "):
        Scene.read("study/scene.toml")
    (tmp_path / "mine.lib").write_text(RESISTOR)
    assert Scene.read("study/scene.toml").load.circuit.resistance == 5e4
    (folder / "mine.lib").write_text(RESISTOR.replace("R1 p n", "R1 n x 1k\nR2 p x"))
    scene = Scene.read("study/scene.toml")
    assert scene.load.circuit.resistance is None
    monkeypatch.chdir(folder.parent.parent)
    assert scene.replace({"run.seed": 5}).load == scene.load
    harvester.save(scene, tmp_path / "copy.toml")
    copy = Scene.read(tmp_path / "copy.toml").load
    assert copy.circuit.source == scene.load.circuit.source


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["load.netlist=resistr"], ["resistr", "did you mean resistor"]),
        (["load.netlist=missing/load.lib"], ["missing/load.lib", "no such file"]),
        (["load.netlist=resistor", "load.subcircuit=resisto"], ["did you mean resistor"]),
        (
            ["load.netlist=resistor", "load.parameters.resistence=1"],
            ["resistence", "did you mean resistance"],
        ),
        (["load.netlist=resistor", "load.parameters.resistance=abc"], ["'abc'", "finite number"]),
        (["load.netlist=resistor", "load.parameters.resistance=nan"], ["finite number"]),
        (["load.netlist=resistor", "load.parameters.resistance=true"], ["load.parameters"]),
        (["load.netlist=resistor", "load.parameters=3"], ["load.parameters", "table"]),
        (["load.netlist=resistor", "load.netlst=3"], ["load.netlst", "did you mean netlist"]),
        (["load.netlist=3"], ["load.netlist", "text"]),
        (
            ["load.netlist=resistor", "load.kind=resistor"],
            ["load.kind needs load.resistance, and there is load.netlist"],
        ),
        (
            ["load.parameters.resistance=1"],
            ["load.parameters needs load.netlist", "--sweep load.parameters.NAME"],
        ),
    ],
)
def test_a_mistake_about_the_load_is_refused_in_one_line(overrides, words):
    with pytest.raises((SceneError, NetlistError)) as caught:
        Scene.read("device", overrides)
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_the_command_line_refuses_a_netlist_that_is_a_program(tmp_path, capsys):
    path = tmp_path / "load.lib"
    path.write_text(f".control\nshell touch {tmp_path}/owned\n.endc\n" + RESISTOR)
    assert main(["simulate", "device", "--set", f"load.netlist={path}"]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert ".control" in message
    assert not (tmp_path / "owned").exists()


def test_a_scene_keeps_the_text_of_its_netlist(tmp_path):
    text = ".subckt mine p n r=1k\n.include part.inc\n.ends\n"
    (tmp_path / "mine.lib").write_text(text)
    (tmp_path / "part.inc").write_text("R1 p n {r}\n")
    load = {"netlist": str(tmp_path / "mine.lib"), "parameters": {"r": "2k"}}
    scene = Scene.read("device").replace(load=load)
    (tmp_path / "part.inc").write_text("R1 p n {2*r}\n")
    (tmp_path / "mine.lib").unlink()
    assert scene.replace({"run.seed": 7}).load.circuit.resistance == 2e3
    assert scene.replace({"load.parameters.r": 3e3}).load.circuit.resistance == 3e3
    assert pickle.loads(pickle.dumps(scene)).replace({"run.seed": 8}).load.circuit.resistance == 2e3
    with pytest.raises(NetlistError, match="no such file"):
        Scene.from_dict(scene.to_dict())


def test_replace_reads_no_record_and_other_samples_of_a_changed_one_are_refused(tmp_path):
    times = np.arange(400) / 100.0
    np.save(tmp_path / "a.npy", np.sin(9.0 * times))
    record = {"kind": "record", "file": str(tmp_path / "a.npy"), "unit": "m/s^2"}
    table = {**record, "sampling_rate": 100.0}
    scene = Scene.read("device").replace({"excitation": table, "run": {"duration": 1.0}})
    samples = scene.excitation.samples
    np.save(tmp_path / "a.npy", np.sin(8.0 * times))
    copy = scene.replace({"run.seed": 7})
    assert copy.excitation == scene.excitation
    assert np.array_equal(copy.excitation.samples, samples)
    with pytest.raises(SceneError, match="record has changed since the scene was read"):
        scene.replace({"excitation.fade_in": 0.1})
    with pytest.raises(SceneError, match="a value or a file of the scene has changed"):
        Scene.from_dict(scene.to_dict())
    again = scene.replace({"excitation.file": str(tmp_path / "a.npy")})
    assert again.digest() != scene.digest()
    (tmp_path / "a.npy").unlink()
    assert scene.replace({"run.seed": 8}).excitation == scene.excitation
    assert "sha256" not in scene.to_tables()["excitation"]
