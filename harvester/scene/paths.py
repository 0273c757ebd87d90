"""Initial state and noise path of each realization, the same for every engine."""

from __future__ import annotations

from typing import TYPE_CHECKING

from harvester.device import timescales
from harvester.excitation.base import realization_seed
from harvester.scene.starts import drawn_start
from harvester.scene.steps import knot_spacing

if TYPE_CHECKING:
    from harvester.excitation.base import ExcitationPath
    from harvester.scene.prepared import Prepared


def start_state(prepared_scene: Prepared, index: int) -> tuple[float, float, float]:
    """Initial state (X, X', transducer's state) of a realization, scaled.

    By default the mass is at rest, in successive wells from the right; [start] replaces this. With
    `run.starts` the state is drawn over the energy range. If `run.orbit = "rest"`, the first
    realization starts at rest.
    """
    run = prepared_scene.scene.run
    if run.starts is not None and (index or run.orbit != "rest"):
        return drawn_start(prepared_scene, index)
    length, wells = prepared_scene.scales.displacement, timescales.wells(prepared_scene.system)
    displacement, velocity, state = wells[index % len(wells)], 0.0, 0.0
    start = prepared_scene.scene.start
    if start:
        if start.displacement is not None:
            displacement = start.displacement / length
        velocity = start.velocity / length
        state = start.voltage / prepared_scene.scene.transducer.state_unit(prepared_scene.setting)
    return displacement, velocity, state


def distinct_realizations(prepared_scene: Prepared, wanted: int | None = None) -> int:
    """Number of distinct realizations: under a deterministic excitation, the number of starts.

    `wanted`: upper limit (default: the scene's `run.realizations`).
    """
    scene = prepared_scene.scene
    count = scene.run.realizations if wanted is None else wanted
    if scene.excitation.random or scene.run.starts is not None:
        return count
    placed = scene.start is not None and scene.start.displacement is not None
    alike = placed or scene.excitation.prescribes_displacement
    return min(count, 1 if alike else len(timescales.wells(prepared_scene.system)))


def several_starts(prepared_scene: Prepared) -> bool:
    """Whether realizations differ only in their initial states."""
    excitation = prepared_scene.scene.excitation
    if excitation.random or excitation.prescribes_displacement:
        return False
    return distinct_realizations(prepared_scene) > 1


def noise_path(prepared_scene: Prepared, index: int, factor: float = 1.0) -> ExcitationPath:
    """The excitation of one realization, from its beginning; the same for every engine."""
    seed = realization_seed(prepared_scene.scene.run.seed, index)
    return prepared_scene.scene.excitation.path(
        knot_spacing(prepared_scene), prepared_scene.excitation_unit / factor, seed
    )
