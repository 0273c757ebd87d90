"""A device's transducer and its load as tables of numbers, from which one compiled solver works.

Unknowns are the voltages of all nodes, the currents of inductors and of elements that set a
voltage, and, last, the velocity X'. They obey d/dt [C y + q(y)] + G y + i(y) = s(t), in A and V; the
velocity's row is a power per velocity (W s per scaled length), so that every row times its unknown
is a power.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from circuits import elements as circuit_elements
from circuits.kernel import junction, waveform
from circuits.kernel.flattening import Place, elements
from circuits.kernel.formula import NotTaken
from circuits.kernel.linear import Order, order_of
from circuits.kernel.tape import Tape
from harvester.device import timescales
from harvester.device.terminals import GROUND, LOAD_AMMETER
from harvester.scene.units import scale, setting

if TYPE_CHECKING:
    from circuits.loads.subcircuits import LoadCircuit
    from harvester.scene.model import Scene

# In front of the names of the device's nodes, so that none of a load's is one of them.
DEVICE = "device:"
# What a diode's model may say that takes no part at 27 °C in a transient.
_NO_PART = {"kf", "af", "xti", "eg", "tnom", "tref", "trs", "trs1", "trs2", "tbv1", "tm1", "tm2",
            "tcv", "level", "bv_max", "fv_max", "id_max", "te_max", "pd_max"}  # fmt: skip
_DIODE = {"is", "n", "rs", "bv", "ibv", "nbv", "cjo", "cj0", "vj", "m", "tt", "fc"}
_PASSIVE = {"m", "scale", "ic", "tc", "tc1", "tc2", "noisy", "r", "c", "l"}


class Tables(NamedTuple):
    """Arrays of a circuit with n unknowns; places of unknowns are int64, n stands for ground.

    Attributes
    ----------
    entries : (k, 2) rows and columns of `capacity` and `conductance`, both (k,).
    steady : (n,) constant sources, s of the equation.
    sources : (k, 2) row and shape of a changing source, `waves` (k, waveform.COLUMNS) its numbers.
    corners : (k, 2) corners of sources drawn through points, one after another.
    junctions : (k, 2) anode and cathode, `junction_values` (k, junction.COLUMNS).
    switches : (k, 6) nodes, nodes that control it (or a current and ground), initial state, sort;
        `switch_values` (k, 4) conductance off and on, control voltage below which it opens and
        above which it closes.
    tape : (k, 4) operations, `tape_values` (k,) their constants.
    behavioural : (k, 4) row it adds to, row it takes from, first operation, place of its value;
        `inputs` (k, 3) which of them, place on the tape, unknown.
    nonlinear_rows, nonlinear_columns : (n,) whether what is not linear stands there.
    start : (2, n) y at the beginning, and what one volt or ampere of the transducer's state adds.
    """

    entries: np.ndarray
    capacity: np.ndarray
    conductance: np.ndarray
    steady: np.ndarray
    sources: np.ndarray
    waves: np.ndarray
    corners: np.ndarray
    junctions: np.ndarray
    junction_values: np.ndarray
    switches: np.ndarray
    switch_values: np.ndarray
    tape: np.ndarray
    tape_values: np.ndarray
    behavioural: np.ndarray
    inputs: np.ndarray
    nonlinear_rows: np.ndarray
    nonlinear_columns: np.ndarray
    start: np.ndarray


class Probes(NamedTuple):
    """Where a record's quantities stand among the unknowns, and their units.

    Attributes
    ----------
    places : int64, shape (5,): terminal, load's current, transducer's state, output, reference.
    units : float64, shape (5,): scaled values of a volt, of the state's volt or ampere, of an
        ampere, of a watt, and the joules of a unit of mechanical energy's row.
    energy : (capacitance (F), volts) by which a store of energy counts as small.
    """

    places: np.ndarray
    units: np.ndarray
    energy: tuple[float, float]


class Circuit(NamedTuple):
    """What `build` gives.

    Attributes
    ----------
    tables, probes
    order : of elimination.
    names : of the unknowns, for messages.
    switches : (name, "file:line") of each switch.
    conductance, capacitance : across the output (S, F).
    """

    tables: Tables
    probes: Probes
    order: Order
    names: tuple[str, ...]
    switches: tuple[tuple[str, str], ...]
    conductance: float
    capacitance: float


class _Builder:
    """Collects elements; every method adds one kind."""

    def __init__(self) -> None:
        self.unknowns: dict[str, int] = {}
        self.entries: dict[tuple[int, int], list[float]] = {}
        self.steady: dict[int, float] = {}
        self.waves, self.corners = [], []
        self.junctions, self.switches, self.switch_names = [], [], []
        self.tape, self.behavioural, self.waiting = Tape(), [], []
        self.nonlinear: set[tuple[str, int]] = set()
        self.initial: list[tuple[int, int, float, float]] = []
        self.inductances: dict[str, float] = {}

    def node(self, name):
        """The place of a node's voltage; −1 for ground."""
        return -1 if name == GROUND else self.unknowns.setdefault(name, len(self.unknowns))

    def branch(self, name):
        """The place of a branch's current."""
        return self.unknowns.setdefault(f"i({name})", len(self.unknowns))

    def enter(self, row, column, capacity=0.0, conductance=0.0):
        if row >= 0 and column >= 0:
            entry = self.entries.setdefault((row, column), [0.0, 0.0])
            entry[0] += capacity
            entry[1] += conductance

    def between(self, a, b, capacity=0.0, conductance=0.0, controls=None):
        """An admittance between two nodes, or from two to others that control it."""
        for row, sign in ((a, 1.0), (b, -1.0)):
            for column, other in zip(controls or (a, b), (1.0, -1.0), strict=True):
                self.enter(row, column, sign * other * capacity, sign * other * conductance)

    def capacitor(self, a, b, value, start):
        self.between(a, b, capacity=value)
        self.initial.append((a, b, start, abs(value)))

    def through(self, name, a, b):
        """A branch whose current is an unknown; its row is the voltage across it."""
        row = self.branch(name)
        for node, sign in ((a, 1.0), (b, -1.0)):
            self.enter(node, row, conductance=sign)
            self.enter(row, node, conductance=-sign)
        return row

    def inductor(self, name, a, b, value, start):
        row = self.through(name, a, b)
        self.enter(row, row, capacity=value)
        self.inductances[name] = value
        self.initial.append((row, -1, start, value))

    def coupling(self, names, share):
        for k, first in enumerate(names):
            for second in names[k + 1 :]:
                mutual = share * (self.inductances[first] * self.inductances[second]) ** 0.5
                one, other = self.branch(first), self.branch(second)
                self.enter(one, other, capacity=mutual)
                self.enter(other, one, capacity=mutual)

    def source(self, row, sign, shape):
        """A source, constant or changing, on the right-hand side of a row."""
        if row < 0:
            return
        if isinstance(shape, float):
            self.steady[row] = self.steady.get(row, 0.0) + sign * shape
        else:
            kind, numbers, corners = shape
            first = len(self.corners)
            self.corners += corners
            self.waves.append((row, kind, sign, first, len(self.corners), *numbers))

    def mark(self, rows, columns):
        self.nonlinear |= {("row", place) for place in rows}
        self.nonlinear |= {("column", place) for place in columns}


