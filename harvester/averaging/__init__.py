"""Stationary means and densities without simulation: the Fokker–Planck equation, or averaging."""

from harvester.averaging.averages import Averages
from harvester.averaging.closures import CLOSURES, TOLERANCES, average

__all__ = ["CLOSURES", "TOLERANCES", "Averages", "average"]
