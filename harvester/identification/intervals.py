"""Errors of fitted values, for correlated residuals and undetermined values.

For residuals with covariance Γ, the estimate's covariance is the sandwich N⁻¹ (Jᵀ Γ J) N⁻¹ with N =
Jᵀ J, where the windows' starts are eliminated from J. Γ is the covariance of a stationary series
with the residuals' spectral density, so that Jᵀ Γ J is a sum over frequencies (Ljung, System
Identification, ch. 9). If residuals are largest where J is, as with a noisy drive, the sandwich is
too small. Therefore the variance is at least that from sums of Jᵀ r over blocks of the record.

Noise of the base's sensor drives the model, so that its residuals are as narrow as the resonance,
and largest where the values have their effect. A single record has only about ten independent
spectral lines there, and a smoothed spectrum is too low. Therefore the spectrum is simulated:
white noise is added to the acceleration and passed through the model in the fit's windows. Its
power is the record's noise floor, limited by the residuals' spectrum without the outputs' white
noise (Whittle likelihood). Before the comparison, the part that windows' starts and values explain
is removed from both noises and the residuals: short windows absorb noise in the motion's band.

An eigenvector of the relative covariance with a large eigenvalue is a combination of values that
the data do not determine.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from harvester.identification.sensors import without_states
from harvester.identification.unknowns import LITTLE
from harvester.identification.validation_record import (
    HALF_INTERVAL,
    autocorrelations,
    drawn_base_noise,
)
from harvester.statistics.batch_means import student_factor

if TYPE_CHECKING:
    from harvester.identification.shooting import Shooting, ShootingFit
    from harvester.identification.unknowns import Unknown

# Maximum change of a value if one record is omitted, in units of the value's size.
MOST_MOVED = 10.0
# Eigenvalues below this share of the largest are round-off of the difference quotients.
SMALLEST_EIGENVALUE = 1e-13
# Number of blocks of a record, whose sums of Jᵀ r are assumed independent.
BLOCKS = 12
# Number of segments over which a residual's spectrum is averaged.
SEGMENTS = 12
# Number of simulated noise records per experiment: their variance is accurate to a third.
DRAWS = 16
# Iterations of the Whittle likelihood; from the third on, powers change by less than 1 %.
WHITTLE_STEPS = 5
# Number of standard errors at which residuals exclude the noise of the base's record.
SURE_OF_SHARE = 2.0


def interval(value: float, standard_error: float) -> tuple[float, float]:
    """95 % interval of a normally distributed estimate."""
    return value - HALF_INTERVAL * standard_error, value + HALF_INTERVAL * standard_error


@dataclass(frozen=True)
class NormalEquations:
    """Sums over all records of products of the Jacobian's columns, after eliminating windows'
    starts.

    Attributes
    ----------
    gradient : ndarray, shape (columns,)
        Jᵀ r.
    normal : ndarray, shape (columns, columns)
        Jᵀ J.
    meats : tuple of ndarray, shape (columns, columns)
        Covariances of Jᵀ r: from the residuals' spectrum, from blocks, and from noise of the base.
    """

    gradient: np.ndarray
    normal: np.ndarray
    meats: tuple[np.ndarray, ...]

    def of(self, columns: Sequence[int]) -> NormalEquations:
        """The equations of a selection of columns."""
        pairs = np.ix_(columns, columns)
        meats = tuple(meat[pairs] for meat in self.meats)
        return NormalEquations(self.gradient[columns], self.normal[pairs], meats)

    @property
    def step(self) -> np.ndarray:
        """Change of all columns' values that reduces the cost most, to first order."""
        return -_inverse(self.normal + _ridge(self.normal)) @ self.gradient

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of all columns' values."""
        ridge = _ridge(self.normal)
        inverse = _inverse(self.normal + ridge)
        meat, blocks, noise = self.meats
        sandwich = inverse @ (meat + ridge) @ inverse
        least = np.maximum(*(np.diag(inverse @ matrix @ inverse) for matrix in (blocks, noise)))
        shares = np.sqrt(np.maximum(least / np.diag(sandwich), 1.0))
        return sandwich * np.outer(shares, shares)


def _ridge(normal):
    """Matrix that limits the variance of a value without effect to the maximum."""
    sizes = np.diag(normal).copy()
    sizes[sizes < SMALLEST_EIGENVALUE * sizes.max()] = sizes.max() or 1.0
    return SMALLEST_EIGENVALUE * np.diag(sizes)