def build(scene: Scene) -> Circuit:
    """The tables of a scene's transducer with its load.

    Parameters
    ----------
    scene : Scene
        Whose load is a netlist.

    Returns
    -------
    Circuit

    Raises
    ------
    LoadError
        The load holds what the compiled engine does not take; the message says where.
    """
    system, scales = scale(scene)
    load = scene.load.circuit
    rate = timescales.angular_frequency(system)
    network = scene.transducer.network(setting(scene), system.transducer, rate)
    b = _Builder()
    inside = b.node(DEVICE + network.terminal)
    outside = b.node(circuit_elements.behind_ammeter(network))
    ammeter = b.through(LOAD_AMMETER, inside, outside)
    _add_load(b, load, network)
    places = [b.node(name) for name in (circuit_elements.OUTPUT, circuit_elements.REFERENCE)]
    row_unit = 1.0 / network.power_unit if network.power_unit > 0.0 else 1.0
    velocity = _add_transducer(b, network, scales, row_unit)
    state = _state(b, network, ammeter)
    b.initial = [each for each in b.initial if each[3] != 0.0]
    tables = _tables(b, velocity)
    probes = Probes(
        np.array([inside, ammeter, state, *places]),
        np.array(
            [
                1.0 / scales.voltage,
                1.0 / network.state_unit,
                network.current_per_ampere,
                network.power_unit,
                row_unit,
            ]
        ),
        (network.reference_capacitance, scales.voltage),
    )
    return Circuit(
        tables,
        probes,
        order_of(tables),
        (*b.unknowns, "X'"),
        tuple(b.switch_names),
        *_across(b, load),
    )


def with_start(circuit: Circuit, state: float, state_unit: float) -> np.ndarray:
    """Unknowns at the beginning with the transducer's state (scaled); shape (n,)."""
    return circuit.tables.start[0] + state * state_unit * circuit.tables.start[1]


def _state(b, network, ammeter):
    if network.state_current:
        return ammeter
    return b.node(DEVICE + network.state_voltage) if network.state_voltage else -1


