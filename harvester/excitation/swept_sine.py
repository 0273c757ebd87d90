"""A sine whose frequency sweeps up and down at a constant number of octaves per minute."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from harvester.base.errors import SceneError
from harvester.device.keys import not_negative, positive, table
from harvester.excitation.base import ExcitationPath, Run, knots
from harvester.excitation.sine import FEWEST_KNOTS_PER_PERIOD, KNOTS_PER_PERIOD, Harmonic

# Number of sweep frequencies at which the choice of the step checks for resonance.
LINES = 24


@table
class SweptSine(Harmonic):
    """η = amplitude · sin(φ), φ' = 2π f, with f from `frequency` to `end_frequency` and back.

    η is linear between knots; the amplitude is compensated as in `Sine`.
    """

    amplitude: float = not_negative("amplitude", "m/s²", "η", required=True)
    frequency: float = positive("frequency: at the start of the sweep", "Hz", required=True)
    end_frequency: float = positive("end frequency: where it turns back", "Hz", required=True)
    octaves_per_minute: float = positive("octaves per minute", "1/min", default=1.0)
    kind: str = "swept-sine"
    knot_spacing: float | None = knots("a fortieth of the shortest period of sine and device")

    drifts = True

    @property
    def lines(self) -> tuple[tuple[float, float], ...]:
        places = np.geomspace(self.frequency, self.end_frequency, LINES)
        return tuple((float(frequency), self.amplitude) for frequency in places)

    @property
    def _highest(self):
        return max(self.frequency, self.end_frequency)

    def check(self, units: str, run: Run, origin: str) -> None:
        if self.frequency == self.end_frequency:
            raise SceneError(
                f"{origin}: excitation.end_frequency = {self.end_frequency:g}: equals "
                'excitation.frequency; choose another value, or kind = "sine"'
            )
        longest = 1.0 / (FEWEST_KNOTS_PER_PERIOD * self._highest)
        self._check_knot_spacing(longest, "an eighth of the sine's shortest period", origin)

    def spacing(self, longest: float) -> float:
        return self.knot_spacing or min(1.0 / (KNOTS_PER_PERIOD * self._highest), longest)

    def path(self, spacing: float, length: float, seed: Any) -> ExcitationPath:
        return SweptPath(self, spacing, length)

    def notes(self, spacing: float, angular_frequency: float, run: Run) -> tuple[str, ...]:
        octaves = abs(math.log2(self.end_frequency / self.frequency))
        once = 60.0 * octaves / self.octaves_per_minute
        return (
            f"a sine sweeps from {self.frequency:g} to {self.end_frequency:g} Hz in {once:.4g} s "
            "and back: means are over the frequencies within the run",
        )


class SweptPath(ExcitationPath):
    """Samples of a swept sine with continuous phase.

    `spacing`: time between knots (s). `length`: see `Excitation.path`.
    """

    def __init__(self, sweep: SweptSine, spacing: float, length: float) -> None:
        self.spacing = spacing
        octaves = math.log2(sweep.end_frequency / sweep.frequency)
        self._once = 60.0 * abs(octaves) / sweep.octaves_per_minute
        self._rate = math.log(2.0) * octaves / self._once
        self._first, self._amplitude = sweep.frequency, sweep.amplitude / length
        self._next = 0

    def read(self, count: int) -> np.ndarray:
        times = np.arange(self._next, self._next + count) * self.spacing
        self._next += count
        sweeps, since = np.divmod(times, 2.0 * self._once)
        back = since > self._once
        since = np.where(back, 2.0 * self._once - since, since)
        one_way = self._first * math.expm1(self._rate * self._once) / self._rate
        turns = self._first * np.expm1(self._rate * since) / self._rate
        turns = np.where(back, 2.0 * one_way - turns, turns) + np.mod(2.0 * one_way * sweeps, 1.0)
        frequency = self._first * np.exp(self._rate * since)
        heights = self._amplitude / np.sinc(frequency * self.spacing) ** 2
        return heights * np.sin(2.0 * math.pi * np.mod(turns, 1.0))
