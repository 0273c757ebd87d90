"""The density of any excitation or record, what kind of noise it is, and a specification of it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.arguments import usual_arithmetic
from harvester.calling import scene_of
from harvester.errors import HarvesterError
from harvester.files import plain_text
from harvester.files.serialising import plain
from harvester.signatures import File, Seconds

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from harvester.scene.model import Scene

# Segments of the density, unless the resolution is given: a 95 % band of about ±1.3 dB. Longer
# segments than the most are not taken by default, and blocks hold so many samples at least: an hour
# at 8 kHz takes no more memory than a minute.
SEGMENTS, MOST_IN_SEGMENT, BLOCK = 64, 2**18, 2**16
# Number of stretches: the trend of their mean squares shows a drift, their scatter gives the errors
# of the moments.
STRETCHES = 32
# Hann's window passes as much noise as this many bins.
HANN_BINS = 1.5
# Bands of an octave in which a specification is averaged, and the share of the greatest density
# below which it ends.
BANDS_PER_OCTAVE, FAINTEST = 12.0, 1e-4
CONFIDENCE = 0.95


def analysis_of(
    source: File,
    device: File | None,
    column: str | None,
    unit: str | None,
    sampling_rate: float | None,
    resolution: float | None,
    duration: Seconds | None,
    breakpoints: int,
) -> SpectrumAnalysis:
    """The analysis that `harvester.spectrum` returns."""
    from harvester.excitation.recorded import RecordedMotion, one_pass

    if breakpoints < 2:
        raise HarvesterError(f"breakpoints {breakpoints}: must be at least 2")
    if not isinstance(source, (str, Path)) or str(source).endswith(".toml") or _built_in(source):
        for name, value in {"device": device, "column": column, "unit": unit}.items():
            if value is not None:
                raise HarvesterError(f"{name}: is for a record, and {source} is a scene")
        scene = scene_of(source)
        return _of_scene(scene, duration, resolution, breakpoints)
    if duration is not None:
        raise HarvesterError("duration: is for a scene; a record is taken whole")
    place: Any = int(column) if column is not None and column.isdigit() else column
    record = RecordedMotion(str(source), unit=unit, column=place, sampling_rate=sampling_rate)
    values, interval, _ = one_pass(record)
    values = values - values.mean()
    units = "scaled" if record.unit == "scaled" else "SI"
    of_device = None if device is None else scene_of(device)
    name = plain_text.name(Path(str(source)).stem)

    def blocks(size: int) -> Iterator[np.ndarray]:
        return (values[first : first + size] for first in range(0, values.size, size))

    return _analysed(
        name, blocks, values.size, interval, resolution, breakpoints, of_device, units, knots=False
    )


def _built_in(source):
    from harvester.scene.source import built_in_names

    return str(source) in built_in_names()


def _of_scene(scene, duration, resolution, breakpoints):
    """Spectrum of the first realization of a scene's excitation."""
    from harvester.prepared.paths import noise_path
    from harvester.prepared.prepared import prepared
    from harvester.prepared.steps import knot_spacing

    ready = prepared(scene)
    spacing = knot_spacing(ready)
    count = int((duration or scene.run.duration) / spacing)

    def blocks(size: int) -> Iterator[np.ndarray]:
        path = noise_path(ready, 0)
        for first in range(0, count, size):
            yield ready.excitation_unit * path.read(min(size, count - first))

    name = scene.name
    return _analysed(
        name, blocks, count, spacing, resolution, breakpoints, scene, scene.units, knots=True
    )


