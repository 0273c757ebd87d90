"""Detects self-oscillating loads with the device at rest, and the speed of their switches.

Kirchhoff's laws of the load alone, C dy/dt + i(y) = s, are solved at rest and linearised. A growing
mode is an oscillator. Switches without a rest state toggle endlessly, at a rate set by the time
constants of their controls.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from circuits.netlist.elements import Element
from circuits.netlist.expression import ExpressionError, Tree, renamed
from circuits.netlist.numbers import THERMAL_VOLTAGE
from circuits.netlist.part_models import hysteresis
from circuits.netlist.switching_events import zero_crossings
from harvester.device.terminals import GROUND

# Conductance from every node to ground (S); largest number of Newton iterations; final residual,
# relative to the currents at a node or the voltages around a loop.
GMIN, MOST_ITERATIONS, SETTLED = 1e-12, 300, 1e-9
# If Newton's iterations fail, they are repeated with this conductance (S), multiplied by the second
# number after each iteration.
SLOWED, FADING = 1e-3, 0.9
# Above this exponent a diode's exponential continues as a straight line.
LARGEST_EXPONENT = 40.0
# A mode grows if its growth rate exceeds this share of the absolute rate. Rates above the second
# number (1/s) are rounding errors.
GROWING, FASTEST = 1e-6, 1e13
# Smallest share of a mode in a control's change for the mode to count.
TAKES_PART = 0.05
# Two values are equal by cancellation if they differ by less than this share of the largest unknown
# in all trials with exact parts, and by more if the parts have these relative errors.
CANCELLED, TRIALS = 1e-12, (0.0, 0.0, 0.0, 1e-3)
# Largest number of unknowns that is analysed, within half a second.
MOST_UNKNOWNS = 300


class SelfOscillation(NamedTuple):
    """Behaviour of a load with the device at rest.

    Attributes
    ----------
    oscillates : bool
    turn : float
        Shortest time constant of the control of an endlessly toggling switch (s); infinite if
        no switch does.
    switch : str
        Name of that switch, as "name (file:line)".
    unknown : str
        Reason why the result is unknown; empty if it is known.
    """

    oscillates: bool = False
    turn: float = math.inf
    switch: str = ""
    unknown: str = ""


AT_REST = SelfOscillation()


def self_oscillation(elements: tuple[Element, ...]) -> SelfOscillation:
    """Behaviour of a load with the device at rest."""
    # Only a source, a gain or a negative part can sustain an oscillation.
    driving = (
        element.delivers
        or element.letter in "begfh"
        or (element.letter in "rlc" and (element.size or 0.0) < 0.0)
        for element in elements
    )
    if not any(driving):
        return AT_REST
    try:
        circuit = _Circuit(elements)
    except ExpressionError as reason:
        return SelfOscillation(unknown=str(reason))
    if circuit.size > MOST_UNKNOWNS:
        return SelfOscillation(unknown=f"it has more than {MOST_UNKNOWNS} nodes and currents")
    motions = [_of_sources(circuit, source) for source in circuit.sources()]
    fastest = min(motions, key=lambda each: each.turn)
    oscillates = any(motion.oscillates for motion in motions)
    unknown = next((motion.unknown for motion in motions if motion.unknown), "")
    return SelfOscillation(oscillates, fastest.turn, fastest.switch, "" if oscillates else unknown)


def cancelled(elements: tuple[Element, ...]) -> str:
    """The first source that compares two values that differ only by rounding, or "".

    The load is solved with random voltages at its pins p and n, stores replaced by their impedances
    at a random rate, and waveforms by random values.
    """
    from circuits.netlist.expression_graph import Values

    compared = [
        (source, renamed(passed, {"n": GROUND}))
        for source in (elements if len(elements) <= MOST_UNKNOWNS else ())
        for passed in (zero_crossings(source.expression) if source.expression else ())
        if passed[0] not in ("sin", "cos")
    ]
    draw = np.random.default_rng(1)
    for error in TRIALS if compared else ():
        rate = 10.0 ** draw.uniform(1.0, 4.0)
        parts = [_static(part, rate, error, draw) for part in elements if part.letter != "k"]
        drive = Element("v", "", ("p", GROUND), "", value=draw.uniform(-20.0, 20.0))
        try:
            circuit = _Circuit((*parts, drive))
            closed = draw.random(circuit.closed.size) < 0.5
            y = circuit.rest(closed, next(circuit.sources()))
        except ExpressionError:
            y = None
        if y is None:
            return ""
        values = Values([passed for _, passed in compared], circuit.unknowns)
        equal = np.abs(values(np.zeros(1), y[:, None])[:, 0]) < CANCELLED * np.abs(y).max()
        compared = [
            pair for pair, same in zip(compared, equal, strict=True) if same == (error == 0.0)
        ]
    return compared[0][0].place if compared else ""


def _static(element, rate, error, draw):
    """A memoryless element: a store becomes a resistor, a waveform a constant.

    Every value changes by a random share of at most `error`.
    """
    if element.letter in "cl" and element.size:
        ohms = (rate * element.size) ** (-1.0 if element.letter == "c" else 1.0)
        element = Element("r", element.name, element.nodes, element.where, value=ohms)
    elif element.wave:
        element = element._replace(wave=None, value=draw.uniform(-10.0, 10.0))
    return element._replace(value=(element.value or 0.0) * (1.0 + error * draw.uniform(-1.0, 1.0)))


def _of_sources(circuit, source):
    closed = circuit.closed.copy()
    seen: list[tuple] = []
    turns: list[tuple[float, str]] = []
    steady_state = circuit.rest(closed, source)
    while steady_state is not None and tuple(closed) not in seen:
        seen.append(tuple(closed))
        wrong = circuit.wrong(closed, steady_state)
        if wrong < 0:
            return SelfOscillation(circuit.grows(steady_state, closed))
        closed[wrong] = ~closed[wrong]
        before, steady_state = steady_state, circuit.rest(closed, source)
        if steady_state is not None:
            constant = circuit.time_constant(wrong, before, steady_state, closed)
            turns.append((constant, circuit.switches[wrong][0].place))
    if steady_state is None:
        return SelfOscillation(unknown="no rest state was found")
    return SelfOscillation(True, *min(turns[seen.index(tuple(closed)) :]))


class _Circuit:
    """The equations of a load without the device; ground is its pin n."""

    def __init__(self, elements: tuple[Element, ...]) -> None:
        self._places: dict[str, int] = {GROUND: -1, "n": -1}
        self._stores: dict[str, tuple[int, int, float]] = {}
        self._mutual: list[tuple[str, str, float]] = []
        self._conductance: list[tuple[int, int, float]] = []
        self._steady: list[tuple[int, float, Element]] = []
        self._diodes: list[tuple] = []
        self.switches: list[tuple] = []
        self._behavioural: list[tuple] = []
        self._branches = {element.name: self._unknown(f"i({element.name})") for element in elements
                          if element.letter in "vl" or element.voltage}  # fmt: skip
        # Imported here, so that reading a load imports no compiler.
        from circuits.netlist import expression_graph

        self._compiled = expression_graph
        self._graph = expression_graph.ExpressionGraph()
        coils = {element.name: element.size for element in elements if element.letter == "l"}
        for element in elements:
            self._add(element, coils)
        self.unknowns = [*self._places][2:]
        self.size = len(self.unknowns)
        self.closed = np.array(["on" in switch.flags for switch, *_ in self.switches], dtype=bool)
        self._rows = np.array(self._graph.rows, dtype=np.int64).reshape(-1, 4)
        self._values = np.array(self._graph.values, dtype=float)
        self._ends, self._sizes = self._storage()
        self._g = self._matrix(self._conductance) + np.diag(
            [0.0 if name.startswith("i(") else GMIN for name in self.unknowns]
        )

    def _matrix(self, entries):
        matrix = np.zeros((self.size, self.size))
        for row, column, value in entries:
            if row >= 0 and column >= 0:
                matrix[row, column] += value
        return matrix

    def _storage(self):
        """Incidence of each capacitor and coil, one per column, and the matrix of their sizes.

        The number of modes then equals the number of stores; rounding adds none.
        """
        names = [*self._stores]
        ends, sizes = np.zeros((self.size + 1, len(names))), np.zeros((len(names),) * 2)
        for k, (a, z, size) in enumerate(self._stores.values()):
            ends[a, k] += 1.0
            ends[z, k] -= 1.0
            sizes[k, k] = size
        for one, other, size in self._mutual:
            sizes[names.index(one), names.index(other)] += size
        return ends[:-1], sizes

    def _unknown(self, name):
        return self._places.setdefault(name, len(self._places) - 2)

    def _add(self, element, coils):
        if element.letter == "k":
            one, other = element.controls
            mutual = element.value * math.sqrt(coils[one] * coils[other])
            self._mutual += [(one, other, -mutual), (other, one, -mutual)]
            return
        nodes = [self._unknown(node) for node in element.nodes]
        row = self._branches.get(element.name, -1)
        if row >= 0:
            for node, sign in zip(nodes[:2], (1.0, -1.0), strict=True):
                self._conductance += [(node, row, sign), (row, node, sign)]
        if element.letter in "cl" and element.size is None:
            raise ExpressionError(f"{element.name}: a value that changes")
        if element.letter == "r":
            self._between(
                self._conductance, nodes, nodes, 1.0 / element.size if element.size else 0.0
            )
        elif element.letter == "c":
            self._stores[element.name] = (*nodes, element.size)
        elif element.letter == "l":
            self._stores[element.name] = (row, -1, -element.size)
        elif element.letter in "vi":
            rows = [(row, 1.0)] if row >= 0 else [(nodes[0], -1.0), (nodes[1], 1.0)]
            self._steady += [(target, sign, element) for target, sign in rows]
        elif element.letter == "d":
            self._diodes.append((nodes, element))
        elif element.letter in "sw":
            control = (
                nodes[2:] if element.letter == "s" else [self._branches[element.controls[0]], -1]
            )
            self.switches.append((element, nodes, control))
        elif element.expression is not None:
            self._add_expression(element, nodes, row)
        elif element.letter in "egfh":
            control = (
                [self._branches[element.controls[0]], -1] if element.letter in "fh" else nodes[2:]
            )
            ends = [row, -1] if row >= 0 else nodes[:2]
            gain = element.value * element.many
            self._between(self._conductance, ends, control, -gain if row >= 0 else gain)
        else:
            raise ExpressionError(f"{element.name}: a transistor")

    @staticmethod
    def _between(entries, ends, controls, value):
        for row, sign in zip(ends, (1.0, -1.0), strict=False):
            for column, other in zip(controls, (1.0, -1.0), strict=False):
                entries.append((row, column, sign * other * value))

    def _add_expression(self, element, nodes, row):
        def unknown_of(tree: Tree) -> int:
            return self._unknown(tree[1]) if tree[0] == "v" else self._branches[tree[1]]

        first = len(self._graph.rows)
        last = self._graph.add(element.expression, unknown_of)
        ends = ((row, -1.0),) if row >= 0 else ((nodes[0], 1.0), (nodes[1], -1.0))
        many = element.many if row < 0 else 1.0
        self._behavioural.append(([(row, sign * many) for row, sign in ends], first, last))

    def sources(self) -> Iterator[np.ndarray]:
        """Right-hand sides for two values of every source: the initial one and the opposite
        extreme.
        """
        for variant in range(2):
            right = np.zeros(self.size)
            for row, sign, source in self._steady:
                if row >= 0:
                    right[row] += sign * _value(source, variant)
            yield right

    def _currents(self, y, closed, slopes_too):
        """Currents i(y) into the nodes, and their derivatives."""
        current, slope = self._g @ y, self._g.copy()
        potentials = np.append(y, 0.0)

        def conducts(nodes, amperes, siemens):
            for row, sign in zip(nodes, (1.0, -1.0), strict=True):
                if row >= 0:
                    current[row] += sign * amperes
                    for column, other in zip(nodes, (1.0, -1.0), strict=True):
                        if slopes_too and column >= 0:
                            slope[row, column] += sign * other * siemens

        for (switch, nodes, _), on in zip(self.switches, closed, strict=True):
            siemens = 1.0 / switch.model.get("ron" if on else "roff")
            conducts(nodes[:2], siemens * (potentials[nodes[0]] - potentials[nodes[1]]), siemens)
        for nodes, diode in self._diodes:
            conducts(nodes, *_diode(diode, potentials[nodes[0]] - potentials[nodes[1]]))
        self._compiled.evaluate(self._rows, self._values, potentials, 0.0)
        shares = np.zeros(self._values.size)
        for ends, first, last in self._behavioural:
            self._compiled.slopes(self._rows, self._values, shares, first, last)
            for row_index, sign in ends:
                if row_index >= 0:
                    current[row_index] += sign * self._values[last]
                    for k in range(first, last + 1):
                        if slopes_too and self._rows[k, 0] == 0:
                            slope[row_index, self._rows[k, 1]] += sign * shares[k]
        return current, slope if slopes_too else None

    def rest(self, closed: np.ndarray, source: np.ndarray) -> np.ndarray | None:
        """The rest state: voltages and currents with C dy/dt = 0, by Newton from 0; None if it
        fails.
        """
        solution = self._newton(closed, source, 0.0)
        return self._newton(closed, source, SLOWED) if solution is None else solution

    def _newton(self, closed, source, held):
        """Newton's iterations, damped by a decreasing conductance (S) at each node."""
        y = np.zeros(self.size)
        nodes = np.diag([0.0 if name.startswith("i(") else 1.0 for name in self.unknowns])
        for _ in range(MOST_ITERATIONS):
            current, slope = self._currents(y, closed, True)
            left, sizes = source - current, np.abs(slope) @ np.abs(y) + np.abs(source)
            if held < GMIN and np.all(np.abs(left) <= SETTLED * sizes):
                return y
            try:
                y = y + np.linalg.solve(slope + held * nodes, left)
            except np.linalg.LinAlgError:
                return None
            if not np.isfinite(y).all():
                return None
            held *= FADING
        return None

    def wrong(self, closed: np.ndarray, y: np.ndarray) -> int:
        """Index of the first switch that would toggle at these voltages, or −1."""
        potentials = np.append(y, 0.0)
        for k, (switch, _, control) in enumerate(self.switches):
            volts = potentials[control[0]] - potentials[control[1]]
            low, high = hysteresis(switch.letter, switch.model)
            if (closed[k] and volts < low) or (not closed[k] and volts > high):
                return k
        return -1

    def _modes(self, y, closed):
        """Modes of the circuit, linearized about a rest state.

        Returns their growth rates (1/s), and their shapes, one per column: in the unknowns, and in
        the charges of the capacitors and the currents of the coils.
        """
        _, slope = self._currents(y, closed, True)
        moved = np.linalg.solve(slope, self._ends @ self._sizes)
        times, shapes = np.linalg.eig(self._ends.T @ moved)
        finite = np.abs(times) > 1.0 / FASTEST
        held = shapes[:, finite]
        return -1.0 / times[finite], moved @ held / times[finite], held

    def grows(self, y: np.ndarray, closed: np.ndarray) -> bool:
        """Whether a mode grows about this rest state."""
        rates, *_ = self._modes(y, closed)
        return bool(np.any(rates.real > GROWING * np.abs(rates)))

    def time_constant(
        self, switch: int, before: np.ndarray, y: np.ndarray, closed: np.ndarray
    ) -> float:
        """Shortest time constant (s) of a switch's control between two rest states."""
        rates, shapes, held = self._modes(y, closed)
        # Switching leaves the energy in stores unchanged; voltages of nodes without a store jump.
        shares = np.linalg.pinv(held) @ (self._ends.T @ (before - y)) if rates.size else rates
        deflections = np.vstack([shapes * shares, np.zeros(rates.size)])
        one, other = self.switches[switch][2]
        parts = np.abs(deflections[one] - deflections[other])
        moved = np.append(before - y, 0.0)
        if abs((deflections[one] - deflections[other]).sum()) < 0.5 * abs(
            moved[one] - moved[other]
        ):
            # Rates of faster modes cannot be distinguished from rounding errors.
            return 0.0
        counts = parts > TAKES_PART * parts.sum()
        return float(1.0 / np.abs(rates[counts]).max(initial=0.0)) if counts.any() else math.inf


def _value(source, variant):
    """Initial value of a source (0), or its opposite extreme (1)."""
    if source.wave is None or variant == 0:
        return source.first_value
    numbers = source.wave.numbers
    if source.wave.kind == "pwl":
        return max(numbers[1::2], key=abs)
    return numbers[0] + numbers[1] if source.wave.kind in ("sin", "sffm") else numbers[1]


def _diode(diode, volts):
    """Current and conductance of a diode."""
    saturation = diode.model.get("is", 1e-14) * diode.get("area", 1.0) * diode.many
    swing = diode.model.get("n", 1.0) * THERMAL_VOLTAGE
    exponent = volts / swing
    if exponent < LARGEST_EXPONENT:
        power = math.exp(max(exponent, -LARGEST_EXPONENT))
        return saturation * (power - 1.0), saturation * power / swing
    power = math.exp(LARGEST_EXPONENT)
    beyond = exponent - LARGEST_EXPONENT
    return saturation * (power * (1.0 + beyond) - 1.0), saturation * power / swing
