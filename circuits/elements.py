"""The parts of the equivalent circuit, each added only to a scene that needs it.

Mechanics as an RC network of order one: node `displacement` carries X, node `velocity` carries
X'/ω, both on capacitors of 1/ω, so that a current into `velocity` is an acceleration over ω².
ω (`rate`) is the device's own angular frequency. Linear terms are controlled sources, which cost
ngspice almost nothing; only what is not linear is behavioural. An inductor for the mass
would need more Newton iterations a step. Node `piezo` carries terminal volts.
"""

import math
from dataclasses import dataclass

from circuits.loads.project import library_text
from harvester.device import contact as contacts
from harvester.device import spring as springs
from harvester.device.damper import drag_formula
from harvester.device.system import System

# Node `noise` is there only where the displacement is prescribed: elsewhere the noise is a current.
DISPLACEMENT, VELOCITY, PIEZO, NOISE, HELD = (
    "displacement",
    "velocity",
    "piezo",
    "noise",
    "held_speed",
)
# A coil's terminal.
COIL = "coil"
# Between the terminal's ammeter and its load, the load's DC side; ngspice's name of the current.
LOAD, OUTPUT, REFERENCE, LOAD_CURRENT = "load_piezo", "load_out", "load_ref", "vload#branch"
AMMETER = "Vload"
# Stray capacitance of each output node, as a share of the transducer's.
STRAY_SHARE = 1e-6
X, U, H = f"v({DISPLACEMENT})", f"v({VELOCITY})", f"v({HELD})"


@dataclass(frozen=True)
class Electrical:
    """The electrical side in the scene's units.

    Attributes
    ----------
    terminal : str
        Node on which the load hangs.
    resistance : Ω (1/λ in scaled scenes); None for a netlist's load.
    voltage_scale : volts per scaled volt.
    power_factor : scaled power per watt.
    reference_capacitance : F, of which stray capacitances are a share.
    charge_per_length, capacitance : of a piezo, θ l (C per scaled displacement) and F (1 in scaled
        scenes).
    volts_per_speed, winding_resistance, inductance, acceleration_per_ampere, scaled_ampere : of a
        coil, Φ l (V s), Ω, H, Φ/(M l) and the scaled current of one ampere.
    """

    terminal: str
    resistance: float | None
    voltage_scale: float
    power_factor: float
    reference_capacitance: float
    charge_per_length: float = 0.0
    capacitance: float = 0.0
    volts_per_speed: float = 0.0
    winding_resistance: float = 0.0
    inductance: float = 0.0
    acceleration_per_ampere: float = 0.0
    scaled_ampere: float = 0.0


def number(value):
    """A float as ngspice reads it back to the last bit."""
    return repr(float(value))


def literal(name, value, *description):
    """A part's number in an expression of the netlist."""
    return number(value)


def add_oscillator(circuit, s: System, rate, start):
    """Mass, constant and linear force of the spring, damper (Eq. 4a).

    `start` is the initial (displacement, velocity over rate), as text.
    """
    gnd = circuit.gnd
    source = circuit.VoltageControlledCurrentSource
    circuit.C("displacement", DISPLACEMENT, gnd, number(1 / rate), ic=start[0])
    source("velocity", gnd, DISPLACEMENT, VELOCITY, gnd, number(1.0))
    circuit.C("mass", VELOCITY, gnd, number(1 / rate), ic=start[1])
    tilt, linear = (*s.spring.coefficients, 0.0, 0.0)[:2]
    if tilt != 0.0:
        circuit.I("tilt", VELOCITY, gnd, number(tilt / rate**2))
    if linear != 0.0:
        source("spring", VELOCITY, gnd, DISPLACEMENT, gnd, number(linear / rate**2))
    if s.damper.damping > 0.0:
        circuit.R("damper", VELOCITY, gnd, number(rate / s.damper.damping))


def add_excitation(circuit, waveform):
    """Base acceleration over ω² as a current; `waveform` is `external` or a PWL."""
    circuit.I("noise", circuit.gnd, VELOCITY, waveform)


