"""Validation records: data that no fit used, a model's prediction of them, and the residuals.

The residuals are compared with the sensors' noise in size and by a regression. To simulate the
residuals of a right model in the same windows, each output's noise is added to the simulated
output, and the base sensor's noise to the model's excitation. The spectrum of these residuals
weights the measured ones. These are regressed on signals typical of a wrong model, computed from
the measured acceleration and the simulated output. For a right model the regression is not
significant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from harvester.base.formatting import with_error
from harvester.identification.measured_response import MeasuredImpedance
from harvester.identification.response import NO_STATES
from harvester.identification.sensors import integrals, without_states
from harvester.identification.shooting import Shooting, ShootingFit
from harvester.scene.units import load_resistance
from harvester.statistics.agreement import differ
from harvester.statistics.estimate import Estimate, root

# Keys in JSON of the mean power (or mean square) of a record and of its predictions.
ESTIMATES = ("measured", "predicted", "relative_difference", "free")
# Half width of a normal variable's 95 % interval, in standard errors.
HALF_INTERVAL = 1.96
# Number of blocks of a record, from whose scatter error bars are computed.
BLOCKS = 12
# A record's noise is estimated in this share of its spectrum, at the highest frequencies.
NOISE_BAND = 0.25
NOISE_SEGMENTS = 16
# Minimum and maximum noise of the base's sensor, relative to the base's rms. A record without noise
# still needs a small value, which shows how noise would act. A floor above the maximum is motion at
# frequencies up to half the sampling rate.
LEAST_BASE_NOISE, MOST_BASE_NOISE = 1e-6, 0.05
# Ratio of the rms of a normal variable to the median of its magnitude.
NORMAL_RMS = 1.4826
# Longest lag of the autocorrelation, in periods of the motion.
WHITE_PERIODS = 1.0
# Number of fitted states per window: displacement, velocity and the transducer's state.
FITTED_STATES = 3
# An output shows no motion if its sensor's noise exceeds this share of its rms.
MOSTLY_NOISE = 0.9
# Number of standard errors from which an effect is significant.
SURE = 3.0
# Number of simulated noise records, and of adjacent lines over which their spectrum is averaged.
DRAWS, LINES = 6, 9
# Residuals are systematic if the regression's F exceeds this. For correct models, fourteen sets of
# three records had F up to 4.2, including the values' errors. With wrong sensors, springs or loads,
# F was at least 32 in the worst record of a set.
SYSTEMATIC = 12.0
# Residuals are too large if they exceed this multiple of a correct model's. For correct models the
# ratio was up to 1.23 in the worst record of eleven sets of two or three records.
TOO_LARGE = 1.5
# A part below this share of an output's standard deviation is ignored.
UNNOTICED = 2e-3
# The same share for a frequency response, and the maximum noise that its residuals may indicate.
UNNOTICED_IN_RESPONSE, MOST_NOISE = 0.05, 0.5
# Singular values below this share of the largest are dropped, since some columns are nearly equal.
SMALLEST_DIRECTION = 1e-8


class Unexplained(NamedTuple):
    """Residuals of one output, as shares of its standard deviation.

    Attributes
    ----------
    left : float
        rms of the residuals.
    noise : float
        Residual that a right model would leave.
    systematic : float
        rms of the part of the residuals that the acceleration and the motion explain.
    ratio : float
        F of this part: about 1 for a right model; NaN for a frequency response.
    is_noise : bool
        Whether the residuals are compatible with noise in size and shape.
    """

    output: str
    left: float
    noise: float
    systematic: float
    ratio: float
    is_noise: bool

    @property
    def beyond(self) -> float:
        """rms in excess of a right model's residual."""
        return math.sqrt(max(self.left**2 - self.noise**2, 0.0))


