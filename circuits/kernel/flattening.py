"""A vetted load as one list of elements: its calls expanded, every value a number."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

from circuits.kernel.formula import CONSTANTS, NotTaken, parse, resolved
from circuits.loads import tree, vetting
from circuits.loads.expansion import called
from circuits.loads.places import lines_of
from circuits.loads.reader import statements
from harvester.device.terminals import GROUND
from harvester.errors import LoadError

if TYPE_CHECKING:
    from circuits.loads.subcircuits import LoadCircuit


class Place(NamedTuple):
    """An element of the expanded load.

    Attributes
    ----------
    letter : its kind.
    name : the calls on the way to it and its own, "xbridge.dupper".
    nodes : names of nodes, those of the load's pins as they are there.
    words : what follows them.
    scope : where its names mean something.
    where : "file:line".
    """

    letter: str
    name: str
    nodes: tuple[str, ...]
    words: list[str]
    scope: Scope
    where: str

    def refuse(self, reason: str) -> NoReturn:
        """Raise LoadError: the compiled engine does not take this element.

        Raises
        ------
        LoadError
        """
        raise LoadError(
            f"{self.where}: {self.name}: Monte Carlo does not take {reason}; use the circuit engine"
        )

    def value(self, text: str) -> float:
        """A number or an expression of parameters in braces as a float."""
        try:
            return self.scope.value(text)
        except NotTaken as reason:
            self.refuse(str(reason))

    def tree(self, text: str) -> tuple[Any, ...]:
        """An expression of the circuit's solution, its nodes and sources by their full names."""
        try:
            found = resolved(parse(text), self.scope.in_the_circuit, self.scope.function)
            return self.scope.with_full_names(found)
        except NotTaken as reason:
            self.refuse(str(reason))

    def model(self, name: str) -> tuple[str, dict[str, float], Scope]:
        """See `Scope.model`."""
        try:
            return self.scope.model(name)
        except NotTaken as reason:
            self.refuse(str(reason))

    def pairs(self) -> dict[str, str]:
        """The words of the form name=value."""
        found = (word.partition("=") for word in self.words if "=" in word and word[0] != "{")
        return {name: value for name, _, value in found}

    def plain(self) -> list[str]:
        """The other words."""
        return [word for word in self.words if "=" not in word or word[0] == "{"]

    def size(self) -> str:
        """The text of an R's, C's or L's value, or its model's name."""
        return (self.plain() or [self.pairs()[self.letter]])[0]


