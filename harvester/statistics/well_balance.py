"""Means for a device with different wells, corrected by the jumps between them.

Realizations start in successive wells. If a well is left once in a run or less, the time in each
reflects the starts. Jump rates do not depend on the starts, and their balance gives the stationary
shares of time. It also gives the stationary numbers of jumps, each of which releases or takes the
energy between two wells. Batches are weighted until the wells have these shares and jumps (a
regression estimator of survey sampling: Särndal, Swensson and Wretman, Model Assisted Survey
Sampling, 1992, chapter 6). A mean's error combines the errors of the means within the wells and of
the rates, weighted by the mean's dependence on the well. The error of a rate follows from the
number of its jumps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from harvester.statistics.batch_means import complete_batches, standard_error
from harvester.statistics.moments import WELLS

if TYPE_CHECKING:
    from harvester.device.system import System
    from harvester.scene.model import Scene
    from harvester.statistics.moments import Moments

# Minimum number of jumps for an error bar: 16 jumps have a relative error of a quarter.
FEWEST_JUMPS = 16.0


@dataclass(frozen=True)
class WellBalance:
    """Stationary shares of time in the wells, from the jumps between them in a run.

    Attributes
    ----------
    counts
        Jumps from one well (row) to another in all realizations, including those before
        `run.settle`; shape (wells, wells).
    times
        Time for which each well was the last one reached (s), in the same period.
    shares
        Stationary shares of time by the rates; None if too few wells were reached or left.
    exchange_time
        The slowest relaxation time of the shares (s).
    weights
        Weights of mean 1, with which the mean of `features` is `balanced`; shape (realizations,
        batches).
    features
        Each batch's share of time in each well, and its jumps per second of each kind; shape
        (realizations, batches, wells + kinds of jumps).
    balanced
        Stationary means of the features, from the jump rates.
    innovations
        Change of `balanced` if all batches deviated from the expected jumps as this batch does;
        shape of `features`.
    changes
        Change of `balanced` by one more jump from the first well to the second; shape (wells,
        wells, wells + kinds of jumps).
    """

    counts: np.ndarray
    times: np.ndarray
    shares: np.ndarray | None
    exchange_time: float
    weights: np.ndarray
    features: np.ndarray
    balanced: np.ndarray
    innovations: np.ndarray
    changes: np.ndarray

    def error(self, series: np.ndarray) -> float | None:
        """Standard error of a mean from the deviations of its weighted batches.

        `series` has the shape (realizations, batches). Returns None if there are fewer than
        `FEWEST_JUMPS` jumps, or too few batches.
        """
        series = np.asarray(series, dtype=float)
        if self.shares is None:
            return None
        off = self.weights[:, :, None] * (self.features - self.balanced)
        slopes = _slopes(off, series)
        within = series - off @ slopes
        error = standard_error(within + self.innovations @ slopes)
        within_error = standard_error(within)
        if error is None or within_error is None:
            return None
        if not self._has_enough_jumps(np.array([within_error]), slopes[:, None], series.size):
            return None
        return error * math.sqrt(series.size / (series.size - len(slopes)))

    def parts(self, series: np.ndarray) -> np.ndarray:
        """Each batch's contribution to a mean's deviation: within the wells, and by its jumps.

        `series` contains deviations of the weighted batches from their mean, shape (realizations,
        batches).
        """
        off = self.weights[:, :, None] * (self.features - self.balanced)
        slopes = _slopes(off, series)
        return series - off @ slopes + self.innovations @ slopes

    def errors_of_groups(self, series: np.ndarray) -> np.ndarray | None:
        """Standard errors of many means from independent groups of batches.

        `series` contains deviations of the weighted groups from their means, shape (realizations ×
        groups, means). Returns None if one of the means has fewer than `FEWEST_JUMPS` jumps.
        """
        if self.shares is None:
            return None
        count, (realizations, batches) = len(series), self.weights.shape
        indices = _group_of(batches, count // realizations)

        def joined(rows):
            groups = [rows[:, indices == k].mean(axis=1) for k in range(count // realizations)]
            return np.stack(groups, axis=1).reshape(count, -1)

        off = joined(self.weights[:, :, None] * (self.features - self.balanced))
        slopes = np.linalg.lstsq(off, series, rcond=None)[0]
        within = series - off @ slopes
        within_errors = within.std(axis=0, ddof=1) / math.sqrt(count)
        if not self._has_enough_jumps(within_errors, slopes, count):
            return None
        parts = within + joined(self.innovations) @ slopes
        return parts.std(axis=0, ddof=1) / math.sqrt(count - len(slopes))

    def _has_enough_jumps(self, within, slopes, count):
        """Whether there are enough jumps for means with these errors within the wells and slopes.

        The effective number of jumps follows from Satterthwaite, Biometrics Bull. 2, 110 (1946). A
        kind of jump that did not occur counts as one jump.
        """
        seen = self.counts[:, :, None] + 1.0
        jumps = (self.changes @ slopes) ** 2 * seen
        samples = (within**2 + jumps.sum(axis=(0, 1))) ** 2
        spread = within**4 / count + (jumps**2 / seen).sum(axis=(0, 1))
        return bool(np.all(samples >= FEWEST_JUMPS * spread))

    def without_wells(self, series: np.ndarray) -> np.ndarray:
        """Unweighted batches with the wells' effect regressed out; their mean is unchanged."""
        off = self.features - self.features.mean(axis=(0, 1))
        return series - off @ _slopes(off, series - series.mean())


