"""Sines in the excitation near a device's resonance: where steps are to be exact."""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING

from harvester.device import timescales
from harvester.scene.units import scale

if TYPE_CHECKING:
    from harvester.device.system import System
    from harvester.scene.model import Scene


# By how much of half a resonance's width an integrator may misplace it. At twice this, a device on
# its flank gives 1 % more or less.
SHARE_OF_HALF_WIDTH = 0.005
# A line whose response is this share of the greatest counts.
COUNTING_RESPONSE = 0.1
# Of the frequency's square, what a spring that is not linear or a stopper lets it change: ten times
# what 14 devices between Q = 12 and 340 showed against steps 32 times shorter.
NONLINEAR_SPREAD = 0.05


@functools.lru_cache(maxsize=64)
def line_frequency(scene: Scene) -> float:
    """The line to which the linear device answers most (rad/s); 0 without lines."""
    answers = _responses(scene)
    return max(answers)[1] if answers else 0.0


@functools.lru_cache(maxsize=64)
def spread(scene: Scene) -> float:
    """Change of the frequency's square, over itself, among the motions that lines drive.

    An integrator that is exact at `line_frequency` leaves this share of its error.
    """
    answers = _responses(scene)
    if not answers:
        return 0.0
    system, _ = scale(scene)
    greatest, tuned = max(answers)
    counting = [omega for size, omega in answers if size > COUNTING_RESPONSE * greatest]
    away = max(abs(omega**2 / tuned**2 - 1.0) for omega in counting)
    nonlinear = len(system.spring.coefficients) > 2 or bool(system.contacts)
    return max(away, NONLINEAR_SPREAD if nonlinear else 0.0)


def half_width(scene: Scene) -> float:
    """That of the resonance over its frequency, by damper and, if it is one, resistor."""
    system, _ = scale(scene)
    omega = line_frequency(scene)
    return 0.5 * timescales.loss_rate(system, omega) / omega


def _responses(scene):
    """(size, angular frequency) of the velocity at each line."""
    if scene.excitation.prescribes_displacement:
        return []
    system, _ = scale(scene)
    pairs = [(amplitude, 2.0 * math.pi * f) for f, amplitude in scene.excitation.lines]
    return [(amplitude * _mobility(system, omega), omega) for amplitude, omega in pairs]


def _mobility(system: System, omega: float) -> float:
    """Velocity per acceleration at a frequency, the load between short and open (s)."""
    low, high = _resonances(system)
    away = max(low**2 - omega**2, omega**2 - high**2, 0.0)
    return omega / math.hypot(away, omega * timescales.loss_rate(system, omega), 1e-9 * omega**2)


def _resonances(system: System) -> tuple[float, float]:
    """Of small oscillations about the stiffest well, without and with the transducer (rad/s)."""
    stiffest = max(timescales.wells(system), key=lambda well: timescales.stiffness(system, well))
    short = math.sqrt(max(timescales.stiffness(system, stiffest), 0.0))
    return short, max(short, timescales.angular_frequency(system))
