"""The source paper's Figs. 4 to 10 as data: what is swept, where, and what is drawn.

Values are those of the captions and of Sect. 4; whatever a curve does not change is the scene's
(D = 0.02, τ1 = 0.4). Figs. 2 and 3 show orbits without noise, see `orbit_maps`.
"""

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from harvester.validation import EFFICIENCY, POWER, VOLTAGE

# Keys of a scene, with the values that they get.
Changes: TypeAlias = tuple[tuple[str, Any], ...]

GAP, RESTITUTION, STIFFNESS = "stoppers.gap", "stoppers.restitution", "stoppers.stiffness"
COUPLING, DECAY_RATE = "piezo.coupling", "load.decay_rate"
INTENSITY, CORRELATION_TIME = "excitation.intensity", "excitation.correlation_time"
KEY_SYMBOLS = {
    GAP: "δr",
    RESTITUTION: "e",
    STIFFNESS: "K",
    COUPLING: "β",
    DECAY_RATE: "λ",
    INTENSITY: "D",
    CORRELATION_TIME: "τ1",
}


@dataclass(frozen=True)
class Curve:
    """Values that one line of a panel stands for, none for the scene's own."""

    changes: Changes

    @property
    def label(self) -> str:
        """ "τ1 = 0.4"."""
        return ", ".join(f"{KEY_SYMBOLS[key]} = {value:g}" for key, value in self.changes)


@dataclass(frozen=True)
class FigurePanel:
    """One of a figure's panels.

    Attributes
    ----------
    swept : str
        The scene's key along the axis; for densities the one in which the curves differ.
    first, last : float
        Ends of the axis; not used for densities.
    quick, full : int
        Monte Carlo points of a curve with and without --quick; without it lines have one more
        between any two.
    """

    swept: str
    first: float
    last: float
    curves: tuple[Curve, ...]
    quick: int = 4
    full: int = 7

    def values(self, quick: bool) -> tuple[list[float], list[float]]:
        """(of the closures, of Monte Carlo): the second are among the first."""
        number = self.quick if quick else self.full
        simulated = np.linspace(self.first, self.last, number)
        lines = simulated if quick else np.linspace(self.first, self.last, 2 * number - 1)
        return [_rounded(v) for v in lines], [_rounded(v) for v in simulated]


@dataclass(frozen=True)
class PaperFigure:
    """One figure.

    Attributes
    ----------
    kind : str
        "density" or "sweep".
    quantities : tuple of str
        One row of panels each; empty for densities.
    """

    title: str
    kind: str
    quantities: tuple[str, ...]
    panels: tuple[FigurePanel, ...]


def _rounded(value):
    """Values rounded in their last bits, so that curves with equal scenes share them."""
    return float(f"{value:.12g}")


def _curves(key, *values):
    return tuple(Curve(((key, value),)) for value in values)


def _density(key, *values):
    return FigurePanel(key, min(values), max(values), _curves(key, *values))


def _efficiency_panels(swept, first, last, points):
    curves = (
        _curves(GAP, 1.1, 1.2, 1.3),
        _curves(RESTITUTION, 0.4, 0.7, 1.0),
        _curves(STIFFNESS, 1.0, 7.0, 13.0),
    )
    return tuple(FigurePanel(swept, first, last, three, *points) for three in curves)


TWO_NOISES = _curves(CORRELATION_TIME, 0.4, 1.0)

STOPPERS = "Density of the displacement: stoppers"
MEANS_OF = "Mean square voltage and mean power"
OF_STOPPERS = (
    _density(GAP, 1.0, 1.2),
    _density(RESTITUTION, 0.5, 0.9),
    _density(STIFFNESS, 5.0, 13.0),
)
OF_NOISE = (_density(INTENSITY, 0.03, 0.1), _density(CORRELATION_TIME, 0.4, 1.0))
OVER_STOPPERS = (
    FigurePanel(GAP, 0.95, 1.25, TWO_NOISES),
    FigurePanel(RESTITUTION, 0.3, 1.0, TWO_NOISES),
    FigurePanel(STIFFNESS, 5.0, 13.0, TWO_NOISES, 5, 5),
)
OVER_LOAD = (
    FigurePanel(DECAY_RATE, 0.03, 0.09, TWO_NOISES),
    FigurePanel(COUPLING, 0.3, 0.95, TWO_NOISES),
)
OVER_INTENSITY = (FigurePanel(INTENSITY, 0.005, 0.125, TWO_NOISES, 5, 9),)
PCE = "Power conversion efficiency"

FIGURES = {
    "fig4": PaperFigure(STOPPERS, "density", (), OF_STOPPERS),
    "fig5": PaperFigure("Density of the displacement: noise", "density", (), OF_NOISE),
    "fig6": PaperFigure(f"{MEANS_OF}: stoppers", "sweep", (VOLTAGE, POWER), OVER_STOPPERS),
    "fig7": PaperFigure(f"{MEANS_OF}: noise intensity", "sweep", (VOLTAGE, POWER), OVER_INTENSITY),
    "fig8": PaperFigure(f"{MEANS_OF}: load and coupling", "sweep", (VOLTAGE, POWER), OVER_LOAD),
    "fig9": PaperFigure(
        f"{PCE}: noise intensity",
        "sweep",
        (EFFICIENCY,),
        _efficiency_panels(INTENSITY, 0.005, 0.125, (5, 9)),
    ),
    "fig10": PaperFigure(
        f"{PCE}: correlation time",
        "sweep",
        (EFFICIENCY,),
        _efficiency_panels(CORRELATION_TIME, 0.1, 1.1, (4, 6)),
    ),
}