def well_balance(scene: Scene, system: System, moments: Sequence[Moments]) -> WellBalance | None:
    """The balance of a run's jumps; None if wells do not differ or nothing is random."""
    batches, excitation = complete_batches(moments), scene.excitation
    if batches is None or not excitation.random or excitation.drifts:
        return None
    wells, count = batches.shape[2] - WELLS, batches.shape[1]
    if wells < 2 or (wells == 2 and system.symmetric):
        return None

    def with_settling(name):
        # A start at rest resembles an arrival by a jump: both are far from the energy at which the
        # well is left. If the time in a well began at the end of settling, it would be too short by
        # a relaxation time. Therefore the sums before the first batch (the last row) are added to
        # the first batch.
        sums = np.stack([getattr(m.jumps, name) for m in moments])
        sums[:, 0] += sums[:, -1]
        return sums[:, :count].copy()

    jumps, times = with_settling("counts"), with_settling("times")
    total, time = jumps.sum(axis=(0, 1)), times.sum(axis=(0, 1))
    if not total.any() and scene.start is not None:
        # All runs stay in the well of the given start, and the means apply to this well.
        return None
    features = _features(moments, batches, total)
    rates = total / np.maximum(time, np.finfo(float).tiny)[:, None]
    shares, exchange = _stationary(rates)
    if shares is None or not features[:, :, : len(time)].any(axis=(0, 1)).all():
        none, changes = np.zeros_like(features), np.zeros((*total.shape, features.shape[2]))
        weights, mean = np.ones(features.shape[:2]), features.mean(axis=(0, 1))
        return WellBalance(total, time, None, exchange, weights, features, mean, none, changes)
    balanced, changes = _balanced(rates, shares, total > 0.0)
    changes /= time[:, None, None]
    weights = _weights(features, balanced)
    surplus = jumps - times[:, :, :, None] * rates
    innovations = np.einsum("rbij,ijk->rbk", surplus, changes) * weights.size
    return WellBalance(
        total, time, shares, exchange, weights, features, balanced, innovations, changes
    )


def weighted(moments: Sequence[Moments], balance: WellBalance | None) -> list[Moments]:
    """Moments with sums weighted by the balance; `jumps` and the last points are unchanged."""
    if balance is None or balance.shares is None:
        return list(moments)
    return [
        _weighted(realization, row)
        for realization, row in zip(moments, balance.weights, strict=True)
    ]


