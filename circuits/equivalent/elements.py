"""Adds the parts of the equivalent circuit that a scene needs.

The mechanics are an RC network with values of order one: the voltage of node `displacement` is X,
of node `velocity` X'/ω, both on capacitors of 1/ω, so that a current into `velocity` is an
acceleration over ω². ω (`rate`) is the device's angular frequency. Linear terms are controlled
sources, which cost ngspice almost nothing; only nonlinear terms are behavioural. An inductor as
mass would need more Newton iterations per step. The transducer's elements come from its `Network`,
whose terminal carries volts.
"""

from __future__ import annotations

import math
from importlib import resources
from typing import TYPE_CHECKING

from harvester.device import contact as contacts
from harvester.device.damper import drag_formula
from harvester.device.system import System
from harvester.device.terminals import GROUND, LOAD_AMMETER, Component, Network

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from PySpice.Spice.Netlist import Circuit

    from circuits.netlist.load_circuit import LoadCircuit
    from harvester.device.contact import Contact
    from harvester.excitation.prescribed import PrescribedDisplacement
    from harvester.scene.units import Scales

# If there is a base voltage, the noise flows into node `excited`, and an ammeter between it and the
# velocity measures the current, which controls the base voltage.
EXCITED, EXCITATION = "excited", "excitation"
# Node `noise` exists only for a prescribed displacement; otherwise the noise is a current.
DISPLACEMENT, VELOCITY, NOISE, HELD = "displacement", "velocity", "noise", "held_speed"
# Nodes of the load's DC side, and ngspice's name of the load's current.
OUTPUT, REFERENCE, LOAD_CURRENT = "load_out", "load_ref", f"v{LOAD_AMMETER}#branch"
# Prefix of the name of a node at a load's pin.
PIN = ":"
# Stray capacitance of an output node, as a share of the transducer's.
STRAY_SHARE = 1e-6
# Node that follows the held impact speed (`HELD`) one step later.
LAGGING = "lagging_speed"
X, U, H = f"v({DISPLACEMENT})", f"v({VELOCITY})", f"v({HELD})"


def number(value: float) -> str:
    """Format a float so that ngspice reads it back exactly."""
    return repr(float(value))


def literal(name: str, value: float, *description: str) -> str:
    """Format a part's coefficient in an expression of the netlist."""
    return number(value)


def add_oscillator(circuit: Circuit, s: System, rate: float, start: tuple[str, ...]) -> None:
    """Mass, constant and linear force of the spring, damper (Eq. 4a).

    `start` is the initial (displacement, velocity over rate), as text.
    """
    gnd = circuit.gnd
    source = circuit.VoltageControlledCurrentSource
    circuit.C("displacement", DISPLACEMENT, gnd, number(1 / rate), ic=start[0])
    source("velocity", gnd, DISPLACEMENT, VELOCITY, gnd, number(1.0))
    circuit.C("mass", VELOCITY, gnd, number(1 / rate), ic=start[1])
    tilt, linear = s.spring.line
    if tilt != 0.0:
        circuit.I("tilt", VELOCITY, gnd, number(tilt / rate**2))
    if linear != 0.0:
        source("spring", VELOCITY, gnd, DISPLACEMENT, gnd, number(linear / rate**2))
    if s.damper.damping > 0.0:
        circuit.R("damper", VELOCITY, gnd, number(rate / s.damper.damping))


def trapezoidal_prewarp_factor(angle: float) -> float:
    """Pre-warping factor that makes the trapezoidal rule exact for an oscillation at ω h.

    The rule lowers the frequency ω by the share (ωh)²/12, which may be as large as a resonance's
    width. A circuit of the frequency tan(ωh/2)/(ωh/2) ω is computed with exactly ω.
    """
    return math.tan(0.5 * angle) / (0.5 * angle) if angle > 0.0 else 1.0


def add_pace(
    circuit: Circuit, rate: float, pace: float, start: tuple[str, ...], slowed: bool
) -> None:
    """Add capacitors that accelerate displacement and velocity by the factor `pace`.

    With `slowed`, steps shorter than the grid's are corrected: a source slows the displacement, and
    the noise source the velocity.
    """
    if pace != 1.0:
        less = number((1.0 / pace - 1.0) / rate)
        circuit.C("displacement_pace", DISPLACEMENT, circuit.gnd, less, ic=start[0])
        circuit.C("velocity_pace", VELOCITY, circuit.gnd, less, ic=start[1])
    if slowed:
        circuit.I("clock", circuit.gnd, DISPLACEMENT, "external")


def excited_node(network: Network) -> str:
    """The node into which the noise flows: the velocity, or the node before its ammeter."""
    driven = any(element.kind == "base voltage" for element in network.elements)
    return EXCITED if driven else VELOCITY


