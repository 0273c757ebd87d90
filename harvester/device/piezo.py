"""The piezo: a clamped capacitance that the velocity charges, perhaps leaky (Eq. 4).

M x'' + … + θ V = …, Cp V' = θ x' − V/R_leak − i, with i into the load. Scaled: V' = X' − λ V.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from harvester.device.keys import SCALED, SI, not_negative, positive
from harvester.device.linear_transducer import LinearTransducer, Rates
from harvester.device.terminals import GROUND, Element, Network, Setting, TransducerTable
from harvester.device.values import Values
from harvester.errors import LoadError

# The square of a larger λ (1/s) would overflow.
FASTEST_DECAY = 1e150
TERMINAL = "piezo"


class Piezo(LinearTransducer, Rates):
    """The state is V; β = θ²/(M Cp), λ = 1/(R Cp) + 1/(R_leak Cp)."""

    __slots__ = ()

    def voltage(self, v: Values, state: Values) -> Values:
        """Terminal voltage."""
        return state

    def loss(self, v: Values, state: Values, current: Values) -> Values:
        """Power in the leak, β V²/(R_leak Cp)."""
        return self.coupling * self.own_rate * state * state

    def stiffness(self, mechanical: float) -> float:
        """What the open piezo adds to a stiffness per mass, β (1/s²)."""
        return self.coupling


def piezo(coupling: float, load_rate: float, leakage_rate: float = 0.0) -> Piezo:
    """The piezo with these scaled values (1/s for the rates)."""
    return Piezo(float(coupling), float(load_rate), float(leakage_rate))


@dataclass(frozen=True)
class PiezoTable(TransducerTable):
    """A piezoelectric transducer.

    SI: θ in N/V, the clamped capacitance in F, the resistance of its dielectric loss in Ω.
    Scaled: β, and 1/(R_leak Cp) as `leakage_rate`.
    """

    coupling: float
    capacitance: Any = None
    leakage_resistance: float | None = None
    leakage_rate: float | None = None

    KEYS: ClassVar[dict] = {
        "coupling": not_negative(required=True),
        "capacitance": positive(units=(SI,), required=True),
        "leakage_resistance": positive(units=(SI,)),
        "leakage_rate": not_negative(units=(SCALED,)),
    }
    takes_voltage: ClassVar[bool] = True

    def voltage_unit(self, setting: Setting) -> float:
        """The scaled unit of voltage, θ l/Cp."""
        if setting.units != SI:
            return 1.0
        return self.coupling * setting.length / self.capacitance

    def equations(self, setting: Setting) -> Piezo:
        """The piezo; a load that is no resistor leaves it open.

        Steps are then chosen for the motion that the damper alone bounds, the greatest there is,
        and the load's power is measured in the circuit.
        """
        rate = self._load_rate(setting)
        if setting.units != SI:
            return piezo(self.coupling, rate, self.leakage_rate or 0.0)
        theta, cp = self.coupling, self.capacitance
        leak = 1.0 / (self.leakage_resistance * cp) if self.leakage_resistance else 0.0
        return piezo(theta**2 / (setting.mass * cp), rate, leak)

    def _load_rate(self, setting):
        """1/(R Cp), 0 for an open circuit."""
        if setting.decay_rate is not None:
            return setting.decay_rate
        resistance, capacitance = setting.resistance, self.capacitance or 1.0
        if not resistance:
            return 0.0
        if resistance * capacitance * FASTEST_DECAY < 1.0:
            raise LoadError(
                f"{setting.name}: the load's resistance of {resistance:g} Ω discharges the piezo's "
                f"{capacitance:g} F faster than {FASTEST_DECAY:g} times a second: choose a greater "
                "one"
            )
        return 1.0 / (resistance * capacitance)

    def network(self, setting: Setting, equations: Piezo, rate: float) -> Network:
        """Capacitance, the current that the velocity drives into it, the force back, the leak."""
        volts, power_unit, charge, capacitance = 1.0, equations.coupling, 1.0, 1.0
        if setting.units == SI:
            capacitance, volts = self.capacitance, self.voltage_unit(setting)
            power_unit = equations.coupling / (capacitance * volts**2)
            charge = self.coupling * setting.length
        elements = [
            Element("capacitor", "piezo", TERMINAL, GROUND, capacitance, holds_state=True),
            Element("moving current", "charge", TERMINAL, GROUND, charge),
        ]
        if equations.coupling > 0.0:
            force = equations.coupling
            elements.append(Element("force of voltage", "back_action", TERMINAL, GROUND, force))
        if equations.own_rate > 0.0:
            leak = 1.0 / (equations.own_rate * capacitance)
            elements.append(Element("resistor", "leak", TERMINAL, GROUND, leak))
        return Network(
            terminal=TERMINAL,
            elements=tuple(elements),
            power_unit=power_unit,
            reference_capacitance=capacitance,
            state_voltage=TERMINAL,
            state_unit=volts,
        )

    def matched_resistance(self, rate: float) -> float:
        """The load resistance 1/(ω Cp) that matches the capacitance."""
        return 1.0 / (rate * (self.capacitance or 1.0))
