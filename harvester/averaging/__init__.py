"""Stochastic averaging of the energy: stationary means and densities without simulation."""

from harvester.averaging.averages import Averages
from harvester.averaging.closures import CLOSURES, TOLERANCE, average

__all__ = ["CLOSURES", "TOLERANCE", "Averages", "average"]
