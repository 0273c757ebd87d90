"""Scatter of parameters between devices, and the devices of a tolerance study.

A parameter scatters independently, as `±10%`, `uniform:a:b` or `normal:5%`, or jointly with others
according to their covariance. Sobol indices need independent parameters. The principal axes of a
joint normal distribution are independent for any covariance. Each axis is a parameter of the study,
named after the scene's number that it changes most.
"""

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import ndtr, ndtri

from harvester.base.errors import HarvesterError, SceneError
from harvester.base.numbers import number as written
from harvester.base.plain_text import named
from harvester.base.reading import read_input
from harvester.scene.model import Scene
from harvester.scene.numbers import number
from harvester.studies.answers import on_common_knots

FORMS = "±10%, ±0.5, uniform:LOW:HIGH, normal:5% or normal:MEAN:SD"
PLUS_MINUS = re.compile(r"(?:±|\+/?-)(.+)")
# Largest JSON of an identification, in bytes.
LARGEST_FILE = 10_000_000
# A normal distribution is evaluated up to this distance of the quantile from 0 and 1.
SMALLEST_SHARE = 1e-12


@dataclass(frozen=True)
class Tolerance:
    """The distribution of one parameter.

    Attributes
    ----------
    key : "table.key" of the scene.
    kind : "uniform" or "normal".
    first, second
        Ends of a uniform distribution; mean and standard deviation of a normal one.
    low, high
        Limits of the key; a normal distribution is truncated there.
    """

    key: str
    kind: str
    first: float
    second: float
    low: float = -math.inf
    high: float = math.inf

    def values(self, shares: np.ndarray) -> np.ndarray:
        """Quantiles of the distribution for shares in (0, 1), same shape."""
        if self.kind == "uniform":
            return self.first + (self.second - self.first) * shares
        below, above = (ndtr((end - self.first) / self.second) for end in (self.low, self.high))
        inside = np.clip(shares, SMALLEST_SHARE, 1.0 - SMALLEST_SHARE)
        return self.first + self.second * ndtri(below + (above - below) * inside)

    def __str__(self) -> str:
        if self.kind == "uniform":
            return f"{self.first:.4g} … {self.second:.4g}"
        cut = (
            ndtr((self.low - self.first) / self.second),
            ndtr((self.first - self.high) / self.second),
        )
        note = ", truncated at the key's limits" if max(cut) > 1e-6 else ""
        return f"normal, {self.first:.4g} ± {self.second:.2g}{note}"


def tolerance(scene: Scene, key: str, distribution: str) -> Tolerance:
    """One parameter's distribution from its text.

    Raises HarvesterError for an unknown key, an unknown distribution, or values that are invalid in
    the scene.
    """
    value, spec = number(scene, key, "--vary")
    where = f"--vary {key}={named(distribution)}"
    if not isinstance(distribution, str):
        raise HarvesterError(f"{where}: is not a text; write {FORMS}")
    kind, first, second = _distribution(distribution, value, where)
    tolerance_of_key = Tolerance(key, kind, first, second, spec.low, spec.high)
    typical = (first, second) if kind == "uniform" else (first,)
    for typical_value in typical:
        try:
            scene.replace({key: typical_value})
        except SceneError as error:
            raise HarvesterError(f"{where}: {error}") from None
    return tolerance_of_key


def _distribution(text, value, where):
    match = PLUS_MINUS.fullmatch(text)
    if match:
        reach = _positive(match.group(1), value, where)
        return "uniform", value - reach, value + reach
    kind, *numbers = text.split(":")
    if kind == "normal" and len(numbers) == 1 and numbers[0].endswith("%"):
        return kind, value, _positive(numbers[0], value, where)
    if kind not in ("uniform", "normal") or len(numbers) != 2:
        raise HarvesterError(f"{where}: no such distribution; write {FORMS}")
    first, second = _number(numbers[0], where), _number(numbers[1], where)
    if kind == "uniform" and not first < second:
        raise HarvesterError(f"{where}: uniform:LOW:HIGH needs LOW below HIGH")
    if kind == "normal" and not second > 0.0:
        raise HarvesterError(f"{where}: normal:MEAN:SD needs SD above 0")
    return kind, first, second


