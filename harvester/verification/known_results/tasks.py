"""What `verify` asks a worker process for that is no mean of a scene."""

from collections.abc import Callable, Sequence

import numpy as np

from harvester.engines.realization import run
from harvester.engines.steps import knot_spacing
from harvester.estimates.of_run import run_estimates
from harvester.scene.model import Scene
from harvester.verification import exact_paths
from harvester.verification.known_results import radau, simulators

# Of a path: X and terminal voltage, scaled, at the knots 1, 2, …
COLUMNS = ("displacement", "voltage")


def _dop853(scene):
    return exact_paths.run(scene, 0, None)[:, [0, 2]]


# Who else runs a scene's first path.
OTHERS: dict[str, Callable[[Scene], np.ndarray]] = {
    "DOP853": _dop853,
    "Radau": radau.bridge_path,
    "ngspice -b": simulators.plain_ngspice,
    "VACASK": simulators.vacask,
}


def rebound(scene: Scene, engine: str, report: Callable) -> tuple[float, float]:
    """Speed at the end of a run that begins with a drop at speed 1, and 0 for its error."""
    return -float(_waveform(scene, engine, "default", report).velocity[-1]), 0.0


def path_deviation(
    scene: Scene, engine: str, step: str, other: str, column: str, report: Callable
) -> tuple[float, float]:
    """Root mean square difference from another's path at the knots, as a share of its own rms.

    `other` is one of `OTHERS`, `column` of `COLUMNS`.
    """
    theirs = OTHERS[other](scene)[:, COLUMNS.index(column)]
    record = _waveform(scene, engine, step, report)
    times = knot_spacing(scene) * np.arange(1, theirs.size + 1)
    ours = np.interp(times, record.time, getattr(record, column))
    return float(np.sqrt(np.mean((ours - theirs) ** 2) / np.mean(theirs**2))), 0.0


def highest(
    scenes: Sequence[Scene], engine: str, quantity: str, report: Callable
) -> tuple[float, float]:
    """The largest of a quantity (scaled) among some scenes that no noise moves."""
    values = []
    for scene in scenes:
        [found] = run(scene, engine, [0], "default", "external", None, report)
        values.append(run_estimates(scene, [found.moments]).whole[quantity].estimate)
    return float(max(values)), 0.0


def _waveform(scene, engine, step, report):
    """All points of the first realization."""
    [found] = run(scene, engine, [0], step, "external", (0.0, 2.0 * scene.run.duration), report)
    return found.waveform
