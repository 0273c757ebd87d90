"""End a run if its mass leaves the range in which the spring is known."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from harvester.base.errors import SolutionDiverged, SpringRangeLeft

if TYPE_CHECKING:
    from collections.abc import Sequence

    from harvester.device.record import Observer, Record
    from harvester.scene.prepared import Prepared


class RangeWatch:
    """Check every accepted point of one realization.

    `low` and `high` are the ends of the range, scaled; `length` is the length unit in the scene's
    units, and `unit` its name in the message.
    """

    def __init__(self, low: float, high: float, length: float, unit: str) -> None:
        self._low, self._high = low, high
        self._length, self._unit = length, unit

    def add(self, record: Record) -> None:
        """Check the points of one chunk; raise SpringRangeLeft if the mass is outside the range."""
        outside = (record.displacement < self._low) | (record.displacement > self._high)
        if outside.any():
            first = int(np.argmax(outside))
            low, high = self._length * self._low, self._length * self._high
            x = self._length * float(record.displacement[first])
            raise SpringRangeLeft(
                f"the mass left oscillator.restoring_force_range = [{low:.6g}, {high:.6g}] at "
                f"t = {record.time[first]:.6g} s, x = {x:.6g}{self._unit}: the spring is unknown "
                "there; extend the range with a force that is valid there, or reduce the excitation"
            )


def leaves_range(prepared_scene: Prepared, error: Exception) -> bool:
    """Whether a run ended because its mass left the range, beyond which a spring may diverge."""
    if isinstance(error, SolutionDiverged):
        return math.isfinite(np.ptp(prepared_scene.system.spring.range))
    return isinstance(error, SpringRangeLeft)


def with_range_watch(
    prepared_scene: Prepared, observers: Sequence[Sequence[Observer]]
) -> list[list[Observer]]:
    """Observers of each realization; if the spring has a range, including a `RangeWatch`."""
    low, high = prepared_scene.system.spring.range
    if math.isinf(high - low):
        return [list(watching) for watching in observers]
    unit = " m" if prepared_scene.scene.units == "SI" else ""
    length = prepared_scene.scales.displacement
    return [[RangeWatch(low, high, length, unit), *watching] for watching in observers]