class Scope:
    """One call of a sub-circuit: the values of its parameters and its nodes."""

    def __init__(
        self,
        circuit: tree.Subcircuit,
        given: dict[str, float],
        nodes: Mapping[str, str],
        path: str,
        parent: Scope | None,
    ) -> None:
        self.circuit, self.given, self.nodes = circuit, given, nodes
        self.path, self.parent = path, parent

    def value(self, text: str) -> float:
        """A number, or an expression in braces."""
        size = vetting.number(text)
        if size is not None:
            return size
        found = resolved(parse(text.strip("{}")), self.parameter, self.function, signed_power=True)
        if found[0] != "number":
            raise NotTaken(f"the changing value {text[:40]}")
        return found[1]

    def parameter(self, name: str) -> tuple[Any, ...]:
        """The value of a parameter as a tree, from here outwards."""
        own = self.circuit
        if name in self.given:
            return ("number", self.given[name])
        for values in (own.local, own.parameters):
            if name in values and name not in getattr(self, "_under_way", ()):
                self._under_way = {*getattr(self, "_under_way", ()), name}
                try:
                    return ("number", self.value(values[name]))
                finally:
                    self._under_way = self._under_way - {name}
        if self.parent is None:
            if name in CONSTANTS:
                return ("number", CONSTANTS[name])
            raise NotTaken(f"the name {name}")
        return self.parent.parameter(name)

    def in_the_circuit(self, name: str) -> tuple[Any, ...]:
        """What a name means in an expression of the circuit's solution."""
        if name == "time":
            return ("time",)
        if name in CONSTANTS:
            # There ngspice's own go first.
            return ("number", CONSTANTS[name])
        if name == "hertz":
            raise NotTaken("hertz")
        return self.parameter(name)

    def function(self, name: str) -> tuple[Any, ...] | None:
        """(arguments, expression, names) of one of the file's functions, or None."""
        scope: Scope | None = self
        while scope is not None:
            if name in scope.circuit.functions:
                _, arguments, expression = scope.circuit.functions[name]
                return arguments, expression, scope.in_the_circuit
            scope = scope.parent
        return None

    def model(self, name: str) -> tuple[str, dict[str, float], Scope]:
        """(kind, values as numbers, flags) of a model, evaluated where it stands."""
        scope = next(each for each in self.outwards() if name in each.circuit.models)
        _, kind, pairs = scope.circuit.models[name]
        return kind, {key: scope.value(text) for key, text in pairs if text}, scope

    def outwards(self) -> Iterator[Scope]:
        """This one and those around it."""
        yield self
        if self.parent is not None:
            yield from self.parent.outwards()

    def node(self, name: str) -> str:
        """The full name of a node."""
        if name in ("0", "gnd"):
            return GROUND
        return self.nodes.get(name, f"{self.path}{name}")

    def with_full_names(self, found: tuple[Any, ...]) -> tuple[Any, ...]:
        """A tree with its nodes and sources by their full names."""
        kind = found[0]
        if kind == "v":
            return ("v", self.node(found[1]), self.node(found[2]))
        if kind == "i":
            return ("i", f"{self.path}{found[1]}")
        if kind in ("number", "time"):
            return found
        return (kind, *(self.with_full_names(part) for part in found[1:]))

    def defining(self, circuit: tree.Subcircuit) -> Scope:
        """The scope around a called sub-circuit: that of the one it is defined in."""
        scope = self
        while scope.parent is not None and scope.circuit is not circuit.outer:
            scope = scope.parent
        return scope


def elements(load: LoadCircuit, pins: Mapping[str, str]) -> Iterator[Place]:
    """All elements of a load.

    Parameters
    ----------
    load : circuits.loads.subcircuits.LoadCircuit
    pins : dict of str to str
        Full names of the nodes at its pins.

    Raises
    ------
    LoadError
        A value is none that a compiled circuit takes.
    """
    yield from _inside(outermost(load, pins), lines_of(load))


def outermost(load: LoadCircuit, pins: Mapping[str, str]) -> Scope:
    """The scope of a load's own sub-circuit."""
    root = tree.parse(statements(load.text, "load"), "load")
    around = Scope(root, {}, {}, "", None)
    return Scope(root.inner[load.name], dict(load.parameters), pins, "", around)


def calls(load: LoadCircuit, pins: Mapping[str, str]) -> Iterator[Scope]:
    """The load's own sub-circuit and all that it calls, in order; as `elements`."""
    yield from _calls(outermost(load, pins), lines_of(load))


def _calls(scope, places):
    yield scope
    for card in scope.circuit.elements:
        target = called(scope.circuit, card.text.split())
        if target is not None:
            yield from _calls(_called(scope, card, target, places), places)


def _inside(scope, places):
    for card in scope.circuit.elements:
        words = card.text.split()
        name = words[0]
        where = places.get((scope.circuit.name, name), "the load")
        target = called(scope.circuit, words)
        if target is None:
            count = 4 if name[0] == "s" else vetting.ELEMENTS[name[0]][0]
            if name[0] in "eg" and not words[3].startswith(("value=", "vol=", "cur=")):
                count = 4
            nodes = tuple(scope.node(node) for node in words[1 : 1 + count])
            yield Place(name[0], scope.path + name, nodes, words[1 + count :], scope, where)
            continue
        yield from _inside(_called(scope, card, target, places), places)


def _called(scope, card, target, places):
    """The scope of a call."""
    words = card.text.split()
    name = words[0]
    where = places.get((scope.circuit.name, name), "the load")
    call = Place("x", scope.path + name, (), words, scope, where)
    given = {key: call.value(text) for key, text in call.pairs().items()}
    bare = call.plain()
    nodes = {pin: scope.node(node) for pin, node in zip(target.pins, bare[1:-1], strict=True)}
    return Scope(target, given, nodes, f"{scope.path}{name}.", scope.defining(target))
