"""A fitted device's predictions of the part of each record that was kept aside."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from harvester.identification.measured_response import MeasuredImpedance
from harvester.identification.response import NO_STATES, SteadyResponses
from harvester.identification.search import settle_windows
from harvester.identification.shooting import Shooting, ShootingFit
from harvester.scene.units import load_resistance
from harvester.statistics.estimate import Estimate

# Number of blocks of a stretch; the scatter of their means gives an error bar.
BLOCKS = 12
# A record's noise is taken from this share of its spectrum, at the highest frequencies.
NOISE_BAND = 0.25
NOISE_SEGMENTS = 16
# Ratio of the rms of a normal variable to the median of its magnitude.
NORMAL_RMS = 1.4826
# A response is smooth if neighbours differ by less than this many variances: noise has 2.
ROUGH = 1.0
# Longest lag of the autocorrelation, in periods of the motion.
WHITE_PERIODS = 1.0


@dataclass(frozen=True)
class ValidationRecord:
    """Measured and simulated outputs of one experiment's stretch.

    Attributes
    ----------
    rate : float
        Hz.
    measured, windowed, free : ndarray, shape (samples, outputs)
        `windowed` is simulated in windows whose starts were found in this stretch, the device's
        numbers being as they were; `free` goes on from the first start alone.
    resistance : float or None
        Resistance of the load (Ω).
    """

    name: str
    outputs: tuple[str, ...]
    rate: float
    measured: np.ndarray
    windowed: np.ndarray
    free: np.ndarray
    windows: int
    resistance: float | None

    aside: ClassVar[str] = "last third"
    # Whether the stretch is long enough for the residuals' correlation to show an error of the
    # model.
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
        """Root mean square of the residuals over the output's standard deviation."""
        spread = float(np.std(self.measured[:, output]))
        return float(np.sqrt(np.mean(self.residuals[:, output] ** 2))) / spread

    @property
    def compared(self) -> tuple[str, str]:
        """Quantity and unit of `powers`."""
        if self.resistance is not None and "voltage" in self.outputs:
            return "mean power", "W"
        return f"mean square {self.outputs[0]}", "scene's unit²"

    def powers(self) -> tuple[Estimate, Estimate, Estimate]:
        """Mean power (or square of an output) measured and predicted, and the relative difference.

        Predicted in windows, along the measured path. Errors are those of means of blocks; that of
        the difference of paired blocks.
        """
        measured, predicted = self._blocks(self.measured), self._blocks(self.windowed)
        difference = (predicted - measured) / float(np.mean(measured))
        return _of_blocks(measured), _of_blocks(predicted), _of_blocks(difference)

    def explained(self) -> Estimate:
        """Share of the first output's variance that the model explains, in windows.

        Its error is that of means of blocks. A model of nothing explains 0 within it, or less.
        """
        seen = self.measured[:, 0] - np.mean(self.measured[:, 0])
        return _explained(seen**2, self.residuals[:, 0] ** 2)

    def free_power(self) -> Estimate:
        """Mean power (or square) of a run from one start, which may part from the measured path."""
        return _of_blocks(self._blocks(self.free))

    def _blocks(self, values):
        column = self.outputs.index("voltage") if "voltage" in self.outputs else 0
        factor = 1.0 / self.resistance if self.compared[1] == "W" and self.resistance else 1.0
        return factor * np.array([float(np.mean(part**2)) for part in blocks_of(values[:, column])])


@dataclass(frozen=True)
class ResponseRecord(ValidationRecord):
    """The frequencies of a measured response that were kept aside.

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
        """Root mean square of the residuals over that of the response, both parts together."""
        return float(np.linalg.norm(self.residuals) / np.linalg.norm(self.measured))

    def noise(self, output: int = 0) -> float:
        """Noise of an output, as a share of its standard deviation.

        A wrong model misses the few lines of the resonance, which the median does not see.
        """
        size = NORMAL_RMS * float(np.median(np.abs(self.residuals[:, output])))
        return size / float(np.std(self.measured[:, output]))

    @property
    def smooth(self) -> bool:
        """Whether neighbouring frequencies resemble each other, as those of noise do not."""
        steps = np.sum(np.diff(self.measured, axis=0) ** 2) / (len(self.measured) - 1)
        return bool(steps < ROUGH * np.var(self.measured, axis=0).sum())

    def explained(self) -> Estimate:
        """Share of the response's square that the model explains, both parts together."""
        return _explained(np.sum(self.measured**2, axis=1), np.sum(self.residuals**2, axis=1))

    def _blocks(self, values):
        squares = np.sum(values**2, axis=1)
        return np.array([float(np.mean(part)) for part in blocks_of(squares)])


