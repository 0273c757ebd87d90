"""Where one parameter, or several, make a mean largest."""

from harvester.studies.optimum.result import Optimum

__all__ = ["Optimum"]
