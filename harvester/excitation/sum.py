"""The sum of several excitations on a common grid of knots."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.errors import SceneError
from harvester.device.keys import Key, key, table
from harvester.excitation.base import Excitation, ExcitationPath, Run, child_seed, knots
from harvester.excitation.sine import DETERMINISTIC_NOTE, Sine
from harvester.records.formats import most_samples

if TYPE_CHECKING:
    from numpy.random.bit_generator import SeedSequence


# Sines have a common period if the ratio of their frequencies equals, to within SAME_RATIO, a
# fraction with a denominator of at most MOST_REPEATS.
MOST_REPEATS, SAME_RATIO = 1000, 1e-9


def common_period(periods: Sequence[float]) -> float | None:
    """Common period (s): the shortest multiple of all; None unless their ratios are simple."""
    first = periods[0]
    ratios = [Fraction(period / first).limit_denominator(MOST_REPEATS) for period in periods]
    pairs = zip(periods, ratios, strict=True)
    if any(not r or abs(period / first / r - 1.0) > SAME_RATIO for period, r in pairs):
        return None
    # The least common multiple of the periods.
    upper = math.lcm(*(ratio.numerator for ratio in ratios))
    return first * upper / math.gcd(*(ratio.denominator for ratio in ratios))


@table
class Sum(Excitation):
    """Sum of several excitations with independent random numbers.

    The common knots limit the band of white noise.
    """

    parts: tuple = key(
        "parts: tables like [excitation]",
        element=Key(kind=dict), count=(1, 100), required=True,
    )  # fmt: skip
    kind: str = "sum"
    knot_spacing: float | None = knots("the shortest of all parts")

    @property
    def kept_samples(self) -> int:
        return sum(part.kept_samples for part in self.parts)

    @property
    def highest_frequency(self) -> float:
        return min(part.highest_frequency for part in self.parts)

    @property
    def symmetric(self) -> bool:
        return all(part.symmetric for part in self.parts)

    @property
    def random(self) -> bool:
        return any(part.random for part in self.parts)

    @property
    def endless(self) -> bool:
        return self.random and all(part.endless or not part.random for part in self.parts)

    @property
    def lines(self) -> tuple[tuple[float, float], ...]:
        """Lines of all parts; sines of equal frequency are one line, the sum of their phasors."""
        phasors: dict[float, complex] = {}
        others: list[tuple[float, float]] = []
        for part in self._leaves():
            if not isinstance(part, Sine):
                others += part.lines
                continue
            same = [f for f in phasors if abs(f / part.frequency - 1.0) <= SAME_RATIO]
            frequency = same[0] if same else part.frequency
            phasor = cmath.rect(part.amplitude, part.phase)
            phasors[frequency] = phasors.get(frequency, 0.0) + phasor
        return (*((frequency, abs(phasor)) for frequency, phasor in phasors.items()), *others)

    def _leaves(self):
        """The parts, with nested sums replaced by their parts."""
        nested = (part._leaves() if isinstance(part, Sum) else [part] for part in self.parts)
        return [leaf for leaves in nested for leaf in leaves]

    @property
    def period(self) -> float | None:
        """Common period of the parts, if the ratios of their periods are simple fractions."""
        periods = [part.period for part in self.parts]
        return None if None in periods else common_period(periods)

    @property
    def corners(self) -> tuple[float, ...]:
        return tuple(corner for part in self.parts for corner in part.corners)

    def density(self, frequencies: np.ndarray) -> np.ndarray | None:
        """The sum of the densities of all parts, since the parts are independent."""
        densities = [part.density(frequencies) for part in self.parts]
        return None if any(part is None for part in densities) else np.sum(densities, axis=0)

    @property
    def longest_run(self) -> float:
        return min(part.longest_run for part in self.parts)

    @property
    def drifts(self) -> bool:
        return any(part.drifts for part in self.parts)

    def transient(self, run: Run) -> bool:
        """Whether all parts are deterministic and one is a transient."""
        return not self.random and any(part.transient(run) for part in self.parts)

    def check(self, units: str, run: Run, origin: str) -> None:
        for index, part in enumerate(self._on_common_knots()):
            if part.prescribes_displacement:
                raise SceneError(
                    f"{origin}: excitation.parts[{index}]: a prescribed_displacement cannot be "
                    "combined with other parts: make it the whole excitation, or remove it"
                )
            part.check(units, run, f"{origin}: parts[{index}]")
        if self.kept_samples > most_samples():
            raise SceneError(
                f"{origin}: excitation.parts: the records have {self.kept_samples} samples in all, "
                f"and this machine's memory allows {most_samples()}: use fewer or shorter records"
            )

    def spacing(self, longest: float) -> float:
        closest = min(part.spacing(longest) for part in self._on_common_knots())
        return self.knot_spacing or closest

    def _on_common_knots(self):
        """The parts, with the sum's `knot_spacing` if it is given."""
        if self.knot_spacing is None:
            return self.parts
        return [replace(part, knot_spacing=self.knot_spacing) for part in self.parts]

    def equivalent_noise(self, relaxation_time: float, longest: float) -> tuple[float, float]:
        pairs = [part.equivalent_noise(relaxation_time, longest) for part in self.parts]
        intensity = sum(d for d, _ in pairs)
        return intensity, intensity / sum(d / time for d, time in pairs)

    def path(self, spacing: float, length: float, seed: SeedSequence) -> ExcitationPath:
        paths = [
            part.path(spacing, length, child_seed(seed, index))
            for index, part in enumerate(self.parts)
        ]
        return SumPath(paths)

    def notes(self, spacing: float, angular_frequency: float, run: Run) -> tuple[str, ...]:
        lines = [part.notes(spacing, angular_frequency, run) for part in self.parts]
        # The note on one sine applies to the sum only if the sum is periodic too.
        lost = DETERMINISTIC_NOTE if self.random or self.period is None else ""
        return tuple(dict.fromkeys(line for part in lines for line in part if line != lost))


class SumPath(ExcitationPath):
    """The sum of paths with the same knots."""

    def __init__(self, paths: Sequence[Any]) -> None:
        self.spacing = paths[0].spacing
        self._paths = paths

    def read(self, count: int) -> np.ndarray:
        return np.sum([path.read(count) for path in self._paths], axis=0)
