"""Total error over wall time: what a method's bias and its sampling error make together.

After a wall time t a mean is off by √(b² + s² c/t): b the method's bias, s²/T the sampling variance
of a run of T simulated seconds, c the wall seconds that one of them costs. Seconds are counted as
time of one processor: the wall time on a machine that does nothing else.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from harvester.base.serialising import plain
from harvester.results.paired import deviations
from harvester.statistics.batch_means import standard_error
from harvester.statistics.estimate import TOO_SHORT, Estimate
from harvester.validation.timed import Timed

# Relative errors for which the time is given.
LIMITS = (0.1, 0.03, 0.01)
# A bias within so many standard errors may be zero, and may be larger by as many.
BIAS_SIGMAS = 2.0


@dataclass(frozen=True)
class TotalError:
    """One method's error in one quantity over wall time.

    Attributes
    ----------
    bias : Estimate
        Bias as a share of the reference's mean; no standard error where the runs are too short.
    scatter : float
        Relative standard error of the mean times the root of the simulated time (√s).
    cost : float
        Seconds of one core for one measured second, settling included.
    """

    bias: Estimate
    scatter: float
    cost: float

    @property
    def resolved_bias(self) -> float:
        """|bias| without what its own error bar explains: √(b² − σ²), 0 where that is all.

        nan without an error bar.
        """
        error = self.bias.standard_error
        if error is None:
            return math.nan
        return math.sqrt(max(self.bias.estimate**2 - error**2, 0.0))

    @property
    def largest_bias(self) -> float:
        """Upper bound of |bias|: two standard errors above it; infinite without an error bar."""
        error = self.bias.standard_error
        return math.inf if error is None else abs(self.bias.estimate) + BIAS_SIGMAS * error

    def after(self, seconds: float | np.ndarray) -> float | np.ndarray:
        """Total error after a wall time; `seconds` a float or an array of any shape."""
        return np.sqrt(self.resolved_bias**2 + self.scatter**2 * self.cost / seconds)

    def seconds_to(self, limit: float) -> float:
        """Wall time to a total error; infinite where the bias alone is larger, nan if unknown."""
        left = limit**2 - self.resolved_bias**2
        if math.isnan(left):
            return math.nan
        return self.scatter**2 * self.cost / left if left > 0.0 else math.inf

    def is_shown(self, limit: float) -> bool:
        """Whether even the upper bound of the bias is within this error."""
        return self.largest_bias <= limit

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, with what is read off at each of `LIMITS`."""
        content = {
            "bias": self.bias.estimate,
            "standard_error": self.bias.standard_error,
            "scatter": self.scatter,
            "seconds_to": {f"{limit:g}": self.seconds_to(limit) for limit in LIMITS},
            "shown": {f"{limit:g}": self.is_shown(limit) for limit in LIMITS},
        }
        return plain(content)


def scatter_of(run: Timed, name: str) -> float:
    """Relative standard error times the root of the simulated time; nan without an error bar."""
    estimate = run.quantities()[name]
    if estimate.standard_error is None or not estimate.estimate:
        return math.nan
    return abs(estimate.standard_error / estimate.estimate) * math.sqrt(run.measured_time)


def bias_of(name: str, run: Timed, reference: Timed) -> Estimate:
    """A method's bias, from its own run and the reference's longer one on the same noise.

    The reference's realizations on the noise of the method's own serve as control variate: with α
    the slope of the batches of one on the other's, m − α m' + (α − 1) M estimates the bias, m' the
    reference's mean over these realizations and M that over all of its own. α is 1 while paths
    stay together, and 0 where they part at once.

    Parameters
    ----------
    name : str
        Name of the quantity.

    Returns
    -------
    Estimate
        As a share of the reference's mean.
    """
    count = min(len(run.moments), len(reference.moments))
    estimates = (run.quantities(count), reference.quantities(count), reference.quantities())
    mean, paired, overall = (quantities[name] for quantities in estimates)
    run_deviations = deviations(run.moments[:count], name)
    common = deviations(reference.moments[:count], name)
    square = float(np.sum(common**2))
    slope = float(np.sum(run_deviations * common)) / square if square > 0.0 else 0.0
    slope = min(max(slope, 0.0), 1.0)
    bias = mean.estimate - slope * paired.estimate - (1.0 - slope) * overall.estimate
    error, far = standard_error(run_deviations - slope * common), overall.standard_error
    if error is None or far is None:
        return Estimate(bias / overall.estimate, None, None, "1", TOO_SHORT)
    error = math.hypot(error, (1.0 - slope) * far)
    return Estimate(bias / overall.estimate, error / abs(overall.estimate), None, "1")
