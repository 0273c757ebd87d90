"""Many starts of one driven device, followed to where they settle."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.errors import HarvesterError
from harvester.estimates.attractors import Divergence, divergence, groups_of, repetition, sizes_of
from harvester.excitation.base import ExcitationPath
from harvester.prepared.paths import noise_path
from harvester.prepared.prepared import prepared
from harvester.prepared.steps import knot_spacing
from harvester.record.range_watch import with_range_watch
from harvester.record.stroboscope import COLUMNS, STATE, Stroboscope
from harvester.results.orbit import orbit_name, share_error
from harvester.running.task import Task, Wanted
from harvester.simulation.methods import Engine, engine_of
from harvester.studies.transient import transient_time

if TYPE_CHECKING:
    from harvester.scene.model import Scene

# A transient falls to this share before the samples are looked at.
SETTLED_SHARE = 1e-6
# Periods followed where the device forgets its start sooner, and where that would take longer.
FEWEST_PERIODS, MOST_PERIODS = 100, 2000
# Samples at the end of each start, in which periods are looked for.
SAMPLES = 64
# How much longer those are followed that have no period by then: chaos may be a transient.
LONGER = 3
# Knots for each one that a scene has: between them a sine is a straight line, which decides for
# starts next to a fractal border. Of 225 starts of a Duffing oscillator 88, 94, 95.6 and 96 %
# came to the well that scipy found, with 1, 2, 4 and 8; four take 1.4 times as long as one.
FINER_KNOTS = 4
# Starts in one task of a resistor's engine, of a netlist's, and of the circuit.
TOGETHER, TOGETHER_NETLIST, TOGETHER_CIRCUIT = 512, 64, 8
# Pairs of neighbours that a Lyapunov exponent is taken from, and their distance at first, as a
# share of the motion's size: a netlist's steps follow its own error and leave more.
PAIRS, NEIGHBOURS, NEIGHBOURS_NETLIST = 16, 1e-8, 1e-5
# Periods for which they are followed.
PARTING_PERIODS = 150
NOT_SETTLED = "not settled"


class Replayed(ExcitationPath):
    """A path that was read once, for all starts.

    Parameters
    ----------
    samples : ndarray
    spacing : float
        s.
    """

    def __init__(self, samples: np.ndarray, spacing: float) -> None:
        self.spacing = spacing
        self._samples, self._next = samples, 0

    def read(self, count: int) -> np.ndarray:
        """The next samples; beyond the last one it repeats that."""
        places = np.arange(self._next, self._next + count)
        self._next += count
        return self._samples[np.minimum(places, self._samples.size - 1)]


@dataclass(frozen=True)
class Orbit:
    """One steady motion of a driven device, in the scene's units.

    Attributes
    ----------
    name : str
        A, B, … in the order of their shares.
    period : int or None
        In periods of the forcing; None for motion that does not repeat itself.
    lyapunov : Divergence or None
        Of a motion without a period: its largest Lyapunov exponent (1/s).
    starts : int
        That came to it.
    share, share_error : float
        Of all starts, and its standard error as that of a random sample of the plane.
    mean_power, rms_voltage, rms_displacement : float
        Over the samples of all its starts.
    points : ndarray, shape (n, 2)
        Its section: displacement and velocity at the beginnings of forcing periods.
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
        """In words: "period 3", "chaotic" or "not settled"."""
        if self.period is not None:
            return f"period {self.period}"
        if self.lyapunov is not None and self.lyapunov.chaotic:
            return "chaotic"
        return NOT_SETTLED


def forced(scene: Scene, command: str) -> Scene:
    """The scene with knots that divide its period, and no start of its own.

    Raises
    ------
    HarvesterError
        The excitation has no period, or chance in it.
    """
    excitation: Any = scene.excitation
    if excitation.period is None or excitation.random:
        raise HarvesterError(
            f'{scene.name}: excitation.kind = "{excitation.kind}": {command} needs a periodic '
            'excitation without chance: set excitation.kind = "sine" (or a sum of sines whose '
            "frequencies have a common period)"
        )
    if excitation.prescribes_displacement:
        raise HarvesterError(
            f'{scene.name}: excitation.kind = "{excitation.kind}": a prescribed motion has no '
            f'start to forget: {command} needs excitation.kind = "sine"'
        )
    ready = prepared(_lasting(scene, excitation.period))
    knots = FINER_KNOTS * math.ceil(excitation.period / knot_spacing(ready) - 1e-9)
    excitation = replace(excitation, knot_spacing=excitation.period / knots)
    return replace(scene, excitation=excitation, start=None)


def periods_of(scene: Scene) -> int:
    """Forcing periods in which the device and its load forget where they began."""
    transient = transient_time(prepared(scene), SETTLED_SHARE)
    wanted = transient / float(scene.excitation.period or 1.0)
    return int(min(max(wanted, FEWEST_PERIODS), MOST_PERIODS)) + 1


def _lasting(scene, seconds):
    run = replace(scene.run, settle=0.0, duration=seconds, realizations=1, starts=None)
    return replace(scene, run=run)


