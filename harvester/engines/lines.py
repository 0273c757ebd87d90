"""Lines of the excitation near a device's resonance: the frequency at which steps are to be exact."""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING

from harvester.device import timescales
from harvester.scene.units import scale

if TYPE_CHECKING:
    from harvester.device.system import System
    from harvester.scene.model import Scene


@functools.lru_cache(maxsize=64)
def line_frequency(scene: Scene) -> float:
    """The line to which the device answers most, by its linear response (rad/s); 0 without lines."""
    lines = () if scene.excitation.prescribes_displacement else scene.excitation.lines
    if not lines:
        return 0.0
    system, _ = scale(scene)
    frequency, _ = max(lines, key=lambda line: line[1] * _mobility(system, 2.0 * math.pi * line[0]))
    return 2.0 * math.pi * frequency


def _mobility(system: System, omega: float) -> float:
    """Velocity per acceleration at a frequency, the load between short and open (s)."""
    low, high = resonances(system)
    away = max(low**2 - omega**2, omega**2 - high**2, 0.0)
    return omega / math.hypot(away, omega * timescales.loss_rate(system, omega), 1e-9 * omega**2)


def resonances(system: System) -> tuple[float, float]:
    """Frequencies of small oscillations about the stiffest well, without and with transducer (rad/s)."""
    stiffest = max(timescales.wells(system), key=lambda well: timescales.stiffness(system, well))
    short = math.sqrt(max(timescales.stiffness(system, stiffest), 0.0))
    return short, max(short, timescales.angular_frequency(system))