def _analysed(name, blocks, count, interval, resolution, breakpoints, scene, units, knots):
    """The analysis of values that come in blocks, an hour of them in flat memory."""
    size = _segment(count, interval, resolution, name)
    with usual_arithmetic():
        density, moments, segments = _sums(blocks, count, interval, size)
    frequencies = np.fft.rfftfreq(size, interval)
    if knots:
        # The engines' excitation is linear between the knots, which lowers the density by this
        # factor.
        density = density * np.sinc(frequencies * interval) ** 4
    return SpectrumAnalysis(
        name=name,
        scene=scene,
        units=units,
        frequencies=frequencies[1:],
        density=density[1:],
        resolution=HANN_BINS / (size * interval),
        segments=segments,
        duration=count * interval,
        moments=moments,
        profile=profile(frequencies[1:], density[1:], breakpoints),
    )


def _segment(count, interval, resolution, name):
    """Samples of a segment, even."""
    size = min(2.0 * count / (SEGMENTS + 1), MOST_IN_SEGMENT)
    if resolution:
        size = HANN_BINS / (resolution * interval)
    size = 2 * int(0.5 * size)
    if size < 16 or size > count:
        raise HarvesterError(
            f"{name}: {count} samples {interval:.3g} s apart do not give segments of {size}: "
            "take a longer one, or another --resolution"
        )
    return size


