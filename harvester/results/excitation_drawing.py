"""The spectrum of what drives a device."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from harvester.device import timescales
from harvester.results.palette import CIRCUIT
from harvester.results.panels import set_title
from harvester.scene.paths import noise_path
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from harvester.scene.model import Scene

# At most so many knots of the path are transformed, divided into so many segments.
MOST_KNOTS, SEGMENTS = 2**18, 32
# The density is drawn down to this share of its peak. Below it lies the leakage of a sine.
LEAST_SHARE = 1e-8


def draw_spectrum(scene: Scene) -> Figure:
    """Spectral density of the first realization's excitation, and where the device resonates."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 2.6))
    axes = figure.add_subplot()
    prepared_scene = prepared(scene)
    frequency, density = excitation_spectrum(scene)
    seen = density > LEAST_SHARE * density.max()
    axes.loglog(frequency[seen], density[seen], color=CIRCUIT, linewidth=0.9, label="excitation")
    resonance = timescales.angular_frequency(prepared_scene.system) / (2.0 * np.pi)
    if resonance > 0.0:
        axes.axvline(resonance, color="0.3", linestyle=":", label="device, small oscillations")
    what = "displacement" if scene.excitation.prescribes_displacement else "acceleration"
    unit = "m²/Hz" if what == "displacement" else "(m/s²)²/Hz"
    axes.set_xlabel("frequency [Hz]")
    axes.set_ylabel(f"{what} [{unit if scene.units == 'SI' else 'scaled'}]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    set_title(figure, f"{scene.name}: spectral density of the excitation")
    return figure


def excitation_spectrum(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """One-sided spectral density of the first realization's path (Hz, the scene's unit² per Hz)."""
    from scipy import signal

    prepared_scene = prepared(scene)
    spacing, run = knot_spacing(prepared_scene), scene.run
    knots = min(MOST_KNOTS, max(2, int((run.settle + run.duration) / spacing)))
    samples = noise_path(prepared_scene, 0).read(knots) * prepared_scene.scales.displacement
    length = max(2, min(knots, 2 * knots // SEGMENTS))
    frequency, density = signal.welch(samples, 1.0 / spacing, nperseg=length)
    return frequency[1:], density[1:]
