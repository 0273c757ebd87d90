"""The ranges that records visited; beyond them a model extrapolates."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from harvester.device import contact, timescales
from harvester.device.system import potential
from harvester.scene.numbers import numbers

if TYPE_CHECKING:
    from harvester.identification.fitting import Fitted
    from harvester.identification.measurement import Measurement
    from harvester.identification.response import Responses

# The visited frequencies lie between these shares of the base's cumulative power.
BAND = (0.01, 0.99)
# A place may lie outside the visited displacements by this share of their range.
MARGIN = 0.02
# A prediction is claimed while its run leaves the range of visited displacements, or the load that
# of the loads, by at most this share, and the frequencies stay within this factor.
BEYOND, BEYOND_BAND = 0.1, 1.5
SPRING = ("restoring_force[", "linear_stiffness", "cubic_stiffness")


@dataclass(frozen=True)
class Visited:
    """Ranges that the records visited, in SI units or a scaled scene's.

    Attributes
    ----------
    displacement, velocity : tuple of (float, float)
        Displacement and velocity of the mass: each record's least and greatest, as the model has
        them.
    frequency : (float, float)
        Hz, of the base.
    loads : tuple of float
        Resistances (Ω).
    extrapolated : tuple of str
        Features of the device that lie outside, in words.
    values : tuple of str
        Keys of values that describe the spring about a place that no record visited.
    si : bool
        Whether the scene is in SI units.
    """

    displacement: tuple[tuple[float, float], ...]
    velocity: tuple[tuple[float, float], ...]
    frequency: tuple[float, float]
    loads: tuple[float, ...]
    extrapolated: tuple[str, ...]
    values: tuple[str, ...]
    si: bool

    @property
    def ranges(self) -> str:
        """The visited ranges, in words."""
        speed = max(abs(end) for interval in self.velocity for end in interval)
        moved = " and ".join(
            f"{self._length(low)} … {self._length(high)}"
            for low, high in _joined(self.displacement)
        )
        low, high = self.frequency
        loads = ", ".join(f"{load:.4g}" for load in self.loads)
        return (
            f"displacement {moved}{' mm' if self.si else ''}, velocity up to {speed:.3g}"
            f"{' m/s' if self.si else ''}, frequency {low:.3g} … {high:.3g}"
            f"{' Hz' if self.si else ''}, load {loads}{' Ω' if self.si else ''}"
        )

    def excludes(self, responses: Responses, x: np.ndarray) -> str:
        """Why a run (scaled displacements) of the only record of `responses` lies outside these
        ranges; empty if it lies within them."""
        low = min(interval[0] for interval in self.displacement)
        high = max(interval[1] for interval in self.displacement)
        margin, x = BEYOND * (high - low), x * responses.length
        if x.min() < low - margin or x.max() > high + margin:
            return "the run leaves the visited displacements"
        record = responses.experiments[0]
        load = float(record.scene.load.resistance)
        if not (1.0 - BEYOND) * min(self.loads) <= load <= (1.0 + BEYOND) * max(self.loads):
            return "its load was not visited"
        slowest, fastest = band([record.measurement])
        if slowest < self.frequency[0] / BEYOND_BAND or fastest > BEYOND_BAND * self.frequency[1]:
            return "its frequencies were not visited"
        return ""

    def _length(self, value):
        return f"{1e3 * value if self.si else value:.3g}"


def visited(fitted: Fitted) -> Visited | None:
    """The ranges that a fit's records visited; None if there are only frequency responses."""
    if fitted.settled is None:
        return None
    responses = fitted.shooting.responses
    displacement: list[tuple[float, float]] = []
    velocity: list[tuple[float, float]] = []
    # Records in time come first; sweeps and impedances after them have only small motion.
    experiments = responses.experiments[: len(fitted.settled.edges)]
    for number in range(len(experiments)):
        states = [fitted.shooting.states(fit, number) for fit in (fitted.fit, fitted.settled)]
        for intervals, column in ((displacement, 0), (velocity, 1)):
            values = np.concatenate([path[:, column] for path in states]) * responses.length
            intervals.append((float(np.nanmin(values)), float(np.nanmax(values))))
    system, scales = responses.known_device(0, fitted.values)
    si = fitted.scene.units == "SI"
    loads = {
        float(numbers(experiment.scene)["load.resistance"][0])
        for experiment in experiments
        if "load.resistance" in numbers(experiment.scene)
    }
    ranges = tuple(displacement)
    spring: tuple[str, ...] = ()
    if not _inside(ranges, 0.0):
        spring = tuple(k for k in fitted.keys if k.rpartition(".")[2].startswith(SPRING))
    outside = _outside(system, scales.displacement, ranges, si, len(loads) > 1)
    if spring:
        names = ", ".join(key.rpartition(".")[2] for key in spring)
        outside = (f"the spring about x = 0 ({names})", *outside)
    return Visited(
        displacement=ranges,
        velocity=tuple(velocity),
        frequency=band(experiment.measurement for experiment in experiments),
        loads=tuple(sorted(loads)),
        extrapolated=outside,
        values=spring,
        si=si,
    )


def band(measurements: Iterable[Measurement]) -> tuple[float, float]:
    """Frequencies between which the base has most of its power, of all records (Hz)."""
    ends = []
    for record in measurements:
        values = record.acceleration - record.acceleration.mean()
        power = np.abs(np.fft.rfft(values * np.hanning(values.size))) ** 2
        gathered = np.cumsum(power)
        places = np.searchsorted(gathered, np.array(BAND) * gathered[-1])
        frequencies = np.fft.rfftfreq(values.size, 1.0 / record.sampling_rate)
        ends.append(frequencies[np.minimum(places, frequencies.size - 1)])
    return float(min(low for low, _ in ends)), float(max(high for _, high in ends))


def _outside(system, length, ranges, si, several_loads):
    """Features of the device outside the visited displacements."""

    def at(place):
        return f"{1e3 * place:.3g} mm" if si else f"{place:.3g}"

    parts = []
    wells = [length * well for well in timescales.wells(system)]
    for well in wells:
        if not _inside(ranges, well):
            parts.append(f"the {'other ' if len(wells) > 1 else ''}well at {at(well)}")
    for saddle in timescales.saddles(system):
        if not _inside(ranges, length * saddle):
            height = float(potential(system, saddle) - potential(system, timescales.rest(system)))
            energy = f" of {height * length**2:.3g} J/kg" if si else f" of {height:.3g}"
            parts.append(f"the barrier at {at(length * saddle)}{energy}")
    for edge in contact.edges(system.contacts):
        if np.isfinite(edge) and edge and not _inside(ranges, length * edge):
            parts.append(f"the stopper at {at(length * edge)}")
    low = min(interval[0] for interval in ranges)
    high = max(interval[1] for interval in ranges)
    parts.append(f"the walls beyond {at(low)} and {at(high)}")
    if not several_loads:
        parts.append("other loads (coupling and capacitance are as right as the load's resistance)")
    return tuple(parts)


def _inside(ranges, place):
    return any(
        low - MARGIN * (high - low) <= place <= high + MARGIN * (high - low) for low, high in ranges
    )


def _joined(ranges):
    """Ranges that overlap as one, ascending."""
    merged: list[list[float]] = []
    for low, high in sorted(ranges):
        if merged and low <= merged[-1][1]:
            merged[-1][1] = max(merged[-1][1], high)
        else:
            merged.append([low, high])
    return merged
