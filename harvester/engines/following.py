"""Integrates many initial states of one driven device over some periods of its excitation."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.errors import HarvesterError, SimulationError, SolutionDiverged
from harvester.engines.methods import Engine, engine_of
from harvester.excitation.base import ExcitationPath
from harvester.scene.paths import noise_path
from harvester.scene.prepared import Prepared, prepared
from harvester.scene.steps import knot_spacing
from harvester.statistics.attractors import Divergence, divergence, sizes_of
from harvester.statistics.range_watch import leaves_range, with_range_watch
from harvester.statistics.stroboscope import STATE, Stroboscope

if TYPE_CHECKING:
    from harvester.device.record import Record
    from harvester.scene.model import Scene

# Seconds between two reports of a task.
REPORT_SECONDS = 0.25
# The excitation's knots are this many times finer than the scene's: between knots the sine is
# replaced by a straight line, whose error decides which well is reached from a start near a fractal
# basin boundary. Of 225 starts of a Duffing oscillator 88, 94, 95.6 and 96 % reached the same well
# as in scipy with 1, 2, 4 and 8 times the knots; four times the knots take 1.4 times as long.
FINER_KNOTS = 4
# Number of initial states in one task: for a resistor as load, for a netlist, and for the engine
# "circuit".
TOGETHER, TOGETHER_NETLIST, TOGETHER_CIRCUIT = 512, 64, 8
# Number of pairs of states for a Lyapunov exponent, and their initial distance as a share of the
# motion's size: a netlist's step control has larger errors, so its pairs start farther apart.
PAIRS, NEIGHBOURS, NEIGHBOURS_NETLIST = 16, 1e-8, 1e-5
# Forcing periods for which the pairs are followed.
PARTING_PERIODS = 150


class Replayed(ExcitationPath):
    """One excitation path for all initial states; its samples are `spacing` (s) apart."""

    def __init__(self, samples: np.ndarray, spacing: float) -> None:
        self.spacing = spacing
        self._samples, self._next = samples, 0

    def read(self, count: int) -> np.ndarray:
        """The next samples; beyond the end the last sample is repeated."""
        places = np.arange(self._next, self._next + count)
        self._next += count
        return self._samples[np.minimum(places, self._samples.size - 1)]


def forced(scene: Scene, command: str) -> Prepared:
    """Return the prepared scene with a whole number of knots per period, without given starts.

    Raises
    ------
    HarvesterError
        The excitation is not periodic or not deterministic.
    """
    excitation: Any = scene.excitation
    if excitation.period is None or excitation.random:
        raise HarvesterError(
            f'{scene.name}: excitation.kind = "{excitation.kind}": {command} needs a periodic '
            'deterministic excitation: set excitation.kind = "sine" (or a sum of sines whose '
            "frequencies have a common period)"
        )
    if excitation.prescribes_displacement:
        raise HarvesterError(
            f'{scene.name}: excitation.kind = "{excitation.kind}": a prescribed motion has no '
            f'initial transient: {command} needs excitation.kind = "sine"'
        )
    prepared_scene = prepared(scene)
    spacing = knot_spacing(_lasting(prepared_scene, excitation.period))
    knots = FINER_KNOTS * math.ceil(excitation.period / spacing - 1e-9)
    excitation = replace(excitation, knot_spacing=excitation.period / knots)
    return prepared_scene.replace(excitation=excitation, start=None)


def _lasting(prepared_scene, seconds):
    return prepared_scene.with_run(settle=0.0, duration=seconds, realizations=1, starts=None)


def follow(
    prepared_scene: Prepared,
    engine: str,
    step: str | float,
    starts: list,
    periods: int,
    kept: int,
    report: Callable[[float], object],
    settings: dict[str, Any] | None = None,
) -> np.ndarray:
    """Integrate initial states over some forcing periods, in a worker process.

    Parameters
    ----------
    prepared_scene : Prepared
        As returned by `forced`.
    engine, step, settings
        The engine's name, its step, and the options that differ from their defaults.
    starts : list of [float, float, float]
        X, X' and the transducer's state, scaled.
    periods, kept : int
        Forcing periods, and how many of the last ones are sampled.

    Returns
    -------
    ndarray, shape (starts, kept + 1, columns)
        Columns as in `harvester.statistics.stroboscope`; inf if a start leaves the range of the
        spring, −inf if it diverges.
    """
    period = float(prepared_scene.scene.excitation.period)  # type: ignore[arg-type]
    prepared_scene = _lasting(prepared_scene, periods * period)
    chosen = engine_of(engine, step=step, **settings or {})
    spacing = knot_spacing(prepared_scene)
    samples = noise_path(prepared_scene, 0).read(round(periods * period / spacing) + 2)
    chosen.prepare(prepared_scene)
    corrected = chosen.in_lockstep(prepared_scene.scene)

    def sampled(some, number):
        """Samples of some initial states; infinite if a state leaves the range or diverges."""
        times = (periods - kept) * period, period, kept + 1
        watching = [Stroboscope(*times, corrected) for _ in some]
        paths = [Replayed(samples, spacing) for _ in some]
        observers = with_range_watch(prepared_scene, [[strobe] for strobe in watching])
        observers[-1].append(_Reached(report, number, len(parts), periods * period))
        try:
            chosen.run_realizations(
                prepared_scene, paths, [tuple(start) for start in some], observers
            )
        except SimulationError as error:
            leaves = leaves_range(prepared_scene, error)
            if not (leaves or isinstance(error, SolutionDiverged)):
                raise
            if len(some) == 1:
                return [np.full_like(watching[0].samples, np.inf if leaves else -np.inf)]
            # One failing initial state ends its whole batch: bisection isolates that state.
            half = len(some) // 2
            return sampled(some[:half], number) + sampled(some[half:], number)
        return [strobe.samples for strobe in watching]

    # The engine "circuit" runs one initial state at a time: in one netlist all would share the time
    # steps.
    together = 1 if engine == "circuit" else len(starts)
    parts = [starts[first : first + together] for first in range(0, len(starts), together)]
    return np.array([row for number, part in enumerate(parts) for row in sampled(part, number)])


class _Reached:
    """Report the finished share of a task whose parts take equal times."""

    reads_points = False

    def __init__(self, report: Callable, part: int, parts: int, seconds: float) -> None:
        self._report, self._part, self._parts, self._seconds = report, part, parts, seconds
        self._next = 0.0

    def add(self, record: Record) -> None:
        """Report the progress of the record, if the last report is old enough."""
        now = time.monotonic()
        if now >= self._next and record.time.size:
            self._report((self._part + float(record.time[-1]) / self._seconds) / self._parts)
            self._next = now + REPORT_SECONDS


def _together(scene: Scene, engine: str) -> int:
    """Number of initial states in one task."""
    if engine == "circuit":
        return TOGETHER_CIRCUIT
    return TOGETHER if scene.load.is_resistor else TOGETHER_NETLIST


def calls_of(
    scene: Scene, engine: Engine, starts: np.ndarray, periods: int, kept: int
) -> list[dict[str, Any]]:
    """Arguments of `follow` except the scene, one dictionary per call."""
    size = _together(scene, engine.name)
    arguments = {**engine.as_arguments("engine"), "periods": periods, "kept": kept}
    return [
        {**arguments, "starts": starts[first : first + size].tolist()}
        for first in range(0, len(starts), size)
    ]


def neighbours(
    scene: Scene, samples: np.ndarray, starts: np.ndarray, members: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of nearby initial states on one motion, and the size of that motion.

    Parameters
    ----------
    samples : ndarray, shape (starts, samples, columns or STATE)
    starts : ndarray, shape (starts, STATE)
    members : ndarray of int
        Indices of the starts that reached the motion.

    Returns
    -------
    (ndarray, ndarray), shapes (2 · PAIRS, STATE) and (STATE,)
        The first starts of all pairs followed by the second ones; the size.
    """
    scale = sizes_of(samples[members, :, :STATE])
    # With a resistor the samples hold the whole state, so pairs start from the samples; a netlist's
    # capacitors and inductors have states too, so pairs start from the initial states.
    if scene.load.is_resistor:
        states = samples[members, :, :STATE].reshape(-1, STATE)
        begin = states[np.linspace(0, len(states) - 1, PAIRS).astype(int)]
        distance = NEIGHBOURS
    else:
        begin = starts[members[np.linspace(0, members.size - 1, PAIRS).astype(int)]]
        distance = NEIGHBOURS_NETLIST
    near = begin.copy()
    near[:, 0] += distance * scale[0]
    return np.concatenate([begin, near]), scale


def exponent_of(scene: Scene, followed: np.ndarray, scale: np.ndarray) -> Divergence | None:
    """Largest Lyapunov exponent from the pairs of `neighbours` after PARTING_PERIODS periods."""
    states = followed[:, :, :STATE]
    pairs = states.reshape(2, PAIRS, *states.shape[1:]).swapaxes(0, 1)
    if not np.isfinite(pairs).all():
        return None
    return divergence(pairs, scale, float(scene.excitation.period or 1.0))
