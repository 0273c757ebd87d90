"""Studies: many runs of one scene on common noise, with error bars, that survive a kill."""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harvester.studies.loads.study import save as save
    from harvester.studies.public import load_study as load_study

# Imported at their first use, so that reading a study's signature needs no numba.
_WHERE = {"load_study": "harvester.studies.public", "save": "harvester.studies.loads.study"}
__all__ = [*_WHERE]


def __getattr__(name: str) -> object:
    if name in _WHERE:
        return getattr(importlib.import_module(_WHERE[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
