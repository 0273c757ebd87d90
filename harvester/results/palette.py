"""Colours and markers of the methods, the same in every figure."""

from collections.abc import Iterable
from itertools import cycle

CIRCUIT, MONTE_CARLO = "#0072B2", "#D55E00"
# Colour and line style of each stationary method.
LINES = {
    "paper": ("0.55", "--"),
    "consistent": ("#009E73", "-"),
    "fokker_planck": ("#A50026", ":"),
    "spectral": ("#332288", "-."),
}
CLOSURE_MARKERS = dict(zip(LINES, "*Xhp", strict=False))
# Those of a closure of another package.
OTHER_LINE, OTHER_MARKER = ("0.3", "-."), "D"
# Colour and marker of each group of methods in `harvester.validation.accuracy_methods`.
_GROUPS = {
    "PWL in the netlist": ("#E69F00", "v"),
    "external source": (CIRCUIT, "o"),
    "side by side": ("#56B4E9", "s"),
    "external source, local error": ("#117733", "P"),
    "Monte Carlo, Runge–Kutta": (MONTE_CARLO, "^"),
    "Monte Carlo, Heun": ("0.2", "<"),
    "compiled device": ("#999933", ">"),
}
_SPARE = tuple(zip(("#44AA99", "#DDCC77", "#AA4499", "#88CCEE"), "8H12", strict=True))


def styles(groups: Iterable[str]) -> dict[str, tuple[str, str]]:
    """(colour, marker) of each group; unknown groups get the next unused ones."""
    spare = cycle(_SPARE)
    return {name: _GROUPS.get(name) or next(spare) for name in dict.fromkeys(groups)}
