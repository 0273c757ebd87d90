"""Which tolerance of a device matters, how its quantity scatters, and the yield."""

from harvester.former_names import handed_on
from harvester.studies.sensitivity.study import Sensitivity

__all__ = ["Sensitivity"]


def __getattr__(name: str) -> object:
    return handed_on(__name__, "harvester.studies.public", name)
