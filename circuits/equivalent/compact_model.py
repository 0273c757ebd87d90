"""A device's mechanics and piezo as a Verilog-A module, generated from its parts' formulas.

netlists/harvester.va is the module of the scene `paper`, for reading and manual runs.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from circuits.equivalent import elements
from circuits.equivalent.elements import DISPLACEMENT, VELOCITY, holding, number
from harvester.base.errors import CompiledDeviceUnavailable
from harvester.base.writing import LICENCE
from harvester.device import contact as contacts
from harvester.device.damper import drag_formula
from harvester.device.piezo import BASE, TERMINAL, BaseForcedPiezo, PiezoLaw
from harvester.device.system import System

if TYPE_CHECKING:
    from PySpice.Spice.Netlist import Circuit

    from harvester.device.terminals import Network
    from harvester.scene.units import Scales

NAME = "harvester"
MODEL = "compiled_harvester"

_HEAD = """\
// Mechanical and piezoelectric side of a vibration energy harvester, in scaled units.
//
//     X'' + c X' + F(X) + contacts + beta V = eta(t)                                  (4a)
//     Cp V' + i = theta l X',   i into the load                                       (4b)
//     contact: K d^n [s + b0 X'/v0],   d = s X - gap > 0,   b0 = 3 (1 - e^2)/4        (5)
//     v0^2 = X'^2 + 2 max(U(X) - U(gap), 0) + 2 K d^(n+1)/(n+1),   U the energy of F
//
// v0 is the speed at the start of the contact, read from the state; |X'|/v0 <= 1 always. Numbers
// are those of the source paper.
//
// X, the displacement in scaled units, is a voltage, and so is X'/rate: with rate the device's own
// angular frequency (rad/s) both are of order one. A current into `velocity` is an acceleration
// over rate^2, so the base acceleration eta enters as a current source, and so is every force here
// over rate^2. `piezo` carries volts against ground; the load goes there. Initial values:
// `.ic v(displacement)=...` with `uic`.
//
//     openvaf-r harvester.va -o harvester.osdi                         (openvaf-reloaded)
//     osdi harvester.osdi                                    (an ngspice with OSDI, such as 46)
//     .model device harvester coupling=0 ...              (omitted parameters: the scene's)
//     N1 displacement velocity piezo device
//
// The impact velocity held from the moment of contact (`event`) and coils stay behavioural.
""" + "".join(f"// {line}\n" for line in LICENCE)
_BASE_NOTE = """\
//
// `base` carries the voltage that the base's acceleration adds in series with Cp, -Q a/Cp with a
// charge of Q a on the terminals: modes of a beam that follow the base at once. A source sets it;
// Cp d/dt (V(piezo) - V(base)) is in (4b).
"""
# Longest line of an expression, in characters.
_WIDTH = 84
SIGN = """
    analog function real sgn;
        input value;
        real value;
        sgn = value > 0.0 ? 1.0 : (value < 0.0 ? -1.0 : 0.0);
    endfunction
"""


# Elements of a piezo's network that a module includes.
HELD = ("piezo", "charge", "back_action")


class Side(NamedTuple):
    """A piezo's electrical side: volts per scaled volt, θ l (C) and Cp (F)."""

    volts: float = 1.0
    charge: float = 1.0
    capacitance: float = 1.0


def module(
    system: System, rate: float = 1.0, side: Side | None = None, name: str | None = None
) -> tuple[str, str, dict[str, float]]:
    """The Verilog-A module of a device and its parameters.

    Parameters
    ----------
    system : harvester.device.system.System
        A device with a piezo, and with impact velocities read from the state.
    rate : float
        ω of the netlist (rad/s).
    side : Side or None
        None: in scaled units.
    name : str or None
        Name of a module for users, with this device's values as defaults. None: a name with a
        digest of the text, which depends on the kinds of parts but not on their values.

    Returns
    -------
    str, str, dict of str to float
        Name, text, and the values of its parameters.
    """
    values, described = {}, {}

    def parameter(key, value, meaning="", bounds=""):
        values[key] = value
        described[key] = (f" from {bounds}" if bounds else "", f"  // {meaning}" if meaning else "")
        return key

    parameter("rate", rate, "rad/s", "(0:inf)")
    lines = mechanics(system, rate, parameter)
    volts, charge, capacitance = side or Side()
    back_action = system.transducer.coupling / rate**2 / volts
    parameter("coupling", back_action, "beta/rate^2 per scaled volt", "[0:inf)")
    parameter("charge", charge, "theta l, C per unit of X")
    parameter("capacitance", capacitance, "Cp, F", "(0:inf)")

    declared = "".join(
        f"    parameter real {key} = {number(values[key] if name else 1.0)}{bounds};{meaning}\n"
        for key, (bounds, meaning) in described.items()
    )
    body = "".join(f"        {line}\n" for line in lines)
    note, nodes, plates = "", "", "V(piezo)"
    if isinstance(system.transducer, BaseForcedPiezo):
        note, nodes, plates = _BASE_NOTE, f", {BASE}", f"V(piezo) - V({BASE})"
    digest = hashlib.sha256((declared + body + nodes).encode()).hexdigest()
    name = name or f"{NAME}_{digest[:12]}"
    text = _TEXT.format(
        head=_HEAD + note,
        name=name,
        declared=declared,
        body=body,
        sign=SIGN if "sgn(" in body else "",
        nodes=nodes,
        plates=plates,
    )
    return name, text, values


