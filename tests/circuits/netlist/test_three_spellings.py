"""Each point at which two readings of a netlist once differed, in three spellings more.

Monte Carlo, the circuit and plain ngspice on the text itself, or a closed form where plain ngspice
reads another thing, agree within 1 %; or the load is refused in one line with the cure.
"""

import re

import numpy as np
import pytest
from raw_files import program_46, run_raw

from circuits.netlist.subcircuits import read_load
from harvester.base.errors import NetlistError
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene

# A linear device from rest; nothing of it reaches the loads here but a resistor's current.
BENCH = [
    "oscillator.linear_stiffness=126.9", "oscillator.cubic_stiffness=0", "oscillator.damping=0.044",
    "run.duration=1", "run.settle=0", "run.realizations=1",
]  # fmt: skip
PLAIN = None
FED = "Vs o1 ref 5\nRs o1 out 10k\n"
LAST = "\nR1 o1 out 1\nRl out ref 9k"
FLIP = "Va a ref 5\nRa a out 10k\nRb out sw 10k\nRl out ref 10k\n"
# Point of issue → (elements, what stands in front, the mean square of the output in V², or the
# refusal; PLAIN: as plain ngspice has it).
POINTS = {
    "names of functions and constants": [
        (FED + "Rl out ref {min+max}", ".param min=4k max=6k", 2.5**2),
        (FED + "Rl out ref {f(sqrt)}", ".param sqrt=2\n.func f(x) {5k*x}", 2.5**2),
        ("B1 o1 ref v={g(1)}" + LAST, ".func g(x) {x*planck*0+echarge*1e19}", 2.56594),
        ("B1 o1 ref v=kelvin*0.01*x" + LAST, ".param kelvin=200 x=1", PLAIN),
        ("B1 p n i=v(p)*e", ".param e=1n", "rename"),
    ],
    "suffixes": [
        (FED + "Rl out ref {10k+1MEG*0}", "", PLAIN),
        (FED + "Rl out ref 10kOhm", "", PLAIN),
        (FED + "Rl out ref {0.01MegOhm}", "", PLAIN),
        (FED + "Rl out ref 4k7", "", (5 * 4.7 / 14.7) ** 2),
        (FED + "Rl out ref {1e4A}", "", "omit the A"),
        (FED + ".param r=400mil\nRl out ref {r}", "", "25.4u"),
    ],
    "scope": [
        (FED + "Xa out ref s1", ".param w=2k\n.subckt s1 a b\n.param w=6k\nXi a b s2\n.ends\n"
         ".subckt s2 a b\nRi a b {w}\n.ends", PLAIN),
        (FED + "Xa out ref s1 w=6k", ".subckt s1 a b w=1k\nXi a b s2 v={w+1k}\n.ends\n"
         ".subckt s2 a b v=1k\nRi a b {v}\n.ends", PLAIN),
        (FED + "Xa out ref s1", ".func f(x) {x*2k}\n.subckt s1 a b\n.func f(x) {x*5k}\n"
         "Ri a b {f(2)}\n.ends", PLAIN),
        (FED + ".param w={q/2}\nRl out ref {w}", ".param q=8k w=1k", PLAIN),
    ],
    "waveforms": [
        ("Vs o1 ref AC 1 0 PULSE(0 5 2m 1u 1u 9m 20m)" + LAST, "", PLAIN),
        ("Vs o1 ref dc 1 pwl(0 0, 10m 5, 60m 1)" + LAST, "", PLAIN),
        ("Is ref out dc 0 ac 1m SIN ( 0 1m 30 )\nRl out ref 9k", "", PLAIN),
        ("Vs o1 ref pulse(0 5 2m 1u)" + LAST, "", "write pulse"),
        ("Vs o1 ref sin(0 1 0)" + LAST, "", "write sin"),
        ("Vs o1 ref exp(0 1)" + LAST, "", "write exp"),
    ],
    "two values": [
        (FED + "Rl out ref 3k r=10k", "", PLAIN),
        (FED + "Rl out ref 1k 10k tc1=0", "", "two values, 1k and 10k"),
        ("Vs o1 ref sin(0 5 25)\nRs o1 out 10k\nCl out ref 1u c=0.5u\nRl out ref 9k", "", PLAIN),
        ("Vs o1 ref 3 dc 5" + LAST, "", "two constant values"),
        ("Vs o1 ref pulse(0 5 0 1u 1u 9m 20m) sin(0 5 25)" + LAST, "", "two waveforms"),
    ],
    "names that stand twice": [
        (FED + "D1 out ref dm\nRl out ref 9k", ".model dm d(is=1n)\n.model dm d(is=9n)",
         "is defined twice"),
        (FED + "Rl out ref {f(1)}", ".func f(x) {9k*x}\n.func f(x) {8k*x}", "is defined twice"),
        (FED + "Xa out ref s", ".subckt s a b\nRi a b 9k\n.ends\n.subckt s a b\nRi a b 8k\n.ends",
         "is defined twice"),
    ],
    "switches of others": [
        (FLIP + "Vc c ref 2\nS1 sw ref c ref sm", ".model sm sw(vt=1 vh=-1 ron=10k roff=10meg)",
         (5 * 20 / 3 / (20 / 3 + 10)) ** 2),
        (FLIP + "Vc c ref 0.5\nS1 sw ref c ref sm",
         ".model sm vswitch(von=1 voff=0 ron=1k roff=100k)",
         (5 / (1 + 10 / 10 + 10 / 20)) ** 2),
        (FLIP + "Vc c c0 0\nRc c0 ref 1k\nIc ref c 2m\nW1 sw ref Vc sm",
         ".model sm csw(it=1m ih=-1m ron=10k roff=10meg)", (5 * 20 / 3 / (20 / 3 + 10)) ** 2),
        (FLIP + "S1 sw ref a ref sm", ".model sm sw(level=2 vt=1)", "write a B source"),
    ],
    "what else": [
        (FED + "Rl out ref {max(2k,10k)+int(0.9)}", "", 2.5**2),
        ("Vs o1 ref {ln(e)*5}\nRs o1 out 10k\nRl out ref 10k", "", 2.5**2),
        ("Va a ref 2\nB1 o1 ref v=sqrt(v(a,ref)+2)" + LAST, "", PLAIN),
        (FED + "Rl out ref {10k*(7%2)}", "", 2.5**2),
        ("Xi o1 ref s\nB1 ref out i=i(xi.v1)*1\nRl out ref 9k",
         ".subckt s a b\nV1 a b 1\nR1 a b 1k\n.ends", 81.0),
        (FED + "Rl out ref {10k*(2 and 1)}", "", "write && for and"),
    ],
    "at a threshold": [
        (FLIP + "Vc c ref 1\nS1 sw ref c ref sm",
         ".model sm sw(vt=1 vh=0 ron=10k roff=100meg)", PLAIN),
        ("Vc c ref 0\nB1 o1 ref v=5*(v(c,ref)>0)+3*(v(c,ref)>=0)" + LAST, "", 9.0),
        ("Vc c ref 1\nVd d c 1\nB1 o1 ref v=v(d,ref)==2 ? 3 : 4" + LAST, "", 9.0),
    ],
    "states at the start": [
        (FLIP + "Vc c ref 0.5\nS1 sw ref c ref sm off",
         ".model sm sw(vt=0.5 vh=0.2 ron=10k roff=100meg)", 2.5**2),
        (FLIP + "Cc c ref 1u ic=1.1\nS1 sw ref c ref sm on",
         ".model sm sw(vt=1 vh=0.2 ron=10k roff=100meg)", 4.0),
        ("Vq q ref 100\nB1 o1 ref v=ln(v(q,ref))" + LAST, "", np.log(100) ** 2),
    ],
    "words of other dialects": [
        ("Va a+ ref 2\nB1 o1 ref v=V(a+,ref)" + LAST, "", 4.0),
        ("Vs o1 ref SINE(0 5 25)" + LAST, "", 12.5),
        ("Va a ref 2\nE1 o1 ref VALUE { V(a,ref)*2 }" + LAST, "", 16.0),
        ("Va a ref 2\nG1 ref out (a,ref) 0.1m\nRl out ref 9k\nRh gnd ref 1k", "", 1.8**2),
        ("B1 p n i=1u*square(v(p))", "", "x*x"),
        ("X1 p n s m=2", ".subckt s a b\nR1 a b 1k\n.ends", "write the call m times"),
    ],
    "diodes": [
        (FED + "D1 out ref dm\nRl out ref 10k",
         ".model dm d(is=1u n=2 ikf=10u isr=1u nr=4)", PLAIN),
        (FED + "D1 out ref dm temp=80\nRl out ref 10k",
         ".model dm d(is=1u n=2 eg=0.7 xti=2)", PLAIN),
        (FED + "Rl out ref rm temp=100", ".model rm r(r=8k tc1=1m)", PLAIN),
        ("Vs o1 ref sin(0 5 25)\nRs o1 out 10k\nCl out ref cm dtemp=50\nRl out ref 9k",
         ".model cm c(cap=0.4u tc1=1m)", PLAIN),
        ("Vs o1 ref sin(0 5 25)\nRs o1 out 10k\nCl out ref cm w=9m l=1m\nRl out ref 9k",
         ".model cm c(cj=0.1 cjsw=10u del=0.1m)", PLAIN),
        ("Cl out ref cm", ".model cm c(c=1u)", "write cap="),
        ("Cl out ref cm", ".model cm c(cj=1m defl=9u)", "it has no value"),
        (FED + "D1 out ref dm", ".model dm d(is=1n vrev=5)", "give is, n and rs"),
        (FED + "D1 out ref dm", ".model dm d(is=1n t_abs=50)", "remove it"),
    ],
    "what is not whole": [
        (FED + "Rl out ref {10k*(1+1}", "", "closing parenthesis missing"),
        (FED + "Rl out ref {}", "", "missing operand"),
        (FED + "Rl out ref { }", "", "missing operand"),
        (FED + "* measure: loss a = f(1)*v(out,ref)\nRl out ref 9k", ".func f(x,y) {x*y}",
         "f takes 2 arguments, not 1"),
        (FED + "Rl out ref {" + "+".join(["10"] * 1000) + "}", "", 2.5**2),
        (FED + "Rl out ref {" + "-" * 300 + "10k}", "", 2.5**2),
        (FED + "S1 out ref o1 ref sm\nRl out ref 9k", ".model sm sw(ron=0)", "write 1m"),
    ],
}  # fmt: skip


