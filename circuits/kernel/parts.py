"""A load's elements into a `Builder`, each kind by one function; refused is what is not taken."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from circuits import elements as circuit_elements
from circuits.kernel import junction, waveform
from circuits.kernel.builder import Builder
from circuits.kernel.flattening import Place, elements
from circuits.kernel.formula import NotTaken

if TYPE_CHECKING:
    from circuits.loads.subcircuits import LoadCircuit

# What a diode's model may say that takes no part at 27 °C in a transient.
_NO_PART = {"kf", "af", "xti", "eg", "tnom", "tref", "trs", "trs1", "trs2", "tbv1", "tm1", "tm2",
            "tcv", "level", "bv_max", "fv_max", "id_max", "te_max", "pd_max"}  # fmt: skip
_DIODE = {"is", "n", "rs", "bv", "ibv", "nbv", "cjo", "cj0", "vj", "m", "tt", "fc"}
# Threshold and half the hysteresis in a switch's model.
_LEVELS = {"s": ("vt", "vh"), "w": ("it", "ih")}
_PASSIVE = {"m", "scale", "ic", "tc", "tc1", "tc2", "noisy", "r", "c", "l"}


def add_load(b: Builder, load: LoadCircuit, network: Any) -> None:
    """Every element of the load, and the stray capacitances of its output."""
    pins = circuit_elements.load_pins(network)
    for pin in ("out", "ref") if load.has_output else ():
        stray = circuit_elements.STRAY_SHARE * network.reference_capacitance
        b.capacitor(b.node(pins[pin]), -1, stray, 0.0)
    names = {name.split(".xload.", 1)[1] for name in (*load.output_resistors, *load.storage)}
    later = []
    for place in elements(load, pins):
        add = _ADD.get(place.letter)
        if add is None:
            place.refuse(f"an element of the letter {place.letter.upper()}")
        if place.letter in _AFTER:
            later.append((add, place))
        else:
            value = add(b, place)
            if place.name in names:
                b.output[place.letter][place.name] = value
    for add, place in later:
        add(b, place)
    _finish_tape(b)


def _ends(b, place, count=2):
    return [b.node(node) for node in place.nodes[:count]]


def _passive(place):
    """Value and multiplier of R, C or L, and what it starts with."""
    pairs = place.pairs()
    for name in pairs:
        if name not in _PASSIVE:
            place.refuse(f"{name}=")
    for word in place.plain():
        if re.fullmatch(r"[a-z_]\w*", word):
            place.refuse(f"a model of {place.letter.upper()}")
    factor = place.value(pairs["scale"]) if "scale" in pairs else 1.0
    many = place.value(pairs["m"]) if "m" in pairs else 1.0
    start = place.value(pairs["ic"]) if "ic" in pairs else 0.0
    return place.value(place.size()) * factor, many, start


def stored(place: Place) -> tuple[float, Any]:
    """Capacitance (F) or inductance (H), multiples counted, and what it starts with (V or A).

    Raises
    ------
    LoadError
        It is no number, or a model's, or a coil is there no times.
    """
    value, many, start = _passive(place)
    if place.letter == "l" and many == 0.0:
        place.refuse("m=0")
    return (value * many if place.letter == "c" else value / many), start


def hysteresis(place: Place, model: dict[str, float]) -> tuple[float, float]:
    """Control (V, or A of a W) below which a switch opens, and that above which it closes."""
    threshold, width = _LEVELS[place.letter]
    middle, half = model.get(threshold, 0.0), model.get(width, 0.0)
    return middle - half, middle + half


def _resistor(b, place):
    value, many, _ = _passive(place)
    if value == 0.0:
        place.refuse("a resistance of 0")
    if many == 0.0:
        return 0.0
    b.between(*_ends(b, place), conductance=many / value)
    return value / many


def _capacitor(b, place):
    value, start = stored(place)
    b.capacitor(*_ends(b, place), value, start)
    return value


def _inductor(b, place):
    value, start = stored(place)
    if value <= 0.0:
        place.refuse(f"an inductance of {value:g}")
    b.inductor(place.name, *_ends(b, place), value, start)
    return value


def _coupling(b, place):
    *names, share = place.plain()
    full = [place.scope.path + name for name in names]
    b.coupling(full, place.value(share))


def _diode(b, place):
    plain = place.plain()
    kind, model, _ = place.model(plain[0])
    if kind != "d":
        place.refuse(f"a diode with a model of {kind}")
    for name in model:
        if name not in _DIODE | _NO_PART:
            place.refuse(f"{name}= of a diode's model")
    if model.get("tnom", model.get("tref", 27.0)) != 27.0:
        place.refuse("tnom= other than 27")
    if model.get("level", 1.0) != 1.0:
        place.refuse("level= other than 1")
    pairs = place.pairs()
    for name in pairs:
        if name not in ("area", "m", "ic"):
            place.refuse(f"{name}=")
    area = place.value(plain[1]) if len(plain) > 1 and plain[1] not in ("on", "off") else 1.0
    area *= place.value(pairs["area"]) if "area" in pairs else 1.0
    many = place.value(pairs["m"]) if "m" in pairs else 1.0
    if not (model.get("is", 1e-14) > 0.0 and model.get("n", 1.0) > 0.0 and area * many > 0.0):
        place.refuse("a saturation current, emission coefficient or area that is not positive")
    if not (0.0 <= model.get("m", 0.5) < 1.0 and 0.0 <= model.get("fc", 0.5) < 1.0):
        place.refuse("m= or fc= outside 0 … 1")
    row = junction.table_row(model, area, many)
    anode, cathode = _ends(b, place)
    if row[junction.RESISTANCE] > 0.0 and (row[junction.TRANSIT] or row[junction.CAPACITANCE]):
        # The junction's charge does not pass its series resistance at once.
        inner = b.node(f"{place.name}#inside")
        b.between(anode, inner, conductance=1.0 / row[junction.RESISTANCE])
        row[junction.RESISTANCE] = 0.0
        anode = inner
    b.junctions.append((anode, cathode, row))
    b.mark([anode, cathode], [anode, cathode])


def _switch(b, place):
    plain = place.plain()
    by_current = place.letter == "w"
    if by_current:
        control = [_current(b, place, plain.pop(0)), -1]
    else:
        control = [b.node(node) for node in place.nodes[2:4]]
    kind, model, _ = place.model(plain[0])
    if kind != ("csw" if by_current else "sw"):
        place.refuse(f"a switch with a model of {kind}")
    for name in model:
        if name not in (*_LEVELS[place.letter], "ron", "roff"):
            place.refuse(f"{name}= of a switch's model")
    low, high = hysteresis(place, model)
    if high < low:
        place.refuse(f"a negative hysteresis {_LEVELS[place.letter][1]}=")
    row = (1.0 / model.get("roff", 1e12), 1.0 / model.get("ron", 1.0), low, high)
    closed = "on" in plain[1:]
    b.switches.append(((*_ends(b, place), *control, int(closed), 0), row))
    b.switch_names.append((place.name, place.where))
    # Its entries are changed in place.
    b.between(*_ends(b, place))


def _voltage_source(b, place):
    row = b.through(place.name, *_ends(b, place))
    b.source(row, -1.0, waveform.read(place))


def _current_source(b, place):
    shape = waveform.read(place)
    a, z = _ends(b, place)
    b.source(a, -1.0, shape)
    b.source(z, 1.0, shape)


def _expression(place):
    for word in place.words:
        name, _, text = word.partition("=")
        if name in ("value", "vol", "cur"):
            return text.strip("{}")
    return None


def _voltage_controlled(b, place):
    """E and G."""
    text = _expression(place)
    voltage = place.letter == "e"
    if text is not None:
        _add_behavioural(b, place, text, voltage)
        return
    gain = place.value(place.plain()[-1])
    controls = [b.node(node) for node in place.nodes[2:4]]
    if voltage:
        row = b.through(place.name, *_ends(b, place))
        b.enter(row, controls[0], conductance=gain)
        b.enter(row, controls[1], conductance=-gain)
    else:
        b.between(*_ends(b, place), conductance=gain, controls=controls)


def _current_controlled(b, place):
    """F and H."""
    text = _expression(place)
    if text is not None:
        _add_behavioural(b, place, text, place.letter == "h")
        return
    source, gain = place.plain()
    control, size = _current(b, place, source), place.value(gain)
    if place.letter == "h":
        row = b.through(place.name, *_ends(b, place))
        b.enter(row, control, conductance=size)
    else:
        a, z = _ends(b, place)
        b.enter(a, control, conductance=size)
        b.enter(z, control, conductance=-size)


def _current(b, place, source):
    """The unknown that is the current of a source of the same sub-circuit."""
    name = f"i({place.scope.path}{source})"
    if name not in b.unknowns:
        place.refuse(f"the current of {source}, which is no unknown: only that of V, E, H or L is")
    return b.unknowns[name]


def _behavioural(b, place):
    which, _, text = " ".join(place.words).partition("=")
    _add_behavioural(b, place, text, which == "v")


def _add_behavioural(b, place, text, voltage):
    """A current between two nodes, or the voltage of a branch, by an expression."""
    a, z = _ends(b, place)
    if voltage:
        a, z = b.through(place.name, a, z), -1
        b.mark([a], [])
    else:
        b.mark([a, z], [])
    b.waiting.append((place, place.tree(text), a, z))


def _finish_tape(b):
    """Expressions onto the tape, once all branches have their places."""

    def unknown_of(tree):
        if tree[0] == "v":
            return b.node(tree[1])
        name = f"i({tree[1]})"
        if name not in b.unknowns:
            raise NotTaken(f"i({tree[1]}), which is no unknown: only that of a V, E, H or L is")
        return b.unknowns[name]

    for number, (place, tree, a, z) in enumerate(b.waiting):
        first = len(b.tape.rows)
        try:
            last = b.tape.add(tree, unknown_of)
        except NotTaken as reason:
            place.refuse(str(reason))
        b.behavioural.append((a, z, first, last))
        for k in range(first, last + 1):
            if b.tape.rows[k][0] == 0:
                b.inputs.append((number, k, b.tape.rows[k][1]))
                b.mark([], [b.tape.rows[k][1]])


_ADD = {
    "r": _resistor, "c": _capacitor, "l": _inductor, "k": _coupling, "d": _diode, "s": _switch,
    "w": _switch, "v": _voltage_source, "i": _current_source, "e": _voltage_controlled,
    "g": _voltage_controlled, "f": _current_controlled, "h": _current_controlled,
    "b": _behavioural,
}  # fmt: skip
# Those that name others.
_AFTER = "kfhw"
