"""`accuracy`: both pictures of one measurement, error over run time and time to an error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Unpack

from harvester.base.serialising import fields_of
from harvester.engines.opening import RunnerOptions, open_runner
from harvester.engines.simulate import require_noise
from harvester.scene.calling import takes_scene
from harvester.scene.model import Scene
from harvester.validation.accuracy_measurement import by_own_length
from harvester.validation.accuracy_methods import ComparedMethod
from harvester.validation.time_to_accuracy import TimeToAccuracy
from harvester.validation.work_precision import WorkPrecision


@dataclass(frozen=True)
class Accuracy:
    """Two pictures of one measurement of every method."""

    work_precision: WorkPrecision
    time_to_accuracy: TimeToAccuracy

    def to_dict(self) -> dict[str, Any]:
        return fields_of(self)


@takes_scene
def accuracy(
    scene: Scene,
    *,
    thorough: bool = False,
    methods: Sequence[ComparedMethod] | None = None,
    **running: Unpack[RunnerOptions],
) -> Accuracy:
    """Measure the error of every method on a scene, and how it falls with time.

    Parameters
    ----------
    scene, thorough, methods, **running
        See `harvester.work_precision`, which shows one of the two pictures.
    """
    require_noise(scene, "accuracy")
    with open_runner(**running) as runner:
        measured = by_own_length(scene, runner, thorough=thorough, methods=methods)
    return Accuracy(WorkPrecision.of(measured), TimeToAccuracy.of(measured))
