"""A load's measures as functions of its nodes' voltages and its sources' currents."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from circuits.netlist.elements import AMMETER
from circuits.netlist.expression import (
    CIRCUIT_ONLY,
    ExpressionError,
    Tree,
    leaves,
    renamed,
    unknowns_in,
)
from circuits.netlist.kinds import LEVEL, LOSS, OUTPUT, STATE
from circuits.netlist.stores import weights
from circuits.netlist.supplies import COMMON
from circuits.netlist.switching_events import zero_crossings
from harvester.base.errors import NetlistError
from harvester.base.plain_text import named, nearest
from harvester.device.terminals import GROUND

if TYPE_CHECKING:
    from circuits.netlist.elements import Element
    from circuits.netlist.expression_graph import Values
    from circuits.netlist.load_circuit import LoadCircuit
    from circuits.netlist.measures import Measure
    from circuits.netlist.scope import Scope

# Number (even) of evaluations of a discontinuous power within a step.
JUMP_PLACES = 32
# Letters of diodes, switches and transistors, which separate the two sides of a rectifier.
_RECTIFYING = "dswqmj"


@dataclass(frozen=True, eq=False)
class Measurement:
    """The measures of a load, in a form that can be evaluated.

    Attributes
    ----------
    rows : tuple of (str, str)
        Kind and name of each value, levels last; power taken in a state has the kind `TAKEN`.
    trees : tuple
        Expressions of the measures, see `circuits.netlist.expression`.
    watched : tuple of str
        The unknowns in these expressions: a node's full name, or "i(name)".
    pins : tuple of str
        Watched nodes that are pins of the load.
    energy : ndarray
        Energy stored in the load (J), as a quadratic form of the first levels.
    """

    rows: tuple[tuple[str, str], ...] = ()
    trees: tuple[Tree, ...] = ()
    watched: tuple[str, ...] = ()
    pins: tuple[str, ...] = ()
    energy: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    @cached_property
    def _values(self) -> Values:
        return self._compiled(self.trees[: self._measures])

    def _compiled(self, trees: Sequence[Tree]) -> Values:
        # Imported here, since reading a load needs no compiled code.
        from circuits.netlist.expression_graph import Values

        return Values(trees, self.watched)

    @cached_property
    def _measures(self) -> int:
        return sum(kind != LEVEL for kind, _ in self.rows)

    @cached_property
    def _level_places(self) -> tuple[int | None, ...]:
        places: dict[str, int] = {name: index for index, name in enumerate(self.watched)}
        level_trees = self.trees[self._measures :]
        return tuple(places.get((unknowns_in(tree) or [GROUND])[0]) for tree in level_trees)

    def levels(self, unknowns: np.ndarray) -> list[np.ndarray | None]:
        """The levels (V, A) from the unknowns of shape (len(watched), n); None for ground."""
        return [None if index is None else unknowns[index] for index in self._level_places]

    def values(self, time: np.ndarray, unknowns: np.ndarray, unit: float) -> np.ndarray:
        """Values of all measures except levels at consecutive points in time.

        Parameters
        ----------
        time : ndarray, shape (n,)
        unknowns : ndarray, shape (len(watched), n)
            Values of the watched unknowns, in V and A.
        unit : float
            Factor from W and J to the required unit.

        Returns
        -------
        ndarray, shape (measures, n)
            Powers and energies in that unit; states are 1 if true, else 0; undefined values are
            nan. A discontinuous power, such as floor(v(p,n)), is averaged from the middle of one
            step to the middle of the next with interpolated unknowns, so that its trapezoidal
            integral has every jump at the right time.
        """
        if not self._measures:
            return np.empty((0, time.size))
        values = self._values(time, unknowns)
        if self._jumping and time.size > 1:
            values[self._jumping] = self._means(time, unknowns, values[self._jumping])
        for row, (kind, _) in zip(values, self.rows, strict=False):
            if kind == STATE:
                row[:] = np.where(np.isnan(row), np.nan, row > 0.0)
            else:
                row *= unit
        return values

    @cached_property
    def _jumping(self) -> list[int]:
        """Rows of discontinuous powers."""
        rows = enumerate(zip(self.rows, self.trees, strict=True))
        return [
            k for k, ((kind, _), tree) in rows if kind in (LOSS, OUTPUT) and zero_crossings(tree)
        ]

    @cached_property
    def _jumping_values(self) -> Values:
        return self._compiled([self.trees[k] for k in self._jumping])

    def _means(self, time, unknowns, ends):
        """Means of discontinuous powers from mid-step to mid-step; `ends`: values at points."""
        steps, shares = np.diff(time), (np.arange(JUMP_PLACES) + 0.5) / JUMP_PLACES
        inside = np.vstack([time, unknowns])
        inside = inside[:, :-1, None] + np.diff(inside)[..., None] * shares
        times, *voltages = inside.reshape(len(inside), -1)
        halves = self._jumping_values(times, np.array(voltages))
        halves = halves.reshape(len(ends), steps.size, 2, -1).mean(axis=-1)
        before, after = (steps * halves[:, :, half] for half in (1, 0))
        areas = np.pad(before, ((0, 0), (1, 0))) + np.pad(after, ((0, 0), (0, 1)))
        widths = np.pad(steps, (1, 0)) + np.pad(steps, (0, 1))
        return np.divide(areas, widths, out=ends.copy(), where=widths > 0.0)


NOTHING = Measurement()


def measurement_of(load: LoadCircuit, pins: Mapping[str, str]) -> Measurement:
    """The measures of a load with its pins at these nodes.

    Parameters
    ----------
    load : circuits.netlist.load_circuit.LoadCircuit
    pins : dict of str to str
        Full names of the nodes at its pins.
    """
    trees: list[Tree] = []
    for measure in (*load.measures, *load.supplies):
        held, taken_tree = (tree and renamed(tree, pins) for tree in measure.trees)
        trees.append(held)
        if taken_tree:
            trees.append(("if", ("<", ("number", 0.0), held), taken_tree, ("number", 0.0)))
    trees += [
        ("i", name[2:-1]) if name.startswith("i(") else ("v", pins.get(name, name), GROUND)
        for name in (*load.levels, *load.probes)
    ]
    watched = tuple(dict.fromkeys(name for tree in trees for name in unknowns_in(tree)))
    outside = tuple(name for name in watched if name in pins.values())
    return Measurement(load.recorded, tuple(trees), watched, outside, energy_of(load))


def energy_of(load: LoadCircuit) -> np.ndarray:
    """Energy of the capacitors and coils of a load (J), as a quadratic form of its levels.

    Elements with an expression as value and elements of logic signals are excluded.
    """
    held = {store.name: weights(store, load.levels) for store in load.stores}
    sizes = {
        element.name: element.size
        for element in load.elements
        if element.name in held and element.size and {*element.nodes} - COMMON <= load.coupled
    }
    form = np.zeros((len(load.levels), len(load.levels)))
    for name, size in sizes.items():
        form += 0.5 * size * np.outer(held[name], held[name])
    for coupling in load.elements:
        coils = [name for name in coupling.controls if name in sizes]
        for a, b in itertools.combinations(coils, 2):
            mutual = (coupling.value or 0.0) * math.sqrt(sizes[a] * sizes[b])
            form += 0.5 * mutual * (np.outer(held[a], held[b]) + np.outer(held[b], held[a]))
    return form


class Probe(NamedTuple):
    """A voltage between two nodes of a load, or a current.

    Attributes
    ----------
    column : its name in a waveform.
    name : a node, or "i(name)".
    reference : the node that the voltage is measured against; "" for a current.
    """

    column: str
    name: str
    reference: str

    def value(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """The voltage or current from the values of nodes and currents."""
        return values[self.name] - values[self.reference] if self.reference else values[self.name]


def probes_of(load: LoadCircuit, names: Iterable[str]) -> tuple[Probe, ...]:
    """Read "a", "v(a)", "v(a,b)" and "i(name)".

    A node of the DC side is measured against that side's reference, other nodes against the pin n.

    Raises
    ------
    NetlistError
        The load has no such node or current.
    """
    known_nodes = {*load.pins, *(node for part in load.elements for node in part.nodes)} - {GROUND}
    known_nodes |= {f"i({part.name})" for part in load.elements if part.has_current}
    # The voltage of the reference is always against n.
    direct = _direct_current_side(load) - {*load.pins[3:]}
    probes = {}
    for text in names:
        column = re.sub(r"\s", "", text.lower())
        voltage = re.fullmatch(r"v\(([^,]*)(?:,([^,]*))?\)", column)
        name, reference = voltage.groups() if voltage else (column, None)
        if not reference:
            column, reference = name, load.pins[3] if name in direct else load.pins[1]
        for node in (name, reference):
            if node not in known_nodes:
                # i(D1), @d1[id] or d1: the current of an element that has none in SPICE.
                words = {*re.findall(r"[\w.]+", node)}
                of_element = words & {part.name for part in load.elements if not part.has_current}
                hint = f": {AMMETER}" if of_element else nearest(node, known_nodes)
                raise NetlistError(
                    f"{load.file or load.name}: no node or current {named(node)}{hint}; there are "
                    f"{', '.join(sorted(known_nodes))}"
                )
        probes[column] = Probe(column, name, "" if name.startswith("i(") else reference)
    return tuple(probes.values())


def _direct_current_side(load):
    """Nodes connected to the output by non-rectifying elements, not through p or n."""
    if not load.has_output:
        return set()
    side = {*load.pins[2:]}
    joined = [{*part.nodes[:2]} for part in load.elements if part.letter not in _RECTIFYING]
    while reached := {*()}.union(*(e for e in joined if e & side)) - {*load.pins[:2]} - side:
        side |= reached
    return side


def evaluated(
    measures: tuple[Measure, ...], scope: Scope, parts: tuple[Element, ...]
) -> tuple[Measure, ...]:
    """The measures with their expressions resolved to nodes and sources of the load.

    Raises
    ------
    NetlistError
        An expression needs a node or a current that the load does not have; with file and line.
    """
    known_nodes = {*scope.nodes.values(), *(node for part in parts for node in part.nodes)}
    known_nodes |= {f"i({part.name})" for part in parts if part.has_current}

    def read(measure: Measure, text: str) -> Any:
        if not text:
            return None
        try:
            tree = scope.tree(text)
            only = next((leaf[1] for leaf in leaves(tree) if leaf[0] == "call"), None)
            if only in CIRCUIT_ONLY:
                raise ExpressionError(f"only ngspice has the function {only}()")
        except ExpressionError as reason:
            raise NetlistError(f"{measure.where}: measure: cannot be evaluated: {reason}") from None
        _check_known(measure, tree, known_nodes)
        return tree

    return tuple(
        measure._replace(trees=(read(measure, measure.expression), read(measure, measure.taking)))
        for measure in measures
    )


def _check_known(measure, tree, unknowns):
    for name in unknowns_in(tree):
        if name not in unknowns:
            kind = "current" if name.startswith("i(") else "node"
            raise NetlistError(
                f"{measure.where}: measure: the load has no {kind} {name[:60]}"
                f"{nearest(name, unknowns)}; there are {', '.join(sorted(unknowns - {GROUND}))}"
                f"{f'; {AMMETER}' * name.startswith('i(')}"
            )
