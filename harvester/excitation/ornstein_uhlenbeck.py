"""Ornstein–Uhlenbeck noise sampled exactly at knots (Eq. 6)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from harvester.base.errors import SceneError
from harvester.device.keys import OneOf, positive, table
from harvester.excitation.base import Excitation, ExcitationPath, Run, knots

if TYPE_CHECKING:
    from numpy.random.bit_generator import SeedSequence


# Default number of knots per correlation time τ1. Linear interpolation lowers the variance of the
# noise by the share spacing/(3 τ1), 4 % here.
KNOTS_PER_CORRELATION_TIME = 8


@table
class OrnsteinUhlenbeck(Excitation):
    """Ornstein–Uhlenbeck base acceleration, Eq. 6."""

    intensity: float = positive("noise intensity D: the variance is D/τ1", "m²/s³", "D")
    correlation_time: float = positive(
        "correlation time of the noise: τ1", "s", "τ1", required=True, usual=(1e-6, 10.0)
    )
    kind: str = "ornstein-uhlenbeck"
    knot_spacing: float | None = knots("an eighth of τ1 or a fortieth of the device's period")
    rms: float | None = positive(
        "base acceleration, rms: √(D/τ1)", "m/s²", "of η", usual=(1e-4, 1e4)
    )

    ALTERNATIVES: ClassVar = (OneOf(("intensity", "rms")),)
    endless = True

    def __post_init__(self) -> None:
        if self.rms is not None:
            object.__setattr__(self, "intensity", self.rms**2 * self.correlation_time)

    def spacing(self, longest: float) -> float:
        if self.knot_spacing is None:
            return min(self.correlation_time / KNOTS_PER_CORRELATION_TIME, longest)
        # Checked only here, since averaging needs no knots.
        if self.knot_spacing > self.correlation_time:
            raise SceneError(
                f"excitation.knot_spacing = {self.knot_spacing:g}: must be a number in "
                f"(0, {self.correlation_time:g}], the correlation time; omit the key for a "
                "suitable spacing"
            )
        return self.knot_spacing

    def equivalent_noise(self, relaxation_time: float, longest: float) -> tuple[float, float]:
        return self.intensity, self.correlation_time

    def density(self, frequencies: np.ndarray) -> np.ndarray:
        """4 D/(1 + ω²τ1²), Eq. 6 one-sided in f."""
        omega = 2.0 * math.pi * frequencies
        return 4.0 * self.intensity / (1.0 + (omega * self.correlation_time) ** 2)

    def path(self, spacing: float, length: float, seed: SeedSequence) -> ExcitationPath:
        """Samples with the exact distribution at the knots, stationary from the first one (Eq. 6).

        η_{k+1} = a η_k + √(D/τ1 (1 − a²)) ξ_k, a = exp(−spacing/τ1). Engines interpolate η linearly
        between knots, which lowers the time-averaged variance by the share spacing/(3 τ1)
        (`interpolation_loss`).
        """
        from harvester.excitation.correlated_normals import NormalPath

        deviation = math.sqrt(self.intensity / length**2 / self.correlation_time)
        return NormalPath(seed, deviation, spacing / self.correlation_time, spacing)

    def notes(self, spacing: float, angular_frequency: float, run: Run) -> tuple[str, ...]:
        loss = interpolation_loss(spacing, self.correlation_time)
        return (f"noise linear between samples: its variance is {loss:.1%} below D/τ1",)

    def averaging_refusal(self) -> str:
        return ""


def interpolation_loss(spacing: float, correlation_time: float) -> float:
    """Share of the noise's variance that is lost by linear interpolation between knots.

    The mean over a segment of ((1−u) η0 + u η1)² is D/τ1 (2 + a)/3 with a = exp(−spacing/τ1).
    """
    return -math.expm1(-spacing / correlation_time) / 3.0
