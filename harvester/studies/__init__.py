"""Load studies: many loads and values on common noise, with error bars, that survive a kill."""

from harvester.studies.loads.dataset import to_dataset
from harvester.studies.loads.files import save
from harvester.studies.loads.outcome import Report
from harvester.studies.loads.study import load_study

__all__ = ["Report", "load_study", "save", "to_dataset"]
