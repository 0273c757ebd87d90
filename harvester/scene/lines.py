"""Spectral lines (sines) of the excitation, and the frequency at which integrators are exact."""

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


# An integrator may shift a resonance by this share of its half width. On the flank of the resonance
# curve this changes the power by half a percent.
SHARE_OF_HALF_WIDTH = 0.005
# Lines count if their response exceeds this share of the largest response.
COUNTING_RESPONSE = 0.1
# A nonlinear spring or a stopper is assumed to change the square of the frequency by this share.
# 14 devices with Q from 12 to 340, compared with 32 times shorter steps, needed a tenth of this.
NONLINEAR_SPREAD = 0.05
# Number of lines with the largest responses whose overtones and combination tones count.
MOST_COMBINED = 4

# If the half width of a resonance is below this share of its frequency, noise is treated like a
# line: at Q = 370 and 410, default steps changed a path by 1 % within 100 periods.
NARROW = 0.01


@functools.lru_cache(maxsize=64)
def line_frequency(prepared_scene: Prepared) -> float:
    """Angular frequency at which integrators are made exact (rad/s); 0 if there is none.

    It is the line to which the linearised device responds most. Without lines it is the resonance
    of a linear device if this is so narrow that the response to noise is nearly a line.
    """
    answers = _responses(prepared_scene)
    if answers:
        return max(answers)[1]
    system = prepared_scene.system
    if prepared_scene.scene.excitation.prescribes_displacement or not _linear(system):
        return 0.0
    omega = timescales.angular_frequency(system)
    return omega if _half_width(system, omega) < NARROW else 0.0


def exact_frequencies(prepared_scene: Prepared) -> list[tuple[float, float]]:
    """Pairs (start time in s, angular frequency in rad/s at which steps are exact; 0: none)."""
    excitation = prepared_scene.scene.excitation
    if isinstance(excitation, SteppedSine):
        return [
            (number * excitation.dwell, 2.0 * math.pi * frequency)
            for number, frequency in enumerate(excitation.frequencies)
        ]
    return [(0.0, line_frequency(prepared_scene))]


@functools.lru_cache(maxsize=64)
def spread(prepared_scene: Prepared) -> float:
    """Largest relative difference of ω² between the lines' motions and `line_frequency`.

    This share of an integrator's error remains if it is exact at `line_frequency`. A nonlinear
    device or load also moves at overtones, which count if they are near the resonance.
    """
    answers = _responses(prepared_scene)
    if not answers:
        return 0.0
    system = prepared_scene.system
    greatest, tuned = max(answers)
    ordered = sorted(answers, reverse=True)
    counting = [omega for size, omega in ordered if size > COUNTING_RESPONSE * greatest]
    away = max(abs(omega**2 / tuned**2 - 1.0) for omega in counting)
    linear = _linear(system)
    if not (linear and prepared_scene.scene.load.is_resistor):
        away = max(away, _met_by_overtones(system, counting, tuned))
    return max(away, 0.0 if linear else NONLINEAR_SPREAD)


def _met_by_overtones(system, counting, tuned):
    """Contribution of the resonance to `spread`, weighted by the nearest combination tone."""
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


def half_width(prepared_scene: Prepared) -> float:
    """Relative half width of the resonance, from the damping and a resistive load."""
    return _half_width(prepared_scene.system, line_frequency(prepared_scene))


def _half_width(system, omega):
    """Half width of a resonance at `omega` (rad/s), relative to `omega`."""
    return 0.5 * timescales.loss_rate(system, omega) / omega


def _linear(system):
    """Whether the spring is linear and there are no stoppers."""
    return system.spring.straight and not system.contacts


def _responses(prepared_scene):
    """(amplitude, angular frequency) of the velocity at each line with nonzero amplitude."""
    scene, system = prepared_scene.scene, prepared_scene.system
    if scene.excitation.prescribes_displacement:
        return []
    pairs = [(amplitude, 2.0 * math.pi * f) for f, amplitude in scene.excitation.lines if amplitude]
    return [(a * omega * float(abs(receptance(system, omega))), omega) for a, omega in pairs]


def receptance(system: System, omega: Any) -> Any:
    """Displacement per acceleration (s²) at angular frequencies (rad/s), complex.

    The load may be anything from a short to an open circuit: between the two resonance frequencies
    the result is the value at resonance.
    """
    # Frequencies of small oscillations about the stiffest well, without and with the transducer.
    stiffest = max(timescales.wells(system), key=lambda well: timescales.stiffness(system, well))
    low = math.sqrt(max(timescales.stiffness(system, stiffest), 0.0))
    high = max(low, timescales.angular_frequency(system))
    away = np.maximum(low**2 - omega**2, 0.0) - np.maximum(omega**2 - high**2, 0.0)
    damped = np.hypot(omega * timescales.loss_rate(system, omega), 1e-9 * omega**2)
    return 1.0 / (away + 1j * damped)
