"""Colours and markers: one of its own for every method, the same in every figure."""

from collections.abc import Iterable
from itertools import cycle

CIRCUIT, MONTE_CARLO = "#0072B2", "#D55E00"
# Colour and line style of each closure.
LINES = {
    "paper": ("0.55", "--"),
    "consistent": ("#009E73", "-"),
    "fokker_planck": ("#A50026", ":"),
    "spectral": ("#332288", "-."),
}
CLOSURE_MARKERS = dict(zip(LINES, "*Xhp", strict=False))
# Colour and marker of each family of methods in `harvester.validation.accuracy_methods`.
_FAMILIES = {
    "PWL in the netlist, trapezoidal": ("#E69F00", "v"),
    "PWL in the netlist, gear": ("#CC79A7", "d"),
    "external source, trapezoidal": (CIRCUIT, "o"),
    "external source, gear": ("#8C564B", "D"),
    "side by side, trapezoidal": ("#56B4E9", "s"),
    "external source, local error": ("#117733", "P"),
    "Monte Carlo, Runge–Kutta": (MONTE_CARLO, "^"),
    "Monte Carlo, Heun": ("0.2", "<"),
    "compiled device, trapezoidal": ("#999933", ">"),
}
_SPARE = tuple(zip(("#44AA99", "#DDCC77", "#AA4499", "#88CCEE"), "8H12", strict=True))


def styles(families: Iterable[str]) -> dict[str, tuple[str, str]]:
    """(colour, marker) of each of these families; those not met before take spare ones in turn."""
    names = dict.fromkeys(families)
    spare = cycle(_SPARE)
    return {name: _FAMILIES.get(name) or next(spare) for name in names}
