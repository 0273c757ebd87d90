"""Recorded base acceleration: the samples of a file are the knots."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from harvester.base import plain_text
from harvester.base.errors import SceneError
from harvester.base.plain_text import named
from harvester.device.keys import Key, key, not_negative, positive, table, word
from harvester.excitation import conditioning
from harvester.excitation.base import Excitation, ExcitationPath, Run, kernel_loss
from harvester.records import samples
from harvester.records.columns import MeasuredFile
from harvester.records.formats import most_samples, read_content
from harvester.records.quantities import ACCELERATION, QUANTITIES, unit_named
from harvester.records.time_base import time_base

if TYPE_CHECKING:
    from numpy.random.bit_generator import SeedSequence


UNITS = (*ACCELERATION, "scaled")
# A note is given if the band that contains BAND_SHARE of the record's power lies above or below the
# device's frequency by more than the factor BAND_MISS.
BAND_SHARE, BAND_MISS = 0.99, 3.0
# A note is given if the offset exceeds this share of the rms.
NOTED_OFFSET = 0.1
# A record is not stationary if the largest mean square of STRETCHES segments exceeds STEADY times
# the smallest.
STRETCHES, STEADY = 4, 1.1
# The record is cut into LINE_STRETCHES segments. It counts as one sine at a time, possibly swept,
# if in most of them LINE_SHARE of the power lies within LINE_BINS bins of the peak. Noise through a
# filter of Q < 20 has less.
LINE_STRETCHES, LINE_SHARE, LINE_BINS = 16, 0.9, 3
# Knots per sample of a smooth record. At seven samples per period, straight lines between these
# knots lower the amplitude by 0.1 %.
SMOOTH_KNOTS = 8
# A record also counts as sines if up to LINES_AT_ONCE lines of BINS_PER_LINE bins contain
# SHARE_OF_SEVERAL of the power. A segment is silent if its power is below SILENT of the strongest
# segment's.
LINES_AT_ONCE, SHARE_OF_SEVERAL, BINS_PER_LINE, SILENT = 3, 0.99, 100, 1e-6
# A run is a transient if the effective number of segments with equal energy is below MOST_EVENTS of
# EVENT_STRETCHES. It is at least 128 for Gaussian noise of any band, and 150 for a record whose
# mean square rises threefold.
EVENT_STRETCHES, MOST_EVENTS = 256, 32.0
# Length of a segment, in samples.
SHORTEST_STRETCH, LONGEST_STRETCH = 128, 1024


@table
class RecordedMotion(Excitation):
    """Base acceleration from a file, linear between samples; see docs/reference/files.md.

    η is minus the base acceleration, since displacements are relative to the base; in a scaled
    scene (`unit = "scaled"`) the column is η itself.

    `harvester.records` reads and repairs the samples, `conditioning` filters them. The ends of a
    periodic record are cross-faded over a twentieth of its length, and each realization starts at a
    random offset, drawn from the seed. A worker process reads the file again, and raises if its
    digest has changed.
    """

    file: str = key(
        "file of the record: relative to the scene's folder, in Python to the working folder",
        kind=str, required=True, file=True,
    )  # fmt: skip
    unit: str | None = word("unit of the column: after scaling; by default in its heading", UNITS)
    column: str | int | None = key("column: its title, or its number from 0", kind=(str, int))
    time_column: str | int | None = key("time column: its title or number", kind=(str, int))
    time_unit: str | None = word(
        "unit of the time column: by default in its heading", tuple(QUANTITIES["time"])
    )
    sampling_rate: float | None = positive("sampling rate: if the file has none", "Hz")
    start: float | None = not_negative("start: time of the first sample used", "s")
    scale: float | None = key("scale: the acceleration is scale · column + offset; by default 1")
    offset: float | None = key("offset: by default 0, in the unit")
    full_scale: float = positive(
        "full scale: acceleration at full scale of a .wav file, in the unit", default=1.0
    )
    detrend: str = word(
        "detrend: subtracts the mean, such as gravity, or a line", ("none", "mean", "linear"),
        default="mean",
    )  # fmt: skip
    band: tuple | None = key(
        "band: corner frequencies of a band-pass filter without phase shift", "Hz",
        element=Key(low=0.0), count=(2, 2),
    )  # fmt: skip
    mend: tuple = key(
        "mend: faults of the record that are repaired", default=(),
        element=Key(kind=str, words=samples.FAULTS), count=(0, 3),
    )  # fmt: skip
    repetition: str = word(
        "repetition: one pass, or periodic repetition", ("none", "periodic"), default="none"
    )
    interpolation: str = word(
        "interpolation between samples: straight lines, or band-limited", ("linear", "smooth"),
        default="linear",
    )  # fmt: skip
    fade_in: float | None = positive("fade-in: time in which the acceleration rises from 0", "s")
    kind: str = "record"
    knot_spacing: float | None = positive(
        "spacing of the knots: samples between the record's by band-limited interpolation", "s"
    )
    sha256: str = key(
        "SHA-256 of the file: other contents are rejected", kind=str, default="", written=False
    )

    symmetric = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "file", str(Path(self.file).absolute()))
        object.__setattr__(self, "sha256", self.sha256 or read_content(self.file)[1])

    @property
    def interval(self) -> float:
        """Time between two knots (s)."""
        return _knots(self).interval

    @property
    def samples(self) -> np.ndarray:
        """Base acceleration at the knots (m/s², or η in a scaled scene), shape (n,)."""
        return _knots(self).values

    @property
    def highest_frequency(self) -> float:
        return 0.5 / one_pass(self).interval

    def measured_density(self, stretch: float) -> tuple[np.ndarray, np.ndarray]:
        return _density(self, max(1, min(round(stretch / self.interval), self.samples.size)))

    @property
    def kept_samples(self) -> int:
        return self.samples.size

    @property
    def lines(self) -> tuple[tuple[float, float], ...]:
        return _lines(self)

    @property
    def period(self) -> float | None:
        return self.samples.size * self.interval if self.repetition == "periodic" else None

    @property
    def own_duration(self) -> float | None:
        return self.period or (self.samples.size - 1) * self.interval

    @property
    def longest_run(self) -> float:
        return math.inf if self.period else (self.samples.size - 1) * self.interval

    @property
    def random(self) -> bool:
        return self.repetition == "periodic"

    @property
    def drifts(self) -> bool:
        return self.repetition == "none"

    def transient(self, run: Run) -> bool:
        count = math.ceil((run.settle + run.duration) / self.interval)
        return self.drifts and _events(self, count) < MOST_EVENTS

    def check(self, units: str, run: Run, origin: str) -> None:
        self._check_unit(units, origin)
        if self.full_scale != 1.0 and Path(self.file).suffix.lower() != ".wav":
            raise SceneError(f"{origin}: excitation.full_scale is for .wav files only: remove it")
        if self.scale == 0.0:
            raise SceneError(f"{origin}: excitation.scale = 0: must not be 0")
        longest = one_pass(self).interval * (1.0 + 1e-9)
        self._check_knot_spacing(longest, "the time between the record's samples", origin)
        if self.interpolation == "smooth" and self.knot_spacing is not None:
            raise SceneError(
                f'{origin}: excitation.interpolation = "smooth" and excitation.knot_spacing: keep '
                "one: knot_spacing already interpolates smoothly"
            )
        if self.repetition == "periodic":
            if self.fade_in is not None:
                raise SceneError(
                    f'{origin}: excitation.fade_in: a record with repetition = "periodic" has no '
                    "beginning: remove the key"
                )
            return
        length: Any = self.own_duration
        if run.duration and run.settle + run.duration > length * (1.0 + 1e-9):
            raise SceneError(
                f"{origin}: the record lasts {length:g} s, and run.settle + run.duration are "
                f'{run.settle + run.duration:g} s; shorten the run or set repetition = "periodic"'
            )

    def spacing(self, longest: float) -> float:
        return self.interval

    def equivalent_noise(self, relaxation_time: float, longest: float) -> tuple[float, float]:
        return _equivalent_noise(self)

    def path(self, spacing: float, length: float, seed: SeedSequence) -> ExcitationPath:
        sign = 1.0 if self.unit == "scaled" else -1.0
        start = 0
        if self.repetition == "periodic":
            start = int(np.random.default_rng(seed).integers(self.samples.size))
        eta = sign * self.samples / length
        return RecordPath(eta, spacing, self.interval, start, self.repetition == "periodic")

    def notes(self, spacing: float, angular_frequency: float, run: Run) -> tuple[str, ...]:
        values, name = self.samples, plain_text.name(Path(self.file).name)
        repeats = self.repetition == "periodic"
        length = (values.size if repeats else values.size - 1) * self.interval
        loss = kernel_loss(self.interval, angular_frequency)
        squares = [float(np.mean(part**2)) for part in np.array_split(values, STRETCHES)]
        change = max(squares) / min(squares) if min(squares) > 0.0 else math.inf
        lines = [
            *_band_remark(self, angular_frequency),
            *(f"record {name}: {remark}" for remark in _knots(self).remarks),
            f"record {name} ({self.sha256[:12]}), {length:g} s, linear between samples "
            f"{self.interval:.4g} s apart: its density at the device's frequency is {loss:.1%} "
            "below the band-limited signal's",
        ]
        if repeats:
            times = (run.settle + run.duration) * run.realizations / length
            lines.append(
                f"the record is repeated {times:.1f} times: error bars show how well this "
                f"record's mean is known (best over whole repeats of {length:g} s), not the "
                "mean of another record"
            )
        elif self.transient(run):
            lines.append(
                "a few events contain the record's energy: it is a transient, not a sample of a "
                "stationary signal; means times run.duration are the energies of this record, and "
                "error bars cover the steps alone, from a second run with longer steps"
            )
        else:
            drifting = (
                "are valid for records with the same drift; between its quarters the mean square "
                f"changes by a factor of {change:.3g}"
            )
            steady = "are valid for similar records; its mean square is steady"
            lines.append(
                f"one pass of one record: error bars {drifting if change > STEADY else steady}; "
                "error bars of stored powers are the step error, for this record alone"
            )
        if abs(values.mean()) > NOTED_OFFSET * values.std():
            lines.append(
                f"the record's mean is {values.mean() / values.std():+.2g} standard deviations: "
                'remove excitation.detrend = "none" to subtract it'
            )
        return tuple(lines)

    def averaging_refusal(self) -> str:
        return (
            "averaging needs Ornstein–Uhlenbeck noise: simulate (method monte-carlo), or average "
            "a fit to the record's spectrum (harvester average --fit)"
        )


class RecordPath(ExcitationPath):
    """Samples of a record at knots, from an offset on.

    Parameters
    ----------
    samples : ndarray, shape (n,)
        η, scaled units.
    spacing, interval : float
        Time between knots and between samples (s); η is linear between samples.
    start : int
        First sample.
    periodic : bool
        Whether the record repeats; else η = 0 after its end.
    """

    def __init__(
        self,
        samples: np.ndarray,
        spacing: float,
        interval: float,
        start: int = 0,
        periodic: bool = False,
    ) -> None:
        self.spacing = spacing
        self._samples = samples
        self._ratio = spacing / interval
        self._start, self._periodic = start, periodic
        self._next = 0

    def read(self, count: int) -> np.ndarray:
        places = np.arange(self._next, self._next + count) * self._ratio
        self._next += count
        before = np.floor(places + 1e-9).astype(int)
        share = np.maximum(places - before, 0.0)
        before += self._start
        return (1.0 - share) * self._at(before) + share * self._at(before + 1)

    def _at(self, places):
        size = self._samples.size
        if self._periodic:
            return self._samples[places % size]
        return np.where(places < size, self._samples[np.minimum(places, size - 1)], 0.0)


class Knots(NamedTuple):
    """Base acceleration at the knots (m/s², or η in a scaled scene), shape (n,), their interval
    (s), and the repairs of the record, in words."""

    values: np.ndarray
    interval: float
    remarks: tuple[str, ...]


@lru_cache(maxsize=4)
def _knots(record: RecordedMotion) -> Knots:
    """The knots of a record, cached for all realizations."""
    name = named(Path(record.file).name)
    try:
        knots = _read_knots(record, name)
    except MemoryError:
        raise SceneError(
            f"{name}: the record does not fit into the free memory: shorten it or lower its "
            "sampling rate"
        ) from None
    knots.values.flags.writeable = False
    return knots


def _read_knots(record, name):
    content, digest = read_content(record.file)
    if digest != record.sha256:
        raise SceneError(f"{name}: the record has changed since the scene was read: read it again")
    measured = MeasuredFile(
        record.file,
        content,
        setting=lambda key, of: f"excitation.{'time_' if of == 'time' else ''}{key}",
        behind="",
    )
    motion = _motion(measured, record.column, record.time_column)
    times, rate = measured.times(
        record.time_column, record.time_unit, record.sampling_rate, [motion]
    )
    raw = record.scale is not None and not unit_named(
        "acceleration", measured.headings[motion].unit
    )
    unit = measured.unit("acceleration", motion, record.unit, record.unit == "scaled", raw)
    factor_of_unit = record.full_scale * ACCELERATION.get(unit, 1.0)
    (values,) = measured.take([motion])
    values, times = _from_start(values, times, rate, record.start, name)
    values, markers = samples.without_markers(values, record.mend)
    if record.scale is not None or record.offset is not None:
        scale = 1.0 if record.scale is None else record.scale
        values = scale * values + (record.offset or 0.0)
    samples.check_size(values, name, factor_of_unit, unit or "scaled")
    values, times, gaps = samples.repaired(values, times, name, record.mend)
    samples.check_variation(values, name)
    cure = "correct it, or leave it out and give excitation.sampling_rate"
    base = time_base(times, rate, name, cure, record.mend)
    rate, values = base.rate, base.resampled(values) * factor_of_unit
    offset = _offset_remark(values, record, unit)
    values = conditioning.conditioned(values, rate, record.detrend, record.band, name)
    if record.fade_in is not None:
        # Half a cosine.
        rise = np.clip(np.arange(values.size) / (record.fade_in * rate), 0.0, 1.0)
        values = values * 0.5 * (1.0 - np.cos(np.pi * rise))
    smooth = SMOOTH_KNOTS if record.interpolation == "smooth" else 1
    knots_per_sample = smooth / (rate * (record.knot_spacing or 1.0 / rate))
    if not knots_per_sample * values.size <= most_samples():
        setting = (
            f"knot_spacing = {record.knot_spacing:g}" if record.knot_spacing else "interpolation"
        )
        raise SceneError(
            f"{name}: excitation.{setting}: gives {knots_per_sample * values.size:.3g} samples, "
            f"and this machine's memory allows {most_samples()}: shorten the record"
        )
    factor = max(1, math.ceil(knots_per_sample - 1e-9))
    refined = conditioning.smoothed if smooth > 1 else conditioning.refined
    values = refined(values, factor)
    if record.repetition == "periodic":
        values = conditioning.closed(values)
    remarks = (*measured.table.remarks, *markers, *gaps, *base.remarks, *offset)
    return Knots(values, float(1.0 / (rate * factor)), remarks)


def _motion(measured, column, time_column):
    """Index of the given column, else of the only column besides time, or the only acceleration."""
    if column is not None:
        return measured.column("acceleration", column)
    table = measured.table
    times = {k for k, heading in enumerate(measured.headings) if heading.quantity == "time"}
    times.add(measured.column("time", time_column, ()))
    others = {*range(len(table.names))} - {*times, *table.texts, *table.complexes}
    if not others:
        # A column of text or complex numbers is rejected with a reason.
        for index in {*table.texts, *table.complexes} - times:
            measured.column("acceleration", index)
    if len(others) != 1:
        others &= {*measured.of("acceleration")}
    if len(others) != 1:
        raise SceneError(
            f"{measured.where}: excitation.column is missing; set it to one of {measured.listed()}"
        )
    return others.pop()


def _offset_remark(values, record, unit):
    """Remark on a subtracted mean value; empty if it is small."""
    mean = float(values.mean())
    if record.detrend != "mean" or not abs(mean) > NOTED_OFFSET * values.std():
        return ()
    amount = f"{mean:.4g} m/s²" if unit else f"{mean:.4g}"
    return (
        f"its mean, {amount} (gravity or an offset), was subtracted; excitation.detrend = "
        '"none" keeps it',
    )


def _from_start(values, times, rate, start, name):
    """Samples and their times from `start` (s) on."""
    if not start:
        return values, times
    if times is None:
        first = math.ceil(start * rate - 1e-9)
    else:
        with np.errstate(invalid="ignore"):
            first = np.append(np.flatnonzero(times >= start * (1.0 - 1e-12)), times.size)[0]
    if first >= values.size:
        length = values.size / rate if times is None else np.nanmax(times)
        raise SceneError(
            f"{name}: excitation.start = {start:g} s: the record ends earlier: start before "
            f"{length:g} s"
        )
    return values[first:], None if times is None else times[first:] - times[first]


def one_pass(record: RecordedMotion) -> Knots:
    """The record's samples without upsampling or cross-fading, and their interval (s)."""
    return _knots(replace(record, repetition="none", knot_spacing=None, interpolation="linear"))


