"""A transducer of a test: a piezo behind the resistance of its electrodes.

Cp V' = θ x' − i, terminal voltage u = V − R_s i, force θ V. Into a resistor R the current is
i = V/(R_s + R), and the electrodes take R_s i².
"""

from typing import ClassVar, NamedTuple

from harvester.device.keys import SI, positive, table
from harvester.device.linear_transducer import LinearTransducer
from harvester.device.terminals import GROUND, Component, Network, TransducerTable


class Numbers(NamedTuple):
    """β, the rates of load and electrodes in λ = 1/((R_s + R) Cp), and R_s Cp (s)."""

    coupling: float
    load_rate: float
    own_rate: float
    electrode_time: float


class SeriesPiezo(LinearTransducer, Numbers):
    """The state is V, the current i/(θ l)."""

    __slots__ = ()

    @property
    def lossless(self):
        return False

    def voltage(self, v, state):
        return state * (1.0 - self.electrode_time * (self.load_rate + self.own_rate))

    def current(self, v, state):
        return (self.load_rate + self.own_rate) * state

    def loss(self, v, state, current):
        return self.coupling * self.electrode_time * current * current


@table
class SeriesPiezoTable(TransducerTable):
    """A piezo with electrodes that have a resistance."""

    coupling: float = positive("coupling", "N/V", required=True)
    capacitance: float = positive("capacitance", "F", required=True)
    electrode_resistance: float = positive("resistance of the electrodes", "Ω", required=True)

    UNITS: ClassVar = (SI,)
    takes_voltage: ClassVar[bool] = True

    def voltage_unit(self, setting):
        return self.coupling * setting.length / self.capacitance

    def equations(self, setting):
        coupling = self.coupling**2 / (setting.mass * self.capacitance)
        time = self.electrode_resistance * self.capacitance
        if setting.resistance is None:
            return SeriesPiezo(coupling, 0.0, 0.0, time)
        total = self.electrode_resistance + setting.resistance
        load, own = setting.resistance / total, self.electrode_resistance / total
        rate = 1.0 / (total * self.capacitance)
        return SeriesPiezo(coupling, load * rate, own * rate, time)

    def network(self, setting, equations, rate):
        inside, terminal, volts = "electrode", "terminal", self.voltage_unit(setting)
        charge = self.coupling * setting.length
        return Network(
            terminal=terminal,
            elements=(
                Component("capacitor", "own", inside, GROUND, self.capacitance, holds_state=True),
                Component("moving current", "charge", inside, GROUND, charge),
                Component("force of voltage", "back_action", inside, GROUND, equations.coupling),
                Component("resistor", "electrode", inside, terminal, self.electrode_resistance),
            ),
            power_unit=1.0 / (setting.mass * setting.length**2),
            reference_capacitance=self.capacitance,
            state_voltage=inside,
            state_unit=volts,
            current_per_ampere=1.0 / charge,
        )

    def matched_resistance(self, rate):
        return 1.0 / (rate * self.capacitance)
