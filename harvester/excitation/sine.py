"""Harmonic base acceleration: one frequency, or several in succession."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from harvester.device.keys import key, not_negative, positive, table
from harvester.excitation.base import Excitation, ExcitationPath, Run, knots

KNOTS_PER_PERIOD = 40
# With fewer knots per period, straight lines do not approximate a sine.
FEWEST_KNOTS_PER_PERIOD = 8
DETERMINISTIC_NOTE = (
    "the excitation is periodic and deterministic: means are over whole periods, and error bars "
    "show the remaining transient, the scatter of the means if the motion has another period, the "
    "error of the steps"
)


class Harmonic(Excitation):
    """Base of all sinusoidal excitations, which have `lines` and a phase, and are deterministic."""

    symmetric = False
    random = False

    def density(self, frequencies: np.ndarray) -> np.ndarray:
        """Continuous spectral density: 0, as sines have only its `lines`."""
        return np.zeros(np.shape(frequencies))

    def equivalent_noise(self, relaxation_time: float, longest: float) -> tuple[float, float]:
        # At resonance 2 E[X'²] = (amplitude · relaxation time)². With noise, E[X'²] is the
        # relaxation time times D/(1 + ω²τ1²).
        return max(
            (max(amplitude, 1e-150) ** 2 * relaxation_time, 1.0 / (2.0 * math.pi * frequency))
            for frequency, amplitude in self.lines
        )


@table
class Sine(Harmonic):
    """η = amplitude · sin(2π frequency t + phase).

    η is linear between knots; the factor 1/sinc²(ω spacing/2) gives the component at this frequency
    the correct amplitude.
    """

    amplitude: float = not_negative("amplitude", "m/s²", "η", required=True)
    frequency: float = positive("frequency", "Hz", required=True)
    phase: float = key("phase: at the beginning", "rad", default=0.0)
    kind: str = "sine"
    knot_spacing: float | None = knots("a fortieth of the shorter period of sine and device")

    @property
    def lines(self) -> tuple[tuple[float, float], ...]:
        return ((self.frequency, self.amplitude),)

    @property
    def period(self) -> float | None:
        return 1.0 / self.frequency

    def check(self, units: str, run: Run, origin: str) -> None:
        longest = 1.0 / (FEWEST_KNOTS_PER_PERIOD * self.frequency)
        self._check_knot_spacing(longest, "an eighth of the sine's period", origin)

    def spacing(self, longest: float) -> float:
        if self.knot_spacing is not None:
            return self.knot_spacing
        knots = math.ceil(max(KNOTS_PER_PERIOD, 1.0 / (self.frequency * longest)) - 1e-9)
        return 1.0 / (self.frequency * knots)

    def path(self, spacing: float, length: float, seed: Any) -> ExcitationPath:
        return SinePath(self.amplitude / length, (self.frequency,), math.inf, spacing, self.phase)

    def notes(self, spacing: float, angular_frequency: float, run: Run) -> tuple[str, ...]:
        return (DETERMINISTIC_NOTE,)


@table
class SteppedSine(Harmonic):
    """Successive frequencies with continuous phase, for frequency responses.

    Not available in scenes: `harvester.frequency_response` creates it.

    `amplitude`: in m/s² in SI. `frequencies`: Hz. `dwell`: time at each frequency (s).
    """

    amplitude: float
    frequencies: tuple
    dwell: float
    knot_spacing: float
    kind: str = "stepped sine"

    @property
    def lines(self) -> tuple[tuple[float, float], ...]:
        return tuple((frequency, self.amplitude) for frequency in self.frequencies)

    def spacing(self, longest: float) -> float:
        return self.knot_spacing

    def path(self, spacing: float, length: float, seed: Any) -> ExcitationPath:
        return SinePath(self.amplitude / length, self.frequencies, self.dwell, spacing)

    def base_displacement(self, times: np.ndarray, place: int) -> np.ndarray:
        """The displacement η/ω² of the base at this frequency (m in SI)."""
        frequency = self.frequencies[place]
        turns = sum(self.frequencies[:place]) * self.dwell
        angle = 2.0 * math.pi * (turns + frequency * (times - place * self.dwell))
        return self.amplitude / (2.0 * math.pi * frequency) ** 2 * np.sin(angle)

    def notes(self, spacing: float, angular_frequency: float, run: Run) -> tuple[str, ...]:
        return ()


class SinePath(ExcitationPath):
    """Samples of successive sines of equal duration, with continuous phase.

    Parameters
    ----------
    amplitude : float
        Amplitude of η, scaled units.
    frequencies : sequence of float
        Hz; the last one continues until the end.
    dwell : float
        Time at each frequency except the last (s).
    spacing : float
        Time between knots (s).
    phase : float
        Phase at the beginning (rad).
    """

    def __init__(
        self,
        amplitude: float,
        frequencies: Sequence[float],
        dwell: float,
        spacing: float,
        phase: float = 0.0,
    ) -> None:
        self.spacing = spacing
        self._frequencies = np.array(frequencies)
        self._dwell = dwell
        self._heights = amplitude / np.sinc(self._frequencies * spacing) ** 2
        turns: Any = np.cumsum(self._frequencies[:-1]) * dwell if len(frequencies) > 1 else []
        self._turns = phase / (2.0 * math.pi) + np.concatenate([[0.0], turns])
        self._next = 0

    def read(self, count: int) -> np.ndarray:
        times = np.arange(self._next, self._next + count) * self.spacing
        self._next += count
        last = self._frequencies.size - 1
        at = np.minimum((times / self._dwell + 1e-12).astype(int), last)
        since = times - np.where(at > 0, at * self._dwell, 0.0) if last else times
        turns = self._turns[at] + self._frequencies[at] * since
        return self._heights[at] * np.sin(2.0 * math.pi * np.mod(turns, 1.0))
