"""What is no circuit is refused where a load is read; nodes that lead nowhere are named."""

import pytest

from circuits.netlist.subcircuits import read_load
from harvester.base.errors import NetlistError
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene

COILS = "L1 p n 1\nL2 a n 10m\nL3 b n 2\nR2 a n 1k\nR3 b n 1k\n"


def read(tmp_path, text, **parameters):
    path = tmp_path / "load.lib"
    path.write_text(text)
    return read_load(path, parameters=parameters)


def with_couplings(*sizes):
    ends = ("L1 L2", "L2 L3", "L1 L3")
    cards = [
        f"K{k} {pair} {size}\n" for k, (pair, size) in enumerate(zip(ends, sizes, strict=True))
    ]
    return ".subckt load p n k=0.9\n" + COILS + "".join(cards) + ".ends\n"


@pytest.mark.parametrize(
    "sizes",
    [
        (0.9, 0.9, 0.9),
        (0.9, -0.9, -0.9),
        (1, 1, 1),
        (0.6, 0.8, 0),
        ("{k}", "{k/2}", 0.1),
    ],
)
def test_couplings_that_coils_can_have(tmp_path, sizes):
    """(0.9, 0.9) alone would be none: the third is what makes it one, wherever it stands."""
    assert read(tmp_path, with_couplings(*sizes)).switches


@pytest.mark.parametrize(
    ("sizes", "parameters"),
    [
        ((0.9, 0.9, -0.9), {}),
        ((0.9, 0.9, 0), {}),
        ((1, 1, 0.99), {}),
        (("{k-0.3}", 0.8, 0.01), {"k": 0.95}),
    ],
)
def test_couplings_that_contradict_each_other(tmp_path, sizes, parameters):
    with pytest.raises(
        NetlistError, match=r"load\.lib:9: k2: impossible couplings: .* l1, l2, l3 would store"
    ):
        read(tmp_path, with_couplings(*sizes), **parameters)


def test_coils_beside_them_are_not_blamed(tmp_path):
    other = "L4 c n 1\nL5 d n 1\nK9 L4 L5 0.99\nR4 c n 1\nR5 d n 1\n.ends"
    text = with_couplings(0.9, 0.9, 0).replace(".ends", other)
    with pytest.raises(NetlistError, match=r"load\.lib:9: k2: .* in l1, l2, l3 would"):
        read(tmp_path, text)


def test_one_coupling_of_several_coils(tmp_path):
    """−½ among three coils is the least: their currents together then hold nothing."""
    text = f".subckt load p n\nX1 p n three k={{k}}\n.param k=-0.5\n.subckt three p n k=1\n{COILS}"
    text += "K1 L1 L2 L3 {k}\n.ends\n.ends\n"
    read(tmp_path, text)
    with pytest.raises(NetlistError, match=r"load\.lib:10: x1\.k1: impossible couplings"):
        read(tmp_path, text.replace("-0.5", "-0.51"))
    with pytest.raises(NetlistError, match=r"load\.lib:10: x1\.k1: coupling -1\.5"):
        read(tmp_path, text.replace("-0.5", "-1.5"))


@pytest.mark.parametrize("value", ["0", "{r}", "{1-1}", "1e-9", "-1p", "r=0", "m=2 r=0"])
def test_a_resistor_of_nothing_is_refused_with_what_to_write(tmp_path, value):
    """ngspice loses the current over 1e-12 Ω to rounding: mean-square voltages of any size."""
    text = f".subckt load p n r=0 \nR2 p a 1k\nR1 a n {value}\n.ends\n"
    with pytest.raises(NetlistError, match=r"load\.lib:3: r1: .* Ω: below .*; 1m, 1e-3 ohms"):
        read(tmp_path, text)
    assert read(tmp_path, text.replace(f"a n {value}", "a n 1m")).linear


@pytest.mark.parametrize(
    ("line", "node"),
    [
        ("B1 p n i=v(pp,n)*1u", "pp"),
        ("B1 p n i=v(a)*1u+max(v(p,nn),0)", "nn"),
        ("E1 b n aa n 2\nR3 b n 1k", "aa"),
        ("S1 p n ctl n sm\n.model sm sw(vt=1 vh=0.1)", "ctl"),
        ("G1 p n value={v(bb)*1u}", "bb"),
        ("X1 p n cell\n.subckt cell x y\nR1 x z 1k\nG1 x y zz y 1u\nR2 z y 1k\n.ends", r"x1\.zz"),
    ],
)
def test_a_voltage_where_nothing_is_connected_is_refused(tmp_path, line, node):
    with pytest.raises(NetlistError, match=rf"load\.lib:\d+: \S+: nothing is .* the node {node}"):
        read(tmp_path, f".subckt load p n\nR1 p a 1k\nR2 a n 1k\n{line}\n.ends\n")


def test_a_node_that_leads_nowhere_is_noted(tmp_path, pool):
    """Not where something asks for its voltage, of which a source is all that it needs."""
    text = ".subckt load p n\nR1 p n 100k\nR2 p outt 1k\nE1 x n p n 2\nG1 p n x n 1n\n.ends\n"
    load = read(tmp_path, text)
    assert load.loose_nodes == ("outt of r2 (load.lib:3)",)
    run = ("run.duration=0.1", "run.settle=0", "run.realizations=1")
    scene = Scene.read("device", [f"load.netlist={tmp_path}/load.lib", *run])
    result = simulate(scene, method="monte-carlo", workers=1, runner=pool)
    assert "nothing else is connected to the node outt of r2 (load.lib:3)" in result.notes


def test_a_sub_circuit_of_nothing_is_refused(tmp_path):
    with pytest.raises(NetlistError, match=r"load\.lib:1: .subckt load contains no element"):
        read(tmp_path, ".subckt load p n\n.ends\n")


def test_the_only_sub_circuit_with_a_loads_pins_is_the_load(tmp_path):
    part = ".subckt part a b\nR1 a b 1k\n.ends\n"
    load = part + ".subckt mine p n\nX1 p n part\n.ends\n"
    assert read(tmp_path, load).name == "mine"
    with pytest.raises(NetlistError, match=r"choose one by load\.subcircuit"):
        read(tmp_path, load + ".subckt other n p\nR1 n p 1\n.ends\n")
    with pytest.raises(NetlistError, match=r"choose one by load\.subcircuit"):
        read(tmp_path, part + part.replace("part", "more"))
