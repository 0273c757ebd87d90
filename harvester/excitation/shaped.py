"""A Gaussian path with a given one-sided density: white noise filtered block by block."""

from __future__ import annotations

import itertools
import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from harvester.excitation.base import ExcitationPath, child_seed

if TYPE_CHECKING:
    from numpy.random.bit_generator import SeedSequence

# Length of the filter in periods of the lowest frequency, and of the band's width. At an abrupt
# lower edge the first sixth octave of the density is then 0.15 dB low, 0.3 dB at 64 periods. A band
# between two abrupt edges loses 0.5 % of its mean square.
PERIODS_OF_LOWEST = 128.0
# Frequency points of the filter within the narrowest gap between two breakpoints.
WIDTHS_OF_GAP = 8.0
# Largest length of a filter: 8 MB, and twice that in each path.
MOST_TAPS = 2**20


def filter_length(frequencies: np.ndarray, spacing: float) -> int:
    """Length of the filter, a power of 2, that resolves the lowest frequency, the band and each
    gap.

    `frequencies`: shape (n,); frequencies of the breakpoints, ascending (Hz). `spacing`: time
    between knots (s).
    """
    gaps = np.diff(frequencies)
    lowest = min(frequencies[0], frequencies[-1] - frequencies[0])
    seconds = max(PERIODS_OF_LOWEST / lowest, WIDTHS_OF_GAP / gaps[gaps > 0.0].min())
    return int(min(2 ** math.ceil(math.log2(seconds / spacing)), MOST_TAPS))


def density_between(points: tuple, frequencies: np.ndarray) -> np.ndarray:
    """The density at frequencies: straight between breakpoints on log–log axes, 0 beyond them.

    `points`: frequency (Hz) and density of each breakpoint. `frequencies`: of any shape.
    """
    at, density = np.log(np.array(points)).T
    inside = (frequencies >= points[0][0]) & (frequencies <= points[-1][0])
    logarithm = np.log(np.where(inside, frequencies, points[0][0]))
    return np.where(inside, np.exp(np.interp(logarithm, at, density)), 0.0)


def mean_square(points: tuple) -> float:
    """∫ G df of straight lines on log–log axes, exactly."""
    total = 0.0
    for (low, first), (high, last) in itertools.pairwise(points):
        slope = math.log(last / first) / math.log(high / low) + 1.0
        # (high^slope − low^slope)/slope, which is ln(high/low) at slope 0.
        octave = slope * math.log(high / low)
        growth = math.expm1(octave) / octave if octave else 1.0
        total += first * low * growth * math.log(high / low)
    return total