def _add_transducer(b, network, scales, row_unit):
    """Elements of the transducer; returns the place of the velocity, the last unknown."""
    nodes = {name: b.node(DEVICE + name) for name in sorted(network.nodes)}
    nodes[GROUND] = -1
    b.branch(LOAD_AMMETER)
    for each in network.elements:
        if each.kind == "inductor":
            b.branch(DEVICE + each.name)
        elif each.kind in ("ammeter", "moving voltage"):
            b.branch(each.name if each.kind == "ammeter" else DEVICE + each.name)
    velocity = len(b.unknowns)
    for each in network.elements:
        _add_part(b, each, nodes, velocity, scales, row_unit)
    b.enter(velocity, velocity, capacity=row_unit)
    b.mark([velocity], [velocity])
    return velocity


def _add_part(b, each, nodes, velocity, scales, row_unit):
    a, z = nodes.get(each.plus, -1), nodes.get(each.minus, -1)
    if each.kind == "resistor":
        b.between(a, z, conductance=1.0 / each.value)
    elif each.kind == "capacitor":
        b.capacitor(a, z, each.value, "state" if each.holds_state else 0.0)
    elif each.kind == "inductor":
        b.inductor(DEVICE + each.name, a, z, each.value, "state" if each.holds_state else 0.0)
    elif each.kind == "ammeter":
        b.through(each.name, a, z)
    elif each.kind == "moving voltage":
        row = b.through(DEVICE + each.name, a, z)
        b.enter(row, velocity, conductance=each.value)
    elif each.kind == "moving current":
        b.enter(a, velocity, conductance=-each.value)
        b.enter(z, velocity, conductance=each.value)
    elif each.kind == "force of voltage":
        gain = row_unit * each.value / scales.voltage
        b.enter(velocity, a, conductance=gain)
        b.enter(velocity, z, conductance=-gain)
    elif each.kind == "force of current":
        b.enter(velocity, b.branch(each.plus), conductance=row_unit * each.value)
    else:
        raise ValueError(f"{each.name}: no element of a circuit is a {each.kind!r}")


def _add_load(b: _Builder, load: LoadCircuit, network: Any) -> None:
    """Every element of the load, and the stray capacitances of its output."""
    pins = {
        "p": circuit_elements.behind_ammeter(network), "n": GROUND,
        "out": circuit_elements.OUTPUT, "ref": circuit_elements.REFERENCE,
    }  # fmt: skip
    for pin in ("out", "ref") if load.has_output else ():
        stray = circuit_elements.STRAY_SHARE * network.reference_capacitance
        b.capacitor(b.node(pins[pin]), -1, stray, 0.0)
    b.output = {"r": {}, "c": {}}
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


def _across(b, load):
    """Conductance (S) and capacitance (F) of what lies across the output."""
    siemens = sum(max(1.0 / value, 0.0) for value in b.output["r"].values() if value)
    return siemens, sum(b.output["c"].values())


def _ends(b, place, count=2):
    return [b.node(node) for node in place.nodes[:count]]


def _passive(place, key):
    """Value and multiplier of R, C or L."""
    pairs, plain = place.pairs(), place.plain()
    for name in pairs:
        if name not in _PASSIVE:
            place.refuse(f"{name}=")
    for word in plain:
        if re.fullmatch(r"[a-z_]\w*", word):
            place.refuse(f"a model of {place.letter.upper()}")
    text = plain[0] if plain else pairs[key]
    factor = place.value(pairs["scale"]) if "scale" in pairs else 1.0
    many = place.value(pairs["m"]) if "m" in pairs else 1.0
    start = place.value(pairs["ic"]) if "ic" in pairs else 0.0
    return place.value(text) * factor, many, start


def _resistor(b, place):
    value, many, _ = _passive(place, "r")
    if value == 0.0:
        place.refuse("a resistance of 0")
    if many == 0.0:
        return 0.0
    b.between(*_ends(b, place), conductance=many / value)
    return value / many


def _capacitor(b, place):
    value, many, start = _passive(place, "c")
    b.capacitor(*_ends(b, place), value * many, start)
    return value * many


def _inductor(b, place):
    value, many, start = _passive(place, "l")
    if value <= 0.0:
        place.refuse(f"an inductance of {value:g}")
    b.inductor(place.name, *_ends(b, place), value / many, start)
    return value / many


def _coupling(b, place):
    *names, share = place.plain()
    full = [place.scope.path + name for name in names]
    for name in full:
        if name not in b.inductances:
            place.refuse(f"a coupling with {name}, which is no inductor of its sub-circuit")
    size = place.value(share)
    if not abs(size) <= 1.0:
        place.refuse(f"a coupling of {size:g}")
    b.coupling(full, size)


