"""Names of the previous release, defined by the new ones; using one gives a warning."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from harvester.calling import SceneOrName
from harvester.studies.public import optimum

if TYPE_CHECKING:
    from xarray import Dataset

    from harvester.studies.loads.study import Study
    from harvester.studies.optimum import Optimum


def Report(study: Study) -> Study:
    """The study itself: `load_study` returns optima, ranking and table."""
    return study


def to_dataset(study: Study) -> Dataset:
    """A load study as an xarray Dataset."""
    return study.to_xarray()


def optimum_of_several(
    scene: SceneOrName, over: Mapping[str, tuple | None], **options: Any
) -> Optimum:
    """See `harvester.optimum`, which takes any number of parameters."""
    return optimum(scene, over, **options)
