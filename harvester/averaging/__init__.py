"""Stochastic averaging of the energy: stationary means and densities without simulation."""

from harvester.averaging.closures import CLOSURES, Averages, average

__all__ = ["CLOSURES", "Averages", "average"]