def _slopes(off, series):
    """Least-squares coefficients of a series on `off`, the deviations of the batches' features."""
    return np.linalg.lstsq(off.reshape(-1, off.shape[2]), series.ravel(), rcond=None)[0]


def _stationary(rates):
    """(shares or None, exchange time (s)) of jump rates from row to column (1/s)."""
    change = rates - np.diag(rates.sum(axis=1))
    decays = np.sort(np.abs(np.linalg.eigvals(change)))
    exchange = 1.0 / decays[1] if decays[1] > 1e-12 * decays[-1] > 0.0 else math.inf
    if not math.isfinite(exchange):
        return None, exchange
    ones = np.ones((1, len(rates)))
    right_side = np.append(np.zeros(len(rates)), 1.0)
    shares = np.linalg.lstsq(np.vstack([change.T / decays[-1], ones]), right_side, rcond=None)[0]
    return np.maximum(shares, 0.0), exchange


def _features(moments, batches, total):
    """Shares of time in the wells and, for each kind of jump that occurred, jumps per second."""
    count = batches.shape[1]
    stays = np.stack([realization.jumps.times[:count] for realization in moments])
    jumps = np.stack([realization.jumps.counts[:count][:, total > 0.0] for realization in moments])
    return np.concatenate([stays, jumps], axis=2) / batches[:, :, :1]


def _balanced(rates, shares, seen):
    """Stationary means of `_features`, and their derivatives by each rate."""
    flows = (shares[:, None] * rates)[seen]
    of_shares = _changes(rates, shares)
    of_flows = (of_shares[:, :, :, None] * rates)[:, :, seen]
    kinds = np.argwhere(seen)
    for column, (well, other) in enumerate(kinds):
        of_flows[well, other, column] += shares[well]
    return np.append(shares, flows), np.concatenate([of_shares, of_flows], axis=2)


def _changes(rates, shares):
    """Derivatives of the stationary shares by each jump rate (row: from, column: to)."""
    change = rates - np.diag(rates.sum(axis=1))
    answer = np.linalg.inv(shares[None] - change)
    return shares[:, None, None] * (answer[None] - answer[:, None])


def _weights(features, balanced):
    """Weights, linear in each batch's features, with which the weighted mean becomes `balanced`."""
    off = features - features.mean(axis=(0, 1))
    scatter = np.einsum("rbi,rbj->ij", off, off) / off[:, :, 0].size
    missing = balanced - features.mean(axis=(0, 1))
    return 1.0 + off @ (np.linalg.pinv(scatter, rcond=1e-10, hermitian=True) @ missing)


def _group_of(batches, groups):
    """The group of a realization's histograms that contains the middle of each batch."""
    return ((np.arange(batches) + 0.5) * groups / batches).astype(int)


def _weighted(moments, weights):
    """Weighted moments of one realization; data after the last complete batch have no weight."""
    padded = np.append(weights, np.ones(len(moments.integrals) - len(weights)))
    groups = len(moments.histograms)
    indices = _group_of(len(padded), groups)
    of_groups = np.bincount(indices, padded, groups) / np.bincount(indices, minlength=groups)
    output = moments.output
    if output is not None:
        output = replace(
            output,
            integrals=output.integrals * padded[:, None],
            measured=output.measured * padded[:, None, None],
            stored=output.stored * padded[:, None],
        )
    strain = moments.strain
    if strain is not None:
        damage = None if strain.damage is None else strain.damage * padded
        strain = replace(strain, squares=strain.squares * padded[:, None], damage=damage)
    return replace(
        moments,
        integrals=moments.integrals * padded[:, None],
        products=moments.products * padded.mean(),
        histograms=moments.histograms * of_groups[:, None, None],
        output=output,
        strain=strain,
    )
