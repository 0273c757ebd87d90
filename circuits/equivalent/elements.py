"""The parts of the equivalent circuit as lines, each written only for a scene that needs it.

Mechanics as an RC network of order one: node `displacement` carries X, node `velocity` carries
X'/ω, both on capacitors of 1/ω, so that a current into `velocity` is an acceleration over ω².
ω (`rate`) is the device's own angular frequency. Linear terms are controlled sources, which cost
ngspice almost nothing; only nonlinear terms are behavioural. An inductor for the mass
would need more Newton iterations a step. The transducer's elements come from its `Network`,
whose terminal carries volts.
"""

from __future__ import annotations

import math
from importlib import resources
from typing import TYPE_CHECKING, Any

from harvester.device import contact as contacts
from harvester.device.damper import drag_formula
from harvester.device.system import System
from harvester.device.terminals import GROUND, LOAD_AMMETER, Component, Network

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from circuits.netlist.load_circuit import LoadCircuit
    from harvester.device.contact import Contact
    from harvester.excitation.prescribed import PrescribedDisplacement
    from harvester.scene.units import Scales

# Node `excited` lies before the velocity. An ammeter between them measures the noise's current,
# which also drives a base voltage. The node exists only then.
EXCITED, EXCITATION = "excited", "excitation"
# Node `noise` exists only if the displacement is prescribed. Otherwise the noise is a current.
DISPLACEMENT, VELOCITY, NOISE, HELD = "displacement", "velocity", "noise", "held_speed"
# Nodes of the load's DC side, and ngspice's name of the current through the ammeter before the
# load.
OUTPUT, REFERENCE, LOAD_CURRENT = "load_out", "load_ref", f"v{LOAD_AMMETER}#branch"
# Prefix of the name of a node at a load's pin.
PIN = ":"
# Stray capacitance of an output node, as a share of the transducer's.
STRAY_SHARE = 1e-6
# Node that follows the held impact speed (`HELD`) one step later.
LAGGING = "lagging_speed"
X, U, H = f"v({DISPLACEMENT})", f"v({VELOCITY})", f"v({HELD})"


def number(value: float) -> str:
    """A float as ngspice reads it back to the last bit."""
    return repr(float(value))


def literal(name: str, value: float, *description: str) -> str:
    """A part's number in an expression of the netlist."""
    return number(value)


def states(rate: float, displacement: str, velocity: str) -> Iterator[str]:
    """Netlist lines of displacement and velocity, with initial values (velocity over rate)."""
    yield f"C{DISPLACEMENT} {DISPLACEMENT} {GROUND} {number(1 / rate)} ic={displacement}"
    yield f"G{VELOCITY} {GROUND} {DISPLACEMENT} {VELOCITY} {GROUND} {number(1.0)}"
    yield f"Cmass {VELOCITY} {GROUND} {number(1 / rate)} ic={velocity}"


def line_forces(s: System, rate: float, refer: Callable[..., str]) -> Iterator[str]:
    """Constant and linear force of the spring (Eq. 4a); `refer` gives the text of a number."""
    tilt, linear = s.spring.line
    if tilt != 0.0:
        yield f"Itilt {VELOCITY} {GROUND} {refer('tilt', tilt / rate**2, 'F/rate^2')}"
    if linear != 0.0:
        gain = refer("linear_stiffness", linear / rate**2, "k1/rate^2")
        yield f"Gspring {VELOCITY} {GROUND} {DISPLACEMENT} {GROUND} {gain}"


def oscillator(s: System, rate: float, start: tuple[str, ...]) -> Iterator[str]:
    """Mass, constant and linear force of the spring, damper (Eq. 4a).

    `start` is the initial (displacement, velocity over rate), as text.
    """
    yield from states(rate, *start[:2])
    yield from line_forces(s, rate, literal)
    if s.damper.damping > 0.0:
        yield f"Rdamper {VELOCITY} {GROUND} {number(rate / s.damper.damping)}"


def trapezoidal_prewarp_factor(angle: float) -> float:
    """The clock's factor that makes the trapezoidal rule exact for an oscillation of ω h.

    The rule takes the frequency ω for one less by (ωh)²/12, which near a resonance is as much as
    its width. It takes tan(ωh/2)/(ωh/2) ω for ω.
    """
    return math.tan(0.5 * angle) / (0.5 * angle) if angle > 0.0 else 1.0


def pacing(rate: float, pace: float, start: tuple[str, ...], slowed: bool) -> Iterator[str]:
    """Parallel capacitors by which displacement and velocity change faster by a factor `pace`.

    If shorter steps than the grid's are `slowed`, a source slows the displacement; the source of
    the noise slows the velocity.
    """
    if pace != 1.0:
        less = number((1.0 / pace - 1.0) / rate)
        for node, begin in ((DISPLACEMENT, start[0]), (VELOCITY, start[1])):
            yield f"C{node}_pace {node} {GROUND} {less} ic={begin}"
    if slowed:
        yield f"Iclock {GROUND} {DISPLACEMENT} external"


