"""Compares an engine's path with a fine one on the same noise, before paths diverge.

Two motions on the same noise diverge in time: a contact or the passage of a saddle amplifies a
small difference. A second fine path from a slightly different start, and the engine at half its
step, show when. Until then the engine's limit for short steps, extrapolated from both steps, must
equal the fine path: this reveals a wrong equation far below the step error. The step error is the
difference of the mean squares at the requested step.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from harvester.device import spring as springs
from harvester.device import timescales
from harvester.device.piezo import Piezo, PiezoTable
from harvester.device.record import Record
from harvester.device.system import elastic_force
from harvester.engines import side_by_side
from harvester.engines.codec import register
from harvester.engines.methods import MonteCarlo
from harvester.engines.realization import Realization, run, start_state
from harvester.scene.model import Scene
from harvester.scene.prepared import Prepared
from harvester.scene.steps import knot_spacing, steps_per_sample
from harvester.validation import STATES
from harvester.validation.paths import (
    from_rest,
    ignore,
    longest_step,
    noise_at_knots,
    recorded,
    states_at_knots,
)

# Number of the circuit's steps along all paths together, if no contact shortens them.
PATH_STEPS = 20_000
# Largest and smallest number of paths.
MOST_PATHS, FEWEST_PATHS = 8, 2
# Shortest and longest path, in periods of small oscillations.
FEWEST_PERIODS = 3.0
MOST_PERIODS = 30.0
# Number of steps from rest to a typical state.
SETTLING_STEPS = 200_000
# Divisor of the step in the second comparison, which distinguishes a wrong model from a long step.
FINER = 2
# Change of the initial velocity of a second fine path, as a share of the rms velocity.
DISPLACED = 1e-4
# Paths are compared until the distance of the two fine ones has grown by this factor.
LARGEST_GROWTH = 5.0
# Largest difference, as a share of the rms, of the paths at the step and half the step for an
# extrapolation.
LARGEST_STEP_ERROR = 0.05
# Deviations are computed for X and V. X' changes its sign in a contact, so that close paths may
# differ strongly at a knot.
SMOOTH = (0, 2)
# An engine's paths are extrapolated to a step of 0. A deviation from the fine paths below this
# share of the rms is ignored.
LEAST_DEVIATION = 3e-3
# The same limit if contacts shorten the steps: a step that grazes a contact reduces the order that
# the extrapolation assumes.
LEAST_OF_STIFF_CONTACTS = 1e-2
# Share of the step error that may remain after extrapolation.
LEFT_OF_STEP_ERROR = 0.25

# Steps of the replay integrator per engine step, without and with stoppers. The integrator does not
# shorten them in a contact.
REPLAY_STEPS, REPLAY_STEPS_IN_CONTACT = 2, 8


@register
@dataclass(frozen=True)
class PathDeviation:
    """Deviation of an engine's paths from fine ones while they are comparable.

    Attributes
    ----------
    reference : str
        Engine of the fine paths.
    of_limit : float
        Relative rms deviation of the limit for short steps, of X or V, whichever is larger; nan if
        paths are not comparable.
    of_mechanics : float
        Deviation of X from the mass driven by the recorded voltage (`replayed`), if the circuit is
        its own reference; else nan.
    resolution : float
        Largest size of both deviations for an engine that solves the same equations.
    of_mean_squares : float
        Largest relative deviation of the mean squares of X' and V at the requested step.
    compared_periods, comparable_periods : float
        Mean compared length in periods of small oscillations, and the comparable length of the fine
        paths alone.
    compared_time : float
        `compared_periods` in s.
    paths : int
    """

    reference: str
    of_limit: float
    of_mechanics: float
    resolution: float
    of_mean_squares: float
    compared_periods: float
    comparable_periods: float
    compared_time: float
    paths: int


def path_deviation(
    model: Prepared, engine: str, step: str | float
) -> tuple[PathDeviation, list[Realization]]:
    """Compare an engine's paths with fine ones; also its realizations at the step asked for.

    Called in a worker process; only the seed of the scene's run is used.
    """
    model = path_scene(model)
    reference = reference_engine(model.scene)
    fine = states_at_knots(model, _paths(model, reference, "fine"))
    # RMS of each state over paths and knots; 1 if it is 0.
    sizes = np.sqrt(np.mean(np.square(fine - fine[:, :1] * (1.0, 0.0, 0.0)), axis=(0, 1)))
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    comparable = _comparable(model, reference, fine, sizes)
    finer = longest_step(model, step, engine) / FINER
    runs = _paths(model, engine, step), _paths(model, engine, finer)
    at_step, at_finer = (states_at_knots(model, realizations) for realizations in runs)
    step_errors = (at_step - at_finer) / sizes
    compared = comparable & _close(step_errors, LARGEST_STEP_ERROR)
    times = [
        knot_spacing(model) * float(knots.sum(axis=1).mean()) for knots in (compared, comparable)
    ]
    stiff = side_by_side.contacts_shorten_steps(model, step)
    least = LEAST_OF_STIFF_CONTACTS if stiff else LEAST_DEVIATION
    deviation = PathDeviation(
        reference=reference,
        of_limit=_largest((_limit(at_step, at_finer) - fine) / sizes, compared),
        of_mechanics=_of_mechanics(model, runs, (at_step, at_finer), compared),
        resolution=max(least, LEFT_OF_STEP_ERROR * _largest(step_errors, compared)),
        of_mean_squares=_mean_squares(at_step, fine, compared),
        compared_periods=times[0] / _period(model),
        comparable_periods=times[1] / _period(model),
        compared_time=times[0],
        paths=len(fine),
    )
    return deviation, runs[0]


def _limit(at_step, at_finer):
    """Second-order extrapolation to short steps."""
    return at_finer + (at_finer - at_step) / (FINER**2 - 1.0)


def _of_mechanics(model, runs, states, compared):
    """Deviation of X from the replayed mass in the limit of short steps; nan if not needed."""
    system = model.system
    holds_speeds = any(getattr(contact.law, "holds", 0.0) for contact in system.contacts)
    # State and voltage determine the forces on the mass.
    replayable = isinstance(system.transducer, Piezo) and not holds_speeds
    if reference_engine(model.scene) != "circuit" or not replayable or not compared.any():
        return np.nan
    differences = [
        path_states[..., 0] - replayed(model, [realization.waveform for realization in ours])
        for ours, path_states in zip(runs, states, strict=True)
    ]
    size = np.sqrt(np.mean(np.square(states[1][..., 0] - states[1][:, :1, 0])))
    return float(np.sqrt(np.mean(np.square(_limit(*differences)[compared]))) / size)


def path_scene(model: Prepared) -> Prepared:
    """The prepared scene for the comparison, from a typical state."""
    spacing, period = knot_spacing(model), _period(model)
    step = spacing / steps_per_sample(model)
    periods = PATH_STEPS * step / (MOST_PATHS * period)
    length = min(max(periods, FEWEST_PERIODS), MOST_PERIODS) * period
    paths = min(max(int(PATH_STEPS * step / length), FEWEST_PATHS), MOST_PATHS)
    brief = from_rest(model, max(round(length / spacing), 1), paths)
    return brief.replace(_typical_start(model))


def reference_engine(scene: Scene) -> str:
    """Monte Carlo, whose scheme is of higher order; the circuit if only it supports the load."""
    return "monte-carlo" if scene.load.is_resistor else "circuit"


def _period(model):
    """Period of small oscillations (s)."""
    return 2.0 * np.pi / timescales.angular_frequency(model.system)


def _typical_start(model):
    """A state of Monte Carlo after many steps, out of contact, as keys of the scene."""
    scene = model.scene
    if scene.start or reference_engine(scene) != "monte-carlo":
        return {}
    settling = from_rest(model, max(round(SETTLING_STEPS / steps_per_sample(model)), 1), 1)
    stop = settling.scene.run.duration
    window = (stop - _period(model), 2.0 * stop)
    [settled] = run(settling, MonteCarlo(), [0], window, ignore)
    system, scales = model.system, model.scales
    last: Any = settled.waveform
    low, high = timescales.free_zone(system)
    # A mass pressed against a stopper is never free: use the last point.
    free = np.flatnonzero((last.displacement > low) & (last.displacement < high))
    last_free = free[-1] if free.size else -1
    # A scene cannot set the initial current of a coil with inductance.
    names = STATES if isinstance(scene.transducer, PiezoTable) else STATES[:2]
    units = (scales.displacement, scales.displacement, scales.voltage)
    return {
        f"start.{name}": float(getattr(last, name)[last_free] * unit)
        for name, unit in zip(names, units, strict=False)
    }


def _paths(model, engine, step):
    count = model.scene.run.realizations
    shared = engine == "circuit" and side_by_side.share_steps(model, step)
    together = [range(count)] if shared else [[index] for index in range(count)]
    return [path for some in together for path in recorded(model, engine, some, step)]


def _comparable(model, engine, fine, sizes):
    """Knots before a small initial difference has grown by `LARGEST_GROWTH`: bool (paths,
    knots)."""
    shift = DISPLACED * sizes[STATES.index("velocity")]
    start = model.scene.start.velocity if model.scene.start else 0.0
    moved = {"start.velocity": start + shift * model.scales.displacement}
    other = states_at_knots(model, _paths(model.replace(moved), engine, "fine"))
    return _close((other - fine) / sizes, LARGEST_GROWTH * DISPLACED)


def _close(shares, largest):
    """Whether X and V of each path, up to each knot, differ by at most this share of the rms."""
    shares = np.abs(shares[..., SMOOTH]).max(axis=2)
    return np.maximum.accumulate(shares, axis=1) <= largest


def _largest(shares, compared):
    """RMS deviation over the compared knots, of X or V, whichever is larger."""
    inside = shares[compared][:, SMOOTH]
    return float(np.sqrt(np.mean(np.square(inside), axis=0)).max()) if inside.size else np.nan


def _mean_squares(paths, fine, compared):
    """Largest relative deviation of the mean squares of X' and V over the compared knots."""
    if not compared.any():
        return np.nan
    ours, theirs = (np.mean(np.square(states[compared][:, 1:]), axis=0) for states in (paths, fine))
    return float(np.abs(ours / np.where(theirs > 0.0, theirs, 1.0) - 1.0)[theirs > 0.0].max())


