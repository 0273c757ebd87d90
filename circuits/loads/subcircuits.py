"""Loads as sub-circuits: a library's or a user's netlist, vetted."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any

from circuits.loads import vetting
from circuits.loads.dialects import ambiguity
from circuits.loads.elements import Element
from circuits.loads.expansion import Expansion
from circuits.loads.flattening import calls, elements, outermost
from circuits.loads.kinds import LEVEL, OUTPUT
from circuits.loads.load_checks import check_load, check_needs, loose_nodes
from circuits.loads.load_watch import Watch, watch_of
from circuits.loads.measurement import evaluated
from circuits.loads.measures import Measure, vet_measures
from circuits.loads.numbers import number
from circuits.loads.own_motion import OwnMotion, cancelled, own_motion
from circuits.loads.part_values import negative_parts, reading_notes, sources_of
from circuits.loads.reader import Card, read_cards
from circuits.loads.stores import Store, levels_of, stores_of
from circuits.loads.supplies import coupled, supplies_of
from circuits.loads.tree import parse, written
from circuits.loads.vetting import (
    check_expression,
    check_nodes,
    check_value,
    listed,
    refuse,
    rewritten,
    vet_element,
)
from circuits.loads.writer import reads_alike, run_text
from harvester.device.terminals import GROUND
from harvester.errors import NetlistError
from harvester.files.plain_text import nearest

# Pins of a load's sub-circuit: the piezo's terminals, and the DC side if it has one.
PIEZO_PINS, OUTPUT_PINS = ("p", "n"), ("out", "ref")
EXPECTED = "p n, or p n out ref (p n: the piezo's terminals; out ref: the DC side), in any order"
# Matches suffixes that SPICE and people read differently: M and F.
_MISREAD = re.compile(r"\s*([+-]?[\d.]+(?:[eE][+-]?\d+)?)(M(?![eE][gG]|[iI][lL])|F)", re.ASCII)
_READINGS = {"M": ("a million", "a thousandth"), "F": ("a farad", "a femtofarad")}


@dataclass(frozen=True)
class LoadCircuit:
    """A load that was read and checked, ready to be connected to the transducer.

    Attributes
    ----------
    text : str
        Text of its file for exported decks: includes inserted, parameters by name; ends with a
        newline.
    elements : tuple of circuits.loads.elements.Element
        All that it holds, as both engines run it.
    name : str
        Name of its sub-circuit.
    pins : tuple of str
        Pins as declared, from `PIEZO_PINS` and `OUTPUT_PINS`.
    parameters : tuple of (str, float)
        Values other than the netlist's own, given where it is called.
    defaults : tuple of (str, float)
        The netlist's own values of its sub-circuit's parameters, where they are plain numbers.
    across_output : tuple of circuits.loads.elements.Element
        Resistors and capacitors across the output.
    linear, switches : bool
        Resistors and capacitors only; anything beside them and diodes.
    resistance : float or None
        Resistance of a load that is one resistor between p and n, in Ω.
    measures : tuple of circuits.loads.measures.Measure
        Measures that its file asks for (`* measure:`).
    probes : tuple of str
        Nodes, and currents "i(name)", that a waveform is to hold; see `with_probes`.
    file : str
        Name of the file that its sub-circuit stands in.
    ambiguity : str
        A note on expressions that another SPICE reads otherwise; empty if there are none.
    source : (Path, tuple of circuits.loads.reader.Card)
        Its file and the cards that were read there, includes in: what `read_load` takes again.
    """

    text: str
    name: str
    pins: tuple
    parameters: tuple
    defaults: tuple
    across_output: tuple[Element, ...]
    linear: bool
    switches: bool
    resistance: float | None
    measures: tuple = ()
    probes: tuple[str, ...] = ()
    file: str = field(default="", compare=False)
    elements: tuple[Element, ...] = field(default=(), compare=False, repr=False)
    ambiguity: str = field(default="", compare=False)
    source: Any = field(default=None, compare=False, repr=False)

    @cached_property
    def is_plain(self) -> bool:
        """Whether ngspice can take the file's own text, as it reads every name as this program
        does.
        """
        return reads_alike(self.text, self.elements)

    @cached_property
    def run_text(self) -> str:
        """The sub-circuit as ngspice runs it, with every number written out."""
        return run_text(self.name, self.pins, self.elements)

    @cached_property
    def watch(self) -> Watch:
        """The unknowns that limit the steps (`circuits.loads.load_watch`), with the pins'
        own names."""
        return watch_of(self, {pin: pin for pin in self.pins})

    @cached_property
    def own_motion(self) -> OwnMotion:
        """How it behaves with the device at rest: `circuits.loads.own_motion`."""
        return own_motion(self.elements)

    @cached_property
    def cancelled(self) -> str:
        """The first source in it whose comparison rounding decides: `circuits.loads.own_motion`."""
        return cancelled(self.elements)

    @cached_property
    def sources(self) -> tuple[str, ...]:
        """Independent sources in it that are not 0: each may deliver energy."""
        return sources_of(self)

    @cached_property
    def periods(self) -> tuple[float, ...]:
        """The periods (s) of its periodic sources, each once."""
        found = (each.wave.period for each in self.elements if each.wave)
        return tuple(dict.fromkeys(period for period in found if period is not None))

    @cached_property
    def negative_parts(self) -> tuple[str, ...]:
        """Resistors, capacitors and coils in it whose value is below 0."""
        return negative_parts(self)

    @cached_property
    def reading_notes(self) -> tuple[str, ...]:
        """Notes on values that its writer may have meant otherwise, such as a suffix."""
        return reading_notes(self)

    @cached_property
    def loose_nodes(self) -> tuple[str, ...]:
        """Nodes with a single connection, as "node of name (file:line)"."""
        return loose_nodes(self)

    @property
    def sha256(self) -> str:
        """Digest of its cards, includes in, and of the values given."""
        said = f"{self.text}{self.name}{self.parameters}"
        return hashlib.sha256(said.encode()).hexdigest()

    @property
    def values(self) -> dict[str, float]:
        """The parameters that are plain numbers, given or by default (SI)."""
        return dict(self.defaults) | dict(self.parameters)

    @cached_property
    def stores(self) -> tuple[Store, ...]:
        """The capacitors and coils of the load."""
        return stores_of(self)

    @cached_property
    def levels(self) -> tuple[str, ...]:
        """Nodes and currents that determine what its stores hold, see `circuits.loads.stores`."""
        return levels_of(self)

    @property
    def may_jump(self) -> bool:
        """Whether a part may change its current without notice."""
        return self.watch.jumps

    @property
    def has_output(self) -> bool:
        """Whether it has a DC side."""
        return OUTPUT_PINS[0] in self.pins

    @cached_property
    def coupled(self) -> frozenset[str]:
        """Nodes of what can exchange energy with its pins, see `circuits.loads.supplies`."""
        return coupled(self.elements)

    @cached_property
    def supplies(self) -> tuple[Measure, ...]:
        """The power that its sources take, see `circuits.loads.supplies`."""
        return supplies_of(self)

    @property
    def measured(self) -> tuple[tuple[str, str], ...]:
        """Kind and name of each value that its measures ask for, and of its sources' powers."""
        return tuple(row for each in (*self.measures, *self.supplies) for row in each.rows)

    @property
    def recorded(self) -> tuple[tuple[str, str], ...]:
        """Kind and name of each value kept of a run: those measured, its levels, its probes."""
        return self.measured + tuple((LEVEL, name) for name in (*self.levels, *self.probes))


