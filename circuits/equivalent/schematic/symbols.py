"""Draws symbols, wires and text of a schematic with schemdraw, as SVG or PNG."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from circuits.netlist.topology import GROUND
from harvester.base.figure_settings import figure_settings, load_matplotlib
from harvester.base.libraries import optional_library

if TYPE_CHECKING:
    from circuits.netlist.topology import Part, Topology

# Lengths in schemdraw's units: of an element along its column, of a column without text, and of one
# character.
ROW, COLUMN, LETTER = 2.0, 1.25, 0.185
NAME_SIZE, VALUE_SIZE, LINE_HEIGHT = 12, 10, 0.44
LONGEST_VALUE = 18
LINE, THIN = 1.4, 0.9
INK, NODE_COLOUR, VALUE_COLOUR, BOX_COLOUR = "black", "#0072B2", "#595959", "#808080"
PIXELS_PER_INCH, INCHES_PER_UNIT, MARGIN = 150, 0.5, 0.3
SYMBOLS = {
    "r": "Resistor", "c": "Capacitor", "l": "Inductor2", "d": "Diode", "v": "SourceV",
    "i": "SourceI", "e": "SourceControlledV", "h": "SourceControlledV", "s": "Switch",
    "f": "SourceControlledI", "g": "SourceControlledI", "w": "Switch",
}  # fmt: skip
# For each kind of transistor: the names of its control and of its fourth node, its kinds of channel
# or doping (the second is drawn if the model names it), and their symbols. Arrows point away from
# an npn's base and into an n channel; schemdraw's two-terminal shapes have the opposite direction.
TRANSISTORS = {
    "q": (("base", "substrate"), "pnp", ("BjtPnp2", "BjtNpn2")),
    "j": (("gate",), "pjf", ("JFetP2", "JFetN2")),
    "m": (("gate", "bulk"), "pmos|pchan", ("NFet2", "PFet2")),
}
# Length of a transistor's control lead; the text is beyond it.
CONTROL_LEAD = 1.4


class Pen:
    """A drawing in progress: its methods record elements, and `image` draws all of them.

    Positions are (x, y) in schemdraw's units, y upwards.

    Attributes
    ----------
    names : list of str
        Names of the elements that were drawn.
    """

    def __init__(self) -> None:
        self.names: list[str] = []
        self._steps: list[Callable] = []

    def text(
        self,
        at: tuple[float, float],
        words: str,
        size: int = VALUE_SIZE,
        colour: str = INK,
        align: str = "left",
    ) -> None:
        """Write a line of text at a position."""

        def draw(library):
            label = library.Label().at(at).theta(0)
            return label.label(
                words, "center", fontsize=size, color=colour, halign=align, valign="center"
            )

        self._steps.append(draw)

    def wire(self, *points: Any, colour: str = INK) -> None:
        """Draw a line from point to point."""
        for start, end in pairwise(points):
            if start != end:
                self._add("Line", start, end, colour)

    def dot(self, at: tuple[float, float], filled: bool = True) -> None:
        """Mark a connection of wires or, with `filled` false, a terminal."""
        shape = {"open": not filled, "radius": 0.07}
        self._steps.append(lambda library: library.Dot(**shape).at(at).theta(0).linewidth(LINE))

    def ground(self, at: tuple[float, float]) -> None:
        """Draw the symbol of ground, node 0."""
        self._steps.append(lambda library: library.Ground().at(at).theta(0).linewidth(LINE))

    def box(self, corner: tuple[float, float], other: tuple[float, float]) -> None:
        """Draw a dashed frame between two opposite corners."""
        (left, low), (right, high) = corner, other
        corners = [(left, low), (right, low), (right, high), (left, high), (left, low)]
        for start, end in pairwise(corners):
            self._add("Line", start, end, BOX_COLOUR, dashed=True)

    def part(
        self,
        part: Part,
        topology: Topology,
        start: tuple[float, float],
        end: tuple[float, float],
        reverse: bool = False,
    ) -> None:
        """Draw an element between two points, with its name and value next to it.

        `topology` is the circuit or sub-circuit of the element. Its first node is at `start`, or
        with `reverse` at `end`.
        """
        self.names.append(part.name)
        symbol = _symbol(part, topology)
        # The plus sign of schemdraw's voltage sources is at the end, in SPICE at the start,
        # and its shape of a pnp transistor begins with the emitter.
        turned = reverse != (symbol.endswith("V") or symbol == "BjtNpn2")
        first, last = (end, start) if turned else (start, end)
        # The control lead points to the right, towards the text.
        self._add(symbol, first, last, flip=part.letter in TRANSISTORS and first[1] < last[1])
        x, y = 0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1])
        upright, lines = start[0] == end[0], words(part)
        beside = CONTROL_LEAD + 0.1 if part.letter in TRANSISTORS else 0.55
        x, y = (x + beside, y + 0.5 * LINE_HEIGHT * (len(lines) - 1)) if upright else (x, y + 1.1)
        for row, line in enumerate(lines):
            size, colour = (VALUE_SIZE, VALUE_COLOUR) if row else (NAME_SIZE, INK)
            align = "left" if upright else "center"
            self.text((x, y - LINE_HEIGHT * row), line, size, colour, align)

    def _add(self, symbol, start, end, colour=INK, dashed=False, flip=False):
        def draw(library):
            across, up = end[0] - start[0], end[1] - start[1]
            # Sources have a direction, which `to` would not rotate.
            angle, length = math.degrees(math.atan2(up, across)), math.hypot(across, up)
            element = getattr(library, symbol)().at(start).theta(angle).length(length)
            element = element.color(colour).linewidth(THIN if dashed else LINE)
            element = element.flip() if flip else element
            return element.linestyle("--") if dashed else element

        self._steps.append(draw)

    def image(self, suffix: str) -> bytes:
        """The drawing as bytes of a file with this suffix, .svg or .png."""
        schemdraw = schemdraw_library()
        from schemdraw import elements

        if suffix == ".svg":
            drawing = schemdraw.Drawing(canvas="svg", show=False, margin=MARGIN)
            # A white background, since the lines are black even on a dark page.
            drawing.config(bgcolor="white")
            self._draw(drawing, elements)
            return drawing.get_imagedata("svg")
        with figure_settings():
            return self._png(schemdraw, elements)

    def _png(self, schemdraw, elements):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure()
        FigureCanvasAgg(figure)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set_aspect("equal")
        drawing = schemdraw.Drawing(canvas=axes, show=False)
        self._draw(drawing, elements)
        drawing.draw(show=False)
        edges = drawing.get_bbox()
        axes.set_xlim(edges.xmin - MARGIN, edges.xmax + MARGIN)
        axes.set_ylim(edges.ymin - MARGIN, edges.ymax + MARGIN)
        size = (edges.xmax - edges.xmin, edges.ymax - edges.ymin)
        figure.set_size_inches(*(INCHES_PER_UNIT * (side + 2.0 * MARGIN) for side in size))
        file = io.BytesIO()
        figure.savefig(file, format="png", dpi=PIXELS_PER_INCH, facecolor="white")
        return file.getvalue()

    def _draw(self, drawing, elements):
        for step in self._steps:
            drawing.add(step(elements))


def schemdraw_library() -> Any:
    """The imported module schemdraw.

    Raises
    ------
    MissingLibrary
    """
    # schemdraw imports matplotlib.
    load_matplotlib()
    return optional_library("schemdraw", "a schematic", "schematic")


def width(part: Part) -> float:
    """Width of a column for the element and its text."""
    lines = words(part)
    letters = max([len(lines[0]), *(0.8 * len(line) for line in lines[1:])])
    lead = CONTROL_LEAD if part.letter in TRANSISTORS else 0.0
    return COLUMN + 0.2 + lead + LETTER * letters


def words(part: Part) -> list[str]:
    """The element's name, its value, and its control."""
    value, control = _value(part), [node for node in part.control if node != GROUND]
    if part.letter in TRANSISTORS:
        names = TRANSISTORS[part.letter][0]
        # The symbol itself shows a bulk that is connected to the source.
        beside = [pair for pair in zip(names, part.beside, strict=False) if pair[1] != part.ends[1]]
        lines = [*(f"{name}: {node}" for name, node in beside), value.split()[0]]
    elif part.letter == "b" or (part.letter in "eg" and re.search(r"=|\bv\(", part.value)):
        # The nodes on which a behavioural source depends, in two lines: a third would reach the
        # name of the rail below.
        half = (len(control) + 1) // 2
        pairs = zip(("of", "and"), (control[:half], control[half:]), strict=True)
        lines = [f"{word} {', '.join(nodes)}" for word, nodes in pairs if nodes]
    elif part.letter in "egs":
        voltage = f"v({', '.join(control)})"
        lines = [f"{value} · {voltage}" if value and part.letter in "eg" else voltage]
    elif control:
        lines = [value, f"i({control[0]})"]
    else:
        lines = [value]
    return [part.name, *filter(None, lines)]


