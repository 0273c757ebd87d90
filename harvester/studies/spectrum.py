"""Spectral density of a scene or record, tests for a stationary Gaussian, and a specification."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base import plain_text
from harvester.base.arguments import usual_arithmetic
from harvester.base.errors import HarvesterError
from harvester.base.formatting import Printed
from harvester.base.serialising import plain
from harvester.results.view import Picture, ResultBase, View

if TYPE_CHECKING:
    from harvester.scene.model import Scene

# Number of segments of the density unless the resolution is given (a 95 % band of about ±1.3 dB),
# their default maximum length, and the minimum length of a block, in samples: an hour at 8 kHz
# needs no more memory than a minute.
SEGMENTS, MOST_IN_SEGMENT, BLOCK = 64, 2**18, 2**16
# Maximum length of a segment for the specification, and number of points of a known density.
MOST_IN_PROFILE, PLACES = 2**20, 2**15
# Maximum number of values of a scene's excitation; a shared core took 24 s for 30 million.
MOST_VALUES = 1e9
# Number of stretches: the trend of their mean squares shows a drift, their scatter gives the errors
# of the moments.
STRETCHES = 32
# Noise bandwidth of Hann's window in bins.
HANN_BINS = 1.5
# A specification ends where the density falls below this share of its maximum.
FAINTEST = 1e-4
# Quality factor of the device whose power a specification preserves, which also preserves the power
# of devices with wider resonances. If the given device's resonance is wider, the findings are for
# the given device. Number of steps per resonance width, and minimum total number of steps.
QUALITY, STEPS_PER_WIDTH, LEAST_STEPS = 100.0, 4.0, 64
# Minimum ratio of that width to the resolution. At 2, the power under the straight lines differed
# by up to 10 % from that under the record's periodogram, at 4 by up to 5 %.
BINS_OF_WIDTH = 4.0
# Number of corrections of the densities after each breakpoint, the difference of power (log) at
# which no further breakpoint is needed, and the smallest difference that is noted.
CORRECTIONS, ALIKE, NOTED_DEPARTURE = 20, 0.02, 0.05
CONFIDENCE = 0.95


def of_record(
    file: str,
    keys: dict[str, Any],
    device: Scene | None,
    resolution: float | None,
    breakpoints: int,
) -> SpectrumAnalysis:
    """Analyse a record, read with these keys of a scene's [excitation]."""
    from harvester.device.keys import check_table
    from harvester.excitation.recorded import RecordedMotion, one_pass

    keys = {"file": file} | {key: value for key, value in keys.items() if value is not None}
    record = check_table("excitation", keys, RecordedMotion, "SI", plain_text.named(file))
    values, interval, _ = one_pass(record)
    values = values - values.mean()
    units = "scaled" if record.unit == "scaled" else "SI"
    name = plain_text.name(Path(file).stem)

    def blocks(size: int) -> Iterator[np.ndarray]:
        return (values[first : first + size] for first in range(0, values.size, size))

    return _analysed(name, blocks, values.size, interval, resolution, breakpoints, device, units)


def of_scene(
    scene: Scene, duration: float | None, resolution: float | None, breakpoints: int
) -> SpectrumAnalysis:
    """Analyse the first realization of a scene's excitation (default duration: the scene's)."""
    from harvester.scene.paths import noise_path
    from harvester.scene.prepared import prepared
    from harvester.scene.steps import knot_spacing

    prepared_scene = prepared(scene)
    spacing = knot_spacing(prepared_scene)
    seconds = duration or scene.run.duration
    if seconds > MOST_VALUES * spacing:
        raise HarvesterError(
            f"{scene.name}: duration = {seconds:g} are {seconds / spacing:.2g} values of the "
            f"excitation; give --duration, at most {MOST_VALUES * spacing:.3g}"
        )
    count = int(seconds / spacing)

    def blocks(size: int) -> Iterator[np.ndarray]:
        path = noise_path(prepared_scene, 0)
        for first in range(0, count, size):
            yield prepared_scene.excitation_unit * path.read(min(size, count - first))

    profiled = _specified(scene.excitation, seconds, spacing)
    return _analysed(
        scene.name, blocks, count, spacing, resolution, breakpoints, scene, scene.units,
        knots=True, profiled=profiled,
    )  # fmt: skip


