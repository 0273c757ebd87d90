"""Distance of a load's capacitors and coils from their steady state at the end of a run.

The averaged charges obey C d⟨y⟩/dt + G (⟨y⟩ − y∞) = 0 with G linearised about the means: the
distance from y∞ is G⁻¹ C times the remaining rate of change of the mean, for any circuit. A diode
that blocks on average counts as blocking, so this is an upper estimate. If the rate decays during
the run, the distance follows from its decay.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from circuits.netlist.kinds import LEVEL
from circuits.netlist.stores import times_of, weights
from harvester.statistics.batch_means import FEWEST_BATCHES, complete_batches
from harvester.statistics.measures import CHANGE, INTEGRAL, SQUARE, measured_series
from harvester.statistics.moments import QUANTITIES

if TYPE_CHECKING:
    from harvester.scene.prepared import Prepared
    from harvester.statistics.moments import Moments

# The error of a store is relative to its voltage, but at least to this share of the terminal's rms
# voltage.
LEAST_HELD = 0.01
# The charging rates in a run's last two quarters give a time constant if their ratio is below 0.98,
# and the ratio of the two previous quarters agrees to 20 % of its distance from 1.
SLOWEST_DECAY, ALIKE = 0.98, 0.2


@dataclass(frozen=True)
class StoreState:
    """The state of one capacitor or coil of a load over a run.

    Attributes
    ----------
    name, where : as in `circuits.netlist.stores.Store`.
    missing, error
        Distance from the final value, as a share of the value; standard error.
    time
        Relaxation time (s); NaN if it could not be determined.
    memory
        Correlation time of its charge under noise (s).
    spread
        Standard deviation of its charge during the run, as a share of the value.
    """

    name: str
    where: str
    missing: float
    error: float
    time: float
    memory: float
    spread: float = 0.0


def store_states(prepared_scene: Prepared, moments: Sequence[Moments]) -> list[StoreState]:
    """States of the load's stores at the end of a run; empty without stores."""
    batches, load = complete_batches(moments), prepared_scene.scene.load.circuit
    output = moments[0].output
    if batches is None or load is None or output is None:
        return []
    rows = output.rows
    names = [name for kind, name in rows if kind == LEVEL]
    if not names or batches.shape[1] < 2:
        return []
    series = np.stack(
        [measured_series(moments, k) for k, (kind, _) in enumerate(rows) if kind == LEVEL], axis=2
    )
    time = batches[:, :, QUANTITIES.index("time")]
    mean = series[..., INTEGRAL].sum(axis=(0, 1)) / time.sum()
    matrix = _matrix(prepared_scene, dict(zip(names, mean, strict=True)))
    square = batches[:, :, QUANTITIES.index("square_voltage")].sum() / time.sum()
    # The rms terminal voltage in volts, the unit of the levels.
    volts = prepared_scene.scales.voltage * math.sqrt(max(float(square), 0.0))
    levels = _Levels(series, time, mean, LEAST_HELD * volts, prepared_scene.scene.excitation.random)
    held = np.array([weights(store, names) for store in load.stores])
    times = [None] * len(held) if matrix is None else times_of(matrix, held)
    return [
        _state(store, levels, ends, matrix, relaxations)
        for store, ends, relaxations in zip(load.stores, held, times, strict=True)
    ]


class _Levels(NamedTuple):
    """Levels of a run: sums (realizations, batches, names, …), times, means, smallest reference."""

    series: np.ndarray
    time: np.ndarray
    mean: np.ndarray
    least: float
    random: bool


def _matrix(prepared_scene, levels):
    """G⁻¹ C about the means; None if a derivative there is not finite."""
    from circuits.kernel.slow_modes import relaxation

    matrix = relaxation(prepared_scene, levels)
    return matrix if np.isfinite(matrix).all() else None


