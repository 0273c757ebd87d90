"""Requests for the paper's scenes.

`reproduce` and `claims` cut the same realizations, so that either finds those of the other.
"""

from collections.abc import Iterable
from typing import Any

from harvester.prepared.steps import resolving
from harvester.running import Request
from harvester.scene.model import Scene
from harvester.simulation.methods import ENGINES

# Averaging time of one realization, in seconds.
DURATIONS = {"monte-carlo": 5_000.0, "circuit": 1_200.0}
# Largest numerical error of a closure. A smaller one would not be visible in a figure.
CLOSURE_ERRORS = {"paper": 5e-3, "consistent": 5e-3, "fokker_planck": 2e-2}
# Rough cost of a request, in units of a closure's point.
COSTS = {"circuit": 20.0, "monte-carlo": 2.0, "fokker_planck": 5.0}


def request(
    scene: Scene,
    method: str,
    realizations: dict[str, int],
    density: bool = False,
    **options: Any,
) -> Request:
    """One scene by one method.

    Parameters
    ----------
    realizations : dict of str to int
        Number for each engine, at first.
    **options
        Of `harvester.running.Request`, for simulations alone.
    """
    if method not in ENGINES:
        return Request(scene, method, tolerance=CLOSURE_ERRORS[method], density=density)
    run = resolving(scene).replace({"run.duration": DURATIONS[method]})
    return Request(run, method, realizations=realizations[method], density=density, **options)


def costly_first(requests: Iterable[Request]) -> list[Request]:
    """The requests with the long ones in front: no process is left alone with one at the end."""
    return sorted(requests, key=_cost, reverse=True)


def _cost(one):
    return COSTS.get(one.method.name, 1.0) + 2.0 * (one.density and one.is_averaged)
