"""The unknowns of a load that limit the steps: controls of switches, capacitors and coils."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

from circuits.netlist.bounds import of_time_alone
from circuits.netlist.part_models import hysteresis
from circuits.netlist.potentials import Potentials, with_sources
from circuits.netlist.switching_events import passing, zero_crossings
from harvester.device.terminals import GROUND

if TYPE_CHECKING:
    from circuits.netlist.elements import Element
    from circuits.netlist.load_circuit import LoadCircuit

# The currents of transistors and behavioural sources may change at any time.
_JUMPING = frozenset("bqjm")


class Watch(NamedTuple):
    """Unknowns of a load that limit the step: controls of switches, capacitors, coils.

    Attributes
    ----------
    unknowns : tuple of str
        A node's full name, "i(name)" or ground: two for each switch, then two for each capacitor
        and coil. The level is their difference (V or A).
    switches : tuple of (float, float, bool)
        For each: the control above which it closes, the control below which it opens, whether it is
        initially closed.
    stores : tuple of (float, bool)
        Capacitance (F) or inductance (H), and whether it is a coil.
    pins : tuple of str
        Nodes at the load's pins.
    jumps : bool
        Whether a part's current may change suddenly, a source has a waveform, the load is
        self-oscillating, or a value is not a positive number: steps then follow the local error,
        and only the switches' unknowns are watched.
    turn : float
        Shortest time constant of the control of an endlessly toggling switch (s).
    """

    unknowns: tuple[str, ...] = ()
    switches: tuple[tuple[float, float, bool], ...] = ()
    stores: tuple[tuple[float, bool], ...] = ()
    pins: tuple[str, ...] = ()
    jumps: bool = False
    turn: float = math.inf


NOTHING = Watch()


def watch_of(load: LoadCircuit, pins: Mapping[str, str]) -> Watch:
    """The unknowns of a load whose changes limit the time step.

    Parameters
    ----------
    load : circuits.netlist.load_circuit.LoadCircuit
    pins : dict of str to str
        Full name of the node at each pin of the load.

    Returns
    -------
    Watch
        Empty for a load of resistors, capacitors and diodes alone, whose voltages change no faster
        than the motion.
    """
    parts = load.elements
    jumps = may_jump(load)
    if not load.switches:
        return Watch(jumps=jumps)
    switches = [_switch(part, pins) for part in parts if part.letter in "sw"]
    switches += _comparisons(parts, pins)
    stores = [] if jumps else [_store(part, pins) for part in parts if part.letter in "cl"]
    watched = [*switches, *stores]
    return Watch(
        tuple(name for ends, _ in watched for name in ends),
        tuple(values for _, values in switches),
        tuple(values for _, values in stores),
        tuple(pins.values()),
        jumps,
        load.self_oscillation.turn,
    )


def may_jump(load: LoadCircuit) -> bool:
    """Whether the current of a part of the load may change suddenly."""
    if any(part.wave is not None for part in load.elements):
        return True
    return load.switches and (load.self_oscillation.oscillates or any(map(_jumps, load.elements)))


def _jumps(element: Element) -> bool:
    if element.letter in _JUMPING or element.expression is not None:
        return True
    return element.letter in "cl" and not (element.size or 0.0) > 0.0


def _switch(switch, pins):
    """The control's ends, and (closes above, opens below, closed at first)."""
    ends = tuple(pins.get(node, node) for node in switch.nodes[2:4])
    if switch.letter == "w":
        ends = f"i({switch.controls[0]})", GROUND
    low, high = hysteresis(switch.letter, switch.model)
    return ends, (high, low, "on" in switch.flags)


def _comparisons(parts, pins):
    """Pins and thresholds, in the form of `_switch`, of each comparison that causes a jump."""
    potentials = Potentials(parts)
    crossings = [
        passing(passed)
        for part in parts
        if part.expression is not None
        for passed in zero_crossings(part.expression)
        if not of_time_alone(with_sources(passed, potentials))
    ]
    return [
        (tuple(pins.get(end, end) for end in ends), (level, level, False))
        for ends, level in filter(None, dict.fromkeys(crossings))
    ]


def _store(store, pins):
    """Unknowns of a store (two nodes, or a coil's current), and (size, whether it is a coil)."""
    if store.letter == "l":
        return (f"i({store.name})", GROUND), (store.size, True)
    return tuple(pins.get(node, node) for node in store.nodes), (store.size, False)