@lru_cache(maxsize=4)
def _filter(points, spacing):
    """Spectrum of the filter over a block of twice its length, and the length.

    A factor 1/sinc²(f spacing) compensates the linear interpolation between knots. White noise of
    variance 1 has the one-sided density 2 spacing.
    """
    taps = filter_length(np.array([f for f, _ in points]), spacing)
    frequencies = np.fft.rfftfreq(4 * taps, spacing)
    gain = np.sqrt(density_between(points, frequencies)) / np.sinc(frequencies * spacing) ** 2
    values = np.roll(np.fft.irfft(gain), taps // 2)[:taps] * np.hanning(taps + 1)[:taps]
    spectrum = np.fft.rfft(values, 2 * taps) / math.sqrt(2.0 * spacing)
    spectrum.flags.writeable = False
    return spectrum, taps


def path_density(points: tuple, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (Hz) of the filter and the density of its path, linear between knots.

    `points`: frequency (Hz) and density of each breakpoint. `spacing`: time between knots (s). The
    density follows the breakpoints, blurred by the filter's finite length.
    """
    spectrum, taps = _filter(points, spacing)
    frequencies = np.fft.rfftfreq(2 * taps, spacing)
    return frequencies, 2.0 * spacing * np.abs(spectrum) ** 2 * np.sinc(frequencies * spacing) ** 4


class ShapedPath(ExcitationPath):
    """Samples of filtered white noise, computed in blocks of fixed size.

    Parameters
    ----------
    points : tuple of (float, float)
        Frequency (Hz) and one-sided density of each breakpoint.
    spacing : float
        Time between knots (s).
    seed : numpy.random.SeedSequence
    kurtosis : float
        3 for a Gaussian path; above, see `Bursts`.
    burst_time : float
        `time` of `Bursts` (s).
    factor : float
        Factor on the samples.
    """

    def __init__(
        self,
        points: tuple,
        spacing: float,
        seed: SeedSequence,
        kurtosis: float = 3.0,
        burst_time: float = math.inf,
        factor: float = 1.0,
    ) -> None:
        from harvester.excitation.correlated_normals import NormalPath

        self.spacing = spacing
        self._spectrum, self._taps = _filter(points, spacing)
        self._white = NormalPath(child_seed(seed, 0), factor)
        self._input = np.zeros(2 * self._taps)
        self._input[self._taps :] = self._white.read(self._taps)
        self._block, self._used = np.empty(0), 0
        self._bursts = None
        if kurtosis > 3.0:
            self._bursts = Bursts(kurtosis, burst_time / spacing, child_seed(seed, 1))

    def read(self, count: int) -> np.ndarray:
        samples, done = np.empty(count), 0
        while done < samples.size:
            if self._used == self._block.size:
                self._fill()
            part = self._block[self._used : self._used + samples.size - done]
            samples[done : done + part.size] = part
            done, self._used = done + part.size, self._used + part.size
        return samples

    def _fill(self):
        """Fill the next block by overlap–save: second half of a convolution of two blocks."""
        self._input[: self._taps] = self._input[self._taps :]
        self._input[self._taps :] = self._white.read(self._taps)
        filtered = np.fft.irfft(np.fft.rfft(self._input) * self._spectrum)
        self._block, self._used = filtered[self._taps :].copy(), 0
        if self._bursts:
            self._block *= self._bursts.read(self._taps)


class Bursts:
    """Factors exp(σ z − σ²) with σ² = ln(kurtosis/3)/4, whose mean square is 1.

    z is normal at every time: z = ξ_j cos θ + ξ_{j+1} sin θ, where θ goes from 0 to π/2 from one
    node to the next and ξ are independent. The factors preserve the mean square of a Gaussian path
    and give it the required kurtosis, 3 E[factor⁴]; the density is blurred by about 1/(2 time).

    `kurtosis`: above 3. `knots`: number of knots from one node to the next.
    """

    def __init__(self, kurtosis: float, knots: float, seed: SeedSequence) -> None:
        self._variance = 0.25 * math.log(kurtosis / 3.0)
        self._knots = max(1, round(knots))
        self._generator = np.random.default_rng(seed)
        # The first node is at a random time, so that the process is stationary.
        self._next = int(self._generator.integers(self._knots))
        self._nodes = self._generator.standard_normal(2)

    def read(self, count: int) -> np.ndarray:
        """The next factors, shape (count,)."""
        places = np.arange(self._next, self._next + count)
        at, offset = np.divmod(places, self._knots)
        missing = int(at[-1]) + 2 - self._nodes.size
        self._nodes = np.append(self._nodes, self._generator.standard_normal(max(missing, 0)))
        angle = 0.5 * math.pi * offset / self._knots
        normal = self._nodes[at] * np.cos(angle) + self._nodes[at + 1] * np.sin(angle)
        passed, self._next = divmod(self._next + count, self._knots)
        self._nodes = self._nodes[passed:]
        if self._nodes.size < 2:
            fresh = self._generator.standard_normal(2 - self._nodes.size)
            self._nodes = np.append(self._nodes, fresh)
        return np.exp(math.sqrt(self._variance) * normal - self._variance)
