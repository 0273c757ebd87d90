"""A load: its elements and derived properties."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from circuits.netlist.elements import Element
from circuits.netlist.kinds import LEVEL
from circuits.netlist.load_checks import loose_nodes
from circuits.netlist.measures import Measure
from circuits.netlist.self_oscillation import SelfOscillation, cancelled, self_oscillation
from circuits.netlist.stores import Store, levels_of, stores_of
from circuits.netlist.supplies import coupled, joined, supplies_of
from circuits.netlist.writer import reads_alike, run_text
from harvester.device.terminals import GROUND

# Pins of a load's sub-circuit: the piezo's terminals, and the DC side if it has one.
PIEZO_PINS, OUTPUT_PINS = ("p", "n"), ("out", "ref")


@dataclass(frozen=True)
class LoadCircuit:
    """A checked load that can be connected to the transducer.

    Attributes
    ----------
    text : str
        Text of its file for exported decks: includes inserted, parameters by name; ends with a
        newline.
    elements : tuple of circuits.netlist.elements.Element
        All elements, as simulated by both engines.
    name : str
        Name of its sub-circuit.
    pins : tuple of str
        Pins as declared, from `PIEZO_PINS` and `OUTPUT_PINS`.
    parameters : tuple of (str, float)
        Parameter values given by the scene instead of the netlist's defaults.
    defaults : tuple of (str, float)
        Defaults of the sub-circuit's parameters that are plain numbers.
    across_output : tuple of circuits.netlist.elements.Element
        Resistors and capacitors across the output.
    linear, switches : bool
        Whether it consists of resistors and capacitors; whether it has elements other than these
        and diodes.
    resistance : float or None
        Resistance of a load that is one resistor between p and n, in Ω.
    measures : tuple of circuits.netlist.measures.Measure
        Measures defined in its file (`* measure:`).
    probes : tuple of str
        Nodes and currents "i(name)" to be recorded in a waveform.
    file : str
        Name of the file of its sub-circuit.
    ambiguity : str
        A note on expressions with another meaning in another SPICE; empty if there are none.
    source : (Path, tuple of circuits.netlist.reader.Card)
        The file, and its cards with all included files: an argument of `read_load`.
    """

    text: str
    name: str
    pins: tuple
    parameters: tuple
    defaults: tuple
    across_output: tuple[Element, ...]
    linear: bool
    switches: bool
    resistance: float | None
    measures: tuple = ()
    probes: tuple[str, ...] = ()
    file: str = field(default="", compare=False)
    elements: tuple[Element, ...] = field(default=(), compare=False, repr=False)
    ambiguity: str = field(default="", compare=False)
    source: Any = field(default=None, compare=False, repr=False)

    @cached_property
    def is_plain(self) -> bool:
        """Whether ngspice reads every name in the file's text as this program does."""
        return reads_alike(self.text, self.elements)

    @cached_property
    def run_text(self) -> str:
        """The sub-circuit for ngspice, with all values as numbers."""
        return run_text(self.name, self.pins, self.elements)

    @cached_property
    def self_oscillation(self) -> SelfOscillation:
        """Behaviour with the device at rest; see `circuits.netlist.self_oscillation`."""
        return self_oscillation(self.elements)

    @cached_property
    def cancelled(self) -> str:
        """The first source with a comparison that depends on rounding, or ""."""
        return cancelled(self.elements)

    @cached_property
    def sources(self) -> tuple[str, ...]:
        """Nonzero independent sources, which may deliver energy."""
        names = (element.name.rpartition(".")[2] for element in self.elements if element.delivers)
        return tuple(dict.fromkeys(names))

    @cached_property
    def periods(self) -> tuple[float, ...]:
        """The distinct periods (s) of its periodic sources."""
        periods = (element.wave.period for element in self.elements if element.wave)
        return tuple(dict.fromkeys(period for period in periods if period is not None))

    @cached_property
    def negative_parts(self) -> tuple[str, ...]:
        """Resistors, capacitors and coils with negative values."""
        return tuple(
            element.place
            for element in self.elements
            if element.letter in "rcl" and (element.size or 0.0) < 0.0
        )

    @cached_property
    def loose_nodes(self) -> tuple[str, ...]:
        """Nodes with a single connection, as "node of name (file:line)"."""
        return loose_nodes(self.elements, self.pins)

    @property
    def sha256(self) -> str:
        """Digest of the file's cards, with all included files, and of the given values."""
        identity = f"{self.text}{self.name}{self.parameters}"
        return hashlib.sha256(identity.encode()).hexdigest()

    @property
    def values(self) -> dict[str, float]:
        """Given and default parameters that are plain numbers (SI)."""
        return dict(self.defaults) | dict(self.parameters)

    @cached_property
    def stores(self) -> tuple[Store, ...]:
        """The capacitors and coils of the load."""
        return stores_of(self.elements)

    @cached_property
    def levels(self) -> tuple[str, ...]:
        """Nodes and currents that determine its stored energy; see `circuits.netlist.stores`."""
        return levels_of(self.elements, self.stores)

    @property
    def has_output(self) -> bool:
        """Whether it has a DC side."""
        return OUTPUT_PINS[0] in self.pins

    @cached_property
    def stray_pins(self) -> tuple[str, ...]:
        """Pins of its DC side that need a stray capacitance to ground while all diodes block.

        `out` gets none if only resistors, coils, switches and diodes are connected to it and a
        resistor or coil leads to another pin: it would be the only capacitance there, and with the
        trapezoidal rule the voltage would ring after a switch opens.
        """
        if not self.has_output:
            return ()
        output, reference = OUTPUT_PINS
        others = {reference, *PIEZO_PINS, GROUND}
        wires = [{*part.nodes} for part in self.elements if part.letter in "rl"]
        near = next(
            nodes for nodes in joined([{output}, *(wire - others for wire in wires)])
            if output in nodes
        )  # fmt: skip
        near_parts = [part for part in self.elements if near & {*part.nodes}]
        leads = any(near & wire and others & wire for wire in wires)
        rings = leads and all(part.letter in "rlswd" for part in near_parts)
        return (reference,) if rings else OUTPUT_PINS

    @cached_property
    def coupled(self) -> frozenset[str]:
        """Nodes of elements that exchange energy with its pins; see `circuits.netlist.supplies`."""
        return coupled(self.elements)

    @cached_property
    def supplies(self) -> tuple[Measure, ...]:
        """Power absorbed by its sources; see `circuits.netlist.supplies`."""
        if not self.has_output:
            return ()
        return supplies_of(self.elements, self.coupled, self.measures)

    @property
    def measured(self) -> tuple[tuple[str, str], ...]:
        """Kind and name of each value of its measures, and of its sources' powers."""
        return tuple(row for measure in (*self.measures, *self.supplies) for row in measure.rows)

    @property
    def recorded(self) -> tuple[tuple[str, str], ...]:
        """Kind and name of each recorded value: measures, levels, probes."""
        return self.measured + tuple((LEVEL, name) for name in (*self.levels, *self.probes))
