"""Draws the schematic of a scene's circuit from its netlist."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from circuits.equivalent import elements
from circuits.equivalent.schematic.ladder import lay_out
from circuits.equivalent.schematic.symbols import (
    COLUMN,
    INK,
    LETTER,
    NODE_COLOUR,
    ROW,
    VALUE_COLOUR,
    VALUE_SIZE,
    Pen,
    plain,
    schemdraw_library,
    width,
)
from circuits.netlist.topology import GROUND, read_topology
from harvester.base.errors import OutputError
from harvester.base.writing import whole_file
from harvester.scene.calling import scene_of
from harvester.scene.prepared import prepared

if TYPE_CHECKING:
    from harvester.scene.calling import SceneOrName

FORMATS = (".svg", ".png")
LOAD_SIDE = (elements.OUTPUT, elements.REFERENCE)
TITLE_SIZE, BOX_TITLE_SIZE = 14, 13
# Lengths in schemdraw's units: gap between parts of the drawing, padding of boxes, wires out of
# boxes.
GAP, PADDING, LEAD = 1.8, 0.7, 0.8
# Largest width of the mechanical side, which then continues in another row.
WIDEST_ROW = 17.0


@dataclass(frozen=True)
class Schematic:
    """A drawn circuit, displayed in notebooks.

    Attributes
    ----------
    names : tuple of str
        Names of its elements in the netlist.
    """

    names: tuple
    _pen: Pen = field(repr=False)

    def image(self, suffix: str = ".svg") -> bytes:
        """The picture as bytes; `suffix` is .svg or .png."""
        return self._pen.image(suffix)

    def _repr_svg_(self):
        return self.image().decode()

    def save(self, path: str | Path) -> None:
        """Write the picture; the suffix determines the format.

        Raises
        ------
        OutputError
            The suffix is not .svg or .png, or the path cannot be written.
        """
        suffix = Path(path).suffix.lower()
        if suffix not in FORMATS:
            raise OutputError(f"{path}: a schematic must be an .svg or .png file")
        image = self.image(suffix)
        with whole_file(path) as file:
            file.write(image)


def schematic(scene: SceneOrName) -> Schematic:
    """Draw the circuit of a scene: all of its netlist's elements, and no others.

    Parameters
    ----------
    scene : Scene, str or Path
        A scene, its file or the name of a built-in one.

    Returns
    -------
    Schematic
        Displayed in notebooks; `save(path)` writes SVG or PNG.

    Raises
    ------
    MissingLibrary
        schemdraw (extra `schematic`) is not installed.
    """
    schemdraw_library()
    scene = scene_of(scene)
    from circuits.equivalent.assembly import assemble

    prepared_scene = prepared(scene)
    circuit = read_topology(assemble(prepared_scene, named=True).text)
    pen = Pen()
    transducer = prepared_scene.network
    electrical = {*transducer.nodes, elements.behind_ammeter(transducer), *LOAD_SIDE}
    right, low = _mechanics(pen, circuit, scene.name, electrical)
    call, end, strays = _electronics(pen, circuit, right + GAP, transducer, electrical)
    inner = circuit.find(call.calls)
    # A load of one element is drawn next to the transducer, a larger one below.
    leave = (end, 0.0)
    turn = [(end + 0.4 * LEAD, 0.0)]
    corner = (end + 2.0 * LEAD, 0.0)
    if len(inner.parts) > 1:
        between = low - 0.5 * GAP
        turn = [(end, between), (0.4 * LEAD, between)]
        corner = (2.0 * LEAD, low - 2.0 * GAP)
    edge = _load(pen, circuit, call, [leave, *turn], corner, strays)
    # A load of several elements is drawn below; the definitions of its sub-circuits then go above
    # the load, to the right of the electrical side, otherwise to the right of the load.
    above = len(inner.parts) > 1
    _definitions(pen, inner, (end + 2.0 * GAP, -PADDING) if above else (edge + GAP, corner[1]))
    return Schematic(tuple(pen.names), pen)


def _mechanics(pen, circuit, name, electrical):
    """Draw the mechanical side; returns its right and lower edge."""
    pen.text((0.0, 1.3), f"{name}: mechanical side", TITLE_SIZE)
    x = top = edge = low = 0.0
    for group in _groups(circuit, electrical):
        ladder = lay_out(group, series=False)
        room = sum(_column_width(column) for column in ladder.columns) + COLUMN
        if x and x + room > WIDEST_ROW:
            x, top = 0.0, low - GAP
        right, bottom = _ladder(pen, circuit, ladder, x, top)
        edge, low = max(edge, right), min(low, bottom)
        x = right + GAP
    return edge, low


def _groups(circuit, electrical):
    """Groups of connected elements without an electrical node, in the netlist's order."""
    groups: list[tuple[set, list]] = []
    for part in circuit.parts:
        nodes = set(part.nodes) - {GROUND}
        if nodes & electrical:
            continue
        joined = [group for group in groups if group[0] & nodes]
        for group in joined:
            groups.remove(group)
            nodes |= group[0]
        groups.append((nodes, [*(p for group in joined for p in group[1]), part]))
    return [parts for _, parts in groups]