def _state(store, levels, ends, matrix, times):
    changes = levels.series[..., CHANGE] @ ends
    length = float(levels.time.sum(axis=1).mean())
    rate = changes.sum() / levels.time.sum()
    held, least = abs(float(levels.mean @ ends)), levels.least
    if store.first.startswith("i("):
        squares = levels.series[..., SQUARE].sum(axis=(0, 1)) / levels.time.sum()
        least = LEAST_HELD * math.sqrt(float(squares @ np.abs(ends)))
    # A voltage that oscillates about 0 has no steady mean.
    steady, held = held > least, max(held, least)
    missing, time = (math.inf, math.nan) if levels.random else _by_decay(changes, length)
    memory = math.inf
    if matrix is not None:
        rates = levels.series[..., CHANGE].sum(axis=(0, 1)) / levels.time.sum()
        by_network = float(ends @ matrix @ rates)
        # A variable capacitance is not part of the network.
        if by_network and rate and not abs(missing) < abs(by_network):
            missing, time = by_network, by_network / rate
        memory = float(times.max(initial=0.0))
    if not math.isfinite(missing):
        # Without a time constant, the remaining change is assumed to equal the change in the run.
        missing, time = rate * length, length
    memory = min(memory, _remembered(levels, ends)) if steady else 0.0
    if not held:
        return StoreState(store.name, store.where, 0.0, 0.0, math.nan, 0.0)
    error = _error_of_change(changes, levels.random) / length * abs(time) if rate else 0.0
    missing = math.copysign(missing / held, missing * float(levels.mean @ ends))
    spread = float(np.std((levels.series[..., INTEGRAL] @ ends) / levels.time)) / held
    return StoreState(store.name, store.where, missing, error / held, abs(time), memory, spread)


def _by_decay(changes, length):
    """Missing part and relaxation time (s), from the rate's decay at the run's end; else inf, nan.

    The rates in the last two quarters are extrapolated as a geometric series.
    """
    batches = changes.shape[1]
    mean_changes = changes.sum(axis=0) / len(changes)
    quarter = batches // 4
    if not quarter:
        return math.inf, math.nan
    first, before, last = (
        float(mean_changes[batches - (k + 1) * quarter : batches - k * quarter].sum())
        for k in (2, 1, 0)
    )
    if not (first * before > 0.0 and last * before > 0.0):
        return math.inf, math.nan
    ratio, earlier = last / before, before / first
    if ratio > SLOWEST_DECAY or abs(ratio - earlier) > ALIKE * (1.0 - ratio):
        return math.inf, math.nan
    to_the_end = float(mean_changes @ (np.arange(batches) + 0.5)) / batches
    time = length * quarter / batches / -math.log(ratio)
    return to_the_end + last * ratio / (1.0 - ratio), time


def _remembered(levels, ends):
    """Correlation time (s) of a store's voltage or current, from neighbouring batches."""
    values = (levels.series[..., INTEGRAL] @ ends) / levels.time
    values = values - values.mean()
    total = float((values**2).sum())
    if not total > 0.0:
        return 0.0
    correlation = float((values[:, 1:] * values[:, :-1]).sum()) / total
    correlation *= values.shape[1] / (values.shape[1] - 1.0)
    batch = float(levels.time.mean())
    if correlation >= 1.0:
        return math.inf
    return batch / -math.log(max(correlation, math.exp(-1.0)))


def _error_of_change(changes, random):
    """Standard error of the mean change over the measured time."""
    realizations, batches = changes.shape
    if realizations >= FEWEST_BATCHES:
        return float(changes.sum(axis=1).std(ddof=1)) / math.sqrt(realizations)
    positions = np.arange(batches) - 0.5 * (batches - 1)
    trend = changes.mean(axis=0).mean()
    if batches > 2:
        trend = trend + positions * (changes.mean(axis=0) @ positions) / (positions @ positions)
    spread = float((changes - trend).std()) / math.sqrt(realizations)
    # Under noise the changes add up like a random walk; in a periodic motion they cancel.
    return spread * math.sqrt(batches) if random else spread
