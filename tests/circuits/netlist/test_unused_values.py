"""Every key and value of a load has its effect, or is refused with file and line."""

import numpy as np
import pytest

from circuits.netlist.expression import Names, parse, resolved
from circuits.netlist.functions import CODES, value
from circuits.netlist.subcircuits import read_load
from harvester.base.errors import NetlistError
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene


def load(folder, body, head=""):
    path = folder / "load.lib"
    path.write_text(f"{head}.subckt load p n\n{body}\n.ends\n")
    return path


@pytest.mark.parametrize(
    "said",
    [
        "tc=0.01 0.02",
        "tc=0.01, 0.02",
        "tc=0.01,0.02",
        "tc={0.005*2} {0.02}",
        "tc1=0.01 tc2=0.02",
    ],
)
@pytest.mark.parametrize("letter", "rcl")
def test_both_coefficients_of_temperature_count(tmp_path, letter, said):
    parts = f"{letter}1 p n 8 {said} temp=77"
    (part,) = read_load(load(tmp_path, parts)).elements
    # At 50 K above the reference: 1 + 0.01 · 50 + 0.02 · 50².
    assert part.value == pytest.approx(8.0 * 51.5)


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ("S1 p n p n sm m=4\n.model sm sw(vt=1)", "S has no parameter 'm=4'"),
        ("S1 p n p n sm area=2\n.model sm sw(vt=1)", "S has no parameter 'area=2'"),
        ("S1 p n p n sm 2\n.model sm sw(vt=1)", "'2' after the model has no effect"),
        ("V1 p a 0\nR1 a n 1k\nW1 p n V1 wm m=2\n.model wm csw(it=1)", "W has no parameter 'm=2'"),
        ("R1 p n 1k area=2", "R has no parameter 'area=2'"),
        ("R1 p n 1k ic=2", "R has no parameter 'ic=2'"),
        ("C1 p n 1n tce=2", "C has no parameter 'tce=2'"),
        ("D1 p n dm ad=2\n.model dm d", "D has no parameter 'ad=2'"),
        ("Q1 p n n qm tc1=2\n.model qm npn", "Q has no parameter 'tc1=2'"),
        ("L1 p n 500 m=2\nL2 a n 50\nK1 L1 L2 0.5\nR2 a n 8k", "k1: m= of the coupled coil l1"),
        ("R1 p n 80k\nV2 p p 1", "v2: it closes a loop of voltage sources"),
        ("V1 a n 1\nV2 a 0 2\nR1 p a 1k", "v2: it closes a loop"),
        ("V1 a b 1\nE1 b c p n 2\nB1 a c v=time\nR1 p a 1k\nR2 c n 1k", "b1: it closes a loop"),
        ("E1 p p a n 2\nR1 a n 1k\nR2 p a 1k", "e1: it closes a loop"),
        ("R1 p n 1e300", "r1: 1e+300: must be at most 1e+30"),
        ("B1 p n i=pwl(v(p),1,0,0,1)", "b1: pwl at 1, 0: write its points in ascending order"),
        ("B1 p n i=pwl(v(p),v(n),0,1,1)", "b1: a point of pwl changes during the run"),
        ("R1 p n 80k 5", "r1: two values, 80k and 5: keep one"),
        ("C1 p n 1e20 ic=1e20", "c1: 5e+59 J: above 1e+09 J rounding hides"),
        ("C1 p n 1n ic=1e200", "c1: ic=1e+200: must be at most"),
        ("R1 p n {f(1,2)}\n.func f(a,a) {a+1}", "the arguments a, a of f must differ"),
        ("D1 p n dm\n.model dm ako:dx d(is=1n)", "ako: write out the parameters"),
    ],
)  # fmt: skip
def test_what_has_no_effect_or_no_sense_is_refused_in_its_line(tmp_path, body, fault):
    with pytest.raises(NetlistError, match=r"load\.lib:\d") as refusal:
        read_load(load(tmp_path, body))
    assert fault in str(refusal.value)


def test_what_may_depend_on_the_current_of_its_loop_is_no_contradiction(tmp_path):
    """A source by its own current is a resistor: i = v/r."""
    body = "Vs a n 1\nH1 a b Vs 1k\nB2 b n v=0\nB3 a n v=1k*i(Vs)\nR1 p a 1k"
    assert len(read_load(load(tmp_path, body)).elements) == 5


def test_facts_in_quotes_are_facts(tmp_path):
    body = 'C1 p n 1n V=25 mfg="KEMET" pn="C08 K8"\n.model dm d(is=1n mfg="Vishay")\nD1 p n dm'
    assert [each.letter for each in read_load(load(tmp_path, body)).elements] == ["c", "d"]


def test_exp_of_a_constant_is_exp_and_of_a_source_ngspices():
    names = Names(parameters_only=True)
    for x in (59.0, 61.0, 80.0, 300.0):
        assert resolved(parse(f"exp({x})"), names)[1] == pytest.approx(np.exp(x), rel=1e-12)
    assert value(CODES["exp"], 80.0, 0.0) == pytest.approx(np.exp(80.0), rel=1e-12)
    # ngspice 39 and 46 both print this for v=exp(229).
    assert value(CODES["exp"], 229.0, 0.0) == 1e99


def test_a_source_with_a_large_exponent_is_ngspices(tmp_path):
    """A resistor of 80 kΩ whose conductance is written with exp(80)."""
    powers = {}
    for name, current in {
        "exp": "v(p,n)*exp(80+0*v(p,n))*1e-30/4.43e9",
        "plain": "v(p,n)/80k",
    }.items():
        path = load(tmp_path, f"B1 p n i={current}")
        scene = Scene.read("device", [f"load.netlist={path}", "run.duration=0.2", "run.settle=0",
                                      "run.realizations=1"])  # fmt: skip
        powers[name] = simulate(scene).quantity("mean_power").estimate
    expected = np.exp(80.0) * 1e-30 / 4.43e9 * 8e4
    assert powers["exp"] / powers["plain"] == pytest.approx(expected, rel=1e-2)
