"""Cores of a device's wells: states in which the mass is trapped, as opposed to a brief crossing.

A mass that passes a saddle may turn back immediately, or cross it repeatedly until it has lost its
excess energy. It has reached a well when it moves between the adjacent saddles with at most
`CORE_SHARE` of the escape energy; a jump leads from one core to another. If residence times are
long, the rate of jumps does not depend on that share.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from harvester.device import timescales
from harvester.device.system import potential

if TYPE_CHECKING:
    from harvester.device.system import System

# Energy limit of a well's core, as a share of the energy from its bottom to the lower adjacent
# saddle.
CORE_SHARE = 0.25


def core_energies(system: System) -> np.ndarray:
    """Largest ½X'² + U(X) in the core of each of several wells.

    From left to right, shape (wells,); scaled energy per mass.
    """
    return np.array(
        [
            float(potential(system, well)) + CORE_SHARE * timescales.barrier(system, well)
            for well in sorted(timescales.wells(system))
        ]
    )


def cores_within(system: System) -> tuple[float, float]:
    """Displacements between which all cores lie."""
    wells, saddles = timescales.wells(system), timescales.saddles(system)
    highest = float(core_energies(system).max())
    ends = []
    for outermost, saddle in ((min(wells), min(saddles)), (max(wells), max(saddles))):
        distance = outermost - saddle
        while float(potential(system, outermost + distance)) <= highest:
            distance *= 2.0
        ends.append(outermost + distance)
    return ends[0], ends[1]


def jump_rates(wells: int, alike: bool) -> dict[str, tuple[tuple[int, int], ...]]:
    """Names of the rates of jumps, with the jumps (from, to) that each counts.

    `wells`: number of wells, at least two; names count them from the left, from 1 on. `alike`:
    whether two wells are symmetric, so that jumps in both directions have one rate.
    """
    pairs = [(a, b) for a in range(wells) for b in range(wells) if a != b]
    if alike:
        return {"jump_rate": tuple(pairs)}
    return {f"jump_rate_from_well_{a + 1}_to_{b + 1}": ((a, b),) for a, b in pairs}


def is_of_jumps(quantity: str) -> bool:
    """Whether a stationary method computes a quantity only with `jump_rates`."""
    return quantity.startswith("jump_rate") or quantity == "slowest_decay_rate"
