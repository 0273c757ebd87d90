"""The elements of a netlist with their nodes, and its sub-circuits, for drawing."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from circuits.netlist.expression import solutions
from circuits.netlist.reader import Card, statements
from circuits.netlist.vetting import ELEMENTS, check_form, refuse
from harvester.base.errors import NetlistError

GROUND = "0"
# Letters of elements whose third and fourth nodes control them and carry no current.
CONTROLLED_BY_NODES = ("e", "g", "s")
# Matches PSpice's controlling nodes in parentheses, after an element's two nodes.
_PAIR = re.compile(r"(?i)^([eg]\S*\s+\S+\s+\S+\s+)\(\s*([^(),\s]+)[\s,]+([^(),\s]+)\s*\)")
# Letters of transistors, with the nodes drain or collector, gate or base, source or emitter, and
# optionally bulk or substrate.
TRANSISTORS = ("m", "j", "q")


@dataclass(frozen=True)
class Part:
    """One element.

    Attributes
    ----------
    name : str
        Name as written in the netlist.
    nodes : tuple of str
        Nodes in the netlist's order; for a controlled element only those that carry current.
    control : tuple of str
        Nodes, sources or coupled coils that control it.
    value : str
        Text after the nodes; for a sub-circuit's call its parameters.
    calls : str
        Name of the sub-circuit of an X element, else empty.
    """

    name: str
    nodes: tuple
    control: tuple = ()
    value: str = ""
    calls: str = ""

    @property
    def letter(self) -> str:
        """The kind of element, in lower case."""
        return self.name[0].lower()

    @property
    def ends(self) -> tuple[str, ...]:
        """The two nodes between which current flows; empty for a coupling."""
        return self.nodes[:3:2] if self.letter in TRANSISTORS else self.nodes[:2]

    @property
    def beside(self) -> tuple[str, ...]:
        """Other nodes: a transistor's gate or base, and its bulk or substrate if present."""
        return self.nodes[1:2] + self.nodes[3:] if self.letter in TRANSISTORS else self.nodes[2:]


@dataclass
class Topology:
    """The elements of a circuit or sub-circuit, in the netlist's order.

    Attributes
    ----------
    name : str
        Name of the sub-circuit; empty for the circuit.
    pins : tuple of str
    parts : list of Part
    inner : dict of str to Topology
        Sub-circuits defined in it.
    models : dict of str to str
        Kind and parameters of each `.model` in it.
    """

    name: str = ""
    pins: tuple = ()
    parts: list = field(default_factory=list)
    inner: dict = field(default_factory=dict)
    models: dict = field(default_factory=dict)
    outer: Topology | None = field(default=None, repr=False)

    def find(self, name: str) -> Topology:
        """A sub-circuit by name, from here outwards.

        Raises
        ------
        NetlistError
            It is not defined.
        """
        if name in self.inner:
            return self.inner[name]
        if self.outer is None:
            raise NetlistError(f"{name}: no such sub-circuit in the netlist; define it")
        return self.outer.find(name)

    def model(self, name: str) -> str:
        """Kind and parameters of a `.model`, searched outwards; empty if there is none."""
        if name in self.models or self.outer is None:
            return self.models.get(name, "")
        return self.outer.model(name)


def read_topology(text: str, name: str = "netlist") -> Topology:
    """Elements and sub-circuits of a netlist.

    Parameters
    ----------
    text : str
        A netlist; its includes are ignored.
    name : str
        Name of its file, for messages.

    Raises
    ------
    NetlistError
        An element of an unsupported kind, or an incomplete statement.
    """
    topology = Topology()
    for card in statements(text, name):
        words = _joined(card.text).split()
        first = words[0].lower()
        if first in (".subckt", ".model") and len(words) < 2:
            refuse(card, f"{first} takes a name")
        if first == ".subckt":
            pins = tuple(w for w in words[2:] if "=" not in w and w.lower() != "params:")
            inner = Topology(words[1].lower(), pins, outer=topology)
            topology.inner[inner.name] = inner
            topology = inner
        elif first == ".ends":
            topology = topology.outer or topology
        elif first == ".model":
            topology.models[words[1].lower()] = " ".join(words[2:]).lower()
        elif not first.startswith((".", "*")):
            topology.parts.append(read_part(card))
    return topology


def _joined(text):
    """Remove white space in braces and around equal signs, so that each is one word."""
    text = re.sub(r"\{[^{}]*\}", lambda match: match.group().replace(" ", ""), paired(text))
    return re.sub(r"(?<![=<>!])\s*=\s*(?!=)", "=", text)


def paired(text: str) -> str:
    """Remove PSpice's parentheses around the controlling nodes of an E or G element."""
    return _PAIR.sub(r"\1\2 \3", text)


def read_part(card: Card) -> Part:
    """The element of a card.

    Raises
    ------
    NetlistError
    """
    words = _joined(card.text).split()
    name, letter = words[0], words[0][0].lower()
    if letter == "x":
        plain = [w for w in words[1:] if "=" not in w and w.lower() != "params:"]
        if not plain:
            refuse(card, f"{card.text[:50]!r}: no sub-circuit to call")
        values = " ".join(w for w in words[1:] if "=" in w)
        return Part(name, tuple(plain[:-1]), (), values, plain[-1].lower())
    check_form(card, name, words[1:])
    if letter == "k":
        return Part(name, (), tuple(words[1:-1]), words[-1])
    count = 2 if letter in CONTROLLED_BY_NODES else ELEMENTS[letter][0]
    # If a transistor has a fourth node, a model's name follows; else a number, a pair or "off".
    following = words[2 + count : 3 + count] if letter in ("m", "q") else []
    if any("=" not in w and re.match(r"(?!off$)[a-z_]", w.lower()) for w in following):
        count += 1
    nodes, remainder = tuple(words[1 : 1 + count]), words[1 + count :]
    if (
        letter in CONTROLLED_BY_NODES
        and len(remainder) > 2
        and not re.search(r"[=({]", remainder[0])
    ):
        return Part(name, nodes, tuple(remainder[:2]), " ".join(remainder[2:]))
    if letter in "fhw":
        return Part(name, nodes, tuple(remainder[:1]), " ".join(remainder[1:]))
    value = " ".join(remainder)
    controls = solutions(value.lower()) if letter in "beg" else ()
    control = dict.fromkeys(node for kind, pair in controls if kind == "v" for node in pair)
    return Part(name, nodes, tuple(control), value)
