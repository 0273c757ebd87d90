"""How a parameter scatters from device to device: `±10%`, `uniform:a:b`, `normal:5%`, …"""

import math
import re
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from harvester.errors import HarvesterError, SceneError
from harvester.files.numbers import number as written
from harvester.files.plain_text import named
from harvester.scene.model import Scene
from harvester.scene.numbers import number

FORMS = "±10%, ±0.5, uniform:LOW:HIGH, normal:5% or normal:MEAN:SD"
PLUS_MINUS = re.compile(r"(?:±|\+/?-)(.+)")
# A normal distribution is followed up to this distance of the quantile from 0 and 1.
SMALLEST_SHARE = 1e-12


@dataclass(frozen=True)
class Tolerance:
    """The distribution of one parameter.

    Attributes
    ----------
    key : str
        "table.key" of the scene.
    kind : str
        "uniform" or "normal".
    first, second : float
        Ends of a uniform distribution; mean and standard deviation of a normal one.
    low, high : float
        Limits that the key allows; a normal distribution is cut off there.
    """

    key: str
    kind: str
    first: float
    second: float
    low: float = -math.inf
    high: float = math.inf

    def values(self, shares: np.ndarray) -> np.ndarray:
        """The values below which these shares of the devices lie, same shape."""
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
        note = ", cut off at what is allowed" if max(cut) > 1e-6 else ""
        return f"normal, {self.first:.4g} ± {self.second:.2g}{note}"


def parse(scene: Scene, text: str) -> Tolerance:
    """The tolerance that `table.key=DISTRIBUTION` says.

    Raises
    ------
    HarvesterError
        No such key, no such distribution, or values that the scene cannot take.
    """
    key, separator, distribution = (part.strip() for part in text.partition("="))
    if not separator or not distribution:
        raise HarvesterError(f"--vary {named(text)}: write it as TABLE.KEY={FORMS.split(',')[0]}")
    return tolerance(scene, key, distribution)


def tolerance(scene: Scene, key: str, distribution: str) -> Tolerance:
    """One parameter's distribution from its text; see `parse`."""
    value, spec = number(scene, key, "--vary")
    where = f"--vary {key}={named(distribution)}"
    if not isinstance(distribution, str):
        raise HarvesterError(f"{where}: is no text; write {FORMS}")
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
    """An absolute number, or a share of the value with `%`."""
    share = text.endswith("%")
    amount = _number(text.removesuffix("%"), where)
    amount *= abs(value) / 100.0 if share else 1.0
    if share and value == 0.0:
        raise HarvesterError(f"{where}: a share of 0 is 0; write uniform:LOW:HIGH")
    if not amount > 0.0:
        raise HarvesterError(f"{where}: the number must be above 0")
    return amount


def _number(text, where):
    try:
        amount = written(text)
    except ValueError:
        amount = math.nan
    if not math.isfinite(amount):
        raise HarvesterError(f"{where}: {named(text)} is no number; write {FORMS}")
    return amount
