"""Adds a load's elements to a `Builder`, one function per kind; unsupported kinds raise."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any, NoReturn

from circuits.equivalent import elements as circuit_elements
from circuits.kernel import junction, waveform
from circuits.kernel.builder import Builder
from circuits.netlist.expression import ExpressionError, renamed
from circuits.netlist.part_models import TEMPERATURE
from circuits.netlist.potentials import Potentials, levels, with_sources
from circuits.netlist.switching_events import zero_crossings
from harvester.base.errors import LoadError

if TYPE_CHECKING:
    from circuits.netlist.elements import Element
    from circuits.netlist.load_circuit import LoadCircuit

# Parameters of a diode's model that have an effect here, at any temperature.
_DIODE = {"is", "n", "rs", "bv", "ibv", "nbv", "cjo", "vj", "m", "tt", "fc", "ikf", "isr", "nr",
          "area", "eg", "xti", "tnom", "trs1", "trs2", "tm1", "tm2", "ttt1",
          "ttt2", "tcv", "tlev", "tlevc", "tpb", "cta"}  # fmt: skip
# Parameters without an effect in a transient: noise, limits that are only reported, the thermal
# path, and the temperature of a tunnel current.
_NO_PART = {"kf", "af", "level", "keg", "xtitun", "ntun", "bv_max", "fv_max", "id_max", "te_max",
            "pd_max", "rth0", "cth0"}  # fmt: skip
# Parameters of the periphery. They have no effect without a length `pj`.
_PERIPHERY = {"isw", "jsw", "ns", "cjp", "cjsw", "php", "vjsw", "mjsw", "fcs", "ikp", "ctp", "ctc",
              "tphp", "pj"}  # fmt: skip
# Parameters of a diode instance that have an effect here.
_NUMBERS = {"area", "m", "ic", "temp", "dtemp"}


def add_load(b: Builder, load: LoadCircuit, network: Any, whole: bool = True) -> None:
    """The load's elements, and the stray capacitances of its output.

    Raises
    ------
    LoadError
        An element is not supported, and the `whole` load is required.
    """
    pins = circuit_elements.load_pins(network)
    for pin in load.stray_pins:
        stray = circuit_elements.STRAY_SHARE * network.reference_capacitance
        b.capacitor(b.node(pins[pin]), -1, stray, 0.0)
    first: list[Element] = []
    later: list[Element] = []
    potentials = Potentials(load.elements)
    for element in load.elements:
        part = element._replace(nodes=tuple(pins.get(node, node) for node in element.nodes))
        if element.expression is not None:
            exact = with_sources(element.expression, potentials)
            part = part._replace(expression=renamed(exact, pins))
        if element.letter in "sw":
            low, high = levels(element, potentials)
            part = part._replace(numbers=(("low", low), ("high", high)))
        (later if element.letter in _AFTER and element.expression is None else first).append(part)
    for part in [*first, *later]:
        with contextlib.nullcontext() if whole else contextlib.suppress(LoadError, KeyError):
            add = _ADD.get(part.letter)
            if add is None:
                _refuse(part, f"an element of the letter {part.letter.upper()}")
            add(b, part)
    _finish_graph(b, whole)


def _refuse(each: Element, reason: str) -> NoReturn:
    """Raise LoadError: the compiled engine does not support this element."""
    raise LoadError(
        f"{each.where}: {each.name}: Monte Carlo does not support {reason}; use the circuit engine"
    )


def _ends(b, each):
    return [b.node(node) for node in each.nodes[:2]]


def _resistor(b, each):
    if each.size is not None:
        b.between(*_ends(b, each), conductance=1.0 / each.size)


def _capacitor(b, each):
    if each.expression is not None:
        _refuse(each, "a capacitance that changes")
    b.capacitor(*_ends(b, each), each.size or 0.0, each.get("ic"))


def _inductor(b, each):
    if each.expression is not None:
        _refuse(each, "an inductance that changes")
    b.inductor(each.name, *_ends(b, each), each.size, each.get("ic"))


def _coupling(b, each):
    b.coupling(list(each.controls), each.value)


def _diode(b, each):
    model = dict(each.model.numbers)
    flat = not each.get("pj", model.get("pj", 0.0))
    for name in {*model} - _DIODE - _NO_PART - (_PERIPHERY if flat else set()):
        _refuse(each, f"{name}= of a diode's model")
    for name, value in each.numbers:
        if name not in _NUMBERS and value:
            _refuse(each, f"{name}=")
    celsius = each.get("temp", TEMPERATURE + each.get("dtemp"))
    area = each.get("area", model.get("area", 1.0))
    row = junction.table_row(model, area, each.many, celsius)
    anode, cathode = _ends(b, each)
    if row[junction.RESISTANCE] > 0.0 and (row[junction.TRANSIT] or row[junction.CAPACITANCE]):
        # The junction is in series with its resistance, at an internal node.
        inner = b.node(f"{each.name}:inside")
        b.between(anode, inner, conductance=1.0 / row[junction.RESISTANCE])
        row[junction.RESISTANCE] = 0.0
        anode = inner
    b.junctions.append((anode, cathode, row))
    b.mark([anode, cathode], [anode, cathode])


def _switch(b, each):
    control = [b.node(node) for node in each.nodes[2:4]]
    if each.letter == "w":
        control = [_current(b, each), -1]
    siemens = (1.0 / each.model.get("roff"), 1.0 / each.model.get("ron"))
    row = (*siemens, each.get("low"), each.get("high"))
    b.switches.append(((*_ends(b, each), *control, int("on" in each.flags), 0), row))
    b.switch_names.append((each.name, each.where))
    # When a switch toggles, its entries are changed in place.
    b.between(*_ends(b, each))


def _shape(each):
    if each.wave is None:
        return each.value
    if each.wave.kind not in waveform.KINDS:
        _refuse(each, f"the waveform {each.wave.kind}")
    return waveform.shape(each.wave)


def _voltage_source(b, each):
    row = b.through(each.name, *_ends(b, each))
    b.source(row, -1.0, _shape(each))


def _current_source(b, each):
    shape = _shape(each)
    a, z = _ends(b, each)
    b.source(a, -1.0, shape)
    b.source(z, 1.0, shape)


def _controlled(b, each):
    """Add a controlled source (E, G, F or H) with a constant gain."""
    if each.expression is not None:
        _behavioural(b, each)
        return
    gain = each.value * each.many
    if each.letter in "fh":
        controls = [_current(b, each), -1]
    else:
        controls = [b.node(node) for node in each.nodes[2:4]]
    if each.voltage:
        row = b.through(each.name, *_ends(b, each))
        b.enter(row, controls[0], conductance=gain)
        b.enter(row, controls[1], conductance=-gain)
    elif each.letter == "f":
        a, z = _ends(b, each)
        b.enter(a, controls[0], conductance=gain)
        b.enter(z, controls[0], conductance=-gain)
    else:
        b.between(*_ends(b, each), conductance=gain, controls=controls)


def _current(b, each):
    """The unknown of the controlling source's current."""
    return b.unknowns[f"i({each.controls[0]})"]


