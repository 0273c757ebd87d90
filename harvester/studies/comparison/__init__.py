"""One scene by circuit, Monte Carlo and averaging, side by side."""

from harvester.studies.comparison.comparison import COMPARED, Comparison

__all__ = ["COMPARED", "Comparison"]
