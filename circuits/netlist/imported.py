"""Converts a top-level netlist, as LTspice writes it for a schematic, to a load's sub-circuit."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from circuits.netlist.expression import respelt, solutions
from circuits.netlist.load_circuit import OUTPUT_PINS, PIEZO_PINS
from circuits.netlist.numbers import number
from circuits.netlist.reader import DIALECT, IGNORED, INCLUDES, MEASURE, NEEDS, Card, statements
from circuits.netlist.topology import (
    CONTROLLED_BY_NODES,
    GROUND,
    Part,
    Topology,
    paired,
    read_part,
    read_topology,
)
from circuits.netlist.vetting import listed
from harvester.base.errors import NetlistError
from harvester.base.plain_text import nearest

PINS = (*PIEZO_PINS, *OUTPUT_PINS)
# Statements that are kept, outside the sub-circuit. The load's reader rejects .if blocks and a
# stray .ends with their lines. Other statements control a simulator and are dropped.
KEPT = (".model", ".param", ".params", ".func", ".ends", ".if", ".else", ".elseif", ".endif")
_WAVE = re.compile(r"(?i)\b(sine?|pulse|exp|sffm|pwl|wavefile)\b")
# Parasitic elements within an LTspice part; they become separate elements.
_WITHIN = re.compile(r"(?i)\s+(rser|rpar|cpar|lser)\s*=\s*(\{[^{}]*\}|\S+)")


class Imported(NamedTuple):
    """A load's statements, each with its line in the schematic's netlist, and one-line notes on
    rewritten statements.
    """

    cards: tuple[Card, ...]
    rewritten: tuple[str, ...]

    @property
    def text(self) -> str:
        """The load's file."""
        return "\n".join(card.text for card in self.cards) + "\n"


def candidates(text: str) -> list[str]:
    """Nodes of a netlist; first the nodes of sources with a waveform, probably the harvester's."""
    parts = _topology(text).parts
    driven = [node for part in parts if _is_wave(part) for node in part.ends]
    return list(dict.fromkeys([*driven, *(node for part in parts for node in part.nodes)]))


def imported(
    text: str,
    name: str,
    nodes: Sequence[str],
    remove: Sequence[str] = (),
    file: str = "netlist",
) -> Imported:
    """The sub-circuit of a top-level netlist.

    Parameters
    ----------
    text : str
        Text of the netlist; its first line is a title.
    name : str
        Name of the sub-circuit.
    nodes : sequence of str
        The harvester's two nodes, then the output's two if there is an output.
    remove : sequence of str
        Elements that represent the harvester, in addition to the sources between its nodes.
    file : str
        Name of the netlist's file, for messages.

    Raises
    ------
    NetlistError
    """
    topology = _topology(text, file)
    node_names = list(dict.fromkeys(node for part in topology.parts for node in part.nodes))
    pins = _pins(nodes, node_names)
    nodes = [*map(_key, nodes)]
    names = [part.name.lower() for part in topology.parts]
    for part_name in remove:
        if part_name.lower() not in names:
            raise NetlistError(f"no element {part_name[:40]}{nearest(part_name.lower(), names)}")
    notes: list[str] = []
    gone = {part_name.lower() for part_name in remove}
    gone |= {
        part.name.lower()
        for part in topology.parts
        if part.letter in "vi" and {*map(_key, part.ends)} == {*nodes[:2]}
    }
    notes += [f"{part_name}: removed, the harvester replaces it" for part_name in sorted(gone)]
    _check_ground(topology, pins)
    currents = _currents(topology, gone)
    functions: list[str] = []
    outside: list[Card] = []
    inside: list[Card] = []
    dialects: list[Card] = []
    # The load's reader rejects .global nodes, which all sub-circuits share.
    kept = (*KEPT, ".global") if any(part.calls for part in topology.parts) else KEPT
    depth = 0
    for card in statements(_body(text), file):
        first = card.text.split()[0].lower()
        depth += first == ".subckt"
        if first == DIALECT:
            dialects.append(card)
        elif not depth and first in (MEASURE, NEEDS):
            inside.append(card._replace(text=_rewritten(card.text, pins, currents)))
        elif not depth and first == ".func":
            rewritten = _rewritten(card.text, pins, currents)
            if rewritten.lower() != card.text.lower():
                functions.append(re.split(r"[\s(]+", card.text)[1])
            outside.append(card._replace(text=rewritten))
        elif depth or first in kept or (first in INCLUDES and not re.search(r"[\\/:]", card.text)):
            outside.append(card)
        elif first.startswith("."):
            notes += [f"{card.text[:60]}: left out"] if first not in IGNORED else []
        elif first not in gone:
            across = {*map(_key, card.text.split()[1:3])}
            output = first[0] in "rc" and len(nodes) == 4 and across == {*nodes[2:]}
            own_pins = pins | {nodes[3]: "ref"} if output else pins
            lines = _element(card, own_pins, currents, notes)
            inside += [card._replace(text=line) for line in lines]
        depth -= depth and first == ".ends"
    _check_functions(topology, functions)
    notes += [
        f".func {function}: rewritten with the load's nodes and sources" for function in functions
    ]
    for part in topology.parts:
        if part.name.lower() not in gone and _is_wave(part):
            notes.append(
                f"{part.name}: stays a source of the load: --remove it if it is the harvester"
            )
    if len(nodes) == 4 and nodes[3] in nodes[:2]:
        # A node cannot have two names: a 0 V source connects the two pins.
        inside.append(Card(f"Vcommon ref {pins[nodes[3]]} 0", file))
        notes.append(f"Vcommon: connects ref to {pins[nodes[3]]}, since node {nodes[3]} was both")
    head = f".subckt {name} {' '.join(PINS[: len(nodes)])}"
    if not dialects:
        dialects.append(Card("* dialect: ltspice", file))
        notes.append("* dialect: ltspice: switches and expressions have LTspice's meaning")
    title = Card(f"* {name}, from a schematic's netlist", file)
    body = [Card(head, file), *inside, Card(f".ends {name}", file)]
    return Imported((title, *dialects, *outside, *body), tuple(notes))


