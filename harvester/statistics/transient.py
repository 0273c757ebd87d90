"""Decay times of the initial state of a device and its load."""

from __future__ import annotations

import math

from harvester.device import timescales
from harvester.scene.prepared import Prepared


def transient_time(prepared_scene: Prepared, share: float, longest: float = math.inf) -> float:
    """Time after which a transient has decayed to `share` of its initial size, scaled.

    The slowest of the device's motion, its terminal's discharge and the load's modes counts; the
    modes' time is limited to `longest`.
    """
    decay = prepared_scene.system.transducer.decay_rate()
    slowest = 2.0 * timescales.relaxation_time(prepared_scene.system)
    slowest = max(slowest, 1.0 / decay) if decay > 0.0 else slowest
    if prepared_scene.scene.load.circuit:
        from circuits.kernel.slow_modes import slowest_time

        slowest = max(slowest, min(slowest_time(prepared_scene), longest / math.log(1.0 / share)))
    return slowest * math.log(1.0 / share)


def memory_of(prepared_scene: Prepared) -> float:
    """The slowest relaxation time, in periods of the excitation."""
    return transient_time(prepared_scene, math.exp(-1.0)) / float(
        prepared_scene.scene.excitation.period or 1.0
    )
