"""What the reader writes for a run is what plain ngspice 46 makes of the user's own text."""

import random
import re
import subprocess
import sys

import numpy as np
import pytest
from raw_files import program_46

from circuits.equivalent.assembly import assemble
from circuits.kernel.assembly import build
from circuits.netlist import subcircuits
from circuits.netlist.expression import (
    ExpressionError,
    leaves,
    parse,
    rebuilt,
    resolved,
    written,
)
from circuits.netlist.expression_graph import Values
from circuits.netlist.load_notes import reading_notes
from circuits.netlist.load_watch import watch_of
from circuits.netlist.scope import Scope
from circuits.netlist.subcircuits import find_netlist, read_load
from circuits.netlist.tree import parse as parse_tree
from circuits.netlist.vetting import Card
from harvester.base.errors import NetlistError
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.validation.other_programs import read_raw


def run(folder, deck):
    """Variables of a deck, as `read_raw`; ngspice's own words where it makes none."""
    (folder / "deck.cir").write_text(deck)
    (folder / "deck.raw").unlink(missing_ok=True)
    command = [program_46(), "-b", "-r", "deck.raw", "deck.cir"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60)
    assert (folder / "deck.raw").exists(), (done.stdout + done.stderr)[-800:]
    return read_raw(folder / "deck.raw")


def mean_square(folder, text):
    """Of the output's voltage over a second, 0.5 s after the beginning, the pins driven by 1 V."""
    deck = (
        f"deck\n{text}\nVm p 0 sin(0 1 12.5)\nXload p 0 out ref load\nCo out 0 1e-14\n"
        "Cr ref 0 1e-14\n.options reltol=1e-5\n.tran 50u 1.5 0.5 50u uic\n"
        ".save v(out) v(ref)\n.end\n"
    )
    raw = run(folder, deck)
    volts = raw["v(out)"] - raw["v(ref)"]
    return np.trapezoid(volts**2, raw["time"]) / (raw["time"][-1] - raw["time"][0])


def load(folder, body, before=""):
    """A load of this body beside what every one here has."""
    path = folder / "load.lib"
    text = f"{before}\n.subckt load p n out ref\n{body}\nRg ref n 1k\nRp p n 306k\n.ends\n"
    path.write_text(text)
    return text, path


BEHIND = "R1 o1 out 1\nR2 out ref 1meg"
FED = "Vs o1 ref 5\nRs o1 out 10k\n"


