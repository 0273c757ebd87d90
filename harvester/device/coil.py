"""The coil: a voltage induced by the velocity, in series with the winding's resistance and
inductance.

M x'' + … + Φ i = …, L i' = Φ x' − R_coil i − v: displacement x, current i, load voltage v, coupling
Φ. Scaled, with the state e = L i/(Φ l) and the rate λ: e' = X' − λ e. Without inductance the
current is proportional to the velocity, and there is no state to integrate.
"""

from __future__ import annotations

import math
from typing import ClassVar, NamedTuple

from harvester.device.dispatch import Values
from harvester.device.keys import SI, OneOf, not_negative, positive, table
from harvester.device.linear_transducer import LinearTransducer, NoBaseForce, TransducerRates
from harvester.device.terminals import (
    GROUND,
    LOAD_AMMETER,
    Component,
    Network,
    Setting,
    TransducerTable,
)

TERMINAL = "coil"


class Coil(LinearTransducer, TransducerRates):
    """A coil with inductance: coupling β = Φ²/(M L), decay rate of the current
    λ = (R_coil + R)/L. Unit of voltage: Φ l (1/s)."""

    __slots__ = ()

    def voltage(self, v: Values, state: Values) -> Values:
        """Terminal voltage of a resistor as load, R i."""
        return self.load_rate * state

    def current(self, v: Values, state: Values) -> Values:
        """The coil's current (the state, in its unit)."""
        return state

    def loss(self, v: Values, state: Values, current: Values) -> Values:
        """Power in the winding, R_coil i²."""
        return self.coupling * self.own_rate * current * current


class _Resistances(NamedTuple):
    winding_damping: float
    current_share: float


class ResistiveCoil(NoBaseForce, _Resistances):
    """A coil without inductance: R_coil i = Φ x' − v, so that i is proportional to X'.

    Currents are in units of Φ l/R_coil (1/s), voltages in Φ l (1/s).

    Attributes
    ----------
    winding_damping
        Φ²/(M R_coil), the damping of a shorted coil (1/s).
    current_share
        R_coil/(R_coil + R), the ratio of the current to the shorted coil's current.
    """

    __slots__ = ()

    @property
    def lossless(self) -> bool:
        """False: a winding always dissipates power."""
        return False

    def decay_rate(self) -> float:
        """Decay rate of the state: 0, since the state is always 0."""
        return 0.0

    def damping(self) -> float:
        """Damping proportional to the velocity, Φ²/(M (R_coil + R)) (1/s)."""
        return self.winding_damping * self.current_share

    def force(self, v: Values, state: Values) -> Values:
        """Force on the mass, Φ i."""
        return self.winding_damping * self.current_share * v

    def state_rate(self, v: Values, state: Values) -> Values:
        """Rate of the state: 0, since it is always 0."""
        return 0.0

    def voltage(self, v: Values, state: Values) -> Values:
        """Terminal voltage, Φ x' − R_coil i."""
        return (1.0 - self.current_share) * v

    def current(self, v: Values, state: Values) -> Values:
        """The coil's current."""
        return self.current_share * v

    def load_power(self, v: Values, state: Values) -> Values:
        """Power into a resistor, v i."""
        share = self.current_share * (1.0 - self.current_share)
        return self.winding_damping * share * v * v

    def loss(self, v: Values, state: Values, current: Values) -> Values:
        """Power in the winding, R_coil i²."""
        return self.winding_damping * current * current

    def stored_energy(self, state: Values) -> Values:
        """Stored energy: 0, without inductance."""
        return 0.0

    def stiffness(self, mechanical: float) -> float:
        """A coil without inductance adds no stiffness."""
        return 0.0

    def loss_rate(self, frequency: float) -> float:
        """Rate at which load and coil damp the motion, Φ²/(M (R_coil + R)) (1/s)."""
        return self.winding_damping * self.current_share


def coil(
    mass: float,
    constant: float,
    resistance: float,
    inductance: float,
    load_resistance: float | None,
) -> Coil | ResistiveCoil:
    """The coil with these SI values."""
    if inductance == 0.0:
        share = 0.0 if load_resistance is None else resistance / (resistance + load_resistance)
        return ResistiveCoil(constant**2 / (mass * resistance), share)
    load = 0.0 if load_resistance is None else load_resistance / inductance
    return Coil(constant**2 / (mass * inductance), load, resistance / inductance)


@table
class CoilTable(TransducerTable):
    """An electromagnetic transducer. If `k2` is given, `coupling` is computed from it."""

    coupling: float = positive("coupling of the coil: Φ", "V s/m", usual=(1e-4, 1e4))
    resistance: float = positive(
        "resistance of the coil: of its winding", "Ω", required=True, usual=(1e-2, 1e6)
    )
    inductance: float = not_negative("inductance of the coil", "H", default=0.0)
    k2: float | None = positive(
        "electromechanical coupling k²: Φ²/(K L), K at the stiffest rest position", "1"
    )

    UNITS: ClassVar = (SI,)
    ALTERNATIVES: ClassVar = (OneOf(("coupling", "k2"), {"k2": ("inductance",)}),)

    def coupling_at(self, stiffness: float) -> float:
        """The coupling (N/A) that follows from `k2` and the spring's stiffness at rest (N/m)."""
        return math.sqrt((self.k2 or 0.0) * stiffness * self.inductance)

    def voltage_unit(self, setting: Setting) -> float:
        """The scaled unit of voltage, Φ l."""
        return self.coupling * setting.length

    def state_unit(self, setting: Setting) -> float:
        """The scaled unit of current (A): Φ l/L, or without inductance Φ l/R_coil."""
        return self.coupling * setting.length / (self.inductance or self.resistance)

    def equations(self, setting: Setting) -> Coil | ResistiveCoil:
        """The coil; open-circuited unless the load is a resistor."""
        return coil(
            setting.mass, self.coupling, self.resistance, self.inductance, setting.resistance
        )

    def network(self, setting: Setting, equations: Coil | ResistiveCoil, rate: float) -> Network:
        """Induced voltage, winding, inductance; the load's ammeter measures the coil's current."""
        volts = self.voltage_unit(setting)
        inside = "winding" if self.inductance > 0.0 else TERMINAL
        elements = [
            Component("moving voltage", "induced", "induced", GROUND, volts),
            Component("resistor", "winding", "induced", inside, self.resistance),
        ]
        if self.inductance > 0.0:
            inductance = self.inductance
            elements.append(
                Component("inductor", "coil", inside, TERMINAL, inductance, holds_state=True)
            )
        force = self.coupling / (setting.mass * setting.length)
        elements.append(Component("force of current", "back_action", LOAD_AMMETER, GROUND, force))
        return Network(
            terminal=TERMINAL,
            elements=tuple(elements),
            power_unit=1.0 / (setting.mass * setting.length**2),
            # Capacitance whose impedance at the motion's frequency equals the winding's.
            reference_capacitance=1.0 / (rate * self.resistance),
            state_current=LOAD_AMMETER if self.inductance > 0.0 else "",
            state_unit=self.state_unit(setting),
            current_per_ampere=(self.inductance or self.resistance) / volts,
        )

    def matched_resistance(self, rate: float) -> float:
        """The matched load resistance (Ω): the winding's resistance."""
        return self.resistance
