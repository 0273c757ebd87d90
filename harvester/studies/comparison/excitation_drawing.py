"""Figure of the excitation's spectrum."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from harvester.device import timescales
from harvester.results.drawing import mark_frequency
from harvester.results.palette import CIRCUIT
from harvester.results.panels import Panel, Series, draw_panels
from harvester.scene.paths import noise_path
from harvester.scene.prepared import Prepared, prepared
from harvester.scene.steps import knot_spacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from harvester.scene.model import Scene

# Maximum number of a path's knots for the spectrum, and number of segments.
MOST_KNOTS, SEGMENTS = 2**18, 32
# Densities below this share of the peak are not drawn: they are leakage of a sine.
LEAST_SHARE = 1e-8


def draw_spectrum(scene: Scene) -> Figure:
    """Draw the first realization's spectral density, and mark the device's resonance."""
    prepared_scene = prepared(scene)
    frequency, density = excitation_spectrum(prepared_scene)
    seen = density > LEAST_SHARE * density.max()
    what = "displacement" if scene.excitation.prescribes_displacement else "acceleration"
    unit = "m²/Hz" if what == "displacement" else "(m/s²)²/Hz"
    resonance = timescales.angular_frequency(prepared_scene.system) / (2.0 * np.pi)
    mark = partial(mark_frequency, frequency=resonance, label="device, small oscillations")
    panel = Panel(
        "frequency [Hz]",
        f"{what} [{unit if scene.units == 'SI' else 'scaled'}]",
        [Series(frequency[seen], density[seen], "excitation", CIRCUIT, width=0.9)],
        log_x=True,
        log_y=True,
        more=mark if resonance > 0.0 else None,
    )
    return draw_panels([panel], f"{scene.name}: spectral density of the excitation", (4.8, 2.3))


def excitation_spectrum(prepared_scene: Prepared) -> tuple[np.ndarray, np.ndarray]:
    """One-sided spectral density of the first realization's path: Hz, the scene's unit² per Hz."""
    from scipy import signal

    spacing, run = knot_spacing(prepared_scene), prepared_scene.scene.run
    knots = min(MOST_KNOTS, max(2, int((run.settle + run.duration) / spacing)))
    samples = noise_path(prepared_scene, 0).read(knots) * prepared_scene.scales.displacement
    length = max(2, min(knots, 2 * knots // SEGMENTS))
    frequency, density = signal.welch(samples, 1.0 / spacing, nperseg=length)
    return frequency[1:], density[1:]