def _analysed(
    name, blocks, count, interval, resolution, breakpoints, scene, units, knots=False, profiled=None
):
    """Analyse values that come in blocks, so that the memory does not grow with the duration.

    `profiled` is the density for the specification, if it is known without the values.
    """
    from scipy.integrate import cumulative_trapezoid

    size = _segment(count, interval, resolution, name)
    frequencies, density, moments, segments = _welch(blocks, count, interval, size, knots)
    if not density.max() > 0.0:
        raise HarvesterError(f"{name}: the density is 0: check the level of the excitation")
    if not profiled:
        # Long segments are used: a device averages over its resonance, so that resolution matters
        # more than the scatter of each value.
        longer = size if resolution else 2 * int(0.5 * min(count / 4.0, MOST_IN_PROFILE))
        fine, values, *_ = _welch(blocks, count, interval, longer, knots)
        # Hann's window gives the ends of the record less weight than its middle, so the power is
        # restored.
        values *= density.sum() * frequencies[0] / (values.sum() * fine[0])
        profiled = fine, values, HANN_BINS / (longer * interval)
    fine, values, bandwidth = profiled
    centre, width = _resonance(scene) or (0.0, 0.0)
    quality = min(QUALITY, centre / width) if width > 0.0 else QUALITY
    # The share is computed from the finer density, so that a line near the band does not leak in.
    gathered = cumulative_trapezoid(values, fine, initial=0.0) / np.trapezoid(values, fine)
    low, high = np.interp([centre - 0.5 * width, centre + 0.5 * width], fine, gathered)
    points, departure = profile(fine, values, breakpoints, bandwidth, quality)
    return SpectrumAnalysis(
        name=name,
        scene=scene,
        units=units,
        frequencies=frequencies,
        density=density,
        resolution=HANN_BINS / (size * interval),
        segments=segments,
        duration=count * interval,
        moments=moments,
        profile=points,
        quality=quality,
        departure=departure,
        resolved_from=BINS_OF_WIDTH * quality * bandwidth,
        band_share=float(high - low),
        band_resolution=bandwidth,
    )


def _welch(blocks, count, interval, size, knots):
    """Frequencies (Hz) and density, powers of the values in each stretch, number of segments."""
    with usual_arithmetic():
        density, moments, segments = _sums(blocks, count, interval, size)
    frequencies = np.fft.rfftfreq(size, interval)
    if knots:
        # The engines interpolate linearly between the knots, which reduces the density by this
        # factor.
        density = density * np.sinc(frequencies * interval) ** 4
    return frequencies[1:], density[1:], moments, segments


def _specified(excitation, seconds, spacing):
    """Frequencies, density and bandwidth of noise with a known density; None for other excitations.

    A density without edges ranges from the reciprocal of the duration to the Nyquist frequency.
    """
    low, high = getattr(excitation, "band", None) or (1.0 / seconds, 0.5 / spacing)
    frequencies = np.unique([*np.geomspace(low, high, PLACES), *excitation.corners])
    density = None if excitation.lines else excitation.density(frequencies)
    return None if density is None else (frequencies, density, 0.0)


def _segment(count, interval, resolution, name):
    """Even number of samples of a segment."""
    size = min(2.0 * count / (SEGMENTS + 1), MOST_IN_SEGMENT)
    if resolution:
        size = min(HANN_BINS / (resolution * interval), 2.0 * count)
    size = 2 * int(0.5 * size)
    if size < 16 or size > count:
        raise HarvesterError(
            f"{name}: {count} samples {interval:.3g} s apart cannot be divided into segments of "
            f"{size}: use a longer duration, or another --resolution"
        )
    return size


