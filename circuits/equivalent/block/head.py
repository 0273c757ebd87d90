"""The header of a block's file: content, pins, and limits of accuracy."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from circuits.equivalent.elements import named_contacts, number
from harvester.base.writing import LICENCE
from harvester.device import timescales
from harvester.device.polynomial import Polynomial

if TYPE_CHECKING:
    from circuits.equivalent.block.parameters import Parameters
    from harvester.scene.prepared import Prepared

# Steps of the trapezoidal rule per period and per contact, for a path accurate to about 1e-4.
STEPS_PER_PERIOD, STEPS_PER_CONTACT = 2500, 400
# Duration of a contact, as a share of a period, below which it is called stiff.
STIFF = 0.05


def longest_step(ready: Prepared) -> float:
    """The longest step (s) at which the trapezoidal rule computes a path to about 1e-4."""
    period = 2.0 * math.pi / timescales.fastest_angular_frequency(ready.system)
    contact = timescales.contact_time(ready.system)
    return min(period / STEPS_PER_PERIOD, contact / STEPS_PER_CONTACT)


def head(ready: Prepared, parameters: Parameters, start: bool = True) -> list[str]:
    """Lines of the header without comment marks; the last lines describe one parameter each.

    `start`: whether `start_state` is a parameter and the operating point is sought from X = 0.
    """
    system, step = ready.system, longest_step(ready)
    period = 2.0 * math.pi / timescales.fastest_angular_frequency(system)
    speed = parameters.rate * parameters.length
    lines = [
        f"harvester scene {ready.scene.name}: {_parts(ready)}",
        *LICENCE,
        "",
        "Pins: p, n    terminals, floating; give them a path to ground",
        "      base    acceleration of the base, 1 V for 1 m/s2, against ground",
        "      x       displacement of the mass, 1 V for displacement_unit metres, against ground",
        f"Inside: V(velocity) is the velocity in units of {number(speed)} m/s.",
        "",
        f"Longest step: {step:.2g} s keeps a non-chaotic path within 1e-5 over 25 periods by",
        "the trapezoidal rule at a relative tolerance of 1e-9; the error grows as its square.",
        f"A period lasts {period:.3g} s. Backward Euler and Gear damp the motion: do not use them.",
    ]
    contact = timescales.contact_time(system)
    if contact < STIFF * period:
        lines += [
            f"WARNING: stiff contact. At the rms speed it lasts {contact:.2g} s,",
            f"{contact / period:.2g} of a period: a simulator with its default longest step",
            "skips it without a warning.",
        ]
    wells = [number(well) for well in timescales.wells(system)]
    if start and len(wells) > 1:
        lines += [
            ".op and .ac use the rest position at x = 0, stable or not. To choose a well, write",
            f".nodeset v(xNAME.displacement)=X with one of X = {', '.join(wells)}.",
        ]
    named = [
        f"  {name} ({parameter.unit}): {parameter.meaning}"
        for name, parameter in parameters.given.items()
        if start or name != "start_state"
    ]
    return [*lines, "", "Parameters:", *named]


def _parts(ready):
    """List of a device's parts, as text."""
    scene, spring = ready.scene, ready.system.spring
    form = "a polynomial" if isinstance(spring, Polynomial) else "a table or a range"
    parts = [f"mass, spring by {form}", "damper"]
    if getattr(ready.system.damper, "quadratic_damping", 0.0):
        parts.append("air drag")
    parts += [f"contact {name}" for name, _ in named_contacts(ready.system)]
    parts.append(type(scene.transducer).__name__.removesuffix("Table").lower())
    return ", ".join(parts)
