"""Tasks of `verify` that give (value, error) of something other than a scene's mean."""

from collections.abc import Callable, Sequence

import numpy as np

from harvester.engines.methods import engine_of
from harvester.engines.realization import run
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.statistics.of_run import run_estimates
from harvester.validation import STATES, exact_paths, radau, simulators
from harvester.validation.paths import recorded, states_at_knots

# Other programs that run a scene's first path. Each gives X and the terminal voltage, scaled, at
# the knots 1, 2, …
OTHERS: dict[str, Callable[[Scene], np.ndarray]] = {
    "DOP853": lambda scene: exact_paths.run(scene, 0)[:, [0, 2]],
    "Radau": radau.bridge_path,
    "ngspice -b": simulators.plain_ngspice,
    "VACASK": simulators.vacask,
}
COLUMNS = ("displacement", "voltage")


def rebound(scene: Scene, engine: str, report: Callable) -> tuple[float, float]:
    """Rebound speed off a stopper: at the end of a run whose mass hits it with speed 1."""
    [path] = recorded(scene, engine, [0], "default")
    return -float(path.waveform.velocity[-1]), 0.0  # type: ignore[union-attr]


def path_deviation(
    scene: Scene, engine: str, step: str, other: str, column: str, report: Callable
) -> tuple[float, float]:
    """Root mean square difference from another's path at the knots, as a share of its own rms.

    `other` is one of `OTHERS`, `column` of `COLUMNS`.
    """
    theirs = OTHERS[other](scene)[:, COLUMNS.index(column)]
    states = states_at_knots(scene, recorded(scene, engine, [0], step))
    ours = states[0, :, STATES.index(column)]
    return float(np.sqrt(np.mean((ours - theirs) ** 2) / np.mean(theirs**2))), 0.0


def highest(
    scenes: Sequence[Scene], engine: str, quantity: str, report: Callable
) -> tuple[float, float]:
    """The largest value of a quantity (scaled) among some scenes without noise."""
    values = []
    for scene in scenes:
        [realization] = run(scene, engine_of(engine), [0], None, report)
        values.append(
            run_estimates(prepared(scene), [realization.moments]).whole[quantity].estimate
        )
    return float(max(values)), 0.0
