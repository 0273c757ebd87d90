"""Layout of a schematic's elements.

Every node of the circuit is drawn as a horizontal line, a rail, and every element as a vertical
column that connects two rails, as the rungs of a ladder that lies on its side. Elements in series
share one column if no other element is connected between them. Rails and columns are ordered so
that the wires are short and rarely cross.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from circuits.netlist.topology import GROUND

if TYPE_CHECKING:
    from circuits.netlist.topology import Part

# Cost of a crossing of two wires, as a length of wire in rows or columns.
CROSSING_COST = 3.0


@dataclass(frozen=True)
class Column:
    """One element, or several in series, between two rails.

    Attributes
    ----------
    nodes : tuple of str
        The first rail, the nodes between the elements in order, and the second rail: one more node
        than parts.
    parts : tuple of circuits.netlist.topology.Part
    """

    nodes: tuple
    parts: tuple

    @property
    def ends(self) -> tuple[str, str]:
        """The two rails that the column connects."""
        return self.nodes[0], self.nodes[-1]


@dataclass(frozen=True)
class Ladder:
    """The layout: columns from left to right, and the height of every rail.

    Attributes
    ----------
    columns : tuple of Column
    rows : dict of str to int
        Row of each rail, from 0 at the bottom. The rails of a column with n parts are at least n
        rows apart.
    """

    columns: tuple
    rows: dict


def lay_out(
    parts: list[Part], left: tuple[str, ...] = (), right: tuple[str, ...] = (), series: bool = True
) -> Ladder:
    """Choose an order of rails and columns with short wires.

    Parameters
    ----------
    parts : iterable of circuits.netlist.topology.Part
    left, right : sequence of str
        Nodes with external connections on this side; each gets a rail.
    series : bool
        Whether elements in series share a column; otherwise every node gets a rail.
    """
    parts = [part for part in parts if len(part.nodes) > 1]
    rail_nodes = {
        *left,
        *right,
        GROUND,
        *(() if series else (n for part in parts for n in part.nodes)),
    }
    columns = _columns(parts, rail_nodes)
    rails = list(dict.fromkeys([*left, *right, *(n for c in columns for n in c.ends)]))
    if GROUND in rails:
        rails.remove(GROUND)
    grounded = [GROUND] * any(GROUND in column.ends for column in columns)

    def cost(trial_rails=None, trial_columns=None):
        order = [*(trial_rails or rails), *grounded]
        return _cost(order, trial_columns or columns, left, right)

    before = None
    while before != (rails, columns):
        before = (rails, columns)
        rails = _improve(rails, lambda order: cost(trial_rails=order))
        columns = _improve(columns, lambda order: cost(trial_columns=order))
    if left and not grounded and rails.index(left[0]) > rails.index(left[-1]):
        rails.reverse()
    return Ladder(tuple(columns), _rows([*rails, *grounded], columns))


def _columns(parts, rail_nodes):
    """Columns of all elements; elements in series without a branch are joined."""
    ends: dict[str, list] = {}
    for part in parts:
        for node in part.ends:
            ends.setdefault(node, []).append(part)
    # A transistor's gate is written next to its rail, so the node needs a rail.
    rail_nodes = rail_nodes | {node for part in parts for node in part.beside}
    inner = {n for n, at in ends.items() if n not in rail_nodes and len(at) == 2 and at[0] != at[1]}
    columns: list[Column] = []
    placed: set[str] = set()
    starts = [part for part in parts if not inner.issuperset(part.ends)]
    for part in [*starts, *parts]:
        if part.name in placed:
            continue
        nodes = part.ends if part.ends[0] not in inner else part.ends[::-1]
        nodes, chain = list(nodes), [part]
        while nodes[-1] in inner:
            following = next(p for p in ends[nodes[-1]] if p != chain[-1])
            if following in chain:
                break
            a, b = following.ends
            nodes.append(b if a == nodes[-1] else a)
            chain.append(following)
        placed.update(p.name for p in chain)
        half = len(chain) // 2
        # A chain that starts and ends on the same rail is split at its middle node.
        cuts = (0, half, len(chain)) if half and nodes[0] == nodes[-1] else (0, len(chain))
        columns += [Column(tuple(nodes[a : b + 1]), tuple(chain[a:b])) for a, b in pairwise(cuts)]
    return columns


def _cost(rails, columns, left, right):
    """Total length of the wires, plus `CROSSING_COST` per crossing."""
    row = {node: position for position, node in enumerate(rails)}
    reach: dict[str, list[int]] = {node: [] for node in rails}
    for position, column in enumerate(columns):
        for node in column.ends:
            reach[node].append(position)
    for node in left:
        reach[node].append(-1)
    for node in right:
        reach[node].append(len(columns))
    total = float(sum(max(at) - min(at) for at in reach.values() if at))
    for position, column in enumerate(columns):
        top, bottom = sorted(row[node] for node in column.ends)
        total += bottom - top
        for node in rails[top + 1 : bottom]:
            if reach[node] and min(reach[node]) < position < max(reach[node]):
                total += CROSSING_COST
    return total


def _improve(order, cost):
    """Local search: move single entries of the order as long as that lowers the cost."""
    best, least = list(order), cost(order)
    moved = True
    while moved:
        moved = False
        for start in range(len(best)):
            for end in range(len(best)):
                trial = best.copy()
                trial.insert(end, trial.pop(start))
                value = cost(trial)
                if value < least:
                    best, least, moved = trial, value, True
    return best


def _rows(rails, columns):
    """Rows of the rails, from the bottom, such that every column has room for its elements."""
    rows = dict.fromkeys(rails[-1:], 0)
    for below, rail in pairwise(reversed(rails)):
        needed = [rows[below] + 1]
        for column in columns:
            if rail in column.ends:
                other = column.ends[column.ends[0] == rail]
                if other in rows:
                    needed.append(rows[other] + len(column.parts))
        rows[rail] = max(needed)
    return rows