def _electronics(pen, circuit, left, transducer, electrical):
    """Draw transducer and ammeter; return the load's call, its position, and other parts."""
    pen.text((left, 1.3), "electrical side", TITLE_SIZE)
    parts = [part for part in circuit.parts if set(part.nodes) & electrical]
    call = next(part for part in parts if part.letter == "x")
    terminal, behind = transducer.terminal, elements.behind_ammeter(transducer)
    ammeter = [part for part in parts if set(part.nodes) == {terminal, behind}]
    inside = {*transducer.nodes, GROUND}
    transducer_parts = [part for part in parts if part != call and inside.issuperset(part.nodes)]
    strays = [part for part in parts if part not in [call, *ammeter, *transducer_parts]]
    ladder = lay_out(transducer_parts, right=(terminal,), series=len(transducer.nodes) > 1)
    x, _ = _ladder(pen, circuit, ladder, left, 0.0, far=(terminal,))
    for part in ammeter:
        pen.part(part, circuit, (x, 0.0), (x + ROW, 0.0), part.nodes[0] != terminal)
        x += ROW
        pen.text((x + 0.1, 0.25), behind, VALUE_SIZE, NODE_COLOUR)
        pen.wire((x, 0.0), (x + LETTER * len(behind), 0.0))
        x += LETTER * len(behind)
    return call, x, strays


def _load(pen, circuit, call, wire, corner, strays):
    """Draw the load in a box and the parts at its output; returns the right edge."""
    inner = circuit.find(call.calls)
    outer = dict(zip(inner.pins, call.nodes, strict=True))
    near = [pin for pin in inner.pins if outer[pin] not in LOAD_SIDE]
    far = [pin for pin in inner.pins if outer[pin] in LOAD_SIDE]
    values = ", ".join(" = ".join(map(plain, word.split("="))) for word in call.value.split())
    title = f"{call.name}: {call.calls}"
    right, height = _boxed(pen, inner, corner, title, values, near, far)
    pen.names.append(call.name)
    for pin in near:
        y, end = height[pin], (corner[0], height[pin])
        if outer[pin] == GROUND:
            pen.wire((corner[0] - 0.5 * LEAD, y), end)
            pen.ground((corner[0] - 0.5 * LEAD, y))
        else:
            pen.wire(*wire, (wire[-1][0], y), end)
    # Elements of the upper output are further out, to avoid the lower output's wire.
    x = right + LEAD
    for pin in sorted(far, key=height.get):
        hung = [part for part in strays if outer[pin] in part.nodes]
        pen.wire((right, height[pin]), (x, height[pin]))
        pen.text((right + 0.1, height[pin] + 0.25), outer[pin], VALUE_SIZE, NODE_COLOUR)
        if hung:
            x, _ = _ladder(pen, circuit, lay_out(hung), x, height[pin], named=False)
    return x