def add_excitation(circuit: Circuit, waveform: str, network: Network) -> None:
    """Add the base acceleration over ω² as a current; `waveform` is `external` or a PWL."""
    node = excited_node(network)
    circuit.I("noise", circuit.gnd, node, waveform)
    if node != VELOCITY:
        circuit.V(EXCITATION, node, VELOCITY, number(0.0))


def add_prescribed_displacement(
    circuit: Circuit,
    rate: float,
    excitation: PrescribedDisplacement,
    scales: Scales,
    network: Network,
) -> None:
    """Add displacement and velocity as sines, and the corresponding η (Eq. 4a).

    X = a sin ωt; without spring and damper, η = X'' + the transducer's force is the force that
    drives the motion. Its power is the input power, so that the energy balance closes.
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
    forces = [element for element in network.elements if element.kind.startswith("force")]
    ends = [f"reaction{k or ''}" for k in range(len(forces))] + [gnd]
    source("inertia", NOISE, ends[0], DISPLACEMENT, gnd, inertia)
    for element, plus, minus in zip(forces, ends, ends[1:], strict=False):
        gain = number(_force_gain(element, rate, scales))
        if element.kind == "force of current":
            circuit.CurrentControlledVoltageSource(plus, plus, minus, f"V{element.plus}", gain)
        else:
            source(plus, plus, minus, element.plus, element.minus, gain)


def add_nonlinear_forces(circuit: Circuit, s: System, rate: float) -> None:
    """Add the nonlinear part of the spring, air drag, and contacts (Eq. 5)."""
    name = "cubic" if s.spring.odd_cubic else "nonlinear_spring"
    forces = {name: s.spring.nonlinear_formula(X, rate, literal)}
    forces["drag"] = drag_formula(s.damper, U, literal)
    for name, contact in named_contacts(s):
        condition, force = contacts.formulas(contact, s.spring, X, U, rate, literal, H)
        forces[name] = f"({condition}) ? {force} : 0"
    for name, expression in forces.items():
        if expression:
            circuit.BehavioralSource(name, VELOCITY, circuit.gnd, current_expression=expression)


def named_contacts(s: System) -> Iterator[tuple[str, Contact]]:
    """(name, contact) of each contact: "stoppers" for a pair, else its side, numbered from 2 on."""
    seen: dict[str, int] = {}
    for contact in s.contacts:
        name = {0.0: "stoppers", 1.0: "stopper_right", -1.0: "stopper_left"}[contact.side]
        seen[name] = seen.get(name, 0) + 1
        yield name + (str(seen[name]) if seen[name] > 1 else ""), contact


def holding(s: System) -> list[Contact]:
    """The contacts whose impact speed is held (`event`) and has an effect."""
    return [
        contact
        for contact in s.contacts
        if getattr(contact.law, "holds", 0.0) and contact.law.damping_factor > 0.0
    ]


def add_speed_hold(circuit: Circuit, s: System, rate: float, step: float, start: str) -> None:
    """Add a sample-and-hold circuit for the impact speed (`event`).

    Out of contact, `held_speed` follows the speed at which the mass would reach the next stopper
    with its present energy; in contact no current flows. A time constant of half a step is the
    shortest without ringing of the trapezoidal rule. The lag of a second node, `lagging_speed`,
    corrects the lag of `held_speed` to a second-order error. `start` is the initial speed over
    rate, as text.
    """
    held = holding(s)
    conditions = [
        contacts.formulas(contact, s.spring, X, U, rate, literal, H)[0] for contact in held
    ]
    gains = {}
    for contact in held:
        ahead = contact.side or 1.0
        gains[contact.side] = contacts.arrival_formula(contact, ahead, s.spring, X, rate, literal)
    gain = next(iter(gains.values()))
    if len(gains) == 2:
        gain = f"(({U}>0) ? {gains[1.0]} : {gains[-1.0]})"
    arrival = f"{U}*{U}+{gain}"
    per_step = number(2 / (rate * step))
    speed = f"((({arrival})>0) ? sqrt({arrival}) : 0)"
    lag = f"v({LAGGING})"
    for node, change in ((LAGGING, f"{speed}-{lag}"), (HELD, f"2*{speed}-{H}-{lag}")):
        follow = f"({change})*{per_step}"
        for condition in reversed(conditions):
            follow = f"({condition}) ? 0 : ({follow})"
        circuit.C(node, node, circuit.gnd, number(1 / rate), ic=start)
        circuit.BehavioralSource(node, circuit.gnd, node, current_expression=follow)


def add_transducer(
    circuit: Circuit,
    elements: Iterable[Component],
    rate: float,
    scales: Scales,
    state: str | None = None,
    pace: float = 1.0,
) -> None:
    """Add a transducer's network; `state` is its initial value (V or A) as text.

    Sources proportional to the motion are controlled by the velocity node, and a force is a current
    out of it (Eq. 4). The charge moved by the mass and the base's voltage are multiplied by `pace`;
    the excitation is divided by it.
    """
    for element in elements:
        gain = pace if element.kind in ("moving current", "base voltage") else 1.0
        element = element._replace(value=element.value * gain)
        _add_element(circuit, element, rate, scales, state or number(0.0))


def _add_element(
    circuit: Circuit, element: Component, rate: float, scales: Scales, state: str
) -> None:
    gnd, value = circuit.gnd, number(element.value)
    ends = (element.name, element.plus, element.minus)
    if element.kind == "resistor":
        circuit.R(*ends, value)
    elif element.kind == "ammeter":
        circuit.V(*ends, value)
    elif element.kind in ("capacitor", "inductor"):
        add = circuit.C if element.kind == "capacitor" else circuit.L
        add(*ends, value, ic=state if element.holds_state else number(0.0))
    elif element.kind == "moving voltage":
        source = circuit.VoltageControlledVoltageSource
        source(*ends, VELOCITY, gnd, number(element.value * rate))
    elif element.kind == "moving current":
        source = circuit.VoltageControlledCurrentSource
        source(
            element.name, element.minus, element.plus, VELOCITY, gnd, number(element.value * rate)
        )
    elif element.kind == "base voltage":
        gain = number(element.value * rate**2)
        circuit.CurrentControlledVoltageSource(*ends, f"V{EXCITATION}", gain)
    elif element.kind == "force of voltage":
        gain = number(_force_gain(element, rate, scales))
        source = circuit.VoltageControlledCurrentSource
        source(element.name, VELOCITY, gnd, element.plus, element.minus, gain)
    elif element.kind == "force of current":
        gain = number(_force_gain(element, rate, scales))
        circuit.CurrentControlledCurrentSource(
            element.name, VELOCITY, gnd, f"V{element.plus}", gain
        )
    else:
        raise ValueError(f"{element.name}: unknown kind of element {element.kind!r}")


def _force_gain(element, rate, scales):
    """Force of a network element: acceleration over rate² per volt or per ampere."""
    unit = scales.voltage if element.kind == "force of voltage" else 1.0
    return element.value / (rate**2 * unit)


def behind_ammeter(network: Network) -> str:
    """The load's node behind the ammeter."""
    return f"load_{network.terminal}"


