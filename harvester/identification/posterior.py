"""Sample the posterior of a fit's values by Markov chains, with flat priors within the bounds.

Residuals are assumed independent and normal, with the variance of the fit; the windows' starts are
eliminated to first order. The sampler is emcee's ensemble of walkers, which is invariant under
linear changes of the values (Goodman and Weare, Comm. App. Math. Comp. Sci. 5, 65 (2010)).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.libraries import optional_library
from harvester.base.serialising import plain
from harvester.identification.sensors import without_states

if TYPE_CHECKING:
    from harvester.identification.fitting import Fitted

WALKERS_PER_VALUE = 4
# Steps between two checks of convergence, and maximum number; the first part is discarded.
STEPS, MOST_STEPS = 100, 1500
LEFT_OUT = 0.25
# A chain is long enough for its quantiles after this number of correlation times.
ENOUGH_TIMES = 30.0
# Quantiles of a 95 % interval.
QUANTILES = (0.025, 0.975)


@dataclass(frozen=True)
class Posterior:
    """Draws from the posterior.

    Attributes
    ----------
    draws : ndarray, shape (draws, keys)
    independent : float
        Effective number of independent draws.
    accepted : float
        Share of the proposed moves that were accepted.
    """

    keys: list[str]
    draws: np.ndarray
    independent: float
    accepted: float

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """95 % intervals by key, from 2.5 % to 97.5 % of the draws."""
        low, high = np.quantile(self.draws, QUANTILES, axis=0)
        return {key: (float(low[n]), float(high[n])) for n, key in enumerate(self.keys)}

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return plain(
            {
                "intervals": self.intervals,
                "medians": dict(zip(self.keys, np.median(self.draws, axis=0), strict=True)),
                "correlations": np.atleast_2d(np.corrcoef(self.draws.T)),
                "independent_draws": self.independent,
                "accepted": self.accepted,
            }
        )


def posterior(
    fitted: Fitted, seed: int = 0, follow: Callable[[float], object] | None = None
) -> Posterior:
    """Sample the posterior of a fit.

    Parameters
    ----------
    follow : callable, optional
        Function of the completed share.

    Raises
    ------
    MissingLibrary
        emcee is not installed.
    """
    emcee = optional_library("emcee", "--posterior", "posterior")
    values, size = fitted.values, fitted.values.size
    errors, walkers = (
        np.maximum(fitted.standard_errors, 1e-12 * np.abs(values)),
        WALKERS_PER_VALUE * size,
    )
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    root = np.linalg.cholesky(fitted.covariance / np.outer(errors, errors) + 1e-9 * np.eye(size))
    begun = values + errors * (rng.standard_normal((walkers, size)) @ root.T)
    begun = np.clip(begun, fitted.shooting.low, fitted.shooting.high)
    sampler = emcee.EnsembleSampler(walkers, size, log_density(fitted))
    state = emcee.State(
        begun, random_state=np.random.RandomState(rng.integers(2**32)).get_state(legacy=True)
    )
    for done in range(STEPS, MOST_STEPS + 1, STEPS):
        state = sampler.run_mcmc(state, STEPS, skip_initial_state_check=True)
        times = sampler.get_autocorr_time(tol=0)
        if follow:
            follow(done / MOST_STEPS)
        if done > ENOUGH_TIMES * np.max(times):
            break
    draws = sampler.get_chain(discard=int(LEFT_OUT * done), flat=True)
    independent = float(draws.shape[0] / np.max(times))
    accepted = float(np.mean(sampler.acceptance_fraction))
    return Posterior(fitted.keys, draws, independent, accepted)


def log_density(fitted: Fitted) -> Callable[[np.ndarray], float]:
    """Return the logarithm of the posterior's density, up to a constant, as a function of the
    values.
    """
    shooting, fit, count = fitted.shooting, fitted.fit, len(fitted.keys)
    shooting.linearized(fit)
    tables = [shooting.jacobian(fit, number)[0] for number in range(len(fit.edges))]
    windows = [edges.size - 1 for edges in fit.edges]
    states = [np.count_nonzero(sizes > 0.0) for sizes in shooting.state_sizes]
    free = sum(table[..., 0].size for table in tables) - np.dot(states, windows) - count

    def cost(trial):
        """Sum of squares, minimised over the windows' starts to first order."""
        total = 0.0
        for number, table in enumerate(tables):
            residuals, _, costs = shooting.residuals(trial, number)
            if not np.isfinite(costs).all():
                return np.inf
            cuts = fit.edges[number] - fit.edges[number][0]
            left = without_states(residuals[..., None], table[..., count:-1], cuts)
            total += float(np.sum(left**2))
        return total

    least = cost(fit)

    def density(values: np.ndarray) -> float:
        if (values < shooting.low).any() or (values > shooting.high).any():
            return -np.inf
        change = (values - fit.values) / shooting.sizes
        return -0.5 * free * (cost(shooting.moved(fit, change)) - least) / least

    return density
