"""Where one parameter, or several, make a mean largest."""

from harvester.former_names import handed_on
from harvester.studies.optimum.result import Optimum

__all__ = ["Optimum"]


def __getattr__(name: str) -> object:
    return handed_on(__name__, "harvester.studies.public", name)
