"""Loads drawn at random, in two spellings: both engines and plain ngspice give one output power."""

import random

import numpy as np
import pytest
from raw_files import driven

from circuits.netlist.subcircuits import read_load
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene

# A damped linear device, whose paths do not part, from rest.
DEVICE = [
    "oscillator.linear_stiffness=126.9", "oscillator.cubic_stiffness=0", "oscillator.damping=0.044",
    "run.duration=1", "run.settle=0", "run.realizations=1",
]  # fmt: skip


class Drawn:
    """One load: its lines in ngspice's spelling, and as LTspice or PSpice may write them."""

    def __init__(self, seed):
        self.draw = random.Random(seed)
        self.plain, self.other = [], []
        self.models, self.heads = [], []
        self.rectifier()
        self.output()
        for part in self.draw.sample([self.zener, self.switch, self.source, self.drain], 2):
            part()

    def add(self, plain, other=None):
        self.plain.append(plain)
        self.other.append(other or plain)

    def size(self, low, high):
        """A value of two digits, log-uniform, in two spellings."""
        exponent = self.draw.uniform(np.log10(low), np.log10(high))
        value = float(f"{10**exponent:.1e}")
        plain = f"{value:g}"
        for power, letter in ((6, "meg"), (3, "k"), (-3, "m"), (-6, "u"), (-9, "n"), (-12, "p")):
            if 1.0 <= value / 10.0**power < 1000.0:
                digits = f"{value / 10.0**power:.3g}"
                whole, _, rest = digits.partition(".")
                spelt = f"{whole}{letter}{rest}" if rest else f"{whole}{letter}"
                return plain, self.draw.choice(
                    [spelt, f"{digits}{letter}", f"{{{digits}{letter}}}"]
                )
        return plain, plain

    def diode(self):
        """A model's name."""
        draw, name = self.draw, f"dm{len(self.models)}"
        words = [
            f"is={draw.choice(['1n', '30n', '2e-14', '5u'])}",
            f"n={draw.choice([1, 1.05, 1.8])}",
        ]
        for word in ("rs=2", "cjo=20p", "tt=5n", "ikf=10m", "ikf=20u", "isr=10n nr=3", "vj=0.4",
                     "m=0.33", "eg=0.69 xti=2", "trs1=1m"):  # fmt: skip
            if draw.random() < 0.3 and not (word.startswith("ikf") and "ikf" in " ".join(words)):
                words.append(word)
        self.models.append(f".model {name} d({' '.join(words)})")
        return name

    def rectifier(self):
        draw = self.draw
        a, z = "p", "n"
        if draw.random() < 0.3:
            turns, coupled = draw.choice([0.5, 2.0, 3.0]), draw.choice([0.9, 0.99])
            self.add(f"L1 p n 40\nL2 s z {40 * turns**2:g}",
                     f"L1 p n {{20*2}}\nL2 s z {{40*{turns}*{turns}}} Rser=0")  # fmt: skip
            self.add(f"K1 L1 L2 {coupled}\nRz z n 10meg")
            a, z = "s", "z"
        kind, model = draw.choice(["half", "bridge", "doubler"]), self.diode()
        warm = draw.choice(["", "", " temp=60", " area=2", " m=2"])
        if kind == "half":
            lines = [f"D1 {a} out {model}{warm}", f"Rn ref {z} 10"]
        elif kind == "bridge":
            lines = [f"D1 {a} out {model}{warm}", f"D2 ref {a} {model}{warm}",
                     f"D3 {z} out {model}{warm}", f"D4 ref {z} {model}{warm}"]  # fmt: skip
        else:
            pump, other = self.size(2e-8, 2e-7)
            lines = [f"C1 {a} mid {{0}}", f"D1 ref mid {model}{warm}", f"D2 mid out {model}{warm}",
                     f"Rn ref {z} 10"]  # fmt: skip
            self.add(lines[0].format(pump), lines[0].format(other))
            lines = lines[1:]
        if draw.random() < 0.4:
            # In a sub-circuit of its own, with the model given beside it.
            ends = "a z out ref mid"
            inner = "\n".join(lines)
            given = f"{a} {z} out ref mid"
            for real, name in ((f" {a} ", " a "), (f" {z} ", " z ")):
                inner = inner.replace(real, name)
            self.heads.append(f".subckt rect {ends} r=1meg\n{inner}\nRx a z {{r}}\n.ends")
            self.add(f"X1 {given} rect r=3meg", f"X1 {given} rect params: r={{1meg*3}}")
            if kind != "doubler":
                self.add("Rmid mid n 1meg")
        else:
            self.add("\n".join(lines))

    def output(self):
        (r, other_r), (c, other_c) = self.size(3e4, 1e6), self.size(3e-8, 5e-7)
        self.add(f"Rout out ref {r}", f"Rout out ref R={other_r} tol=1")
        self.add(f"Cout out ref {c}", f"Cout out ref {other_c} Rser=0")
        self.add("Cs ref n 10p")

    def zener(self):
        volts = self.draw.choice([3.3, 5.1, 12.0])
        ibv = self.draw.choice(["", " ibv=10u", " nbv=2"])
        self.models.append(f".model zm d(is=1n bv={volts}{ibv} rs=5)")
        self.add("Dz ref out zm")

    def switch(self):
        draw = self.draw
        level, half = draw.choice([0.5, 1.0, 3.0]), draw.choice([0.1, 0.3])
        r, other = self.size(1e4, 2e5)
        self.add(f"Rs out sw {r}", f"Rs out sw {other}")
        kind = draw.choice(["v", "w", "smooth", "clock"])
        if kind == "v":
            self.add(f"S1 sw ref out ref sm{draw.choice(['', ' off', ' on'])}")
            self.models.append(f".model sm sw(ron=100 roff=100meg vt={level} vh={half})")
        elif kind == "w":
            self.add("Va out oa 0\nRa oa ref 200k\nW1 sw ref Va wm")
            self.models.append(f".model wm csw(ron=100 roff=100meg it={level * 3:g}u ih={half:g}u)")
        elif kind == "smooth":
            # Its law by hand in ngspice's spelling.
            low, high = level - half, level + half
            x = f"min(max((v(out,ref)-{low:g})/{high - low:g},0),1)"
            self.add(f"Bs sw ref i=v(sw,ref)*exp(ln(100k/1k)*{x}*{x}*(3-2*{x}))/100k",
                     "S1 sw ref out ref sm")  # fmt: skip
            name = draw.choice([f"sw(vt={level} vh=-{half}", f"vswitch(von={high:g} voff={low:g}"])
            self.models.append(f".model sm {name} ron=1k roff=100k)")
        else:
            self.add("Vc ck ref pulse(0 1 3m 10u 10u 7m 20m)")
            self.add("S1 sw ref ck ref sm")
            self.models.append(".model sm sw(ron=100 roff=100meg vt=0.5 vh=0.2)")

    def source(self):
        draw = self.draw
        kind = draw.choice(["bias", "sine", "buffer", "gain"])
        if kind == "bias":
            self.add("Vb b ref 1\nRb b out 200k", "Vb b ref DC 1 AC 1\nRb b out 0.2meg")
        elif kind == "sine":
            self.add("Is ref out sin(1u 1u 30)", "Is ref out SINE(1u 1u 30)")
        elif kind == "buffer":
            self.add(
                "E1 e ref out ref 0.5\nRe e out 300k", "E1 e ref (out,ref) {1/2}\nRe e out 300k"
            )
        else:
            self.add("G1 out ref out ref 2u", "G1 out ref VALUE {2u*v(out,ref)}")

    def drain(self):
        self.add(
            *self.draw.choice(
                [
                    ("Bd out ref i=v(out,ref)>2 ? (v(out,ref)-2)*10u : 0",
                     "Bd out ref i=if(v(out,ref)>2,(v(out,ref)-2)*10u,0)"),
                    ("Bd out ref i=1u*pow(v(out,ref),2)", "Bd out ref i=1u*v(out,ref)**2"),
                    ("Bd out ref i=2u*tanh(v(out,ref))", "Bd out ref i={q*tanh(v(out,ref))}"),
                    ("Rdd out rd 1\nRd rd ref {100k*(1+v(out,ref)^2)}",
                     "Rdd out rd 1\nRd rd ref {f(v(out,ref))}"),
                    ("Bd out ref i=max(min(v(out,ref),1),0)*3u",
                     "Bd out ref i=limit(v(out,ref),0,1)*3u"),
                ]
            )
        )  # fmt: skip

    def text(self, other):
        lines = self.other if other else self.plain
        head = "* dialect: ltspice\n.param q={4u/2}\n.func f(x) {100k*(1+x*x)}\n" if other else ""
        if not other and any("Bs sw" in line for line in lines):
            models = [model for model in self.models if not model.startswith(".model sm")]
        else:
            models = self.models
        inner = "\n".join([*models, *self.heads])
        return f"{head}{inner}\n.subckt load p n out ref\n" + "\n".join(lines) + "\n.ends\n"


