"""Ornstein–Uhlenbeck noise sampled exactly at knots: the one path that every engine is given."""

import math

import numpy as np

from harvester.compilation import compiled


def realization_seeds(seed, realizations):
    """One independent `SeedSequence` per realization, the same whatever runs them."""
    return np.random.SeedSequence(seed).spawn(realizations)


class NoisePath:
    """A stream of Ornstein–Uhlenbeck samples at equally spaced knots (Eq. 6).

    Exact in law at the knots: η_{k+1} = a η_k + √(D/τ1 (1 − a²)) ξ_k, a = exp(−spacing/τ1),
    stationary from the first. Engines take η as linear between knots, which lowers the
    variance averaged over time by about spacing/(3 τ1) of itself (`interpolation_loss`).

    Parameters
    ----------
    intensity, correlation_time : float
        D and τ1, scaled units.
    spacing : float
        Time between knots (s).
    seed : numpy.random.SeedSequence
        Of this realization; the same seed gives the same bytes in blocks of any size.
    """

    def __init__(self, intensity, correlation_time, spacing, seed):
        self.spacing = spacing
        self._deviation = math.sqrt(intensity / correlation_time)
        self._memory = math.exp(-spacing / correlation_time)
        self._kick = math.sqrt(-math.expm1(-2.0 * spacing / correlation_time))
        self._generator = np.random.default_rng(seed)
        self._last = math.nan

    def read(self, count):
        """The next `count` samples, float64 of shape (count,)."""
        samples = self._generator.standard_normal(count)
        if count:
            self._last = _filter(samples, self._last, self._memory, self._kick)
            samples *= self._deviation
        return samples


def interpolation_loss(spacing, correlation_time):
    """Share of the noise's variance that linear interpolation between knots takes away.

    The mean over a segment of ((1−u) η0 + u η1)² is D/τ1 (2 + a)/3 with a = exp(−spacing/τ1).
    """
    return -math.expm1(-spacing / correlation_time) / 3.0


@compiled
def _filter(samples, last, memory, kick):
    """Turn white samples of unit variance into the stationary sequence, in place."""
    start = 0
    if math.isnan(last):
        last = samples[0]
        start = 1
    for index in range(start, samples.size):
        last = memory * last + kick * samples[index]
        samples[index] = last
    return last