def plain(value: str) -> str:
    """A number with three digits; other text unchanged."""
    return f"{float(value):.3g}" if re.fullmatch(r"[-+.\de]+", value) else value


def _value(part):
    if part.letter == "x":
        return part.calls
    value = plain(re.sub(r"\s*\bic=\S+", "", part.value))
    if part.letter in TRANSISTORS:
        return value
    return "" if part.letter == "b" or len(value) > LONGEST_VALUE else value


def _symbol(part, topology):
    """Name of the element in schemdraw."""
    if part.letter == "b":
        return "SourceControlledV" if re.match(r"(?i)v\s*=", part.value) else "SourceControlledI"
    if part.letter == "x" and is_diode(topology.find(part.calls)):
        return "Diode"
    if part.letter in TRANSISTORS:
        _, second, symbols = TRANSISTORS[part.letter]
        model = topology.model(part.value.split()[0].lower())
        return symbols[bool(re.search(rf"\b({second})\b", model))]
    return SYMBOLS.get(part.letter, "RBox")


def is_diode(inner: Topology) -> bool:
    """Whether a sub-circuit is a diode from its first to its second pin, possibly with leakage."""
    diodes = [part.nodes for part in inner.parts if part.letter == "d"]
    return diodes == [inner.pins] and all(part.letter in "drc" for part in inner.parts)
