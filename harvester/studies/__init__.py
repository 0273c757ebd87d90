"""Load studies: many loads and values on common noise, with error bars, that survive a kill."""

from harvester.studies.study import load_study

__all__ = ["load_study"]
