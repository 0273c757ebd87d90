"""Names of a load's file: whatever a user calls a part, both engines build the same circuit."""

import re
import string

import numpy as np
import pytest
from raw_files import driven

from circuits.kernel.assembly import build
from circuits.netlist.subcircuits import read_load
from circuits.netlist.writer import node_name
from harvester.base.errors import HarvesterError
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared

# A load with an element of each kind that the compiled engine takes. Words in angle brackets are
# names.
LOAD = """\
.func <function>(x) {2*x}
.param <parameter>=1k
.subckt <called> a <inner pin> <inner parameter>=1k
R<r> a <inner node> {<inner parameter>}
C<c> <inner node> <inner pin> 10n
.ends
.subckt load p n out ref
.model <model> d(is=1n n=1.5 rs=10 tt=1n)
.model <switch model> sw(vt=0.4 vh=0.1 ron=1k roff=1meg)
.model fixedmodel csw(it=1u ih=0.1u ron=1k roff=1meg)
D<d> p out <model>
D2<d> ref p <model>
Rn n ref {<function>(<parameter>)}
Cout out ref 100n
Rout out ref 100k
X<x> out ref <called> <inner parameter>=2k
R<r> out <node> 50k
V<v> <node> <other node> 0
R2<r> <other node> ref {50*<parameter>}
L<l> out <coil> 10
L2<l> <second> ref 10
K<k> L<l> L2<l> 0.5
Rfixedc <coil> ref 1meg
Rfixedd <second> ref 1meg
E<e> fixede ref <node> ref 0.5
Rfixede fixede ref 1meg
H<h> fixedh ref V<v> 1k
Rfixedh fixedh ref 1meg
F<f> out ref V<v> 0.1
G<g> out ref <node> ref 1u
B<b> out ref i=v(<node>,ref)*1u+i(V<v>)*0.1
S<s> out fixeds ref <node> <switch model>
Rfixeds fixeds ref 100k
W<w> out fixedw V<v> fixedmodel
Rfixedw fixedw ref 100k
I<i> ref out 10n
.ends
"""
PLACES = list(dict.fromkeys(re.findall(r"<([^<>]+)>", LOAD)))
# Names of nodes and elements, then those that a definition may have.
ODD = """
a+b a_2b_b a_2b+ a+2b_ a_5f_2b_b 1.5 x.y v.a 5 1e3 10k a#b p#branch a-b -- oad load load_piezo
load_out load_ref piezo device 0device noise velocity displacement d1 inside xload xcopy0 x1.r1
n1 out_ stray_out excited pi e hertz exp sgn i v temper b if and time param subckt gnd_ _ __
_2b_
"""
PLAIN = """
load_piezo device resistor u2 a_2b_b w m l c1 xload tc1 area sin pulse dc ic temp _ vt sw d dm
npn value vcc
"""


def text_with(**names):
    """The load's text; what is not given has a plain name."""
    plain = {place: f"{place[0]}{k}z" for k, place in enumerate(PLACES)}
    said = plain | {key.replace("_", " "): name for key, name in names.items()}
    return re.sub(r"<([^<>]+)>", lambda found: said[found[1]], LOAD)


def drawn(rng, place):
    """A legal name for a place."""
    definition = place in ("function", "parameter", "inner parameter", "model", "called",
                           "switch model")  # fmt: skip
    if rng.random() < 0.6:
        return str(rng.choice((PLAIN if definition else ODD).split()))
    letters = string.ascii_lowercase + "_" + ("" if definition else string.digits + "_+-.#")
    return "".join(rng.choice([*letters], size=rng.integers(2, 8)))


def tables(path):
    """The compiled engine's tables of the load behind a device."""
    scene = Scene.read("device", [f"load.netlist={path}"])
    return build(prepared(scene)).tables


def renamed(folder, rng, count):
    """Some places renamed, `count` times: (names, whether the tables are right, ratio of answers).

    The answer is that of ngspice for the text that the circuit runs, over that for the plain names.
    """
    path = folder / "load.lib"
    path.write_text(text_with())
    right, answer = tables(path), driven(folder, path.read_text())
    for _ in range(count):
        names = {}
        for place in rng.choice(PLACES, size=6, replace=False):
            name = drawn(rng, place)
            if name not in names.values():
                names[place.replace(" ", "_")] = name
        path.write_text(text_with(**names))
        try:
            found = tables(path)
        except HarvesterError as refusal:
            yield names, "load.lib:" in str(refusal), 1.0
            continue
        same = all(np.array_equal(one, other) for one, other in zip(found, right, strict=True))
        yield names, same, driven(folder, read_load(path).run_text) / answer


@pytest.mark.slow
def test_a_few_names(tmp_path):
    for names, same, ratio in renamed(tmp_path, np.random.default_rng(3), 12):
        assert same, names
        assert ratio == pytest.approx(1.0, rel=1e-6), names


@pytest.mark.exhaustive
def test_many_names(tmp_path):
    for names, same, ratio in renamed(tmp_path, np.random.default_rng(4), 500):
        assert same, names
        assert ratio == pytest.approx(1.0, rel=1e-6), names


def test_nodes_names_stay_different():
    names = [*ODD.split(), "a_2b_2b_", "_5f_", "_5f_5f_", "a__2b_", "a_+", "_+_"]
    assert len({node_name(name) for name in {*names}}) == len({*names})