def normal_equations(
    shooting: Shooting, fit: ShootingFit, at_minimum: bool = True
) -> NormalEquations:
    """Normal equations of a fit, in units of the unknowns' sizes.

    Parameters
    ----------
    at_minimum : bool
        False if the values of some unknowns are not fitted. Residuals due to their errors then do
        not count as noise.
    """
    p, parts = len(shooting.unknowns), []
    for number, edges in enumerate(fit.edges):
        table, _ = shooting.jacobian(fit, number)
        states, residuals = table[..., p : p + 3], table[..., -1]
        parts.append((without_states(table[..., :p], states, edges - edges[0]), states, residuals))
    normal = sum(np.einsum("noi,noj->ij", columns, columns) for columns, _, _ in parts)
    gradient = sum(np.einsum("noi,no->i", columns, residuals) for columns, _, residuals in parts)
    inverse = _inverse(normal + _ridge(normal))
    step = 0.0 * gradient if at_minimum else -inverse @ gradient
    meats = []
    for number, (columns, states, residuals) in enumerate(parts):
        residuals = residuals + columns @ step
        if shooting.experiments[number].is_steady:
            # Lines of a response or an impedance are few, and their residuals mostly white.
            free = max(residuals.shape[0] - columns.shape[-1] / residuals.shape[1], 1.0)
            sizes = [float(part @ part) / free * correlation_factor(part) for part in residuals.T]
            meats.append((np.einsum("o,noi,noj->ij", sizes, columns, columns),) * 3)
            continue
        free = residuals.shape[0] - 3 * (fit.edges[number].size - 1) - p
        scores = np.einsum("noi,no->ni", columns, residuals)
        blocks = np.array([part.sum(axis=0) for part in np.array_split(scores, BLOCKS)])
        noise = _covariance_of_scores(shooting, fit, number, states, residuals, columns, inverse)
        fitted_away = residuals.shape[0] / max(free, 1)
        meats.append(
            (
                _meat(columns, residuals) * fitted_away,
                blocks.T @ blocks * BLOCKS / (BLOCKS - 1),
                noise,
            )
        )
    return NormalEquations(gradient, normal, tuple(sum(m) for m in zip(*meats, strict=True)))


def covariance(shooting: Shooting, fit: ShootingFit) -> np.ndarray:
    """Covariance of the values, in the scene's units squared, shape (unknowns, unknowns)."""
    sizes = shooting.sizes
    return normal_equations(shooting, fit).covariance * np.outer(sizes, sizes)


def moved_by_records(shooting: Shooting, fit: ShootingFit, records: int) -> np.ndarray:
    """Covariance from the changes of the values when each record is omitted in turn (jackknife).

    It includes the model error, which differs between records. Each fit without a record is one
    step of the linearized problem. As the variance from so few records is uncertain, intervals are
    widened by Student's distribution. The result is zero for a single record.

    Parameters
    ----------
    records : int
        Number of time records, which come first. Frequency responses and impedances are never
        omitted: values that only one of them determines, such as the mass, would be unbounded
        without it.

    Returns
    -------
    ndarray, shape (unknowns, unknowns)
        In the scene's units squared.
    """
    p = len(shooting.unknowns)
    if records < 2 or not (fit.grams or shooting.linearized(fit)):
        return np.zeros((p, p))
    normal, gradient, _ = shooting.reduced(fit)
    systems = [shooting.reduced(replace(fit, grams=[grams])) for grams in fit.grams[:records]]
    moves = (
        np.array([-_inverse(normal - n) @ (gradient - g) for n, g, _ in systems]) * shooting.sizes
    )
    moves = np.clip(moves, -MOST_MOVED * shooting.sizes, MOST_MOVED * shooting.sizes)
    moves -= moves.mean(axis=0)
    return student_factor(records - 1) ** 2 * (records - 1) / records * moves.T @ moves


