"""Parameters that scatter together, by their covariance: independent directions of it.

Sobol indices are of independent parameters. The principal axes of a joint normal distribution are
independent, whatever the covariance: each is one parameter of the study, named after what it mostly
moves.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import ndtri

from harvester.errors import HarvesterError
from harvester.files.plain_text import named
from harvester.files.reading import read_input
from harvester.scene.model import Scene
from harvester.scene.numbers import number

# Largest JSON of an identification, in bytes.
LARGEST_FILE = 10_000_000
# The normal distribution is followed up to this distance of the quantile from 0 and 1.
SMALLEST_SHARE = 1e-12


@dataclass(frozen=True)
class Direction:
    """One principal axis of a joint normal distribution.

    Attributes
    ----------
    key : str
        The parameter that it mostly moves, with its place among the axes.
    centre, steps : dict of str to float
        For every parameter: its mean, and its change in one standard deviation of the axis.
    """

    key: str
    centre: dict[str, float]
    steps: dict[str, float]
    kind: str = "normal"
    first: float = 0.0
    second: float = 1.0

    def values(self, shares: np.ndarray) -> np.ndarray:
        """Standard deviations below which these shares of the devices lie, same shape."""
        return ndtri(np.clip(shares, SMALLEST_SHARE, 1.0 - SMALLEST_SHARE))

    def __str__(self) -> str:
        moved = sorted(
            ((step / abs(self.centre[key] or 1.0), key) for key, step in self.steps.items()),
            key=lambda each: -abs(each[0]),
        )
        return ", ".join(f"{key.rpartition('.')[2]} {share:+.2g}" for share, key in moved[:3])


def directions(scene: Scene, identified: Mapping[str, Any] | str | Path) -> list[Direction]:
    """The principal axes of an identification's covariance.

    Parameters
    ----------
    scene : Scene
        The scene, whose values are the means of the distributions.
    identified : dict with `keys` and `covariance`, or the file of its JSON
        Result of `Identification.to_dict` or `harvester identify --json`.

    Raises
    ------
    HarvesterError
        It is no such thing, or names keys that the scene does not have.
    """
    where, content = "covariance", identified
    if not isinstance(content, Mapping):
        where = f"--covariance {named(str(content))}"
        content = _content(content, where)
    try:
        keys = [str(key) for key in content["keys"]]
        covariance = np.array(content["covariance"], dtype=float)
    except (KeyError, TypeError, ValueError):
        raise HarvesterError(f"{where}: no identification with keys and covariance") from None
    if covariance.shape != (len(keys), len(keys)) or not np.isfinite(covariance).all():
        raise HarvesterError(f"{where}: the covariance is no square matrix of its keys' size")
    indices = [index for index, key in enumerate(keys) if not key.startswith("sensor.")]
    keys, covariance = [keys[index] for index in indices], covariance[np.ix_(indices, indices)]
    centre = {key: number(scene, key, where)[0] for key in keys}
    units = np.array([abs(value) or 1.0 for value in centre.values()])
    spread, axes = np.linalg.eigh(covariance / np.outer(units, units))
    axes_found: list[Direction] = []
    for axis in map(int, np.argsort(-spread)):
        steps = axes[:, axis] * math.sqrt(max(float(spread[axis]), 0.0)) * units
        main = keys[int(np.argmax(np.abs(axes[:, axis])))]
        label = f"axis {len(axes_found) + 1}: {main}"
        axes_found.append(Direction(label, centre, dict(zip(keys, map(float, steps), strict=True))))
    return axes_found


def _content(file, where):
    try:
        return json.loads(read_input(file, "JSON file", LARGEST_FILE))
    except (ValueError, RecursionError):
        raise HarvesterError(f"{where}: not a JSON file") from None
