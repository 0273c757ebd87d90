"""Evaluate one point of a load study: simulate until its power is precise, and estimate."""

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from harvester.averaging.method import Stationary
from harvester.base.errors import HarvesterError
from harvester.base.method import Method
from harvester.device.record import Record
from harvester.engines.methods import Engine
from harvester.engines.orbits import followed
from harvester.engines.outcome import LARGEST_RESIDUAL
from harvester.engines.realizations import Realizations, averaging
from harvester.engines.request import (
    COMPLETE,
    FIRST_REALIZATIONS,
    answers_before_failure,
    in_rounds,
    in_units,
    not_balanced,
    note_on_steps,
    residual_notes,
    sampling_error_budget,
    told,
)
from harvester.engines.task import Wanted
from harvester.scene.model import Scene
from harvester.scene.paths import distinct_realizations
from harvester.scene.prepared import Prepared, prepared
from harvester.scene.steps import step_error
from harvester.statistics.batch_means import complete_batches
from harvester.statistics.moments import Moments
from harvester.statistics.output_side import USED
from harvester.statistics.paired import sums
from harvester.statistics.passivity import SUPPLIED, fed_by_stores
from harvester.statistics.run_estimates import run_estimates
from harvester.statistics.settling import withheld
from harvester.studies.sweep import Cell

# Dimensions of a record's columns; all other columns are powers.
WAVEFORM = {
    "time": "time",
    "displacement": "displacement",
    "velocity": "velocity",
    "voltage": "voltage",
    "load_power": "power",
}
POWER = "output_power"


# An output counts as supplied by the load's sources if at most this share of its power is
# harvested.
LEAST_HARVESTED = 0.01
# Maximum number of realizations of a point if a precision is requested.
MOST_REALIZATIONS = 4000


@dataclass(frozen=True)
class Evaluation(Cell):
    """The result at one point of a load study.

    Its estimates also have `output_power`: the power into the load's output or, without a DC side,
    the power that leaves the transducer.

    Attributes
    ----------
    series : ndarray, shape (realizations, batches), or None
        Output power of each batch, in the scene's units.
    power_error : float
        Standard error of the output power; NaN if there is none. It is given even if `estimates`
        withholds it because the run is too short for slow quantities.
    waveform
        Beginning of the first realization, with rows as in `Record`, in the scene's units.
    """

    series: np.ndarray | None = field(default=None, repr=False)
    power_error: float = math.nan
    waveform: np.ndarray | None = field(default=None, repr=False)

    @property
    def power(self) -> float:
        """Output power; NaN if there is none."""
        return self.estimates[POWER].estimate if POWER in self.estimates else math.nan

    @property
    def unranked(self) -> str:
        """Reason why the power is not ranked, since the device does not feed the output; else
        empty.
        """
        if self.is_supplied:
            sources = (name for name in self.estimates if name.startswith(SUPPLIED))
            names = ", ".join(name.removeprefix(SUPPLIED) for name in sources)
            return f"{names} in the load supplies the output's whole power: nothing is harvested"
        if fed_by_stores(self.estimates):
            return "the load's stores supply part of the output: raise run.settle or run.duration"
        return "no power reaches its output" if self.power <= 0.0 else ""

    @property
    def is_supplied(self) -> bool:
        """Whether the load's sources supply all the power used at the output."""
        used = self.estimates.get(USED)
        return used is not None and self.power <= LEAST_HARVESTED * used.estimate

    @property
    def ranked_power(self) -> float:
        """Output power for ranking; NaN if it is not harvested."""
        return math.nan if self.unranked else self.power

    @property
    def relative_error(self) -> float:
        """Relative error of the output power; infinite without an error bar."""
        share = self.power_error / abs(self.power) if self.power else math.nan
        return math.inf if math.isnan(share) else share


