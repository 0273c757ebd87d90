"""Load studies: many loads and values on common noise, with error bars, that survive a kill."""

from harvester.studies.dataset import to_dataset
from harvester.studies.files import save
from harvester.studies.outcome import Report
from harvester.studies.study import load_study

__all__ = ["Report", "load_study", "save", "to_dataset"]