def _sums(blocks, count, interval, size):
    """Density, powers of the values in each stretch, and number of segments."""
    from scipy import signal

    stretch = max(count // STRETCHES, 1)
    # Segments overlap by half; the density is their mean, accumulated block after block.
    total, segments = np.zeros(size // 2 + 1), 0
    powers, position = np.zeros((STRETCHES, 4)), 0
    remainder = np.empty(0)
    for block in blocks(max(size, BLOCK)):
        remainder = np.append(remainder, block)
        many = (remainder.size - size) // (size // 2) + 1
        if many > 0:
            end = size + (many - 1) * (size // 2)
            _, density = signal.welch(remainder[:end], 1.0 / interval, nperseg=size, detrend=False)
            total += many * density
            segments += many
            remainder = remainder[many * (size // 2) :]
        ends = np.minimum(np.arange(1, STRETCHES + 1) * stretch - position, block.size)
        starts = np.clip(np.arange(STRETCHES) * stretch - position, 0, block.size)
        for which in np.flatnonzero(ends > starts):
            part = block[starts[which] : ends[which]]
            square = part * part
            sums = part.sum(), square.sum(), (square * part).sum(), (square * square).sum()
            powers[which] += sums
        position += block.size
    return total / segments, powers[: count // stretch] / stretch, segments


def profile(
    frequencies: np.ndarray,
    density: np.ndarray,
    breakpoints: int,
    resolution: float = 0.0,
    quality: float = QUALITY,
) -> tuple[np.ndarray, tuple[float, float]]:
    """Breakpoints of straight lines on log–log axes, with the mean square of the density.

    At each frequency the power of a device of quality factor 100 under the lines is compared with
    that under the density. Each further breakpoint is placed at the largest difference relative to
    the scatter due to the record's finite length. Then all breakpoints are corrected by the ratios
    of these powers.

    Parameters
    ----------
    frequencies, density : ndarray, shape (n,)
    breakpoints
        Maximum number of breakpoints.
    resolution
        Bandwidth of the density (Hz).
    quality
        Quality factor of the device whose difference of power is returned.

    Returns
    -------
    ndarray, shape (m, 2)
        Frequency (Hz) and density; no rows if the density is a single line.
    tuple of float
        Frequency (Hz) of the device whose power differs most, and the relative difference.
    """
    from scipy.integrate import cumulative_trapezoid

    from harvester.excitation.shaped import mean_square

    loud = np.flatnonzero(density > FAINTEST * density.max())
    f, g = (values[loud[0] : loud[-1] + 1] for values in (frequencies, density))
    # Hann's window spreads a line over seven bins with this share of its maximum density.
    if f[-1] - f[0] <= 5.0 * resolution:
        return np.empty((0, 2)), (math.nan, math.nan)
    steps = math.ceil(math.log(f[-1] / f[0]) * STEPS_PER_WIDTH * QUALITY)
    x = np.linspace(math.log(f[0]), math.log(f[-1]), max(steps, LEAST_STEPS))
    at, square = np.exp(x), cumulative_trapezoid(g, f, initial=0.0)
    half = 0.5 * np.maximum(at * (x[1] - x[0]), 2.0 * resolution)
    low, high = np.maximum(at - half, f[0]), np.minimum(at + half, f[-1])
    smoothed = (np.interp(high, f, square) - np.interp(low, f, square)) / (high - low)
    smoothed = np.maximum(smoothed, FAINTEST**2 * smoothed.max())
    # A resonance of width πf/2Q averages over 6/resolution seconds, four segments.
    scatter = np.hypot(ALIKE, np.sqrt(QUALITY * resolution / (3.0 * math.pi * at)))

    powers = _powers(x, smoothed)
    chosen, y = np.array([0, x.size - 1]), np.log(smoothed[[0, -1]])
    while True:
        for _ in range(CORRECTIONS):
            away = np.log(_powers(x, np.exp(np.interp(x, x[chosen], y))) / powers)
            y = y - 0.5 * away[chosen]
        away[chosen] = 0.0
        if chosen.size == breakpoints or np.abs(away).max() < ALIKE:
            break
        worst = int((np.abs(away) / scatter).argmax())
        index = int(np.searchsorted(chosen, worst))
        y = np.insert(y, index, np.interp(x[worst], x[chosen], y) - away[worst])
        chosen = np.insert(chosen, index, worst)
    points = np.exp(np.column_stack([x[chosen], y]))
    points[:, 1] *= square[-1] / mean_square(tuple(map(tuple, points)))
    lines = np.exp(np.interp(x, x[chosen], np.log(points[:, 1])))
    shares = _powers(x, lines, quality) / _powers(x, smoothed, quality) - 1.0
    index = int(np.abs(shares).argmax())
    return points, (float(at[index]), float(shares[index]))


def _resonance(scene):
    """Frequency and half-power width of a scene's device (Hz), with its load; None without one."""
    from harvester.device import timescales
    from harvester.scene.prepared import prepared

    if scene is None or scene.excitation.prescribes_displacement:
        return None
    system = prepared(scene).system
    omega = timescales.loaded_frequency(system)
    return omega / (2.0 * math.pi), timescales.loss_rate(system, omega) / (2.0 * math.pi)


def _powers(x, density, quality=QUALITY):
    """Relative mean-square velocity of a device of this Q at each frequency exp(x)."""
    from scipy.signal import fftconvolve

    ratio = np.exp((x[1] - x[0]) * np.arange(1 - x.size, x.size))
    response = ratio**2 / ((1.0 - ratio**2) ** 2 + (ratio / quality) ** 2)
    return fftconvolve(density * np.exp(x), response[::-1], mode="valid")


@dataclass(frozen=True, repr=False)
class SpectrumAnalysis(ResultBase):
    """Result of `harvester.spectrum`.

    Attributes
    ----------
    scene
        Scene of the excitation, or of the device.
    units : "SI" or "scaled".
    frequencies, density : ndarray, shape (n,)
        Hz, and one-sided density in (m/s²)²/Hz, or of η in a scaled scene.
    resolution
        Bandwidth of the density (Hz).
    segments
        Number of segments, overlapping by half, with Hann's window.
    duration
        Duration of the record, or of the realization (s).
    moments : ndarray, shape (stretches, 4)
        Mean of each power, 1 to 4, in stretches of equal duration.
    profile : ndarray, shape (m, 2)
        Breakpoints: frequency (Hz) and density.
    departure : tuple of float
        Frequency (Hz) of the device of this `quality` whose power under the breakpoints differs
        most, and the relative difference.
    resolved_from
        Lowest frequency at which the profile resolves such a device (Hz).
    quality
        Quality factor of that device: the scene's, at most 100.
    band_share
        Share of the power within the half-power width of the scene's device.
    band_resolution
        Bandwidth of the density from which this share is computed (Hz).
    """

    name: str
    scene: Scene | None
    units: str
    frequencies: np.ndarray = field(repr=False)
    density: np.ndarray = field(repr=False)
    resolution: float
    segments: int
    duration: float
    moments: np.ndarray = field(repr=False)
    profile: np.ndarray = field(repr=False)
    departure: tuple[float, float] = field(repr=False)
    resolved_from: float = field(repr=False)
    quality: float = QUALITY
    band_share: float = 0.0
    band_resolution: float = 0.0

    @property
    def unit(self) -> str:
        """The unit of the density."""
        return "scaled" if self.units == "scaled" else "(m/s^2)^2/Hz"

    @property
    def rms(self) -> float:
        """The rms value, √∫ G df."""
        return math.sqrt(float(self.density.sum()) * self._bin)

    @property
    def _bin(self):
        return float(self.frequencies[1] - self.frequencies[0])

    @property
    def bandwidth(self) -> float:
        """(∫ G df)²/∫ G² df (Hz): bandwidth of flat noise with equally many independent values."""
        return float(self.density.sum() ** 2 / (self.density**2).sum()) * self._bin

    @property
    def band(self) -> tuple[float, float]:
        """Frequencies (Hz) between which nine tenths of the power are."""
        gathered = np.cumsum(self.density) / self.density.sum()
        low, high = np.searchsorted(gathered, [0.05, 0.95])
        return float(self.frequencies[low]), float(self.frequencies[min(high, gathered.size - 1)])

    @property
    def confidence_band(self) -> tuple[float, float]:
        """Factors of the density that bound the true density with 95 % confidence at each
        frequency.

        They follow from χ² with 36 K²/(19 K − 1) degrees of freedom for K segments that overlap by
        half, with Hann's window (P. D. Welch, IEEE Trans. Audio Electroacoust. 15, 70, 1967).
        """
        from scipy.stats import chi2

        freedom = 36.0 * self.segments**2 / (19.0 * self.segments - 1.0)
        low, high = chi2.ppf([0.5 + 0.5 * CONFIDENCE, 0.5 - 0.5 * CONFIDENCE], freedom)
        return float(freedom / low), float(freedom / high)

    def kurtosis(self) -> tuple[float, float]:
        """E[(a − ā)⁴]/E[(a − ā)²]², 3 for a Gaussian, and its jackknife standard error."""
        return _left_out(self.moments, lambda m: _central(m)[1] / _central(m)[0] ** 2)

    def skewness(self) -> tuple[float, float]:
        """E[(a − ā)³]/E[(a − ā)²]^1.5, 0 for a Gaussian, and its standard error."""
        return _left_out(self.moments, lambda m: _central(m)[2] / _central(m)[0] ** 1.5)

    def runs_test(self) -> tuple[int, float]:
        """Number of runs of stretches with mean squares on one side of the median, and the p-value.

        A small number means that the strength drifts. The p-value assumes a normal number of runs
        (J. S. Bendat and A. G. Piersol, Random Data, 4th ed., 2010, section 4.5.2).
        """
        from scipy.stats import norm

        above = self.moments[:, 1] > np.median(self.moments[:, 1])
        runs = 1 + int(np.count_nonzero(above[1:] != above[:-1]))
        first, all_ = int(above.sum()), above.size
        second = all_ - first
        if not first:
            return runs, 1.0
        mean = 2.0 * first * second / all_ + 1.0
        variance = (mean - 1.0) * (mean - 2.0) / (all_ - 1.0)
        return runs, float(2.0 * norm.sf(abs(runs - mean) / math.sqrt(variance)))

    @property
    def drifts(self) -> bool:
        """Whether few runs show a drift that exceeds the variation of a steady sine between
        stretches.

        Over a stretch of duration T the mean square of a sine deviates by up to 1/(2 π f T), by its
        phase.
        """
        runs, probability = self.runs_test()
        squares, centre = self.moments[:, 1], self.frequencies @ self.density / self.density.sum()
        differ = len(squares) / (2.0 * math.pi * centre * self.duration)
        has_few_runs = 2 * runs < len(squares) and probability < 1.0 - CONFIDENCE
        return bool(has_few_runs and squares.std() > differ * squares.mean())

    def device_band(self) -> tuple[float, float, float] | None:
        """Frequency and half-power width of the device (Hz), and the share of the power in this
        band.
        """
        resonance = _resonance(self.scene)
        return resonance and (*resonance, self.band_share)

    def view(self) -> View:
        """Table, findings and pictures."""
        return View(
            self._table(),
            self._findings(),
            headline=f"{self.name}: rms {self.rms:.4g}{' m/s²' * (self.units == 'SI')}, largest "
            f"density at {self.frequencies[self.density.argmax()]:.4g} Hz",
            pictures=[Picture(_draw, self)],
            records=self._records,
            is_series=True,
            texts=self.texts,
        )

    def _records(self):
        """Header and one row per frequency of the density."""
        header = ["frequency [Hz]", f"density [{self.unit}]"]
        return header, np.column_stack([self.frequencies, self.density]).tolist()

    def _table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows as text."""
        unit = "" if self.units == "scaled" else "m/s²"
        (kurtosis, error), (skewness, spread) = self.kurtosis(), self.skewness()
        runs, probability = self.runs_test()
        rows = [
            ["rms", Printed(f"{self.rms:.4g} {unit}".rstrip(), self.rms, None, unit)],
            [
                "bandwidth (∫ G df)²/∫ G² df",
                Printed(f"{self.bandwidth:.4g} Hz", self.bandwidth, None, "Hz"),
            ],
            ["band with nine tenths of the power", "{:.4g} to {:.4g} Hz".format(*self.band)],
            ["kurtosis", Printed(f"{kurtosis:.3f} ± {error:.2g}", kurtosis, error)],
            ["skewness", Printed(f"{skewness:.3f} ± {spread:.2g}", skewness, spread)],
            ["runs test", f"{runs} runs of {len(self.moments)} stretches, p = {probability:.2g}"],
        ]
        device = self.device_band()
        if device and self.scene:
            centre, width, share = device
            band = f"{centre:.4g} ± {0.5 * width:.2g} Hz: {share:.2%} of the power"
            if BINS_OF_WIDTH * self.band_resolution > width:
                band += f", lines within {self.band_resolution:.3g} Hz of it included"
            load = "with resistor" if self.scene.load.is_resistor else "open circuit"
            rows.append([f"device's band, {load}", band])
        return ["", "quantity", "value"], [["", *row] for row in rows]

    def _findings(self) -> list[str]:
        """Sentences on the method, and on deviations from stationary Gaussian noise."""
        low, high = (10.0 * math.log10(factor) for factor in self.confidence_band)
        frequency, share = self.departure
        lines = [
            f"Welch, {self.segments} segments of Hann's window, overlapping by half, of "
            f"{self.duration:g} s: resolution {self.resolution:.3g} Hz, {CONFIDENCE:.0%} band "
            f"{low:+.2f} to {high:+.2f} dB at each frequency"
        ]
        lines.append(
            f"specification: {len(self.profile)} breakpoints with the same rms; a device's power "
            f"at Q = {self.quality:.3g} changes most at {frequency:.4g} Hz, by {share:+.1%}"
            + (": use more breakpoints" if abs(share) > NOTED_DEPARTURE else "")
            if self.profile.size
            else "no specification: the density is a single line; use a sine instead"
        )
        if self.profile.size and self.resolved_from > self.profile[0, 0]:
            lines.append(
                f"below {self.resolved_from:.3g} Hz {self.duration:g} s are too short to resolve a "
                f"device of Q = {self.quality:.3g}: use a longer record, or a longer duration of a "
                "scene"
            )
        kurtosis, error = self.kurtosis()
        if abs(kurtosis - 3.0) > 3.0 * error:
            lines.append(
                f"not Gaussian: its kurtosis is {(kurtosis - 3.0) / error:+.1f} standard errors "
                "from 3"
            )
        if self.drifts:
            lines.append(
                "not stationary: its strength drifts, so that one density does not describe it"
            )
        return lines

    def texts(self) -> dict[str, str]:
        """The specification as a file for `excitation.breakpoints`."""
        lines = [f"# specification of {self.name}", f"frequency [Hz], density [{self.unit}]"]
        lines += [f"{frequency:.6g}, {density:.6g}" for frequency, density in self.profile]
        return {"-profile.csv": "\n".join(lines) + "\n"} if self.profile.size else {}

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        (kurtosis, error), (skewness, spread) = self.kurtosis(), self.skewness()
        runs, probability = self.runs_test()
        return plain(
            {
                "name": self.name,
                "scene": self.scene,
                "unit": self.unit,
                "resolution": self.resolution,
                "segments": self.segments,
                "duration": self.duration,
                "rms": self.rms,
                "bandwidth": self.bandwidth,
                "kurtosis": {"estimate": kurtosis, "standard_error": error},
                "skewness": {"estimate": skewness, "standard_error": spread},
                "runs_test": {"runs": runs, "p_value": probability},
                "device_band": self.device_band(),
                "profile": self.profile.tolist(),
                "frequencies": self.frequencies.tolist(),
                "density": self.density.tolist(),
            }
        )


def _draw(analysis):
    from harvester.base.formatting import in_print
    from harvester.results.panels import Panel, Series, draw_panels

    loud = analysis.density > FAINTEST * analysis.density.max()
    y = analysis.density[loud]
    series = [Series(analysis.frequencies[loud], y, "Welch", "0.7", width=3.0)]
    if analysis.profile.size:
        x, y = analysis.profile.T
        series.append(Series(x, y, "specification", "#0072B2", "-", "o"))
    device = analysis.device_band()
    if device:
        series.append(
            Series([device[0]] * 2, [y.min(), y.max()], "device's frequency", "#D55E00", "--")
        )
    label = f"one-sided density [{in_print(analysis.unit)}]"
    panel = Panel("frequency [Hz]", label, series, log_x=True, log_y=True)
    return draw_panels([panel], f"{analysis.name}: spectrum", (6.0, 4.0))


def _central(moments):
    """Central moments of second, fourth and third order from mean powers 1 to 4."""
    first, two, three, four = moments
    return (
        two - first**2,
        four - 4.0 * three * first + 6.0 * two * first**2 - 3.0 * first**4,
        three - 3.0 * two * first + 2.0 * first**3,
    )


def _left_out(moments, value):
    """A function of the mean powers, and its jackknife standard error over the stretches."""
    count = len(moments)
    means = moments.mean(axis=0)
    parts = [value((count * means - stretch) / (count - 1)) for stretch in moments]
    return float(value(means)), float(np.std(parts) * math.sqrt(count - 1))