def write(folder, elements, before):
    path = folder / "load.lib"
    text = f"{before}\n.subckt load p n out ref\n{elements}\nRg ref n 1k\nRp p n 306k\n.ends\n"
    path.write_text(text)
    return path, text


def plain_square(folder, text):
    """Of the output's voltage over a second in plain ngspice, without the device."""
    (folder / "deck.cir").write_text(
        f"deck\n{text}\nXload p 0 out ref load\nRd p 0 1meg\nCo out 0 1e-14\nCr ref 0 1e-14\n"
        ".options reltol=1e-5\n.tran 100u 1 0 100u uic\n.save v(out) v(ref)\n.end\n"
    )
    raw = run_raw(folder, "deck.cir", program_46())
    return np.trapezoid((raw["v(out)"] - raw["v(ref)"]) ** 2, raw["time"])


CASES = [(point, *each) for point, spellings in POINTS.items() for each in spellings]


@pytest.mark.parametrize(
    ("elements", "before", "fault"), [each[1:] for each in CASES if isinstance(each[3], str)]
)
def test_what_is_refused_says_the_cure_in_one_line(tmp_path, elements, before, fault):
    path, _ = write(tmp_path, elements + "\nRo out ref 9k", before)
    with pytest.raises(NetlistError, match=rf"^load\.lib:\d+: .*{re.escape(fault)}") as refusal:
        read_load(path)
    assert "\n" not in str(refusal.value)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("point", "elements", "before", "truth"), [e for e in CASES if not isinstance(e[3], str)]
)
def test_what_runs_is_right_in_both_engines(pool, tmp_path, point, elements, before, truth):
    path, text = write(tmp_path, elements, before)
    expected = plain_square(tmp_path, text) if truth is PLAIN else truth
    assert plain_square(tmp_path, read_load(path).run_text) == pytest.approx(expected, rel=1e-2)
    scene = Scene.read("device", [*BENCH, f"load.netlist={path}"])
    for method in ("circuit", "monte-carlo"):
        result = simulate(scene, method=method, step="fine", runner=pool)
        siemens = sum(1.0 / each.size for each in scene.load.circuit.across_output
                      if each.letter == "r")  # fmt: skip
        used = "mean_power_used_at_output"
        key = used if used in result.quantities else "mean_output_power"
        power = result.quantity(key).estimate
        assert power == pytest.approx(expected * siemens, rel=1e-2), (point, method)
