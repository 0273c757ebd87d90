"""Names of the release before, which still work and say what to write instead."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from harvester.calling import SceneOrName
from harvester.studies.loads.study import Study
from harvester.studies.optimum import Optimum, optimum

if TYPE_CHECKING:
    from xarray import Dataset


def _warn(old, new):
    warnings.warn(f"{old} goes with the next release: {new}", DeprecationWarning, stacklevel=3)


def Report(study: Study) -> Study:
    """The study itself: `load_study` returns optima, ranking and table."""
    _warn("Report", "load_study returns all that it had")
    return study


def to_dataset(study: Study) -> Dataset:
    """A load study as an xarray Dataset."""
    _warn("to_dataset", "use study.to_xarray()")
    return study.to_xarray()


def optimum_of_several(
    scene: SceneOrName, over: Mapping[str, tuple | None], **options: Any
) -> Optimum:
    """See `harvester.optimum`, which takes any number of parameters."""
    _warn("optimum_of_several", "optimum takes several parameters too")
    return optimum(scene, over, **options)
