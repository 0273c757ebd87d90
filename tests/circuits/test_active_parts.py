"""Couplings that no coils have are refused; what may deliver energy is named."""

import re

import pytest

from circuits.loads.subcircuits import read_load
from harvester.errors import NetlistError, SimulatorAborted
from harvester.scene.model import Scene
from harvester.simulation import simulate

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
    with pytest.raises(NetlistError, match=r"load\.lib:9: k2: no coils .* l1, l2, l3 would hold"):
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
    with pytest.raises(NetlistError, match=r"load\.lib:10: x1\.k1: no coils are coupled so"):
        read(tmp_path, text.replace("-0.5", "-0.51"))
    with pytest.raises(NetlistError, match=r"load\.lib:10: x1\.k1: a coupling of -1.5"):
        read(tmp_path, text.replace("-0.5", "-1.5"))


def test_sources_and_values_below_zero(tmp_path):
    text = (
        ".subckt load p n bias=0\nR1 p n 1k\nV1 p a {bias}\nR2 a b {-bias}\nX1 b n cell r=-2k\n"
        "I1 a n dc 0\nC1 a n 1n\nR3 b n {v(p)*1k}\n"
        ".subckt cell a b r=1\nRc a b {r}\nV2 a c sin(0 1 50)\nR4 c b 1k\n.ends\n.ends\n"
    )
    load = read(tmp_path, text)
    assert load.sources == ("v2",)
    assert load.negative_parts == ("x1.rc (load.lib:10)",)
    load = read(tmp_path, text, bias=5.0)
    assert load.sources == ("v1", "v2")
    assert load.negative_parts == ("r2 (load.lib:4)", "x1.rc (load.lib:10)")


@pytest.mark.parametrize("engine", ["circuit", "monte-carlo"])
def test_a_value_below_zero_is_named_where_the_run_ends_early(tmp_path, pool, engine):
    scene = scene_with(tmp_path, "R1 p n -1k")
    with pytest.raises(SimulatorAborted, match=r"below 0 .* without an end: r1 \(load\.lib:2\)"):
        simulate(scene, method=engine, workers=1, runner=pool)


@pytest.mark.parametrize("engine", ["circuit", "monte-carlo"])
def test_a_value_below_zero_is_noted_where_it_does_not(tmp_path, pool, engine):
    scene = scene_with(tmp_path, "R1 p a -1k\nR2 a n 100k")
    result = simulate(scene, method=engine, workers=1, runner=pool)
    (note,) = (note for note in result.notes if "counts as the piezo's" in note)
    assert re.match(r"the load has values below 0 \(r1 \(load\.lib:2\)\): what they", note)


def scene_with(tmp_path, body):
    path = tmp_path / "load.lib"
    path.write_text(f".subckt load p n\n{body}\n.ends\n")
    short = ("run.duration=6", "run.settle=0.1", "run.realizations=1")
    return Scene.load("device", [f"load.netlist={path}", *short])