def _sums(blocks, count, interval, size):
    """Density, powers of the values in each stretch, and number of segments."""
    from scipy import signal

    stretch = max(count // STRETCHES, 1)
    # Whole segments with an overlap of half of one: the density is their mean, block after block.
    total, segments = np.zeros(size // 2 + 1), 0
    powers, place = np.zeros((STRETCHES, 4)), 0
    left = np.empty(0)
    for block in blocks(max(size, BLOCK)):
        left = np.append(left, block)
        many = (left.size - size) // (size // 2) + 1
        if many > 0:
            end = size + (many - 1) * (size // 2)
            _, density = signal.welch(left[:end], 1.0 / interval, nperseg=size, detrend=False)
            total += many * density
            segments += many
            left = left[many * (size // 2) :]
        ends = np.minimum(np.arange(1, STRETCHES + 1) * stretch - place, block.size)
        starts = np.clip(np.arange(STRETCHES) * stretch - place, 0, block.size)
        for which in np.flatnonzero(ends > starts):
            part = block[starts[which] : ends[which]]
            square = part * part
            sums = part.sum(), square.sum(), (square * part).sum(), (square * square).sum()
            powers[which] += sums
        place += block.size
    return total / segments, powers[: count // stretch] / stretch, segments


def profile(frequencies: np.ndarray, density: np.ndarray, breakpoints: int) -> np.ndarray:
    """Breakpoints of straight lines on log–log axes, with the mean square of the density.

    Averages in twelfths of an octave are followed: each next breakpoint stands where the lines so
    far are farthest from them in dB.

    Parameters
    ----------
    frequencies, density : ndarray, shape (n,)
    breakpoints : int
        Largest number of breakpoints.

    Returns
    -------
    ndarray, shape (m, 2)
        Frequency (Hz) and density.
    """
    from harvester.excitation.shaped import mean_square

    loud = np.flatnonzero(density > FAINTEST * density.max())
    kept = slice(loud[0], loud[-1] + 1)
    f, g = frequencies[kept], np.maximum(density[kept], FAINTEST * density.max())
    band = np.floor(BANDS_PER_OCTAVE * np.log2(f / f[0]) + 1e-9).astype(int)
    counts = np.bincount(band)
    used = counts > 0
    x = np.log(np.bincount(band, f)[used] / counts[used])
    y = np.log(np.bincount(band, g)[used] / counts[used])
    x[0], x[-1] = math.log(f[0]), math.log(f[-1])
    if x.size < 2 or x[-1] <= x[0]:
        raise HarvesterError("the density has one line only: a sine is no spectrum")
    chosen = [0, x.size - 1]
    while len(chosen) < min(breakpoints, x.size):
        away = np.abs(y - np.interp(x, x[chosen], y[chosen]))
        if away.max() < 1e-9:
            break
        chosen = sorted({*chosen, int(away.argmax())})
    points = np.exp(np.column_stack([x[chosen], y[chosen]]))
    square = float(g.sum() * (frequencies[1] - frequencies[0]))
    points[:, 1] *= square / mean_square(tuple(map(tuple, points)))
    return points


@dataclass(frozen=True)
class SpectrumAnalysis:
    """Result of `harvester.spectrum`.

    Attributes
    ----------
    name : str
    scene : Scene or None
        Whose excitation it is, or whose device is looked at.
    units : str
        "SI" or "scaled".
    frequencies, density : ndarray, shape (n,)
        Hz, and one-sided density in (m/s²)²/Hz, or of η in a scaled scene.
    resolution : float
        Bandwidth of the density (Hz).
    segments : int
        Half overlapping ones, by Hann's window.
    duration : float
        s.
    moments : ndarray, shape (stretches, 4)
        Mean of each power, 1 to 4, in stretches of equal length.
    profile : ndarray, shape (m, 2)
        Breakpoints: frequency (Hz) and density.
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
        """(∫ G df)²/∫ G² df (Hz): the width of flat noise with as many independent values."""
        return float(self.density.sum() ** 2 / (self.density**2).sum()) * self._bin

    @property
    def band(self) -> tuple[float, float]:
        """Frequencies (Hz) between which nine tenths of the power lie."""
        gathered = np.cumsum(self.density) / self.density.sum()
        low, high = np.searchsorted(gathered, [0.05, 0.95])
        return float(self.frequencies[low]), float(self.frequencies[min(high, gathered.size - 1)])

    @property
    def confidence_band(self) -> tuple[float, float]:
        """Factors of the density between which the true one lies, by 95 % at each frequency.

        χ² with 36 K²/(19 K − 1) degrees of freedom, K half overlapping segments by Hann's window
        (P. D. Welch, IEEE Trans. Audio Electroacoust. 15, 70, 1967).
        """
        from scipy.stats import chi2

        freedom = 36.0 * self.segments**2 / (19.0 * self.segments - 1.0)
        low, high = chi2.ppf([0.5 + 0.5 * CONFIDENCE, 0.5 - 0.5 * CONFIDENCE], freedom)
        return float(freedom / low), float(freedom / high)

    def kurtosis(self) -> tuple[float, float]:
        """E[(a − ā)⁴]/E[(a − ā)²]², 3 for a Gaussian, and its standard error (leave one out)."""
        return _left_out(self.moments, lambda m: _central(m)[1] / _central(m)[0] ** 2)

    def skewness(self) -> tuple[float, float]:
        """E[(a − ā)³]/E[(a − ā)²]^1.5, 0 for a Gaussian, and its standard error."""
        return _left_out(self.moments, lambda m: _central(m)[2] / _central(m)[0] ** 1.5)

    def runs_test(self) -> tuple[int, float]:
        """Runs of stretches whose mean square lies on one side of the median, and the p-value.

        Few runs: the strength drifts. By the normal law of the number of runs (J. S. Bendat and
        A. G. Piersol, Random Data, 4th ed., 2010, section 4.5.2).
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
        """Whether few runs show a drift, larger than a steady sine's stretches differ by.

        Over a stretch of T the mean square of a sine is off by up to 1/(2 π f T), by its phase.
        """
        runs, probability = self.runs_test()
        squares, centre = self.moments[:, 1], self.frequencies @ self.density / self.density.sum()
        differ = len(squares) / (2.0 * math.pi * centre * self.duration)
        few = 2 * runs < len(squares) and probability < 1.0 - CONFIDENCE
        return bool(few and squares.std() > differ * squares.mean())

    def device_band(self) -> tuple[float, float, float] | None:
        """Frequency and half-power width of the device (Hz), and the share of the power in it."""
        from harvester.device import timescales
        from harvester.prepared.prepared import prepared

        if self.scene is None or self.scene.excitation.prescribes_displacement:
            return None
        system = prepared(self.scene).system
        omega = timescales.angular_frequency(system)
        centre, width = (
            omega / (2.0 * math.pi),
            timescales.loss_rate(system, omega) / (2.0 * math.pi),
        )
        edges = np.append(self.frequencies - 0.5 * self._bin, self.frequencies[-1])
        gathered = np.append(0.0, np.cumsum(self.density)) / self.density.sum()
        low, high = np.interp([centre - 0.5 * width, centre + 0.5 * width], edges, gathered)
        return centre, width, float(high - low)

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows as text."""
        unit = "" if self.units == "scaled" else "m/s²"
        (kurtosis, error), (skewness, spread) = self.kurtosis(), self.skewness()
        runs, probability = self.runs_test()
        rows = [
            ["rms", f"{self.rms:.4g} {unit}"],
            ["bandwidth", f"{self.bandwidth:.4g} Hz"],
            ["nine tenths of the power", "{:.4g} to {:.4g} Hz".format(*self.band)],
            ["kurtosis", f"{kurtosis:.3f} ± {error:.2g}"],
            ["skewness", f"{skewness:.3f} ± {spread:.2g}"],
            ["runs test", f"{runs} runs of {len(self.moments)} stretches, p = {probability:.2g}"],
        ]
        device = self.device_band()
        if device:
            centre, width, share = device
            rows.append(["device's band", f"{centre:.4g} ± {0.5 * width:.2g} Hz: {share:.2%}"])
        return ["", "quantity", "value"], [["", *row] for row in rows]

    def sentences(self) -> list[str]:
        """How it was found, and what departs from stationary Gaussian noise."""
        low, high = (10.0 * math.log10(each) for each in self.confidence_band)
        lines = [
            f"Welch, {self.segments} half overlapping segments by Hann's window of "
            f"{self.duration:g} s: resolution {self.resolution:.3g} Hz, {CONFIDENCE:.0%} band "
            f"{low:+.2f} to {high:+.2f} dB at each frequency",
            f"specification: {len(self.profile)} breakpoints with the same rms",
        ]
        kurtosis, error = self.kurtosis()
        if abs(kurtosis - 3.0) > 3.0 * error:
            lines.append(
                f"not Gaussian: its kurtosis is {(kurtosis - 3.0) / error:+.1f} errors off 3"
            )
        if self.drifts:
            lines.append(
                "not stationary: its strength drifts, so that one density does not describe it"
            )
        return lines

    def texts(self) -> dict[str, str]:
        """The specification as a file that `excitation.breakpoints` takes."""
        lines = [f"# specification of {self.name}", f"frequency [Hz], density [{self.unit}]"]
        lines += [f"{frequency:.6g}, {density:.6g}" for frequency, density in self.profile]
        return {"-profile.csv": "\n".join(lines) + "\n"}

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

    def figure(self) -> Figure:
        """The density, its specification and the device's frequency."""
        from harvester.show import figures

        return figures.drawn(_draw, self)


def _draw(analysis):
    from harvester.show.numbers import in_print
    from harvester.show.panels import Panel, Series, draw_panels

    loud = analysis.density > FAINTEST * analysis.density.max()
    x, y = analysis.profile.T
    series = [
        Series(analysis.frequencies[loud], analysis.density[loud], "Welch", "0.7", width=3.0),
        Series(x, y, "specification", "#0072B2", "-", "o"),
    ]
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
    one, two, three, four = moments
    return (
        two - one**2,
        four - 4.0 * three * one + 6.0 * two * one**2 - 3.0 * one**4,
        three - 3.0 * two * one + 2.0 * one**3,
    )


def _left_out(moments, value):
    """A function of the mean powers, and its jackknife standard error over the stretches."""
    count = len(moments)
    whole = moments.mean(axis=0)
    parts = [value((count * whole - each) / (count - 1)) for each in moments]
    return float(value(whole)), float(np.std(parts) * math.sqrt(count - 1))
