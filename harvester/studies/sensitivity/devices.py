"""The scenes of the devices that a tolerance study simulates."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from harvester.errors import HarvesterError, SceneError
from harvester.scene.model import Scene
from harvester.studies.answers import on_common_knots
from harvester.studies.sensitivity.joint_tolerance import Direction
from harvester.studies.sensitivity.tolerances import Tolerance


def parameters(tolerances: Sequence[Tolerance | Direction], shares: np.ndarray) -> dict[str, float]:
    """Values of a device's parameters by their keys."""
    found: dict[str, float] = {}
    for each, share in zip(tolerances, shares, strict=True):
        value = float(each.values(share))
        if isinstance(each, Direction):
            for key, step in each.steps.items():
                found[key] = found.get(key, each.centre[key]) + value * step
        else:
            found[each.key] = value
    return found


def devices(
    scene: Scene, tolerances: Sequence[Tolerance | Direction], shares: np.ndarray, replicates: int
) -> list[list[Scene]]:
    """Scenes of each row: of every device all replicates, one after another.

    Parameters
    ----------
    scene : Scene
    tolerances : sequence of Tolerance or Direction
    shares : ndarray, shape (rows, devices, parameters)
        See `harvester.studies.sensitivity.sobol.design`.
    replicates : int
        Each has its part of the realizations, on noise that is a row's own.

    Raises
    ------
    HarvesterError
        A device that cannot be.
    """
    realizations = max(scene.run.realizations // replicates, 1)
    rows = []
    for place, row in enumerate(shares):
        seeds = [_seed(scene.run.seed, place, k) for k in range(replicates)]
        try:
            made = [scene.replace(parameters(tolerances, each)) for each in row]
        except SceneError as error:
            raise HarvesterError(
                f"--vary: a device within the tolerances is not valid: {error}; choose narrower "
                "ones"
            ) from None
        rows.append(
            [
                replace(device, run=replace(scene.run, seed=seed, realizations=realizations))
                for device in made
                for seed in (seeds if replicates > 1 else [scene.run.seed])
            ]
        )
    if replicates == 1:
        return rows
    flat = on_common_knots([each for row in rows for each in row])
    return [flat[start : start + len(rows[0])] for start in range(0, len(flat), len(rows[0]))]


def _seed(seed, row, replicate):
    """The seed of the noise that all devices of a row share in one replicate."""
    words = np.random.SeedSequence(seed, spawn_key=(row, replicate)).generate_state(2, np.uint64)
    return int(words[0])
