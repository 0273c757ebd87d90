import json
import subprocess

import pytest
from raw_files import ngspice_program

from circuits.equivalent.export import for_ltspice, stand_alone
from circuits.equivalent.schematic.drawing import schematic
from harvester.averaging.of_scene import average
from harvester.base.plain_text import json_text, name, one_line
from harvester.cli.command_line import main
from harvester.results import figures
from harvester.results.drawing import draw_result
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path
from harvester.scene.prepared import prepared
from harvester.scene.source import BUILT_IN
from harvester.studies.grid import make_grid

LINEAR = (BUILT_IN / "linear.toml").read_text()
HOSTILE = [
    "a\n.control\nshell touch OWNED\n.endc\n",
    "b\n*# shell touch OWNED\n",
    "c\r\nRevil piezo 0 1\r\n",
    "\x1b[31mred\x07",
    "[bold]x[/bold]".replace("/", "∕"),
    "$\\frac{a$",
    "\udcff\udcfe:smile: é 日",
    "{nope}'q\"`id`;$(id)",
    "\u202egnp\u2028z\x85\x9b",
    "..",
    "=cmd",
    "x" * 240,
]


@pytest.mark.parametrize("hostile", HOSTILE)
def test_a_hostile_name_is_a_line_without_a_meaning(hostile):
    plain = name(hostile)
    assert plain.isprintable()
    assert plain == name(plain) != ""
    assert not set(plain) & set("$\\{}\"'`<>|*?:;/!^")
    assert plain[0] not in "-+=@."
    assert len(plain.encode()) <= 150
    assert one_line(hostile).isprintable()
    text = json_text({hostile: [hostile]})
    assert text.isprintable()
    assert json.loads(text) == {hostile: [hostile]}


def test_ordinary_names_stay():
    for each in ("paper", "a b-c_1.5", "Gerät (2) [neu]", "日本", "50%, R=1k"):
        assert name(each) == one_line(each) == each


@pytest.mark.parametrize("hostile", HOSTILE[:3])
def test_a_scene_name_adds_nothing_to_netlists(tmp_path, hostile):
    scene = Scene.read("linear", ["run.duration=0.1", "run.settle=0"])
    other = Scene.from_tables(scene.to_tables(), name=hostile)
    path = [noise_path(prepared(scene), 0) for _ in range(4)]
    plain, evil = (
        stand_alone(prepared(scene), path[0]).text,
        stand_alone(prepared(other), path[1]).text,
    )
    assert evil.split("\n")[2:] == plain.split("\n")[2:]
    (tmp_path / "a.cir").write_text(evil + ".end\n")
    subprocess.run([ngspice_program(), "-b", "a.cir"], cwd=tmp_path, capture_output=True)
    assert not (tmp_path / "OWNED").exists()
    plain, evil = (
        for_ltspice(prepared(s), p, "n.txt")[0] for s, p in ((scene, path[2]), (other, path[3]))
    )
    assert evil.split("\n")[1:] == plain.split("\n")[1:]


def test_the_call_that_a_netlist_names_is_quoted():
    scene = Scene.read("linear", ["run.duration=0.1", "run.settle=0"])
    scene = Scene.from_tables(scene.to_tables(), name="two words & more")
    text = stand_alone(prepared(scene), noise_path(prepared(scene), 0)).text
    assert "-r 'two words & more.raw' 'two words & more.cir'\n" in text


@pytest.mark.slow
def test_names_reach_terminal_files_and_figures_as_they_are(tmp_path, capsys, recwarn):
    for place, hostile in enumerate(HOSTILE[3:8]):
        file = tmp_path / f"{hostile}.toml"
        file.write_text(LINEAR)
        folder = tmp_path / str(place)
        call = ["average", str(file), "--method", "paper", "--output", str(folder)]
        assert main(call) == 0
        assert len(list(folder.iterdir())) == 5
    streams = capsys.readouterr()
    assert (streams.out + streams.err).replace("\n", "").isprintable()
    assert "[bold]x" in streams.out
    assert not recwarn.list


def test_what_is_wrong_with_a_hostile_name_is_printable(capsys):
    assert main(["average", "no\x1b[31m\nscene\udcff"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("harvester: 'no\\x1b[31m\\nscene\\udcff': no such scene")
    assert main(["average", "linear", "--no\x1b[31m"]) == 2
    assert "\x1b" not in capsys.readouterr().err


def test_schematics_and_studies_take_names(tmp_path):
    scene = Scene.read("linear")
    scene = Scene.from_tables(scene.to_tables(), name="$\\frac{a$<b>")
    assert b"\\frac" not in schematic(scene).image()
    load = tmp_path / "$\\frac{a$\n.lib"
    load.write_text(".subckt r p n\nR1 p n 1k\n.ends\n")
    (label,) = make_grid(scene, [str(load)], {}).loads
    assert label == "__frac_a__"


def test_figures_believe_no_matplotlibrc(tmp_path, monkeypatch):
    result = average(Scene.read("linear"), method="paper")
    plain = figures.image(figures.drawn(draw_result, result), "png")
    import matplotlib

    with matplotlib.rc_context({"font.size": 40, "text.usetex": True}):
        assert figures.image(figures.drawn(draw_result, result), "png") == plain
        assert schematic(result.scene).image(".png")
