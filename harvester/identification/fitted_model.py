"""A model fitted to records: values, covariance, and predictions of the data kept aside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from harvester.base.errors import IdentificationError
from harvester.excitation.recorded import RecordedMotion
from harvester.identification.intervals import undetermined
from harvester.identification.measured_response import MeasuredResponse
from harvester.identification.proof import ValidationStretch, sensor_noise
from harvester.identification.shooting import Shooting, ShootingFit
from harvester.identification.unknowns import Unknown, first_sizes, sizes_of, unknowns, with_values

if TYPE_CHECKING:
    from harvester.identification.measurement import Measurement
    from harvester.scene.model import Scene


# A good model leaves at most this share of an output's rms beyond the sensor's noise.
MISSED_SHARE = 0.05
MOST_NOISE = 0.5
# Two errors that differ by less than this share count as equal.
NOTED = 0.02


@dataclass(frozen=True)
class Fitted:
    """A model with the values that fit.

    Attributes
    ----------
    scene : Scene
        The scene with the fitted values.
    values : ndarray, shape (unknowns,)
    covariance : ndarray, shape (unknowns, unknowns)
    stretches : list of ValidationStretch
        The kept-aside part of each record.
    interpolation : str
        Interpolation of the acceleration between its samples.
    settled : ShootingFit or None
        Windows of the parts kept aside, of records in time.
    """

    scene: Scene
    values: np.ndarray
    covariance: np.ndarray
    undetermined: list
    stretches: list[ValidationStretch]
    interpolation: str
    shooting: Shooting
    fit: ShootingFit
    settled: ShootingFit | None = None

    @classmethod
    def concluded(
        cls,
        scene: Scene,
        shooting: Shooting,
        fit: ShootingFit,
        covariance: np.ndarray,
        stretches: list[ValidationStretch],
        settled: ShootingFit | None = None,
    ) -> Fitted:
        """The model at the end of a fit; `scene` is the scene that the fit began with.

        Raises
        ------
        IdentificationError
            No device has these values.
        """
        keys = [unknown.key for unknown in shooting.unknowns]
        fitted_scene = with_values(scene, keys, fit.values)
        if fitted_scene is None:
            raise IdentificationError(
                f"{scene.name}: the scene refuses the best-fitting values: check the columns' "
                "units and signs, free fewer (--free), or begin nearer (--set)"
            )
        path = shooting.responses.interpolation
        base = fitted_scene.excitation
        if isinstance(base, RecordedMotion) and base.knot_spacing is None:
            # Later simulations under this record then interpolate it as the fit did.
            fitted_scene = fitted_scene.replace({"excitation.interpolation": path})
        unclear = undetermined(keys, fit.values, shooting.sizes, covariance)
        return cls(
            fitted_scene, fit.values, covariance, unclear, stretches, path, shooting, fit, settled
        )

    def with_covariance(self, covariance: np.ndarray) -> Fitted:
        """The same model with another covariance, which gives wider intervals."""
        sizes = self.shooting.sizes
        unclear = undetermined(self.keys, self.values, sizes, covariance)
        return replace(self, covariance=covariance, undetermined=unclear)

    def with_more(
        self, added: Sequence[Unknown], sizes: dict[str, float], scene: Scene, keys: Sequence[str]
    ) -> tuple[Shooting, ShootingFit] | None:
        """The problem with more unknowns, linearized at the values that fit; None if it diverges.

        Experiments get the spring of `scene`, in which the model's values have these keys.
        """
        free = [
            unknown.begun(value)
            for unknown, value in zip(unknowns(scene, keys, sizes), self.values, strict=True)
        ]
        free += added
        experiments = self.shooting.responses.experiments
        if scene is not self.scene:
            force = [k or 0.0 for k in scene.oscillator.coefficients]
            experiments = [
                replace(other, scene=other.scene.replace({"oscillator.restoring_force": force}))
                for other in experiments
            ]
        names = [unknown.key for unknown in free]
        shooting = self.shooting.beside(self.shooting.responses.replaced(experiments, names), free)
        fit = replace(self.fit, values=np.array([unknown.start for unknown in free]))
        return (shooting, fit) if shooting.linearized(fit) else None

    @property
    def sensor_noise(self) -> float:
        """Noise of the first output's sensor, as a share of its rms, in the noisiest record."""
        return max(sensor_noise(part) for part in self.stretches)

    @property
    def adequate(self) -> bool:
        """Whether the residuals of the data kept aside are little more than the sensor's noise."""
        noise = min(self.sensor_noise, MOST_NOISE)
        return max(self.nrmse**2 - noise**2, 0.0) <= MISSED_SHARE**2

    @property
    def leaves_noise(self) -> bool:
        """Whether the residuals of the data kept aside are only noise, so that no model can
        be better."""
        return all(part.nrmse() <= (1.0 + NOTED) * sensor_noise(part) for part in self.stretches)

    @property
    def keys(self) -> list[str]:
        """Keys of the values."""
        return self.shooting.responses.keys

    @property
    def standard_errors(self) -> np.ndarray:
        """Standard errors of the values."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def nrmse(self) -> float:
        """Normalized rms error of the first output over all stretches kept aside."""
        return float(np.sqrt(np.mean([part.nrmse() ** 2 for part in self.stretches])))


def fitted_sizes(base: Fitted, measurements: Sequence[Measurement]) -> dict[str, float]:
    """Sizes from the fitted motion; for a frequency response those of `first_sizes`."""
    if isinstance(measurements[0], MeasuredResponse):
        return first_sizes(base.scene, measurements)
    reach, speed = 0.0, 0.0
    fit = base.fit
    for number in range(len(fit.edges)):
        states = base.shooting.states(fit, number)
        reach = max(reach, float(np.abs(states[:, 0]).max()))
        speed = max(speed, float(np.std(states[:, 1])))
    length = base.shooting.responses.length
    return sizes_of(base.scene, measurements, reach * length, speed * length)