def follow(
    scene: Scene,
    engine: str,
    step: str | float,
    starts: list,
    periods: int,
    kept: int,
    report: Callable,
    settings: dict[str, Any] | None = None,
) -> np.ndarray:
    """Follow starts for some forcing periods, in a worker process.

    Parameters
    ----------
    scene : Scene
        As `forced` gives it.
    engine, step, settings
        The engine's name, its step, and what else of it is not as usual.
    starts : list of [float, float, float]
        X, X' and the transducer's state, scaled.
    periods, kept : int
        Forcing periods, and how many of the last ones are sampled.

    Returns
    -------
    ndarray, shape (starts, kept + 1, columns)
        With the columns of `harvester.record.stroboscope`.
    """
    period = float(scene.excitation.period)  # type: ignore[arg-type]
    lasting = _lasting(scene, periods * period)
    ready = prepared(lasting)
    chosen = engine_of(engine, step=step, **settings or {})
    spacing = knot_spacing(ready)
    samples = noise_path(ready, 0).read(round(periods * period / spacing) + 2)
    watching = [Stroboscope((periods - kept) * period, period, kept + 1) for _ in starts]
    chosen.prepare(ready)
    # One netlist of the circuit for each: side by side they would share their steps.
    together = 1 if engine == "circuit" else len(starts)
    for first in range(0, len(starts), together):
        some = slice(first, first + together)
        chosen.run_realizations(
            ready,
            [Replayed(samples, spacing) for _ in starts[some]],
            [tuple(each) for each in starts[some]],
            with_range_watch(ready, [[each] for each in watching[some]]),
        )
        report([])
    return np.array([each.samples for each in watching])


def together(scene: Scene, engine: str) -> int:
    """Starts in one task."""
    if engine == "circuit":
        return TOGETHER_CIRCUIT
    return TOGETHER if scene.load.is_resistor else TOGETHER_NETLIST


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
        # A resistor's device is where its sample is; the stores of a netlist begin anew.
        if scene.load.is_resistor:
            begin, lasting = samples[again, -1, :STATE], (LONGER - 1) * first
        else:
            begin, lasting = starts[again], LONGER * first
        later = yield from _pieces(scene, engine, version, begin, lasting, kept)
        samples[again] = np.where(np.isnan(later), samples[again], later)
    return samples


def _pieces(scene, engine, version, starts, periods, kept):
    """Samples of all starts, some in a task."""
    size = together(scene, engine.name)
    pieces = [starts[first : first + size] for first in range(0, len(starts), size)]
    label = f"{engine.name} {periods}"
    arguments = {"scene": scene, **engine.as_arguments("engine"), "periods": periods, "kept": kept}
    answers = yield Wanted(
        [
            Task(follow, {**arguments, "starts": each.tolist()}, version, label, len(each))
            for each in pieces
        ]
    )
    found = []
    for answer, piece in zip(answers, pieces, strict=True):
        if isinstance(answer, HarvesterError):
            raise answer
        missing = np.full((len(piece), kept + 1, len(COLUMNS)), np.nan)
        found.append(missing if answer is None else answer)
    return np.concatenate(found)


def exponents(
    scene: Scene,
    engine: Engine,
    version: str,
    samples: np.ndarray,
    starts: np.ndarray,
    members: np.ndarray,
) -> Generator[Wanted, list, Divergence | None]:
    """A plan: the largest Lyapunov exponent of the motion that these members are on."""
    states = samples[members, :, :STATE].reshape(-1, STATE)
    scale = sizes_of(samples[members, :, :STATE])
    resistor = scene.load.is_resistor
    if resistor:
        begin = states[np.linspace(0, len(states) - 1, PAIRS).astype(int)]
        apart = NEIGHBOURS
    else:
        begin = starts[members[np.linspace(0, members.size - 1, PAIRS).astype(int)]]
        apart = NEIGHBOURS_NETLIST
    near = begin.copy()
    near[:, 0] += apart * scale[0]
    kept = PARTING_PERIODS
    followed = yield from _pieces(
        scene, engine, version, np.concatenate([begin, near]), kept + 1, kept
    )
    pairs = followed[:, :, :STATE].reshape(2, PAIRS, kept + 1, STATE).swapaxes(0, 1)
    if np.isnan(pairs).any():
        return None
    return divergence(pairs, scale, float(scene.excitation.period or 1.0))


def orbits_of(
    scene: Scene,
    engine: Engine,
    version: str,
    starts: np.ndarray,
    periods: int | None,
) -> Generator[Wanted, list, tuple[list[Orbit], np.ndarray]]:
    """A plan: the orbits that starts come to, and to which each came (−1: not followed)."""
    samples = yield from following(scene, engine, version, starts, periods)
    which = np.full(len(starts), -1)
    (done,) = np.nonzero(~np.isnan(samples).any(axis=(1, 2)))
    found = []
    for number, group in enumerate(groups_of(samples[done][:, :, :STATE]) if done.size else []):
        members = done[group.members]
        which[members] = number
        exponent = None
        if group.period is None:
            exponent = yield from exponents(scene, engine, version, samples, starts, members)
        found.append(_orbit(scene, number, group, samples[members], exponent, done.size))
    return found, which


def _orbit(scene, number, group, samples, exponent, count):
    """An orbit in the scene's units."""
    scales = prepared(scene).scales
    size, speed = scales.of("displacement"), scales.of("velocity")
    # Over whole periods of the motion.
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