def correlation_factor(residuals: np.ndarray) -> float:
    """Factor (≥ 1) by which correlated residuals count less than white ones.

    It is 1 + 2 Σ ρ up to the first lag within the scatter of white residuals (three times 1/√n).
    """
    n = residuals.size
    correlations = autocorrelations(residuals, n // 4 - 1)
    below = np.append(correlations, 0.0) < 3.0 / math.sqrt(n)
    return 1.0 + 2.0 * float(np.sum(correlations[: np.argmax(below)]))


def _meat(columns, residuals):
    """Jᵀ Γ J of one experiment, over all pairs of outputs."""
    from scipy import signal

    samples = residuals.shape[0]
    segment = min(max(16, 2 * samples // (SEGMENTS + 1)), samples)
    pairs = residuals.T[:, None], residuals.T[None]
    f, density = signal.csd(*pairs, nperseg=segment, detrend=False, return_onesided=False)
    spectra, frequencies = np.fft.rfft(columns, axis=0), np.fft.rfftfreq(samples)
    # Each line counts for positive and negative frequency, except the first and the last.
    weight = np.full(frequencies.size, 2.0 / samples)
    weight[0] = 1.0 / samples
    if samples % 2 == 0:
        weight[-1] = 1.0 / samples
    total = np.zeros((columns.shape[2],) * 2)
    for a, b in np.ndindex(density.shape[:2]):
        values = weight * np.interp(frequencies, f[f >= 0.0], density[a, b, f >= 0.0])
        total += (spectra[:, a].conj().T @ (values[:, None] * spectra[:, b])).real
    return 0.5 * (total + total.T)


def _inverse(normal):
    """Inverse of a possibly singular matrix; undetermined directions get a large variance."""
    scale = np.sqrt(np.diag(normal))
    values, vectors = np.linalg.eigh(normal / np.outer(scale, scale))
    values = np.maximum(values, SMALLEST_EIGENVALUE * values[-1])
    return (vectors / values) @ vectors.T / np.outer(scale, scale)


def _covariance_of_scores(shooting, fit, number, states, residuals, columns, inverse):
    """Covariance of one experiment's scores Jᵀ r, shape (columns, columns).

    `states`: the residuals' derivatives by the windows'
    starts; `columns`: the derivatives by the values, without the part that the windows' starts
    explain; `inverse`: inverse of the normal matrix of all experiments.
    """
    random, (samples, outputs) = np.random.default_rng(0), residuals.shape
    drawn = np.zeros((samples, outputs, 1 + outputs, DRAWS))
    drawn[:, :, 0] = drawn_base_noise(shooting, fit, number, random, DRAWS)
    for output in range(outputs):
        drawn[:, output, 1 + output] = random.standard_normal((samples, DRAWS))
    cuts = fit.edges[number] - fit.edges[number][0]
    drawn = without_states(drawn.reshape(samples, outputs, -1), states, cuts)
    scores = np.einsum("noi,nod->id", columns, drawn)
    # The fit removes the part of the noise that the windows' starts and the values explain.
    drawn -= columns @ (inverse @ scores)
    of_base, of_outputs = _sizes(residuals, drawn.reshape(samples, outputs, -1, DRAWS))
    of_draws = scores[:, :DRAWS]
    from_base = of_base / DRAWS * of_draws @ of_draws.T
    return from_base + np.einsum("o,noi,noj->ij", of_outputs, columns, columns)


def _sizes(residuals, drawn):
    """Share of the simulated base noise's power in the residuals, and each output's mean square.

    The share is 1 (the noise of the base's record), unless the residuals require more, or exclude
    this by `SURE_OF_SHARE` standard errors.
    """
    from scipy.optimize import nnls

    samples = residuals.shape[0]
    spectrum = (np.abs(np.fft.rfft(residuals, axis=0)[1:]) ** 2 / samples).T.ravel()
    powers = np.mean(np.abs(np.fft.rfft(drawn, axis=0)[1:]) ** 2, axis=-1) / samples
    parts = powers.swapaxes(0, 1).reshape(spectrum.size, -1)
    explained = np.full(spectrum.size, np.maximum(spectrum.mean(), 1e-300))
    for _ in range(WHITTLE_STEPS):
        weighted = parts / explained[:, None]
        sizes = nnls(weighted, spectrum / explained)[0]
        explained = np.maximum(parts @ sizes, 1e-12 * explained.max())
    error = math.sqrt(max(_inverse(weighted.T @ weighted)[0, 0], 0.0)) if parts[:, 0].any() else 0.0
    share = sizes[0] if sizes[0] - SURE_OF_SHARE * error > 1.0 else 1.0
    return min(share, sizes[0] + SURE_OF_SHARE * error), sizes[1:]


# A value with a larger relative standard error is undetermined.
UNDETERMINED = 0.5
# A value belongs to an undetermined direction if its component exceeds this share of the largest
# one.
SHARE_OF_DIRECTION = 0.1


@dataclass(frozen=True)
class Undetermined:
    """A direction in which values can change without effect on the data.

    Attributes
    ----------
    keys : tuple of str
        Keys of the values that change together.
    powers : tuple of float
        Exponents of the product of values that the data determine; empty for a single value.
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
        return f"{' and '.join(names)} are not determined separately, only {' · '.join(factors)}"


def undetermined(
    unknowns: Sequence[Unknown], values: np.ndarray, covariance: np.ndarray
) -> list[Undetermined]:
    """Directions of relative values with too large standard errors."""
    # A value that may be 0 is determined if its error is small compared with a change of order one.
    keys, units = [unknown.key for unknown in unknowns], units_of(unknowns, values, share=1.0)
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


def units_of(unknowns: Sequence[Unknown], values: np.ndarray, share: float = 1e-3) -> np.ndarray:
    """Units of relative values: the value, or its size if it may be 0 and is small."""
    sizes, low = (np.array([getattr(u, name) for u in unknowns]) for name in ("size", "low"))
    values = np.abs(values)
    return np.where((low > LITTLE * sizes) | (values > share * sizes), values, sizes)