@pytest.mark.parametrize(
    ("body", "before"),
    [
        # Scope: values given, of the caller, of the file; functions where they are defined.
        (FED + "Xa out ref s", ".param r=7k\n.subckt s a b\n.param r={2*r}\nRi a b {r}\n.ends"),
        (FED + ".param q=1k\nXa out ref s", ".param q=10k\n.subckt s a b\nRi a b {q}\n.ends"),
        (FED + "Xa out ref s q=3k", ".subckt s a b q=1k r={q*2}\nRi a b {r}\n.ends"),
        (FED + ".func f(x) {3*x}\nRl out ref {g(5k)}", ".func f(x) {x}\n.func g(x) {f(x)}"),
        (FED + "Rl out ref {1k*g(2)}", ".param x=5\n.func f(a) {x*a}\n.func g(x) {f(x)+x}"),
        (FED + ".param k=2k\nRl out ref {f(3)}", ".param k=1k\n.func f(a) {k*a}"),
        ("B1 o1 ref V={g(2)}\nRs o1 out 10k\nRl out ref 9k", ".param c=4\n.func g(x) {c*x}"),
        # The last of two values counts, a model's before none.
        (FED + "Rl out ref r=5k 10k", ""),
        (FED + "Rl out ref rm 2k", ".model rm r(r=10k)"),
        (FED + "Rl out ref rm l=20u w=3u dtemp=50", ".model rm r(rsh=1k narrow=0.1u tc1=0.01)"),
        ("Vs o1 ref sin(0 5 20)\nRs o1 out 10k\nC1 out ref c=5u 1u\nRl out ref 9k", ""),
        ("Vs o1 ref sin(0 5 20)\nL1 o1 out 1 l=40\nRl out ref 9k", ""),
        # Sources, in any order.
        ("Vs o1 ref ac 1 0 sin(0 5 20) dc 3\nRs o1 out 1k\nRl out ref 9k", ""),
        ("Vs o1 ref sin(1 5 20 0.6 2 30)\nRs o1 out 1k\nRl out ref 9k", ""),
        ("Vs o1 ref sin(1 5 -20 0 2 30)\nRs o1 out 1k\nRl out ref 9k", ""),
        ("Vs o1 ref dc 2 ac 1\nRs o1 out 1k\nRl out ref {max(2k,9k)}", ""),
        ("Vs o1 ref pwl 0 0 0.7 5 0.7 2 1 0\nRs o1 out 1k\nRl out ref 9k", ""),
        ("Vs o1 ref exp(0 5 0.6 50m 0.9 20m)\nRs o1 out 1k\nRl out ref 9k", ""),
        ("Is ref out pulse(0 1m 7m 0 0 10m 40m)\nRl out ref 9k", ""),
        # Controlled sources as others write them.
        ("Va a ref 2\nE1 o1 ref VALUE {2*v(a,ref)}\nRs o1 out 10k\nRl out ref 9k", ""),
        ("Va a ref 2\nE1 o1 ref (a,ref) 2\nRs o1 out 10k\nRl out ref 9k", ""),
        ("Va a ref 2\nG1 ref out a ref 0.1m m=3\nRl out ref 9k", ""),
        ("Va a ref 2\nB1 ref out i=0.1m*v(a,ref) m=3\nRl out ref 9k", ""),
        ("Va a+ ref 2\nB1 ref out i=0.1m*v(a+,ref)\nRl out ref 9k", ""),
        ("Rx p out {1k*(2+v(p)*v(p))}\nRl out ref 9k", ""),
    ],
)  # fmt: skip
def test_the_run_is_plain_ngspices_of_the_users_own_text(tmp_path, body, before):
    text, path = load(tmp_path, body, before)
    # A node named with a sign is one that ngspice's own expressions cannot take.
    theirs = mean_square(tmp_path, text.replace("a+", "a"))
    ours = mean_square(tmp_path, read_load(path).run_text)
    assert ours == pytest.approx(theirs, rel=5e-3, abs=1e-12)


@pytest.mark.parametrize(
    ("body", "before", "truth"),
    [
        # A parameter named as a function of ngspice's: it takes 0 for it.
        (FED + "Rl out ref {limit*1}", ".param limit=10k", 2.5**2),
        (FED + "Rl out ref {2*sgn+max}", ".param sgn=2.5k max=5k", 2.5**2),
        # Words of LTspice and PSpice that ngspice lacks.
        ("Bs o1 ref v=if(v(o2,ref),4,1)+int(1.9)\nVx o2 ref 0.4\n" + BEHIND, "", 4),
        ("Bs o1 ref v=buf(v(o2,ref))+2*inv(v(o2,ref))\nVx o2 ref 0.4\n" + BEHIND, "", 4),
        ("Bs o1 ref v=limit(v(o2,ref),1,3)+stp(v(o2,ref))\nVx o2 ref 9\n" + BEHIND, "", 16),
        ("Bs o1 ref v=hypot(3,v(o2,ref))+sqr(2)\nVx o2 ref 4\n" + BEHIND, "", 81),
        ("Vs o1 ref {c*boltz*1e15+pi}\nR1 o1 out 1\nR2 out ref 1meg", "",
         (2.99792458e8 * 1.38064852e-23 * 1e15 + np.pi) ** 2),
        # The switches of LTspice and PSpice: half way, the mean of the logarithms.
        ("Va a ref 5\nVc c ref 2.5\nS1 a out c ref sm\nRl out ref 10k",
         ".model sm sw(ron=1k roff=100k vt=2.5 vh=-2)", 2.5**2),
        ("Va a ref 5\nVc c ref 2\nS1 a out c ref sm\nRl out ref 10k",
         ".model sm vswitch(ron=1k roff=100k von=3 voff=1)", 2.5**2),
        # The flag of a switch within its hysteresis counts, and what charges its control.
        ("Vc c ref 0.5\nVa a ref 5\nS1 a out c ref sm ON\nRl out ref 10k",
         ".model sm sw(ron=10k roff=100meg vt=0.5 vh=0.2)", 2.5**2),
        ("Cc c ref 1m ic=2.5\nVa a ref 5\nS1 a out c ref sm ON\nRl out ref 10k",
         ".model sm sw(ron=10k roff=100meg vt=2.5 vh=0.3)", 2.5**2),
        # A logarithm of a source is not evaluated at 0 V.
        ("Vq q ref 1000\nBs o1 ref v=log10(v(q,ref))\nR1 o1 out 1\nR2 out ref 1meg", "", 9),
        ("Va a ref 5\nRs a out 10k\nD1 out ref dx 2\nRl out ref 10k", ".model dx d(is=1e-30 n=9)",
         2.5**2),
    ],
)  # fmt: skip
def test_what_ngspice_reads_otherwise_runs_as_it_is_meant(tmp_path, body, before, truth):
    _, path = load(tmp_path, body, before)
    assert mean_square(tmp_path, read_load(path).run_text) == pytest.approx(truth, rel=1e-3)


