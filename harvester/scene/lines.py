"""Sines in the excitation near a device's resonance: where steps are to be exact."""

from __future__ import annotations

import functools
import itertools
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.device import timescales
from harvester.excitation.sine import SteppedSine

if TYPE_CHECKING:
    from harvester.device.system import System
    from harvester.scene.prepared import Prepared


# An integrator may misplace a resonance by this share of its half width. On the flank the power
# then changes by half a percent.
SHARE_OF_HALF_WIDTH = 0.005
# Lines count if their response exceeds this share of the largest response.
COUNTING_RESPONSE = 0.1
# A nonlinear spring or a stopper is assumed to change the square of the frequency by this share.
# Fourteen devices with Q from 12 to 340 showed a tenth of it against steps 32 times shorter.
NONLINEAR_SPREAD = 0.05
# Number of lines, by largest response, whose overtones and combination tones count.
MOST_COMBINED = 4

# If the half width of a resonance is below this share of its frequency, noise is treated like a
# line: at Q = 370 and 410 default steps cost one path 1 % in 100 periods.
NARROW = 0.01


@functools.lru_cache(maxsize=64)
def line_frequency(ready: Prepared) -> float:
    """The frequency at which steps are to be exact (rad/s); 0 where there is no such.

    Frequency of the line to which the linear device responds most. Without lines, of a linear
    device with so narrow a resonance that its response to noise is nearly a line.
    """
    answers = _responses(ready)
    if answers:
        return max(answers)[1]
    system = ready.system
    if ready.scene.excitation.prescribes_displacement or not _linear(system):
        return 0.0
    omega = timescales.angular_frequency(system)
    return omega if _half_width(system, omega) < NARROW else 0.0


def exact_frequencies(ready: Prepared) -> list[tuple[float, float]]:
    """Times (s) from which steps are to be exact at an angular frequency (rad/s; 0: none)."""
    excitation = ready.scene.excitation
    if isinstance(excitation, SteppedSine):
        return [
            (number * excitation.dwell, 2.0 * math.pi * frequency)
            for number, frequency in enumerate(excitation.frequencies)
        ]
    return [(0.0, line_frequency(ready))]


@functools.lru_cache(maxsize=64)
def spread(ready: Prepared) -> float:
    """Largest relative difference of ω² between the lines' motions and `line_frequency`.

    An integrator that is exact at `line_frequency` leaves this share of its error. A nonlinear
    device or load also moves at overtones, which count if they meet the resonance.
    """
    answers = _responses(ready)
    if not answers:
        return 0.0
    system = ready.system
    greatest, tuned = max(answers)
    # The largest first.
    ordered = sorted(answers, reverse=True)
    counting = [omega for size, omega in ordered if size > COUNTING_RESPONSE * greatest]
    away = max(abs(omega**2 / tuned**2 - 1.0) for omega in counting)
    linear = _linear(system)
    if not (linear and ready.scene.load.is_resistor):
        away = max(away, _met_by_overtones(system, counting, tuned))
    return max(away, 0.0 if linear else NONLINEAR_SPREAD)


def _met_by_overtones(system, counting, tuned):
    """The resonance's part in `spread`, by how near overtones and combination tones come to it."""
    resonance = timescales.angular_frequency(system)
    width = _half_width(system, resonance) * resonance
    sides = [side * omega for omega in counting[:MOST_COMBINED] for side in (1.0, -1.0)]
    nearest = min(
        abs(abs(sum(tones)) - resonance)
        for count in (2, 3)
        for tones in itertools.combinations_with_replacement(sides, count)
    )
    met = width**2 / (width**2 + nearest**2 or 1.0)
    return met * abs(resonance**2 / tuned**2 - 1.0)


def half_width(ready: Prepared) -> float:
    """Half width of the resonance over its frequency, from the damper and a resistor as load."""
    return _half_width(ready.system, line_frequency(ready))


def _half_width(system, omega):
    """Half width of the resonance at a frequency (rad/s), over that frequency."""
    return 0.5 * timescales.loss_rate(system, omega) / omega


def _linear(system):
    """Whether the spring has no power above the first and there are no stoppers."""
    return system.spring.straight and not system.contacts


def _responses(ready):
    """(size, angular frequency) of the velocity at each line that is not silent."""
    scene, system = ready.scene, ready.system
    if scene.excitation.prescribes_displacement:
        return []
    pairs = [(amplitude, 2.0 * math.pi * f) for f, amplitude in scene.excitation.lines if amplitude]
    return [(a * omega * float(abs(receptance(system, omega))), omega) for a, omega in pairs]


def receptance(system: System, omega: Any) -> Any:
    """Displacement per acceleration at frequencies (rad/s), the load between short and open (s²).

    Complex; real without damping. Between both resonances it is the value at a resonance.
    """
    # Frequencies of small oscillations about the stiffest well, without and with the transducer.
    stiffest = max(timescales.wells(system), key=lambda well: timescales.stiffness(system, well))
    low = math.sqrt(max(timescales.stiffness(system, stiffest), 0.0))
    high = max(low, timescales.angular_frequency(system))
    away = np.maximum(low**2 - omega**2, 0.0) - np.maximum(omega**2 - high**2, 0.0)
    damped = np.hypot(omega * timescales.loss_rate(system, omega), 1e-9 * omega**2)
    return 1.0 / (away + 1j * damped)
