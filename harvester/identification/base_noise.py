"""Covariance of a fit's scores Jᵀ r from the noise of the sensors of base and outputs.

Noise of the base's sensor drives the model, so what it leaves is as narrow as the resonance and
largest where the values have their effect. A single record's residuals show its spectrum there by
some ten independent lines, and a smoothed spectrum is too low. Hence its shape is drawn: white
noise is added to the acceleration and sent through the model in the fit's own windows. Its size
beside the outputs' white noise is the one that explains the residuals (Whittle's likelihood).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from harvester.identification.proof import noise_floor
from harvester.identification.response import Experiment
from harvester.identification.window_states import without_states

if TYPE_CHECKING:
    from harvester.identification.shooting import Fit, Shooting

# Number of drawn noise records of each experiment: a variance from them is known to a third.
DRAWS = 16
# Largest and smallest noise that is drawn, as shares of the base's rms. A higher floor is motion up
# to half the sampling rate; a record without noise still has a direction in which noise would act.
MOST_BASE_NOISE, LEAST_BASE_NOISE = 0.05, 1e-6
# Iterations of Whittle's likelihood; from the third on its sizes change by less than 1 %.
WHITTLE_STEPS = 5


def base_noise(acceleration: np.ndarray, rate: float) -> float:
    """rms noise of the base's sensor, from the floor of its spectrum.

    Parameters
    ----------
    acceleration : ndarray, shape (n,)
    rate : float
        Hz.
    """
    return min(noise_floor(acceleration, rate), MOST_BASE_NOISE * float(np.std(acceleration)))


def covariance_of_scores(
    shooting: Shooting, fit: Fit, number: int, table: np.ndarray, columns: np.ndarray
) -> np.ndarray:
    """Covariance of one experiment's scores, shape (unknowns, unknowns), in the fit's weights.

    Zero of a frequency response or an impedance.

    Parameters
    ----------
    shooting : Shooting
    fit : Fit
    number : int
        Of the experiment.
    table : ndarray, shape (samples, outputs, unknowns + 4)
        [J_unknowns, J_states, r].
    columns : ndarray, shape (samples, outputs, unknowns)
        J_unknowns without what the windows' starts explain.
    """
    p = columns.shape[-1]
    if not isinstance(shooting.responses.experiments[number], Experiment):
        return np.zeros((p, p))
    cuts = fit.edges[number] - fit.edges[number][0]
    drawn = without_states(_drawn(shooting, fit, number), table[..., p : p + 3], cuts)
    of_base, of_outputs = _sizes(table[..., -1], drawn)
    scores = np.einsum("noi,nod->id", columns, drawn)
    covariance = of_base / drawn.shape[-1] * scores @ scores.T
    return covariance + np.einsum("o,noi,noj->ij", of_outputs, columns, columns)


def _drawn(shooting, fit, number):
    """Weighted residuals from drawn noise of the base's sensor, shape (samples, outputs, draws)."""
    measurement = shooting.responses.experiments[number].measurement
    base, rate = measurement.acceleration, measurement.sampling_rate
    size = max(base_noise(base, rate), LEAST_BASE_NOISE * float(np.std(base)))
    noise = size * np.random.default_rng(0).standard_normal((base.size, DRAWS))
    residuals = shooting.responses.moved_by_noise(
        number, noise, fit.values, fit.edges[number], fit.starts[number]
    )
    return residuals / fit.noise[number][:, None]


def _sizes(left, drawn):
    """Share of the drawn spectrum in the residuals', and each output's own mean square."""
    from scipy.optimize import nnls

    samples, outputs = left.shape
    seen = np.abs(np.fft.rfft(left, axis=0)[1:]) ** 2 / samples
    shape = np.mean(np.abs(np.fft.rfft(drawn, axis=0)[1:]) ** 2, axis=-1) / samples
    white = np.kron(np.eye(outputs), np.ones((seen.shape[0], 1)))
    parts = np.column_stack([shape.T.ravel(), white])
    spectrum = seen.T.ravel()
    explained = np.repeat(np.maximum(seen.mean(axis=0), 1e-300), seen.shape[0])
    for _ in range(WHITTLE_STEPS):
        sizes = nnls(parts / explained[:, None], spectrum / explained)[0]
        explained = np.maximum(parts @ sizes, 1e-12 * explained.max())
    return sizes[0], sizes[1:]
