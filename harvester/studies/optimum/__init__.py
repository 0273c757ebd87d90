"""`optimum`: where one parameter, or several, make a mean largest."""

from harvester.studies.optimum.one import Optimum, optimum

__all__ = ["Optimum", "optimum"]
