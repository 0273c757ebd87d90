"""States in which realizations of a driven device begin: drawn over its energy range, or a grid."""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from harvester.device import timescales
from harvester.device.system import elastic_force, potential

if TYPE_CHECKING:
    from harvester.scene.prepared import Prepared

# Starts are drawn up to this multiple of the amplitude at which the undamped device follows the
# drive on its highest branch: a start beyond it falls back to that branch.
BEYOND_HIGHEST_BRANCH = 1.3
# Amplitudes at which that branch is searched, in units of the outermost well's displacement (or 1).
AMPLITUDES = np.geomspace(1e-3, 1e3, 601)
# Under noise or a record starts are drawn up to this energy, in units of the mean-square velocity.
# The motion exceeds it for under 1 % of the time.
RESOLVED_ENERGY = 5.0
# Most trials for one start. Of points drawn in a box about the energy range fewer than nine in ten
# are rejected.
MOST_TRIALS = 1000


class EnergyRange(NamedTuple):
    """The part of the (X, X') plane in which starts are drawn, ½X'² + U(X) ≤ `highest`; scaled.

    Attributes
    ----------
    highest
        Energy per mass.
    low, high
        Displacements between which U(X) is below it.
    speed
        Greatest |X'| in it.
    """

    highest: float
    low: float
    high: float
    speed: float


@functools.lru_cache(maxsize=64)
def energy_range(ready: Prepared) -> EnergyRange:
    """The range of energies from which starts are drawn."""
    system = ready.system
    wells, saddles = timescales.wells(system), timescales.saddles(system)
    bottoms = [float(potential(system, well)) for well in wells]
    highest = min(bottoms)
    for saddle in saddles:
        top = float(potential(system, saddle))
        # The range reaches as far above the saddle as the deepest well lies below it.
        highest = max(highest, 2.0 * top - min(bottoms))
    middle = 0.5 * (min(wells) + max(wells))
    size = max(max(wells) - middle, abs(middle)) or 1.0
    lines = ready.scene.excitation.lines
    if lines:
        reach = BEYOND_HIGHEST_BRANCH * _highest_branch(ready, lines, size)
        ends = [float(potential(system, middle + side * reach)) for side in (-1.0, 1.0)]
        highest = max(highest, *ends)
    else:
        square = timescales.driven_square_velocity(system, timescales.angular_frequency(system))
        if math.isfinite(square):
            highest = max(highest, max(bottoms) + RESOLVED_ENERGY * square)
    low = _where(system, min(wells), -1.0, highest)
    high = _where(system, max(wells), 1.0, highest)
    return EnergyRange(highest, low, high, math.sqrt(2.0 * (highest - min(bottoms))))


def _highest_branch(ready, lines, size):
    """Amplitude of the undamped motion about zero that the drive's lines keep up, scaled.

    The describing function of a cubic force is three quarters of the force at the amplitude; no
    steady motion is larger than the drive over damping times frequency.
    """
    system = ready.system
    highest = 0.0
    for frequency, amplitude in lines:
        omega, drive = 2.0 * math.pi * frequency, amplitude / ready.excitation_unit
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
    """The displacement beyond an outermost well at which U is the energy."""
    from scipy.optimize import brentq

    away = 1e-3 * (abs(well) or 1.0)
    while float(potential(system, well + side * away)) < highest and away < 1e12:
        away *= 2.0

    def excess(x):
        return float(potential(system, x)) - highest

    if excess(well) >= 0.0:
        return well
    return float(brentq(excess, well, well + side * away))


def drawn_start(ready: Prepared, index: int) -> tuple[float, float, float]:
    """(X, X', 0): start number `index`, evenly over the area of the energy range; scaled.

    It follows from the scene's seed and the number alone.
    """
    span = energy_range(ready)
    generator = np.random.default_rng(
        np.random.SeedSequence(ready.scene.run.seed, spawn_key=(index, 0))
    )
    x, v = 0.0, 0.0
    for _ in range(MOST_TRIALS):
        x = float(generator.uniform(span.low, span.high))
        v = float(generator.uniform(-span.speed, span.speed))
        if 0.5 * v * v + float(potential(ready.system, x)) <= span.highest:
            break
    return x, v, 0.0
