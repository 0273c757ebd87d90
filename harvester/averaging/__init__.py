"""Stationary means and densities of a scene or device without simulation, by a closure."""

from harvester.averaging.closures import CLOSURES, DEFAULT_CLOSURE, average
from harvester.stationary.averages import Averages

__all__ = ["CLOSURES", "DEFAULT_CLOSURE", "Averages", "average"]