@pytest.mark.parametrize(
    ("body", "before", "fault"),
    [
        ("Xa out ref s r={q}", ".param q=4k\n.subckt s a b q=8k r=1k\nRi a b {r}\n.ends",
         "s also has a parameter q, whose value ngspice would use here: rename"),
        ("B1 ref out i=pi*v(p)", ".param pi=3", "pi is a constant of ngspice: rename"),
        ("B1 ref out i=1A*v(p)", "", "omit the A"),
        ("R9 p n 2A", "", "omit the A"),
        ("V1 out ref pulse(0 1 0 1m 1m 5m)", "", "write pulse(low high delay"),
        ("V1 out ref pulse(0 1 0 1m 1m 5m 10m 3)", "", "write pulse(low high delay"),
        ("V1 out ref pulse(0 1 0 -1m 1m 5m 10m)", "", "write pulse(low high delay"),
        ("V1 out ref pulse(0 1 0 1m 1m 5m 0)", "", "write pulse(low high delay"),
        ("V1 out ref sin(0 1)", "", "write sin(offset amplitude frequency"),
        ("V1 out ref exp(0 1 0 1m)", "", "write exp(low high delay1"),
        ("V1 out ref exp(0 1 2 1m 1 1m)", "", "write exp(low high delay1"),
        ("V1 out ref pwl(0 1 2)", "", "write pwl(time value"),
        ("V1 out ref pwl(0 0 1m 1) r=0", "", "write all its points"),
        ("V1 out ref am(1 2 3 4)", "", "write a B source"),
        ("V1 out ref sin(0 1 5) pulse(0 1 0 1m 1m 5m 10m)", "", "two waveforms"),
        ("V1 out ref 5 3", "", "two constant values"),
        ("S1 p n out ref sm", ".model sm sw(level=2)", "write a B source"),
        ("S1 p n out ref sm", ".model sm sw(vt=1)\n.model sm sw(vt=2)", "is defined twice"),
        ("D1 p n dm", ".model dm d(vz=5)", "a model d has no vz"),
        ("B1 p n i=1u*idt(v(p))", "", "a current source into a capacitor"),
        ("B1 p n i=(v(p)>1) & (v(p)<2)", "", "write &&"),
        ("R9 p n {f(1k)}", ".func f(a,b) {a+b}", "f takes 2 arguments, not 1"),
        ("R9 p n {x==2<y}", ".param x=1 y=3", "write parentheses"),
        ("B1 p n i=v(p)!=2>=v(n)", "", "write parentheses"),
        ("R9 p n {1k 2}", "", "an operator is missing"),
        ("* needs: x>1 and x<3\nR9 p n 1k", ".param x=2", "write && for and"),
        ("R9 p n {1k+(2}", "", "closing parenthesis missing"),
        ("X1 p n s", ".subckt s a b\n* measure: loss x = v(a)\nR1 a b 1k\n.ends",
         "measure: put it into the load's sub-circuit"),
        ("E1 out ref p n 2 m=3", "", "parallel voltage sources are equal to one"),
    ],
)  # fmt: skip
def test_what_has_two_readings_is_refused_with_what_to_write(tmp_path, body, before, fault):
    _, path = load(tmp_path, body + "\nRl out ref 10k", before)
    with pytest.raises(NetlistError, match=re.escape(fault)) as refusal:
        read_load(path)
    assert re.match(r"load\.lib:\d+: ", str(refusal.value))


@pytest.mark.parametrize("value", ["1M", "4M7", "1F", "10MF"])
def test_a_value_from_a_scene_is_no_spice_text(tmp_path, value):
    _, path = load(tmp_path, "Rl out ref {r}", ".param r=1k")
    with pytest.raises(NetlistError, match=r"in SPICE and a (million|farad) in SI: write"):
        read_load(path, parameters={"r": value})


