"""Follow many starts of a driven device until they reach a steady motion."""

import math
from collections.abc import Generator
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from harvester.base.arguments import Named
from harvester.base.errors import HarvesterError
from harvester.base.formatting import with_error
from harvester.base.serialising import LEFT_OUT
from harvester.engines.following import (
    PARTING_PERIODS,
    calls_of,
    exponent_of,
    follow,
    neighbours,
)
from harvester.engines.methods import Engine
from harvester.engines.task import Task, Wanted
from harvester.results.orbit import (
    CHARGING,
    DIVERGES,
    ESCAPES,
    NO_PERIOD,
    NOT_SETTLED,
    UNSTEADY,
    means_of_motion,
    orbit_name,
    share_error,
)
from harvester.scene.model import Scene
from harvester.scene.prepared import Prepared
from harvester.scene.steps import step_error, susceptance
from harvester.statistics.attractors import (
    CONVERGED,
    NEARLY_CONVERGED,
    QUANTITIES,
    Divergence,
    groups_of,
    means_of,
    repetition,
    transients,
)
from harvester.statistics.estimate import Estimate
from harvester.statistics.stroboscope import COLUMNS, STATE
from harvester.statistics.transient import memory_of, transient_time
from harvester.statistics.units import unit_of

# Samples are taken after the slowest transient has decayed to this share.
SETTLED_SHARE = 1e-6
# Default limits of the number of periods for which a start is followed.
FEWEST_PERIODS, MOST_PERIODS = 100, 2000
# Maximum number of periods for a user: their excitation samples need some hundred megabytes.
MOST_PERIODS_ASKED = 100_000
# Number of samples at the end of each start, from which its period is determined.
SAMPLES = 64
# Starts without a period are followed for LONGER times the periods, since chaos may be transient.
# WITNESSES of an aperiodic motion's starts are followed LONGER times longer again, and all its
# starts if one becomes periodic. Then the best start of each cycle is followed until it converges,
# in at most ROUNDS rounds.
LONGER, WITNESSES, ROUNDS = 3, 16, 3


@dataclass(frozen=True)
class Orbit:
    """One outcome of a driven device's starts, in the scene's units: a steady motion, or none.

    Attributes
    ----------
    name : A, B, … in the order of the shares; for an unsteady motion its `kind`.
    kind : "period 3" or "chaotic", or for an unsteady motion one of `UNSTEADY`.
    period
        Period of the motion in forcing periods; None for an aperiodic motion.
    lyapunov
        Largest Lyapunov exponent (1/s) of an aperiodic motion.
    starts
        Number of starts that reached the motion.
    share, share_error : float
        Share of all starts, and its standard error, as if they were a random sample of the plane.
    mean_power, rms_voltage, rms_displacement : float
        Means over whole cycles of the start that converged best; for a chaotic motion, over the
        samples of all its starts; NaN without a steady motion.
    errors : dict of str to float
        Errors of these means: the step error, and the remaining transient or, for a chaotic motion,
        the standard error; NaN if there are too few samples.
    points : ndarray, shape (n, 2)
        Stroboscopic section: displacement and velocity at the starts of forcing periods.
    units : dict of str to str
        Units of the means, for printing.
    """

    name: str
    kind: str
    period: int | None
    lyapunov: Divergence | None
    starts: int
    share: float
    share_error: float
    mean_power: float
    rms_voltage: float
    rms_displacement: float
    errors: dict[str, float]
    points: np.ndarray = field(repr=False)
    units: dict[str, str] = field(default_factory=dict, repr=False, metadata=LEFT_OUT)

    @property
    def quantities(self) -> Named:
        """The means as estimates with their errors; empty without a steady motion."""
        means = {
            name: Estimate(
                getattr(self, name), self.errors[name], None, dimension, unit=self.units[dimension]
            )
            for name, dimension in QUANTITIES.items()
            if self.steady and self.units
        }
        return means_of_motion(self.name, means)

    @property
    def steady(self) -> bool:
        """Whether it is a steady motion, which has a mean power."""
        return self.kind not in UNSTEADY

    def text(self, name: str, unit: str) -> str:
        """One of `QUANTITIES` with its error, as text."""
        return with_error(Estimate(getattr(self, name), self.errors[name], None, unit), unit)


def periods_of(driven: Prepared) -> int:
    """Number of forcing periods after which the initial state of device and load is negligible."""
    transient = transient_time(driven, SETTLED_SHARE)
    periods = transient / float(driven.scene.excitation.period or 1.0)
    return int(min(max(periods, FEWEST_PERIODS), MOST_PERIODS)) + 1