def _behavioural(b, each):
    """Add a current between two nodes, or the voltage of a branch, given by an expression."""
    a, z = _ends(b, each)
    tree = each.expression
    if each.voltage:
        a, z = b.through(each.name, a, z), -1
        b.mark([a], [])
    else:
        b.mark([a, z], [])
        if each.many != 1.0:
            tree = ("*", tree, ("number", each.many))
    b.waiting.append((each, tree, a, z))


def _finish_graph(b, whole):
    """Add expressions to the graph, once all branches have their indices."""

    def unknown_of(tree):
        return b.node(tree[1]) if tree[0] == "v" else b.unknowns[f"i({tree[1]})"]

    for number, (element, tree, a, z) in enumerate(b.waiting):
        first = len(b.graph.rows)
        try:
            last = b.graph.add(tree, unknown_of)
        except ExpressionError as reason:
            if not whole:
                continue
            _refuse(element, str(reason))
        b.behavioural.append((a, z, first, last))
        for k in range(first, last + 1):
            if b.graph.rows[k][0] == 0:
                b.inputs.append((number, k, b.graph.rows[k][1]))
                b.mark([], [b.graph.rows[k][1]])
    for _, tree, _, _ in b.waiting:
        b.zero_crossings += [b.graph.add(passed, unknown_of) for passed in zero_crossings(tree)]


_ADD = {
    "r": _resistor, "c": _capacitor, "l": _inductor, "k": _coupling, "d": _diode, "s": _switch,
    "w": _switch, "v": _voltage_source, "i": _current_source, "e": _controlled,
    "g": _controlled, "f": _controlled, "h": _controlled, "b": _behavioural,
}  # fmt: skip
# Letters of elements that refer to other elements, which must be added first.
_AFTER = "kfhw"
