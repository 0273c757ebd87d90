"""A vetted file to the frozen tree of one load: its calls expanded, every value a number."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NoReturn

from circuits.netlist import part_models, vetting
from circuits.netlist.elements import Element, Model
from circuits.netlist.expansion import called
from circuits.netlist.expression import ExpressionError, NotConstant, Tree, varies
from circuits.netlist.expression import parse as parse_expression
from circuits.netlist.numbers import number
from circuits.netlist.reader import Card
from circuits.netlist.scope import Scope
from circuits.netlist.tree import Subcircuit
from circuits.netlist.vetting import refuse
from circuits.netlist.waveform import KINDS as WAVEFORMS
from circuits.netlist.waveform import waveform

# Letters of elements whose second pair of nodes controls them and carries no current.
_CONTROLLED = "esg"
_EXPRESSIONS = ("value", "vol", "cur")


def outermost(root: Subcircuit, name: str, given: dict[str, float]) -> Scope:
    """The scope of a load's own sub-circuit, its pins by their own names."""
    top = root.inner[name]
    file = Scope(root)
    return Scope(top, given, {pin: pin for pin in top.pins}, "", file, file)


def elements(scope: Scope) -> Iterator[Element]:
    """All elements of a sub-circuit and of the sub-circuits it calls, in order.

    Raises
    ------
    NetlistError
        A value has none, or is none that its element can have.
    """
    for card, words in scope.circuit.elements:
        target = called(scope.circuit, words)
        if target is not None:
            yield from elements(_inside(scope, card, words, target))
            continue
        line = _Line(scope, card, words)
        try:
            yield _READERS[words[0][0]](line)
        except ExpressionError as fault:
            line.refuse(str(fault))


def calls(scope: Scope) -> Iterator[Scope]:
    """A sub-circuit and all that it calls, in order."""
    yield scope
    for card, words in scope.circuit.elements:
        target = called(scope.circuit, words)
        if target is not None:
            yield from calls(_inside(scope, card, words, target))


def _inside(scope, card, words, target):
    bare = [word for word in words if "=" not in word]
    pairs = dict(word.split("=", 1) for word in words if "=" in word)
    try:
        return scope.called(words[0], target, bare[1:-1], pairs)
    except ExpressionError as fault:
        refuse(card, f"{words[0]}: {fault}")


class _Line:
    """One element's card: its words as values, by the names of its scope."""

    def __init__(self, scope: Scope, card: Card, words: list[str]) -> None:
        self.scope, self.card = scope, card
        self.letter, self.name = words[0][0], scope.element(words[0])
        count = vetting.ELEMENTS[self.letter][0]
        if self.letter in "eg" and not words[3].startswith(tuple(f"{k}=" for k in _EXPRESSIONS)):
            count = 4
        self.nodes = tuple(scope.node(node) for node in words[1 : 1 + count])
        self.rest = words[1 + count :]
        self.plain = [word for word in self.rest if "=" not in word or word[0] == "{"]
        named = (word.split("=", 1) for word in self.rest if "=" in word and word[0] != "{")
        self.named = dict(named)

    def refuse(self, fault: str) -> NoReturn:
        """Raise NetlistError with file and line."""
        refuse(self.card, f"{self.name}: {fault}")

    def numbers(self, *without: str) -> dict[str, float]:
        """Values of the element's name=value settings."""
        return {k: self.scope.value(v) for k, v in self.named.items() if k not in without}

    def model(self, name: str) -> Model:
        """A model as it counts here, named by where it is defined."""
        model = self.scope.model(name)
        if model is None:
            self.refuse(f"no .model {name[:60]}")
        scope, (_, kind, pairs) = model
        numbers = tuple((key, scope.value(text)) for key, text in pairs if text)
        return Model(scope.path + name, kind, numbers, tuple(k for k, text in pairs if not text))

    def made(self, **what: Any) -> Element:
        """The element that the line describes."""
        return Element(self.letter, self.name, self.nodes, self.card.where, **what)


def _ordered(line):
    """The model (or None), the values as text and the other numbers of an R, C or L."""
    model, values, bare = None, [], []
    for word in line.rest:
        key, equals, text = word.partition("=") if word[0] != "{" else (word, "", "")
        if equals and key == line.letter:
            values.append(text)
        elif not equals and number(word) is None and line.scope.model(word):
            if model:
                line.refuse("two models: keep one")
            model = line.model(word)
        elif not equals:
            values.append(word)
            bare.append(word)
    if len(bare) > 1:
        line.refuse(f"two values, {' and '.join(bare)[:60]}: keep one")
    return model, values, line.numbers(line.letter)


def _passive(line):
    model, values, numbers = _ordered(line)
    if values and varies(parse_expression(values[-1].strip("{}"))):
        return _varying(line, values[-1], numbers)
    try:
        written_value = line.scope.value(values[-1]) if values else None
    except NotConstant:
        return _varying(line, values[-1], numbers)
    size = part_models.size(line.letter, written_value, model, numbers)
    kept_numbers = tuple((key, numbers[key]) for key in ("m", "ic") if key in numbers)
    many = numbers.get("m", 1.0)
    if line.letter == "l" and (size <= 0.0 or many <= 0.0):
        line.refuse(f"an inductance of {size:g}, {many:g} times: give it a value above 0")
    return line.made(value=size, numbers=kept_numbers)


