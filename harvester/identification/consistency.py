"""Whether a model's residuals are only the sensors' noise.

The noise of each output is added to the simulated one, and that of the base's sensor to what drives
the model: this simulates the residuals that a right model would have, in the same windows. Their
spectrum weights the measured residuals. These are then regressed on signals that a wrong model
would leave, made of the measured acceleration and the simulated output. For a right model the
regression explains no more than chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.identification.intervals import base_noise
from harvester.identification.proof import noise_floor
from harvester.identification.sensors import integrals
from harvester.identification.window_states import without_states

if TYPE_CHECKING:
    from harvester.identification.fitted_model import Fitted

# Number of drawn noise records, and of neighbouring lines over which their spectrum is averaged.
DRAWS, LINES = 6, 9
# Residuals are systematic if the regression's F exceeds this. Fourteen sets of three records with
# right models had up to 4.2, the values' own errors included; sets with wrong sensors, springs or
# loads had 32 and more in their worst record.
SYSTEMATIC = 12.0
# A systematic part below this share of an output's standard deviation is ignored.
UNNOTICED = 2e-3
# Singular values below this share of the largest are dropped: some columns are nearly the same.
SMALLEST_DIRECTION = 1e-8


@dataclass(frozen=True)
class Misfit:
    """Residuals of one output of one record, as shares of its standard deviation.

    Attributes
    ----------
    left : float
        rms of the residuals.
    noise : float
        Residual that a right model would leave.
    systematic : float
        rms of the residuals' part that follows from the acceleration and the motion.
    ratio : float
        F of that part: about 1 for a right model.
    """

    record: str
    output: str
    left: float
    noise: float
    systematic: float
    ratio: float

    @property
    def is_noise(self) -> bool:
        """Whether the residual is compatible with noise, so the model may be right."""
        return self.ratio < SYSTEMATIC or self.systematic < UNNOTICED


def misfits(fitted: Fitted) -> list[Misfit]:
    """Misfits of each record's outputs in the part kept aside; none of frequency responses."""
    if fitted.settled is None:
        return []
    return [
        misfit
        for number in range(len(fitted.settled.edges))
        for misfit in _Residuals(fitted, number).misfits()
    ]


def worst(found: Sequence[Misfit]) -> Misfit | None:
    """The misfit that is farthest from noise; None where all are noise."""
    wrong = [misfit for misfit in found if not misfit.is_noise]
    return max(wrong, key=lambda misfit: misfit.systematic, default=None)


class _Residuals:
    """Weighted residuals of one record, with the fitted starts of the windows projected out."""

    def __init__(self, fitted: Fitted, number: int) -> None:
        settled: Any = fitted.settled
        self.responses, self.number = fitted.shooting.responses, number
        self.values, self.edges = fitted.values, settled.edges[number]
        self.starts, self.noise = settled.starts[number], settled.noise[number]
        self.inside = slice(self.edges[0], self.edges[-1])
        self._cuts = self.edges - self.edges[0]
        frozen = fitted.shooting.frozen()
        self.measured = frozen.seen(number, self.edges)
        self.table = frozen.jacobian(settled, number)[0]
        self.experiment = self.responses.experiments[number]

    def misfits(self) -> list[Misfit]:
        left, drawn = self.table[..., -1], self._drawn()
        simulated = left * self.noise + self.measured
        results = []
        for output, name in enumerate(self.experiment.measurement.outputs):
            signals = self._signals(output, simulated[:, output])
            spectrum = _smooth(np.mean(np.abs(np.fft.rfft(drawn[:, output], axis=0)) ** 2, axis=1))
            systematic, ratio = _regressed(left[:, output], signals, spectrum)
            unit = float(self.noise[output] / np.std(self.measured[:, output]))
            results.append(
                Misfit(
                    self.experiment.measurement.name,
                    name,
                    unit * _rms(left[:, output]),
                    unit * _rms(drawn[:, output]),
                    unit * systematic,
                    ratio,
                )
            )
        return results

    def _drawn(self):
        """Simulated residuals of a right model, shape (samples, outputs, draws)."""
        measurement, random = self.experiment.measurement, np.random.default_rng(0)
        rate, base = measurement.sampling_rate, measurement.acceleration
        floors = np.array([noise_floor(series, rate) for series in self.measured.T])
        shaken = base_noise(base, rate) * random.standard_normal((base.size, DRAWS))
        drawn = self.responses.moved_by_noise(
            self.number, shaken, self.values, self.edges, self.starts
        )
        drawn += floors[:, None] * random.standard_normal(drawn.shape)
        return without_states(drawn / self.noise[:, None], self.table[..., :-1], self._cuts)

    def _signals(self, output, simulated):
        """Signals that a wrong model would leave in an output's residuals, shape (samples,
        signals)."""
        measurement = self.experiment.measurement
        places = np.arange(measurement.acceleration.size)
        integral = integrals(measurement.acceleration, measurement.sampling_rate, places)[0]
        moved = simulated - simulated.mean()
        slope = np.gradient(moved)
        signals = [
            moved,
            slope,
            measurement.acceleration[self.inside],
            integral[self.inside],
            moved**2,
            moved**3,
            moved**2 * slope,
        ]
        columns = np.column_stack([signal - signal.mean() for signal in signals])
        columns = columns / np.maximum(columns.std(axis=0), 1e-300)
        alone = np.zeros((*self.measured.shape, columns.shape[1]))
        alone[:, output] = columns
        return without_states(alone, self.table[..., :-1], self._cuts)[:, output]


def _regressed(left, signals, spectrum):
    """rms of the part of residuals that signals explain, and its F, with weights by a spectrum."""
    weights = 1.0 / np.sqrt(np.maximum(spectrum, 1e-12 * spectrum.max()))
    seen = np.fft.rfft(left) * weights
    columns = np.fft.rfft(signals, axis=0) * weights[:, None]
    flat = np.concatenate([columns.real, columns.imag])
    coefficients, _, rank, _ = np.linalg.lstsq(
        flat, np.concatenate([seen.real, seen.imag]), rcond=SMALLEST_DIRECTION
    )
    explained = columns @ coefficients
    # The median ignores the few spectral lines of a sine that no signal explains.
    chance = float(np.median(np.abs(seen - explained) ** 2)) / np.log(2.0)
    ratio = 2.0 * float(np.sum(np.abs(explained) ** 2)) / rank / max(chance, 1e-300)
    return _rms(signals @ coefficients), ratio


def _smooth(spectrum):
    """A spectrum averaged over neighbouring lines."""
    padded = np.pad(spectrum, LINES // 2, "edge")
    return np.convolve(padded, np.full(LINES, 1.0 / LINES), "valid")


def _rms(values):
    return float(np.sqrt(np.mean(values**2)))
