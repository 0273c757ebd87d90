"""Multiple shooting: windows with separate starts, as long as errors in them stay small.

Bock, in Modelling of Chemical Reaction Systems (1981), and for records of chaotic motion Baake et
al., Phys. Rev. A 45, 5524 (1992). The least-squares problem has the unknowns of the device, and
three states for each window, which are eliminated window by window from the normal equations.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.identification.response import INTERPOLATIONS, Trial, interpolated, side_by_side

if TYPE_CHECKING:
    from harvester.identification.response import Experiment
    from harvester.identification.unknowns import Unknown

# Step of the difference quotients, relative to the unknowns' sizes and the states' rms values.
DIFFERENCE = 1e-5
# A linearization is rejected if a weighted residual changes by more than this when an unknown or
# state changes by its size.
LARGEST_SLOPE = 1e12
# Initial, minimum and maximum damping of the Levenberg–Marquardt steps.
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-9, 1e9


@dataclass
class ShootingFit:
    """State of a fit: values, windows, their starts, and the linearization.

    Attributes
    ----------
    values : ndarray, shape (unknowns,)
        Values of the unknowns, in the scene's units.
    edges : list of ndarray of int
        Edges of the windows of each experiment.
    starts : list of ndarray, shape (windows, 3)
        Scaled states at the beginnings of the windows.
    noise : list of ndarray, shape (outputs,)
        Noise levels that divide the residuals.
    cost : float
        Sum of squares of the weighted residuals.
    grams, transitions, growth : list of ndarray
        For each window of each experiment: [J r]ᵀ[J r]; derivative of its end by its start; the
        largest output for an error of its start, both in rms values.
    """

    values: np.ndarray
    edges: list[np.ndarray]
    starts: list[np.ndarray]
    noise: list[np.ndarray]
    cost: float = np.inf
    grams: list = field(default_factory=list, repr=False)
    transitions: list = field(default_factory=list, repr=False)
    growth: list = field(default_factory=list, repr=False)


@dataclass(frozen=True)
class Shooting:
    """The least-squares problem of several experiments.

    Attributes
    ----------
    experiments : sequence of Experiment
    unknowns : sequence of Unknown
    length : float
        Displacement unit of the states, in the scene's units: the same for all trial values.
    interpolation : str
        A name in `INTERPOLATIONS`.
    state_sizes : sequence of ndarray, shape (3,)
        rms of each state, by experiment; 0 for a state that does not exist.
    fixed : bool
        Whether the values are fixed, and the windows' starts are the only unknowns.
    """

    experiments: Sequence[Experiment]
    unknowns: Sequence[Unknown]
    length: float
    interpolation: str = INTERPOLATIONS[0]
    state_sizes: Sequence[np.ndarray] = ()
    fixed: bool = False

    @cached_property
    def keys(self) -> list[str]:
        """Keys of the values."""
        return [unknown.key for unknown in self.unknowns]

    @cached_property
    def first(self) -> np.ndarray:
        """Initial values, shape (unknowns,)."""
        return np.array([unknown.start for unknown in self.unknowns])

    @cached_property
    def sizes(self) -> np.ndarray:
        """Typical magnitudes of changes of the values, shape (unknowns,)."""
        return np.array([unknown.size for unknown in self.unknowns])

    @cached_property
    def low(self) -> np.ndarray:
        """Lower bounds of the values, shape (unknowns,)."""
        return np.array([unknown.low for unknown in self.unknowns])

    @cached_property
    def high(self) -> np.ndarray:
        """Upper bounds of the values, shape (unknowns,)."""
        return np.array([unknown.high for unknown in self.unknowns])

    @property
    def count(self) -> int:
        """Number of values that are not fixed."""
        return 0 if self.fixed else len(self.unknowns)

    def state_units(self, number: int) -> np.ndarray:
        """Units of the states of one experiment: their sizes, or 1 for a missing state."""
        sizes = self.state_sizes[number]
        return np.where(sizes > 0.0, sizes, 1.0)

    def known(self, values: Iterable[float]) -> dict[str, float]:
        """Values of the unknowns by key."""
        return dict(zip(self.keys, map(float, values), strict=True))

    def at(self, number: int, values: Iterable[float]) -> Trial:
        """One experiment with values of the unknowns."""
        return Trial(self, number, self.known(values))

    def residuals(
        self, fit: ShootingFit, number: int, values: Any = None, starts: Any = None
    ) -> tuple[np.ndarray, Any, np.ndarray]:
        """Weighted residuals of one experiment, its windows' ends, and each window's cost.

        If a solution diverges, residuals are 0 and the cost is inf.

        Parameters
        ----------
        values, starts : ndarray, optional
            By default those of the fit.
        """
        edges = fit.edges[number]
        values = fit.values if values is None else values
        starts = fit.starts[number] if starts is None else starts
        _, ends, outputs = self.at(number, values).states(edges, starts)
        weighted = (np.nan if outputs is None else outputs) - self.seen(number, edges)
        weighted = weighted / fit.noise[number]
        costs = np.add.reduceat(np.sum(weighted**2, axis=1), edges[:-1] - edges[0])
        costs[~np.isfinite(costs)] = np.inf
        return np.nan_to_num(weighted, posinf=0.0, neginf=0.0), ends, costs

    def states(self, fit: ShootingFit, number: int) -> Any:
        """States at the samples of one experiment of a fit, shape (samples, 3)."""
        edges, starts = fit.edges[number], fit.starts[number]
        return self.at(number, fit.values).states(edges, starts)[0]

    def seen(self, number: int, edges: np.ndarray) -> np.ndarray:
        """Measured outputs in the windows of one experiment, shape (samples, outputs)."""
        outputs = self.experiments[number].measurement.outputs
        return np.column_stack([series[edges[0] : edges[-1]] for series in outputs.values()])

    def moved_by_noise(self, fit: ShootingFit, number: int, noise: np.ndarray) -> np.ndarray:
        """Changes of one experiment's outputs caused by noise of the base's sensor.

        Zero after the solution has diverged.

        Parameters
        ----------
        noise : ndarray, shape (n, draws)

        Returns
        -------
        ndarray, shape (samples, outputs, draws)
        """
        record, windows = self.experiments[number], (fit.edges[number], fit.starts[number])
        base, path = record.measurement.acceleration, record.acceleration[self.interpolation]
        undisturbed = self.at(number, fit.values).states(*windows)[2]

        def moved(draw):
            shaken, path_noise = draw
            noisy = replace(
                record,
                measurement=replace(record.measurement, acceleration=base + shaken),
                acceleration={self.interpolation: path + path_noise},
            )
            others = [*self.experiments[:number], noisy, *self.experiments[number + 1 :]]
            trial = replace(self, experiments=others).at(number, fit.values)
            return trial.states(*windows)[2] - undisturbed

        paths = interpolated(noise, record.steps, self.interpolation)
        changes = np.stack(side_by_side(moved, zip(noise.T, paths.T, strict=True)), axis=-1)
        return np.nan_to_num(changes, posinf=0.0, neginf=0.0)

    def cost(self, fit: ShootingFit) -> float:
        """Sum of squares; inf if the device diverges."""
        return float(sum(self.residuals(fit, n)[2].sum() for n in range(len(fit.edges))))

    def jacobian(self, fit: ShootingFit, number: int) -> tuple[Any, Any]:
        """[J_unknowns, J_states, r] of one experiment and its windows' transitions, or None.

        Columns are in sizes; transitions have the shape (windows, 3, 3).
        """
        base, ends, costs = self.residuals(fit, number)
        if not np.isfinite(costs).all():
            return None, None
        p = self.count
        table = np.zeros((*base.shape, p + 4))
        table[..., -1] = base

        def of_value(k):
            moved = fit.values.copy()
            moved[k] += DIFFERENCE * self.sizes[k] * (-1.0 if moved[k] >= self.high[k] else 1.0)
            shifted, _, costs = self.residuals(fit, number, moved)
            if np.isfinite(costs).all():
                table[..., k] = (shifted - base) / ((moved[k] - fit.values[k]) / self.sizes[k])

        # Each call fills its own column, so that the threads' order does not affect the result.
        side_by_side(of_value, range(p))
        table[..., p:-1], transitions = self.by_states(fit, number, fit.starts[number], base, ends)
        return table, transitions

    def by_states(
        self,
        fit: ShootingFit,
        number: int,
        starts: np.ndarray,
        residuals: np.ndarray,
        ends: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of residuals and of windows' ends by the windows' starts, in sizes.

        Shapes (samples, outputs, 3) and (windows, 3, 3). `residuals`, `ends`: those of `starts`.
        """
        sizes, lengths = self.state_units(number), np.diff(fit.edges[number])
        columns, transitions = np.zeros((*residuals.shape, 3)), np.zeros((len(starts), 3, 3))

        def of_state(k):
            moved = starts.copy()
            moved[:, k] += DIFFERENCE * sizes[k]
            shifted, moved_ends, costs = self.residuals(fit, number, starts=moved)
            bounded = np.repeat(np.isfinite(costs), lengths)[:, None]
            columns[..., k] = np.where(bounded, shifted - residuals, 0.0) / DIFFERENCE
            transitions[:, :, k] = (moved_ends - ends) / sizes / DIFFERENCE

        side_by_side(of_state, np.flatnonzero(self.state_sizes[number] > 0.0))
        return columns, transitions

    def linearized(self, fit: ShootingFit) -> bool:
        """Fill the Gram matrices of all windows; return whether the device stays bounded."""
        fit.grams, fit.transitions, fit.growth = [], [], []
        p = self.count
        for number, edges in enumerate(fit.edges):
            table, transitions = self.jacobian(fit, number)
            if table is None or not np.abs(table).max() < LARGEST_SLOPE:
                fit.grams = []
                return False
            cuts = edges - edges[0]
            fit.grams.append(grams_of(table, cuts))
            fit.transitions.append(transitions)
            shares = self._shares(number, fit.noise[number])
            moved = np.linalg.norm(table[..., p:-1] * shares[:, None], axis=(1, 2))
            fit.growth.append(np.maximum.reduceat(moved, cuts[:-1]))
        fit.cost = float(sum(gram[:, -1, -1].sum() for gram in fit.grams))
        return True

    def _shares(self, number, noise):
        """Noise level of each output, divided by the output's rms."""
        outputs = self.experiments[number].measurement.outputs
        return noise / np.array([np.std(series) for series in outputs.values()])

    def step(self, fit: ShootingFit, damping: float) -> tuple[np.ndarray, float]:
        """Change of the unknowns in sizes by the damped normal equations, and the expected decrease
        of the cost.
        """
        normal, gradient, gained = self.reduced(fit, damping)
        if not self.count:
            return gradient, gained
        free = np.ones(self.count, bool)
        at = (fit.values <= self.low) | (fit.values >= self.high)
        for _ in range(self.count + 1):
            change = np.zeros(self.count)
            block = normal[np.ix_(free, free)]
            change[free] = -np.linalg.lstsq(block, gradient[free], rcond=1e-14)[0]
            target = fit.values / self.sizes + change
            out = (target < self.low / self.sizes) | (target > self.high / self.sizes)
            if not (out & at & free).any():
                break
            free &= ~(out & at)
        target = np.clip(fit.values + change * self.sizes, self.low, self.high)
        change = (target - fit.values) / self.sizes
        return change, gained - float(gradient @ change)

    def reduced(
        self, fit: ShootingFit, damping: float = 0.0
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Normal matrix and gradient of the unknowns alone, after eliminating the starts, and the
        decrease of the cost by the starts.
        """
        p, grams = self.count, np.concatenate(fit.grams)
        normal, gradient = grams[:, :p, :p].sum(axis=0), grams[:, :p, -1].sum(axis=0)
        normal += damping * np.diag(np.maximum(np.diag(normal), 1e-300))
        inverse = state_inverse(grams[:, p : p + 3, p : p + 3], damping)
        cross, of_starts = grams[:, :p, p : p + 3], grams[:, p : p + 3, -1]
        normal -= np.einsum("wik,wkl,wjl->ij", cross, inverse, cross)
        gradient -= np.einsum("wik,wkl,wl->i", cross, inverse, of_starts)
        return normal, gradient, float(np.einsum("wk,wkl,wl->", of_starts, inverse, of_starts))

    def minimized(self, fit: ShootingFit, iterations: int, tolerance: float) -> ShootingFit:
        """The fit at the minimum of its cost, with unchanged windows.

        Parameters
        ----------
        iterations : int
            Maximum number of iterations.
        tolerance : float
            Share of the cost: a step with a smaller expected or actual decrease is the last one.
        """
        if not self.linearized(fit):
            return fit
        damping = FIRST_DAMPING
        for _ in range(iterations):
            while damping <= MOST_DAMPING:
                change, promised = self.step(fit, damping)
                trial = self.moved(fit, change, damping)
                trial.cost = self.cost(trial)
                last = promised < tolerance * fit.cost
                if last or trial.cost < fit.cost:
                    break
                damping *= 8.0
            else:
                return fit
            if last:
                # Such a short step does not change the linearization.
                trial = replace(fit, values=trial.values, starts=trial.starts, cost=trial.cost)
                return trial if trial.cost < fit.cost else fit
            damping = max(0.2 * damping, LEAST_DAMPING)
            if not self.linearized(trial):
                return fit
            gained, fit = fit.cost - trial.cost, trial
            if gained < tolerance * fit.cost:
                return fit
        return fit

    def moved(self, fit: ShootingFit, change: np.ndarray, damping: float = 0.0) -> ShootingFit:
        """The fit after a change of the unknowns in sizes; its starts follow to first order."""
        p, starts = self.count, []
        for number, (grams, states) in enumerate(zip(fit.grams, fit.starts, strict=True)):
            inverse = state_inverse(grams[:, p : p + 3, p : p + 3], damping)
            right = grams[:, p : p + 3, -1] + grams[:, p : p + 3, :p] @ change
            moves = np.einsum("wij,wj->wi", inverse, right)
            starts.append(states - moves * self.state_units(number))
        values = fit.values if self.fixed else fit.values + change * self.sizes
        return ShootingFit(values, fit.edges, starts, fit.noise)

    def reweighted(self, fit: ShootingFit) -> ShootingFit:
        """The fit with each output's noise estimated from its residuals."""
        noise = []
        for number, level in enumerate(fit.noise):
            residuals, _, costs = self.residuals(fit, number)
            rms = np.sqrt(np.mean(residuals**2, axis=0)) if np.isfinite(costs).all() else 1.0
            noise.append(level * np.maximum(rms, 1e-6))
        return replace(fit, noise=noise)


def grams_of(table: np.ndarray, cuts: np.ndarray) -> np.ndarray:
    """[J r]ᵀ[J r] of each window, from an experiment's table."""
    parts = [table[a:b].reshape(-1, table.shape[-1]) for a, b in pairwise(cuts)]
    return np.array([part.T @ part for part in parts])


def state_inverse(block: np.ndarray, damping: Any) -> np.ndarray:
    """Inverses of the normal matrices of windows' starts, with common or individual damping."""
    block, sizes = block.copy(), np.einsum("wii->wi", block)
    largest = sizes.max(axis=1, keepdims=True)
    ridge = damping * sizes + 1e-10 * np.where(largest > 0.0, largest, 1.0)
    block[:, range(3), range(3)] += ridge
    return np.linalg.inv(block)
