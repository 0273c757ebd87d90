"""A device as a SPICE sub-circuit of standard elements and behavioural sources."""

from __future__ import annotations

from typing import TYPE_CHECKING

from circuits.equivalent.elements import VELOCITY, H, U, X, number
from harvester.device import contact as contacts
from harvester.device.damper import drag_formula
from harvester.device.terminals import GROUND, LOAD_AMMETER

if TYPE_CHECKING:
    from collections.abc import Iterator

    from circuits.equivalent.block.parameters import Parameters
    from harvester.device.terminals import Component, Network

PINS = ("p", "n", "base", "x")


def subcircuit(name: str, parameters: Parameters) -> str:
    """The sub-circuit in ngspice's syntax."""
    body = [
        "* Initial values are start_displacement, start_velocity and start_state: use uic.",
        *_mechanics(parameters),
        *_electrical(parameters),
    ]
    parameter_lines = "".join(
        f"+ {key}={number(parameter.value)}\n" for key, parameter in parameters.given.items()
    )
    derived = "".join(f".param {key}={{{text}}}\n" for key, text in parameters.derived.items())
    return (
        f".subckt {name} {' '.join(PINS)}\n{parameter_lines}{derived}"
        + "".join(f"{line}\n" for line in body)
        + f".ends {name}\n"
    )


def _mechanics(parameters: Parameters) -> Iterator[str]:
    """Mass, spring, damper, contacts; a current into `velocity` is a force over mass and rate²."""
    system, rate, length = parameters.ready.system, parameters.rate, parameters.length
    refer = parameters.named("{{{}}}".format)
    one = number(1.0 / rate)
    yield f"Cdisplacement displacement 0 {one} ic={{start_displacement*{number(1.0 / length)}}}"
    yield "Gvelocity 0 displacement velocity 0 1.0"
    yield f"Cmass velocity 0 {one} ic={{start_velocity*{number(1.0 / (rate * length))}}}"
    yield f"Gbase velocity 0 base 0 {{base_factor*{number(1.0 / (length * rate**2))}}}"
    yield f"Ex x 0 displacement 0 {{{number(length)}/displacement_unit}}"
    damping = refer("damping", system.damper.damping / rate)
    yield f"Gdamper velocity 0 velocity 0 {damping}"
    tilt, linear = system.spring.line
    if tilt != 0.0:
        yield f"Itilt velocity 0 {refer('tilt', tilt / rate**2, 'F/rate^2')}"
    if linear != 0.0:
        gain = refer("linear_stiffness", linear / rate**2, "k1/rate^2")
        yield f"Gspring velocity 0 displacement 0 {gain}"
    for name, formula in (
        ("nonlinear_spring", system.spring.nonlinear_formula(X, rate, refer)),
        ("drag", drag_formula(system.damper, U, refer)),
    ):
        if formula:
            yield f"B{name} velocity 0 i={formula}"
    for name, contact in parameters.contacts.items():

        def of_contact(key, *rest, name=name):
            return refer(f"{name}_{key}", *rest)

        condition, force = contacts.formulas(
            contact, system.spring, X, U, rate, of_contact, H, bounded=True
        )
        yield f"B{name} velocity 0 i=({condition}) ? {force} : 0"


def _electrical(parameters: Parameters) -> Iterator[str]:
    """The transducer's network between the pins."""
    network: Network = parameters.ready.network
    node = nodes_of(network)
    if metered(network):
        yield f"V{LOAD_AMMETER} {node[network.terminal]} p 0"
    for element in network.elements:
        ends = f"{node.get(element.plus, element.plus)} {node.get(element.minus, element.minus)}"
        swapped = " ".join(reversed(ends.split()))
        value = f"{{{parameters.element(element.name, si_value(element, parameters))}}}"
        start = " ic={start_state}" if element.holds_state else ""
        yield {
            "resistor": f"R{element.name} {ends} {value}",
            "capacitor": f"C{element.name} {ends} {value}{start}",
            "inductor": f"L{element.name} {ends} {value}{start}",
            "ammeter": f"V{element.name} {ends} 0",
            "moving voltage": f"E{element.name} {ends} {VELOCITY} 0 {value}",
            "base voltage": f"E{element.name} {ends} base 0 {value}",
            "moving current": f"G{element.name} {swapped} {VELOCITY} 0 {value}",
            "force of voltage": f"G{element.name} {VELOCITY} 0 {ends} {value}",
            "force of current": f"F{element.name} {VELOCITY} 0 V{element.plus} {value}",
        }[element.kind]


def metered(network: Network) -> bool:
    """Whether a force on the mass is proportional to the current through the terminals."""
    return any(element.plus == LOAD_AMMETER for element in network.elements)


def nodes_of(network: Network) -> dict[str, str]:
    """The block's nodes for the nodes of the network."""
    terminal = "terminal" if metered(network) else "p"
    # The network's node "base" carries the base's voltage; a pin has the same name, so it is
    # renamed.
    return {GROUND: "n", network.terminal: terminal, "base": "lifted"}


def si_value(component: Component, parameters: Parameters) -> float:
    """Value of an element in terms of V(velocity), its current or V(base); others unchanged."""
    rate, scales = parameters.rate, parameters.ready.scales
    if component.kind.startswith("moving"):
        return component.value * rate
    if component.kind == "base voltage":
        return -component.value / parameters.ready.excitation_unit
    if component.kind.startswith("force"):
        unit = scales.voltage if component.kind == "force of voltage" else 1.0
        return component.value / (rate**2 * unit)
    return component.value