def evaluating(
    scene: Scene, method: Method, version: str, precision: float | None
) -> Generator[Wanted, list, Evaluation]:
    """Generator for `Runner.follow` that returns the evaluation of one point.

    Parameters
    ----------
    method
        Engine or stationary method.
    version : see `harvester.engines.runner.Runner.version`.
    precision : float or None
        Target relative error of the output power, including the step error; None: use the scene's
        number of realizations.
    """
    prepared_scene = prepared(scene)
    if isinstance(method, Stationary):
        answers = yield Wanted([averaging(scene, method)])
        return _evaluate(prepared_scene, method.name, *answers_before_failure(answers))
    if not isinstance(method, Engine):
        raise TypeError(f"{method} is neither an engine nor a stationary method")
    cut = Realizations.of(prepared_scene, method, version, waveform=True)
    cost = step_error(prepared_scene, method.step, method.name)

    def judge(answers_so_far, ended):
        evaluation = _evaluate(prepared_scene, method.name, answers_so_far, ended, cost)
        # More realizations do not improve a power that is not harvested.
        unknown = evaluation.realizations and not evaluation.is_supplied
        return evaluation, evaluation.relative_error if unknown else 0.0

    most = MOST_REALIZATIONS if precision else distinct_realizations(prepared_scene)
    first = FIRST_REALIZATIONS if precision else most
    aim = sampling_error_budget(precision, cost) if precision else None
    evaluation = yield from in_rounds(cut, first, most, aim, judge)
    note = note_on_steps(precision, cost) if precision and evaluation.realizations else ""
    return replace(evaluation, notes=(*evaluation.notes, note)) if note else evaluation


def _evaluate(prepared_scene, method, answers, ended, cost=0.0):
    """Evaluate the answers at one point.

    Parameters
    ----------
    answers
        Answers of the point's tasks, in the order of their realizations.
    ended
        Reason why later answers are missing; "" if none are.
    cost
        Relative error of a power due to the step; see `harvester.scene.steps.step_error`.
    """
    scales = prepared_scene.scales
    if not answers:
        words = told(ended) if isinstance(ended, HarvesterError) else f"no run: {ended}"
        return Evaluation(method, words)
    if "quantities" in answers[0]:
        estimates = in_units(answers[0]["quantities"], scales)
        mean = estimates["mean_power"]
        power_error = _or_nan(mean.standard_error)
        return Evaluation(method, COMPLETE, {**estimates, POWER: mean}, power_error=power_error)
    prepared_scene, moments, orbits, on_orbits = followed(prepared_scene, answers, cost)
    run = run_estimates(prepared_scene, moments, cost)
    if not abs(run.residual) <= LARGEST_RESIDUAL:
        return Evaluation(method, told(not_balanced(run.residual)))
    series = power_series(run.moments, scales.power)
    name = "mean_output_power" if moments[0].has_output else "mean_power"
    estimates = in_units(run.whole, scales)
    power = estimates[name]
    estimates = withheld({**estimates, POWER: power}, run.shortfalls)
    estimates[name] = estimates[POWER]
    why = power.note if power.standard_error is None and not run.shortfalls else ""
    reason = (f"output power: {why}",) if why else ()
    notes = (*on_orbits, *run.notes, *residual_notes(run.residual), *reason)
    outcome = COMPLETE
    if isinstance(ended, HarvesterError):
        outcome, notes = f"ended after {len(moments)} realizations: {told(ended)}", ()
    waveform = answers[0]["waveform"]
    if waveform is not None:
        factors = [scales.of(WAVEFORM.get(name, "power")) for name in Record._fields]
        waveform = waveform * np.array(factors)[:, None]
    return Evaluation(
        method=method,
        outcome=outcome,
        estimates=estimates,
        series=series,
        realizations=len(moments),
        orbits=orbits,
        notes=notes,
        power_error=_or_nan(power.standard_error),
        waveform=waveform,
    )


def series_of(prepared_scene: Prepared, answers: Sequence[dict]) -> np.ndarray | None:
    """Output power of a point's tasks by batch, in the scene's units, or None.

    Several realizations without noise are replaced by the mean over those on the followed orbit.
    """
    if not answers:
        return None
    moments = followed(prepared_scene, answers, 0.0).moments
    series = power_series(moments, prepared_scene.scales.power)
    return series if prepared_scene.scene.excitation.random else series.mean(axis=0, keepdims=True)


def power_series(moments: Sequence[Moments], unit: float) -> np.ndarray:
    """Output power by batch, shape (realizations, batches), whose mean is the estimate."""
    if complete_batches(moments) is None:
        raise HarvesterError("no realization is long enough for one batch: raise run.duration")
    energy, time = sums(moments, "mean_output_power" if moments[0].has_output else "mean_power")
    mean = energy.sum() / time.sum()
    return unit * (mean + (energy - mean * time) / time.mean())


def _or_nan(error):
    return math.nan if error is None else error