def check_periods(periods: int | None, fewest: int) -> None:
    """Raise if the number of periods is too small, or too large for the memory."""
    if periods is not None and not fewest <= periods <= MOST_PERIODS_ASKED:
        raise HarvesterError(
            f"--periods {periods}: must be a whole number in [{fewest}, {MOST_PERIODS_ASKED}]"
        )


def following(
    driven: Prepared, engine: Engine, version: str, starts: np.ndarray, periods: int | None
) -> Generator[Wanted, list, Any]:
    """Generator for `Runner.follow`: follow all starts until they reach a steady motion.

    `periods` None: as many as the device needs, and at least `LONGER` times as many for aperiodic
    starts.

    Returns
    -------
    ndarray, shape (starts, SAMPLES + 1, columns)
        NaN for starts that were not followed because time ran out.
    """
    first = _first_periods(driven, periods)
    sample_count = min(SAMPLES, first - 1)
    samples = yield from _pieces(driven.scene, engine, version, starts, first, sample_count)
    if periods is not None or np.isnan(samples).any():
        return samples
    plan = _Onwards(driven.scene, engine, version, starts, samples, first)
    yield from plan.follow(_aperiodic(samples), 1, LONGER)
    for group in _groups(samples):
        if group.period is None:
            witnesses = group.members[:: math.ceil(group.members.size / WITNESSES)]
            yield from plan.follow(witnesses, LONGER, LONGER**2)
            if _aperiodic(samples[witnesses]).size < witnesses.size:
                remaining = np.setdiff1d(group.members, witnesses)
                yield from plan.follow(remaining, LONGER, LONGER**2)
    return samples


def _first_periods(driven, periods):
    return periods or max(periods_of(driven), SAMPLES + 1)


def _aperiodic(samples):
    """Indices of the starts that stay in range and are aperiodic."""
    inside = np.isfinite(samples).all(axis=(1, 2))
    states = np.where(inside[:, None, None], samples[:, :, :STATE], 0.0)
    return np.flatnonzero(inside & (repetition(states) == 0))


def _groups(samples):
    """Groups of the starts that were followed and stay in range."""
    (inside,) = np.nonzero(np.isfinite(samples).all(axis=(1, 2)))
    groups = groups_of(samples[inside][:, :, :STATE]) if inside.size else []
    return [replace(group, members=inside[group.members]) for group in groups]


class _Onwards(NamedTuple):
    """Starts that are followed further; their last samples are updated in place."""

    scene: Scene
    engine: Engine
    version: str
    starts: np.ndarray
    samples: np.ndarray
    periods: int

    def follow(self, indices, done, total):
        """Follow some starts from `done` to `total` times the periods."""
        if not len(indices):
            return
        # With a resistor the samples contain the full state, so runs continue from them. A
        # netlist's capacitors and inductors have further states, so runs restart.
        if self.scene.load.is_resistor:
            begin, times = self.samples[indices, -1, :STATE], total - done
        else:
            begin, times = self.starts[indices], total
        later = yield from _pieces(
            self.scene, self.engine, self.version, begin, times * self.periods,
            self.samples.shape[1] - 1,
        )  # fmt: skip
        self.samples[indices] = np.where(np.isnan(later), self.samples[indices], later)


def _pieces(scene, engine, version, starts, periods, sample_count):
    """Yield tasks of several starts each, and return the samples of all starts."""
    calls = calls_of(scene, engine, starts, periods, sample_count)
    label = f"{engine.name} {periods}"
    answers = yield Wanted(
        [
            Task(follow, {"scene": scene, **call}, version, label, len(call["starts"]))
            for call in calls
        ]
    )
    pieces = []
    for answer, call in zip(answers, calls, strict=True):
        if isinstance(answer, HarvesterError):
            raise answer
        missing = np.full((len(call["starts"]), sample_count + 1, len(COLUMNS)), np.nan)
        pieces.append(missing if answer is None else answer)
    return np.concatenate(pieces)


