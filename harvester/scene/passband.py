"""Error under noise due to an integrator's frequency shift, for the linearised device."""

from __future__ import annotations

import functools
import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from harvester.device import timescales
from harvester.excitation.base import realization_seed
from harvester.scene import lines

if TYPE_CHECKING:
    from harvester.scene.prepared import Prepared

# Numbers of quadrature points: overall, on each side of the resonance, and between two corners.
OVERALL, ASIDE, BETWEEN = 1001, 201, 17
# Relative change of the frequency in a numerical derivative.
SMALL = 1e-6
# If no formula gives the density, Welch's method estimates it from at most this number of samples
# of a path, in segments of this number of periods of the resonance.
MOST_SAMPLES, SEGMENT_PERIODS = 2**18, 256.0


@functools.lru_cache(maxsize=64)
def misplacement(prepared_scene: Prepared, spacing: float, order: int) -> float:
    """Relative change of E[X²] if every frequency ω becomes ω (1 + ω^order), to first order.

    Multiplied by c h^order, it is the error of an integrator that shifts ω by c (ω h)^order. If the
    integrator is exact at a line, only the difference from the shift there counts. Sines are part
    of E[X²], but not of its change; `harvester.scene.lines` treats their error.

    `spacing`: time between two samples of the excitation (s).
    """
    system, excitation = prepared_scene.system, prepared_scene.scene.excitation
    frequencies, density = _spectrum(prepared_scene, spacing)
    omega = 2.0 * math.pi * frequencies
    moved = omega**order - lines.line_frequency(prepared_scene) ** order
    changes = [0.0]
    for share_of_open in _shares_of_open(prepared_scene):
        gain, below, above = (
            _gain(system, omega * factor, share_of_open)
            for factor in (1.0, 1.0 - SMALL, 1.0 + SMALL)
        )
        response = density * np.sinc(frequencies * spacing) ** 4 * gain
        total = np.trapezoid(response, frequencies)
        for frequency, amplitude in excitation.lines:
            at_line = _gain(system, 2.0 * math.pi * frequency, share_of_open)
            total += 0.5 * amplitude**2 * at_line
        slope = np.log(above / below) / (2.0 * SMALL)
        if total > 0.0:
            changes.append(abs(np.trapezoid(slope * moved * response, frequencies)) / total)
    return float(max(changes))


def _shares_of_open(prepared_scene):
    """Share of the open transducer's stiffness that acts with the load, as functions of ω.

    Charge that decays at the rate λ has the share ω²/(λ² + ω²). A netlist is between a short and an
    open circuit.
    """
    decay = prepared_scene.system.transducer.decay_rate()
    if prepared_scene.scene.load.is_resistor and math.isfinite(decay):
        return [lambda omega: omega**2 / (decay**2 + omega**2)]
    return [lambda omega: 0.0, lambda omega: 1.0]


def _gain(system, omega, share_of_open):
    """|X/η|² (s⁴) of small oscillations about the stiffest well at angular frequencies (rad/s)."""
    stiffest = max(timescales.wells(system), key=lambda well: timescales.stiffness(system, well))
    low = max(timescales.stiffness(system, stiffest), 0.0)
    high = max(low, timescales.angular_frequency(system) ** 2)
    away = low + (high - low) * share_of_open(omega) - omega**2
    damped = np.hypot(omega * timescales.loss_rate(system, omega), 1e-9 * omega**2)
    return 1.0 / (away**2 + damped**2)


def _spectrum(prepared_scene, spacing):
    """Frequencies (Hz) up to the sampling rate, and the excitation's density at them."""
    system, excitation, run = (
        prepared_scene.system,
        prepared_scene.scene.excitation,
        prepared_scene.scene.run,
    )
    omega = timescales.angular_frequency(system)
    width = 0.5 * timescales.loss_rate(system, omega) * np.logspace(-1.0, 3.0, ASIDE)
    corners = np.unique(excitation.corners)
    grids = [
        np.geomspace(1e-3 * omega, math.pi / spacing, OVERALL) / (2.0 * math.pi),
        np.concatenate([omega - width, [omega], omega + width]) / (2.0 * math.pi),
        *(np.linspace(low, high, BETWEEN) for low, high in pairwise(corners)),
        # A density may be discontinuous at a corner.
        *(corners * side for side in (1.0 - 1e-12, 1.0 + 1e-12)),
    ]
    frequencies = np.unique(np.concatenate(grids))
    frequencies = frequencies[(frequencies > 0.0) & (frequencies <= 0.5 / spacing)]
    density = excitation.density(frequencies)
    if density is not None:
        return frequencies, density
    from scipy.signal import welch

    # The path is independent of the scene's seed, so that the steps are too.
    path = excitation.path(spacing, prepared_scene.excitation_unit, realization_seed(0, 0))
    count = min((run.settle + run.duration) / spacing, MOST_SAMPLES)
    samples = path.read(math.ceil(count))
    segment = min(SEGMENT_PERIODS * 2.0 * math.pi / (omega * spacing), samples.size)
    frequencies, density = welch(samples, 1.0 / spacing, nperseg=math.ceil(segment))
    return frequencies[1:], density[1:]
