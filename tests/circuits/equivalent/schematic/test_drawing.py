import re
import subprocess
import sys
from xml.etree import ElementTree

import pytest

from circuits.equivalent.assembly import assemble
from circuits.equivalent.schematic.drawing import BOX_TITLE_SIZE, schematic
from circuits.equivalent.schematic.symbols import NAME_SIZE
from harvester.base.errors import OutputError
from harvester.cli.command_line import main
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared

SCENES = {
    "linear": ("linear", []),
    "paper": ("paper", []),
    "impact speed held": ("paper_si", ["stoppers.impact_velocity=event"]),
    "resistor": ("device", []),
    "bridge": ("device", ["load.netlist=bridge"]),
    "parallel SSHI": ("device", ["load.netlist=sshi_parallel"]),
    "bridge and buck": ("device", ["load.netlist=bridge_buck"]),
    "prescribed displacement": (
        "device",
        [
            "excitation=none",
            "excitation.kind=prescribed_displacement",
            "excitation.amplitude=0.01",
            "excitation.frequency=12",
            "load.netlist=sece",
        ],
    ),
}


def element_names(netlist):
    """First words of a netlist's element lines."""
    return sorted(re.findall(r"^(?![.*+])\S+", netlist, re.MULTILINE))


def drawn_names(drawing):
    """What stands beside the symbols of a picture, in their size of letters, and box titles."""
    texts = [each for each in ElementTree.fromstring(drawing.image()).iter() if "text" in each.tag]
    words = {size: ["".join(t.itertext()) for t in texts if t.get("font-size") == size]
             for size in (str(NAME_SIZE), str(BOX_TITLE_SIZE))}  # fmt: skip
    boxes = [title.split(":")[0] for title in words[str(BOX_TITLE_SIZE)] if ":" in title]
    return sorted([*words[str(NAME_SIZE)], *boxes])


@pytest.mark.parametrize("case", SCENES)
def test_the_drawing_holds_the_netlists_elements_and_no_others(case):
    scene = Scene.read(*SCENES[case])
    expected = element_names(assemble(prepared(scene), named=True).text)
    drawing = schematic(scene)
    assert sorted(drawing.names) == expected
    assert drawn_names(drawing) == expected


def test_what_the_scene_leaves_out_is_not_drawn():
    linear = set(schematic(Scene.read("linear")).names)
    paper = set(schematic(Scene.read("paper")).names)
    assert paper - linear == {"Bcubic", "Bstoppers"}
    assert "Gback_action" not in schematic(Scene.read("paper", ["piezo.coupling=0"])).names


def test_coupled_coils_and_transistors_of_a_users_load_are_drawn(tmp_path):
    (tmp_path / "pump.lib").write_text(
        ".subckt pump p n out ref\nL1 p a 1m\nL2 b n 1m\nK1 L1 L2 0.9\nQ1 a b out tr\n"
        "R1 out ref 1k\nR2 ref n 1k\n.model tr npn()\n.ends\n"
    )
    scene = Scene.read("device", [f"load.netlist={tmp_path}/pump.lib"])
    assert sorted(schematic(scene).names) == element_names(
        assemble(prepared(scene), named=True).text
    )
    assert b"k1: l1, l2" in schematic(scene).image()


def test_files(tmp_path, capsys):
    assert main(["schematic", "linear", "--output", str(tmp_path)]) == 0
    ElementTree.parse(tmp_path / "linear-schematic.svg")
    assert main(["schematic", "linear", "--output", str(tmp_path / "a.png")]) == 0
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    capsys.readouterr()
    assert main(["schematic", "linear"]) == 0
    assert ElementTree.fromstring(capsys.readouterr().out).tag.endswith("svg")
    with pytest.raises(OutputError, match=r"\.svg or \.png"):
        schematic(Scene.read("linear")).save(tmp_path / "a.jpg")


def test_without_schemdraw_it_says_what_to_install():
    code = (
        "import sys\nsys.modules['schemdraw'] = None\n"
        "from harvester.cli.command_line import main\nsys.exit(main(['schematic', 'linear']))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 2
    assert "pip install 'vibration-harvester[schematic]'" in done.stderr
