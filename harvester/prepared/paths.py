"""Where each realization starts, and the noise path that drives it: the same for every engine."""

from __future__ import annotations

from typing import TYPE_CHECKING

from harvester.device import timescales
from harvester.excitation import realization_seed
from harvester.prepared.steps import knot_spacing
from harvester.scene.units import scale, setting

if TYPE_CHECKING:
    from harvester.excitation.base import ExcitationPath
    from harvester.scene.model import Scene


def start_state(scene: Scene, index: int) -> tuple[float, float, float]:
    """(X, X', transducer's state) in which a realization starts, scaled.

    At rest in the wells in turn, beginning on the right, unless the scene says where.
    """
    parameters, scales = scale(scene)
    wells = timescales.wells(parameters)
    displacement, velocity, state = wells[index % len(wells)], 0.0, 0.0
    start = scene.start
    if start:
        if start.displacement is not None:
            displacement = start.displacement / scales.displacement
        velocity = start.velocity / scales.displacement
        state = start.voltage / scene.transducer.state_unit(setting(scene))
    return displacement, velocity, state


def noise_path(scene: Scene, index: int) -> ExcitationPath:
    """The excitation of one realization, at its beginning; the same for every engine."""
    _, scales = scale(scene)
    seed = realization_seed(scene.run.seed, index)
    return scene.excitation.path(knot_spacing(scene), scales.displacement, seed)