def excited_node(network: Network) -> str:
    """The node into which the noise flows: the velocity, or an ammeter's before it."""
    driven = any(element.kind == "base voltage" for element in network.elements)
    return EXCITED if driven else VELOCITY


def excitation(waveform: str, network: Network) -> Iterator[str]:
    """Base acceleration over ω² as a current; `waveform` is `external` or a PWL."""
    node = excited_node(network)
    yield f"Inoise {GROUND} {node} {waveform}"
    if node != VELOCITY:
        yield f"V{EXCITATION} {node} {VELOCITY} {number(0.0)}"


def prescribed_displacement(
    rate: float, excitation: PrescribedDisplacement, scales: Scales, network: Network
) -> Iterator[str]:
    """Displacement and velocity as sines, and the η of a mass that would move so (Eq. 4a).

    X = a sin ωt; with neither spring nor damper, η = X'' + the transducer's force: η is then the
    force that drives the motion; its power is the input power, so that the energy balance closes.
    """
    amplitude = excitation.amplitude / scales.displacement
    omega = 2.0 * math.pi * excitation.frequency
    cycles = number(excitation.frequency)
    yield f"V{DISPLACEMENT} {DISPLACEMENT} {GROUND} SIN(0 {number(amplitude)} {cycles})"
    speed = number(amplitude * omega / rate)
    yield f"V{VELOCITY} {VELOCITY} {GROUND} SIN(0 {speed} {cycles} 0 0 90)"
    forces = [element for element in network.elements if element.kind.startswith("force")]
    ends = [f"reaction{k or ''}" for k in range(len(forces))] + [GROUND]
    inertia = number(-((omega / rate) ** 2))
    yield f"Einertia {NOISE} {ends[0]} {DISPLACEMENT} {GROUND} {inertia}"
    for element, plus, minus in zip(forces, ends, ends[1:], strict=False):
        gain = number(gain_of(element, rate, scales))
        if element.kind == "force of current":
            yield f"H{plus} {plus} {minus} V{element.plus} {gain}"
        else:
            yield f"E{plus} {plus} {minus} {element.plus} {element.minus} {gain}"


def curved_forces(
    s: System, rate: float, refer: Callable[..., str], spring: str, **own: Any
) -> Iterator[str]:
    """The spring beyond its first power, air drag, and every contact while it acts (Eq. 5).

    `refer` gives the text of a number, `own` is of `harvester.device.contact.formulas`.
    """
    forces = {
        spring: s.spring.nonlinear_formula(X, rate, refer),
        "drag": drag_formula(s.damper, U, refer),
    }
    for name, contact in named_contacts(s):

        def of_contact(key: str, *description: Any, name: str = name) -> str:
            return refer(f"{name}_{key}", *description)

        condition, force = contacts.formulas(contact, s.spring, X, U, rate, of_contact, H, **own)
        forces[name] = f"({condition}) ? {force} : 0"
    for name, expression in forces.items():
        if expression:
            yield f"B{name} {VELOCITY} {GROUND} i={expression}"


def nonlinear_forces(s: System, rate: float) -> Iterator[str]:
    """`curved_forces` with numbers."""
    name = "cubic" if s.spring.odd_cubic else "nonlinear_spring"
    return curved_forces(s, rate, literal, name)


def named_contacts(s: System) -> Iterator[tuple[str, Contact]]:
    """(name, contact) of each: "stoppers" for a pair, else by its side, with a number from 2 on."""
    seen: dict[str, int] = {}
    for contact in s.contacts:
        name = {0.0: "stoppers", 1.0: "stopper_right", -1.0: "stopper_left"}[contact.side]
        seen[name] = seen.get(name, 0) + 1
        yield name + (str(seen[name]) if seen[name] > 1 else ""), contact


def holding(s: System) -> list[Contact]:
    """The contacts whose impact speed is held and matters (`event`)."""
    return [
        contact
        for contact in s.contacts
        if getattr(contact.law, "holds", 0.0) and contact.law.damping_factor > 0.0
    ]


