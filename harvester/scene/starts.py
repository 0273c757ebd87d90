"""Initial states of realizations of a driven device, drawn over its energy range."""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from harvester.device import timescales
from harvester.device.system import elastic_force, potential

if TYPE_CHECKING:
    from harvester.scene.prepared import Prepared

# The range extends to this multiple of the amplitude at which the undamped device follows the drive
# on its highest branch: motion from a larger start decays to that branch.
BEYOND_HIGHEST_BRANCH = 1.3
# Amplitudes at which that branch is searched, in units of the outermost well's displacement (or 1).
AMPLITUDES = np.geomspace(1e-3, 1e3, 601)
# Under noise or a record starts are drawn up to this energy, in units of the mean-square velocity.
# The motion exceeds it for under 1 % of the time.
RESOLVED_ENERGY = 5.0
# Maximum number of trials for one start. Fewer than nine in ten points drawn in a box around the
# energy range are rejected.
MOST_TRIALS = 1000


class EnergyRange(NamedTuple):
    """The part of the (X, X') plane in which starts are drawn, ½X'² + U(X) ≤ `highest`; scaled.

    Attributes
    ----------
    highest
        Energy per mass.
    low, high
        Displacements between which U(X) is below `highest`.
    speed
        Largest |X'| in the range.
    """

    highest: float
    low: float
    high: float
    speed: float


@functools.lru_cache(maxsize=64)
def energy_range(prepared_scene: Prepared) -> EnergyRange:
    """The range of energies from which starts are drawn."""
    system = prepared_scene.system
    wells, saddles = timescales.wells(system), timescales.saddles(system)
    bottoms = [float(potential(system, well)) for well in wells]
    highest = min(bottoms)
    for saddle in saddles:
        top = float(potential(system, saddle))
        # The range extends as far above the saddle as the deepest well lies below it.
        highest = max(highest, 2.0 * top - min(bottoms))
    middle = 0.5 * (min(wells) + max(wells))
    size = max(max(wells) - middle, abs(middle)) or 1.0
    lines = prepared_scene.scene.excitation.lines
    if lines:
        reach = BEYOND_HIGHEST_BRANCH * _highest_branch(prepared_scene, lines, size)
        ends = [float(potential(system, middle + side * reach)) for side in (-1.0, 1.0)]
        highest = max(highest, *ends)
    else:
        square = timescales.driven_square_velocity(system, timescales.angular_frequency(system))
        if math.isfinite(square):
            highest = max(highest, max(bottoms) + RESOLVED_ENERGY * square)
    low = _where(system, min(wells), -1.0, highest)
    high = _where(system, max(wells), 1.0, highest)
    return EnergyRange(highest, low, high, math.sqrt(2.0 * (highest - min(bottoms))))


def _highest_branch(prepared_scene, lines, size):
    """Largest amplitude at which the drive's lines can sustain undamped motion about zero, scaled.

    The describing function of a cubic force is three quarters of the force at the amplitude. No
    steady motion exceeds the drive divided by damping times frequency.
    """
    system = prepared_scene.system
    highest = 0.0
    for frequency, amplitude in lines:
        omega, drive = 2.0 * math.pi * frequency, amplitude / prepared_scene.excitation_unit
        amplitudes = size * AMPLITUDES
        inertia = (4.0 / 3.0) * (omega**2 * amplitudes + drive)
        force = np.minimum(
            elastic_force(system, amplitudes), -np.asarray(elastic_force(system, -amplitudes))
        )
        below = np.flatnonzero(force < inertia)
        largest = float(amplitudes[below[-1]]) if below.size else 0.0
        damping = system.damper.damping
        if damping > 0.0:
            largest = min(largest, drive / (damping * omega))
        highest = max(highest, largest)
    return highest


def _where(system, well, side, highest):
    """The displacement beyond an outermost well at which U is `highest`."""
    from scipy.optimize import brentq

    away = 1e-3 * (abs(well) or 1.0)
    while float(potential(system, well + side * away)) < highest and away < 1e12:
        away *= 2.0

    def excess(x):
        return float(potential(system, x)) - highest

    if excess(well) >= 0.0:
        return well
    return float(brentq(excess, well, well + side * away))


def drawn_start(prepared_scene: Prepared, index: int) -> tuple[float, float, float]:
    """Start number `index`, (X, X', 0), uniform over the area of the energy range; scaled.

    It depends only on the scene's seed and `index`.
    """
    span = energy_range(prepared_scene)
    generator = np.random.default_rng(
        np.random.SeedSequence(prepared_scene.scene.run.seed, spawn_key=(index, 0))
    )
    x, v = 0.0, 0.0
    for _ in range(MOST_TRIALS):
        x = float(generator.uniform(span.low, span.high))
        v = float(generator.uniform(-span.speed, span.speed))
        if 0.5 * v * v + float(potential(prepared_scene.system, x)) <= span.highest:
            break
    return x, v, 0.0