def load_names() -> list[str]:
    """Names of the loads in netlists/, sorted; a file without one of its name is for others."""
    names = []
    for file in resources.files("netlists").iterdir():
        name, ending = file.name.partition(".")[::2]
        if ending == "lib" and f".subckt {name} " in file.read_text(encoding="utf-8"):
            names.append(name)
    return sorted(names)


def find_netlist(netlist: str, folders: Sequence[str | Path] = (".",)) -> Path:
    """The file of a load.

    Parameters
    ----------
    netlist : str
        A name in netlists/, or a path (with a dot or a slash in it).
    folders : sequence of str or Path
        Folders in which a relative path is looked for, in order.

    Raises
    ------
    NetlistError
    """
    if re.fullmatch(r"\w+", netlist):
        names = load_names()
        if netlist not in names:
            raise NetlistError(
                f"load.netlist = {netlist[:60]!r}: no such load{nearest(netlist, names)}; there "
                f"are {', '.join(names)}; a file of your own is named with its ending"
            )
        return Path(str(resources.files("netlists").joinpath(f"{netlist}.lib")))
    for folder in folders:
        path = Path(folder) / netlist
        # A name that the system does not accept is no file.
        if os.path.isfile(path):
            return path
        if os.path.isdir(path):
            raise NetlistError(f"load.netlist = {netlist[:200]!r}: is a folder, not a file")
    looked = " and ".join(str(Path(folder).absolute()) for folder in folders)
    raise NetlistError(f"load.netlist = {netlist[:200]!r}: no such file in {looked}")