def _varying(line, text, numbers):
    """A resistor by an expression is a current; C and L only ngspice has."""
    tree = line.scope.tree(text)
    for key in numbers:
        if key != "m" and not (key == "ic" and line.letter != "r"):
            line.refuse(f"{key}= next to an expression: put it into the expression")
    all_numbers = tuple(numbers.items())
    if line.letter != "r":
        return line.made(expression=tree, numbers=all_numbers)
    ohms = ("/", ("v", *line.nodes), tree)
    return line.made(expression=ohms)._replace(letter="b", numbers=all_numbers)


def _coupling(line):
    *names, size = line.plain
    return line.made(value=line.scope.value(size), controls=tuple(map(line.scope.element, names)))


def _with_model(line):
    """D, Q, J and M: further nodes, the model, values without a name, flags."""
    position = next(k for k, word in enumerate(line.plain) if line.scope.model(word))
    model = line.model(line.plain[position])
    flags = tuple(word for word in line.plain[position + 1 :] if word in ("on", "off"))
    bare = [word for word in line.plain[position + 1 :] if word not in ("on", "off")]
    if len(bare) > 1 or (bare and "area" in line.named):
        line.refuse(f"two values after the model, {' '.join(bare)[:40]}: write area=")
    numbers = line.numbers()
    if bare:
        numbers["area"] = line.scope.value(bare[0])
    if line.letter == "d":
        model = part_models.check_diode(line, model, numbers)
    further_nodes = tuple(line.scope.node(node) for node in line.plain[:position])
    return line.made(model=model, numbers=tuple(numbers.items()), flags=flags)._replace(
        nodes=(*line.nodes, *further_nodes)
    )


def _switch(line):
    controls: tuple[str, ...] = ()
    plain = list(line.plain)
    if line.letter == "w":
        controls = (line.scope.element(plain.pop(0)),)
    model = line.model(plain[0])
    asked: Tree = ("i", controls[0]) if controls else ("v", *line.nodes[2:4])
    smooth = part_models.smooth_switch(line, model, asked)
    if smooth is not None:
        current = ("*", ("v", *line.nodes[:2]), smooth)
        return line.made(expression=current)._replace(letter="b", nodes=line.nodes[:2])
    model = part_models.switch(line, model)
    return line.made(model=model, controls=controls, flags=tuple(plain[1:]))


def _source(line):
    """A constant, or a waveform; small-signal parameters (ac) do not count."""
    words = [word for word in line.rest if word not in ("(", ")", ",")]
    constant, kind, amounts, position = None, None, [], 0
    while position < len(words):
        word = words[position]
        key, equals, text = word.partition("=") if word[0] != "{" else (word, "", "")
        position += 1
        if key == "ac":
            position += 0 if equals else _count_numbers(words[position : position + 2])
        elif word == "dc" or (equals and key == "dc"):
            constant = _only(line, constant, text or words[position : position + 1])
            position += 0 if equals else 1
        elif not equals and (word in WAVEFORMS or word in ("am", "sine")):
            if kind:
                line.refuse(f"two waveforms, {kind} and {word}: keep one")
            kind = word
            count = _count_numbers(words[position:])
            amounts = [line.scope.value(text) for text in words[position : position + count]]
            position += count
        elif not equals:
            constant = _only(line, constant, [word])
    if "r" in line.named:
        line.refuse("r=: ngspice 39 and 46 repeat a pwl differently: write its points out")
    value = line.scope.value(constant) if constant else 0.0
    if kind is None:
        return line.made(value=value)
    delay = line.scope.value(line.named["td"]) if "td" in line.named else 0.0
    return line.made(wave=waveform(kind, amounts, delay))


def _only(line, before, words):
    if before is not None:
        line.refuse("two constant values: keep one")
    if not words:
        line.refuse("dc without a value")
    return words if isinstance(words, str) else words[0]


def _count_numbers(words):
    """Number of values before the first word that is no value."""
    keywords = ("dc", "ac", "am", "sine", *WAVEFORMS)
    others = (word in keywords or (word[0] != "{" and "=" in word) for word in words)
    return next((count for count, other in enumerate(others) if other), len(words))


def _by_expression(line, text, voltage):
    return line.made(expression=line.scope.tree(text), voltage=voltage, numbers=_multiplier(line))


def _multiplier(line):
    return (("m", line.scope.value(line.named["m"])),) if "m" in line.named else ()


def _controlled(line):
    """E, G, F and H: a gain, or value={expression}."""
    voltage = line.letter in "eh"
    text = next((line.named[key] for key in _EXPRESSIONS if key in line.named), None)
    if text is not None:
        return _by_expression(line, text, voltage)
    gain = line.scope.value(line.plain[-1])
    controls = (line.scope.element(line.plain[0]),) if line.letter in "fh" else ()
    return line.made(value=gain, controls=controls, voltage=voltage, numbers=_multiplier(line))


def _behavioural(line):
    key = "v" if "v" in line.named else "i"
    return _by_expression(line, line.named[key], key == "v")


_READERS = {
    "r": _passive, "c": _passive, "l": _passive, "k": _coupling, "d": _with_model,
    "q": _with_model, "j": _with_model, "m": _with_model, "s": _switch, "w": _switch,
    "v": _source, "i": _source, "e": _controlled, "g": _controlled, "f": _controlled,
    "h": _controlled, "b": _behavioural,
}  # fmt: skip