def _diode(b, place):
    plain = place.plain()
    kind, model, _ = place.scope.model(plain[0])
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
    for name in ("area", "m"):
        area *= place.value(pairs[name]) if name in pairs else 1.0
    if not (model.get("is", 1e-14) > 0.0 and model.get("n", 1.0) > 0.0 and area > 0.0):
        place.refuse("a saturation current, emission coefficient or area that is not positive")
    if not (0.0 <= model.get("m", 0.5) < 1.0 and 0.0 <= model.get("fc", 0.5) < 1.0):
        place.refuse("m= or fc= outside 0 … 1")
    row = junction.table_row(model, area)
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
    kind, model, _ = place.scope.model(plain[0])
    if kind != ("csw" if by_current else "sw"):
        place.refuse(f"a switch with a model of {kind}")
    threshold, width = ("it", "ih") if by_current else ("vt", "vh")
    for name in model:
        if name not in (threshold, width, "ron", "roff"):
            place.refuse(f"{name}= of a switch's model")
    middle, half = model.get(threshold, 0.0), model.get(width, 0.0)
    if half < 0.0:
        place.refuse(f"a negative hysteresis {width}=")
    row = (1.0 / model.get("roff", 1e12), 1.0 / model.get("ron", 1.0), middle - half, middle + half)
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

    b.inputs = []
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


def _tables(b, velocity):
    n = velocity + 1
    if len(b.unknowns) != velocity:
        raise ValueError("an unknown was added behind the velocity")
    rows = sorted(b.entries)
    steady = np.zeros(n)
    for place, value in b.steady.items():
        steady[place] = value
    flags = np.zeros((2, n), dtype=np.bool_)
    for kind, place in b.nonlinear:
        if place >= 0:
            flags[int(kind == "column"), place] = True

    def places(found, width):
        table = np.array(found, dtype=np.int64).reshape(-1, width)
        return np.where(table < 0, n, table)

    def numbers(found, width):
        return np.array(found, dtype=float).reshape(-1, width)

    return Tables(
        entries=places(rows, 2),
        capacity=np.array([b.entries[row][0] for row in rows]),
        conductance=np.array([b.entries[row][1] for row in rows]),
        steady=steady,
        sources=np.array([wave[:2] for wave in b.waves], dtype=np.int64).reshape(-1, 2),
        waves=numbers([wave[2:] for wave in b.waves], waveform.COLUMNS),
        corners=numbers(b.corners, 2),
        junctions=places([each[:2] for each in b.junctions], 2),
        junction_values=numbers([each[2] for each in b.junctions], junction.COLUMNS),
        switches=places([each[0] for each in b.switches], 6),
        switch_values=numbers([each[1] for each in b.switches], 4),
        tape=np.array(b.tape.rows, dtype=np.int64).reshape(-1, 4),
        tape_values=np.array(b.tape.values, dtype=float),
        behavioural=places(b.behavioural, 4),
        inputs=places(b.inputs, 3),
        nonlinear_rows=flags[0],
        nonlinear_columns=flags[1],
        start=_starts(b, n),
    )


def _starts(b, n):
    """y at the beginning without the transducer's state, and what one unit of it adds: (2, n).

    What sources set holds; the voltages of capacitors and the currents of inductors are as given,
    those of the greatest first where they contradict each other; the first step finds the rest.
    """
    matrix = np.zeros((len(b.initial), n + 1))
    values = np.zeros((len(b.initial), 2))
    for k, (a, z, start, size) in enumerate(b.initial):
        # Ground stands last.
        matrix[k, a] += np.sqrt(size)
        matrix[k, z] -= np.sqrt(size)
        values[k, 1 if start == "state" else 0] = np.sqrt(size) * _one_if_state(start)
    heaviest = np.abs(matrix).max(initial=1.0)
    fixed, given = _set_voltages(b, n)
    matrix = np.concatenate([1e-3 / heaviest * matrix[:, :n], fixed])
    values = np.concatenate([1e-3 / heaviest * values, given])
    sizes = np.abs(matrix).max(axis=0, initial=0.0)
    sizes[sizes == 0.0] = 1.0
    found = np.linalg.lstsq(matrix / sizes, values, rcond=1e-13)[0]
    return (found / sizes[:, None]).T


def _one_if_state(start):
    return 1.0 if start == "state" else start


def _set_voltages(b, n):
    """Rows of the branches that set a voltage and hold no flux, and what they set at time 0."""
    chosen = []
    for name, place in b.unknowns.items():
        entries = {column: e for (row, column), e in b.entries.items() if row == place}
        holds = any(e[0] != 0.0 for e in entries.values()) or ("row", place) in b.nonlinear
        if name.startswith("i(") and not holds:
            chosen.append((place, entries))
    rows, values = np.zeros((len(chosen), n)), np.zeros((len(chosen), 2))
    for k, (place, entries) in enumerate(chosen):
        for column, (_, conductance) in entries.items():
            rows[k, column] = conductance
        values[k, 0] = b.steady.get(place, 0.0)
        size = np.abs(rows[k]).max()
        rows[k], values[k] = rows[k] / size, values[k] / size
    return rows, values