def mechanics(
    system: System, rate: float, parameter: Callable, x: str = "x", u: str = "u", **own: Any
) -> list[str]:
    """Statements that set `push`, the forces of spring, damper and contacts over rate².

    Parameters
    ----------
    system : harvester.device.system.System
    rate : float
    parameter : callable
        Turns (name, value, meaning, range) into the text of a number.
    x, u : str
        Names of X and X'/rate.
    **own
        Options of `harvester.device.contact.formulas`.
    """

    def over_square(key, value, meaning):
        return parameter(key, value / rate**2, meaning)

    tilt, linear = system.spring.line
    damping = parameter("damping", system.damper.damping / rate, "c/rate", "[0:inf)")
    terms = [
        f"{damping}*{u}",
        over_square("tilt", tilt, "F(0)/rate^2") if tilt != 0.0 else "",
        f"{over_square('linear_stiffness', linear, 'k1/rate^2')}*{x}" if linear != 0.0 else "",
        system.spring.nonlinear_formula(x, rate, parameter),
        drag_formula(system.damper, u, parameter),
    ]
    lines = _wrapped(f"push = {' + '.join(filter(None, terms))};")
    for name, contact in elements.named_contacts(system):

        def of_contact(key, value, *description, name=name):
            return parameter(f"{name}_{key}", value, *description)

        condition, force = contacts.formulas(contact, system.spring, x, u, rate, of_contact, **own)
        lines += [f"if ({condition})", *_wrapped(f"    push = push + {force};")]
    return lines


def _wrapped(statement):
    """Split a statement into lines before operators."""
    lines = [""]
    for piece in re.split(r"(?=[*+])", statement):
        if len(lines[-1] + piece) > _WIDTH:
            lines.append("        ")
        lines[-1] += piece
    return lines


_TEXT = """\
{head}
`include "disciplines.vams"

module {name}(displacement, velocity, piezo{nodes});
    inout displacement, velocity, piezo{nodes};
    electrical displacement, velocity, piezo{nodes};

{declared}
    real x, u, push;
{sign}
    analog begin
        x = V(displacement);
        u = V(velocity);

        // Damper, spring and contacts over rate^2.
{body}
        I(displacement) <+ ddt(x / rate) - u;
        I(velocity) <+ ddt(u / rate) + push + coupling * V(piezo);  // (4a)
        I(piezo) <+ capacitance * ddt({plates}) - charge * rate * u;  // (4b)
    end
endmodule
"""


def add_device(circuit: Circuit, network: Network) -> None:
    """Add one compiled device, connected to the nodes of `circuits.equivalent.elements`."""
    ends = (DISPLACEMENT, VELOCITY, TERMINAL, *({BASE} & network.nodes))
    circuit.raw_spice += f"Nharvester {' '.join(ends)} {MODEL}\n"


def left_out(network: Network) -> list:
    """Elements of a piezo's network that the compiled device does not include."""
    return [element for element in network.elements if element.name not in HELD]


def add_model(
    circuit: Circuit,
    system: System,
    rate: float,
    network: Network,
    scales: Scales,
    pace: float = 1.0,
) -> None:
    """The `.model` line that all copies of a scene's device share.

    Parameters
    ----------
    circuit : PySpice.Spice.Netlist.Circuit
    system : harvester.device.system.System
    rate : float
        ω of the netlist (rad/s).
    network : harvester.device.terminals.Network
    scales : harvester.scene.units.Scales
    pace : float
        Factor of the charge moved by the mass; see
        `circuits.equivalent.elements.trapezoidal_prewarp_factor`.
    """
    charge, capacitance = (network.value(name) for name in ("charge", "piezo"))
    side = Side(scales.voltage, charge * pace, capacitance)
    name, _, values = module(system, rate, side)
    settings = " ".join(f"{key}={number(value)}" for key, value in values.items())
    circuit.raw_spice += f".model {MODEL} {name} {settings}\n"


def add_starts(circuit: Circuit, starts: Any) -> None:
    """Add initial values of every copy: pairs of the nodes' prefix and three values, as text."""
    for prefix, start in starts:
        nodes = dict(zip((DISPLACEMENT, VELOCITY, TERMINAL), start[:3], strict=True))
        values = " ".join(f"v({prefix}{node})={value}" for node, value in nodes.items())
        circuit.raw_spice += f".ic {values}\n"


def module_of(system: System) -> tuple[str, str]:
    """Name and Verilog-A text of the module for a device.

    Raises
    ------
    CompiledDeviceUnavailable
        A part has no compiled form.
    """
    if holding(system):
        raise CompiledDeviceUnavailable(
            'stoppers.impact_velocity = "event": not for the compiled device; use "energy"'
        )
    if not isinstance(system.transducer, PiezoLaw):
        raise CompiledDeviceUnavailable("the compiled device supports only a piezo")
    return module(system)[:2]
