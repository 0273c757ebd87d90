"""The parts of the equivalent circuit, each added only to a scene that needs it.

Mechanics as an RC network of order one: node `displacement` carries X, node `velocity` carries
X'/ω, both on capacitors of 1/ω, so that a current into `velocity` is an acceleration over ω².
ω (`rate`) is the device's own angular frequency. Linear terms are controlled sources, which cost
ngspice almost nothing; only cubic spring and contact are behavioural. An inductor for the mass
would need more Newton iterations a step. Node `piezo` carries terminal volts.
"""

import math
from dataclasses import dataclass

from circuits.loads import library_text
from harvester.forces import speed_held_at_rest
from harvester.parameters import ScaledParameters

# Node `noise` is there only where the displacement is prescribed: elsewhere the noise is a current.
DISPLACEMENT, VELOCITY, PIEZO, NOISE, HELD = (
    "displacement",
    "velocity",
    "piezo",
    "noise",
    "held_speed",
)
# Between the piezo's ammeter and its load, the load's DC side, and ngspice's name of the current.
LOAD, OUTPUT, REFERENCE, LOAD_CURRENT = "load_piezo", "load_out", "load_ref", "vload#branch"
# Stray capacitance of each output node, as a share of the piezo's.
STRAY_SHARE = 1e-6
X, U, H = f"v({DISPLACEMENT})", f"v({VELOCITY})", f"v({HELD})"


@dataclass(frozen=True)
class Electrical:
    """The electrical side in the scene's units.

    Attributes
    ----------
    charge_per_length : θ l, C per scaled displacement (1 in scaled scenes).
    capacitance, resistance : F, Ω (1 and 1/λ in scaled scenes); None for a netlist's load.
    voltage_scale : volts per scaled volt.
    """

    charge_per_length: float
    capacitance: float
    resistance: float | None
    voltage_scale: float

    def power_factor(self, p):
        """Scaled power per watt: β V'V per scaled volt squared over the capacitance's own."""
        return p.coupling / (self.capacitance * self.voltage_scale**2)


def number(value):
    """A float as ngspice reads it back to the last bit."""
    return repr(float(value))


def add_oscillator(circuit, p: ScaledParameters, rate, start):
    """Mass, linear spring and damper, at rest at `start`, as text (Eq. 4a)."""
    gnd = circuit.gnd
    source = circuit.VoltageControlledCurrentSource
    circuit.C("displacement", DISPLACEMENT, gnd, number(1 / rate), ic=start)
    source("velocity", gnd, DISPLACEMENT, VELOCITY, gnd, number(1.0))
    circuit.C("mass", VELOCITY, gnd, number(1 / rate), ic=number(0.0))
    if p.linear_stiffness != 0.0:
        stiffness = number(p.linear_stiffness / rate**2)
        source("spring", VELOCITY, gnd, DISPLACEMENT, gnd, stiffness)
    if p.damping > 0.0:
        circuit.R("damper", VELOCITY, gnd, number(rate / p.damping))


def add_excitation(circuit, waveform):
    """Base acceleration over ω² as a current; `waveform` is `external` or a PWL."""
    circuit.I("noise", circuit.gnd, VELOCITY, waveform)


def add_prescribed_displacement(circuit, p, rate, excitation, scales):
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
    reaction = number(p.coupling / (rate**2 * scales.voltage))
    source("reaction", "reaction", gnd, PIEZO, gnd, reaction)


def add_cubic(circuit, p, rate):
    """Cubic spring κ X³ (Eq. 4a)."""
    expression = f"({number(p.cubic_stiffness / rate**2)}*{X})*({X}*{X})"
    circuit.BehavioralSource("cubic", VELOCITY, circuit.gnd, current_expression=expression)


def add_stoppers(circuit, p, rate):
    """Hertz-damp contact on both sides (Eq. 5), evaluated in contact only."""
    depth = f"abs({X})-{number(p.gap)}"
    force = f"{number(p.contact_stiffness / rate**2)}*pow({depth},1.5)"
    share = f"sgn({X})"
    if p.damping_factor > 0.0:
        share = f"({share}+{number(p.damping_factor)}*{_speed_ratio(p, rate, depth)})"
    expression = f"(abs({X})>{number(p.gap)}) ? {force}*{share} : 0"
    circuit.BehavioralSource("stoppers", VELOCITY, circuit.gnd, current_expression=expression)


