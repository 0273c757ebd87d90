"""Studies: a scene over values, loads and methods, with error bars, that survive a kill."""

from harvester.studies.former import Report, to_dataset
from harvester.studies.loads.study import Study, load_study, save

__all__ = ["Report", "Study", "load_study", "save", "to_dataset"]