def _definitions(pen, inner, corner):
    """Draw each sub-circuit used by the load once, in a separate box."""
    x, y = corner
    for called in _called(inner):
        half = (len(called.pins) + 1) // 2
        users = f"each {called.name}"
        x, _ = _boxed(pen, called, (x, y), users, "", called.pins[:half], called.pins[half:])
        x += GAP


def _called(topology):
    """All sub-circuits used here, directly or indirectly, without duplicates."""
    subcircuits = {}
    for part in topology.parts:
        if part.letter == "x":
            inner = topology.find(part.calls)
            subcircuits[inner.name] = inner
            subcircuits |= {subcircuit.name: subcircuit for subcircuit in _called(inner)}
    return list(subcircuits.values())


def _boxed(pen, topology, corner, title, subtitle, near, far):
    """Draw a sub-circuit in a frame; returns the right edge and the height of every pin."""
    left, top = corner
    ladder = lay_out(topology.parts, near, far)
    right, low = _ladder(pen, topology, ladder, left, top, near, far)
    highest = max(ladder.rows.values())
    height = {pin: top - ROW * (highest - ladder.rows[pin]) for pin in (*near, *far)}
    for pin, y in height.items():
        pen.dot((left if pin in near else right, y), filled=False)
    for coupling in (part for part in topology.parts if part.letter == "k"):
        low -= 0.5
        words = f"{coupling.name}: {', '.join(coupling.control)}, {coupling.value}"
        pen.text((left + PADDING, low), words, VALUE_SIZE, INK)
        pen.names.append(coupling.name)
    pen.box((left, low - PADDING), (right, top + PADDING))
    pen.text((left, top + PADDING + (0.7 if subtitle else 0.3)), title, BOX_TITLE_SIZE)
    pen.text((left, top + PADDING + 0.3), subtitle, VALUE_SIZE, VALUE_COLOUR)
    return right, height


def _ladder(pen, topology, ladder, left, top, near=(), far=(), named=True):
    """Draw a layout, given its upper left corner; returns its right and lower edge.

    The rails of nodes in `near` are drawn from the left edge, those in `far` up to the right edge.
    """
    highest = max(ladder.rows.values())
    y = {node: top - ROW * (highest - row) for node, row in ladder.rows.items()}
    reach: dict[str, list[float]] = {node: [] for node in y}
    x = left + (PADDING if near else 0.0)
    for column in ladder.columns:
        for node in column.ends:
            reach[node].append(x)
        _column(pen, topology, column, x, y, ladder.rows)
        x += _column_width(column)
    for node, at in reach.items():
        begin = left if node in near else min(at)
        end = x if node in far else max(at)
        pen.wire((begin, y[node]), (end, y[node]))
        if node == GROUND:
            pen.ground((begin, y[node]))
        elif named:
            pen.text((begin + 0.15, y[node] + 0.25), node, VALUE_SIZE, NODE_COLOUR)
        for joint in set(at):
            if begin < joint < end or at.count(joint) > 1:
                pen.dot((joint, y[node]))
    return x, min(y.values()) - (0.6 if GROUND in y else 0.0)


def _column(pen, topology, column, x, y, rows):
    """Draw the elements of a column, centred between its rails, and the wires to both."""
    upper = rows[column.ends[0]] >= rows[column.ends[1]]
    start, end = (y[node] for node in column.ends)
    step = -ROW if upper else ROW
    spare = abs(rows[column.ends[0]] - rows[column.ends[1]]) - len(column.parts)
    at = start + step * (spare // 2)
    pen.wire((x, start), (x, at))
    for part, node, following in zip(column.parts, column.nodes, column.nodes[1:], strict=False):
        pen.part(part, topology, (x, at), (x, at + step), part.nodes[0] != node)
        at += step
        if following != column.nodes[-1]:
            pen.dot((x, at))
            pen.text((x + 0.3, at), following, VALUE_SIZE, NODE_COLOUR)
    pen.wire((x, at), (x, end))


def _column_width(column):
    return max(width(part) for part in column.parts)