@dataclass(frozen=True)
class ImpedanceRecord(ResponseRecord):
    """The frequencies of an impedance that were kept aside; outputs are ln |Z| and phase."""

    quantity: ClassVar[str] = "impedance"
    compared: ClassVar[tuple[str, str]] = ("mean |Z|", "Ω")

    def nrmse(self, output: int = 0) -> float:
        """Root mean square of the relative error of Z."""
        return float(np.sqrt(np.mean(np.sum(self.residuals**2, axis=1))))

    def noise(self, output: int = 0) -> float:
        """Noise of the analyser, as relative error of Z: both outputs together."""
        medians = np.median(np.abs(self.residuals), axis=0)
        return NORMAL_RMS * float(np.linalg.norm(medians))

    def _blocks(self, values):
        sizes = np.exp(values[:, 0])
        return np.array([float(np.mean(part)) for part in blocks_of(sizes)])


def blocks_of(values: np.ndarray) -> list[np.ndarray]:
    """A series in the blocks whose means give an error bar."""
    return np.array_split(values, min(BLOCKS, values.size))


def _explained(measured, left):
    """Share of the measured mean square that the model explains: 1 − residual/measured."""
    means = np.array([float(np.mean(part)) for part in blocks_of(measured - left)])
    return _of_blocks(means / float(np.mean(measured)))


def _of_blocks(values):
    error = float(np.std(values, ddof=1)) / math.sqrt(values.size)
    return Estimate(float(np.mean(values)), error, float(values.size), "1")


def predicted(
    shooting: Shooting,
    fit: ShootingFit,
    stretches: Sequence[tuple[int, int]],
    reach: tuple[float, float] | None = None,
) -> tuple[list[ValidationRecord], ShootingFit]:
    """Motion and outputs of the fitted device in a stretch of each experiment.

    Parameters
    ----------
    stretches : sequence of (int, int)
        First sample, and that behind the last.
    reach : (float, float), optional
        Scaled displacements between which the mass is looked for.

    Returns
    -------
    list of ValidationRecord
    ShootingFit
        The windows of the stretches with their starts.
    """
    settled = settle_windows(shooting.frozen(), fit, stretches, reach)
    responses, predictions = shooting.responses, []
    for number, edges in enumerate(settled.edges):
        experiment = responses.experiments[number]
        starts = settled.starts[number]
        _, _, windowed = responses.states(number, fit.values, edges, starts)
        span = edges[[0, -1]]
        _, _, free = responses.states(number, fit.values, span, starts[:1])
        outputs = experiment.measurement.outputs
        scene = experiment.scene
        predictions.append(
            ValidationRecord(
                name=experiment.measurement.name,
                outputs=tuple(outputs),
                rate=experiment.measurement.sampling_rate,
                measured=shooting.seen(number, edges),
                windowed=windowed,
                free=free,
                windows=edges.size - 1,
                resistance=load_resistance(scene) if scene.units == "SI" else None,
            )
        )
    return predictions, settled


def predicted_lines(responses: SteadyResponses, values: np.ndarray, number: int) -> ResponseRecord:
    """Predictions of the lines of a response or an impedance that were kept aside."""
    measurement: Any = responses.experiments[number].measurement
    measured = np.column_stack(list(measurement.outputs.values()))
    edges = np.array([0, measured.shape[0]])
    _, _, simulated = responses.states(number, values, edges, NO_STATES)
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
        frequency=frequency,
    )


def sensor_noise(stretch: ValidationRecord, output: int = 0) -> float:
    """Noise of an output, as a share of its standard deviation, from the floor of its spectrum.

    Of a response it is the median of the residuals.
    """
    values, spread = stretch.measured[:, output], float(np.std(stretch.measured[:, output]))
    if isinstance(stretch, ResponseRecord):
        return stretch.noise(output)
    return noise_floor(values, stretch.rate) / spread


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


@dataclass(frozen=True)
class Whiteness:
    """Autocorrelation of residuals.

    Attributes
    ----------
    correlations : ndarray, shape (lags,)
        Autocorrelations from lag 1 on.
    bound : float
        Limit within which white residuals' correlations stay at 95 % of the lags.
    probability : float
        Probability of a sum of squares as large as this for white residuals (Ljung and Box).
    """

    correlations: np.ndarray
    bound: float
    probability: float

    @property
    def white(self) -> bool:
        """Whether nothing speaks against white residuals: a false alarm in a thousand."""
        return self.probability > 1e-3


def whiteness(stretch: ValidationRecord, output: int, period: float) -> Whiteness:
    """Autocorrelation of a stretch's residuals over a period of the motion (s)."""
    from scipy.stats import chi2

    values = stretch.residuals[:, output] - stretch.residuals[:, output].mean()
    n = values.size
    lags = int(np.clip(round(WHITE_PERIODS * period * stretch.rate), 4, n // 4))
    spectrum = np.abs(np.fft.rfft(values, 2 * n)) ** 2
    series = np.fft.irfft(spectrum)[: lags + 1]
    correlations = series[1:] / series[0] if series[0] > 0.0 else np.zeros(lags)
    statistic = n * (n + 2) * float(np.sum(correlations**2 / (n - np.arange(1, lags + 1))))
    return Whiteness(correlations, 1.96 / math.sqrt(n), float(chi2.sf(statistic, lags)))
