"""White noise, band-limited by its knots: independent values with linear interpolation."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from harvester.base.errors import SceneError
from harvester.device.keys import positive, table
from harvester.excitation.base import Excitation, ExcitationPath, Run, kernel_loss, knots

if TYPE_CHECKING:
    from numpy.random.bit_generator import SeedSequence


@table
class White(Excitation):
    """White base acceleration of two-sided density D/π, up to the band limit of the knots.

    Values at the knots are independent with variance 2 D/spacing. Straight lines between them
    give the density D/π · sinc⁴(ω spacing/2): D/π at low frequency, half of it at 0.32/spacing
    hertz, and an autocorrelation of area 2 D.

    With the default `knot_spacing`, 0.4 % of the density is lost at the device's frequency.
    """

    intensity: float = positive("noise intensity D: density D/π", "m²/s³", "D", required=True)
    kind: str = "white"
    knot_spacing: float | None = knots("a fortieth of the device's period")

    endless = True

    def spacing(self, longest: float) -> float:
        if self.knot_spacing is not None:
            return self.knot_spacing
        if not math.isfinite(longest):
            raise SceneError(
                "excitation.knot_spacing is missing: give it (s), since this device has no natural "
                "frequency to derive it from"
            )
        return longest

    def equivalent_noise(self, relaxation_time: float, longest: float) -> tuple[float, float]:
        # 1/(1 + ω²τ1²) and sinc⁴(ω spacing/2) agree to second order for this τ1.
        return self.intensity, self.spacing(longest) / math.sqrt(6.0)

    def density(self, frequencies: np.ndarray) -> np.ndarray:
        """4 D at all frequencies, without the band limit of the knots."""
        return np.full(np.shape(frequencies), 4.0 * self.intensity)

    def path(self, spacing: float, length: float, seed: SeedSequence) -> ExcitationPath:
        from harvester.excitation.correlated_normals import NormalPath

        deviation = math.sqrt(2.0 * (self.intensity / length**2) / spacing)
        return NormalPath(seed, deviation, spacing=spacing)

    def notes(self, spacing: float, angular_frequency: float, run: Run) -> tuple[str, ...]:
        loss = kernel_loss(spacing, angular_frequency)
        return (
            f"white noise linear between samples {spacing:.3g} s apart: its density is {loss:.1%} "
            f"below D/π at the device's frequency and half of it at {0.3189 / spacing:.3g} Hz",
        )

    def averaging_refusal(self) -> str:
        return ""
