"""Resolution of names in each call of a sub-circuit, by ngspice's rules.

A parameter is looked up in the calling sub-circuit, then in its callers up to the file. A value
given in the call has precedence over a .param of the sub-circuit, and this over the default in its
.subckt line. Functions, models and sub-circuits are looked up in the enclosing *definitions*. A
function's text replaces its call, so that its free names refer to the caller's scope.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

from circuits.netlist.expression import (
    ExpressionError,
    Names,
    NotConstant,
    Tree,
    is_constant,
    leaves,
    parse,
    replaced,
    resolved,
)
from circuits.netlist.functions import CONSTANTS
from circuits.netlist.numbers import number
from circuits.netlist.tree import Subcircuit
from harvester.device.terminals import GROUND

# Constants with precedence over parameters in ngspice's behavioural sources.
_FIRST = ("pi", "e")


class Scope:
    """One call of a sub-circuit: the given values and the nodes.

    Parameters
    ----------
    circuit : Subcircuit
    given : dict of str to float
        Values of parameters that are given in the call.
    nodes : mapping of str to str
        Full names of the nodes at its pins.
    path : str
        The calls that lead to it: "xbridge.".
    parent, caller : Scope or None
        Scopes of the enclosing definition, and of the caller; None for the file.
    """

    def __init__(
        self,
        circuit: Subcircuit,
        given: Mapping[str, float] | None = None,
        nodes: Mapping[str, str] | None = None,
        path: str = "",
        parent: Scope | None = None,
        caller: Scope | None = None,
    ) -> None:
        self.circuit, self.given, self.nodes = circuit, given or {}, nodes or {}
        self.path, self.parent, self.caller = path, parent, caller
        self._under_way: set[str] = set()
        self._values: dict[str, float] = {}

    def value(self, text: str) -> float:
        """A number, a parameter's name or an expression in braces as a number.

        Raises
        ------
        ExpressionError
        """
        size = number(text)
        if size is not None:
            return size
        names = Names(lambda name: ("number", self.parameter(name)), self.function, True)
        result = resolved(parse(text.strip("{}")), names)
        if not is_constant(result):
            raise NotConstant("must be constant, but changes during the run")
        return float(result[1])

    def tree(self, text: str) -> Tree:
        """An expression of the circuit's solution, with full names of nodes and sources.

        Raises
        ------
        ExpressionError
        """
        names = Names(self._of_circuit, self.function)
        tree = replaced(resolved(parse(text.strip("{}")), names), self._with_full_names)
        for leaf in leaves(tree):
            if leaf[:2] == ("call", "pwl"):
                _check_points(leaf[3:])
        return tree

    def _of_circuit(self, name):
        """The tree of a name in an expression of voltages and currents."""
        if name == "time":
            return ("time",)
        if name == "hertz":
            raise NotConstant("hertz is defined only in an AC analysis: remove it")
        value = self.parameter(name)
        if name in _FIRST and not math.isclose(value, CONSTANTS[name], rel_tol=1e-6):
            raise ExpressionError(f"{name} is a constant of ngspice: rename the parameter")
        return ("number", value)

    def parameter(self, name: str) -> float:
        """The value of a parameter, from here outwards along the calls.

        Raises
        ------
        ExpressionError
        """
        if name in ("time", "hertz"):
            raise NotConstant(f"{name} changes during the run: write a constant")
        if name not in self._under_way:
            if name in self.given:
                return self.given[name]
            for values in (self.circuit.local, self.circuit.parameters):
                if name in values:
                    return self._evaluated(name, values[name])
        if self.caller is not None:
            return self.caller.parameter(name)
        if name in CONSTANTS:
            return CONSTANTS[name]
        raise ExpressionError(f"unknown name {name[:60]}: define it by .param")

    def _evaluated(self, name, text):
        """Evaluate a parameter; within its own value, its name refers to the enclosing scope."""
        if name in self._values:
            return self._values[name]
        alone = not self._under_way
        self._under_way.add(name)
        try:
            value = self.value(text)
        finally:
            self._under_way.discard(name)
        if alone:
            self._values[name] = value
        return value

    def function(self, name: str) -> Any:
        """(arguments, tree, lookup of functions in its scope) of a file's function, or None."""
        for scope in self.outwards():
            if name in scope.circuit.functions:
                _, arguments, expression = scope.circuit.functions[name]
                return arguments, parse(expression), scope.function
        return None

    def model(self, name: str) -> tuple[Scope, Any] | None:
        """The scope of a model's definition, and (card, kind, pairs); or None."""
        for scope in self.outwards():
            if name in scope.circuit.models:
                return scope, scope.circuit.models[name]
        return None

    def outwards(self) -> Iterator[Scope]:
        """Yield this scope and its enclosing definitions, from inside out."""
        scope: Scope | None = self
        while scope is not None:
            yield scope
            scope = scope.parent

    def node(self, name: str) -> str:
        """The full name of a node."""
        if name in ("0", "gnd"):
            return GROUND
        return self.nodes.get(name, f"{self.path}{name}")

    def element(self, name: str) -> str:
        """The full name of an element. Only calls (names with x first) are followed by a dot."""
        return self.path + (name if name[0] == "x" else name.replace(".", ":"))

    def _with_full_names(self, leaf):
        """A voltage or current with the full names of its nodes or source."""
        if leaf[0] == "v":
            return ("v", *map(self.node, leaf[1:]))
        return ("i", self.element(leaf[1])) if leaf[0] == "i" else leaf

    def called(self, name: str, target: Subcircuit, pins: list[str], texts: dict[str, str]) -> Any:
        """The scope of a call from here, values given as text.

        Raises
        ------
        ExpressionError
            A name in a value has another meaning inside the called sub-circuit, which ngspice would
            use.
        """
        values = {key: self.value(text) for key, text in texts.items()}
        nodes = {pin: self.node(node) for pin, node in zip(target.pins, pins, strict=True)}
        parent = next(outer for outer in self.outwards() if outer.circuit is target.outer)
        inside = Scope(target, values, nodes, f"{self.element(name)}.", parent, self)
        for key, text in texts.items():
            inside._check_given(key, text, values[key])
        return inside

    def _check_given(self, key, text, value):
        """Raise if names in a value have another meaning here, which ngspice would use."""
        if number(text) is not None:
            return
        own_names = {*self.given, *self.circuit.local, *self.circuit.parameters}
        names = {leaf[1] for leaf in leaves(parse(text.strip("{}"))) if leaf[0] == "name"}
        hidden = (names & own_names) - {key}
        self._under_way.add(key)
        try:
            other = self.value(text) if hidden else value
        except ExpressionError:
            return
        finally:
            self._under_way.discard(key)
        if other != value:
            raise ExpressionError(
                f"{key}={text[:40]}: {self.circuit.name} also has a parameter {min(hidden)}, whose "
                "value ngspice would use here: rename one of them"
            )


def _check_points(points):
    """Raise for points of a pwl that ngspice refuses only when it runs."""
    if any(not is_constant(point) for point in points):
        raise ExpressionError("a point of pwl changes during the run: write constants")
    abscissas = [point[1] for point in points[::2]]
    if any(right <= left for left, right in pairwise(abscissas)):
        listed = ", ".join(f"{abscissa:g}" for abscissa in abscissas[:8])
        raise ExpressionError(f"pwl at {listed}: write its points in ascending order")