def loads(folder, seed):
    """The load's file in both spellings."""
    drawn = Drawn(seed)
    paths = []
    for name, other in (("plain", False), ("other", True)):
        (folder / name).mkdir(exist_ok=True)
        path = folder / name / "load.lib"
        path.write_text(drawn.text(other))
        paths.append(path)
    return paths


def run(path, method, **options):
    scene = Scene.read("device", [*DEVICE, f"load.netlist={path}"])
    return simulate(scene, method=method, **options)


def power(result):
    return result.quantity("mean_output_power").estimate


# Outputs of nanowatts behind junctions that hardly conduct: at `fine` steps cost either engine 1 to
# 12 %, and a note says so; at `finest` they agree to 0.7 %.
FAINT = {90, 167, 200, 208}
# The circuit stops, with its reason, at a switch that turns over and over.
STOPS = pytest.mark.xfail(reason="a switch turns over and over", strict=True)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "seed", [pytest.param(seed, marks=STOPS if seed == 149 else ()) for seed in range(300)]
)
def test_engines_spellings_and_plain_ngspice_agree(pool, tmp_path, seed):
    plain, other = loads(tmp_path, seed)
    theirs = driven(tmp_path, plain.read_text())
    assert driven(tmp_path, read_load(plain).run_text) == pytest.approx(theirs, rel=1e-2)
    assert driven(tmp_path, read_load(other).run_text) == pytest.approx(theirs, rel=1e-2)
    circuit = run(plain, "circuit", step="fine", runner=pool)
    for path in (plain, other):
        ours = run(path, "monte-carlo", step="fine", runner=pool)
        noted = [any("per cent" in note for note in each.notes) for each in (ours, circuit)]
        # Outputs below the note's limit may agree all the same.
        if seed in FAINT:
            assert noted == [True, True]
        else:
            assert power(ours) == pytest.approx(power(circuit), rel=1e-2), path.read_text()
