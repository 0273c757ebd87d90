"""Interface of every transducer: its table in a scene, and its network in neutral terms.

A transducer acts on the mass with a force and delivers power to the load at its terminals. Its
internal loss (leak, winding) never counts as power. Each transducer is a module with two classes:
the named tuple of its scaled equations (see `harvester.device.linear_transducer`), and its table,
derived from `TransducerTable`. An entry in `harvester.scene.tables.TRANSDUCERS` registers it.
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
        Name of the scene, for messages.
    excitation_unit
        The base's acceleration per unit of η, in the scene's units; 0 if the displacement is
        prescribed and the base is at rest.
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
        Kind of the element, and meaning of `value`: "resistor" (Ω), "capacitor" (F), "inductor"
        (H), "ammeter" (0 V); "moving voltage", "moving current": source proportional to X' (V or
        A per scaled unit; the current flows from `minus` to `plus`, and out of it); "base voltage":
        a source proportional to η (V per scaled unit); "force of voltage", "force of current":
        force on the mass against X', by the voltage between the nodes (scaled acceleration per
        scaled volt) or by the current of the ammeter whose name is `plus` (scaled acceleration per
        ampere).
    name
        Unique name, without blanks.
    plus, minus
        Nodes.
    value : float.
    holds_state
        Whether this capacitor's voltage or this inductor's current is the transducer's state, and
        has its initial value.
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
        Node to which the load is connected.
    elements : tuple of Component
    power_unit
        Scaled power per watt.
    reference_capacitance : F, large compared with stray capacitances of a load.
    state_voltage, state_current
        Node whose voltage, or name of the ammeter whose current, is the state; both empty without a
        state.
    state_unit
        Volts or amperes of one scaled state.
    current_per_ampere
        Value of `current` in the equations at one ampere into the load; 0 if it is not used, else
        every load has the ammeter.
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
        """Whether an inductance carries the load's current, so that it cannot jump."""
        return self.state_current == LOAD_AMMETER

    def value(self, name: str) -> float:
        """The value of the element with this name."""
        return next(element.value for element in self.elements if element.name == name)


class TransducerTable(Table):
    """Base of the tables: classes decorated by `harvester.device.keys.table`, with a field per key.

    Attributes
    ----------
    takes_voltage
        Whether a run can start with `start.voltage`, because the state is a voltage.
    """

    takes_voltage: ClassVar[bool] = False

    def voltage_unit(self, setting: Setting) -> float:
        """Volts per scaled unit of `voltage` in the equations."""
        raise NotImplementedError

    def state_unit(self, setting: Setting) -> float:
        """Volts or amperes of one scaled state."""
        return self.voltage_unit(setting)

    def equations(self, setting: Setting) -> Any:
        """The transducer with its load, scaled; see `harvester.device.linear_transducer`.

        Raises LoadError if the load is incompatible.
        """
        raise NotImplementedError

    def network(self, setting: Setting, equations: Any, rate: float) -> Network:
        """The elements of the transducer up to its terminal.

        `equations`: the return value of the method `equations`; `rate` is in rad/s.
        """
        raise NotImplementedError

    def matched_resistance(self, rate: float) -> float:
        """A nearly optimal load resistance (Ω) at an angular frequency, to compare loads with."""
        raise NotImplementedError
