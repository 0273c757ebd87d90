"""Estimates and densities with their standard errors."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.arguments import no_attribute
from harvester.base.errors import HarvesterError
from harvester.base.formatting import with_error
from harvester.base.numbers import is_real
from harvester.base.plain_text import shown
from harvester.base.serialising import LEFT_OUT, plain

NONE_SEEN = "no event: no error bar for the rate"
NOTHING_PUT_IN = "no energy input"
TOO_SHORT = "too short for an error bar: raise run.duration or run.realizations"
NO_VALUE = "no number: the averaged quantity is not finite at some time of the run"
# A rectifier's output voltage in ngspice is accurate to this share (Newton's iterations).
RESOLVED_SHARE = 1e-6
UNRESOLVED = f"below the solver's tolerance, {RESOLVED_SHARE:g} of the output voltage"
ROUNDED_OFF = "below the solver's resolution of the load's powers"
NO_OUTPUT = "the output has no resistor and no measure"
STARTS_CHARGED = "the output starts charged"
NOT_STARTED = "the output did not start"
# These reasons take precedence over `TOO_SHORT`.
OF_THE_VALUE = (NO_VALUE, UNRESOLVED, ROUNDED_OFF, NO_OUTPUT, STARTS_CHARGED, NOT_STARTED)
# Format specifications of text have only fill, alignment and width; all others are for numbers.
OF_TEXT = re.compile(r"(.?[<>^])?([1-9]\d*)?s?")
_IN_JSON = ("estimate", "standard_error", "effective_sample_size")


@dataclass(frozen=True, repr=False)
class Estimate:
    """A mean with its evidence, in scaled units or the units of `dimension`.

    `float(estimate)` and `numpy.asarray(estimates, float)` are the values without errors, for
    computing and drawing; `result.to_dataframe()` has columns of values and standard errors.

    Attributes
    ----------
    standard_error : None if the run is too short for it.
    effective_sample_size
        Number of independent samples, or events of a rate, that would give this error. None if the
        variance of the averaged quantity is not stored: ratios of a load's powers, rates of change.
    dimension : "voltage^2", "power", "1", "rate", …
    note
        Reason for a missing error bar; else empty.
    unit
        Unit of the estimate, for printing; empty in scaled units.
    """

    estimate: float
    standard_error: float | None
    effective_sample_size: float | None
    dimension: str
    note: str = ""
    unit: str = field(default="", compare=False, metadata=LEFT_OUT)

    if not TYPE_CHECKING:

        def __getattr__(self, name):
            raise no_attribute("an Estimate has no attribute", name, self.__dataclass_fields__)

    def __float__(self) -> float:
        return float(self.estimate)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """The value alone, so that numpy and matplotlib take lists of estimates."""
        return np.array(float(self), dtype)

    def __repr__(self) -> str:
        return with_error(self, self.unit)

    def __format__(self, spec: str) -> str:
        if OF_TEXT.fullmatch(spec):
            return format(str(self), spec)
        try:
            return format(float(self), spec)
        except ValueError as error:
            raise self._refused(f", format {shown(spec)}: {error}") from None

    def __mul__(self, factor: Any) -> Estimate:
        """Multiply; the product has no unit, since the factor may convert it."""
        return self.times(factor) if is_real(factor) else self._no_result(factor)

    def __add__(self, number: Any) -> Estimate:
        """Add a number in the estimate's unit; the error is unchanged."""
        if not is_real(number):
            self._no_result(number)
        return replace(self, estimate=self.estimate + number)

    def __sub__(self, number: Any) -> Estimate:
        return self + -number if is_real(number) else self._no_result(number)

    def __rsub__(self, number: Any) -> Estimate:
        return -self + number

    def __neg__(self) -> Estimate:
        return self.times(-1.0, self.unit)

    def __truediv__(self, divisor: Any) -> Estimate:
        return self * (1.0 / divisor) if is_real(divisor) else self._no_result(divisor)

    def __array_ufunc__(self, function: Any, method: str, *values: Any, **options: Any) -> Any:
        """Support numpy numbers and arrays as left operands of + - *, reject other functions."""
        operators = {np.multiply: self.__mul__, np.add: self.__add__, np.subtract: self.__rsub__}
        if function not in operators or method != "__call__" or values[0] is self:
            raise self._refused(f", numpy.{function.__name__}")
        if not np.ndim(values[0]):
            return operators[function](values[0])
        return np.vectorize(operators[function], otypes=[object])(values[0])

    def _no_result(self, *others: Any) -> Any:
        """Reject operations without an error bar, as estimates on the same noise are correlated."""
        raise self._refused(f" and {others[0]}" if others else "")

    def _refused(self, operation: str) -> HarvesterError:
        return HarvesterError(
            f"{self}{operation}: an Estimate combines with numbers alone, by + - * /; compute and "
            "compare with float(…), numpy.asarray(list, float), or .estimate and .standard_error "
            "(errors on the same noise are correlated: harvester.paired_difference compares two "
            "results)"
        )

    __rmul__, __radd__ = __mul__, __add__
    __rtruediv__ = __pow__ = __rpow__ = _no_result
    __lt__ = __le__ = __gt__ = __ge__ = __pos__ = __abs__ = __round__ = _no_result

    def times(self, factor: float, unit: str = "") -> Estimate:
        """The estimate in a unit that is smaller by this factor."""
        error = self.standard_error
        return replace(
            self,
            estimate=self.estimate * factor,
            standard_error=None if error is None else error * abs(factor),
            unit=unit,
        )

    def to_dict(self, unit: str | None = None) -> dict[str, Any]:
        """Plain values for JSON, with `unit` if given; NaN and missing errors become null."""
        content = {name: getattr(self, name) for name in _IN_JSON}
        if unit is not None:
            content["unit"] = unit
        return plain({**content, "note": self.note} if self.note else content)


@dataclass(frozen=True)
class Density:
    """Histogram density: bin centres, density and its standard error, each of shape (n,)."""

    centre: np.ndarray
    density: np.ndarray
    standard_error: np.ndarray | None
    dimension: str


def why_no_error(estimate: float, error: float | None) -> str:
    """Reason for a missing error bar; empty if the estimate has one."""
    if error is not None:
        return ""
    return TOO_SHORT if math.isfinite(estimate) else NO_VALUE


def root(square: Estimate) -> Estimate:
    """RMS value and its error from a mean square."""
    root = math.sqrt(square.estimate)
    error = square.standard_error
    if error is not None:
        error = 0.5 * error / root if root > 0.0 else 0.0
    dimension = square.dimension.removesuffix("^2")
    unit = square.unit.removesuffix("^2").strip("()")
    return Estimate(root, error, square.effective_sample_size, dimension, square.note, unit)


def with_roots(quantities: Mapping[str, Estimate]) -> dict[str, Estimate]:
    """The quantities; each mean square is followed by its root (rms)."""
    extended: dict[str, Estimate] = {}
    for name, estimate in quantities.items():
        extended[name] = estimate
        of_root = name.replace("mean_square", "rms")
        if of_root not in quantities and estimate.estimate >= 0.0:
            extended[of_root] = root(estimate)
    return extended
