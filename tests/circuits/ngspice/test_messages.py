"""What ngspice says is read by its form, and told with the element and the file it means."""

import pytest

from circuits.netlist.subcircuits import read_load
from circuits.ngspice import messages
from circuits.ngspice.messages import with_places
from harvester.base.errors import SimulationError
from harvester.base.worker_process import Worker
from harvester.engines.methods import Circuit
from harvester.engines.realization import run as realization_run
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.source import BUILT_IN

BODY = """.subckt load p n out ref
Rin p out 1k
Rback n ref 1k
Rload out ref 100k
{body}
.ends
"""
RUN = {"engine": Circuit(), "indices": [0]}
SHORT = ["run.duration=0.2", "run.settle=0", "run.realizations=1"]


@pytest.fixture(scope="module")
def run():
    """Run a scene's first realization, in a process that outlives a failed one."""
    one = Worker()
    yield lambda scene: one.call(
        realization_run, {"prepared_scene": prepared(scene), "window": None, **RUN}
    )
    one.close()


def loaded(tmp_path, body, name="load", inner=""):
    (tmp_path / f"{name}.lib").write_text(inner + BODY.format(body=body))
    settings = ["load.resistance=none", f"load.netlist={tmp_path / name}.lib"]
    return Scene.read("device", [*settings, "load.subcircuit=load", *SHORT])


@pytest.mark.parametrize("name", ["error_bars", "fatal", "no such, cannot be aborted", "error: x"])
def test_a_scenes_name_is_no_trouble(run, tmp_path, name):
    file = tmp_path / f"{name}.toml"
    file.write_text((BUILT_IN / "paper.toml").read_text())
    scene = Scene.read(str(file), ["run.duration=50", "run.realizations=1"])
    assert run(scene)[0].seconds > 0.0


def test_names_in_a_load_are_no_trouble(run, tmp_path):
    body = (
        "Rerror p fatal 1k\nDfailed fatal error unknown\n.model unknown d(is=1n)\n"
        "Rnotfound error n 1\nBcannot p n i=0*v(fatal)\nXabort p n singular\n"
        ".subckt singular error fatal\nRerror error fatal 1meg\n.ends"
    )
    assert run(loaded(tmp_path, body, "error"))[0].seconds > 0.0


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("B9 p n i=ln(-1+0*v(p))", r"b9 \(load\.lib:5\): -1 out of range for ln"),
    ],
)
def test_a_refusal_names_the_element_and_its_place(run, tmp_path, body, expected):
    with pytest.raises(SimulationError, match=expected):
        run(loaded(tmp_path, body))


def test_an_element_of_a_called_sub_circuit_is_found_in_its_own_file(run, tmp_path):
    (tmp_path / "parts.lib").write_text(
        ".subckt part a b\nR8 a b 1k\nB9 a b i=ln(-1+0*v(a))\n.ends\n"
    )
    scene = loaded(tmp_path, "Xone p n part", inner=".include parts.lib\n")
    with pytest.raises(SimulationError, match=r"b9 \(parts\.lib:3\): -1 out of range"):
        run(scene)


@pytest.mark.parametrize("hysteresis", ["", "vh=1"])
def test_a_switch_that_undoes_what_turned_it_wants_a_hysteresis(run, tmp_path, hysteresis):
    """At its threshold the terminal is shorted; with hysteresis that lasts down to 4 V."""
    body = f"S1 p n p n shorts\n.model shorts sw(vt=5 {hysteresis} ron=1 roff=100meg)"
    scene = loaded(tmp_path, body).replace({"run.duration": 1.0})
    if hysteresis:
        assert run(scene)[0].seconds > 0.0
    else:
        with pytest.raises(SimulationError, match=r"s1 \(load\.lib:5\); .*give it a hysteresis"):
            run(scene)


@pytest.mark.parametrize(
    "line",
    [
        "Circuit: harvester scene error",
        "Note: the error bars are fine",
        "r.xload.rerror p n 1k",
        ".model fatal d(error=1)",
        "Warning: Value of resistor r.xload.rfatal is too small, set to 1e-12",
    ],
)
def test_a_line_that_only_mentions_trouble_is_none(line):
    assert messages.refusal([line]) == ""


def test_a_reason_that_repeats_a_whole_expression_is_cut():
    said = messages.refusal(["Error: cannot read", "Error: no such " + "- " * 9000])
    assert said.startswith("cannot read; no such - -")
    assert len(said) < 300


def test_a_refusal_never_ends_in_a_bare_error_on_line():
    said = messages.refusal(["Error on line 3 or its substitute:", "  r.xload.r1 a b", "bad value"])
    assert said == "r.xload.r1: bad value"
    assert messages.refusal(["Error on line:"]) == "it gave no reason"


def test_places_follow_calls_and_copies(tmp_path):
    file = tmp_path / "load.lib"
    file.write_text(BODY.format(body="Xa p n inner\n.subckt inner a b\nXb a b deep\n.ends") + DEEP)
    load = read_load(file, "load")
    assert load.file == "load.lib"
    said = with_places("check node l.xcopy1.xload.l.xa.l.xb.l1#branch", load)
    assert said == "check node l1 (load.lib:11)"
    assert with_places("node xload.xa.middle", load).startswith("node middle of the load")


DEEP = ".subckt deep a b\nL1 a b 1m\n.ends\n"
