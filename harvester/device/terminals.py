"""Interface of every transducer: its table in a scene, and its network in neutral terms.

A transducer acts on the mass with a force and delivers power to the load at its terminals. Its
internal loss (leak, winding) never counts as power. It is one module with two classes: the named
tuple of its scaled equations (see `harvester.device.linear_transducer`), and its table, derived
from `TransducerTable`. It joins the others by an entry in `harvester.scene.tables.TRANSDUCERS`.
"""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

from harvester.device.keys import Table

# The terminal's voltage is measured against this node.
GROUND = "0"
# Name of the ammeter (0 V) between terminal and load. Its current leaves the transducer.
LOAD_AMMETER = "load"


class Setting(NamedTuple):
    """Surroundings of a transducer (mass, length, load), in the scene's units.

    Attributes
    ----------
    units : "SI" or "scaled".
    mass, length
        kg and m per scaled length; 1 in scaled scenes.
    resistance
        Resistance (Ω) of a load that is a resistor; None for others, treated as an open circuit.
    decay_rate
        λ of a scaled scene's built-in resistor (1/s), else None.
    name
        Of the scene, for messages.
    excitation_unit
        The base's acceleration for one unit of η, in the scene's units; 0 where the
        displacement is prescribed and the base rests.
    """

    units: str
    mass: float
    length: float
    resistance: float | None
    decay_rate: float | None
    name: str
    excitation_unit: float = 1.0


class Component(NamedTuple):
    """A component of a network, between two nodes.

    Attributes
    ----------
    kind
        Kind of the element, and meaning of `value`:
        "resistor" (Ω), "capacitor" (F), "inductor" (H), "ammeter" (0 V);
        "moving voltage", "moving current": a source in proportion to X' (V or A for one scaled
        unit; the current flows from `minus` to `plus`, and out of it);
        "base voltage": a source in proportion to η (V for one scaled unit);
        "force of voltage", "force of current": force on the mass against X', by the voltage
        between the nodes (scaled acceleration per scaled volt) or by the current of the ammeter
        whose name is `plus` (scaled acceleration per ampere).
    name
        Its own, without blanks.
    plus, minus
        Nodes.
    value : float.
    holds_state
        Whether the voltage of this capacitor, or the current of this inductor, is the
        transducer's state, in which it begins.
    """

    kind: str
    name: str
    plus: str
    minus: str
    value: float = 0.0
    holds_state: bool = False


class Network(NamedTuple):
    """The electrical side of a transducer up to its terminal, as elements.

    Attributes
    ----------
    terminal
        Node on which the load hangs.
    elements : tuple of Component
    power_unit
        Scaled power per watt.
    reference_capacitance : F, of which stray capacitances of a load are a small share.
    state_voltage, state_current
        Node whose voltage, or name of the ammeter whose current, is the
        state; both empty where there is none.
    state_unit
        Volts or amperes of one scaled state.
    current_per_ampere
        Value of `current` in the equations at one ampere into the load; 0 if
        nothing asks for it, else the load's ammeter is there for every load.
    """

    terminal: str
    elements: tuple
    power_unit: float
    reference_capacitance: float
    state_voltage: str = ""
    state_current: str = ""
    state_unit: float = 1.0
    current_per_ampere: float = 0.0

    @property
    def nodes(self) -> set[str]:
        """Names of all nodes but the ground: set of str."""
        ends = {
            node
            for element in self.elements
            if element.kind != "force of current"
            for node in (element.plus, element.minus)
        }
        return (ends | {self.terminal}) - {GROUND}

    @property
    def drives_current(self) -> bool:
        """Whether the load's current is an inductance's, so that it cannot change at once."""
        return self.state_current == LOAD_AMMETER

    def value(self, name: str) -> float:
        """The value of the element with this name."""
        return next(element.value for element in self.elements if element.name == name)


class TransducerTable(Table):
    """Base of the tables: classes by `harvester.device.keys.table`, with a field for each key.

    Attributes
    ----------
    takes_voltage
        Whether a run can start with `start.voltage`, because the state is a voltage.
    """

    takes_voltage: ClassVar[bool] = False

    def voltage_unit(self, setting: Setting) -> float:
        """Volts of one scaled volt, in which `voltage` of the equations counts."""
        raise NotImplementedError

    def state_unit(self, setting: Setting) -> float:
        """Volts or amperes of one scaled state."""
        return self.voltage_unit(setting)

    def equations(self, setting: Setting) -> Any:
        """The transducer with its load, scaled; see `harvester.device.linear_transducer`.

        Raises LoadError if the load does not go with it.
        """
        raise NotImplementedError

    def network(self, setting: Setting, equations: Any, rate: float) -> Network:
        """The elements of the transducer up to its terminal.

        `equations`: returned by the method of this name; `rate` is in rad/s.
        """
        raise NotImplementedError

    def matched_resistance(self, rate: float) -> float:
        """A resistance that takes power well at an angular frequency (Ω), to compare loads with."""
        raise NotImplementedError
