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
    values: dict[str, float] = {}
    for tolerance, share in zip(tolerances, shares, strict=True):
        value = float(tolerance.values(share))
        if isinstance(tolerance, Direction):
            for key, step in tolerance.steps.items():
                values[key] = values.get(key, tolerance.centre[key]) + value * step
        else:
            values[tolerance.key] = value
    return values


def devices(
    scene: Scene, tolerances: Sequence[Tolerance | Direction], shares: np.ndarray, replicates: int
) -> list[list[Scene]]:
    """Scenes of each row: of every device all replicates, one after another.

    Parameters
    ----------
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
    for number, row in enumerate(shares):
        seeds = [_seed(scene.run.seed, number, k) for k in range(replicates)]
        try:
            scenes = [scene.replace(parameters(tolerances, quantiles)) for quantiles in row]
        except SceneError as error:
            raise HarvesterError(
                f"--vary: a device within the tolerances is not valid: {error}; choose narrower "
                "ones"
            ) from None
        rows.append(
            [
                replace(device, run=replace(scene.run, seed=seed, realizations=realizations))
                for device in scenes
                for seed in (seeds if replicates > 1 else [scene.run.seed])
            ]
        )
    if replicates == 1:
        return rows
    flat = on_common_knots([device_scene for row in rows for device_scene in row])
    return [flat[start : start + len(rows[0])] for start in range(0, len(flat), len(rows[0]))]


def _seed(seed, row, replicate):
    """The seed of the noise that all devices of a row share in one replicate."""
    words = np.random.SeedSequence(seed, spawn_key=(row, replicate)).generate_state(2, np.uint64)
    return int(words[0])