@lru_cache(maxsize=4)
def _power_band(record: RecordedMotion) -> tuple[float, float]:
    """Frequencies (Hz) between which the record has `BAND_SHARE` of its power."""
    values, interval, _ = one_pass(record)
    power = np.abs(np.fft.rfft(values - values.mean())) ** 2
    gathered = np.cumsum(power) / power.sum()
    frequencies = np.fft.rfftfreq(values.size, interval)
    ends = np.searchsorted(gathered, [0.5 * (1.0 - BAND_SHARE), 0.5 * (1.0 + BAND_SHARE)])
    low, high = frequencies[np.minimum(ends, frequencies.size - 1)]
    return float(low), float(high)


def _band_remark(record, angular_frequency):
    """Remark if the record's power is far from the device's frequency."""
    frequency = angular_frequency / (2.0 * math.pi)
    low, high = _power_band(record)
    if not 0.0 < frequency < math.inf or low / BAND_MISS <= frequency <= high * BAND_MISS:
        return ()
    return (
        f"the record does not excite the device: {BAND_SHARE:.0%} of its power lies between "
        f"{low:.3g} and {high:.3g} Hz, and the device resonates at {frequency:.3g} Hz: check "
        "the time column's heading, time_unit and sampling_rate",
    )


def _lines(record):
    """The strongest sines of each segment, if the record consists of a few sines at a time."""
    values, interval, _ = _knots(record)
    size = min(values.size // LINE_STRETCHES, LONGEST_STRETCH)
    if size < SHORTEST_STRETCH:
        return ()
    stretches = np.array(
        [values[k * values.size // LINE_STRETCHES :][:size] for k in range(LINE_STRETCHES)]
    )
    stretches = (stretches - stretches.mean(axis=1, keepdims=True)) * np.hanning(size)
    density = np.abs(np.fft.rfft(stretches, axis=1)) ** 2
    # The residual mean at frequency 0 is not a sine.
    density[:, 0] = 0.0
    total_power = density.sum(axis=1)
    if np.median(total_power) <= SILENT * total_power.max():
        return ()
    sines: list[tuple[float, float]] = []
    bins = np.arange(density.shape[1])
    for removed in range(min(LINES_AT_ONCE, max(1, bins.size // BINS_PER_LINE))):
        peaks = density.argmax(axis=1)
        nearby = np.abs(bins - peaks[:, None]) <= LINE_BINS
        power = (density * nearby).sum(axis=1)
        # The Hann window reduces the mean square to 3/8.
        amplitudes = np.sqrt(4.0 * power / (0.375 * size**2))
        sines += zip((peaks / (size * interval)).tolist(), amplitudes.tolist(), strict=True)
        density[nearby] = 0.0
        share = SHARE_OF_SEVERAL if removed else LINE_SHARE
        if np.median(density.sum(axis=1)) < (1.0 - share) * np.median(total_power):
            return tuple(sines)
    return ()


@lru_cache(maxsize=4)
def _events(record, count):
    """Effective number of segments with equal energy among the first `count` knots."""
    parts = np.array_split(record.samples[: count + 1], EVENT_STRETCHES)
    energies = np.array([float(np.sum(part**2)) for part in parts])
    squares = float(np.sum(energies**2))
    return float(energies.sum()) ** 2 / squares if squares > 0.0 else math.inf


@lru_cache(maxsize=4)
def _density(record, size):
    """Welch's estimate of the record's density, from segments of `size` knots."""
    from scipy import signal

    return signal.welch(record.samples, 1.0 / record.interval, nperseg=size)


@lru_cache(maxsize=4)
def _equivalent_noise(record):
    """(D, τ1) of Ornstein–Uhlenbeck noise with the record's peak density D/π and variance D/τ1."""
    values = record.samples
    _, density = _density(record, min(values.size, 1024))
    # The density is one-sided and per hertz: 4 π S(ω).
    intensity = float(density.max()) / 4.0
    return intensity, intensity / float(np.mean(values**2))
