"""Vibration specified by breakpoints of a one-sided density, as in standards and loggers."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from harvester.base.errors import SceneError
from harvester.device.keys import POSITIVE, Key, OneOf, key, positive, table, word
from harvester.excitation.base import Excitation, ExcitationPath, Run, knots
from harvester.excitation.profiles import PROFILES
from harvester.excitation.shaped import (
    ShapedPath,
    density_between,
    filter_length,
    mean_square,
    path_density,
)
from harvester.records.quantities import ACCELERATION

if TYPE_CHECKING:
    from numpy.random.bit_generator import SeedSequence


UNITS = {"g^2/Hz": ACCELERATION["g"] ** 2, "(m/s^2)^2/Hz": 1.0, "scaled": 1.0}
# Knots per period of the spectrum's highest frequency: default and minimum. With the default,
# straight lines lower the density there by 0.2 dB, which is compensated. A slow device needs fewer:
# with the minimum the first image, at three times the highest frequency, has 1.2 % of the density.
# A bridge at 46 Hz then needs half the steps for a band up to 500 Hz, and a third for one up to
# 2 kHz.
KNOTS_PER_PERIOD, FEWEST_KNOTS_PER_PERIOD = 12.0, 4.0
# A note is given if the rms of the knots exceeds the rms of the interpolated path by this share.
# The second number is the number of integration points.
NOTED_EXCESS, EXCESS_FREQUENCIES = 0.01, 2001
# A note is given if the filter's blur removes more than this share of the mean square.
NOTED_LOSS = 0.01
# Default duration of a burst, in periods of the lowest frequency.
PERIODS_PER_BURST = 20.0


@table
class Spectrum(Excitation):
    """Stationary vibration of a given one-sided density, straight between breakpoints on log axes.

    The density is 0 outside the breakpoints. With a kurtosis above 3 the Gaussian path is
    multiplied by factors exp(σ z − σ²) that change from one burst to the next; see
    `harvester.excitation.shaped.Bursts`.
    """

    breakpoints: tuple = key(
        "breakpoints: frequency (Hz, ascending) and density of each, or a file of two columns",
        element=Key(element=POSITIVE, count=(2, 2)), count=(2, 10000), file=True,
    )  # fmt: skip
    unit: str | None = word("unit of the densities", tuple(UNITS))
    kurtosis: float = key(
        "kurtosis: 3 is Gaussian; larger values give bursts", low=3.0, high=30.0, default=3.0
    )
    burst_time: float | None = positive(
        "duration of a burst: by default 20 periods of the lowest frequency", "s"
    )
    source: str = key(
        "source: the publication of the values, quoted by results", kind=str, default=""
    )
    kind: str = "spectrum"
    knot_spacing: float | None = knots(
        "a twelfth of the shortest period of the band; for a slower device a fortieth of its period"
    )
    profile: str | None = word(
        "named spectrum: written out as breakpoints, unit and source", PROFILES
    )

    endless = True
    ALTERNATIVES: ClassVar = (OneOf(("breakpoints", "profile")),)

    @property
    def points(self) -> tuple[tuple[float, float], ...]:
        """Frequency (Hz) and density ((m/s²)²/Hz, or of η in a scaled scene) of each breakpoint."""
        factor = UNITS[self.unit or "scaled"]
        return tuple((frequency, factor * density) for frequency, density in self.breakpoints)

    @property
    def kept_samples(self) -> int:
        """Samples in memory of one path: input, output and filter."""
        frequencies = np.array([frequency for frequency, _ in self.breakpoints])
        spacing = self.knot_spacing or 1.0 / (KNOTS_PER_PERIOD * frequencies[-1])
        return 5 * filter_length(frequencies, spacing)

    @property
    def band(self) -> tuple[float, float]:
        """Lowest and highest frequency (Hz)."""
        return self.breakpoints[0][0], self.breakpoints[-1][0]

    @property
    def corners(self) -> tuple[float, ...]:
        return tuple(frequency for frequency, _ in self.breakpoints)

    def density(self, frequencies: np.ndarray) -> np.ndarray:
        return density_between(self.points, frequencies)

    def check(self, units: str, run: Run, origin: str) -> None:
        self._check_unit(units, origin, required=True)
        frequencies = [frequency for frequency, _ in self.breakpoints]
        for index, (low, high) in enumerate(itertools.pairwise(frequencies), 1):
            if not low < high:
                raise SceneError(
                    f"{origin}: excitation.breakpoints[{index}] = {high:g} Hz after {low:g} Hz: "
                    "frequencies must ascend; write a jump as two close frequencies"
                )
        if self.burst_time is not None and self.burst_time < 1.0 / frequencies[0]:
            raise SceneError(
                f"{origin}: excitation.burst_time = {self.burst_time:g}: must be at least "
                f"{1.0 / frequencies[0]:.3g}, a period of the lowest frequency: shorter bursts "
                "would blur the density completely"
            )
        longest = 1.0 / (FEWEST_KNOTS_PER_PERIOD * frequencies[-1])
        words = "a quarter of the highest frequency's period"
        self._check_knot_spacing(longest, words, origin)

    def spacing(self, longest: float) -> float:
        period = 1.0 / self.band[1]
        close, wide = period / KNOTS_PER_PERIOD, period / FEWEST_KNOTS_PER_PERIOD
        return self.knot_spacing or min(max(close, longest), wide, longest)

    def equivalent_noise(self, relaxation_time: float, longest: float) -> tuple[float, float]:
        # Noise with the same peak density, G = 4 D, and the same variance, D/τ1.
        intensity = max(density for _, density in self.points) / 4.0
        return intensity, intensity / mean_square(self.points)

    def path(self, spacing: float, length: float, seed: SeedSequence) -> ExcitationPath:
        burst = self.burst_time or PERIODS_PER_BURST / self.band[0]
        return ShapedPath(self.points, spacing, seed, self.kurtosis, burst, 1.0 / length)

    def notes(self, spacing: float, angular_frequency: float, run: Run) -> tuple[str, ...]:
        low, high = self.band
        unit = "" if self.unit == "scaled" else " m/s²"
        listed = ", ".join(f"{f:g} Hz {g:g}" for f, g in self.breakpoints[:20])
        ellipsis = f" and {len(self.breakpoints) - 20} more" if len(self.breakpoints) > 20 else ""
        source = f" after {self.source}" if self.source else ""
        lines = [
            f"spectrum{source}: {listed}{ellipsis} {self.unit}; rms "
            f"{math.sqrt(mean_square(self.points)):.4g}{unit}"
        ]
        frequencies = np.linspace(*self.band, EXCESS_FREQUENCIES)
        density = self.density(frequencies)
        raised = density / np.sinc(frequencies * spacing) ** 4
        excess = math.sqrt(float(raised.sum() / density.sum())) - 1.0
        if excess > NOTED_EXCESS:
            lines.append(
                f"samples {spacing:.3g} s apart: the density is correct for the path with straight "
                f"lines between the samples; the rms of the samples alone is {excess:.1%} higher"
            )
        frequency = angular_frequency / (2.0 * math.pi)
        if not low <= frequency <= high and 0.0 < frequency < math.inf:
            lines.append(
                f"the spectrum does not excite the device: it lies between {low:g} and {high:g} "
                f"Hz, and the device resonates at {frequency:.3g} Hz"
            )
        places, density = path_density(self.points, spacing)
        lost = 1.0 - float(density.sum()) * places[1] / mean_square(self.points)
        if lost > NOTED_LOSS:
            lines.append(
                f"the filter of the path resolves {4.0 * places[1]:.2g} Hz: it removes "
                f"{lost:.1%} of the mean square, at edges and peaks of the density"
            )
        if self.kurtosis > 3.0:
            burst = self.burst_time or PERIODS_PER_BURST / low
            lines.append(
                f"bursts of {burst:.3g} s give a kurtosis of {self.kurtosis:g} and blur the "
                f"density by about {0.5 / burst:.2g} Hz"
            )
        return tuple(lines)