def orbits_of(
    driven: Prepared, engine: Engine, version: str, starts: np.ndarray, periods: int | None
) -> Generator[Wanted, list, tuple[list[Orbit], np.ndarray]]:
    """Generator for `Runner.follow`: the orbits that the starts reach.

    Returns the orbits with their powers, followed by the kinds of the other starts, and the index
    in this list for each start (−1: not followed).
    """
    samples = yield from following(driven, engine, version, starts, periods)
    groups = _groups(samples)
    motions = yield from _cycles(driven, engine, version, starts, samples, groups, periods)
    unsettled, scene = _unsettled(driven), driven.scene
    for group in groups:
        if group.period is None:
            near, scale = neighbours(scene, samples, starts, group.members)
            parting = yield from _pieces(
                scene, engine, version, near, PARTING_PERIODS + 1, PARTING_PERIODS
            )
            exponent = exponent_of(scene, parting, scale)
            if exponent is not None and exponent.chaotic and unsettled != CHARGING:
                motions.append((group.members, samples[group.members], group.points, exponent))
    motions.sort(key=lambda motion: (-motion[0].size, motion[0].min()))
    which, orbits = np.full(len(starts), -1), []
    followed, ended = ~np.isnan(samples).any(axis=(1, 2)), np.isinf(samples).any(axis=(1, 2))
    escaped, diverged = ended & (samples[:, -1, 0] > 0.0), ended & (samples[:, -1, 0] < 0.0)
    count, steps = int(followed.sum()), step_error(driven, engine.step, engine.name)
    seconds, memory = float(scene.excitation.period or 1.0), memory_of(driven)
    units = np.array([driven.scales.of(dimension) for dimension in QUANTITIES.values()])
    size = np.array([driven.scales.of("displacement"), driven.scales.of("velocity")])
    for number, (members, orbit_samples, points, exponent) in enumerate(motions):
        which[members] = number
        period = None if exponent else len(points)
        kind = f"period {period}" if period else "chaotic"
        values = means_of(orbit_samples, seconds, steps, memory, susceptance(driven)) * units
        section = points[:, :2] * size
        name = orbit_name(number)
        shown = values, section, period, exponent
        orbits.append(_orbit(driven, name, kind, members.size, count, *shown))
    for kind, is_member in (
        (unsettled, followed & ~ended & (which < 0)),
        (ESCAPES, escaped),
        (DIVERGES, diverged),
    ):
        if is_member.any():
            which[is_member] = len(orbits)
            orbits.append(_orbit(driven, kind, kind, int(is_member.sum()), count))
    return orbits, which


def _cycles(driven, engine, version, starts, samples, groups, periods):
    """Periodic motions: the members of each, its best start's samples and its section.

    The best start of each group is followed until it converges. Groups whose best starts reach the
    same cycle are merged.
    """
    members = [group.members for group in groups if group.period]
    best = np.array(
        [indices[np.argmin(_remains(driven, samples[indices]))] for indices in members], dtype=int
    )
    first = _first_periods(driven, periods)
    plan = _Onwards(driven.scene, engine, version, starts[best], samples[best], first)
    for k in range(1, ROUNDS) if periods is None else ():
        again = np.flatnonzero(_remains(driven, plan.samples) > CONVERGED)
        yield from plan.follow(again, LONGER**k, LONGER ** (k + 1))
    remains, motions = _remains(driven, plan.samples), []
    (settled,) = np.nonzero(remains <= NEARLY_CONVERGED)
    for group in groups_of(plan.samples[settled][:, :, :STATE]) if settled.size else []:
        same = settled[group.members]
        best_samples = plan.samples[same[[np.argmin(remains[same])]]]
        period = motion_of(driven, best_samples[0])[0]
        together = np.concatenate([members[k] for k in same])
        motions.append((together, best_samples, best_samples[0, -period:], None))
    return motions


def _remains(driven, samples):
    """Remaining transient of each start, see `transients`."""
    return transients(samples[:, :, :STATE], memory_of(driven))[2]


def _unsettled(driven):
    """Reason why starts have not converged, e.g. a store that is slower than the simulated time."""
    load, period = driven.scene.load.circuit, float(driven.scene.excitation.period)
    stores = load and load.stores
    periods = transient_time(driven, SETTLED_SHARE) / period
    return CHARGING if stores and periods > MOST_PERIODS else NOT_SETTLED


def motion_of(driven: Prepared, samples: np.ndarray) -> tuple[int, str]:
    """Period and kind of the motion of one start, from its samples, shape (samples, columns)."""
    if np.isinf(samples).any():
        return 0, ESCAPES if samples[-1, 0] > 0.0 else DIVERGES
    if np.isnan(samples).any():
        return 0, NOT_SETTLED
    memory = memory_of(driven)
    (period,), _, (remains,) = transients(samples[None, :, :STATE], memory)
    if period and remains <= NEARLY_CONVERGED:
        return int(period), f"period {period}"
    unsettled = _unsettled(driven)
    return 0, unsettled if period or unsettled == CHARGING else NO_PERIOD


def _orbit(driven, name, kind, starts, count, values=None, points=None, period=None, exponent=None):
    """An outcome of some starts; without values, an unsteady motion."""
    values = np.full((2, len(QUANTITIES)), math.nan) if values is None else values
    means, errors = (dict(zip(QUANTITIES, map(float, row), strict=True)) for row in values)
    points = np.empty((0, 2)) if points is None else points
    units = {dimension: unit_of(driven.scene, dimension) for dimension in QUANTITIES.values()}
    share = starts / count, share_error(starts, count)
    return Orbit(
        name, kind, period, exponent, starts, *share, **means, errors=errors, points=points,
        units=units,
    )  # fmt: skip
