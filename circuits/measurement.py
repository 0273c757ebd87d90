"""A load's measures as functions of its nodes' voltages and its sources' currents."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from circuits.kernel.flattening import elements, outermost
from circuits.kernel.formula import NotTaken, parse, resolved
from harvester.device.terminals import GROUND
from harvester.errors import NetlistError
from harvester.files.plain_text import nearest
from harvester.record.output_side import STATE

if TYPE_CHECKING:
    from circuits.loads.subcircuits import LoadCircuit

# Letters of elements whose current is an unknown of the circuit.
_WITH_CURRENT = "vehl"


def _truth_of(function):
    """The function's truth values, nan where an argument is: C and numpy would call it false."""

    def truth(*arguments):
        unknown = np.any(np.isnan(np.array(np.broadcast_arrays(*arguments), dtype=float)), axis=0)
        found = function(*arguments)
        return np.where(unknown, np.nan, found) if unknown.any() else found

    return truth


_FUNCTIONS: dict[str, Callable] = {
    "+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "negative": np.negative,
    "^": lambda x, y: np.power(np.abs(x), y),
    "pwr": lambda x, y: np.copysign(np.power(np.abs(x), y), x),
    "abs": np.abs, "exp": np.exp, "ln": np.log, "sqrt": np.sqrt, "sin": np.sin, "cos": np.cos,
    "tan": np.tan, "asin": np.arcsin, "acos": np.arccos, "atan": np.arctan, "sinh": np.sinh,
    "cosh": np.cosh, "tanh": np.tanh, "asinh": np.arcsinh, "max": np.maximum, "min": np.minimum,
    "if": lambda c, x, y: np.where(np.isnan(c), np.nan, np.where(c, x, y)),
    "<": _truth_of(np.less), "<=": _truth_of(np.less_equal), "==": _truth_of(np.equal),
    "and": _truth_of(np.logical_and), "or": _truth_of(np.logical_or),
    "not": _truth_of(np.logical_not), "u": _truth_of(lambda x: np.greater(x, 0.0)),
    "sgn": np.sign, "floor": np.floor, "ceil": np.ceil, "uramp": lambda x: np.maximum(x, 0.0),
}  # fmt: skip


class Measurement(NamedTuple):
    """The measures of a load, ready to be evaluated.

    Attributes
    ----------
    rows : tuple of (str, str)
        Kind and name of each value; what a state takes is a row of the kind `TAKEN`.
    trees : tuple
        Their expressions, see `circuits.kernel.formula`.
    watched : tuple of str
        The unknowns that they are made of: a node's full name, or "i(name)".
    pins : tuple of str
        Those of them that are nodes at the load's pins.
    """

    rows: tuple[tuple[str, str], ...] = ()
    trees: tuple[Any, ...] = ()
    watched: tuple[str, ...] = ()
    pins: tuple[str, ...] = ()

    def values(self, time: np.ndarray, unknowns: np.ndarray, unit: float) -> np.ndarray:
        """Values of all rows at consecutive points.

        Parameters
        ----------
        time : ndarray, shape (n,)
        unknowns : ndarray, shape (len(watched), n)
            In V and A.
        unit : float
            Of a watt and a joule.

        Returns
        -------
        ndarray, shape (len(rows), n)
            Powers and energies in that unit; of states 1 where they hold, else 0. nan where an
            expression has no value.
        """
        found = np.empty((len(self.rows), time.size))
        known = dict(zip(self.watched, unknowns, strict=True))
        with np.errstate(all="ignore"):
            for row, (kind, _), tree in zip(found, self.rows, self.trees, strict=True):
                value = _value(tree, known, time)
                row[:] = _truth_of(np.greater)(value, 0.0) if kind == STATE else unit * value
        return found


NOTHING = Measurement()


def _value(tree, known, time):
    kind = tree[0]
    if kind == "number":
        return tree[1]
    if kind == "time":
        return time
    if kind == "v":
        a, z = (0.0 if node == GROUND else known[node] for node in tree[1:])
        return a - z
    if kind == "i":
        return known[f"i({tree[1]})"]
    return _FUNCTIONS[kind](*(_value(part, known, time) for part in tree[1:]))


def measurement_of(load: LoadCircuit, pins: Mapping[str, str]) -> Measurement:
    """The measures of a load with its pins at these nodes.

    Parameters
    ----------
    load : circuits.loads.subcircuits.LoadCircuit
    pins : dict of str to str
        Full names of the nodes at its pins.

    Raises
    ------
    NetlistError
        An expression needs a node or a current that the load does not have; with file and line.
    """
    if not load.measures:
        return NOTHING
    scope = outermost(load, pins)
    places = list(elements(load, pins))
    known = {GROUND, *pins.values(), *(node for place in places for node in place.nodes)}
    known |= {f"i({place.name})" for place in places if _has_current(place)}
    trees: list[Any] = []
    watched: dict[str, None] = {}
    for measure in load.measures:
        tree = _tree(measure, measure.expression, scope, known, watched)
        trees.append(tree)
        if measure.taking:
            power = _tree(measure, measure.taking, scope, known, watched)
            holds = ("<", ("number", 0.0), tree)
            trees.append(("if", holds, power, ("number", 0.0)))
    outside = tuple(name for name in watched if name in pins.values())
    return Measurement(load.measured, tuple(trees), tuple(watched), outside)


def _has_current(place):
    voltage = place.letter == "b" and "".join(place.words).startswith("v=")
    return voltage or place.letter in _WITH_CURRENT


def _tree(measure, text, scope, known, watched):
    try:
        tree = scope.with_full_names(resolved(parse(text), scope.in_the_circuit, scope.function))
    except NotTaken as reason:
        raise NetlistError(f"{measure.where}: measure: cannot be evaluated: {reason}") from None
    for leaf in _leaves(tree):
        if leaf not in known:
            what = "current" if leaf.startswith("i(") else "node"
            raise NetlistError(
                f"{measure.where}: measure: the load has no {what} {leaf[:60]}"
                f"{nearest(leaf, known)}; a current is that of a V, E, H, L or of a B with v="
            )
        if leaf != GROUND:
            watched[leaf] = None
    return tree


def _leaves(tree):
    if tree[0] == "v":
        yield from tree[1:]
    elif tree[0] == "i":
        yield f"i({tree[1]})"
    elif tree[0] not in ("number", "time"):
        for part in tree[1:]:
            yield from _leaves(part)
