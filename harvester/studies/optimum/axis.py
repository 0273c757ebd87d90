"""A parameter of an optimisation: its range, and its value at the maximum."""

import math
from dataclasses import dataclass

from harvester.base.errors import HarvesterError
from harvester.scene.model import Scene
from harvester.scene.numbers import number

# A range is searched logarithmically if the ratio of its ends exceeds this number.
LOGARITHMIC = 3.0
# A flat region below this share of the range is narrow.
NARROW = 0.02
# Half width of an interval, in standard errors.
INTERVAL = 2.0
# Default range: the scene's value divided by and multiplied by this number.
SPAN = 10.0


@dataclass(frozen=True)
class Axis:
    """A parameter with its range and its scale (linear or logarithmic).

    Attributes
    ----------
    key : "table.key" of the scene.
    """

    key: str
    low: float
    high: float

    @classmethod
    def of(cls, scene: Scene, key: str, low: float | None, high: float | None) -> "Axis":
        """Check a key of the scene and its range.

        `low`, `high` None: a tenth and ten times the scene's value, within the key's limits.

        Raises HarvesterError for an unknown key, an empty range, or a value that is invalid in the
        scene.
        """
        value, spec = number(scene, key, "--over")
        ends = sorted((value / SPAN, value * SPAN))
        low = max(ends[0], spec.low) if low is None else low
        high = min(ends[1], spec.high) if high is None else high
        if not low < high:
            raise HarvesterError(
                f"{key}: the range {low:g} to {high:g} is empty; give it as LOW:HIGH"
            )
        for end in (low, high):
            scene.replace({key: end})
        return cls(key, low, high)

    def own(self, scene: Scene) -> float:
        """The parameter's value in the scene."""
        return number(scene, self.key, "--over")[0]

    @property
    def logarithmic(self) -> bool:
        """Whether the scale is logarithmic."""
        return self.low > 0.0 and self.high / self.low >= LOGARITHMIC

    def coordinate(self, value: float) -> float:
        """Normalised coordinate of a value: 0 at the lower end of the range, 1 at the upper end."""
        if self.logarithmic:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def value(self, coordinate: float) -> float:
        """The parameter at a normalised coordinate."""
        if self.logarithmic:
            return float(self.low * (self.high / self.low) ** coordinate)
        return float(self.low + coordinate * (self.high - self.low))

    def slope(self, coordinate: float) -> float:
        """Derivative of the parameter with respect to the coordinate."""
        if self.logarithmic:
            return self.value(coordinate) * math.log(self.high / self.low)
        return self.high - self.low


@dataclass(frozen=True)
class OptimalParameter:
    """One parameter at a maximum.

    Attributes
    ----------
    standard_error
        Standard error of the optimum, if a curve was fitted.
    flat_low, flat_high : float
        Range of this parameter, with the others constant, in which the quantity is not
        significantly more than 1 % below the maximum; NaN if the runs are too short to decide, or
        it was not computed.
    open_low, open_high
        Whether the flat region extends to the end of the range.
    """

    axis: Axis
    place: float
    standard_error: float | None = None
    flat_low: float = math.nan
    flat_high: float = math.nan
    open_low: bool = False
    open_high: bool = False

    @property
    def is_narrow(self) -> bool:
        """Whether the flat region is a small share of the range."""
        width = self.axis.coordinate(self.flat_high) - self.axis.coordinate(self.flat_low)
        return bool(width < NARROW)
