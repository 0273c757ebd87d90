"""A device as a sub-circuit of SPICE: standard elements and behavioural sources."""

from __future__ import annotations

from typing import TYPE_CHECKING

from circuits.equivalent.elements import (
    curved_forces,
    element_line,
    gain_of,
    line_forces,
    number,
    states,
)
from harvester.device.terminals import GROUND, LOAD_AMMETER

if TYPE_CHECKING:
    from collections.abc import Iterator

    from circuits.equivalent.block.parameters import Parameters
    from harvester.device.terminals import Component, Network

PINS = ("p", "n", "base", "x")


def subcircuit(name: str, parameters: Parameters) -> str:
    """The sub-circuit in ngspice's syntax."""
    body = [
        "* It starts from start_displacement, start_velocity and start_state: use uic.",
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
    begin = (f"start_{name}*{number(1.0 / unit)}" for name, unit in
             (("displacement", length), ("velocity", rate * length)))  # fmt: skip
    yield from states(rate, *(f"{{{text}}}" for text in begin))
    yield f"Gbase velocity 0 base 0 {{base_factor*{number(1.0 / (length * rate**2))}}}"
    yield f"Ex x 0 displacement 0 {{{number(length)}/displacement_unit}}"
    damping = refer("damping", system.damper.damping / rate)
    yield f"Gdamper velocity 0 velocity 0 {damping}"
    yield from line_forces(system, rate, refer)
    yield from curved_forces(system, rate, refer, "nonlinear_spring", bounded=True)


def _electrical(parameters: Parameters) -> Iterator[str]:
    """The transducer's network between the pins."""
    network: Network = parameters.ready.network
    node = nodes_of(network)
    if metered(network):
        yield f"V{LOAD_AMMETER} {node[network.terminal]} p 0"
    for element in network.elements:
        value = parameters.element(element.name, si_value(element, parameters))
        value = "0" if element.kind == "ammeter" else f"{{{value}}}"
        plus, minus = (node.get(end, end) for end in (element.plus, element.minus))
        start = " ic={start_state}" if element.holds_state else ""
        yield element_line(element, plus, minus, value, start, "E base 0")


def metered(network: Network) -> bool:
    """Whether a force on the mass is proportional to the current through the terminals."""
    return any(element.plus == LOAD_AMMETER for element in network.elements)


def nodes_of(network: Network) -> dict[str, str]:
    """The block's nodes for the pins of the network."""
    terminal = "terminal" if metered(network) else "p"
    # The network's node "base" is raised by the base's acceleration; its name is a pin's, so it is
    # renamed.
    return {GROUND: "n", network.terminal: terminal, "base": "lifted"}


def si_value(each: Component, parameters: Parameters) -> float:
    """Value of an element in terms of V(velocity), its current or V(base); others unchanged."""
    if each.kind == "base voltage":
        return -each.value / parameters.ready.excitation_unit
    return gain_of(each, parameters.rate, parameters.ready.scales)
