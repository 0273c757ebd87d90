"""A device as a Verilog-A module with the pins of the sub-circuit.

Its states are relative to their initial values, so that every node starts at 0 V. A simulator then
needs no initial values, and its search for an operating point begins in the device's well.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from circuits.equivalent.block.head import head
from circuits.equivalent.block.spice import PINS, metered, nodes_of, si_value
from circuits.equivalent.compact_model import SIGN, mechanics
from circuits.equivalent.elements import number

if TYPE_CHECKING:
    from circuits.equivalent.block.parameters import Parameters
    from harvester.device.terminals import Component, Network

_TEXT = """\
{head}
`include "disciplines.vams"

module {name}({pins});
    inout p, n, base, x;
    electrical p, n, base, x;
    electrical displacement, velocity{nodes};

{parameters}
    real place, u, push, pull;
{derived}{sign}
    analog begin
{values}
        place = V(displacement) + start_displacement*{per_length};
        u = V(velocity) + start_velocity*{per_speed};

        // Damper, spring and contacts, per mass over rate^2; below, the transducer's force.
{mechanics}
        pull = 0.0;
{electrical}
        I(displacement) <+ ddt({per_rate}*V(displacement)) - u;
        I(velocity) <+ ddt({per_rate}*V(velocity)) + push + pull;
        I(velocity) <+ base_factor*{per_base}*V(base);
        V(x) <+ place*{length}/displacement_unit;
    end
endmodule
"""


def module(name: str, parameters: Parameters) -> str:
    """The module's text, with the header as a comment."""
    prepared_scene, rate, length = parameters.ready, parameters.rate, parameters.length
    refer = parameters.named(str)
    moved = mechanics(prepared_scene.system, rate, refer, "place", "u", bounded=True)
    network: Network = prepared_scene.network
    named = nodes_of(network)
    inside = sorted(named.get(node, node) for node in network.nodes - {network.terminal})
    inside += ["terminal"] * metered(network)
    return _TEXT.format(
        head="".join(
            f"// {line}".rstrip() + "\n" for line in head(prepared_scene, parameters, start=False)
        ),
        name=name,
        pins=", ".join(PINS),
        nodes="".join(f", {node}" for node in inside),
        parameters="".join(
            f"    parameter real {key} = {number(parameter.value)}"
            f"{f' from {parameter.bounds}' if parameter.bounds else ''};  // {parameter.unit}\n"
            for key, parameter in parameters.given.items()
            if key != "start_state"
        ),
        derived="".join(f"    real {key};\n" for key in parameters.derived),
        sign=SIGN if "sgn(" in " ".join(moved) else "",
        values="".join(
            f"        {key} = {formula};\n" for key, formula in parameters.derived.items()
        ),
        per_length=number(1.0 / length),
        per_speed=number(1.0 / (rate * length)),
        per_rate=number(1.0 / rate),
        per_base=number(1.0 / (length * rate**2)),
        length=number(length),
        mechanics="".join(f"        {line}\n" for line in moved),
        electrical="".join(f"        {line}\n" for line in _electrical(parameters)),
    )


def _electrical(parameters: Parameters) -> list[str]:
    """Verilog-A contribution statements of the transducer's network."""
    network: Network = parameters.ready.network
    lines = [_contribution(element, nodes_of(network), parameters) for element in network.elements]
    # A 0 V source would merge both nodes and its current would be 0, so 1e-9 Ω measures it.
    return ["V(terminal, p) <+ 1e-9*I(terminal, p);", *lines] if metered(network) else lines


def _contribution(component: Component, node: dict[str, str], parameters: Parameters) -> str:
    ends = (
        f"{node.get(component.plus, component.plus)}, {node.get(component.minus, component.minus)}"
    )
    value = parameters.element(component.name, si_value(component, parameters))
    return {
        "resistor": f"I({ends}) <+ V({ends})/({value});",
        "capacitor": f"I({ends}) <+ {value}*ddt(V({ends}));",
        "inductor": f"V({ends}) <+ {value}*ddt(I({ends}));",
        "ammeter": f"V({ends}) <+ 0.0;",
        "moving voltage": f"V({ends}) <+ {value}*u;",
        "base voltage": f"V({ends}) <+ {value}*V(base);",
        "moving current": f"I({ends}) <+ -{value}*u;",
        "force of voltage": f"pull = pull + {value}*V({ends});",
        "force of current": f"pull = pull + {value}*I(terminal, p);",
    }[component.kind]