def add_speed_hold(circuit, p, rate, step):
    """Sample and hold of the impact speed (`event`).

    Out of contact, `held_speed` follows the speed at which the mass would arrive at the
    stopper with the energy it has; in contact nothing flows. A time constant of half a step
    is the shortest that the trapezoidal rule follows without ringing.
    """
    gap = number(p.gap)
    arrival = f"{U}*{U}+{_spring_energy(p, rate)}"
    follow = f"(({arrival})>0) ? (sqrt({arrival})-{H})*{number(2 / (rate * step))} : "
    follow += f"-{H}*{number(2 / (rate * step))}"
    start = number(speed_held_at_rest(p) / rate)
    circuit.C("held_speed", HELD, circuit.gnd, number(1 / rate), ic=start)
    circuit.BehavioralSource(
        "held_speed",
        circuit.gnd,
        HELD,
        current_expression=f"(abs({X})>{gap}) ? 0 : ({follow})",
    )


def add_piezo(circuit, p, rate, electrical):
    """Clamped capacitance charged by the velocity (Eq. 4b) and the force back (Eq. 4a)."""
    gnd = circuit.gnd
    source = circuit.VoltageControlledCurrentSource
    circuit.C("piezo", PIEZO, gnd, number(electrical.capacitance), ic=number(0.0))
    source("charge", gnd, PIEZO, VELOCITY, gnd, number(electrical.charge_per_length * rate))
    if p.coupling > 0.0:
        back_action = number(p.coupling / (rate**2 * electrical.voltage_scale))
        source("back_action", VELOCITY, gnd, PIEZO, gnd, back_action)


def add_resistor(circuit, electrical):
    """The built-in resistor as a sub-circuit between the piezo's terminals."""
    circuit.raw_spice += library_text("resistor")
    circuit.X("load", "resistor", PIEZO, circuit.gnd, resistance=number(electrical.resistance))


def add_load(circuit, load, electrical):
    """A netlist's call between the piezo's terminals, an ammeter (0 V) before it.

    A current that leaves the piezo is positive. While every diode blocks, a DC side has no
    potential of its own against the piezo, and Newton's iterations fail at short steps: a stray
    capacitance to ground gives it one. A single resistor needs neither: its power follows from
    the voltage.
    """
    plain = load.resistance is not None
    nodes = {"p": PIEZO if plain else LOAD, "n": circuit.gnd, "out": OUTPUT, "ref": REFERENCE}
    if not plain:
        circuit.V("load", PIEZO, LOAD, number(0.0))
    values = {name: number(value) for name, value in load.parameters}
    for pin in ("out", "ref") if load.has_output else ():
        stray = number(STRAY_SHARE * electrical.capacitance)
        circuit.C(f"stray_{pin}", nodes[pin], circuit.gnd, stray, ic=number(0.0))
    circuit.X("load", load.name, *(nodes[pin] for pin in load.pins), **values)


def _spring_energy(p, rate):
    """2 (U(x) − U(δ))/ω² of the bare spring, as an expression: (x² − δ²) (a + κ/2 x²).

    Written as a product because ngspice differentiates term by term.
    """
    half = 0.5 * p.cubic_stiffness / rate**2
    constant = p.linear_stiffness / rate**2 + half * p.gap**2
    slope = f"{number(constant)}+{number(half)}*({X}*{X})" if half > 0.0 else number(constant)
    return f"({X}*{X}-{number(p.gap**2)})*({slope})"


def _speed_ratio(p, rate, depth):
    """X'/v0, at most 1 in size; `harvester.forces.impact_speed` gives the same form."""
    if p.held_impact_velocity:
        return f"((abs({U})<{H}) ? {U}/{H} : sgn({U}))"
    spring = _spring_energy(p, rate)
    if p.preloaded:
        spring = f"((({spring})>0) ? ({spring}) : 0)"
    contact = f"{number(0.8 * p.contact_stiffness / rate**2)}*pow({depth},2.5)"
    # The last term only keeps 0/0 away at the instant of contact.
    return f"{U}*pow({U}*{U}+{spring}+{contact}+1e-30,-0.5)"
