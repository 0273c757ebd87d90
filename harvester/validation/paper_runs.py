"""Requests for the paper's scenes, and their outcomes.

`reproduce` and `claims` cut the same realizations, so that either finds those of the other.
"""

from collections.abc import Iterable
from typing import Any, TypeAlias, TypeGuard

from harvester.base.errors import HarvesterError
from harvester.engines.methods import ENGINES
from harvester.engines.request import Answer, Request
from harvester.scene.model import Scene
from harvester.scene.steps import resolving

# Averaging time of one realization, in seconds.
DURATIONS = {"monte-carlo": 5_000.0, "circuit": 1_200.0}
# Largest numerical error of a closure. A smaller one would not be visible in a figure.
CLOSURE_ERRORS = {"paper": 5e-3, "consistent": 5e-3, "fokker_planck": 2e-2}
# Rough cost of a request, in units of a closure's point.
COSTS = {"circuit": 20.0, "monte-carlo": 2.0, "fokker_planck": 5.0}
NOT_RUN = "not run: the time budget was spent"
# The outcome of a point: its answer, the reason why there is none, or None if it is not computed
# yet.
Outcome: TypeAlias = Answer | HarvesterError | None


def request(
    scene: Scene, method: str, realizations: dict[str, int], density: bool = False, **options: Any
) -> Request:
    """One scene by one method.

    Parameters
    ----------
    realizations : dict of str to int
        Number for each engine, at first.
    **options
        Of `harvester.engines.Request`, for simulations alone.
    """
    if method not in ENGINES:
        return Request(scene, method, tolerance=CLOSURE_ERRORS[method], density=density)
    run = resolving(scene).replace({"run.duration": DURATIONS[method]})
    return Request(run, method, realizations=realizations[method], density=density, **options)


def costly_first(requests: Iterable[Request]) -> list[Request]:
    """The requests with the long ones in front: no process is left alone with one at the end."""

    def cost(one):
        return COSTS.get(one.method.name, 1.0) + 2.0 * (one.density and one.is_averaged)

    return sorted(requests, key=cost, reverse=True)


def answered(outcome: Outcome) -> TypeGuard[Answer]:
    """Whether a point has an answer, and neither a reason nor nothing."""
    return outcome is not None and not isinstance(outcome, HarvesterError)


def reason(outcome: Outcome) -> str:
    """Why a point has no answer."""
    return NOT_RUN if outcome is None else str(outcome)
