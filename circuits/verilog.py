"""The mechanics of a device, and its piezo, as a Verilog-A module made from its parts' formulas.

The module of the scene `paper` is netlists/harvester.va, to be read and run by hand.
"""

import hashlib

from circuits import elements
from harvester.device import contact as contacts
from harvester.device import spring as springs
from harvester.device.damper import drag_formula
from harvester.device.system import System

NAME = "harvester"

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
//     .model device harvester rate=3 damping=0.02 ...
//     N1 displacement velocity piezo device
//
// The impact velocity held from the moment of contact (`event`) and coils stay behavioural.
"""


def module(system: System, rate=1.0, electrical=None, name=None):
    """The Verilog-A module of a device and its parameters.

    Parameters
    ----------
    system : harvester.device.system.System
        With a piezo, and impact velocities read from the state.
    rate : float
        ω of the netlist (rad/s).
    electrical : circuits.elements.Electrical or None
        None: only the text is wanted.
    name : str or None
        Of the module; None: one that holds a digest of its text, which depends on the parts that
        the device has and not on their values.

    Returns
    -------
    str, str, dict of str to float
        Name, text, and the values of its parameters.
    """
    values = {"rate": rate}

    def parameter(key, value):
        values[key] = value
        return key

    lines = _mechanics(system, rate, parameter)
    values["charge"] = electrical.charge_per_length if electrical else 1.0
    values["capacitance"] = electrical.capacitance if electrical else 1.0
    values["coupling"] = (
        system.transducer.coupling / rate**2 / electrical.voltage_scale if electrical else 1.0
    )
    declared = "".join(f"    parameter real {key} = 1.0;\n" for key in values)
    body = "".join(f"        {line}\n" for line in lines)
    name = name or f"{NAME}_{hashlib.sha256((declared + body).encode()).hexdigest()[:12]}"
    return name, _TEXT.format(head=_HEAD, name=name, declared=declared, body=body), values


def _mechanics(system, rate, parameter):
    """Statements that set `push`, the forces of spring, damper and contacts over rate²."""
    tilt, linear = (*system.spring.coefficients, 0.0, 0.0)[:2]
    terms = [f"{parameter('damping', system.damper.damping / rate)} * u"]
    if tilt != 0.0:
        terms.append(parameter("tilt", tilt / rate**2))
    if linear != 0.0:
        terms.append(f"{parameter('linear_stiffness', linear / rate**2)} * x")
    formulas = (
        springs.nonlinear_formula(system.spring, "x", lambda n, k: parameter(n, k / rate**2)),
        drag_formula(system.damper, "u", parameter),
    )
    lines = [f"push = {' + '.join([*terms, *filter(None, formulas)])};"]
    for name, contact in elements.named_contacts(system):

        def own(key, value, name=name):
            return parameter(f"{name}_{key}", value)

        condition, force = contacts.formulas(contact, system.spring, "x", "u", rate, own)
        lines += [f"if ({condition})", f"    push = push + {force};"]
    return lines


_TEXT = """\
{head}
`include "disciplines.vams"

module {name}(displacement, velocity, piezo);
    inout displacement, velocity, piezo;
    electrical displacement, velocity, piezo;

{declared}
    real x, u, push;

    analog function real sgn;
        input value;
        real value;
        sgn = value > 0.0 ? 1.0 : (value < 0.0 ? -1.0 : 0.0);
    endfunction

    analog begin
        x = V(displacement);
        u = V(velocity);
{body}
        I(displacement) <+ ddt(x / rate) - u;
        I(velocity) <+ ddt(u / rate) + push + coupling * V(piezo);
        I(piezo) <+ capacitance * ddt(V(piezo)) - charge * rate * u;
    end
endmodule
"""