def add_prescribed_displacement(circuit, s: System, rate, excitation, scales, electrical):
    """Displacement and velocity as sines, and the η of a mass that would move so (Eq. 4a).

    X = a sin ωt; with neither spring nor damper, η = X'' + βV: what drives the piezo is the power
    put in, and the energy balance holds as it stands.
    """
    gnd = circuit.gnd
    amplitude = excitation.amplitude / scales.displacement
    omega = 2.0 * math.pi * excitation.frequency
    cycles = number(excitation.frequency)
    circuit.V("displacement", DISPLACEMENT, gnd, f"SIN(0 {number(amplitude)} {cycles})")
    speed = number(amplitude * omega / rate)
    circuit.V("velocity", VELOCITY, gnd, f"SIN(0 {speed} {cycles} 0 0 90)")
    source = circuit.VoltageControlledVoltageSource
    inertia = number(-((omega / rate) ** 2))
    source("inertia", NOISE, "reaction", DISPLACEMENT, gnd, inertia)
    if electrical.terminal == COIL:
        reaction = number(electrical.acceleration_per_ampere / rate**2)
        circuit.CurrentControlledVoltageSource("reaction", "reaction", gnd, AMMETER, reaction)
    else:
        reaction = number(s.transducer.coupling / (rate**2 * electrical.voltage_scale))
        source("reaction", "reaction", gnd, PIEZO, gnd, reaction)


def add_nonlinear_spring(circuit, s: System, rate):
    """The powers of the restoring force beyond the first, where there are any."""

    def over_rate(name, value, meaning):
        return number(value / rate**2)

    expression = springs.nonlinear_formula(s.spring, X, over_rate)
    if expression:
        cubic_only = s.spring.symmetric and len(s.spring.odd) == 2
        name = "cubic" if cubic_only else "nonlinear_spring"
        circuit.BehavioralSource(name, VELOCITY, circuit.gnd, current_expression=expression)


def add_drag(circuit, s: System):
    """Quadratic damping C2 |X'| X', where there is any."""
    expression = drag_formula(s.damper, U, literal)
    if expression:
        circuit.BehavioralSource("drag", VELOCITY, circuit.gnd, current_expression=expression)


def add_contacts(circuit, s: System, rate):
    """Every contact, evaluated while it acts only (Eq. 5)."""
    for name, contact in named_contacts(s):
        condition, force = contacts.formulas(contact, s.spring, X, U, rate, literal, H)
        circuit.BehavioralSource(
            name, VELOCITY, circuit.gnd, current_expression=f"({condition}) ? {force} : 0"
        )


def named_contacts(s: System):
    """(name, contact) of each: "stoppers" for a pair, else by its side, with a number from 2 on."""
    seen = {}
    for contact in s.contacts:
        name = {0.0: "stoppers", 1.0: "stopper_right", -1.0: "stopper_left"}[contact.side]
        seen[name] = seen.get(name, 0) + 1
        yield name + (str(seen[name]) if seen[name] > 1 else ""), contact


def holding(s: System):
    """The contacts whose impact speed is held and matters (`event`)."""
    return [
        each
        for each in s.contacts
        if getattr(each.law, "holds", 0.0) and each.law.damping_factor > 0.0
    ]


def add_speed_hold(circuit, s: System, rate, step, start):
    """Sample and hold of the impact speed (`event`).

    Out of contact, `held_speed` follows the speed at which the mass would arrive at the
    stopper ahead with the energy it has; in contact nothing flows. A time constant of half a step
    is the shortest that the trapezoidal rule follows without ringing. `start` is the initial speed
    over rate, as text.
    """
    held = holding(s)
    conditions = [contacts.formulas(each, s.spring, X, U, rate, literal, H)[0] for each in held]
    gains = {
        each.side: contacts.arrival_formula(each, each.side or 1.0, s.spring, X, rate, literal)
        for each in held
    }
    gain = next(iter(gains.values()))
    if len(gains) == 2:
        gain = f"(({U}>0) ? {gains[1.0]} : {gains[-1.0]})"
    arrival = f"{U}*{U}+{gain}"
    per_step = number(2 / (rate * step))
    follow = f"(({arrival})>0) ? (sqrt({arrival})-{H})*{per_step} : -{H}*{per_step}"
    for condition in reversed(conditions):
        follow = f"({condition}) ? 0 : ({follow})"
    circuit.C("held_speed", HELD, circuit.gnd, number(1 / rate), ic=start)
    circuit.BehavioralSource("held_speed", circuit.gnd, HELD, current_expression=follow)