@dataclass(frozen=True, kw_only=True)
class ValidationRecord:
    """The part of one measurement that no fit used, with a model's prediction.

    Attributes
    ----------
    rate : float
        Hz.
    measured, windowed, free : ndarray, shape (samples, outputs)
        `windowed` is simulated in windows whose starts were fitted to this part, with unchanged
        values of the device; `free` continues from the first start alone.
    resistance : float or None
        Resistance of the load (Ω).
    motion : float
        Median frequency of the measured motion (Hz).
    unexplained : tuple of Unexplained
        Residual of each output; one for all outputs of a response.
    """

    name: str
    outputs: tuple[str, ...]
    rate: float
    measured: np.ndarray
    windowed: np.ndarray
    free: np.ndarray
    windows: int
    resistance: float | None
    motion: float
    unexplained: tuple[Unexplained, ...] = ()

    aside: ClassVar[str] = "last third"
    # Whether the part is long enough for the residuals' correlation to show a model error.
    long: ClassVar[bool] = True

    @property
    def residuals(self) -> np.ndarray:
        """Outputs simulated in windows minus the measured ones."""
        return self.windowed - self.measured

    @property
    def quantity(self) -> str:
        """Name of the quantity that `nrmse` refers to."""
        return self.outputs[0]

    def nrmse(self, output: int = 0) -> float:
        """Root mean square of the residuals divided by the output's standard deviation."""
        spread = float(np.std(self.measured[:, output]))
        return float(np.sqrt(np.mean(self.residuals[:, output] ** 2))) / spread

    def noise(self, output: int = 0) -> float:
        """Noise of an output relative to its standard deviation: the floor of its spectrum."""
        values = self.measured[:, output]
        return noise_floor(values, self.rate) / float(np.std(values))

    @property
    def compared(self) -> tuple[str, str]:
        """Quantity and unit of `powers`."""
        if self.resistance is not None and "voltage" in self.outputs:
            return "mean power", "W"
        return f"mean square {self.outputs[0]}", "scene's unit²"

    def powers(self) -> tuple[Estimate, Estimate, Estimate]:
        """Mean power (or mean square) measured and predicted, and the relative difference.

        The prediction is in windows, along the measured path. Errors are those of block means; for
        the difference, of paired blocks.
        """
        measured, predicted = (
            block_means(self._compared_values(values)) for values in (self.measured, self.windowed)
        )
        difference = (predicted - measured) / float(np.mean(measured))
        return mean_of(measured), mean_of(predicted), mean_of(difference)

    def explained(self) -> Estimate:
        """Share of the first output's variance that the model explains, in windows.

        Its error is that of block means. It is at most 0 if the model explains nothing.
        """
        return self._explained(self.measured[:, :1] - np.mean(self.measured[:, 0]), 1)

    def _explained(self, measured, outputs):
        """Share of the mean square of measured values that the model explains."""
        squares = np.sum(self.residuals[:, :outputs] ** 2, axis=1)
        seen = np.sum(measured**2, axis=1)
        return mean_of(block_means(seen - squares) / float(np.mean(seen)))

    def free_power(self) -> Estimate:
        """Mean power (or square) of a run from one start, which may leave the measured path."""
        return mean_of(block_means(self._compared_values(self.free)))

    def _compared_values(self, values):
        """Power (or square of an output) at the samples."""
        column = self.outputs.index("voltage") if "voltage" in self.outputs else 0
        factor = 1.0 / self.resistance if self.compared[1] == "W" and self.resistance else 1.0
        return factor * values[:, column] ** 2

    def whiteness(self, output: int = 0) -> Whiteness:
        """Autocorrelation of the residuals over a period of the motion."""
        return _whiteness(self.residuals[:, output], self.rate / self.motion)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, without the samples."""
        estimates = dict(zip(ESTIMATES, (*self.powers(), self.free_power()), strict=True))
        return {
            "name": self.name,
            "outputs": self.outputs,
            "nrmse": {name: self.nrmse(n) for n, name in enumerate(self.outputs)},
            "sensor_noise": {name: self.noise(n) for n, name in enumerate(self.outputs)},
            "windows": self.windows,
            "compared": self.compared[0],
            **{
                name: {"estimate": value.estimate, "standard_error": value.standard_error}
                for name, value in estimates.items()
            },
        }

    @property
    def shows_motion(self) -> bool:
        """Whether the model explains more than chance, or its residuals exceed noise.

        The starts of the windows are fitted to this part: in white noise, each of their states
        explains as much as one sample contains.
        """
        explained = self.explained()
        chance = FITTED_STATES * self.windows / len(self.measured)
        if explained.estimate > chance + SURE * (explained.standard_error or 0.0):
            return True
        return self.noise() < MOSTLY_NOISE and not (self.long and self.whiteness().white)

    @property
    def worst(self) -> Unexplained:
        """Output with the largest residual in excess of noise; unexplained outputs come first."""
        return max(self.unexplained, key=lambda part: (not part.is_noise, part.beyond, part.left))

    @property
    def is_explained(self) -> bool:
        """Whether the residuals of every output are only the sensors' noise."""
        return all(part.is_noise for part in self.unexplained)


