"""Errors of fitted values: with correlated residuals, and for values that are not determined.

With residuals of covariance Γ the estimate's covariance is the sandwich N⁻¹ (Jᵀ Γ J) N⁻¹, N = Jᵀ J,
the windows' starts eliminated from J. Γ is that of a stationary series with the residuals' own
spectral density, so that Jᵀ Γ J is a sum over frequencies (Ljung, System Identification, ch. 9).
Where residuals are largest just where J is, as those of a noisy drive are, that is too little: a
variance is never below that from sums of Jᵀ r over blocks of the record.

Noise of the base's sensor drives the model, so the residuals that it causes are as narrow as the
resonance and largest where the values have their effect. A single record shows their spectrum there
by some ten independent lines, and a smoothed spectrum is too low. Hence the spectrum is simulated:
white noise is added to the acceleration and sent through the model in the fit's own windows. Its
size relative to the outputs' white noise is the one that explains the residuals (Whittle's
likelihood).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from harvester.identification.response import Experiment
from harvester.identification.shooting import without_states
from harvester.identification.validation_record import noise_floor

if TYPE_CHECKING:
    from harvester.identification.shooting import Shooting, ShootingFit

# Half width of a normal variable's 95 % interval, in standard errors.
HALF_INTERVAL = 1.96
# Probability of an interval, and the most by which leaving out one record may move a value, in
# sizes of the value.
HELD, MOST_MOVED = 0.95, 10.0
# A value with a larger relative standard error than this is undetermined.
UNDETERMINED = 0.5
# Eigenvalues below this share of the largest are rounding of the difference quotients.
SMALLEST_EIGENVALUE = 1e-13
# A value belongs to an undetermined direction if its component exceeds this share of the largest
# one.
SHARE_OF_DIRECTION = 0.1
# Number of blocks of a record; their sums of Jᵀ r are taken as independent.
BLOCKS = 12
# Number of segments that a residual's spectrum is averaged over.
SEGMENTS = 12
# Number of drawn noise records of each experiment: a variance from them is known to a third.
DRAWS = 16
# Largest and smallest noise that is drawn, as shares of the base's rms. A higher floor is motion up
# to half the sampling rate; a record without noise still has a direction in which noise would act.
MOST_BASE_NOISE, LEAST_BASE_NOISE = 0.05, 1e-6
# Iterations of Whittle's likelihood; from the third on its sizes change by less than 1 %.
WHITTLE_STEPS = 5


@dataclass(frozen=True)
class Undetermined:
    """A direction in which the values can move without the data noticing.

    Attributes
    ----------
    keys : tuple of str
        Keys of the values that move together.
    powers : tuple of float
        The product of the values to these powers is what is determined; empty for a single value.
    """

    keys: tuple[str, ...]
    powers: tuple[float, ...]

    def __str__(self) -> str:
        names = [key.rpartition(".")[2] for key in self.keys]
        if not self.powers:
            return f"{names[0]} is not determined"
        factors = [
            name if power == 1.0 else f"{name}^{power:.3g}"
            for name, power in zip(names, self.powers, strict=True)
        ]
        return f"{' and '.join(names)} are not determined apart, only {' · '.join(factors)}"


def interval(value: float, standard_error: float) -> tuple[float, float]:
    """95 % interval of a normal estimate."""
    return value - HALF_INTERVAL * standard_error, value + HALF_INTERVAL * standard_error


def covariance(shooting: Shooting, fit: ShootingFit) -> np.ndarray:
    """Covariance of the values, in the scene's units squared, shape (unknowns, unknowns)."""
    p = len(shooting.unknowns)
    normal, meat, blocks, noise = (np.zeros((p, p)) for _ in range(4))
    for number, edges in enumerate(fit.edges):
        table, _ = shooting.jacobian(fit, number)
        columns = without_states(table[..., :p], table[..., p : p + 3], edges - edges[0])
        normal += np.einsum("noi,noj->ij", columns, columns)
        free = table.shape[0] - 3 * (edges.size - 1) - p
        fitted_away = table.shape[0] / max(free, 1)
        meat += _meat(columns, table[..., -1]) * fitted_away
        noise += covariance_of_scores(shooting, fit, number, table, columns) * fitted_away
        scores = np.einsum("noi,no->ni", columns, table[..., -1])
        sums = np.array([part.sum(axis=0) for part in np.array_split(scores, BLOCKS)])
        blocks += sums.T @ sums * BLOCKS / (BLOCKS - 1)
    # A value without any effect gets the largest variance, not an infinite one.
    sizes = np.diag(normal).copy()
    sizes[sizes < SMALLEST_EIGENVALUE * sizes.max()] = sizes.max() or 1.0
    normal += SMALLEST_EIGENVALUE * np.diag(sizes)
    meat += SMALLEST_EIGENVALUE * np.diag(sizes)
    inverse = _inverse(normal)
    sandwich = inverse @ meat @ inverse
    least = np.maximum(*(np.diag(inverse @ matrix @ inverse) for matrix in (blocks, noise)))
    shares = shooting.sizes * np.sqrt(np.maximum(least / np.diag(sandwich), 1.0))
    return sandwich * np.outer(shares, shares)


