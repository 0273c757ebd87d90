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
# If no formula gives the density, Welch's method estimates it from at most this number of samples
# of a path, in segments of this number of periods of the resonance.
MOST_SAMPLES, SEGMENT_PERIODS = 2**18, 64.0


@functools.lru_cache(maxsize=64)
def misplacement(prepared_scene: Prepared, spacing: float, order: int) -> float:
    """Relative change of E[X²] if every frequency ω becomes ω (1 + ω^order), to first order.

    Multiplied by c h^order, it is the error of an integrator that shifts ω by c (ω h)^order. If the
    integrator is exact at a line, only the difference from the shift there counts. Sines are part
    of E[X²], but not of its change; `harvester.scene.lines` treats their error.

    `spacing`: time between two samples of the excitation (s).

    Notes
    -----
    With H = X/η = 1/(k − ω² + i d ω), d ln|H|²/d ln ω = 2 Re[(2 ω² − i d ω) H].
    """
    excitation = prepared_scene.scene.excitation
    frequencies, density = _spectrum(prepared_scene, spacing)
    omega = 2.0 * math.pi * frequencies
    transfer = lines.receptance(prepared_scene.system, omega)
    response = density * np.sinc(frequencies * spacing) ** 4 * np.abs(transfer) ** 2
    total = np.trapezoid(response, frequencies)
    for frequency, amplitude in excitation.lines:
        at_line = lines.receptance(prepared_scene.system, 2.0 * math.pi * frequency)
        total += 0.5 * abs(amplitude * at_line) ** 2
    moved = omega**order - lines.line_frequency(prepared_scene) ** order
    slope = 2.0 * ((2.0 * omega**2 - 1j * (1.0 / transfer).imag) * transfer).real
    change = np.trapezoid(slope * moved * response, frequencies)
    return float(abs(change) / total) if total > 0.0 else 0.0


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
