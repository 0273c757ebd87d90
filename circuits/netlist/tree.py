"""A netlist file as nested sub-circuits: parsed from cards, and written out again."""

from __future__ import annotations

import re
from collections import ChainMap
from dataclasses import dataclass, field

from circuits.netlist import vetting
from circuits.netlist.dialects import DIALECTS
from circuits.netlist.expression import FUNCTIONS
from circuits.netlist.reader import DIALECT, MEASURE, NEEDS, Card
from circuits.netlist.vetting import Visible, check_nodes, listed, refuse

# Deepest nesting of definitions.
DEEPEST_DEFINITION = 20
_INSTEAD = {
    ".ic": " (write ic= after the capacitor or coil)",
    ".title": " (write the title after *)",
    ".global": " (give the sub-circuits a pin for it)",
}
# Matches a comma before `name=`, which cannot be one between a function's arguments.
COMMA = re.compile(r"\s*,\s*(?=[a-z_]\w*\s*=[^=])")


@dataclass(eq=False)
class Subcircuit:
    """A .subckt definition, or the file that contains the definitions (empty name)."""

    card: Card
    name: str = ""
    pins: tuple = ()
    parameters: dict = field(default_factory=dict)
    local: dict = field(default_factory=dict)
    local_cards: dict = field(default_factory=dict)
    functions: dict = field(default_factory=dict)
    models: dict = field(default_factory=dict)
    elements: list = field(default_factory=list)
    measures: list = field(default_factory=list)
    needs: list = field(default_factory=list)
    inner: dict = field(default_factory=dict)
    outer: Subcircuit | None = None
    dialect: str = ""

    def scope(self) -> Visible:
        """The visible names, including names of enclosing definitions."""
        around = self.around()
        parameters = (values for c in around for values in (c.local, c.parameters))
        return Visible(
            ChainMap(*parameters),
            ChainMap(*(circuit.functions for circuit in around)),
            ChainMap(*(circuit.models for circuit in around)),
            around[-1].dialect,
        )

    def place(self, name: str) -> Card:
        """The card that defines a parameter's value."""
        return self.local_cards.get(name, self.card)

    def around(self) -> list[Subcircuit]:
        """This sub-circuit and its enclosing definitions, from inside out."""
        return [self, *(self.outer.around() if self.outer else ())]

    def find(self, name: str) -> Subcircuit | None:
        """The visible sub-circuit of this name, searched outwards, or None."""
        return next((c.inner[name] for c in self.around() if name in c.inner), None)

    def known(self) -> set[str]:
        """Names of all sub-circuits that can be called from here."""
        return {name for circuit in self.around() for name in circuit.inner}


def parse(cards: list[Card], name: str) -> Subcircuit:
    """Parse a file's cards into nested sub-circuits; elements are not checked yet."""
    root = current = Subcircuit(Card("", name))
    for card in cards:
        first, _, remainder = card.text.partition(" ")
        if first == ".subckt":
            current = _opened(current, card, remainder)
        elif first == ".ends":
            if current is root:
                refuse(card, ".ends without a .subckt")
            if remainder and remainder != current.name:
                refuse(card, f".ends {remainder[:40]} closes .subckt {current.name[:40]}")
            current = current.outer or root
        elif first in (".param", ".params"):
            # Parameters may be separated by commas.
            pairs = vetting.vet_parameters(card, COMMA.sub(" ", remainder))
            current.local.update(pairs)
            current.local_cards.update(dict.fromkeys(pairs, card))
        elif first == ".func":
            name, arguments, expression = vetting.vet_function(card)
            if current is root and name in FUNCTIONS:
                refuse(
                    card,
                    f"{name} is a function of ngspice: outside a .subckt yours would change "
                    "the device, too; put it into the load's .subckt",
                )
            _once(card, current.functions, f".func {name}", name)
            current.functions[name] = (card, arguments, expression)
        elif first == ".model":
            name, kind, values = vetting.vet_model(card)
            _once(card, current.models, f".model {name}", name)
            current.models[name] = (card, kind, values)
        elif first == DIALECT:
            if remainder not in DIALECTS or root.dialect not in ("", remainder):
                choice = ", ".join(DIALECTS)
                refuse(card, f"* dialect: {remainder[:40]}: one of {choice} for all files")
            root.dialect = remainder
        elif first == MEASURE:
            current.measures.append(Card(remainder, card.where))
        elif first == NEEDS:
            if current is root:
                refuse(card, "needs: put it into the .subckt with these parameters")
            current.needs.append(Card(remainder, card.where))
        elif first.startswith("."):
            refuse(
                card,
                f"{first[:40]} is not accepted{_INSTEAD.get(first, '')}: a load has elements, "
                ".model, .param, .func, .subckt and .include",
            )
        elif current is root:
            title = "; a title begins with *" if card is cards[0] else ""
            refuse(card, f"{first[:40]}: an element outside a .subckt; put it into one{title}")
        else:
            current.elements.append(card)
    if current is not root:
        refuse(current.card, f".subckt {current.name} without .ends")
    return root


def _once(card, defined, what, name):
    """Raise for a name defined twice: ngspice releases differ in which definition counts."""
    if name in defined:
        refuse(card, f"{what[:60]} is defined twice, first at {defined[name][0].where}: keep one")


def _opened(outer, card, rest):
    words = re.sub(r"\bparams:\s*", "", rest).split()
    names = [word for word in words if "=" not in word]
    if not names or not re.fullmatch(r"[a-z_][\w.\-]*", names[0]) or len(names) < 2:
        refuse(card, "write it as .subckt name pins parameter=value")
    if len(outer.around()) > DEEPEST_DEFINITION:
        refuse(card, f".subckt {names[0]}: definitions nest deeper than {DEEPEST_DEFINITION}")
    if names[0] in outer.inner:
        refuse(card, f".subckt {names[0][:40]} is defined twice")
    check_nodes(card, names[1:])
    if ground := {"0", "gnd"} & {*names[1:]}:
        refuse(
            card,
            f"the pin {ground.pop()} is SPICE's ground, the same node in every circuit: rename it "
            "here and in the body, for example to n",
        )
    if len({*names[1:]}) < len(names[1:]):
        refuse(card, f"the pins {listed(names[1:])} must differ")
    parameters = vetting.vet_parameters(card, " ".join(word for word in words if "=" in word))
    inner = Subcircuit(card, names[0], tuple(names[1:]), parameters, outer=outer)
    outer.inner[names[0]] = inner
    return inner


def written(circuit: Subcircuit) -> list[str]:
    """The lines of a sub-circuit, or of a whole file."""
    lines = []
    if circuit.name:
        defaults = [f"{name}={value}" for name, value in circuit.parameters.items()]
        lines.append(" ".join([".subckt", circuit.name, *circuit.pins, *defaults]))
    lines += [f".param {name}={value}" for name, value in circuit.local.items()]
    for name, (_, arguments, expression) in circuit.functions.items():
        lines.append(f".func {name}({','.join(arguments)}) {{{expression}}}")
    for name, (_, kind, pairs) in circuit.models.items():
        inside = " ".join(f"{key}={value}" if value else key for key, value in pairs)
        lines.append(f".model {name} {kind}({inside})")
    lines += [f"* needs: {card.text}" for card in circuit.needs]
    for inner in circuit.inner.values():
        lines += written(inner)
    lines += [line.text for line in circuit.elements]
    return [*lines, f".ends {circuit.name}"] if circuit.name else lines