@dataclass(frozen=True, kw_only=True)
class ResponseRecord(ValidationRecord):
    """The validation frequencies of a measured response.

    Attributes
    ----------
    frequency : ndarray, shape (samples,)
        Hz.
    """

    frequency: np.ndarray

    aside: ClassVar[str] = "every third frequency"
    long: ClassVar[bool] = False
    quantity: ClassVar[str] = "response"
    compared: ClassVar[tuple[str, str]] = ("mean square response", "(V/(m/s²))²")

    def nrmse(self, output: int = 0) -> float:
        """Root mean square of the residuals relative to the response's, both parts together."""
        return float(np.linalg.norm(self.residuals) / np.linalg.norm(self.measured))

    def noise(self, output: int = 0) -> float:
        """Noise of an output, relative to its standard deviation.

        It is a median, which ignores the few lines at the resonance that a wrong model misses.
        """
        size = NORMAL_RMS * float(np.median(np.abs(self.residuals[:, output])))
        return size / float(np.std(self.measured[:, output]))

    def explained(self) -> Estimate:
        """Share of the response's square that the model explains, both parts together."""
        return self._explained(self.measured, len(self.outputs))

    def _compared_values(self, values):
        return np.sum(values**2, axis=1)

    def judged(self) -> ResponseRecord:
        """The record with its residuals evaluated."""
        residual, noise = self.nrmse(), self.noise()
        beyond = math.sqrt(max(residual**2 - min(noise, MOST_NOISE) ** 2, 0.0))
        is_noise = beyond <= UNNOTICED_IN_RESPONSE
        part = Unexplained(self.quantity, residual, noise, beyond, math.nan, is_noise)
        return replace(self, unexplained=(part,))


@dataclass(frozen=True, kw_only=True)
class ImpedanceRecord(ResponseRecord):
    """The validation frequencies of an impedance; outputs are ln |Z| and phase."""

    quantity: ClassVar[str] = "impedance"
    compared: ClassVar[tuple[str, str]] = ("mean |Z|", "Ω")

    def nrmse(self, output: int = 0) -> float:
        """Root mean square of the relative error of Z."""
        return float(np.sqrt(np.mean(np.sum(self.residuals**2, axis=1))))

    def noise(self, output: int = 0) -> float:
        """Noise of the analyser as relative error of Z, both outputs together."""
        medians = np.median(np.abs(self.residuals), axis=0)
        return NORMAL_RMS * float(np.linalg.norm(medians))

    def _compared_values(self, values):
        return np.exp(values[:, 0])


