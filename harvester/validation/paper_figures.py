"""The source paper's Figs. 4 to 10, from paper.toml, and requests for their scenes.

`reproduce` and `claims` use the same realizations, so that each can reuse the other's.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeGuard

import numpy as np

from harvester.base.errors import HarvesterError
from harvester.engines.methods import ENGINES
from harvester.engines.request import Answer, Request
from harvester.scene.model import Scene
from harvester.scene.steps import resolving
from harvester.validation import entries

# Keys of a scene and their new values.
Changes: TypeAlias = tuple[tuple[str, Any], ...]

SYMBOL_KEYS = {
    "δr": "stoppers.gap",
    "e": "stoppers.restitution",
    "K": "stoppers.stiffness",
    "β": "piezo.coupling",
    "λ": "load.decay_rate",
    "D": "excitation.intensity",
    "τ1": "excitation.correlation_time",
}
KEY_SYMBOLS = {key: symbol for symbol, key in SYMBOL_KEYS.items()}
# Averaging time of one realization, in seconds.
DURATIONS = {"monte-carlo": 5_000.0, "circuit": 1_200.0}
# Largest numerical error of a stationary method; smaller errors are not visible in a figure.
CLOSURE_ERRORS = {"paper": 5e-3, "consistent": 5e-3, "fokker_planck": 2e-2}
# Rough cost of a request, in units of a stationary method's point.
COSTS = {"circuit": 20.0, "monte-carlo": 2.0, "fokker_planck": 5.0}
NOT_RUN = "not run: the time budget was spent"
# The outcome of a point: its answer, the reason why there is none, or None if it is not computed
# yet.
Outcome: TypeAlias = Answer | HarvesterError | None


def name_of(changes: Changes) -> str:
    """ "δr = 1.1, D = 0.02"; "defaults" without changes."""
    return ", ".join(f"{KEY_SYMBOLS[key]} = {value:g}" for key, value in changes) or "defaults"


@dataclass(frozen=True)
class FigurePanel:
    """One of a figure's panels.

    Attributes
    ----------
    swept : str
        The scene's key along the axis; for densities the one in which the curves differ.
    curves : tuple of Changes
        Values of the lines.
    first, last : float
        Ends of the axis; not used for densities.
    quick, full : int
        Monte Carlo points of a curve with and without --quick. Without --quick, lines have a
        further point between any two.
    """

    swept: str
    curves: tuple[Changes, ...]
    first: float = 0.0
    last: float = 0.0
    quick: int = 4
    full: int = 7

    def values(self, quick: bool) -> tuple[list[float], list[float]]:
        """Values for stationary methods, and for Monte Carlo; the latter are among the former."""
        number = self.quick if quick else self.full
        simulated = np.linspace(self.first, self.last, number)
        lines = simulated if quick else np.linspace(self.first, self.last, 2 * number - 1)
        # Values are rounded in their last bits, so that curves with equal scenes share points.
        closures, simulations = ([float(f"{v:.12g}") for v in some] for some in (lines, simulated))
        return closures, simulations


@dataclass(frozen=True)
class PaperFigure:
    """One figure with a row of panels for each of `quantities`, which is empty for densities."""

    title: str
    panels: tuple[FigurePanel, ...]
    quantities: tuple[str, ...] = ()


def _figure(title, panels, quantities=()):
    def panel(swept, curves, values, **ends):
        changes = tuple(((SYMBOL_KEYS[curves], value),) for value in values)
        return FigurePanel(SYMBOL_KEYS[swept], changes, **ends)

    return PaperFigure(title, tuple(panel(**table) for table in panels), tuple(quantities))


FIGURES = {
    entry["name"]: _figure(**{name: entry[name] for name in entry if name != "name"})
    for entry in entries("paper")["figure"]
}


def request(
    scene: Scene, method: str, realizations: dict[str, int], density: bool = False, **options: Any
) -> Request:
    """One scene by one method.

    Parameters
    ----------
    realizations : dict of str to int
        Initial number per engine.
    **options
        Options of `harvester.engines.request.Request`, for simulations only.
    """
    if method not in ENGINES:
        return Request(scene, method, tolerance=CLOSURE_ERRORS[method], density=density)
    run = resolving(scene).replace({"run.duration": DURATIONS[method]})
    return Request(run, method, realizations=realizations[method], density=density, **options)


def costly_first(requests: Iterable[Request]) -> list[Request]:
    """Requests with long ones first, so that none runs alone at the end."""

    def cost(one):
        return COSTS.get(one.method.name, 1.0) + 2.0 * (one.density and one.is_averaged)

    return sorted(requests, key=cost, reverse=True)


def answered(outcome: Outcome) -> TypeGuard[Answer]:
    """Whether a point has an answer."""
    return outcome is not None and not isinstance(outcome, HarvesterError)


def told_of(outcome: Outcome) -> dict[str, Any]:
    """A point for JSON: its answer, or the reason why it has none."""
    return outcome.to_dict() if answered(outcome) else {"refused": reason(outcome)}


def reason(outcome: Outcome) -> str:
    """Why a point has no answer."""
    return NOT_RUN if outcome is None else str(outcome)
