"""Which value a parameter has where several places give one: ngspice's answer is the answer."""

import itertools
import subprocess

import pytest
from raw_files import ngspice_program

from circuits.netlist.subcircuits import read_load
from harvester.base.errors import NetlistError

RESISTOR = "R1 p n {r}"


def resistance(folder, text, **given):
    """What plain ngspice makes of a load, in ohms."""
    values = " ".join(f"{name}={value}" for name, value in given.items())
    netlist = f"t\n{text}\nI1 0 top 1m\nXload top 0 load {values}\n.op\n.print op v(top)\n.end\n"
    (folder / "plain.cir").write_text(netlist)
    command = [ngspice_program(), "-b", "plain.cir"]
    said = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=30).stdout
    return next(float(w[1]) * 1e3 for w in map(str.split, said.splitlines()) if w[:1] == ["top"])


def read(folder, text, **given):
    (folder / "load.lib").write_text(text)
    return read_load(folder / "load.lib", "load", given)


@pytest.mark.parametrize(
    ("header", "inner", "outer", "given"),
    [
        places
        for places in itertools.product((None, 300), (None, 100), (None, 50), (None, 200))
        if any(places[:3]) and (places[0] or not places[3])
    ],
)
def test_one_name_in_several_places(tmp_path, header, inner, outer, given):
    text = f".param r={outer}\n" if outer else ""
    text += ".subckt load p n" + (f" r={header}\n" if header else "\n")
    text += RESISTOR + (f"\n.param r={inner}" if inner else "") + "\n.ends\n"
    values = {"r": given} if given else {}
    load = read(tmp_path, text, **values)
    plain = resistance(tmp_path, text, **values)
    assert load.resistance == pytest.approx(plain)
    assert resistance(tmp_path, load.text, **dict(load.parameters)) == pytest.approx(plain)
    assert resistance(tmp_path, load.run_text) == pytest.approx(plain)
    if header and not given:
        assert dict(load.defaults)["r"] == pytest.approx(plain)


@pytest.mark.parametrize(
    "text",
    [
        ".subckt load p n r=300\n.param q={r*2}\n.param r=100\nR1 p n {q}\n.ends",
        ".param a=40\n.subckt load p n r={2*a}\n.param a=7\nR1 p n {r}\n.ends",
        ".param r=50\n.subckt load p n\n.param r={r*2}\nR1 p n {r}\n.ends",
        ".param r=40\n.subckt load p n r={r}\nR1 p n {r}\n.ends",
        ".subckt load p n a=300 r={2*a}\nR1 p n {r}\n.ends",
        ".param r=100\n.param r=70\n.subckt load p n\nR1 p n {r}\n.ends",
        ".subckt load p n r=300\n.subckt in a b r=10\nR1 a b {r}\n.ends in\nX1 p n in\n.ends",
        ".subckt load p n r=300\n.subckt in a b r=10\nR1 a b {r}\n.ends\nX1 p n in r={r}\n.ends",
        ".subckt load p n r=300\n.subckt in a b r=9\n.param r=33\nR1 a b {r}\n.ends\nX1 p n in\n"
        ".ends",
        ".func f(x) {2*x}\n.subckt load p n r=300\n.func f(x) {3*x}\nR1 p n {f(r)}\n.ends",
        ".param k=5\n.func f(x) {k*x}\n.subckt load p n r=300 k=2\nR1 p n {f(r)}\n.ends",
        ".subckt load p n\n.func sin(x) {3*x}\nR1 p n {sin(50)}\n.ends",
        ".param r=100\n.model r r(r=50)\n.subckt load p n\nR1 p n r\n.ends",
        ".model 1k r(r=50)\n.subckt load p n\nR1 p n 1k\n.ends",
        ".model rm r(r=50)\n.subckt load p n\n.model rm r(r=70)\nR1 p n rm\n.ends",
        ".param pi=100\n.subckt load p n\nR1 p n {pi}\n.ends",
        ".subckt load p n m=2\nR1 p n 300\n.ends",
        ".param q=3 , r={max(100,q)}\n.subckt load p n\nR1 p n {r}\n.ends",
        ".subckt load p n\nR1 p n 3mil\n.ends",
        ".subckt load p n\nR1 p n 300 r=100\n.ends",
        ".subckt load p n\nR1 p n -5\n.ends",
    ],
)
def test_what_is_run_is_what_plain_ngspice_runs(tmp_path, text):
    load = read(tmp_path, text + "\n")
    plain = resistance(tmp_path, text)
    assert resistance(tmp_path, load.text) == pytest.approx(plain)
    assert resistance(tmp_path, load.run_text) == pytest.approx(plain)
    assert load.resistance in (None, pytest.approx(plain))


