"""Number of realizations that run together: in one netlist, or in Monte Carlo's loop."""

from __future__ import annotations

import math

from harvester.device import timescales
from harvester.engines.monte_carlo.engine import MOST_TOGETHER
from harvester.scene.prepared import Prepared
from harvester.scene.steps import knot_spacing, steps_per_contact, steps_per_sample

# More copies in one netlist are no faster, as `accuracy` measures: behavioural elements soon
# exceed the processor's cache.
MOST_COPIES = {"behavioural": 16, "compiled": 200}
# Least number of netlists into which the realizations of a run are split, to use all cores.
FEWEST_NETLISTS = 8
# Fewest copies in one netlist, since copies share the shortest step: 32 compiled ones are 1.7 times
# as fast as 8, and 3.7 times as fast as behavioural ones. There are at least two netlists
# nevertheless.
FEWEST_COPIES = {"behavioural": 1, "compiled": 32}
FEWEST_FOR_COPIES = 2


def copies(realizations: int, device: str) -> int:
    """Fastest number of copies of the "behavioural" or "compiled" device in one netlist.

    It depends on the scene alone: results do not depend on the machine or the number of workers.
    """
    share = max(
        realizations // FEWEST_NETLISTS,
        min(realizations // FEWEST_FOR_COPIES, FEWEST_COPIES[device]),
    )
    return max(1, min(share, MOST_COPIES[device]))


def together(realizations: int, workers: float) -> int:
    """Realizations that Monte Carlo integrates together: an equal number per worker, up to a limit.

    They are independent: results do not depend on this number. `workers` is inf if unknown.
    """
    among = FEWEST_NETLISTS if math.isinf(workers) else int(workers)
    rounds = math.ceil(realizations / among / MOST_TOGETHER)
    return math.ceil(realizations / (rounds * among))


def share_steps(
    prepared_scene: Prepared,
    step: str | float = "default",
    source: str = "external",
    tolerance: float | None = None,
) -> bool:
    """Whether several realizations may be copies in one netlist, which share the time steps.

    Each realization gets its own netlist if contacts are stiff (each would shorten all copies'
    steps), if the local error controls the steps, or if the load switches.
    """
    return (
        prepared_scene.scene.load.is_resistor
        and source == "external"
        and tolerance is None
        and not contacts_shorten_steps(prepared_scene, step)
    )


def contacts_shorten_steps(prepared_scene: Prepared, step: str | float) -> bool:
    """Whether the longest step does not resolve a contact at the rms speed."""
    system = prepared_scene.system
    longest = knot_spacing(prepared_scene) / steps_per_sample(prepared_scene, step)
    return timescales.contact_time(system) < steps_per_contact(prepared_scene, step) * longest