def _body(text):
    """The netlist, without a title line that is not a comment; § in names becomes _."""
    title, _, lines = re.sub(r"\r\n?", "\n", text).partition("\n")
    return f"{title if title.startswith('*') else ''}\n{lines}".replace("§", "_")


def _topology(text, name="netlist"):
    topology = read_topology(_body(text), name)
    if not topology.parts:
        raise NetlistError("no element at the top level: give a schematic's netlist, or a .subckt")
    return topology


def _is_wave(part: Part) -> bool:
    return part.letter in "vi" and bool(_WAVE.search(part.value))


def _key(node):
    """A node's name as SPICE compares it."""
    return GROUND if node.lower() == "gnd" else node.lower()


def _pins(nodes, current_nodes):
    """The new names of all nodes, by `_key`."""
    spelt = {_key(node): node for node in current_nodes}
    for node in nodes:
        if _key(node) not in spelt:
            raise NetlistError(
                f"no node {node[:40]}{nearest(node, current_nodes)}; there are "
                f"{listed(current_nodes)}"
            )
    nodes = [*map(_key, nodes)]
    if len(nodes) not in (2, 4) or nodes[0] == nodes[1] or len({*nodes[2:]}) == 1:
        raise NetlistError("give the harvester's two nodes, and optionally the output's two")
    pins = dict(zip(nodes[:2], PIEZO_PINS, strict=True))
    pins |= {n: pin for n, pin in zip(nodes[2:], OUTPUT_PINS, strict=False) if n not in pins}
    # In a load node 0 is the harvester's terminal n, so the schematic's ground is renamed.
    renamed = {GROUND: "ground"} | {key: f"{key}_" for key in spelt if key in PINS}
    for key, name in renamed.items():
        while name in spelt:
            name += "_"
        pins.setdefault(key, name)
    return spelt | pins


def _renamed(node, pins):
    return pins.get(_key(node), node)


def _within(topology: Topology) -> Iterator[tuple[str, Part]]:
    """Elements of all sub-circuits, each with its sub-circuit's name."""
    for inner in topology.inner.values():
        yield from ((inner.name, part) for part in inner.parts)
        yield from _within(inner)


