"""Converts a vetted file to the elements of a load: calls expanded, values evaluated."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NoReturn

from circuits.netlist import part_models
from circuits.netlist.elements import Element, Model
from circuits.netlist.expression import ExpressionError, NotConstant, Tree, varies
from circuits.netlist.expression import parse as parse_expression
from circuits.netlist.scope import Scope
from circuits.netlist.tree import Subcircuit
from circuits.netlist.vetting import Line, refuse
from circuits.netlist.waveform import waveform


def outermost(root: Subcircuit, name: str, parameters: dict[str, float]) -> Scope:
    """The scope of a load's top sub-circuit, whose pins keep their names."""
    top = root.inner[name]
    file = Scope(root)
    return Scope(top, parameters, {pin: pin for pin in top.pins}, "", file, file)


def elements(scope: Scope) -> Iterator[Element]:
    """All elements of a sub-circuit and of the sub-circuits it calls, in order.

    Raises
    ------
    NetlistError
        A value cannot be evaluated, or is not allowed for its element.
    """
    for line in scope.circuit.elements:
        if line.calls:
            yield from elements(_inside(scope, line))
            continue
        part = _ScopedLine(scope, line)
        try:
            yield _READERS[part.letter](part)
        except ExpressionError as fault:
            part.refuse(str(fault))


def calls(scope: Scope) -> Iterator[Scope]:
    """A sub-circuit and all sub-circuits that it calls, in order."""
    yield scope
    for line in scope.circuit.elements:
        if line.calls:
            yield from calls(_inside(scope, line))


def _inside(scope, line):
    target = scope.circuit.find(line.calls)
    try:
        return scope.called(line.name, target, line.nodes, line.named)
    except ExpressionError as fault:
        refuse(line.card, f"{line.name}: {fault}")


class _ScopedLine:
    """One element's line, evaluated in its scope."""

    def __init__(self, scope: Scope, line: Line) -> None:
        self.scope, self.line = scope, line
        self.letter, self.name = line.name[0], scope.element(line.name)
        self.nodes = tuple(map(scope.node, line.nodes))
        self.controls = tuple(map(scope.element, line.controls))

    def refuse(self, fault: str) -> NoReturn:
        """Raise NetlistError with file and line."""
        refuse(self.line.card, f"{self.name}: {fault}")

    def numbers(self) -> dict[str, float]:
        """Values of the element's name=value settings."""
        return {key: self.scope.value(text) for key, text in self.line.named.items()}

    def model(self) -> Model | None:
        """The element's model with numbers, named by its definition's path, or None."""
        if not self.line.models:
            return None
        name = self.line.models[0]
        definition = self.scope.model(name)
        assert definition is not None
        scope, (_, kind, pairs) = definition
        numbers = tuple((key, scope.value(text)) for key, text in pairs if text)
        return Model(scope.path + name, kind, numbers, tuple(k for k, text in pairs if not text))

    def made(self, **changes: Any) -> Element:
        """The element that the line describes."""
        basis = Element(self.letter, self.name, self.nodes, self.line.card.where)
        return basis._replace(**changes)


def _passive(part):
    values, bare = part.line.values, part.line.bare
    if len(part.line.models) > 1:
        part.refuse("two models: keep one")
    model = part.model()
    if len(bare) > 1:
        part.refuse(f"two values, {' and '.join(bare)[:60]}: keep one")
    numbers = part.numbers()
    if values and varies(parse_expression(values[-1].strip("{}"))):
        return _varying(part, values[-1], numbers)
    try:
        written_value = part.scope.value(values[-1]) if values else None
    except NotConstant:
        return _varying(part, values[-1], numbers)
    size = part_models.size(part.letter, written_value, model, numbers)
    kept_numbers = tuple((key, numbers[key]) for key in ("m", "ic") if key in numbers)
    many = numbers.get("m", 1.0)
    if part.letter == "l" and (size <= 0.0 or many <= 0.0):
        part.refuse(f"inductance {size:g}, m={many:g}: must be above 0")
    return part.made(value=size, numbers=kept_numbers)


def _varying(part, text, numbers):
    """A resistor given by an expression becomes a current; C and L need ngspice."""
    tree, letter = part.scope.tree(text), part.letter
    for key in numbers:
        if key != "m" and not (key == "ic" and letter != "r"):
            part.refuse(f"{key}= next to an expression: put it into the expression")
    if letter == "r":
        letter, tree = "b", ("/", ("v", *part.nodes), tree)
    return part.made(letter=letter, expression=tree, numbers=tuple(numbers.items()))


def _coupling(part):
    return part.made(value=part.scope.value(part.line.values[0]), controls=part.controls)


def _with_model(part):
    """D, Q, J and M: more nodes, the model, values without a name, flags."""
    values, numbers = part.line.values, part.numbers()
    if len(values) > 1 or (values and "area" in numbers):
        part.refuse(f"two values after the model, {' '.join(values)[:40]}: write area=")
    if values:
        numbers["area"] = part.scope.value(values[0])
    model = part.model()
    if part.letter == "d":
        model = part_models.check_diode(part, model, numbers)
    return part.made(model=model, numbers=tuple(numbers.items()), flags=(*part.line.flags,))


def _switch(part):
    controls, model = part.controls, part.model()
    control: Tree = ("i", controls[0]) if controls else ("v", *part.nodes[2:4])
    smooth = part_models.smooth_switch(part, model, control)
    if smooth is not None:
        current = ("*", ("v", *part.nodes[:2]), smooth)
        return part.made(letter="b", expression=current, nodes=part.nodes[:2])
    model = part_models.switch(part, model)
    return part.made(model=model, controls=controls, flags=(*part.line.flags,))


def _source(part):
    """A constant, or a waveform; small-signal parameters (ac) are ignored."""
    values, waves, numbers = part.line.values, part.line.waves, part.numbers()
    if len(waves) > 1:
        part.refuse(f"two waveforms, {waves[0][0]} and {waves[1][0]}: keep one")
    if len(values) > 1:
        part.refuse("two constant values: keep one")
    if "r" in numbers:
        part.refuse("r=: ngspice 39 and 46 repeat a pwl differently: write all its points")
    value = part.scope.value(values[0]) if values else 0.0
    if not waves:
        return part.made(value=value)
    ((kind, amounts),) = waves
    amounts = [*map(part.scope.value, amounts)]
    return part.made(wave=waveform(kind, amounts, numbers.get("td", 0.0)))


def _controlled(part):
    """E, G, F, H and B: an expression, or a gain."""
    line, numbers = part.line, tuple(part.numbers().items())
    if line.expression:
        tree = part.scope.tree(line.expression)
        return part.made(expression=tree, voltage=line.voltage, numbers=numbers)
    gain = part.scope.value(line.values[0])
    return part.made(value=gain, controls=part.controls, voltage=line.voltage, numbers=numbers)


_READERS = {
    "r": _passive, "c": _passive, "l": _passive, "k": _coupling, "d": _with_model,
    "q": _with_model, "j": _with_model, "m": _with_model, "s": _switch, "w": _switch,
    "v": _source, "i": _source, "e": _controlled, "g": _controlled, "f": _controlled,
    "h": _controlled, "b": _controlled,
}  # fmt: skip
