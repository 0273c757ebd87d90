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
from typing import TYPE_CHECKING

import numpy as np

from harvester.identification.intervals import base_noise
from harvester.identification.sensors import integrals
from harvester.identification.shooting import without_states
from harvester.identification.validation_record import noise_floor

if TYPE_CHECKING:
    from harvester.identification.fitting import Fitted

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
    records = range(len(fitted.settled.edges))
    return [misfit for number in records for misfit in _misfits_of(fitted, number)]


def worst(found: Sequence[Misfit]) -> Misfit | None:
    """The misfit that is farthest from noise; None where all are noise."""
    wrong = [misfit for misfit in found if not misfit.is_noise]
    return max(wrong, key=lambda misfit: misfit.systematic, default=None)


def _misfits_of(fitted, number):
    """Misfits of one record, the fitted starts of the windows projected out of its residuals."""
    shooting, fit = fitted.shooting.frozen(), fitted.settled
    measurement = shooting.responses.experiments[number].measurement
    edges, noise = fit.edges[number], fit.noise[number]
    cuts, inside = edges - edges[0], slice(edges[0], edges[-1])
    measured, table = shooting.seen(number, edges), shooting.jacobian(fit, number)[0]
    left, starts = table[..., -1], table[..., :-1]
    drawn = without_states(_drawn(shooting, fit, number, measured) / noise[:, None], starts, cuts)
    simulated = left * noise + measured
    results = []
    for output, name in enumerate(measurement.outputs):
        columns = _signals(measurement, inside, simulated[:, output])
        alone = np.zeros((*measured.shape, columns.shape[1]))
        alone[:, output] = columns
        signals = without_states(alone, starts, cuts)[:, output]
        spectrum = _smooth(np.mean(np.abs(np.fft.rfft(drawn[:, output], axis=0)) ** 2, axis=1))
        systematic, ratio = _regressed(left[:, output], signals, spectrum)
        unit = float(noise[output] / np.std(measured[:, output]))
        rms, drawn_rms = (unit * _rms(values[:, output]) for values in (left, drawn))
        results.append(Misfit(measurement.name, name, rms, drawn_rms, unit * systematic, ratio))
    return results


def _drawn(shooting, fit, number, measured):
    """Simulated residuals of a right model, shape (samples, outputs, draws)."""
    measurement = shooting.responses.experiments[number].measurement
    random = np.random.default_rng(0)
    rate, base = measurement.sampling_rate, measurement.acceleration
    floors = np.array([noise_floor(series, rate) for series in measured.T])
    shaken = base_noise(base, rate) * random.standard_normal((base.size, DRAWS))
    edges, starts = fit.edges[number], fit.starts[number]
    drawn = shooting.responses.moved_by_noise(number, shaken, fit.values, edges, starts)
    return drawn + floors[:, None] * random.standard_normal(drawn.shape)


def _signals(measurement, inside, simulated):
    """Signals that a wrong model would leave in an output's residuals, shape (samples, signals)."""
    places = np.arange(measurement.acceleration.size)
    integral = integrals(measurement.acceleration, measurement.sampling_rate, places)[0][inside]
    base, moved = measurement.acceleration[inside], simulated - simulated.mean()
    slope = np.gradient(moved)
    signals = [moved, slope, base, integral, moved**2, moved**3, moved**2 * slope]
    columns = np.column_stack([signal - signal.mean() for signal in signals])
    return columns / np.maximum(columns.std(axis=0), 1e-300)


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