@pytest.mark.parametrize("name", ["bridge", "doubler", "node_buck", "sece"])
def test_named_and_written_out_are_one_circuit(tmp_path, name):
    """An exported deck keeps names; the run of it is the run of what is written out."""
    read = read_load(find_netlist(name))
    paths = []
    for text in (read.text, read.run_text):
        deck = (
            f"deck\n{text}\nVm p 0 sin(0 20 25)\nXload p 0 out ref {read.name}\nCo out 0 1e-13\n"
            "Cr ref 0 1e-13\n.options reltol=1e-4 itl4=100\n.tran 50u 0.05 0 50u uic\n.save v(out) "
            "v(ref) i(vm)\n.end\n"
        ).replace("p 0 out ref", " ".join("0" if pin == "n" else pin for pin in read.pins))
        raw = run(tmp_path, deck)
        times = np.linspace(0.0, 0.05, 200)
        paths.append(np.interp(times, raw["time"], raw["v(out)"] - raw["v(ref)"]))
    assert np.abs(paths[0] - paths[1]).max() <= 1e-3 * max(np.abs(paths[0]).max(), 1e-6)


@pytest.mark.parametrize(
    ("body", "note"),
    [
        ("C1 out ref 1F", "in SPICE F after a number is femto and M is milli"),
        ("R1 out ref 100M", "in SPICE F after a number is femto and M is milli"),
        ("C1 out ref 1u", "no measure is an output: the output power is 0"),
        (
            "R1 out ref 1k\nS1 p n out ref sm\n.model sm sw(vt=1 vh=-1)",
            "is read as a smooth switch",
        ),
        ("R1 out ref 1k\nC1 out ref 1u", ""),
        ("R1 out ref 1k\nC1 out 0 1u", "is the pin n, a terminal of the transducer: write ref"),
        ("R1 out ref 1k\nB1 out ref i=1u*v(out)", "write ref for the ground of the output, v(out"),
        ("R1 out ref 1k\nB1 out ref i=1u*(v(out,ref)+v(p))", ""),
    ],
)
def test_what_may_not_be_meant_so_is_noted(tmp_path, body, note):
    _, path = load(tmp_path, body)
    notes = reading_notes(read_load(path))
    assert any(note in each for each in notes) if note else not notes


def test_a_text_is_read_once_for_all_that_asks(monkeypatch):
    texts = []
    real = subcircuits.parse
    monkeypatch.setattr(subcircuits, "parse", lambda *given: texts.append(1) or real(*given))
    scene = Scene.read("device", ["load.netlist=node_buck"])
    build(prepared(scene))
    assemble(prepared(scene))
    circuit = scene.load.circuit
    assert watch_of(circuit, {pin: pin for pin in circuit.pins}).switches
    assert circuit.sources
    assert circuit.loose_nodes == ()
    assert len(texts) == 1


def random_expression(draw, depth=0):
    """An expression of x, y (parameters or voltages) that has a value everywhere."""
    if depth > 3 or draw.random() < 0.2:
        return draw.choice(["x", "y", "2", "0.5", "1.5k", "3e-1", "100m"])
    kind = draw.choice(["binary", "binary", "call", "two", "choice", "sign", "power"])
    a, b, c = (random_expression(draw, depth + 1) for _ in range(3))
    if kind == "binary":
        sign = draw.choice(["+", "-", "*", "<", ">=", "==", "&&", "||"])
        return draw.choice([f"({a}){sign}({b})", f"({a} {sign} {b})", f"{a}{sign}({b})"])
    if kind == "call":
        name = draw.choice(["abs", "tanh", "atan", "sin", "cos", "sgn", "u", "uramp", "floor"])
        return f"{name}({a})"
    if kind == "two":
        return f"{draw.choice(['max', 'min', 'pow', 'pwr'])}(0.1+abs({a}), tanh({b}))"
    if kind == "choice":
        return f"(({a}) > ({b}) ? ({b}) : ({c}))"
    if kind == "sign":
        return f"(-({a}))"
    return f"(0.2+abs({a}))^(tanh({b}))"


