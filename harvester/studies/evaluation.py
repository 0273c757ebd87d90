"""From the realizations of one point to its quantities with error bars."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from harvester.errors import HarvesterError
from harvester.estimates.batch_means import complete_batches
from harvester.estimates.estimate import Estimate
from harvester.estimates.of_run import run_estimates, with_steps
from harvester.estimates.settling import withheld
from harvester.prepared.prepared import prepared
from harvester.record.moments import Moments
from harvester.record.record import Record
from harvester.results.paired import sums
from harvester.running.request import COMPLETE, in_units, not_balanced, residual_notes, told
from harvester.scene.model import Scene
from harvester.simulation.outcome import LARGEST_RESIDUAL

# Dimensions of a record's columns; the others are powers.
WAVEFORM = {
    "time": "time",
    "displacement": "displacement",
    "velocity": "velocity",
    "voltage": "voltage",
    "load_power": "power",
}
POWER = "output_power"


@dataclass(frozen=True)
class Evaluation:
    """What a point has come to.

    Attributes
    ----------
    outcome : str
        "complete", or what went wrong.
    estimates : dict of str to Estimate
        In the scene's units; `output_power` is the power into the load's output, or, without a
        DC side, what leaves the piezo.
    series : ndarray, shape (realizations, batches), or None
        Output power, in the scene's units.
    realizations : int
    power_error : float
        Standard error of the output power, nan where there is none, also where `estimates`
        withholds it for a run too short for what is slow.
    waveform : ndarray or None
        Beginning of the first realization, rows as in `Record`, in the scene's units.
    """

    outcome: str
    estimates: dict[str, Estimate] = field(default_factory=dict)
    series: np.ndarray | None = field(default=None, repr=False)
    realizations: int = 0
    power_error: float = math.nan
    waveform: np.ndarray | None = field(default=None, repr=False)

    @property
    def power(self) -> float:
        """Output power, nan where there is none."""
        return self.estimates[POWER].estimate if POWER in self.estimates else math.nan

    @property
    def relative_error(self) -> float:
        """Of the output power; infinite without an error bar."""
        share = self.power_error / abs(self.power) if self.power else math.nan
        return math.inf if math.isnan(share) else share


def evaluate(
    scene: Scene,
    good: Sequence[dict],
    ended: HarvesterError | str,
    step_error: float = 0.0,
) -> Evaluation:
    """Quantities of one point.

    Parameters
    ----------
    scene : Scene
    good : sequence of dict
        Answers of its tasks, in the order of their realizations.
    ended : HarvesterError or str
        What came instead of the next ones; "" where all came.
    step_error : float
        See `harvester.estimates.of_run.run_estimates`.

    Returns
    -------
    Evaluation
    """
    scales = prepared(scene).scales
    if not good:
        words = told(ended) if isinstance(ended, HarvesterError) else f"nothing was run: {ended}"
        return Evaluation(words)
    if "quantities" in good[0]:
        estimates = in_units(good[0]["quantities"], scales)
        mean = estimates["mean_power"]
        error = _or_nan(mean.standard_error)
        return Evaluation(COMPLETE, {**estimates, POWER: mean}, power_error=error)
    moments = [each for part in good for each in part["moments"]]
    found = run_estimates(scene, moments, step_error)
    if not abs(found.residual) <= LARGEST_RESIDUAL:
        return Evaluation(told(not_balanced(found.residual)))
    outcome = "; ".join([COMPLETE, *found.notes, *residual_notes(found.residual)])
    if isinstance(ended, HarvesterError):
        outcome = f"ended after {len(moments)} realizations: {told(ended)}"
    series = power_series(found.moments, scales.power)
    power = Estimate(float(series.mean()), found.error(series), None, "power")
    power = with_steps(scene, power, step_error)
    estimates = in_units(found.whole, scales)
    estimates[POWER] = power
    return Evaluation(
        outcome=outcome,
        estimates=withheld(estimates, found.shortfalls),
        series=series,
        realizations=len(moments),
        power_error=_or_nan(power.standard_error),
        waveform=_waveform_in_units(good[0]["waveform"], scales),
    )


def series_of(scene: Scene, good: Sequence[dict]) -> np.ndarray | None:
    """Output power of a point's tasks batch by batch, in the scene's units, or None."""
    moments = [each for part in good for each in part["moments"]]
    return power_series(moments, prepared(scene).scales.power) if moments else None


def power_series(moments: Sequence[Moments], unit: float) -> np.ndarray:
    """Output power batch by batch, shape (realizations, batches), whose mean is the estimate."""
    if complete_batches(moments) is None:
        raise HarvesterError("no realization has a complete batch: raise run.duration")
    energy, time = sums(moments, "mean_output_power" if moments[0].has_output else "mean_power")
    mean = energy.sum() / time.sum()
    return unit * (mean + (energy - mean * time) / time.mean())


def _or_nan(error):
    return math.nan if error is None else error


def _waveform_in_units(waveform, scales):
    if waveform is None:
        return None
    factors = [scales.of(WAVEFORM.get(name, "power")) for name in Record._fields]
    return waveform * np.array(factors)[:, None]