@dataclass(frozen=True, kw_only=True)
class WholeRecord(ValidationRecord):
    """A record that no fit used, without its first part, simulated from one start.

    Attributes
    ----------
    outside : str
        Reason why the prediction is not claimed, else empty. A claimed prediction has one orbit for
        all sets of values, in the range of the fitted records.
    left : float
        rms of the first output's residuals in windows, in excess of noise, relative to its standard
        deviation.
    limit : float
        Maximum `left` of a record of the fitted device.
    agreement : float
        Share of the sets of values whose runs have the predicted orbit.
    rms_unit : str
        Unit of the first output; empty in a scaled scene.
    predicted_rms, predicted_power : Estimate
        Predictions of the run, with errors due to the values and the fitted records.
    own : dict of str to Estimate
        Values estimated from this record, with errors from its residuals and from the other values.
    """

    outside: str
    left: float
    limit: float
    measured_orbit: str
    predicted_orbit: str
    agreement: float
    rms_unit: str
    predicted_rms: Estimate
    predicted_power: Estimate
    own: dict[str, Estimate]

    aside: ClassVar[str] = "whole record"

    @property
    def claimed(self) -> bool:
        """Whether the model's range of validity includes this record."""
        return not self.outside

    @property
    def follows(self) -> bool:
        """Whether the residual is small enough for a record of the fitted device."""
        return self.left <= self.limit

    @property
    def measured_rms(self) -> Estimate:
        """rms of the first output."""
        return root_mean_square(self.measured)

    @property
    def holds(self) -> bool:
        """Whether the measured orbit, rms and power agree with the prediction."""
        return (
            self.measured_orbit == self.predicted_orbit
            and _within(self.measured_rms, self.predicted_rms)
            and _within(self.powers()[0], self.predicted_power)
        )

    def __str__(self) -> str:
        claim = "claimed" if self.claimed else f"not claimed ({self.outside})"
        outcome = "within its interval" if self.holds else "not as predicted"
        quantity, unit = self.compared

        def outcome_of(orbit, rms, power):
            return f"{orbit}, rms {_text(rms, self.rms_unit)}, {quantity} {_text(power, unit)}"

        measured = outcome_of(self.measured_orbit, self.measured_rms, self.powers()[0])
        expected = outcome_of(self.predicted_orbit, self.predicted_rms, self.predicted_power)
        fitted_values = self.own.items() if self.follows else ()
        values = ", ".join(f"{key} = {_text(value, '')}" for key, value in fitted_values)
        return (
            f"{self.name}, validation record: {claim}, {outcome}; measured {measured}; predicted "
            f"{expected} (this orbit in {self.agreement:.0%} of the runs with likely values)"
            f"{f', with {values}, fitted to this record' if values else ''}"
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, without the samples."""
        quantity, unit = self.compared
        names = ("name", "measured_orbit", "predicted_orbit", "left", "follows", "agreement",
                 "rms_unit", "measured_rms", "predicted_rms", "predicted_power", "own")  # fmt: skip
        return {
            **{name: getattr(self, name) for name in names},
            "claimed": self.claimed,
            "why": self.outside,
            "quantity": quantity,
            "unit": unit,
            "measured_power": self.powers()[0],
            "within_interval": self.holds,
        }


def _text(value, unit):
    """An estimate with half its 95 % interval, as text."""
    return with_error(replace(value, standard_error=HALF_INTERVAL * value.standard_error), unit)


def block_means(values: np.ndarray) -> np.ndarray:
    """Means of a series in the blocks whose scatter gives error bars, shape (blocks,)."""
    return np.array([np.mean(part) for part in np.array_split(values, min(BLOCKS, values.size))])


def mean_of(values: np.ndarray) -> Estimate:
    """Mean of independent values, with its error."""
    error = float(np.std(values, ddof=1)) / math.sqrt(values.size)
    return Estimate(float(np.mean(values)), error, float(values.size), "1")


def root_mean_square(values: np.ndarray) -> Estimate:
    """rms of the first of several series (samples, outputs), with the error of its blocks."""
    return root(mean_of(block_means(values[:, 0] ** 2)))


def _within(measured: Estimate, expected: Estimate) -> bool:
    """Whether a measured value is within its prediction's 95 % interval."""
    error = math.hypot(measured.standard_error or 0.0, expected.standard_error or 0.0)
    difference = measured.estimate - expected.estimate
    return math.isfinite(difference) and not differ(difference, error, sigmas=HALF_INTERVAL)


def prediction(shooting: Shooting, fit: ShootingFit, number: int) -> ValidationRecord:
    """Predict one record with a fit's values, in the fit's windows."""
    edges, starts = fit.edges[number], fit.starts[number]
    experiment, trial = shooting.experiments[number], shooting.at(number, fit.values)
    measurement, scene = experiment.measurement, experiment.scene
    return ValidationRecord(
        name=measurement.name,
        outputs=tuple(measurement.outputs),
        rate=measurement.sampling_rate,
        measured=shooting.seen(number, edges),
        windowed=trial.states(edges, starts)[2],
        free=trial.states(edges[[0, -1]], starts[:1])[2],
        windows=edges.size - 1,
        resistance=load_resistance(scene) if scene.units == "SI" else None,
        motion=measurement.frequencies[0],
    )


def predicted_lines(problem: Shooting, values: np.ndarray, number: int) -> ResponseRecord:
    """Predict the validation lines of a response or an impedance."""
    measurement: Any = problem.experiments[number].measurement
    measured = np.column_stack(list(measurement.outputs.values()))
    edges = np.array([0, measured.shape[0]])
    _, _, simulated = problem.at(number, values).states(edges, NO_STATES)
    frequency = measurement.frequency
    is_impedance = isinstance(measurement, MeasuredImpedance)
    return (ImpedanceRecord if is_impedance else ResponseRecord)(
        name=measurement.name,
        outputs=tuple(measurement.outputs),
        rate=float((frequency.size - 1) / (frequency[-1] - frequency[0])),
        measured=measured,
        windowed=simulated,
        free=simulated,
        windows=1,
        resistance=None,
        motion=float(np.median(frequency)),
        frequency=frequency,
    ).judged()


def noise_floor(values: np.ndarray, rate: float) -> float:
    """rms of a record's noise: the floor of its spectrum in the highest quarter, assumed white.

    Parameters
    ----------
    values : ndarray, shape (n,)
    rate : float
        Hz.
    """
    from scipy import signal

    f, density = signal.welch(values, rate, nperseg=max(16, values.size // NOISE_SEGMENTS))
    floor = float(np.median(density[f > (1.0 - NOISE_BAND) * f[-1]]))
    return math.sqrt(floor * 0.5 * rate)


def drawn_base_noise(
    shooting: Shooting, fit: ShootingFit, number: int, random: np.random.Generator, draws: int
) -> np.ndarray:
    """Weighted residuals due to noise of the base's sensor, shape (samples, outputs, draws).

    The noise has the power of the floor of the record's spectrum.
    """
    measurement = shooting.experiments[number].measurement
    base, rms = measurement.acceleration, float(np.std(measurement.acceleration))
    floor = noise_floor(base, measurement.sampling_rate)
    size = float(np.clip(floor, LEAST_BASE_NOISE * rms, MOST_BASE_NOISE * rms))
    noise = size * random.standard_normal((base.size, draws))
    return shooting.moved_by_noise(fit, number, noise) / fit.noise[number][:, None]


@dataclass(frozen=True)
class Whiteness:
    """Autocorrelation of residuals.

    Attributes
    ----------
    correlations : ndarray, shape (lags,)
        Autocorrelations from lag 1 on.
    bound : float
        Limit of white residuals' correlations at 95 % of the lags.
    probability : float
        Probability that white residuals have at least this sum of squares (Ljung and Box).
    """

    correlations: np.ndarray
    bound: float
    probability: float

    @property
    def white(self) -> bool:
        """Whether the residuals are compatible with white noise (false alarms: one in 1000)."""
        return self.probability > 1e-3


def autocorrelations(values: np.ndarray, lags: int) -> np.ndarray:
    """Autocorrelations of a series from lag 1 on; 0 for a constant."""
    spectrum = np.abs(np.fft.rfft(values - values.mean(), 2 * values.size)) ** 2
    series = np.fft.irfft(spectrum)[: lags + 1]
    return series[1:] / series[0] if series[0] > 0.0 else np.zeros(lags)


def _whiteness(residuals, per_period):
    """Autocorrelation of residuals at lags up to one period, which is `per_period` samples."""
    from scipy.stats import chi2

    n = residuals.size
    lags = int(np.clip(round(WHITE_PERIODS * per_period), 4, n // 4))
    correlations = autocorrelations(residuals, lags)
    statistic = n * (n + 2) * float(np.sum(correlations**2 / (n - np.arange(1, lags + 1))))
    return Whiteness(correlations, HALF_INTERVAL / math.sqrt(n), float(chi2.sf(statistic, lags)))


def validated(shooting: Shooting, fit: ShootingFit, number: int) -> ValidationRecord:
    """A prediction with the residual of each output.

    The only unknowns of `shooting` are the starts of `fit`'s windows.
    """
    record, table = prediction(shooting, fit, number), shooting.jacobian(fit, number)[0]
    if table is None:
        # The device diverges, so nothing is explained.
        parts = [
            Unexplained(name, math.inf, 0.0, math.inf, math.nan, False) for name in record.outputs
        ]
        return replace(record, unexplained=tuple(parts))
    measurement = shooting.experiments[number].measurement
    edges, noise, parts = fit.edges[number], fit.noise[number], []
    cuts, inside = edges - edges[0], slice(edges[0], edges[-1])
    residuals, starts = table[..., -1], table[..., :-1]
    drawn = without_states(_drawn(shooting, fit, number, record.measured), starts, cuts)
    for output, name in enumerate(record.outputs):
        columns = _signals(measurement, inside, record.windowed[:, output])
        alone = np.zeros((*record.measured.shape, columns.shape[1]))
        alone[:, output] = columns
        signals = without_states(alone, starts, cuts)[:, output]
        spectrum = _smooth(np.mean(np.abs(np.fft.rfft(drawn[:, output], axis=0)) ** 2, axis=1))
        explained, ratio = _regressed(residuals[:, output], signals, spectrum)
        unit = float(noise[output] / np.std(record.measured[:, output]))
        left, of_noise = unit * _rms(residuals[:, output]), unit * _rms(drawn[:, output])
        follows = ratio >= SYSTEMATIC and unit * explained >= UNNOTICED
        large = left > TOO_LARGE * of_noise and left**2 - of_noise**2 > UNNOTICED**2
        is_noise = not (follows or large)
        parts.append(Unexplained(name, left, of_noise, unit * explained, ratio, is_noise))
    return replace(record, unexplained=tuple(parts))


def _drawn(shooting, fit, number, measured):
    """Simulated weighted residuals of a right model, shape (samples, outputs, draws)."""
    rate = shooting.experiments[number].measurement.sampling_rate
    random = np.random.default_rng(0)
    drawn = drawn_base_noise(shooting, fit, number, random, DRAWS)
    floors = np.array([noise_floor(series, rate) for series in measured.T]) / fit.noise[number]
    return drawn + floors[:, None] * random.standard_normal(drawn.shape)


def _signals(measurement, inside, simulated):
    """Signals typical of a wrong model's residuals in an output, shape (samples, signals)."""
    positions = np.arange(measurement.acceleration.size)
    integral = integrals(measurement.acceleration, measurement.sampling_rate, positions)[0][inside]
    base, moved = measurement.acceleration[inside], simulated - simulated.mean()
    slope = np.gradient(moved)
    signals = [moved, slope, base, integral, moved**2, moved**3, moved**2 * slope]
    columns = np.column_stack([signal - signal.mean() for signal in signals])
    return columns / np.maximum(columns.std(axis=0), 1e-300)


def _regressed(residuals, signals, spectrum):
    """rms of the part of the residuals that signals explain, and its F, weighted by a spectrum."""
    weights = 1.0 / np.sqrt(np.maximum(spectrum, 1e-12 * spectrum.max()))
    seen = np.fft.rfft(residuals) * weights
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
    """Average a spectrum over adjacent lines."""
    from scipy.ndimage import uniform_filter1d

    return uniform_filter1d(spectrum, LINES, mode="nearest")


def _rms(values):
    return float(np.sqrt(np.mean(values**2)))