def read_load(
    path: Path,
    subcircuit: str | None = None,
    parameters: dict[str, Any] | None = None,
    cards: Sequence[Card] | None = None,
) -> LoadCircuit:
    """Read, vet and prepare a load.

    Parameters
    ----------
    path : Path
        Path from `find_netlist`.
    subcircuit : str or None
        Which of the file's; None: the one called as the file, or the only one with these pins.
    parameters : dict of str to (float or str), optional
        Values for the sub-circuit's parameters and for the file's `.param`; "100k" means 1e5.
    cards : sequence of Card, optional
        What was read of the file before: it is not read again.

    Returns
    -------
    LoadCircuit

    Raises
    ------
    NetlistError
        One line with file, line and fault.
    """
    path = Path(path)
    cards = [vetting.tidy(card) for card in read_cards(path)] if cards is None else [*cards]
    root = parse(cards, path.name)
    top = _chosen(root, path, subcircuit)
    values = _override(root, top, parameters or {}, path)
    _check_pins(top)
    _vet(root)
    Expansion(root).content(top)
    scope = outermost(root, top.name, values)
    check_needs(scope)
    for each in calls(scope):
        if each.circuit is not top and each.circuit.measures:
            refuse(each.circuit.measures[0], "measure: put it into the load's own sub-circuit")
    parts = tuple(elements(scope))
    measures = vet_measures([*root.measures, *top.measures], top.scope())
    output = _across_output(top, parts, measures)
    letters = {"b" if each.expression is not None else each.letter for each in parts}
    load = LoadCircuit(
        text="\n".join(written(root)) + "\n",
        name=top.name,
        pins=top.pins,
        parameters=tuple(values.items()),
        defaults=tuple(_defaults(root, top)),
        across_output=tuple(output),
        linear=letters <= {"r", "c"},
        switches=not letters <= {"r", "c", "d"},
        resistance=_single_resistance(top, parts),
        measures=evaluated(measures, scope, parts),
        file=top.card.where.rpartition(":")[0],
        elements=parts,
        ambiguity="" if root.dialect else ambiguity(cards),
        source=(path, tuple(cards)),
    )
    check_load(load)
    return load


def _defaults(root, top):
    """(name, number) of its own parameters where the file gives a plain number."""
    known = {**root.local, **top.parameters, **top.local}
    sizes = ((name, number(known[name])) for name in top.parameters)
    return [(name, size) for name, size in sizes if size is not None]


def _chosen(root, path, name):
    if not root.inner:
        raise NetlistError(f"{path.name}: holds no .subckt: put the load into one")
    if name is None:
        names = [each for each, circuit in root.inner.items() if _fits(circuit)] or [*root.inner]
        name = path.stem.lower() if path.stem.lower() in root.inner else names[0]
        if name != path.stem.lower() and len(names) > 1:
            raise NetlistError(
                f"{path.name}: holds {listed(root.inner)}: say which by load.subcircuit"
            )
    if name.lower() not in root.inner:
        raise NetlistError(
            f"{path.name}: no .subckt {name[:60]}{nearest(name.lower(), root.inner)}; there are "
            f"{listed(root.inner)}"
        )
    return root.inner[name.lower()]


def _fits(circuit):
    return {*circuit.pins} in ({*PIEZO_PINS}, {*PIEZO_PINS, *OUTPUT_PINS})


def _check_pins(top):
    if not top.elements:
        refuse(top.card, f".subckt {top.name[:40]} holds no element")
    if not _fits(top):
        refuse(
            top.card,
            f".subckt {top.name[:40]} has the pins {listed(top.pins)}; expected {EXPECTED}",
        )


def _override(root, top, given, path):
    """Put the user's values in; those of the sub-circuit's own parameters are returned."""
    values = {}
    known = {**root.local, **top.local, **top.parameters}
    for key, value in given.items():
        name = key.lower()
        where = f"load.parameters.{key[:60]} = {value!r:.60}"
        if name not in known:
            there = f"; there are {listed(known)}" if known else "; it has none"
            raise NetlistError(
                f"{where}: {path.name} has no such parameter{nearest(name, known)}{there}"
            )
        if isinstance(value, str) and (read := _MISREAD.match(value)):
            mega, small = _READINGS[read.group(2)]
            raise NetlistError(
                f"{where}: {value[:30]} is {small} in SPICE and {mega} to most people: write "
                f"{read.group(1)}{'meg' if read.group(2) == 'M' else ''} or "
                f"{read.group(1)}{read.group(2).lower()}"
            )
        size = number(value) if isinstance(value, str) else float(value)
        if size is None or not abs(size) < float("inf"):
            raise NetlistError(f'{where}: must be a finite number, or one like "100k"')
        if name in top.parameters:
            values[name] = size
        else:
            place = top.local if name in top.local else root.local
            place[name] = repr(size)
    return values


