"""The piezo: a clamped capacitance charged by the velocity, optionally with leakage (Eq. 4).

M x'' + … + θ V = …, Cp V' = θ x' − Q a' − V/R_leak − i, with the load's current i. Scaled:
V' = X' + κ η' − λ V. The base's acceleration a moves the charge Q a directly through the residual
modes of a beam, which follow it quasi-statically (`base_charge`); η = −μ a/l, so that κ = Q/(μ θ).
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, NamedTuple

from harvester.base.errors import LoadError
from harvester.device.dispatch import Values
from harvester.device.keys import SCALED, SI, OneOf, key, not_negative, positive, table
from harvester.device.linear_transducer import LinearTransducer, TransducerRates
from harvester.device.terminals import GROUND, Component, Network, Setting, TransducerTable

# Largest decay rate λ (1/s) whose square does not overflow.
FASTEST_DECAY = 1e150
TERMINAL = "piezo"
# The node whose voltage against ground the base's acceleration sets, in series with Cp.
BASE = "base"


class PiezoLaw(LinearTransducer):
    """Properties of every piezo, with or without charge moved by the base's acceleration."""

    __slots__ = ()

    def voltage(self, v: Values, state: Values) -> Values:
        """Terminal voltage."""
        return state

    def loss(self, v: Values, state: Values, current: Values) -> Values:
        """Power in the leakage resistance, β V²/(R_leak Cp)."""
        return self.coupling * self.own_rate * state * state

    def stiffness(self, mechanical: float) -> float:
        """Stiffness per mass that the open-circuit piezo adds, β (1/s²)."""
        return self.coupling


class Piezo(PiezoLaw, TransducerRates):
    """A piezo whose state is the voltage V; coupling β = θ²/(M Cp), decay rate
    λ = 1/(R Cp) + 1/(R_leak Cp)."""

    __slots__ = ()


class _ShakenRates(NamedTuple):
    coupling: float
    load_rate: float
    own_rate: float
    base_share: float


class BaseForcedPiezo(PiezoLaw, _ShakenRates):
    """A piezo in which the base's acceleration moves charge directly.

    The state is the voltage V. The capacitance stores W = V − κ η with the excitation η, and
    W' = X' − λ V; ½βW² is the energy of the capacitance and the residual modes.

    Attributes
    ----------
    base_share
        κ, the open-circuit voltage per unit of η, scaled (s²).
    """

    __slots__ = ()

    def base_rate(self, slope: float) -> float:
        """Contribution of the base to the state's rate, κ η'."""
        return self.base_share * slope

    def base_speed(self, v: Values, state: Values, current: Values) -> Values:
        """X' − βκ W': the base also moves the residual modes."""
        return v - self.coupling * self.base_share * (v - self.own_rate * state - current)

    def kept_state(self, state: Values, noise: Values) -> Values:
        """The state that stores energy, W = V − κ η."""
        return state - self.base_share * noise

    def current(self, v: Values, state: Values) -> Values:
        """Scaled current through a resistive load, V/(R Cp)."""
        return self.load_rate * state


def piezo(
    coupling: float, load_rate: float, leakage_rate: float = 0.0, base_share: float = 0.0
) -> Piezo | BaseForcedPiezo:
    """The piezo with these scaled values (1/s for the rates, s² for κ)."""
    rates = float(coupling), float(load_rate), float(leakage_rate)
    return BaseForcedPiezo(*rates, float(base_share)) if base_share else Piezo(*rates)


