"""Start and noise path of each realization: the same for every engine."""

from __future__ import annotations

from typing import TYPE_CHECKING

from harvester.device import timescales
from harvester.excitation.base import realization_seed
from harvester.scene.starts import drawn_start
from harvester.scene.steps import knot_spacing

if TYPE_CHECKING:
    from harvester.excitation.base import ExcitationPath
    from harvester.scene.prepared import Prepared


def start_state(ready: Prepared, index: int) -> tuple[float, float, float]:
    """(X, X', transducer's state) in which a realization starts, scaled.

    At rest in successive wells, beginning on the right, unless the scene gives a start; drawn over
    the energy range where `run.starts` asks for it, the first at rest if its orbit is followed.
    """
    run = ready.scene.run
    if run.starts is not None and (index or run.orbit != "rest"):
        return drawn_start(ready, index)
    length, wells = ready.scales.displacement, timescales.wells(ready.system)
    displacement, velocity, state = wells[index % len(wells)], 0.0, 0.0
    start = ready.scene.start
    if start:
        if start.displacement is not None:
            displacement = start.displacement / length
        velocity = start.velocity / length
        state = start.voltage / ready.scene.transducer.state_unit(ready.setting)
    return displacement, velocity, state


def distinct_realizations(ready: Prepared, wanted: int | None = None) -> int:
    """Number of realizations that differ: with a deterministic excitation the number of starts.

    `wanted` is by default the scene's own number.
    """
    scene = ready.scene
    count = scene.run.realizations if wanted is None else wanted
    if scene.excitation.random or scene.run.starts is not None:
        return count
    placed = scene.start is not None and scene.start.displacement is not None
    alike = placed or scene.excitation.prescribes_displacement
    return min(count, 1 if alike else len(timescales.wells(ready.system)))


def several_starts(ready: Prepared) -> bool:
    """Whether realizations differ by their starts alone."""
    excitation = ready.scene.excitation
    if excitation.random or excitation.prescribes_displacement:
        return False
    return distinct_realizations(ready) > 1


def noise_path(ready: Prepared, index: int, factor: float = 1.0) -> ExcitationPath:
    """The excitation of one realization, at its beginning; the same for every engine."""
    seed = realization_seed(ready.scene.run.seed, index)
    return ready.scene.excitation.path(knot_spacing(ready), ready.excitation_unit / factor, seed)
