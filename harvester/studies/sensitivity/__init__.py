"""Which tolerance of a device matters, how its quantity scatters, and the yield."""

from harvester.studies.sensitivity.study import Sensitivity

__all__ = ["Sensitivity"]
