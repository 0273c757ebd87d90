"""Counts the elements and characters of a load with its calls and functions expanded, before
ngspice does so.

ngspice replaces each call of a function by its text and each X by its sub-circuit's cards:
a few lines can expand to more than any machine holds.
"""

from __future__ import annotations

import graphlib
import re
from typing import TYPE_CHECKING, NamedTuple

from circuits.netlist.vetting import refuse

if TYPE_CHECKING:
    from circuits.netlist.tree import Subcircuit

# Most elements, and most sub-circuit calls, of an expanded load.
MOST_ELEMENTS = 2000
# Most characters of all cards together, and of one card, after expansion.
MOST_CHARACTERS = 1_000_000
LONGEST_EXPANDED = 20_000
# Deepest nesting of calls of sub-circuits, or of functions.
DEEPEST_CALL = 20
# Most parameters, functions, models and sub-circuits of a file. ngspice compares each with all
# others.
MOST_DEFINITIONS = 5000

_PIECE = re.compile(r"[a-z_][\w.]*|[(),]|[^a-z_(),]+")


class Length(NamedTuple):
    """Length of an expanded text: `own` plus `share` times the length of its arguments."""

    own: int = 0
    share: int = 0

    def plus(self, other: Length) -> Length:
        """Length of both texts together."""
        return Length(self.own + other.own, self.share + other.share)

    def given(self, argument: Length) -> Length:
        """Length of the text with its arguments inserted."""
        return Length(self.own + self.share * argument.own, self.share * argument.share)


class Expansion:
    """Counts the elements of a file's expanded sub-circuits, visiting each sub-circuit once.

    Parameters
    ----------
    root : Subcircuit
        Vetted.

    Raises
    ------
    NetlistError
        Raised by every method if a part is too large, with file and line.
    """

    def __init__(self, root: Subcircuit) -> None:
        self._functions: dict = {}
        self._contents: dict = {}
        self._characters: dict = {}
        self._definitions = 0
        self._add_definitions(root)
        # ngspice expands functions even in unused sub-circuits.
        self._check(root.card, self._own_characters(root))

    def content(
        self, circuit: Subcircuit, calling: tuple[Subcircuit, ...] = ()
    ) -> tuple[int, int, int]:
        """Numbers of elements, calls and characters of a sub-circuit, including those it calls."""
        if circuit in self._contents:
            return self._contents[circuit]
        if circuit in calling:
            refuse(circuit.card, f".subckt {circuit.name} contains itself")
        if len(calling) > DEEPEST_CALL:
            refuse(circuit.card, f"calls nest deeper than {DEEPEST_CALL} sub-circuits")
        elements = calls = 0
        characters = self._own_characters(circuit)
        for line in circuit.elements:
            target = circuit.find(line.calls)
            inside = self.content(target, (*calling, circuit)) if target else (1, 0, 0)
            elements, calls = elements + inside[0], calls + inside[1] + bool(target)
            characters += inside[2]
            if max(elements, calls) > MOST_ELEMENTS:
                refuse(line.card, f"more than {MOST_ELEMENTS} elements or calls after expansion")
            self._check(line.card, characters)
        self._contents[circuit] = elements, calls, characters
        return self._contents[circuit]

    def _check(self, card, characters):
        if characters > MOST_CHARACTERS:
            refuse(card, f"more than {MOST_CHARACTERS // 1000} kB of netlist after expansion")

    def _own_characters(self, circuit):
        """Number of characters of a sub-circuit's cards and of the definitions within it."""
        if circuit in self._characters:
            return self._characters[circuit]
        cards = [(line.card, line.text) for line in circuit.elements]
        for card, _, pairs in circuit.models.values():
            cards.append((card, " ".join(f"{key}={value}" for key, value in pairs)))
        for values in (circuit.parameters, circuit.local):
            cards += [(circuit.place(name), f"{name}={value}") for name, value in values.items()]
        total = 0
        for card, text in cards:
            length = self._length(text, circuit).own
            if length > LONGEST_EXPANDED:
                refuse(card, f"{text[:40]!r} is longer than {LONGEST_EXPANDED} once expanded")
            total += length
        total += sum(self._own_characters(inner) for inner in circuit.inner.values())
        self._characters[circuit] = total
        return total

    def _add_definitions(self, circuit):
        """Count the definitions of a file, and the expanded text of each function."""
        self._definitions += len(circuit.parameters) + len(circuit.local) + len(circuit.models)
        self._definitions += len(circuit.functions) + len(circuit.inner)
        if self._definitions > MOST_DEFINITIONS:
            refuse(
                circuit.card,
                f"more than {MOST_DEFINITIONS} parameters, functions, models and sub-circuits",
            )
        _check_parameters(circuit)
        for name in circuit.functions:
            self._function(circuit, name, ())
        for inner in circuit.inner.values():
            self._add_definitions(inner)

    def _function(self, circuit, name, calling):
        """Length of a function's expanded text; None if the file does not define it."""
        owner = next((c for c in circuit.around() if name in c.functions), None)
        if owner is None:
            return None
        card, arguments, expression = owner.functions[name]
        key = (owner, name)
        if key in calling:
            refuse(card, f".func {name} calls itself")
        if len(calling) > DEEPEST_CALL:
            refuse(card, f"calls nest deeper than {DEEPEST_CALL} functions")
        if key not in self._functions:
            length = self._length(expression, owner, arguments, (*calling, key))
            if length.own + length.share > LONGEST_EXPANDED:
                refuse(card, f".func {name} is longer than {LONGEST_EXPANDED} once expanded")
            self._functions[key] = length
        return self._functions[key]

    def _length(self, text, circuit, arguments=(), calling=()):
        """Length of a text with every call in it expanded."""
        # For each open parenthesis: its function, the text before it, and the text inside it.
        opened, length = [], Length()
        pieces = _PIECE.findall(text)
        for index, piece in enumerate(pieces):
            if piece == "(":
                function = self._function(circuit, pieces[index - 1] if index else "", calling)
                opened.append((function, length))
                length = Length()
            elif piece == ")" and opened:
                function, before = opened.pop()
                length = before.plus(function.given(length) if function else length).plus(Length(2))
            elif piece in arguments:
                length = length.plus(Length(0, 1))
            else:
                length = length.plus(Length(len(piece)))
        for _, before in reversed(opened):
            length = before.plus(length)
        return length


def _check_parameters(circuit):
    """Raise for cyclic .param; a .param that names itself refers to the enclosing definition."""
    local_values = circuit.local
    graph = {
        name: {word for word in re.findall(r"[a-z_]\w*", value) if word in local_values}
        for name, value in local_values.items()
        if value.startswith("{")
    }
    for name, needed in graph.items():
        if name in needed and name in {**circuit.scope().parameters.parents, **circuit.parameters}:
            needed.discard(name)
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        circle = " → ".join(error.args[1][:5])
        refuse(circuit.place(error.args[1][0]), f".param {circle}: a cyclic definition")
