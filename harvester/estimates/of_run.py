"""From the moments of a run to its estimates, with notes on what the run is too short for."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from harvester.errors import SceneError
from harvester.estimates.balance import energy_balance_residual
from harvester.estimates.batch_means import (
    complete_batches,
    duration_for_error,
    error_of_starts,
    error_without_chance,
    measured_time,
    standard_error,
    standard_error_of_drift,
)
from harvester.estimates.estimate import TOO_SHORT
from harvester.estimates.means import estimate_all
from harvester.estimates.measures import without_value
from harvester.estimates.output_side import estimate_output
from harvester.estimates.passivity import (
    efficiency_notes,
    faint_output_notes,
    source_notes,
)
from harvester.estimates.settling import Shortfall, shortfalls, slow_exchange, withheld
from harvester.estimates.strain import estimate_strain, strain_notes
from harvester.estimates.units import unit_of
from harvester.estimates.well_balance import weighted, well_balance
from harvester.record.moments import QUANTITIES

if TYPE_CHECKING:
    from harvester.estimates.estimate import Estimate
    from harvester.estimates.well_balance import WellBalance
    from harvester.prepared.prepared import Prepared
    from harvester.record.moments import Moments
    from harvester.scene.model import Scene

# Fewest periods of a deterministic excitation whose means show how they differ.
FEWEST_PERIODS = 2


@dataclass(frozen=True)
class RunEstimates:
    """Scaled estimates of a run, and what to know before citing one.

    Attributes
    ----------
    whole : dict of str to Estimate
        All estimates, each with its error bar.
    shortfalls : list of Shortfall
        The relaxations for which the run was too short.
    residual : float
        Residual of the energy balance, as a share of the energy put in.
    notes : tuple of str
        Notes on sources in the load, efficiencies above 1 and the shortfalls.
    moments : list of Moments
        Moments, weighted by `harvester.estimates.well_balance` where wells differ.
    error : callable
        The error of a mean from batches of these.
    balance : WellBalance or None
        Balance of the jumps between wells, where these differ.
    """

    whole: dict[str, Estimate]
    shortfalls: list[Shortfall]
    residual: float
    notes: tuple[str, ...]
    moments: list[Moments] = field(repr=False)
    error: Callable = field(repr=False)
    balance: WellBalance | None = field(repr=False)

    @property
    def scaled(self) -> dict[str, Estimate]:
        """The estimates, without the error bars that would be too small."""
        return withheld(self.whole, self.shortfalls)


def run_estimates(
    ready: Prepared, moments: Sequence[Moments], step_error: float = 0.0
) -> RunEstimates:
    """Estimates from the moments of a scene's realizations.

    Parameters
    ----------
    ready : Prepared
    moments : sequence of Moments
    step_error : float
        Share that the steps may cost, see `harvester.prepared.steps.step_error`: where nothing is
        by chance it is part of the error.

    Raises
    ------
    SceneError
        No step of the run lies in its measured time.
    """
    scene, system, scales = ready.scene, ready.system, ready.scales
    moments = list(moments)
    if not measured_time(moments) > 0.0:
        raise SceneError(
            f"{scene.name}: run.duration = {scene.run.duration:g}: no whole step lies in it; "
            "raise it to some periods of the motion"
        )
    balance = well_balance(scene, system, moments)
    balanced = weighted(moments, balance)
    error = balance.error if balance else error_of(scene)
    whole = estimate_all(balanced, system, error) | estimate_output(balanced, error)
    whole |= estimate_strain(balanced, scene.excitation, error)
    whole = {name: with_steps(scene, each, step_error) for name, each in whole.items()}
    found = shortfalls(ready, moments, whole, balance)
    notes = (
        *source_notes(scene.load.circuit),
        *_loose_nodes(scene.load.circuit),
        *_without_value(scene.load.circuit, moments),
        *(scene.load.circuit.reading_notes if scene.load.circuit else ()),
        *efficiency_notes(whole, scales.of("power"), unit_of(scene, "power")),
        *faint_output_notes(whole),
        *strain_notes(scene, moments),
        *(each.note for each in found),
        *slow_exchange(scene, balance),
    )
    residual = energy_balance_residual(moments, system)
    whole = _with_lengths(scene, balanced, whole)
    return RunEstimates(whole, found, residual, notes, balanced, error, balance)


def _with_lengths(scene, moments, whole):
    """The estimates; where one has no error bar, its note names the duration that would give it."""
    batches, period = complete_batches(moments), scene.excitation.period
    if batches is None or all(each.note != TOO_SHORT for each in whole.values()):
        return whole
    series = batches[:, :, QUANTITIES.index("square_voltage")]
    if not scene.excitation.random:
        series = series.mean(axis=0, keepdims=True)
    duration = duration_for_error(series, scene.run.duration)
    if period and not scene.excitation.random:
        duration = FEWEST_PERIODS * period
    note = f"too short for an error bar: set run.duration = {duration:.2g} or more"
    return {
        name: replace(each, note=note) if each.note == TOO_SHORT else each
        for name, each in whole.items()
    }


def _without_value(load, moments):
    """A note on each measure of a load whose expression has no value at some time."""
    names = without_value(moments)
    return tuple(
        f"{measure.where}: measure: {measure.kind} {measure.name} = {measure.expression} has no "
        "finite value at some time of the run, such as the root of a negative number or a quotient "
        "by 0; correct the expression"
        for measure in (load.measures if load else ())
        if any(row in names for row in measure.rows)
    )


def error_of(scene: Scene) -> Callable:
    """The function that gives a mean's standard error from batches, chosen by excitation and
    starts.
    """
    excitation = scene.excitation
    drawn = excitation.random or scene.run.starts is not None
    if excitation.period is not None:
        return partial(error_without_chance, drawn=drawn)
    in_time = standard_error_of_drift if excitation.drifts else standard_error
    if excitation.random:
        return in_time

    def error(series: np.ndarray) -> float | None:
        # All starts meet the same stretch of the excitation.
        common = in_time(series.mean(axis=0, keepdims=True))
        chance = error_of_starts(series) if drawn else 0.0
        return None if common is None else math.hypot(common, chance)

    return error


def with_steps(scene: Scene, estimate: Estimate, step_error: float) -> Estimate:
    """For a periodic excitation, add the step error to the error bar and drop the sample size."""
    if scene.excitation.period is None or scene.excitation.random:
        return estimate
    error = estimate.standard_error
    if error is not None:
        error = math.hypot(error, step_error * abs(estimate.estimate))
    return replace(estimate, standard_error=error, effective_sample_size=None)


def _loose_nodes(load):
    """A note on nodes of a load that lead nowhere: a misspelt name makes such."""
    if load is None or not load.loose_nodes:
        return ()
    more = " …" if load.loose_nodes[3:] else ""
    return (f"nothing else is connected to the node {', '.join(load.loose_nodes[:3])}{more}",)
