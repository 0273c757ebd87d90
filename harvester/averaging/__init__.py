"""Stationary means and densities without simulation, most by stochastic averaging of the energy."""

from harvester.averaging.averages import Averages
from harvester.averaging.closures import AVERAGED, CLOSURES, TOLERANCES, average

__all__ = ["AVERAGED", "CLOSURES", "TOLERANCES", "Averages", "average"]