def add_piezo(circuit, s: System, rate, electrical, start=None):
    """Clamped capacitance charged by the velocity (Eq. 4b) and the force back (Eq. 4a)."""
    gnd = circuit.gnd
    source = circuit.VoltageControlledCurrentSource
    capacitance = number(electrical.capacitance)
    circuit.C("piezo", PIEZO, gnd, capacitance, ic=start or number(0.0))
    source("charge", gnd, PIEZO, VELOCITY, gnd, number(electrical.charge_per_length * rate))
    if s.transducer.coupling > 0.0:
        back_action = number(s.transducer.coupling / (rate**2 * electrical.voltage_scale))
        source("back_action", VELOCITY, gnd, PIEZO, gnd, back_action)


def add_leak(circuit, s: System, electrical):
    """The piezo's dielectric loss, where there is any."""
    if s.transducer.own_rate > 0.0:
        resistance = 1.0 / (s.transducer.own_rate * electrical.capacitance)
        circuit.R("leak", PIEZO, circuit.gnd, number(resistance))


def add_coil(circuit, rate, electrical):
    """Induced voltage, winding and inductance up to the terminal; the force back by its current.

    The load's ammeter carries the coil's current, L i' = Φ x' − R_coil i − v.
    """
    gnd = circuit.gnd
    emf = number(electrical.volts_per_speed * rate)
    circuit.VoltageControlledVoltageSource("induced", "induced", gnd, VELOCITY, gnd, emf)
    inside = COIL if electrical.inductance == 0.0 else "winding"
    circuit.R("winding", "induced", inside, number(electrical.winding_resistance))
    if electrical.inductance > 0.0:
        circuit.L("coil", inside, COIL, number(electrical.inductance), ic=number(0.0))
    force = number(electrical.acceleration_per_ampere / rate**2)
    circuit.CurrentControlledCurrentSource("back_action", VELOCITY, gnd, AMMETER, force)


def add_resistor(circuit, electrical):
    """The built-in resistor as a sub-circuit between the terminals, behind a coil's ammeter."""
    circuit.raw_spice += library_text("resistor")
    node = electrical.terminal
    if electrical.terminal == COIL:
        node = LOAD
        circuit.V("load", electrical.terminal, LOAD, number(0.0))
    circuit.X("load", "resistor", node, circuit.gnd, resistance=number(electrical.resistance))


def add_load(circuit, load, electrical):
    """A netlist's call between the terminals, an ammeter (0 V) before it.

    A current that leaves the transducer is positive. While every diode blocks, a DC side has no
    potential of its own against the terminals, and Newton's iterations fail at short steps: a stray
    capacitance to ground gives it one. A single resistor needs neither: its power follows from
    the voltage.
    """
    measured = load.resistance is None or electrical.terminal == COIL
    first = LOAD if measured else electrical.terminal
    nodes = {"p": first, "n": circuit.gnd, "out": OUTPUT, "ref": REFERENCE}
    if measured:
        circuit.V("load", electrical.terminal, LOAD, number(0.0))
    values = {name: number(value) for name, value in load.parameters}
    for pin in ("out", "ref") if load.has_output else ():
        stray = number(STRAY_SHARE * electrical.reference_capacitance)
        circuit.C(f"stray_{pin}", nodes[pin], circuit.gnd, stray, ic=number(0.0))
    circuit.X("load", load.name, *(nodes[pin] for pin in load.pins), **values)