def _check_ground(topology, pins):
    """Raise if sub-circuits use node 0, unless it is the harvester's n as in a load."""
    for name, part in _within(topology) if pins[GROUND] != "n" else ():
        alone = any(kind == "v" and len(ends) == 1 for kind, ends in solutions(part.value))
        if GROUND in map(_key, (*part.nodes, *part.control)) or alone:
            raise NetlistError(
                f"{part.name} in .subckt {name} uses node 0, which in a load is the harvester's "
                "second node, but you chose another one: add a pin for node 0 to the sub-circuit, "
                "and write V(x) as V(x,PIN)"
            )


def _currents(topology, gone):
    """Replacement of i(NAME): a resistor's (ends, resistance), or the reason why there is none."""
    expressions: dict[str, tuple[tuple[str, ...], str] | str] = {}
    for part in topology.parts:
        name = part.name.lower()
        if name in gone:
            expressions[name] = f"I({part.name}): {part.name} is removed: the harvester replaces it"
        elif part.letter == "r" and len(part.value.split()) == 1 and "=" not in part.value:
            expressions[name] = (part.ends, part.value.strip("{}"))
        elif part.letter not in "vehl":
            expressions[name] = (
                f"I({part.name}): put a 0 V source, V_{part.name}, in series with {part.name} "
                f"and write I(V_{part.name})"
            )
    return expressions


def _check_functions(topology, functions):
    """Raise if a sub-circuit calls a rewritten function: its nodes have other names there."""
    for name, part in _within(topology):
        for function in functions:
            if re.search(rf"(?i)\b{re.escape(function)}\s*\(", part.value):
                raise NetlistError(
                    f".func {function}: it uses nodes of the schematic, and .subckt {name} "
                    "calls it too: pass these voltages as arguments"
                )


def _rewritten(text, pins, currents):
    """Replace voltages and currents in a text by the load's names."""

    def spell(kind, names):
        if kind == "v":
            return _voltage(names, pins)
        expression = currents.get(names[0].lower(), "")
        if isinstance(expression, tuple):
            ends, ohms = expression
            return f"({_voltage(ends, pins)}/({_rewritten(ohms, pins, {})}))"
        if expression:
            raise NetlistError(expression)
        return ""

    return respelt(text, spell)


def _element(
    card: Card, pins: dict[str, str], currents: dict[str, Any], remarks: list[str]
) -> Iterator[str]:
    """An element with renamed nodes, and its parasitic parts as separate elements."""
    # LTspice writes 0 for a missing part.
    text = paired(card.text)
    within = [(key.lower(), value) for key, value in _WITHIN.findall(text) if number(value) != 0.0]
    card = card._replace(text=_WITHIN.sub("", text))
    words = card.text.split()
    part = read_part(card)
    name, letter, count = part.name, part.letter, len(part.nodes)
    if letter in CONTROLLED_BY_NODES and words[3:5] == [*part.control]:
        count = 4
    nodes = [_renamed(node, pins) for node in words[1 : 1 + count]]
    remainder = " ".join(words[1 + count :])
    # In V and I sources parentheses contain a waveform; in other elements V(…) and I(…) are
    # quantities.
    if letter not in "vi":
        current_names = [names[0] for kind, names in solutions(remainder) if kind == "i"]
        remainder = _rewritten(remainder, pins, currents)
        remarks += [
            f"{name}: I({current}) is replaced by voltage/resistance"
            for current in dict.fromkeys(current_names)
            if isinstance(currents.get(current.lower()), tuple)
        ]
    for key, value in within:
        parasitic = f"{key[0].upper()}{key[1:]}_{name}"
        if letter not in "rclvi" or (letter == "i" and key == "rser"):
            raise NetlistError(f"{name}: {key}= is unsupported here: write a separate element")
        remarks.append(f"{name}: {key}={value} becomes the element {parasitic}")
        if key.endswith("ser"):
            yield f"{parasitic} {nodes[1]}_{name} {nodes[1]} {value}"
            nodes[1] = f"{nodes[1]}_{name}"
        else:
            yield f"{parasitic} {nodes[0]} {nodes[1]} {value}"
    yield " ".join([name, *nodes, remainder])


def _voltage(ends, pins):
    """A voltage in an expression; for one node it is against node 0."""
    nodes = [_renamed(node, pins) for node in ends]
    if len(nodes) == 1 and pins[GROUND] != "n":
        nodes.append(pins[GROUND])
    return f"v({','.join(nodes)})"