def moved_by_records(shooting: Shooting, fit: ShootingFit, records: int) -> np.ndarray:
    """Covariance from the changes of the values as each record is left out in turn (jackknife).

    It holds a model's error, which differs from record to record. Each fit without a record is one
    step of the linearized problem. A variance from so few records is itself uncertain: intervals
    are widened by Student's distribution. Zero of a single record.

    Parameters
    ----------
    records : int
        Number of records in time, which come first. Frequency responses and impedances stay in:
        what one of them alone determines, such as the mass, would be without a bound where it is
        left out.

    Returns
    -------
    ndarray, shape (unknowns, unknowns)
        In the scene's units squared.
    """
    from scipy.stats import t

    p = len(shooting.unknowns)
    if records < 2 or not (fit.grams or shooting.linearized(fit)):
        return np.zeros((p, p))
    normal, gradient = shooting.reduced(fit)
    systems = [shooting.reduced(replace(fit, grams=[grams])) for grams in fit.grams[:records]]
    moves = np.array([-_inverse(normal - n) @ (gradient - g) for n, g in systems]) * shooting.sizes
    moves = np.clip(moves, -MOST_MOVED * shooting.sizes, MOST_MOVED * shooting.sizes)
    moves -= moves.mean(axis=0)
    student = t.ppf(0.5 + 0.5 * HELD, records - 1) / HALF_INTERVAL
    return student**2 * (records - 1) / records * moves.T @ moves


def _meat(columns, residuals):
    """Jᵀ Γ J of one experiment, over all pairs of outputs."""
    from scipy import signal

    samples, outputs, p = columns.shape
    segment = min(max(16, 2 * samples // (SEGMENTS + 1)), samples)
    options = {"nperseg": segment, "detrend": False, "return_onesided": False}
    spectra = np.fft.rfft(columns, axis=0)
    frequencies = np.fft.rfftfreq(samples)
    # Each line stands for positive and negative frequency, except the first and the last.
    weight = np.full(frequencies.size, 2.0)
    weight[0] = 1.0
    if samples % 2 == 0:
        weight[-1] = 1.0
    total = np.zeros((p, p))
    for a in range(outputs):
        for b in range(outputs):
            f, density = signal.csd(residuals[:, a], residuals[:, b], **options)
            positive = f >= 0.0
            order = np.argsort(f[positive])
            values = np.interp(frequencies, f[positive][order], density[positive][order])
            products = np.einsum(
                "k,ki,kj->ij", weight * values, spectra[:, a].conj(), spectra[:, b]
            )
            total += products.real / samples
    return 0.5 * (total + total.T)


def _inverse(normal):
    """Inverse of a matrix that may be singular; undetermined directions get a large variance."""
    scale = np.sqrt(np.diag(normal))
    values, vectors = np.linalg.eigh(normal / np.outer(scale, scale))
    values = np.maximum(values, SMALLEST_EIGENVALUE * values[-1])
    return (vectors / values) @ vectors.T / np.outer(scale, scale)


def undetermined(
    keys: list[str], values: np.ndarray, sizes: np.ndarray, covariance: np.ndarray
) -> list[Undetermined]:
    """Directions of relative values in which the standard error is too large.

    Parameters
    ----------
    values, sizes : ndarray
        Values and sizes of the unknowns; a value much smaller than its size counts in sizes.
    """
    units = np.where(np.abs(values) > 1e-3 * sizes, np.abs(values), sizes)
    relative = covariance / np.outer(units, units)
    spread, directions = np.linalg.eigh(relative)
    unclear = []
    for k in np.flatnonzero(np.sqrt(np.maximum(spread, 0.0)) > UNDETERMINED)[::-1]:
        direction = directions[:, k]
        members = np.flatnonzero(np.abs(direction) > SHARE_OF_DIRECTION * np.abs(direction).max())
        members = members[np.argsort(-np.abs(direction[members]))]
        names = tuple(keys[n] for n in members)
        unclear.append(Undetermined(names, _determined_powers(relative, members)))
    return unclear


def _determined_powers(relative, members):
    """Exponents of the product of the undetermined values that the records determine best."""
    if members.size == 1:
        return ()
    _, directions = np.linalg.eigh(relative[np.ix_(members, members)])
    best = directions[:, 0]
    return tuple(float(power) for power in np.round(best / best[np.argmax(np.abs(best))], 3))


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
    shooting: Shooting, fit: ShootingFit, number: int, table: np.ndarray, columns: np.ndarray
) -> np.ndarray:
    """Covariance of one experiment's scores, shape (unknowns, unknowns), in the fit's weights.

    Zero of a frequency response or an impedance.

    Parameters
    ----------
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
    from_base = of_base / drawn.shape[-1] * scores @ scores.T
    return from_base + np.einsum("o,noi,noj->ij", of_outputs, columns, columns)


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
