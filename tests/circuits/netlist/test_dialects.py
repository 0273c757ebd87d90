"""Every row of the table of dialects in docs/reference/netlists.md, run by both engines."""

import re
from pathlib import Path

import numpy as np
import pytest
from raw_files import program_46, run_raw

from circuits.netlist.expression import written
from circuits.netlist.expression_graph import Values
from circuits.netlist.load_notes import reading_notes
from circuits.netlist.subcircuits import read_load
from harvester.base.errors import NetlistError

DOCS = Path(__file__).parents[3] / "docs" / "reference" / "netlists.md"
VOLTS = {"m": -2.0, "h": 0.4, "z": 0.0, "t": 3.0}
OTHERS, OURS = ("ltspice", "pspice"), ("ngspice", "")
# Of each row: what is written of the nodes m, h, z and t, its value in LTspice or PSpice by their
# manuals, and here.
VALUES = {
    "`x^y`": [("v(t)^2", 0.0, 9.0), ("v(t)^v(z)", 1.0, 1.0), ("v(t)^v(h)", 1.0, 3.0**0.4)],
    "`x**y`": [
        ("v(m)**3", -8.0, 8.0),
        ("v(m)**2", 4.0, 4.0),
        ("v(m)**v(h)", 2.0**0.4 * np.cos(0.4 * np.pi), 2.0**0.4),
        ("2**3**2", 64.0, 64.0),
    ],
    "`pow(x,y)`": [("pow(v(m),3)", -8.0, 8.0)],
    "`pwr(x,y)`": [("pwr(v(m),3)", 8.0, -8.0)],
    "`c ? a : b`, `&&`, <code>&#124;&#124;</code>, `!`": [
        ("(v(h) ? 2 : 3)", 3.0, 2.0),
        ("(v(h) && v(t))+2", 2.0, 3.0),
        ("(v(h) || v(z))+2", 2.0, 3.0),
        ("!v(h)", 1.0, 0.0),
        ("(v(t)>1 && v(h)<1 ? 2 : 3)", 2.0, 2.0),
    ],
    "`&`, <code>&#124;</code>, `~`": [
        ("(v(t) & v(h))+2", 2.0, "write &&"),
        ("(v(t) | v(h))+2", 3.0, r"write \|\|"),
        ("~v(h)", 1.0, "write !x"),
        ("(v(t) & v(h) | v(z))", "write parentheses", "write &&"),
    ],
    "`u(x)`": [("u(v(z))", 0.0, 0.5), ("u(v(t))", 1.0, 1.0), ("u(v(m))", 0.0, 0.0)],
    "`if(c,a,b)`": [("if(v(h),2,3)", 3.0, 3.0)],
    "`buf`, `inv`, `limit`, `int`, `round`, `hypot`, `stp`, `sqr`, `pwrs`": [
        ("buf(v(h))+2*inv(v(h))", 2.0, 2.0),
        ("limit(v(t),v(m),1)", 1.0, 1.0),
        ("int(-1.7)", -1.0, -1.0),
        ("round(v(t)-0.4)", 3.0, 3.0),
        ("hypot(v(t),4)", 5.0, 5.0),
        ("stp(v(t))+stp(v(m))", 1.0, 1.0),
        ("sqr(v(t))", 9.0, 9.0),
        ("pwrs(v(m),3)", -8.0, -8.0),
    ],
    "`and`, `or`, `not`": [("v(t) and v(h)", "write && for and", "write && for and")],
    "`idt`, `sdt`, `table`, `atan2`, `delay`": [
        ("idt(v(t))", "a current source into a capacitor", "a current source into a capacitor"),
        ("sdt(v(t))", "a current source into a capacitor", "a current source into a capacitor"),
        ("table(v(t),0,0,1,1)", "write pwl", "write pwl"),
        ("atan2(v(t),1)", r"write atan\(y/x\)", r"write atan\(y/x\)"),
        ("delay(v(t),1m)", "a chain of R and C", "a chain of R and C"),
    ],
    "x/0": [("v(t)/v(z)", 3e32, 3e32)],
}
# Of each other row elements and, where they are refused, what is said.
ELEMENTS = {
    "switch with `vh` or `ih` below 0, `VSWITCH`, `ISWITCH`": [
        ("S1 p n h ref sm\n.model sm sw(vt=1 vh=-1)", ""),
        ("S1 p n h ref sm\n.model sm vswitch(von=1 voff=0)", ""),
        ("W1 p n vh sm\n.model sm iswitch(ion=1m ioff=0)", ""),
    ],
    "switch with `level=2`, `ilimit`, `td`": [
        ("S1 p n h ref sm\n.model sm sw(level=2)", "write a B source"),
        ("S1 p n h ref sm\n.model sm sw(ilimit=1)", "write a B source"),
        ("S1 p n h ref sm\n.model sm vswitch(td=1u)", "delay the control by R and C"),
    ],
    "`SINE(…)`, `VALUE {…}`, `E1 a b (c,d) 2`": [
        ("V1 a ref SINE(0 1 50)\nRa a ref 1k", ""),
        ("E1 a ref VALUE {2*v(h)}\nRa a ref 1k", ""),
        ("E1 a ref (h,ref) 2\nRa a ref 1k", ""),
    ],
    "`m=` on B, F, G": [
        ("B1 p n i=1u m=2", ""),
        ("G1 p n h ref 1u m=2", ""),
        ("F1 p n vh 2 m=2", ""),
        ("E1 a ref h ref 2 m=2\nRa a ref 1k", "are equal to one"),
        ("H1 a ref vh 2 m=2\nRa a ref 1k", "are equal to one"),
    ],
    "diode with `ron`, `vfwd`, `vz`, `nbvl`": [
        ("D1 p n dm\n.model dm d(ron=1)", "give is, n and rs"),
        ("D1 p n dm\n.model dm d(vfwd=0.3)", "give is, n and rs"),
        ("D1 p n dm\n.model dm d(vz=5)", "remove it"),
        ("D1 p n dm\n.model dm d(nbvl=5)", "remove it"),
    ],
}


