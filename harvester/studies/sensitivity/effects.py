"""Effect of a parameter: change of a quantity's mean from the parameter's low to its high."""

import numpy as np

from harvester.studies.sensitivity.sobol import Interval, interval

# Quantiles of the devices at which a parameter counts as low and as high.
ENDS = (0.05, 0.95)
RESAMPLES = 1000


def effects(shares: np.ndarray, values: np.ndarray, seed: int) -> list[tuple[Interval, Interval]]:
    """Change of the quantity's mean where one parameter is low and high, averaged over the others.

    By least squares: a mean and, for each parameter, a parabola in the share of the devices below
    it. Rows are resampled for the intervals.

    Parameters
    ----------
    shares : ndarray, shape (rows, devices, parameters)
        Shares of the devices below each value, in (0, 1).
    values : ndarray, shape (rows, devices)

    Returns
    -------
    list of (Interval, Interval)
        Low and high, for each parameter.
    """
    rows, _, count = shares.shape
    terms = np.concatenate([np.ones((*values.shape, 1)), *_parabola(shares)], axis=2)
    squares = np.einsum("rdi,rdj->rij", terms, terms)
    products = np.einsum("rdi,rd->ri", terms, values)
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(3,)))
    weights = generator.multinomial(rows, np.full(rows, 1.0 / rows), RESAMPLES)
    weights = np.vstack([np.ones(rows), weights])
    fits = [np.linalg.pinv(np.tensordot(w, squares, 1)) @ (w @ products) for w in weights]
    slopes, bends = np.array(fits)[:, 1 : count + 1], np.array(fits)[:, count + 1 :]
    intervals = []
    for k in range(count):
        low, high = (sum(np.multiply((slopes[:, k], bends[:, k]), _column(end))) for end in ENDS)
        intervals.append((interval(low[0], low[1:]), interval(high[0], high[1:])))
    return intervals


def _parabola(share):
    """Slope and bend, each with mean 0 over all devices."""
    return share - 0.5, (share - 0.5) ** 2 - 1.0 / 12.0


def _column(share):
    return np.array(_parabola(share))[:, None]
