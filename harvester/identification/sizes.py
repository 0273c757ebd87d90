"""Sizes: the typical magnitude of each unknown, also of one that begins at zero; fits work
in these units."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from harvester.identification.measured_response import MeasuredResponse
from harvester.identification.reconstruction import frequencies
from harvester.identification.sensors import HIGHPASSES
from harvester.prepared.prepared import prepared
from harvester.scene.units import restoring_spring

if TYPE_CHECKING:
    from harvester.identification.fitted_model import Fitted
    from harvester.identification.measurement import Measurement
    from harvester.scene.model import Scene

SHARE_OF_PERIOD = 0.1
POWERS = 8


def sizes_of(
    scene: Scene, measurements: Sequence[Measurement], reach: float, speed: float
) -> dict[str, float]:
    """Typical magnitudes of the unknowns, including the sensors', by their keys.

    Parameters
    ----------
    scene : Scene
    measurements : sequence of Measurement
    reach, speed : float
        Greatest displacement and rms velocity, in the scene's units.
    """
    force = [k or 0.0 for k in scene.oscillator.coefficients]
    # The largest force that one power of the spring has at the greatest displacement.
    greatest = max((abs(k) * reach**n for n, k in enumerate(force)), default=0.0)
    if scene.oscillator.force_table is not None:
        greatest = float(np.abs(restoring_spring(scene.oscillator).force(reach)))
    greatest = greatest or 1.0
    sizes = {f"oscillator.restoring_force[{n}]": greatest / reach**n for n in range(POWERS)}
    sizes["oscillator.linear_stiffness"] = greatest / reach
    sizes["oscillator.cubic_stiffness"] = greatest / reach**3
    damping = scene.oscillator.damping or 1e-2 * greatest / speed
    sizes["oscillator.damping"] = damping
    sizes["oscillator.quadratic_damping"] = damping / speed
    sizes["stoppers.gap"] = reach
    sizes["stoppers.stiffness"] = greatest / reach**1.5
    frequency = frequencies(measurements[0])[0]
    for name in ("acceleration", "voltage"):
        for effect in HIGHPASSES:
            sizes[f"sensor.{name}_{effect}"] = SHARE_OF_PERIOD * frequency
    base = measurements[0].acceleration
    sizes["sensor.acceleration_offset"] = 1.0 if base is None else float(np.std(base)) or 1.0
    for name, values in measurements[0].sensed.items():
        sizes[f"sensor.{name}_offset"] = float(np.std(values))
        for effect in ("delay", "filter"):
            sizes[f"sensor.{name}_{effect}"] = SHARE_OF_PERIOD / frequency
    return sizes


def first_sizes(scene: Scene, measurements: Sequence[Measurement]) -> dict[str, float]:
    """Sizes before any fit: a motion of one length unit of the scene, at the measured frequency."""
    length = prepared(scene).scales.displacement
    speed = 2.0 * np.pi * frequencies(measurements[0])[0] * length
    return sizes_of(scene, measurements, length, speed)


def fitted_sizes(base: Fitted, measurements: Sequence[Measurement]) -> dict[str, float]:
    """Sizes from the fitted motion; for a frequency response those of `first_sizes`."""
    if isinstance(measurements[0], MeasuredResponse):
        return first_sizes(base.scene, measurements)
    reach, speed = 0.0, 0.0
    responses, fit = base.shooting.responses, base.fit
    for number, edges in enumerate(fit.edges):
        states, _, _ = responses.states(number, fit.values, edges, fit.starts[number])
        reach = max(reach, float(np.abs(states[:, 0]).max()))
        speed = max(speed, float(np.std(states[:, 1])))
    length = responses.length
    return sizes_of(base.scene, measurements, reach * length, speed * length)
