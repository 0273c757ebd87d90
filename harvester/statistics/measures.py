"""Quantities from a load file's `* measure:` lines: losses of stages, states, events.

Shares are relative to the mechanical input. The shares of all losses, outputs, stores and the
device's losses add up to 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from circuits.netlist.kinds import LOSS, OUTPUT, STATE, STORE, TAKEN
from harvester.statistics.batch_means import (
    FEWEST_BATCHES,
    complete_batches,
    independent_events,
    ratio_estimate,
)
from harvester.statistics.estimate import NO_VALUE, TOO_SHORT, Estimate
from harvester.statistics.moments import QUANTITIES, Moments
from harvester.statistics.output_moments import MEASURED

SECONDS_PER_HOUR = 3600.0
# Up to this number of events, the error of their number assumes independent events.
FEW_EVENTS = 10
UNCHANGED = "the state never changed: no error bar for the rate of changes"
INTEGRAL, CHANGE, RISES, FALLS, SQUARE = range(len(MEASURED))


def estimate_measures(
    moments: Sequence[Moments],
    error_of: Callable,
    error_of_change: Callable,
) -> dict[str, Estimate]:
    """Quantities of the measures of a load with an output, scaled.

    A loss gives `NAME_loss` and `NAME_loss_share`, an output `NAME_power` and `NAME_power_share`, a
    store `NAME_storage_power`. A state gives `NAME_time_share`, `NAME_first_time` (from the run's
    beginning), `NAME_starts_per_hour` and `NAME_stops_per_hour`. A state that takes a power also
    gives the energy per event, `NAME_energy`. `error_of_change` is for stores.
    """
    batches, output = complete_batches(moments), moments[0].output
    if batches is None or output is None:
        return {}
    estimates: dict[str, Estimate] = {}
    for row, (kind, name) in enumerate(output.rows):
        if kind not in _QUANTITIES:
            continue
        series = measured_series(moments, row)
        error = error_of_change if kind == STORE else error_of
        estimates.update(_QUANTITIES[kind](name, series, batches, moments, row, error))
    return estimates


def measured_series(moments: Sequence[Moments], row: int) -> np.ndarray:
    """Sums of one measure over complete batches, shape (realizations, batches, len(MEASURED))."""
    batches = complete_batches(moments)
    count = 0 if batches is None else batches.shape[1]
    outputs = [realization.output for realization in moments if realization.output is not None]
    return np.stack([output.measured[:count, row] for output in outputs])


def without_value(moments: Sequence[Moments]) -> list[tuple[str, str]]:
    """Kind and name of the measures that are not finite at some time of the run."""
    output = moments[0].output if moments else None
    if output is None or complete_batches(moments) is None:
        return []
    return [
        rows
        for row, rows in enumerate(output.rows)
        if not np.isfinite(measured_series(moments, row)[:, :, INTEGRAL]).all()
    ]


def _power(suffix):
    def quantities(name, series, batches, moments, row, error_of):
        energy, squares = series[:, :, INTEGRAL], series[:, :, SQUARE]
        power = ratio_estimate(energy, _time(batches), "power", squares=squares, error_of=error_of)
        yield f"{name}_{suffix}", power
        put_in = batches[:, :, QUANTITIES.index("input_power")]
        yield f"{name}_{suffix}_share", ratio_estimate(energy, put_in, "1", error_of=error_of)

    return quantities


def _store(name, series, batches, moments, row, error_of):
    change = series[:, :, CHANGE]
    power = ratio_estimate(change, _time(batches), "power", error_of=error_of)
    yield f"{name}_storage_power", power


def _state(name, series, batches, moments, row, error_of):
    squares = series[:, :, SQUARE]
    share = ratio_estimate(
        series[:, :, INTEGRAL], _time(batches), "1", squares=squares, error_of=error_of
    )
    if share.note != NO_VALUE and not series[:, :, [RISES, FALLS]].any():
        share = Estimate(share.estimate, None, None, "1", UNCHANGED)
    yield f"{name}_time_share", share
    if share.note == NO_VALUE:
        yield f"{name}_first_time", replace(share, dimension="time")
        for event in ("starts", "stops"):
            yield f"{name}_{event}_per_hour", replace(share, dimension="hourly_rate")
        return
    yield f"{name}_first_time", _first([realization.output.first[row] for realization in moments])
    yield f"{name}_starts_per_hour", _hourly(series[:, :, RISES], _time(batches))
    yield f"{name}_stops_per_hour", _hourly(series[:, :, FALLS], _time(batches))


def _event_energy(name, series, batches, moments, row, error_of):
    """Energy per event: integral of the power taken in a state over the number of its ends.

    The state's row of sums precedes this one.
    """
    state = measured_series(moments, row - 1)
    if not np.isfinite(state[:, :, INTEGRAL]).all():
        yield f"{name}_energy", Estimate(math.nan, None, None, "energy", NO_VALUE)
        return
    times, energy = state[:, :, FALLS], series[:, :, INTEGRAL]
    energy_per_event = ratio_estimate(energy, times, "energy", "no event", error_of=error_of)
    yield f"{name}_energy", energy_per_event


_QUANTITIES = {
    OUTPUT: _power("power"),
    LOSS: _power("loss"),
    STORE: _store,
    STATE: _state,
    TAKEN: _event_energy,
}


def _time(batches):
    return batches[:, :, QUANTITIES.index("time")]


def _hourly(events, time):
    """Events per hour; the error for few events assumes that they are independent."""
    estimate = ratio_estimate(events, time / SECONDS_PER_HOUR, "hourly_rate")
    count, error = float(events.sum()), estimate.standard_error
    if count < FEW_EVENTS:
        independent = math.sqrt(max(count, 1.0)) * SECONDS_PER_HOUR / float(time.sum())
        error = max(error or 0.0, independent)
    size = independent_events(estimate.estimate, error)
    return Estimate(estimate.estimate, error, size, "hourly_rate", "" if error else TOO_SHORT)


def _first(times):
    """Mean over the realizations that reached the state; an error bar only if all did."""
    reached = [time for time in times if math.isfinite(time)]
    if not reached:
        return Estimate(math.nan, None, None, "time", "never")
    mean = float(np.mean(reached))
    if len(reached) < len(times):
        note = f"mean over {len(reached)} of {len(times)} realizations that reached the state"
        return Estimate(mean, None, None, "time", note)
    if len(reached) < FEWEST_BATCHES:
        note = f"of {len(reached)} realizations: too few for an error bar"
        return Estimate(mean, None, None, "time", note)
    error = float(np.std(reached, ddof=1)) / math.sqrt(len(reached))
    return Estimate(mean, error, len(reached), "time")
