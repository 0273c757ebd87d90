"""Sources in a load that may supply energy, and the power that they absorb.

A converter is often a pair of sources, one of which absorbs the power that the other delivers.
Sources that depend on each other's terminals or currents are counted together.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING

from circuits.netlist.expression import Tree, currents_in, leaves
from circuits.netlist.kinds import BATTERY, LOSS, OUTPUT, SUPPLY
from circuits.netlist.measures import Measure
from circuits.netlist.potentials import has_tree, wave_tree
from harvester.device.terminals import GROUND

if TYPE_CHECKING:
    from circuits.netlist.elements import Element

# Common nodes, which do not make sources depend on each other.
COMMON = frozenset({"n", "ref", GROUND})
_PINS = frozenset({"p", "out"})


def supplies_of(
    elements: Sequence[Element], coupled_nodes: Collection[str], measures: Iterable[Measure]
) -> tuple[Measure, ...]:
    """The power absorbed by each group of a load's sources, as measures of special kinds.

    A constant voltage source is a battery that stores its energy input, unless a measure of the
    file counts its current as output or loss.
    """
    sources = {element.name: element for element in elements if _may_supply(element)}
    booked = {
        name: source
        for name, source in sources.items()
        if _within(source, coupled_nodes) and _current(source) is not None
    }
    counted = {
        name
        for measure in measures
        if measure.kind in (OUTPUT, LOSS)
        for name in currents_in(measure.trees[0])
    }
    groups = ([booked[name] for name in group if name in booked]
              for group in _groups(sources, elements))  # fmt: skip
    return tuple(_measure(group, counted) for group in groups if group)


def unbooked(elements: Iterable[Element]) -> tuple[str, ...]:
    """Sources of unknown power, since only ngspice can evaluate their currents."""
    return tuple(
        element.name for element in elements if _may_supply(element) and not _current(element)
    )


def _may_supply(element: Element) -> bool:
    return element.delivers or (element.letter in "efghb" and element.written_letter not in "rsw")


def _current(element: Element) -> Tree | None:
    """The current from the first node to the second, as an expression; None if unknown."""
    if element.letter == "v" or element.voltage:
        return ("i", element.name)
    tree: Tree
    if element.expression is not None:
        tree = element.expression
    elif element.letter == "i":
        if element.wave and not has_tree(element.wave):
            return None
        tree = wave_tree(element.wave) if element.wave else ("number", element.value)
    else:
        control = ("i", *element.controls) if element.controls else ("v", *element.nodes[2:4])
        tree = ("*", ("number", element.value), control)
    if any(leaf[0] == "call" for leaf in leaves(tree)):
        return None
    return ("*", ("number", element.many), tree)


def _measure(group: Sequence[Element], counted: Collection[str]) -> Measure:
    tree: Tree = ("number", 0.0)
    for source in group:
        tree = ("+", tree, ("*", ("v", *source.nodes[:2]), _current(source)))
    first = group[0]
    stores = len(group) == 1 and first.letter == "v" and first.wave is None
    kind = BATTERY if stores and first.name not in counted else SUPPLY
    name = "_and_".join(source.name.replace(".", "_") for source in group)
    return Measure(kind, name, "", "", first.where, (tree, None))


def coupled(parts: Sequence[Element]) -> frozenset[str]:
    """Nodes of the elements that can exchange energy with a load's pins.

    Elements with only one node in common with others, such as logic signals, cannot, unless a
    converter's sources feed them and others take energy from them.
    """
    islands = joined({*part.ends} - COMMON for part in parts)
    sources = {part.name: part for part in parts if _may_supply(part)}
    groups = _groups(sources, parts)
    reached = {*_PINS}
    waiting = []
    for island in islands:
        shared = {"n" if node == GROUND else node for part in parts if island & {*part.ends}
                  for node in {*part.ends} & COMMON}  # fmt: skip
        if island & _PINS or len(shared) > 1:
            reached |= island
        elif sum(bool(island & {*source.nodes[:2]}) for source in sources.values()) > 1:
            waiting.append(island)
    for _ in islands:
        fed = {node for group in groups if any(_within(sources[name], reached) for name in group)
               for name in group for node in sources[name].nodes[:2]}  # fmt: skip
        reached = reached.union(*(island for island in waiting if island & fed))
    return frozenset(reached)


def _within(source, nodes):
    return {*source.nodes[:2]} - COMMON <= nodes


def joined(ends: Iterable[set[str]]) -> list[set[str]]:
    """Sets of connected nodes, given the ends of each element."""
    islands: list[set[str]] = []
    for nodes in filter(None, ends):
        near = [island for island in islands if island & nodes]
        islands = [island for island in islands if island not in near]
        islands.append(nodes.union(*near))
    return islands


def _groups(sources: dict[str, Element], parts: Sequence[Element]) -> list[list[str]]:
    """Groups of names of sources that are counted together."""
    at: dict[str, list[Element]] = {}
    for part in parts:
        for node in part.ends:
            at.setdefault(node, []).append(part)
    by_name = {part.name: part for part in parts}
    by_current: dict[str, set[str]] = {}
    reached: dict[str, set[str]] = {}
    for name, part in sources.items():
        nodes, currents = {*part.controlling} - {*part.nodes[:2]}, {*part.currents}
        # An ammeter's or coil's current may equal the current of adjacent sources.
        around = {node for i in currents - {*sources} if i in by_name for node in by_name[i].nodes}
        by_current[name] = (currents & {*sources} | _near(around, at, sources)) - {name}
        reached[name] = by_current[name] | _near(nodes, at, sources) - {name}
    for _ in sources:
        reached = {a: near.union(*(reached[b] for b in near)) for a, near in reached.items()}
    groups: list[list[str]] = []
    for name in sources:
        together = [
            group
            for group in groups
            if any(
                other in by_current[name]
                or name in by_current[other]
                or (other in reached[name] and name in reached[other])
                for other in group
            )
        ]
        groups = [group for group in groups if group not in together]
        groups.append([*itertools.chain(*together), name])
    return groups


def _near(nodes: Iterable[str], at: dict, sources: Collection[str]) -> set[str]:
    """Sources that determine the voltages of some nodes, directly or through other elements."""
    near_sources: set[str] = set()
    seen: set[str] = {*COMMON, "p"}
    waiting = [*nodes]
    while waiting:
        node = waiting.pop()
        if node in seen:
            continue
        seen.add(node)
        ports = {part.name for part in at.get(node, ()) if part.name in sources}
        near_sources |= ports
        for part in at.get(node, ()) if not ports else ():
            waiting += [*part.ends, *part.controlling]
            near_sources |= {*part.currents} & {*sources}
    return near_sources