def add_resistor(circuit: Circuit, resistance: float, network: Network) -> None:
    """Add the built-in resistor (Ω), behind an ammeter if the network needs one.

    Otherwise the resistor's power follows from the voltage.
    """
    text = resources.files("netlists").joinpath("resistor.lib").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("*")]
    circuit.raw_spice += "\n".join(lines) + "\n"
    node = network.terminal
    if network.current_per_ampere > 0.0:
        node = _add_ammeter(circuit, network)
    circuit.X("load", "resistor", node, circuit.gnd, resistance=number(resistance))


def load_pins(network: Network) -> dict[str, str]:
    """Names of the nodes at a load's pins, after the ammeter.

    The colon distinguishes them from nodes within the load, whose names contain none.
    """
    ends = {"p": behind_ammeter(network), "out": OUTPUT, "ref": REFERENCE}
    return {"n": GROUND, **{pin: f"{PIN}{node}" for pin, node in ends.items()}}


def add_load(circuit: Circuit, load: LoadCircuit, network: Network, named: bool) -> None:
    """Add the call of a netlist behind an ammeter; with `named` it includes parameters.

    While all diodes block, the DC side's potential against the terminals is undefined, and Newton's
    iterations fail at short steps. Stray capacitances to ground at `LoadCircuit.stray_pins` define
    it.
    """
    measured = load.resistance is None or network.current_per_ampere > 0.0
    first = _add_ammeter(circuit, network) if measured else network.terminal
    nodes = {"p": first, "n": circuit.gnd, "out": OUTPUT, "ref": REFERENCE}
    values = {name: number(value) for name, value in load.parameters if named}
    for pin in load.stray_pins:
        stray = number(STRAY_SHARE * network.reference_capacitance)
        circuit.C(f"stray_{pin}", nodes[pin], circuit.gnd, stray, ic=number(0.0))
    circuit.X("load", load.name, *(nodes[pin] for pin in load.pins), **values)


def _add_ammeter(circuit, network):
    """Add 0 V between terminal and load, positive out of the transducer; return the load's node."""
    node = behind_ammeter(network)
    circuit.V(LOAD_AMMETER, network.terminal, node, number(0.0))
    return node
