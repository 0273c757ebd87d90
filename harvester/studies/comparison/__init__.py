"""`validate`: one scene by circuit, Monte Carlo and averaging, side by side."""

from harvester.studies.comparison.comparison import COMPARED, Comparison, validate

__all__ = ["COMPARED", "Comparison", "validate"]
