"""The SI parameters of a block, and the coefficients of its scaled formulas.

Formulas are from `harvester.device`, in scaled units. Each coefficient becomes an expression of SI
parameters with only + − * /, which all simulators read in the same way. Its factor is the scaled
value divided by the SI values to which it is proportional, so no scaling is duplicated here. A
coefficient without such a rule is written as a constant.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from circuits.equivalent.elements import named_contacts, number
from harvester.base.errors import NetlistError
from harvester.device import timescales
from harvester.device.coil import CoilTable
from harvester.device.hertz import HertzDamp
from harvester.device.piezo import PiezoTable
from harvester.device.polynomial import Polynomial
from harvester.scene.units import acting_stoppers

if TYPE_CHECKING:
    from harvester.scene.prepared import Prepared

# A factor within this distance of 1 is omitted.
ROUNDING = 1e-12
# Elements of the transducers' networks, with the parameters to which their values are proportional.
ELEMENTS = {
    "piezo": ("capacitance",),
    "charge": ("coupling",),
    "induced": ("coupling",),
    "back_action": ("coupling", "/mass"),
    "leak": ("leakage_resistance",),
    "winding": ("resistance",),
    "coil": ("inductance",),
    "base_charge": ("base_charge", "/capacitance"),
}


class Parameter(NamedTuple):
    """A parameter of a block.

    Attributes
    ----------
    value : float
        Value in the scene.
    unit : str
    meaning : str
    bounds : str
        Range in Verilog-A; empty if unlimited.
    """

    value: float
    unit: str
    meaning: str
    bounds: str = ""


class Parameters:
    """The parameters of a block, and the expressions of these parameters in its formulas.

    Parameters
    ----------
    ready : harvester.scene.prepared.Prepared
        A prepared scene in SI.
    start : (float, float, float)
        Initial X, X' and transducer's state, scaled.
    displacement_unit : float
        Metres per volt at the pin `x`.

    Attributes
    ----------
    given : dict of str to Parameter
    derived : dict of str to str
        Expressions of the parameters, in order of dependence.
    """

    def __init__(
        self, ready: Prepared, start: tuple[float, float, float], displacement_unit: float
    ) -> None:
        self.ready = ready
        self.rate = timescales.angular_frequency(ready.system)
        self.length = ready.scales.displacement
        self.contacts = dict(named_contacts(ready.system))
        self.derived: dict[str, str] = {}
        self.given: dict[str, Parameter] = {}
        self._add_mechanics()
        self._add_contacts()
        self._add_transducer()
        state = start[2] * ready.network.state_unit
        for name, value, unit in (
            ("start_displacement", start[0] * self.length, "m"),
            ("start_velocity", start[1] * self.length, "m/s"),
            ("start_state", state, "V" if ready.network.state_voltage else "A"),
        ):
            self._give(name, value, unit, "at the beginning")
        self._give("displacement_unit", displacement_unit, "m/V", "at the pin x", "(0:inf)")

    def _give(self, name: str, *parameter: Any) -> None:
        self.given[name] = Parameter(*parameter)

    def _add_mechanics(self):
        oscillator, spring = self.ready.scene.oscillator, self.ready.system.spring
        mass: Any = oscillator.mass
        self._give("mass", mass, "kg", "moving mass", "(0:inf)")
        counts = "factor of the base's acceleration"
        self._give("base_factor", oscillator.base_factor, "1", counts)
        self._give("damping", oscillator.damping, "N s/m", "c", "[0:inf)")
        if drag := oscillator.quadratic_damping:
            self._give("quadratic_damping", drag, "N s2/m2", "air drag", "[0:inf)")
        if isinstance(spring, Polynomial):
            for n, value in enumerate(oscillator.coefficients):
                if value:
                    unit = "N/m" + (str(n) if n > 1 else "") if n else "N"
                    self._give(f"k{n}", value, unit, f"of F = ... + k{n} x^{n} + ...")

    def _add_contacts(self):
        stoppers = acting_stoppers(self.ready.scene, self.ready.system.spring)
        for (name, contact), (stopper, _) in zip(self.contacts.items(), stoppers, strict=True):
            if not isinstance(contact.law, HertzDamp):
                continue
            power = f"N/m^{stopper.exponent:g}"
            self._give(f"{name}_stiffness", stopper.stiffness, power, "K", "[0:inf)")
            if contact.law.damping_factor:
                self._give(f"{name}_restitution", stopper.restitution, "1", "e", "[0:1]")
            if isinstance(self.ready.system.spring, Polynomial):
                meaning = "from x = 0 to the stopper"
                self._give(f"{name}_gap", stopper.gap, "m", meaning, "(0:inf)")

    def _add_transducer(self):
        table = self.ready.scene.transducer
        if not isinstance(table, (PiezoTable, CoilTable)):
            return
        per_volt = isinstance(table, PiezoTable)
        units = {"coupling": "N/V" if per_volt else "N/A", "capacitance": "F",
                 "leakage_resistance": "ohm", "base_charge": "C s2/m", "resistance": "ohm",
                 "inductance": "H"}  # fmt: skip
        for name, unit in units.items():
            if value := getattr(table, name, None):
                bounds = "" if name == "base_charge" else "(0:inf)"
                self._give(name, value, unit, "transducer", bounds)

    def proportional(self, value: float, *names: str) -> str:
        """A value as an expression of parameters; a slash before a name divides by it."""
        product, text = 1.0, ""
        for name in names:
            bare = name.removeprefix("/")
            if bare not in self.given:
                return number(value)
            text += f"/{bare}" if bare != name else f"*{name}"
            product *= self.given[bare].value ** (-1.0 if bare != name else 1.0)
        if product == 0.0:
            return number(value)
        factor = value / product
        if text.startswith("*") and abs(factor - 1.0) < ROUNDING:
            return text[1:]
        return number(factor) + text

    def element(self, name: str, value: float) -> str:
        """The value of one element of the transducer's network."""
        if not isinstance(self.ready.scene.transducer, (PiezoTable, CoilTable)):
            return number(value)
        return self.proportional(value, *ELEMENTS.get(name, ("",)))

    def named(self, refer: Callable[[str], str]) -> Callable[..., str]:
        """The function that writes a formula's coefficient (`harvester.device.spring`).

        A contact's keys begin with its name. `refer` returns the text of a reference to a derived
        name.
        """

        def number_of(key: str, value: float, meaning: str = "", bounds: str = "") -> str:
            names = [name for name in self.contacts if key.startswith(f"{name}_")]
            front = f"{max(names, key=len)}_" if names else ""
            expression = self._expression(front, key.removeprefix(front), value, meaning)
            if expression == number(value):
                return expression
            self.derived[f"n_{key}"] = expression
            return refer(f"n_{key}")

        return number_of

    def _expression(self, front, key, value, meaning):
        power = re.fullmatch(r"k(\d)|gain(\d)", key)
        if key == "damping":
            return f"damping*{number(1.0 / self.rate)}/mass"
        if value == 0.0:
            return number(value)
        if key in ("tilt", "linear_stiffness") or power:
            order = {"tilt": 0, "linear_stiffness": 1}.get(key)
            if power:
                order = int(power[1]) if power[1] else int(power[2]) - 1
            if f"k{order}" in self.given:
                return self.proportional(value, f"k{order}", "/mass")
        if front and isinstance(self.ready.system.spring, Polynomial):
            expression = self._of_gap(front, key, value)
            if expression:
                return expression
        rules = {
            "quadratic_damping": ("quadratic_damping", "/mass"),
            "stiffness": (f"{front}stiffness", "/mass"),
            "energy": (f"{front}stiffness", "/mass"),
        }
        if key in rules:
            return self.proportional(value, *rules[key])
        if key == "damping_factor" and f"{front}restitution" in self.given:
            e = f"{front}restitution"
            return f"0.75*(1-{e}*{e})"
        # This is a force or an energy per mass, such as a piece of a table.
        return self.proportional(value, "/mass") if "/rate^2" in meaning else number(value)

    def _of_gap(self, front, key, value):
        """Expression for a coefficient of a contact's formula that depends on the gap."""
        gap = f"{front}gap"
        if key == "gap":
            return self.proportional(value, gap)
        if key == "gap_square":
            return self.proportional(value, gap, gap)
        if key == "gain_slope":
            return self.proportional(value, "k3", "/mass")
        unit = self.rate**2
        if key == "gain_constant":
            terms = [f"k1*{number(1.0 / unit)}"] if "k1" in self.given else []
            if "k3" in self.given:
                terms.append(f"k3*{gap}*{gap}*{number(0.5 / unit)}")
            return f"({'+'.join(terms) or '0'})/mass"
        if key != "gain_below":
            return None
        side = self.contacts[front[:-1]].side or 1.0
        terms = []
        for n in range(8):
            if f"k{n}" in self.given:
                factor = 2.0 * side ** (n + 1) / ((n + 1) * unit * self.length**2)
                terms.append(f"k{n}*{number(factor)}" + f"*{gap}" * (n + 1))
        return f"({'+'.join(terms) or '0'})/mass"


def check_block(ready: Prepared) -> None:
    """Raise if a block cannot represent the scene.

    Raises
    ------
    NetlistError
    """
    scene = ready.scene
    if scene.units != "SI":
        raise NetlistError(
            f"{scene.name}: a block is in SI and the scene's units are {scene.units!r}: write the "
            "device in kg, N and m (paper_si is paper in SI), or use `--as deck`"
        )
    if scene.excitation.prescribes_displacement:
        raise NetlistError(
            f"{scene.name}: excitation.kind = {scene.excitation.kind!r} prescribes the motion, "
            "and a block's base moves: choose another excitation, or use `--as deck`"
        )
    if any(getattr(contact.law, "holds", 0.0) for contact in ready.system.contacts):
        raise NetlistError(
            f'{scene.name}: stoppers.impact_velocity = "event" needs prescribed steps: '
            'use "energy", or `--as deck`'
        )