def speed_hold(s: System, rate: float, step: float, start: str) -> Iterator[str]:
    """Sample and hold of the impact speed (`event`).

    Out of contact, `held_speed` follows the speed at which the mass would arrive at the stopper
    ahead with the energy it has; in contact nothing flows. A time constant of half a step is the
    shortest that the trapezoidal rule follows without ringing. Such a node lags; the lag of
    a second node, `lagging_speed`, is added to correct for it, which leaves an error of second
    order. `start` is the initial speed over rate, as text.
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
        yield f"C{node} {node} {GROUND} {number(1 / rate)} ic={start}"
        yield f"B{node} {GROUND} {node} i={follow}"


def transducer(
    elements: Iterable[Component],
    rate: float,
    scales: Scales,
    state: str | None = None,
    pace: float = 1.0,
) -> Iterator[str]:
    """Elements of a transducer's network; `state` is the volts or amperes it begins with, as text.

    A source that moves with the mass is controlled by the velocity, and a force is a current out of
    it (Eq. 4). The charge that the mass moves, and the base's voltage, are multiplied by `pace`;
    the excitation is divided by it.
    """
    for element in elements:
        factor = pace if element.kind in ("moving current", "base voltage") else 1.0
        element = element._replace(value=element.value * factor)
        start = f" ic={state if element.holds_state and state else number(0.0)}"
        gain = number(gain_of(element, rate, scales))
        yield element_line(element, element.plus, element.minus, gain, start)


def gain_of(each: Component, rate: float, scales: Scales) -> float:
    """Value of a network's element, whose mass moves with V(velocity) times rate.

    A base voltage is per ampere of the noise; a force is an acceleration over rate² per volt or
    ampere.
    """
    if each.kind.startswith("moving"):
        return each.value * rate
    if each.kind == "base voltage":
        return each.value * rate**2
    if each.kind.startswith("force"):
        unit = scales.voltage if each.kind == "force of voltage" else 1.0
        return each.value / (rate**2 * unit)
    return each.value


def element_line(
    each: Component, plus: str, minus: str, value: str, start: str, base: str = f"H V{EXCITATION}"
) -> str:
    """An element of a transducer's network between two nodes, its value as text.

    `start` is the initial value of a store, as text; `base` the letter of the source of a base
    voltage, and what controls it.
    """
    name, ends = each.name, f"{plus} {minus}"
    letter, _, shaking = base.partition(" ")
    return {
        "resistor": f"R{name} {ends} {value}",
        "capacitor": f"C{name} {ends} {value}{start}",
        "inductor": f"L{name} {ends} {value}{start}",
        "ammeter": f"V{name} {ends} {value}",
        "moving voltage": f"E{name} {ends} {VELOCITY} {GROUND} {value}",
        "moving current": f"G{name} {minus} {plus} {VELOCITY} {GROUND} {value}",
        "base voltage": f"{letter}{name} {ends} {shaking} {value}",
        "force of voltage": f"G{name} {VELOCITY} {GROUND} {ends} {value}",
        "force of current": f"F{name} {VELOCITY} {GROUND} V{each.plus} {value}",
    }[each.kind]


def behind_ammeter(network: Network) -> str:
    """The load's node where its current is measured."""
    return f"load_{network.terminal}"


def resistor_definition() -> list[str]:
    """The sub-circuit of the built-in resistor."""
    text = resources.files("netlists").joinpath("resistor.lib").read_text(encoding="utf-8")
    return [line for line in text.splitlines() if line.strip() and not line.startswith("*")]


def resistor(resistance: float, network: Network) -> Iterator[str]:
    """The call of the built-in resistor (Ω), behind an ammeter where the network asks for one.

    A single resistor's power follows from the voltage.
    """
    node = network.terminal
    if network.current_per_ampere > 0.0:
        node = behind_ammeter(network)
        yield _ammeter(network)
    yield f"Xload {node} {GROUND} resistor resistance={number(resistance)}"


def load_pins(network: Network) -> dict[str, str]:
    """Names of the nodes at a load's pins, after the ammeter.

    The colon distinguishes them from nodes within the load, whose names hold none.
    """
    ends = {"p": behind_ammeter(network), "out": OUTPUT, "ref": REFERENCE}
    return {"n": GROUND, **{pin: f"{PIN}{node}" for pin, node in ends.items()}}


def load_call(load: LoadCircuit, network: Network, named: bool) -> Iterator[str]:
    """A netlist's call between the terminals, an ammeter before it; its parameters where `named`.

    While every diode blocks, a DC side has no defined potential against the terminals, and
    Newton's iterations fail at short steps: a stray capacitance to ground gives it one, at the pins
    that `LoadCircuit.stray_pins` names.
    """
    nodes = {"p": network.terminal, "n": GROUND, "out": OUTPUT, "ref": REFERENCE}
    if load.resistance is None or network.current_per_ampere > 0.0:
        nodes["p"] = behind_ammeter(network)
        yield _ammeter(network)
    stray = number(STRAY_SHARE * network.reference_capacitance)
    for pin in load.stray_pins:
        yield f"Cstray_{pin} {nodes[pin]} {GROUND} {stray} ic={number(0.0)}"
    values = (f"{name}={number(value)}" for name, value in sorted(load.parameters) if named)
    yield " ".join(["Xload", *(nodes[pin] for pin in load.pins), load.name, *values])


def _ammeter(network):
    """0 V between terminal and load, positive out of the transducer."""
    return f"V{LOAD_AMMETER} {network.terminal} {behind_ammeter(network)} {number(0.0)}"