def test_reading_a_load_imports_no_compiler():
    code = (
        "import sys\nfrom circuits.netlist.subcircuits import find_netlist, read_load\n"
        "load = read_load(find_netlist('node_buck'))\nassert load.run_text and load.measures\n"
        "print('numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def random_chain(draw):
    """Operators one after another with few parentheses: their precedence decides."""
    text = draw.choice(["x", "y", "2", "0.7", "3"])
    for _ in range(draw.randint(2, 5)):
        sign = draw.choice(["+", "-", "*", "/", "<", ">=", "==", "!=", "&&", "||", "^", "**"])
        operand = draw.choice(["x", "y", "2", "0.7", "3", "(x+2*y)", "(y>0.5)"])
        text += f"{sign}{operand}" if sign not in ("^", "**") else f"{sign}{draw.choice('23')}"
    return text if draw.random() < 0.8 else f"({text}) ? x : y"


# Share of a number by which ngspice may read it otherwise: 0.5 as 0.49999999999999994.
LAST_DIGITS = 1e-12


class Moved:
    """x and y as numbers, their last digits and all others' changed by chance; seed 0: not."""

    function, parameters_only = staticmethod(lambda name: None), False

    def __init__(self, seed):
        self._seed = seed

    def number(self, value):
        """The same number always changes alike: x > x stays as it is."""
        if self._seed == 0 or value.is_integer():
            return value
        return value * (1.0 + LAST_DIGITS * random.Random(f"{self._seed}{value!r}").uniform(-1, 1))

    def name(self, name):
        return ("number", self.number({"x": X, "y": Y}[name]))

    def value(self, text):
        """Of an expression of x and y."""

        def made(here, parts):
            if here[0] == "number":
                return ("number", self.number(here[1]))
            return (*here[: len(here) - len(parts)], *parts) if parts else here

        return resolved(rebuilt(parse(text), made), self)[1]


def has_a_value(text):
    """Whether it is read, and no comparison in it is met to within the last digits of its numbers.

    There ngspice's own value is chance: it reads 0.5 + 0.5 as less than 1.
    """
    try:
        values = [Moved(seed).value(text) for seed in range(6)]
    except ExpressionError:
        return False
    return np.ptp(values) <= 1e-8 * max(np.abs(values)) < 1e-2


X, Y = -1.7, 0.6


def agree(tmp_path, seed, count):
    """Source, measure, parameter and what is written: each has plain ngspice's value."""
    draw = random.Random(seed)
    drawn = [random_expression(draw) for _ in range(count)]
    drawn += [random_chain(draw) for _ in range(count // 2)]
    texts = [text for text in drawn if has_a_value(text)]
    assert len(texts) > count
    scope = Scope(parse_tree([Card(f".param x={X} y={Y}", "a:1")], "a"))
    volts = [re.sub(r"\b([xy])\b", r"v(n\1)", text) for text in texts]
    trees = [scope.tree(text) for text in volts]
    ours = Values(trees, ["nx", "ny"])(np.zeros(1), np.array([[X], [Y]]))[:, 0]
    lines = ["deck", f"vx nx 0 {X}", f"vy ny 0 {Y}", f".nodeset v(nx)={X} v(ny)={Y}"]
    lines += [f"b{k} b{k} 0 v={text}" for k, text in enumerate(volts)]
    lines += [f"bw{k} w{k} 0 v={written(tree)}" for k, tree in enumerate(trees)]
    # ngspice's parameters know neither u nor uramp.
    plain = {k: text for k, text in enumerate(texts) if not re.search(r"\bu(ramp)?\(", text)}
    lines += [f".param x={X} y={Y}", *(f"vp{k} p{k} 0 {{{text}}}" for k, text in plain.items())]
    raw = run(tmp_path, "\n".join([*lines, ".op", ".end"]) + "\n")
    for k, text in enumerate(texts):
        found = raw[f"v(b{k})"][0], raw[f"v(w{k})"][0], ours[k]
        assert found[1:] == pytest.approx([found[0]] * 2, rel=1e-6, abs=1e-9), text
        parameters = scope.tree(text)
        assert parameters[1] == pytest.approx(found[0], rel=1e-6, abs=1e-9), text
        if k in plain:
            own = scope.value(f"{{{text}}}")
            assert own == pytest.approx(raw[f"v(p{k})"][0], rel=1e-6, abs=1e-9), text
        assert not [each for each in leaves(parameters) if each[0] == "name"]


def test_random_expressions_have_plain_ngspices_values(tmp_path):
    agree(tmp_path, 1, 200)


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(2, 42))
def test_more_random_expressions(tmp_path, seed):
    agree(tmp_path, seed, 500)