def _vet(circuit):
    """Judge every card of a sub-circuit and of those within it, in place."""
    scope = circuit.scope()
    for values in (circuit.parameters, circuit.local):
        for name, value in values.items():
            if number(value) is None and not value.startswith("{"):
                value = "{" + value + "}"
            values[name] = check_value(circuit.place(name), value, scope, name)
    for name, (card, kind, pairs) in circuit.models.items():
        checked = [(k, v and check_value(card, v, scope, k)) for k, v in pairs]
        circuit.models[name] = (card, kind, checked)
    circuit.needs = [_need(card, scope) for card in circuit.needs]
    for name, (card, arguments, expression) in circuit.functions.items():
        own = scope._replace(parameters=scope.parameters.new_child(dict.fromkeys(arguments)))
        circuit.functions[name] = (card, arguments, check_expression(card, expression, own))
    circuit.elements = [_vetted(card, circuit, scope) for card in circuit.elements]
    names = set()
    for card, words in circuit.elements:
        if words[0] in names:
            refuse(card, f"{words[0][:40]} is there twice")
        names.add(words[0])
    for card, words in circuit.elements:
        if words[0][0] == "k":
            _check_coupling(card, words, {name for name in names if name[0] == "l"})
    for inner in circuit.inner.values():
        _vet(inner)


def _need(card, scope):
    """A "needs" line as it is written, or in ngspice's syntax where that differs."""
    text = check_expression(card, card.text, scope)
    return card if text == rewritten(card.text) else card._replace(text=text)


def _check_coupling(card, words, coils):
    """Refuse a coupling with what is no coil."""
    for name in words[1:-1]:
        if name not in coils:
            refuse(card, f"{words[0]}: no inductor {name} in its sub-circuit{nearest(name, coils)}")


def _vetted(card, circuit, scope):
    """(card, words) of one element; a call is checked against what it calls."""
    if not card.text.startswith("x"):
        return card, vet_element(card, scope)
    words = re.sub(r"\bparams:\s*", "", card.text).split()
    bare = [word for word in words if "=" not in word]
    target = circuit.find(bare[-1])
    if target is None:
        refuse(card, f"no .subckt {bare[-1][:40]}{nearest(bare[-1], circuit.known())}")
    nodes = bare[1:-1]
    check_nodes(card, [bare[0], *nodes])
    if len(nodes) != len(target.pins):
        refuse(card, f"{bare[0][:40]}: {target.name[:40]} has the pins {listed(target.pins)}")
    pairs = vetting.vet_parameters(card, " ".join(word for word in words if "=" in word))
    for name in pairs:
        if name == "m" and name not in target.parameters:
            refuse(card, "m= on a call: ngspice 39 and 46 differ in it: write the call m times")
        if name not in target.parameters:
            refuse(
                card,
                f"{target.name[:40]} has no parameter {name[:40]}"
                f"{nearest(name, target.parameters)}",
            )
    given = [f"{name}={check_value(card, value, scope, name)}" for name, value in pairs.items()]
    return card, [*bare, *given]


def _single_resistance(top, parts):
    """The resistance of a load that is one resistor between its pins, else None."""
    if {*top.pins} != {*PIEZO_PINS} or len(parts) != 1 or parts[0].letter != "r":
        return None
    ends = {*parts[0].nodes} in ({"p", "n"}, {"p", GROUND})
    return parts[0].size if ends and (parts[0].size or 0.0) > 0.0 else None


def _across_output(top, parts, measures):
    """The resistors and capacitors across the output."""
    if OUTPUT_PINS[0] not in top.pins:
        if measures:
            refuse(top.card, f"measures are of a load with the pins {' '.join(OUTPUT_PINS)}")
        return []
    across = [
        each
        for each in parts
        if {*each.nodes[:2]} == {*OUTPUT_PINS} and each.written_letter in "rc"
    ]
    for each in across:
        if each.value is None:
            raise NetlistError(
                f"{each.where}: {each.name} lies across out and ref: give it a constant value"
            )
    if not across and all(each.kind != OUTPUT for each in measures):
        refuse(
            top.card,
            "no resistor or capacitor lies across out and ref, and no measure is an output: "
            "nothing to harvest",
        )
    return across