def load(folder, dialect, body):
    nodes = "\n".join(f"V{name} {name} ref {volts}" for name, volts in VOLTS.items())
    line = f"* dialect: {dialect}\n" if dialect else ""
    path = folder / "load.lib"
    path.write_text(
        f"{line}.subckt load p n out ref\n{nodes}\n{body}\nRo out ref 10k\nRg ref n 1k\n.ends\n"
    )
    return read_load(path)


def cases(told):
    rows = [(text, theirs, ours) for row in VALUES.values() for text, theirs, ours in row]
    found = [(each, text, theirs) for each in OTHERS for text, theirs, _ in rows]
    found += [(each, text, ours) for each in OURS for text, _, ours in rows]
    return [each for each in found if isinstance(each[2], str) == told]


def test_each_spelling_has_the_value_that_its_dialect_gives_it(tmp_path):
    lines = ["deck", *(f"v{name} {name} 0 {volts}" for name, volts in VOLTS.items())]
    lines += [f".nodeset v({name})={volts}" for name, volts in VOLTS.items()]
    point = np.array([[volts] for volts in VOLTS.values()])
    for k, (dialect, text, value) in enumerate(cases(told=False)):
        read = load(tmp_path, dialect, f"B1 b ref v={text}\nRb b ref 1meg")
        tree = next(each.expression for each in read.elements if each.name == "b1")
        ours = Values([tree], [*VOLTS, "ref"])(np.zeros(1), np.vstack([point, [[0.0]]]))[0, 0]
        assert ours == pytest.approx(value, rel=1e-6, abs=1e-12), (dialect, text)
        said = re.sub(r"v\((\w+),ref\)", r"v(\1)", written(tree))
        lines.append(f"b{k} b{k} 0 v={said}")
    (tmp_path / "deck.cir").write_text("\n".join([*lines, ".op", ".end"]) + "\n")
    raw = run_raw(tmp_path, "deck.cir", program_46())
    for k, (dialect, text, value) in enumerate(cases(told=False)):
        assert raw[f"v(b{k})"][0] == pytest.approx(value, rel=1e-6, abs=1e-12), (dialect, text)


@pytest.mark.parametrize(("dialect", "text", "fault"), cases(told=True))
def test_what_a_dialect_cannot_say_here_is_refused_with_what_to_write(
    tmp_path, dialect, text, fault
):
    with pytest.raises(NetlistError, match=rf"^load\.lib:\d+: .*{fault}"):
        load(tmp_path, dialect, f"B1 b ref v={text}\nRb b ref 1meg")