def replayed(model: Prepared, waveforms: Sequence[Record]) -> np.ndarray:
    """Displacements at the knots under recorded terminal voltages, shape (realizations, knots).

    Runge–Kutta of fourth order; `waveforms` belong to the realizations 0, 1, … from their
    beginning.
    """
    system = model.system
    spacing, count = knot_spacing(model), len(waveforms)
    noise = [noise_at_knots(model, index) for index in range(count)]
    knots = noise[0].size - 1
    finer = REPLAY_STEPS_IN_CONTACT if system.contacts else REPLAY_STEPS
    steps = finer * steps_per_sample(model, "default")
    times = np.linspace(0.0, knots * spacing, 2 * steps * knots + 1)
    starts = np.array([start_state(model, index) for index in range(count)])
    drive = np.array([np.interp(times, times[:: 2 * steps], path) for path in noise]).T
    # The mean voltage over a step is used, since a switching load discharges the piezo within a
    # step.
    voltage = [_means(w, start[2], times[::2]) for w, start in zip(waveforms, starts, strict=True)]
    push = system.transducer.coupling * np.array(voltage).T
    x, v = starts[:, 0], starts[:, 1]
    places = np.empty((count, knots))
    for step in range(steps * knots):
        a, b, c = drive[2 * step : 2 * step + 3] - push[step]
        x, v = _runge_kutta(system, x, v, a, b, c, spacing / steps)
        if (step + 1) % steps == 0:
            places[:, (step + 1) // steps - 1] = x
    return places


def _means(waveform, first, ends):
    """Means of a recorded voltage between these times; `first` is the initial voltage."""
    recorded_times = np.append(0.0, waveform.time)
    times = np.union1d(recorded_times, ends)
    values = np.interp(times, recorded_times, np.append(first, waveform.voltage))
    gained = cumulative_trapezoid(values, times, initial=0.0)
    return np.diff(gained[np.searchsorted(times, ends)]) / np.diff(ends)


def _runge_kutta(system, x, v, first, middle, last, h):
    """One step with a drive given at its beginning, middle and end."""
    half = 0.5 * h
    a1 = first - _resistance(system, x, v)
    v2 = v + half * a1
    a2 = middle - _resistance(system, x + half * v, v2)
    v3 = v + half * a2
    a3 = middle - _resistance(system, x + half * v2, v3)
    v4 = v + h * a3
    a4 = last - _resistance(system, x + h * v3, v4)
    x = x + h / 6.0 * (v + 2.0 * (v2 + v3) + v4)
    return x, v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)


def _resistance(system, x, v):
    """Force of spring, damper and contacts against the drive; arrays of one shape."""
    force = elastic_force(system, x) + system.damper.force(v)
    for contact in system.contacts:
        side = np.sign(x) if contact.side == 0.0 else contact.side
        depth = np.maximum(side * x - contact.gap, 0.0)
        if depth.any():
            gain = springs.energy(system.spring, x) - springs.energy(
                system.spring, side * contact.gap
            )
            force = force + np.where(depth > 0.0, contact.law.damping(depth, v, gain, 0.0), 0.0) * v
    return force
