"""Each kind of element is drawn as what it is, its pins where its nodes are, under its name."""

import pytest
from schemdraw import Drawing, elements

from circuits.equivalent.schematic.ladder import lay_out
from circuits.equivalent.schematic.symbols import Pen, words
from circuits.netlist.topology import read_topology

MODELS = (
    ".model n nmos()\n.model p pmos()\n.model vdp vdmos(pchan vto=-1)\n.model b npn()\n"
    ".model c pnp()\n.model jn njf()\n.model jp pjf()\n.model d d()\n.model s sw()\n"
)
TOP, BOTTOM = (0.0, 0.0), (0.0, -2.0)


def placed(line, reverse=False):
    """The element of a netlist's line, drawn downwards, and its part."""
    topology = read_topology(f"{line}\n{MODELS}V0 x y 0\n")
    part = topology.parts[0]
    pen = Pen()
    pen.part(part, topology, TOP, BOTTOM, reverse)
    drawing = Drawing(show=False)
    return drawing.add(pen._steps[0](elements)), part


def at(element, anchor):
    place = element.absanchors[anchor]
    return pytest.approx((place.x, place.y), abs=1e-6)


# Line, shape, the node above and the node below, words.
KINDS = {
    "resistor": ("R1 u d 1k", "Resistor", ["R1", "1k"]),
    "capacitor": ("C1 u d 1n", "Capacitor", ["C1", "1n"]),
    "inductor": ("L1 u d 1m", "Inductor2", ["L1", "1m"]),
    "diode": ("D1 u d d", "Diode", ["D1", "d"]),
    "voltage source": ("V1 u d 5", "SourceV", ["V1", "5"]),
    "current source": ("I1 u d 1m", "SourceI", ["I1", "1m"]),
    "voltage by voltage": ("E1 u d a b 2", "SourceControlledV", ["E1", "2 · v(a, b)"]),
    "current by voltage": ("G1 u d a b 2", "SourceControlledI", ["G1", "2 · v(a, b)"]),
    "current by current": ("F1 u d V0 2", "SourceControlledI", ["F1", "2", "i(V0)"]),
    "voltage by current": ("H1 u d V0 2", "SourceControlledV", ["H1", "2", "i(V0)"]),
    "behavioural current": ("B1 u d I=v(a)", "SourceControlledI", ["B1", "of a"]),
    "of three nodes": ("B1 u d I=v(a,b)*v(c)", "SourceControlledI", ["B1", "of a, b", "and c"]),
    "behavioural voltage": ("B1 u d V=v(a)", "SourceControlledV", ["B1", "of a"]),
    "switch": ("S1 u d a b s", "Switch", ["S1", "v(a, b)"]),
    "n-channel MOSFET": ("M1 u g d d n W=1u", "NFet2", ["M1", "gate: g", "n"]),
    "its bulk": ("M1 u g d k n W=1u", "NFet2", ["M1", "gate: g", "bulk: k", "n"]),
    "p-channel MOSFET": ("M1 u g d d p", "PFet2", ["M1", "gate: g", "p"]),
    "MOSFET of three pins": ("M1 u g d vdp", "PFet2", ["M1", "gate: g", "vdp"]),
    "npn": ("Q1 u g d b 2", None, ["Q1", "base: g", "b"]),
    "npn with substrate": ("Q1 u g d k b", None, ["Q1", "base: g", "substrate: k", "b"]),
    "pnp": ("Q1 u g d c", None, ["Q1", "base: g", "c"]),
    "n-channel JFET": ("J1 u g d jn", None, ["J1", "gate: g", "jn"]),
    "p-channel JFET": ("J1 u g d jp", None, ["J1", "gate: g", "jp"]),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_is_drawn_between_its_nodes_under_its_name(kind):
    line, shape, said = KINDS[kind]
    element, part = placed(line)
    assert part.ends == ("u", "d")
    assert words(part) == said
    assert shape is None or type(element).__name__.startswith(shape)
    ends = [at(element, "start"), at(element, "end")]
    assert ends in ([TOP, BOTTOM], [BOTTOM, TOP])
    if shape in ("Diode", "SourceI", "SourceControlledI"):
        # From the anode, and the way of the current within a source.
        assert ends == [TOP, BOTTOM]
    if shape in ("SourceV", "SourceControlledV"):
        assert ends == [BOTTOM, TOP]


def arrow(element):
    """The absolute ends of a transistor's arrow."""
    (found,) = [each for each in element.segments if getattr(each, "arrow", None)]
    return [element.transform.transform(point) for point in (found.path[0], found.path[-1])]


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("kind", ["npn", "pnp", "n-channel JFET", "p-channel JFET"])
def test_a_transistors_arrow_is_that_of_its_kind(kind, reverse):
    """IEC 60617: at the emitter, away from the base of an npn; into an n channel."""
    element, _ = placed(KINDS[kind][0], reverse)
    tail, head = arrow(element)
    if kind.endswith("JFET"):
        # The gate's lead comes from the right.
        assert (head.x < tail.x) == (kind[0] == "n")
        return
    emitter = TOP if reverse else BOTTOM
    middle = 0.5 * (tail.y + head.y)
    assert abs(middle - emitter[1]) < 1.0
    away = abs(head.y - emitter[1]) < abs(tail.y - emitter[1])
    assert away == (kind == "npn")


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("kind", ["n-channel MOSFET", "p-channel MOSFET", "npn", "n-channel JFET"])
def test_a_control_lead_points_to_its_words(kind, reverse):
    element, _ = placed(KINDS[kind][0], reverse)
    lead = element.absanchors["base" if kind == "npn" else "gate"]
    assert 0.5 < lead.x < 1.5
    assert BOTTOM[1] < lead.y < TOP[1]


def test_a_transistor_stands_between_drain_and_source_and_its_gate_has_a_rail():
    parts = read_topology(f"M1 p a n n n\nR1 p a 1\nR2 a n 1\n{MODELS}").parts
    ladder = lay_out(parts, left=("p", "n"))
    (column,) = [each for each in ladder.columns if each.parts[0].name == "M1"]
    assert set(column.ends) == {"p", "n"}
    assert "a" in ladder.rows