@pytest.mark.parametrize("dialect", ["", "ltspice"])
@pytest.mark.parametrize(
    ("body", "fault"), [each for row in ELEMENTS.values() for each in row]
)  # fmt: skip
def test_elements_of_others_are_read_or_refused(tmp_path, dialect, body, fault):
    if not fault:
        assert load(tmp_path, dialect, body).elements
        return
    with pytest.raises(NetlistError, match=rf"^load\.lib:\d+: .*{fault}"):
        load(tmp_path, dialect, body)


def test_every_row_of_the_table_is_tested():
    text = DOCS.read_text(encoding="utf-8")
    table = text[text.index("## Dialects") :]
    rows = re.findall(r"(?m)^\| (.+?) \| .+ \|$", table[: table.index("\n\n## ")])[2:]
    assert {*rows} == {*VALUES, *ELEMENTS}


@pytest.mark.parametrize(
    ("body", "noted"),
    [
        ("R9 p n 1k Rser=0\nB1 p n i=1u*v(h)^2", "ltspice, whose 'rser=' is in this file"),
        ("R9 p n {if(1,2k,3k)}\nB1 p n i={1u*pow(v(m),3)}", "ltspice, whose 'if('"),
        ("S1 p n h ref sm\n.model sm vswitch(von=1)\nB1 p n i=1u*u(v(z))", "pspice, whose"),
        # What both mean alike, and what no other dialect's word stands beside.
        ("R9 p n 1k Rser=0\nB1 p n i=(v(h)>1 && v(m)<2 ? 1u : 2u)*v(h)**2", ""),
        ("B1 p n i=1u*v(h)^2", ""),
    ],
)
def test_a_guess_of_the_dialect_is_noted_where_it_matters(tmp_path, body, noted):
    guess, said = load(tmp_path, "", body), load(tmp_path, "ngspice", body)
    notes = [each for each in reading_notes(guess) if "* dialect" in each]
    assert len(notes) == bool(noted)
    assert noted in "".join(notes)
    assert not said.ambiguity


def test_a_dialects_parameters_functions_and_measures_count_too(tmp_path):
    """Of LTspice's 3^2 both are true; pwr() keeps no sign."""
    path = tmp_path / "load.lib"
    path.write_text(
        "* dialect: LTspice\n.func f(x) {pwr(x,3)+(x^0)}\n.param r={1k*(2+(3^2))}\n"
        "* measure: loss any = f(-2)*v(out,ref)**2\n"
        ".subckt load p n out ref k={f(-2)}\n* needs: k ^ 0\n"
        "Rk p n {k*1k}\nRo out ref {r}\nRg ref n 1k\n.ends\n"
    )
    read = read_load(path)
    sizes = {each.name: each.size for each in read.elements}
    assert sizes["rk"] == pytest.approx(8e3)
    assert sizes["ro"] == pytest.approx(2e3)
    assert read.measures[0].trees[0] == (
        "*", ("number", 8.0), ("^", ("v", "out", "ref"), ("number", 2.0))
    )  # fmt: skip


def test_long_expressions_of_a_dialect_are_read_or_refused_at_once(tmp_path):
    """A base stands twice in what its power comes to, and a sum is as deep as it is long."""
    assert load(tmp_path, "ltspice", "B1 p n i=1n*(" + "+".join(["v(t)"] * 3000) + ")").elements
    assert load(tmp_path, "ltspice", "R9 p n {1k+7%2+u(0)}").elements
    with pytest.raises(NetlistError, match="becomes too long"):
        load(tmp_path, "ltspice", "B1 p n i=v(t)" + "**3" * 4000)
    assert load(tmp_path, "", "R9 p n 1k Rser=0\nB1 p n i=v(t)" + "**3" * 4000).elements


def test_an_unknown_dialect_and_two_are_refused(tmp_path):
    with pytest.raises(NetlistError, match=r"one of ngspice, ltspice, pspice"):
        load(tmp_path, "hspice", "R9 p n 1k")
    with pytest.raises(NetlistError, match=r"for all files"):
        load(tmp_path, "ltspice\n* dialect: pspice", "R9 p n 1k")