@table
class PiezoTable(TransducerTable):
    """A piezoelectric transducer.

    In SI, `k2` may be given instead of `coupling`: θ is then computed from it.
    """

    coupling: float = not_negative(
        "piezoelectric coupling: θ", "N/V", "β", usual=(1e-8, 1.0), drawn=True
    )
    capacitance: Any = positive(
        "capacitance of the piezo: Cp, clamped", "F",
        units=(SI,), required=True, likely=(1e-15, 10.0, 1e-9, "nF"), usual=(1e-13, 1e-3),
        drawn=True,
    )  # fmt: skip
    leakage_resistance: float | None = positive(
        "leakage resistance of the piezo: R_leak, its dielectric loss", "Ω", units=(SI,)
    )
    leakage_rate: float | None = not_negative(
        "leakage rate", scaled="1/(R_leak Cp), 1/s", units=(SCALED,)
    )
    base_charge: float = key(
        "charge that the base moves: Q per acceleration", "C s²/m", "Q/θ at μ = 1, s²",
        default=0.0, rare=True, drawn=True,
    )  # fmt: skip
    k2: float | None = positive(
        "electromechanical coupling k²: θ²/(K Cp), K at the stiffest rest position", "1",
        units=(SI,), drawn=True,
    )  # fmt: skip

    ALTERNATIVES: ClassVar = (OneOf(("coupling", "k2")),)
    takes_voltage: ClassVar[bool] = True

    def coupling_at(self, stiffness: float) -> float:
        """The coupling (N/V) that follows from `k2` and the spring's stiffness at rest (N/m)."""
        return math.sqrt((self.k2 or 0.0) * stiffness * self.capacitance)

    def voltage_unit(self, setting: Setting) -> float:
        """The scaled unit of voltage, θ l/Cp."""
        if setting.units != SI:
            return 1.0
        return self.coupling * setting.length / self.capacitance

    def equations(self, setting: Setting) -> Piezo | BaseForcedPiezo:
        """The piezo; open-circuited unless the load is a resistor.

        An open circuit gives the largest motion, for which steps are chosen; the circuit measures
        the load's power.
        """
        rate, share = self._load_rate(setting), self._base_share(setting)
        if setting.units != SI:
            return piezo(self.coupling, rate, self.leakage_rate or 0.0, share)
        theta, cp = self.coupling, self.capacitance
        leak = 1.0 / (self.leakage_resistance * cp) if self.leakage_resistance else 0.0
        return piezo(theta**2 / (setting.mass * cp), rate, leak, share)

    def _base_share(self, setting):
        """κ = Q/(μ θ); 0 if the base is at rest."""
        if not self.base_charge:
            return 0.0
        if setting.units != SI:
            return self.base_charge * setting.excitation_unit
        return self.base_charge * setting.excitation_unit / (self.coupling * setting.length)

    def _load_rate(self, setting):
        """1/(R Cp), 0 for an open circuit."""
        if setting.decay_rate is not None:
            return setting.decay_rate
        resistance, capacitance = setting.resistance, self.capacitance or 1.0
        if not resistance:
            return 0.0
        if resistance * capacitance * FASTEST_DECAY < 1.0:
            raise LoadError(
                f"{setting.name}: the load resistance of {resistance:g} Ω discharges the piezo's "
                f"{capacitance:g} F faster than {FASTEST_DECAY:g} times a second: choose a larger "
                "resistance"
            )
        return 1.0 / (resistance * capacitance)

    def network(self, setting: Setting, equations: Piezo | BaseForcedPiezo, rate: float) -> Network:
        """Network of the capacitance, the velocity's current into it, the reaction force, the leak.

        The base's acceleration adds a voltage in series with the capacitance.
        """
        volts, power_unit, charge, capacitance = 1.0, equations.coupling, 1.0, 1.0
        if setting.units == SI:
            capacitance, volts = self.capacitance, self.voltage_unit(setting)
            power_unit = equations.coupling / (capacitance * volts**2)
            charge = self.coupling * setting.length
        behind, current_per_ampere = GROUND, 0.0
        base: tuple[Component, ...] = ()
        if isinstance(equations, BaseForcedPiezo):
            behind, current_per_ampere = BASE, 1.0 / charge
            share = equations.base_share * volts
            base = (Component("base voltage", "base_charge", BASE, GROUND, share),)
        elements = [
            Component("capacitor", "piezo", TERMINAL, behind, capacitance, holds_state=True),
            Component("moving current", "charge", TERMINAL, GROUND, charge),
            *base,
        ]
        if equations.coupling > 0.0:
            force = equations.coupling
            elements.append(Component("force of voltage", "back_action", TERMINAL, GROUND, force))
        if equations.own_rate > 0.0:
            leak = 1.0 / (equations.own_rate * capacitance)
            elements.append(Component("resistor", "leak", TERMINAL, GROUND, leak))
        return Network(
            terminal=TERMINAL,
            elements=tuple(elements),
            power_unit=power_unit,
            reference_capacitance=capacitance,
            state_voltage=TERMINAL,
            state_unit=volts,
            current_per_ampere=current_per_ampere,
        )

    def matched_resistance(self, rate: float) -> float:
        """The load resistance 1/(ω Cp) that matches the capacitance."""
        return 1.0 / (rate * (self.capacitance or 1.0))
