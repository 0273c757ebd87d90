"""Voltages that the load's sources alone determine, as functions of time and at the start."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise

from circuits.netlist.elements import Element
from circuits.netlist.expression import ONE, ZERO, Tree, leaves, replaced
from circuits.netlist.part_models import hysteresis
from circuits.netlist.waveform import FOREVER, Waveform
from harvester.device.terminals import GROUND

# Most points of a pwl that is replaced by an expression.
MOST_POINTS = 24
# Rounding of a switch's control (V or A), relative to the larger of 1 and its thresholds.
CONTROL_ROUNDING = 1e-12
# Functions whose value or slope is undefined at 0 V.
_UNDEFINED_AT_0 = {"ln", "^", "pwr", "acosh"}


class Potentials:
    """Voltages between nodes that are connected by voltage sources.

    Parameters
    ----------
    elements : iterable of Element
        Voltage sources among them are used, and with `charged` also charged capacitors.
    """

    def __init__(self, elements: Iterable[Element], charged: bool = False) -> None:
        self._ways: dict[str, dict[Element, int]] = {}
        self._roots: dict[str, str] = {}
        neighbours: dict[str, list[tuple[str, Element, int]]] = {}
        for element in elements:
            if element.letter == "v" or (
                charged and element.letter == "c" and "ic" in dict(element.numbers)
            ):
                a, z = element.nodes
                neighbours.setdefault(a, []).append((z, element, -1))
                neighbours.setdefault(z, []).append((a, element, 1))
        for root in [GROUND, "n", *neighbours]:
            if root not in self._roots:
                self._spread(root, neighbours)

    def _spread(self, root, neighbours):
        self._roots[root], self._ways[root] = root, {}
        waiting = [root]
        while waiting:
            reached = waiting.pop()
            for node, source, sign in neighbours.get(reached, ()):
                if node not in self._roots:
                    self._roots[node] = root
                    self._ways[node] = {**self._ways[reached], source: sign}
                    waiting.append(node)

    def between(self, a: str, z: str) -> list[tuple[int, Element]] | None:
        """Signs and sources whose sum is the voltage from a to z, or None."""
        if self._roots.get(a, a) != self._roots.get(z, z):
            return None
        one, other = self._ways.get(a, {}), self._ways.get(z, {})
        signs = {source: one.get(source, 0) - other.get(source, 0) for source in {**one, **other}}
        return [(sign, source) for source, sign in signs.items() if sign]

    def start(self, a: str, z: str) -> float | None:
        """The initial voltage from a to z, or None."""
        sources = self.between(a, z)
        if sources is None:
            return None
        return sum(
            sign * (source.get("ic") if source.letter == "c" else source.first_value)
            for sign, source in sources
        )


def with_sources(tree: Tree, potentials: Potentials) -> Tree:
    """Replace each voltage that only sources determine by the values of these sources."""
    return replaced(tree, lambda leaf: _from_sources(leaf, potentials) if leaf[0] == "v" else leaf)


def _from_sources(voltage, potentials):
    sources = potentials.between(*voltage[1:])
    if sources is None or any(source.wave and not has_tree(source.wave) for _, source in sources):
        return voltage
    tree = None
    for sign, source in sources:
        one = wave_tree(source.wave) if source.wave else ("number", source.value)
        one = one if sign > 0 else ("negative", one)
        tree = one if tree is None else ("+", tree, one)
    return tree or ZERO


def has_tree(wave: Waveform) -> bool:
    """Whether `wave_tree` gives its expression."""
    return wave.kind != "sffm" and len(wave.numbers) <= 2 * MOST_POINTS


def wave_tree(wave: Waveform) -> Tree:
    """A waveform as an expression of the time; exact between its corners."""
    n = [("number", value) for value in wave.numbers]
    time: Tree = ("time",)
    if wave.kind == "pwl":
        return _lines(wave.numbers, time)
    if wave.kind == "sin":
        late = ("max", ("-", time, n[3]), ZERO)
        turned = ("number", math.radians(wave.numbers[5]))
        angle = ("+", ("*", ("number", 2.0 * math.pi * wave.numbers[2]), late), turned)
        swing: Tree = ("*", n[1], ("sin", angle))
        if wave.numbers[4]:
            swing = ("*", swing, ("exp", ("negative", ("*", n[4], late))))
        return ("+", n[0], swing)
    height: Tree = ("number", wave.numbers[1] - wave.numbers[0])
    if wave.kind == "exp":
        share = ("-", _settled(time, n[2], n[3]), _settled(time, n[4], n[5]))
        return ("+", n[0], ("*", height, share))
    since: Tree = ("-", time, n[2])
    if wave.numbers[6] < FOREVER:
        periods = ("max", ("floor", ("/", since, n[6])), ZERO)
        since = ("-", since, ("*", n[6], periods))
    up = _ramp(since, n[3])
    down = _ramp(("-", since, ("number", wave.numbers[3] + wave.numbers[5])), n[4])
    return ("+", n[0], ("*", height, ("-", up, down)))


def _ramp(late, length):
    return ("min", ("max", ("/", late, length), ZERO), ONE)


def _settled(time, delay, constant):
    late = ("max", ("-", time, delay), ZERO)
    return ("-", ONE, ("exp", ("negative", ("/", late, constant))))


def _lines(numbers, time):
    points = list(zip(numbers[::2], numbers[1::2], strict=True))
    tree: Tree = ("number", points[-1][1])
    for (t0, v0), (t1, v1) in reversed(list(pairwise(points))):
        if t1 > t0:
            slope = ("*", ("number", (v1 - v0) / (t1 - t0)), ("-", time, ("number", t0)))
            tree = ("if", ("<", time, ("number", t1)), ("+", ("number", v0), slope), tree)
    return ("if", ("<", time, ("number", points[0][0])), ("number", points[0][1]), tree)


def levels(switch: Element, potentials: Potentials) -> tuple[float, float]:
    """Controls below which a switch opens and above which it closes, with a margin for rounding.

    With hysteresis, a control exactly at a threshold changes nothing. Without, ngspice toggles the
    switch when its control reaches the threshold from either side.
    """
    low, high = hysteresis(switch.letter, switch.model)
    rounding = CONTROL_ROUNDING * max(abs(low), abs(high), 1.0)
    if high > low:
        return low - rounding, high + rounding
    sources = potentials.between(*switch.nodes[2:4]) if switch.letter == "s" else None
    sides = [_sides(sign, source) for sign, source in sources or ()]
    least, most = (sum(side[k] for side in sides) for k in range(2))
    # If the control is constant at the threshold, ngspice starts with the switch closed.
    if sides and abs(most - low) <= rounding:
        return low - rounding, high - rounding
    if sides and abs(least - low) <= rounding:
        return low + rounding, high + rounding
    return low, high


def _sides(sign, source):
    """Smallest and largest value of a source, times its sign."""
    if source.wave is None:
        ends = [source.value]
    elif source.wave.kind == "pwl":
        ends = list(source.wave.numbers[1::2])
    elif source.wave.kind in ("pulse", "exp"):
        ends = list(source.wave.numbers[:2])
    else:
        offset, swing = source.wave.numbers[:2]
        ends = [offset - abs(swing), offset + abs(swing)]
    return sorted((sign * min(ends), sign * max(ends)))


def starts(elements: tuple[Element, ...]) -> dict[str, float]:
    """Initial node voltages, from sources and charged capacitors, that ngspice must be given.

    Otherwise ngspice starts at 0 V: it loses the state of a switch within its hysteresis, and
    evaluates ln(0).
    """
    potentials = Potentials(elements, charged=True)
    node_voltages: dict[str, float] = {}
    for element in elements:
        for a, z in _decisive(element, potentials):
            volts = potentials.start(a, z)
            if volts is not None and z not in node_voltages and a not in node_voltages:
                node_voltages[a], node_voltages[z] = volts, 0.0
    return {node: volts for node, volts in node_voltages.items() if node not in (GROUND, "n")}


def _decisive(element, potentials):
    """Pairs of nodes whose initial voltage determines an element's initial state."""
    if element.letter == "s":
        a, z = element.nodes[2:4]
        low, high = hysteresis(element.letter, element.model)
        volts = potentials.start(a, z)
        if volts is not None and (element.flags or volts) and low <= volts <= high > low:
            yield a, z
    elif element.expression is not None:
        parts = list(leaves(element.expression))
        if any(part[0] in _UNDEFINED_AT_0 for part in parts):
            yield from (part[1:] for part in parts if part[0] == "v")
