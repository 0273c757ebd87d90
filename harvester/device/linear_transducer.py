"""The equations of a transducer with one state, and the coefficients of the simplest transducers.

The state e obeys e' = X' − λ e, scaled so that X' drives it with the factor 1; the force on the
mass against X' is d X' + β e. Every linear network with one capacitance or one inductance has this
form.
"""

from __future__ import annotations

from typing import NamedTuple

from harvester.device.dispatch import Values


class NoBaseForce:
    """Base class of transducers on which the base's acceleration does not act directly."""

    __slots__ = ()

    def base_rate(self, slope: float) -> float:
        """The term that η', the excitation's rate of change, adds to X' in the state's equation.

        No term is −0.0: adding it changes no bit, and the compiler removes it.
        """
        return -0.0

    def base_speed(self, v: Values, state: Values, current: Values) -> Values:
        """Velocity whose product with η is the input power; `current` flows into the load."""
        return v

    def kept_state(self, state: Values, noise: Values) -> Values:
        """The state that determines `stored_energy`, and that a scene's start sets."""
        return state


class LinearTransducer(NoBaseForce):
    """Base class, without fields, of transducers with these equations.

    Methods take and return floats and are compiled. A subclass has at least
    `coupling`, `load_rate` and `own_rate` as in `TransducerRates`, and `voltage` and `loss`.
    """

    __slots__ = ()

    coupling: float
    load_rate: float
    own_rate: float

    @property
    def lossless(self) -> bool:
        """Whether the transducer itself dissipates no power."""
        return self.own_rate == 0.0

    def decay_rate(self) -> float:
        """Decay rate λ of the state e, from e' = X' − λ e (1/s)."""
        return self.load_rate + self.own_rate

    def damping(self) -> float:
        """Damping d: the part of the force that is proportional to the velocity, over velocity
        (1/s)."""
        return 0.0

    def force(self, v: Values, state: Values) -> Values:
        """Force on the mass, d X' + β e."""
        return self.coupling * state

    def state_rate(self, v: Values, state: Values) -> Values:
        """Rate of change of the state, e' = X' − λ e."""
        return v - (self.load_rate + self.own_rate) * state

    def current(self, v: Values, state: Values) -> Values:
        """The current into a resistor as load, if `loss` needs it."""
        return 0.0

    def load_power(self, v: Values, state: Values) -> Values:
        """Power into a resistor."""
        return self.coupling * self.load_rate * state * state

    def stored_energy(self, state: Values) -> Values:
        """The stored energy ½ β e²."""
        return 0.5 * self.coupling * state * state

    def stiffness(self, mechanical: float) -> float:
        """Stiffness per mass (1/s²) of the transducer at the frequency √`mechanical`."""
        square = abs(mechanical) + self.coupling
        return self.coupling * square / ((self.load_rate + self.own_rate) ** 2 + square)

    def loss_rate(self, frequency: float) -> float:
        """Damping rate of motion at a frequency by load and transducer, βλ/(λ² + ω²) (1/s)."""
        rate = self.load_rate + self.own_rate
        return self.coupling * rate / (rate**2 + frequency**2)


class TransducerRates(NamedTuple):
    """Coefficients of a transducer whose loss and load both discharge the state.

    Attributes
    ----------
    coupling
        β, force per state (1/s²).
    load_rate
        The load resistor's part of λ (1/s); 0 if the load is a netlist.
    own_rate
        The transducer's own part of λ (1/s).
    """

    coupling: float
    load_rate: float
    own_rate: float = 0.0