def _positive(text, value, where):
    """Parse an absolute number, or a share of the value with `%`."""
    share = text.endswith("%")
    amount = _number(text.removesuffix("%"), where)
    amount *= abs(value) / 100.0 if share else 1.0
    if share and value == 0.0:
        raise HarvesterError(f"{where}: a share of the value 0 is 0; write uniform:LOW:HIGH")
    if not amount > 0.0:
        raise HarvesterError(f"{where}: the number must be above 0")
    return amount


def _number(text, where):
    try:
        amount = written(text)
    except ValueError:
        amount = math.nan
    if not math.isfinite(amount):
        raise HarvesterError(f"{where}: {named(text)} is not a number; write {FORMS}")
    return amount


@dataclass(frozen=True)
class Direction:
    """One principal axis of a joint normal distribution.

    Attributes
    ----------
    key
        The scene's number that the axis changes most, with the axis' number.
    centre, steps : dict of str to float
        For each number: its mean, and its change by one standard deviation along the axis.
    """

    key: str
    centre: dict[str, float]
    steps: dict[str, float]
    kind: str = "normal"
    first: float = 0.0
    second: float = 1.0

    def values(self, shares: np.ndarray) -> np.ndarray:
        """Standard normal quantiles for shares in (0, 1), same shape."""
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
    scene
        The scene, whose values are the means of the distributions.
    identified : dict with `keys` and `covariance`, or the file of its JSON
        Result of `Identification.to_dict` or `harvester identify --json`.

    Raises
    ------
    HarvesterError
        `identified` is not such a result, or contains keys that the scene does not have.
    """
    where, content = "covariance", identified
    if not isinstance(content, Mapping):
        where = f"--covariance {named(str(content))}"
        try:
            content = json.loads(read_input(content, "JSON file", LARGEST_FILE))
        except (ValueError, RecursionError):
            raise HarvesterError(
                f"{where}: not a JSON file: give the JSON of harvester identify"
            ) from None
    try:
        keys = [str(key) for key in content["keys"]]
        covariance = np.array(content["covariance"], dtype=float)
    except (KeyError, TypeError, ValueError):
        raise HarvesterError(
            f"{where}: not an identification with keys and covariance: give the JSON of "
            "harvester identify"
        ) from None
    if covariance.shape != (len(keys), len(keys)) or not np.isfinite(covariance).all():
        raise HarvesterError(
            f"{where}: the covariance must be a square matrix with one row per key"
        )
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


def parameters(tolerances: Sequence[Tolerance | Direction], shares: np.ndarray) -> dict[str, float]:
    """Values of a device's parameters by key."""
    values: dict[str, float] = {}
    for parameter, share in zip(tolerances, shares, strict=True):
        value = float(parameter.values(share))
        if isinstance(parameter, Direction):
            for key, step in parameter.steps.items():
                values[key] = values.get(key, parameter.centre[key]) + value * step
        else:
            values[parameter.key] = value
    return values


def devices(
    scene: Scene, tolerances: Sequence[Tolerance | Direction], shares: np.ndarray, replicates: int
) -> list[list[Scene]]:
    """Scenes of each row: all replicates of its first device, then of its second, and so on.

    Parameters
    ----------
    shares : ndarray, shape (rows, devices, parameters)
        See `harvester.studies.sensitivity.sobol.design`.
    replicates
        Number of replicates; each has its part of the realizations, with noise that is common to a
        row.

    Raises
    ------
    HarvesterError
        A device is not valid.
    """
    realizations = max(scene.run.realizations // replicates, 1)
    rows = []
    for row_number, row in enumerate(shares):
        seeds = [_seed(scene.run.seed, row_number, k) for k in range(replicates)]
        try:
            scenes = [scene.replace(parameters(tolerances, quantiles)) for quantiles in row]
        except SceneError as error:
            raise HarvesterError(
                f"--vary: a device within the tolerances is not valid: {error}; choose narrower "
                "tolerances"
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
    flat = iter(on_common_knots([device_scene for row in rows for device_scene in row]))
    return [[next(flat) for _ in row] for row in rows]


def _seed(seed, row, replicate):
    """The seed of the noise common to all devices of a row in one replicate."""
    words = np.random.SeedSequence(seed, spawn_key=(row, replicate)).generate_state(2, np.uint64)
    return int(words[0])
