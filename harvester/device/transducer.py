"""Transducers: a piezo, perhaps leaky, or a coil, each with the state that its load leaves it.

A transducer acts on the mass with a force and hands power to what hangs on its terminals. Its own
loss (leak, winding) is a quantity of its own and never counts as power. Scaled units: the state
is V of Eq. 4b, V' = X' − λ V. For a coil with inductance L and constant Φ, V ≙ L i/(Φ l) obeys the
same equation with λ = (R_coil + R)/L and β = Φ²/(M L); without inductance the current follows the
velocity and nothing is left to integrate.

`load_rate` is the load resistor's part of λ; 0 where a netlist is the load, which only a circuit
knows.
"""

from typing import NamedTuple


class Piezo(NamedTuple):
    """A clamped capacitance Cp, Cp V' = θ x' − V/R_leak − i; force θ V (Eq. 4).

    Attributes
    ----------
    coupling : β = θ²/(M Cp).
    load_rate : λ = 1/(R Cp) (1/s).
    own_rate : 1/(R_leak Cp), 0 without dielectric loss (1/s).
    """

    coupling: float
    load_rate: float
    own_rate: float = 0.0

    def decay_rate(self):
        """λ of V' = X' − λ V (1/s)."""
        return self.load_rate + self.own_rate

    def damping(self):
        """What damps the velocity at once (1/s)."""
        return 0.0

    def force(self, v, state):
        """Force on the mass, β V."""
        return self.coupling * state

    def state_rate(self, v, state):
        """V' (Eq. 4b)."""
        return v - (self.load_rate + self.own_rate) * state

    def voltage(self, v, state):
        """Terminal voltage."""
        return state

    def current(self, v, state):
        """Current that heats the transducer itself: the leak's follows from the voltage."""
        return 0.0

    def load_power(self, v, state):
        """Power into a resistor, β V²/(R Cp) (Eq. 30)."""
        return self.coupling * self.load_rate * state * state

    def loss(self, voltage, current):
        """Power in the leak, β V²/(R_leak Cp)."""
        return self.coupling * self.own_rate * voltage * voltage

    def stored_energy(self, voltage, loss):
        """½ β V²; `loss` is the transducer's own at that time."""
        return 0.5 * self.coupling * voltage * voltage

    def stiffness(self, mechanical):
        """What the open transducer adds to a stiffness per mass (1/s²)."""
        return self.coupling

    def loss_rate(self, frequency):
        """Rate at which load and transducer damp motion at a frequency, βλ/(λ² + ω²) (1/s)."""
        rate = self.load_rate + self.own_rate
        return self.coupling * rate / (rate**2 + frequency**2)


class Coil(NamedTuple):
    """A coil with inductance, L i' = Φ x' − R_coil i − v; force Φ i. The state is L i/(Φ l).

    Voltages are in units of Φ l (1/s).

    Attributes
    ----------
    coupling : β = Φ²/(M L).
    load_rate, own_rate : R/L and R_coil/L (1/s).
    """

    coupling: float
    load_rate: float
    own_rate: float

    def decay_rate(self):
        """λ of V' = X' − λ V (1/s)."""
        return self.load_rate + self.own_rate

    def damping(self):
        """What damps the velocity at once (1/s)."""
        return 0.0

    def force(self, v, state):
        """Force on the mass, β L i/(Φ l)."""
        return self.coupling * state

    def state_rate(self, v, state):
        """V' = X' − λ V."""
        return v - (self.load_rate + self.own_rate) * state

    def voltage(self, v, state):
        """Terminal voltage of a resistor as load, R i."""
        return self.load_rate * state

    def current(self, v, state):
        """The coil's current, as its state."""
        return state

    def load_power(self, v, state):
        """Power into a resistor, R i²."""
        return self.coupling * self.load_rate * state * state

    def loss(self, voltage, current):
        """Power in the winding, R_coil i²."""
        return self.coupling * self.own_rate * current * current

    def stored_energy(self, voltage, loss):
        """½ L i², from the winding's loss R_coil i²."""
        return 0.5 * loss / self.own_rate

    def stiffness(self, mechanical):
        """At the frequency of this mechanical stiffness per mass, β ω²/(λ² + ω²) (1/s²)."""
        square = abs(mechanical) + self.coupling
        return self.coupling * square / ((self.load_rate + self.own_rate) ** 2 + square)

    def loss_rate(self, frequency):
        """Rate at which load and transducer damp motion at a frequency, βλ/(λ² + ω²) (1/s)."""
        rate = self.load_rate + self.own_rate
        return self.coupling * rate / (rate**2 + frequency**2)


class ResistiveCoil(NamedTuple):
    """A coil without inductance: R_coil i = Φ x' − v, so that i follows X' at once; force Φ i.

    Currents are in units of Φ l/R_coil (1/s), voltages in Φ l (1/s).

    Attributes
    ----------
    winding_damping : Φ²/(M R_coil), the damping of a shorted coil (1/s).
    current_share : R_coil/(R_coil + R), the current over that of the shorted coil.
    """

    winding_damping: float
    current_share: float

    def decay_rate(self):
        """0: the state stays 0."""
        return 0.0

    def damping(self):
        """What damps the velocity at once, Φ²/(M (R_coil + R)) (1/s)."""
        return self.winding_damping * self.current_share

    def force(self, v, state):
        """Force on the mass, Φ i."""
        return self.winding_damping * self.current_share * v

    def state_rate(self, v, state):
        """The state stays 0."""
        return 0.0

    def voltage(self, v, state):
        """Terminal voltage, Φ x' − R_coil i."""
        return (1.0 - self.current_share) * v

    def current(self, v, state):
        """The coil's current."""
        return self.current_share * v

    def load_power(self, v, state):
        """Power into a resistor, v i."""
        share = self.current_share * (1.0 - self.current_share)
        return self.winding_damping * share * v * v

    def loss(self, voltage, current):
        """Power in the winding, R_coil i²."""
        return self.winding_damping * current * current

    def stored_energy(self, voltage, loss):
        """Nothing is stored."""
        return 0.0

    def stiffness(self, mechanical):
        """None."""
        return 0.0

    def loss_rate(self, frequency):
        """Rate at which load and coil damp the motion, Φ²/(M (R_coil + R)) (1/s)."""
        return self.winding_damping * self.current_share


def piezo(coupling, load_rate, leakage_rate=0.0):
    """The piezo with these scaled values (1/s for the rates)."""
    return Piezo(float(coupling), float(load_rate), float(leakage_rate))


def coil(mass, constant, resistance, inductance, load_resistance):
    """The coil with these SI values.

    Parameters
    ----------
    mass : kg.
    constant : Φ (N/A).
    resistance, inductance : R_coil > 0 (Ω) and L ≥ 0 (H).
    load_resistance : R (Ω); None where a netlist is the load, taken as an open circuit.
    """
    if inductance == 0.0:
        share = 0.0 if load_resistance is None else resistance / (resistance + load_resistance)
        return ResistiveCoil(constant**2 / (mass * resistance), share)
    load = 0.0 if load_resistance is None else load_resistance / inductance
    return Coil(constant**2 / (mass * inductance), load, resistance / inductance)
