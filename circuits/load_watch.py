"""What of a load decides the steps: its switches' controls, its capacitors and its coils."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

from circuits.kernel.flattening import Place, elements
from circuits.kernel.parts import hysteresis, stored
from circuits.loads.vetting import WAVEFORMS
from harvester.device.terminals import GROUND
from harvester.errors import LoadError

if TYPE_CHECKING:
    from circuits.loads.subcircuits import LoadCircuit

# Transistors and behavioural sources change their currents by a law of their own, at any time.
_JUMPING = frozenset("bqjm")
_CHANGING = WAVEFORMS - {"dc", "ac"}
_EXPRESSIONS = ("value=", "vol=", "cur=")


class Watch(NamedTuple):
    """Unknowns of a load that tell how long a step may be.

    Attributes
    ----------
    unknowns : tuple of str
        A node's full name, "i(name)" or ground, two for each switch and then two for each
        capacitor and coil: what counts is the first less the second (V or A).
    switches : tuple of (float, float, bool)
        Control above which each closes, that below which it opens, whether it is closed at first.
    stores : tuple of (float, bool)
        Capacitance (F) or inductance (H), and whether it is a coil's.
    pins : tuple of str
        Nodes at the load's pins.
    jumps : bool
        Whether a part may change its current without notice, a source has a waveform of its own, or
        a value is no number or not positive: steps then follow the local error, and of the unknowns
        only the switches' are watched.
    """

    unknowns: tuple[str, ...] = ()
    switches: tuple[tuple[float, float, bool], ...] = ()
    stores: tuple[tuple[float, bool], ...] = ()
    pins: tuple[str, ...] = ()
    jumps: bool = False


NOTHING = Watch()


def watch_of(load: LoadCircuit, pins: Mapping[str, str]) -> Watch:
    """What to watch of a load with its pins at these nodes.

    Parameters
    ----------
    load : circuits.loads.subcircuits.LoadCircuit
    pins : dict of str to str
        Full names of the nodes at its pins.

    Returns
    -------
    Watch
        Empty for resistors, capacitors and diodes, which follow the motion.
    """
    try:
        places = list(elements(load, pins))
    except LoadError:
        return Watch(jumps=True) if load.switches else NOTHING
    jumps = any(map(_has_waveform, places))
    if not load.switches:
        return Watch(jumps=jumps)
    try:
        switches = [_switch(place) for place in places if place.letter in "sw"]
        stores = [_store(place) for place in places if place.letter in "cl"]
    except LoadError:
        return Watch(jumps=True)
    jumps = jumps or any(map(_may_jump, places)) or any(size <= 0.0 for _, (size, _) in stores)
    if any(low > high for _, (high, low, _) in switches):
        return Watch(jumps=True)
    watched = switches if jumps else [*switches, *stores]
    return Watch(
        tuple(name for ends, _ in watched for name in ends),
        tuple(values for _, values in switches),
        () if jumps else tuple(values for _, values in stores),
        tuple(pins.values()),
        jumps,
    )


def _has_waveform(place: Place) -> bool:
    return place.letter in "vi" and not _CHANGING.isdisjoint(place.words)


def _may_jump(place: Place) -> bool:
    return place.letter in _JUMPING or any(word.startswith(_EXPRESSIONS) for word in place.words)


def _switch(place):
    """The control's ends, and (closes above, opens below, closed at first)."""
    plain = place.plain()
    ends = place.nodes[2:4]
    if place.letter == "w":
        ends = f"i({place.scope.path}{plain.pop(0)})", GROUND
    _, model, _ = place.model(plain[0])
    low, high = hysteresis(place, model)
    return ends, (high, low, "on" in plain[1:])


def _store(place):
    """The ends of what is kept, and (size, whether it is a coil's current)."""
    coil = place.letter == "l"
    ends = (f"i({place.name})", GROUND) if coil else place.nodes[:2]
    return ends, (stored(place)[0], coil)
