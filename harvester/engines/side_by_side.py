"""How many realizations the circuit engine takes side by side in one netlist."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from harvester.device import timescales
from harvester.engines.steps import knot_spacing, steps_per_contact, steps_per_knot
from harvester.scene.units import scale

if TYPE_CHECKING:
    from harvester.scene.model import Scene

# More copies in one netlist are no faster, as `work-precision` measures: behavioural elements soon
# fill the processor's cache.
MOST_COPIES = {"behavioural": 16, "compiled": 200}
# The realizations of a run are split into at least so many netlists, for the machine's cores.
FEWEST_NETLISTS = 8


def copies(
    scene: Scene,
    most: Callable,
    step: str | float = "default",
    source: str = "external",
    tolerance: float | None = None,
    netlists: int = FEWEST_NETLISTS,
) -> int:
    """Copies of the device in one netlist: as many as pay.

    They share their steps. So a stiff contact, which shortens those of one copy after another,
    control by the local error and loads that switch leave each realization its own netlist.
    The number follows from the scene alone: the same scene gives the same numbers on any machine.

    Parameters
    ----------
    scene : Scene
    most : callable
        Gives the number beyond which more are no faster; asked only where it matters.
    step, source, tolerance
        See `harvester.simulate`.
    netlists : int
        That the realizations are split into at least.
    """
    if (
        not scene.load.is_resistor
        or source != "external"
        or tolerance is not None
        or contacts_shorten_steps(scene, step)
    ):
        return 1
    share = max(1, scene.run.realizations // netlists)
    return share if share <= min(MOST_COPIES.values()) else min(share, most())


def contacts_shorten_steps(scene: Scene, step: str | float) -> bool:
    """Whether the longest step does not resolve a contact at the rms speed."""
    system, _ = scale(scene)
    longest = knot_spacing(scene) / steps_per_knot(scene, step)
    return timescales.contact_time(system) < steps_per_contact(scene, step) * longest
