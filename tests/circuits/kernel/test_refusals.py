"""What the compiled engine does not take is refused with file, line and reason."""

import pytest

from circuits.kernel import engine
from circuits.kernel.assembly import build
from harvester.base.errors import LoadError, NetlistError, SimulatorAborted
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path, start_state
from harvester.scene.prepared import prepared

AROUND = "* a load\n.subckt load p n out ref\nR1 out ref 100k\n{}\n.ends\n"


def with_load(tmp_path, text, *overrides):
    path = tmp_path / "mine.lib"
    path.write_text(AROUND.format(text))
    return Scene.read("device", [f"load.netlist={path}", "run.realizations=1", *overrides])


@pytest.mark.parametrize(
    ("text", "line", "reason"),
    [
        ("M1 p out n n nm\n.model nm nmos(vto=1)", 4, "letter M"),
        ("Q1 p out n tr\n.model tr npn(bf=100)", 4, "letter Q"),
        ("D1 p out dm\n.model dm d(is=1n jtun=1n)", 4, "jtun="),
        ("D1 p out dm pj=1u\n.model dm d(is=1n cjsw=1p)", 4, "cjsw="),
        ("B1 p out i=ddt(v(p))", 4, "ddt"),
    ],
)
def test_with_file_line_and_reason(tmp_path, text, line, reason):
    scene = with_load(tmp_path, text)
    with pytest.raises(LoadError, match=rf"mine\.lib:{line}: .*{reason}.*circuit engine"):
        build(prepared(scene))


@pytest.mark.parametrize(
    ("text", "line", "reason"),
    [
        ("L1 p out 0", 4, "inductance 0"),
        ("Rx p out 1k\nB1 p n i=i(rx)", 5, r"i\(rx\) is no current in the load"),
        ("R2 p out {1k+5%0}", 4, "% is undefined: division by 0"),
        ("V1 p x am(1 2 3 4)\nR2 x out 1k", 4, "am differs between ngspice 39 and 46"),
        ("D1 p out dm\n.model dm d(is=1n vz=5)", 5, "a model d has no vz[^;]*; remove it"),
        ("S1 p out p n sm\n.model sm sw(ron=0)", 4, "write 1m"),
    ],
)
def test_what_no_engine_takes_is_refused_where_the_load_is_read(tmp_path, text, line, reason):
    with pytest.raises(NetlistError, match=rf"mine\.lib:{line}: .*{reason}"):
        with_load(tmp_path, text)


def test_before_anything_runs(tmp_path):
    with pytest.raises(LoadError, match="letter J"):
        simulate(with_load(tmp_path, "J1 p out n jm\n.model jm njf()"), method="monte-carlo")


@pytest.mark.slow
def test_a_run_that_gets_nowhere_is_given_up(tmp_path, monkeypatch):
    """A buffer below 0 behind diodes: its voltage grows without an end, in ever shorter steps."""
    monkeypatch.setattr(engine, "PATIENCE", 0.5)
    diodes = "D1 p rail d\nD2 ref p d\nD3 n rail d\nD4 ref n d\n.model d d(is=41n n=1.09 rs=1)"
    text = f"{diodes}\nCbuffer rail ref -1u\nCstray ref n 10p\nR2 rail out 1meg"
    scene = with_load(tmp_path, text)
    ready = prepared(scene)
    start = start_state(ready, 0)
    s = ready.system
    with pytest.raises(SimulatorAborted, match=r"it stalls.*value below 0.*cbuffer"):
        for _ in engine.integrate(
            s, engine.circuit_of(prepared(scene)), noise_path(ready, 0), start, 1e3
        ):
            pass


def test_parameters_have_ngspices_precedence(tmp_path):
    """A value given where a sub-circuit is called, its own .param, its default, the file's."""
    path = tmp_path / "mine.lib"
    path.write_text(
        ".param a=1 d=4\n"
        ".subckt inner x y a=2 b=3\n.param b=30\nR1 x y {1k*a}\nR2 x y {1k*b}\nR3 x y {1k*d}\n"
        ".ends\n"
        ".subckt mine p n c=5\nX1 p n inner\nX2 p n inner a={c*2} b=6\n.ends\n"
    )
    scene = Scene.read("device", [f"load.netlist={path}", "load.parameters.c=7"])
    circuit = build(prepared(scene))
    siemens = dict(zip(map(tuple, circuit.tables.entries), circuit.tables.conductance, strict=True))
    node = circuit.names.index(":load_piezo")
    wanted = sum(1e-3 / value for value in (2, 30, 4, 14, 6, 4))
    assert siemens[node, node] == pytest.approx(wanted, rel=1e-12)
