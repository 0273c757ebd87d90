"""Many starts of one driven device, followed to where they settle."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.errors import HarvesterError
from harvester.estimates.attractors import Divergence, groups_of, repetition
from harvester.prepared.prepared import prepared
from harvester.record.stroboscope import COLUMNS, STATE
from harvester.results.orbit import orbit_name, share_error, wandering_kind
from harvester.running.task import Task, Wanted
from harvester.simulation.following import (
    PARTING_PERIODS,
    calls_of,
    exponent_of,
    follow,
    neighbours,
)
from harvester.simulation.methods import Engine
from harvester.studies.transient import transient_time

if TYPE_CHECKING:
    from harvester.scene.model import Scene

# Samples are taken once the slowest transient has decayed to this share.
SETTLED_SHARE = 1e-6
# Fewest and most periods that a start is followed if none are asked for.
FEWEST_PERIODS, MOST_PERIODS = 100, 2000
# Most periods that a user may ask for: their samples of the excitation take some hundred megabytes.
MOST_PERIODS_ASKED = 100_000
# Number of samples at the end of each start, from which its period is determined.
SAMPLES = 64
# Starts without a period by then are followed for this many times the periods: chaos may be a
# transient.
LONGER = 3


@dataclass(frozen=True)
class Orbit:
    """One steady motion of a driven device, in the scene's units.

    Attributes
    ----------
    name : str
        A, B, … in the order of their shares.
    period : int or None
        Period of the motion in forcing periods; None if it does not repeat itself.
    lyapunov : Divergence or None
        For a motion without a period: its largest Lyapunov exponent (1/s).
    starts : int
        Number of starts that settled on it.
    share, share_error : float
        Share of all starts, and its standard error as that of a random sample of the plane.
    mean_power, rms_voltage, rms_displacement : float
        Over the samples of all its starts.
    points : ndarray, shape (n, 2)
        Stroboscopic section: displacement and velocity at the beginnings of forcing periods.
    """

    name: str
    period: int | None
    lyapunov: Divergence | None
    starts: int
    share: float
    share_error: float
    mean_power: float
    rms_voltage: float
    rms_displacement: float
    points: np.ndarray

    @property
    def kind(self) -> str:
        """Kind of motion in words: "period 3", "chaotic" or "not settled"."""
        if self.period is not None:
            return f"period {self.period}"
        return wandering_kind(self.lyapunov)


def periods_of(scene: Scene) -> int:
    """Forcing periods in which the device and its load forget where they began."""
    transient = transient_time(prepared(scene), SETTLED_SHARE)
    wanted = transient / float(scene.excitation.period or 1.0)
    return int(min(max(wanted, FEWEST_PERIODS), MOST_PERIODS)) + 1


def check_periods(periods: int | None, fewest: int) -> None:
    """Refuse what cannot be followed, or has no room in memory.

    Raises
    ------
    HarvesterError
    """
    if periods is not None and not fewest <= periods <= MOST_PERIODS_ASKED:
        raise HarvesterError(
            f"--periods {periods}: must be a whole number in [{fewest}, {MOST_PERIODS_ASKED}]"
        )


def following(
    scene: Scene,
    engine: Engine,
    version: str,
    starts: np.ndarray,
    periods: int | None,
) -> Generator[Wanted, list, Any]:
    """A plan for `Runner.follow`: all starts to where they settle.

    `periods` None: as many as the device needs, and `LONGER` times as many for those that have no
    period by then.

    Returns
    -------
    ndarray, shape (starts, SAMPLES + 1, columns)
        NaN for starts that time was too short for.
    """
    first = periods or max(periods_of(scene), SAMPLES + 1)
    kept = min(SAMPLES, first - 1)
    samples = yield from _pieces(scene, engine, version, starts, first, kept)
    if periods is not None or np.isnan(samples).any():
        return samples
    (again,) = np.nonzero(repetition(samples[:, :, :STATE]) == 0)
    if again.size:
        # With a resistor the samples hold the whole state, so runs continue from them; a netlist's
        # capacitors and inductors have states of their own, so runs restart.
        if scene.load.is_resistor:
            begin, lasting = samples[again, -1, :STATE], (LONGER - 1) * first
        else:
            begin, lasting = starts[again], LONGER * first
        later = yield from _pieces(scene, engine, version, begin, lasting, kept)
        samples[again] = np.where(np.isnan(later), samples[again], later)
    return samples


def _pieces(scene, engine, version, starts, periods, kept):
    """Samples of all starts, divided into tasks of several starts each."""
    calls = calls_of(scene, engine, starts, periods, kept)
    label = f"{engine.name} {periods}"
    answers = yield Wanted(
        [Task(follow, each, version, label, len(each["starts"])) for each in calls]
    )
    found = []
    for answer, call in zip(answers, calls, strict=True):
        if isinstance(answer, HarvesterError):
            raise answer
        missing = np.full((len(call["starts"]), kept + 1, len(COLUMNS)), np.nan)
        found.append(missing if answer is None else answer)
    return np.concatenate(found)


def orbits_of(
    scene: Scene,
    engine: Engine,
    version: str,
    starts: np.ndarray,
    periods: int | None,
) -> Generator[Wanted, list, tuple[list[Orbit], np.ndarray]]:
    """A plan for `Runner.follow`: the orbits that starts settle on, and each start's orbit
    number (−1: not followed)."""
    samples = yield from following(scene, engine, version, starts, periods)
    which = np.full(len(starts), -1)
    (done,) = np.nonzero(~np.isnan(samples).any(axis=(1, 2)))
    found = []
    for number, group in enumerate(groups_of(samples[done][:, :, :STATE]) if done.size else []):
        members = done[group.members]
        which[members] = number
        exponent = None
        if group.period is None:
            near, scale = neighbours(scene, samples, starts, members)
            parting = yield from _pieces(
                scene, engine, version, near, PARTING_PERIODS + 1, PARTING_PERIODS
            )
            exponent = exponent_of(scene, parting, scale)
        found.append(_orbit(scene, number, group, samples[members], exponent, done.size))
    return found, which


def _orbit(scene, number, group, samples, exponent, count):
    """An orbit in the scene's units."""
    scales = prepared(scene).scales
    size, speed = scales.of("displacement"), scales.of("velocity")
    # Means are taken over whole periods of the motion.
    repeated = group.period or 1
    whole = (samples.shape[1] - 1) // repeated * repeated
    lasting = whole * float(scene.excitation.period)
    means = (samples[:, -1, STATE:] - samples[:, -1 - whole, STATE:]).mean(axis=0) / lasting
    power, square_voltage, square_displacement = map(float, means)
    share = len(samples) / count
    return Orbit(
        name=orbit_name(number),
        period=group.period,
        lyapunov=exponent,
        starts=len(samples),
        share=share,
        share_error=share_error(len(samples), count),
        mean_power=power * scales.of("power"),
        rms_voltage=math.sqrt(square_voltage) * scales.of("voltage"),
        rms_displacement=math.sqrt(square_displacement) * size,
        points=group.points[:, :2] * np.array([size, speed]),
    )
