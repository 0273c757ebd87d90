"""Stationary means and densities without simulation: the Fokker–Planck equation, or averaging."""

from harvester.averaging.averages import Averages
from harvester.averaging.closures import CLOSURES, DEFAULT_CLOSURE, TOLERANCES, average

__all__ = ["CLOSURES", "DEFAULT_CLOSURE", "TOLERANCES", "Averages", "average"]
