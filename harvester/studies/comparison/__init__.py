"""One scene by circuit, Monte Carlo and averaging, side by side."""

from harvester.former_names import handed_on
from harvester.studies.comparison.comparison import COMPARED, Comparison

__all__ = ["COMPARED", "Comparison"]


def __getattr__(name: str) -> object:
    return handed_on(__name__, "harvester.studies.public", name)
