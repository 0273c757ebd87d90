"""The elements of a load, with numbers, full names and file lines."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

from circuits.netlist.expression import Tree, currents_in, nodes_in
from circuits.netlist.waveform import Waveform

# Advice in messages on unavailable currents.
AMMETER = (
    "SPICE computes currents of V, E, H, L and of B with v= alone; for another element, insert a "
    "source of 0 V in series (V1 a b 0) and use i(V1)"
)


class Model(NamedTuple):
    """A .model as used by one element: name, kind, parameters and flags."""

    name: str
    kind: str
    numbers: tuple[tuple[str, float], ...]
    flags: tuple[str, ...] = ()

    def get(self, name: str, otherwise: float = 0.0) -> float:
        """The value of a parameter."""
        return dict(self.numbers).get(name, otherwise)


class Element(NamedTuple):
    """One element of a load, with all calls of sub-circuits expanded.

    Attributes
    ----------
    letter : kind of the element.
    name : full name, after the calls that lead to it: "xbridge.dupper".
    nodes : names of nodes; a node at a pin of the load has the pin's name.
    where : "file:line".
    value : R (Ω), C (F), L (H) with temperature, scale and model applied; coupling of a K; gain of
        a controlled source; value of a constant source (V or A).
    numbers : other parameters of the element, such as "m" and "ic".
    model, wave, expression : if it has one; its expression is in volts, amperes or seconds.
    controls : full names of the sources or coils that control it.
    flags : "on" or "off".
    voltage : whether an expression or a gain sets a voltage, not a current.
    """

    letter: str
    name: str
    nodes: tuple[str, ...]
    where: str
    value: float | None = None
    numbers: tuple[tuple[str, float], ...] = ()
    model: Model | None = None
    wave: Waveform | None = None
    expression: Tree | None = None
    controls: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()
    voltage: bool = False

    def get(self, name: str, otherwise: float = 0.0) -> float:
        """The value of a name=value setting."""
        return dict(self.numbers).get(name, otherwise)

    @property
    def place(self) -> str:
        """Name and location for messages: "name (file:line)"."""
        return f"{self.name} ({self.where})"

    @property
    def written_letter(self) -> str:
        """The letter in the file, if the element is represented by another kind here."""
        return self.name.rpartition(".")[2][0]

    @property
    def is_smooth_switch(self) -> bool:
        """Whether it is a smooth switch of LTspice or PSpice, here a current expression."""
        return self.letter == "b" and self.written_letter in "sw"

    @property
    def delivers(self) -> bool:
        """Whether it is an independent source with a nonzero value."""
        return self.letter in "vi" and (self.wave is not None or self.value != 0.0)

    @property
    def first_value(self) -> Any:
        """The initial value of an independent source."""
        return self.wave.start if self.wave else self.value

    @property
    def has_current(self) -> bool:
        """Whether its current is an unknown of the circuit, so that i(name) exists."""
        return self.letter in "vehl" or (self.letter == "b" and self.voltage)

    @property
    def ends(self) -> tuple[str, ...]:
        """The nodes through which its current flows."""
        return self.nodes[:2] if self.letter in "egs" else self.nodes

    @property
    def controlling(self) -> list[str]:
        """Nodes whose voltages control it, possibly including ground."""
        return [*self.nodes[len(self.ends) :], *nodes_in(self.expression)]

    @property
    def currents(self) -> list[str]:
        """Full names of the sources and coils whose currents control it."""
        return [*self.controls, *currents_in(self.expression)]

    @property
    def many(self) -> float:
        """Number of identical elements in parallel (m)."""
        return self.get("m", 1.0)

    @property
    def size(self) -> float | None:
        """Total value of all parallel elements (Ω, F, H); None if it is an expression."""
        if self.value is None or not self.many:
            return None
        return self.value * self.many if self.letter == "c" else self.value / self.many


def ramped(elements: Iterable[Element], time: float) -> list[Element]:
    """Elements whose constant sources rise from 0 within this time (s)."""
    return [
        element._replace(wave=Waveform("pwl", (0.0, 0.0, time, element.value)))
        if element.letter in "vi" and element.value and element.wave is None
        else element
        for element in elements
    ]