@pytest.mark.parametrize("pairs", ["q=3,r=300", "q={min(1,3)}, r=300", "q=3 ,r=300 , s=1"])
def test_a_comma_parts_parameters_wherever_blanks_stand(tmp_path, pairs):
    """ngspice 39 itself hangs where none stands before it."""
    text = f".param {pairs}\n.subckt load p n\nR1 p n {{r+q-q}}\n.ends\n"
    assert resistance(tmp_path, read(tmp_path, text).text) == pytest.approx(300.0)


@pytest.mark.parametrize("text", [".param r=3meg q=3mil", ".param q={3mil}", ".param q=3a"])
def test_a_suffix_with_two_readings_is_refused_with_both(tmp_path, text):
    """ngspice takes mil for a thousandth in a .param, and A for 1e-18 in one release of two."""
    with pytest.raises(NetlistError, match=r"load\.lib:1: .*(1e-3|46 reads A as 1e-18)"):
        read(tmp_path, text + "\n.subckt load p n\nR1 p n {q}\n.ends\n")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "message"),
    [
        # Defined for the whole circuit, it would change the device.
        (".ends\n.func abs(x) {10*x}\n.subckt more p n", "abs is a function of ngspice"),
        (".func v(x) {x}", "v is a function of ngspice"),
        (".param time=1", "time is reserved by ngspice"),
        (".param temper=1", "temper is reserved by ngspice"),
        # Behavioural sources know the constant alone.
        (".func f(x) {x}\n.func f(x) {2*x}", r"\.func f is defined twice, first at load\.lib:3"),
        (".model a d\n.model a d(is=1n)", r"\.model a is defined twice"),
        (".param e=1\nE1 x 0 value={e*v(p)}", "e is a constant of ngspice"),
        (".param pi=1e6\nB1 p n i=pi*v(p)", "pi is a constant of ngspice"),
        ("R1 p n 1k", "r1 is defined twice"),
    ],
)
def test_a_name_that_means_two_things_is_refused(tmp_path, line, message):
    with pytest.raises(NetlistError, match=message):
        read(tmp_path, f".subckt load p n\nR1 p n 1k\n{line}\n.ends\n")


@pytest.mark.parametrize(
    "line",
    [
        ".param c=10n\nC1 p n {c}",
        ".param c=10n\nB1 p n i=c*v(p)",
        ".param pi=3.14159265\nB1 c n i=1e-9*pi*v(c)",
    ],
)
def test_a_name_with_one_meaning_is_not(tmp_path, line):
    read(tmp_path, f".subckt load p n\nR1 p n 1k\n{line}\n.ends\n")


@pytest.mark.parametrize(
    "call", ["pow(v(p))", "min(1)", "pwl(v(p))", "pwl(v(p),0,1,2)", "abs(1,2)", "v(p,n,p)"]
)
def test_a_call_that_crashes_ngspice_is_refused(tmp_path, call):
    with pytest.raises(NetlistError, match=r"load\.lib:2: .*: \w+ takes \d arguments, not \d"):
        read(tmp_path, f".subckt load p n\nB1 p n i={call}\n.ends\n")
