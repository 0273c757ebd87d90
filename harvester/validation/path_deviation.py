"""The path of an engine against a fine one on the same noise, for as long as paths can be compared.

Two motions on the same noise diverge in time: a contact or the passage of a saddle amplifies a
small difference. A second fine path from a slightly different start shows when, and so does the
engine itself at half its step. Up to there the engine's limit for short steps, extrapolated from
the two, has to be the fine path: a wrong equation shows there far below what the step itself costs.
What the step costs is the difference of the mean squares at the step asked for.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from harvester.device import timescales
from harvester.device.piezo import Piezo, PiezoTable
from harvester.engines import side_by_side
from harvester.engines.codec import register
from harvester.engines.methods import MonteCarlo
from harvester.engines.realization import Realization, run
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing, steps_per_sample
from harvester.validation import STATES
from harvester.validation.paths import from_rest, ignore, recorded, states_at_knots
from harvester.validation.replay import replayed

# The circuit takes this many steps along all paths together, if no contact shortens them.
PATH_STEPS = 20_000
# Largest and smallest number of paths.
MOST_PATHS, FEWEST_PATHS = 8, 2
# Shortest and longest path, in periods of small oscillations.
FEWEST_PERIODS = 3.0
MOST_PERIODS = 30.0
# A mass takes so many steps from rest to a typical state.
SETTLING_STEPS = 200_000
# The step is divided by this for the second comparison, which distinguishes a wrong model from a
# long step.
FINER = 2
# A second fine path begins with a velocity that differs by this share of the rms velocity.
DISPLACED = 1e-4
# Paths are compared while the two fine ones are at most this many times as far apart as at first.
LARGEST_GROWTH = 5.0
# The order of the step is relied on if the paths at the step and at half of it differ by at most
# this share of the rms.
LARGEST_STEP_ERROR = 0.05
# Deviations are taken of X and V. X' changes its sign in a contact, so that close paths may differ
# much at a knot.
SMOOTH = (0, 2)
# An engine's paths are extrapolated to a step of 0. If they then deviate from the fine paths by
# less than this share of the rms, the deviation does not count.
LEAST_DEVIATION = 3e-3
# The same limit where contacts shorten the steps: a step that grazes a contact spoils the order on
# which the extrapolation relies.
LEAST_OF_STIFF_CONTACTS = 1e-2
# Extrapolation may leave this share of the step's error.
LEFT_OF_STEP_ERROR = 0.25


@register
@dataclass(frozen=True)
class PathDeviation:
    """How far an engine's paths lie from fine ones over the stretch in which they are comparable.

    Attributes
    ----------
    reference : str
        Engine of the fine paths.
    of_limit : float
        Root mean square deviation of the limit for short steps, as a share of the state's rms,
        of X or V, whichever is larger; nan where no stretch can be compared.
    of_mechanics : float
        The same of X against the mass under the recorded voltage (`replay`), where the circuit is
        its own reference; nan elsewhere.
    resolution : float
        Size that both deviations may have in an engine that solves the same equations.
    of_mean_squares : float
        Largest deviation of the mean squares of X' and V at the step asked for, as a share.
    compared_periods, comparable_periods : float
        Mean length of the stretch in periods of small oscillations, and that of the fine paths
        alone, whatever the engine does.
    compared_time : float
        The former (s).
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
    scene: Scene, engine: str, step: str | float
) -> tuple[PathDeviation, list[Realization]]:
    """Compare an engine's paths with fine ones; also its realizations at the step asked for.

    In a worker process; of the scene's run only the seed counts.
    """
    brief = path_scene(scene)
    model = prepared(brief)
    reference = reference_engine(scene)
    fine = states_at_knots(brief, _paths(brief, reference, "fine"))
    # RMS of each state over paths and knots; 1 where it stays 0.
    sizes = np.sqrt(np.mean(np.square(fine - fine[:, :1] * (1.0, 0.0, 0.0)), axis=(0, 1)))
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    comparable = _comparable(brief, reference, fine, sizes)
    own_step = knot_spacing(model) / steps_per_sample(model, step, engine)
    runs = _paths(brief, engine, step), _paths(brief, engine, own_step / FINER)
    at_step, at_finer = (states_at_knots(brief, realizations) for realizations in runs)
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
        of_mechanics=_of_mechanics(brief, runs, (at_step, at_finer), compared),
        resolution=max(least, LEFT_OF_STEP_ERROR * _largest(step_errors, compared)),
        of_mean_squares=_mean_squares(at_step, fine, compared),
        compared_periods=times[0] / _period(brief),
        comparable_periods=times[1] / _period(brief),
        compared_time=times[0],
        paths=len(fine),
    )
    return deviation, runs[0]


def _limit(at_step, at_finer):
    """Extrapolation of second order to short steps."""
    return at_finer + (at_finer - at_step) / (FINER**2 - 1.0)


def _of_mechanics(scene, runs, states, compared):
    """Deviation of X from the replayed mass in the limit for short steps; nan where not needed."""
    system = prepared(scene).system
    holds_speeds = any(getattr(contact.law, "holds", 0.0) for contact in system.contacts)
    # State and voltage say what acts on the mass.
    replayable = isinstance(system.transducer, Piezo) and not holds_speeds
    if reference_engine(scene) != "circuit" or not replayable or not compared.any():
        return np.nan
    apart = [
        path_states[..., 0] - replayed(scene, [realization.waveform for realization in ours])
        for ours, path_states in zip(runs, states, strict=True)
    ]
    size = np.sqrt(np.mean(np.square(states[1][..., 0] - states[1][:, :1, 0])))
    return float(np.sqrt(np.mean(np.square(_limit(*apart)[compared]))) / size)


def path_scene(scene: Scene) -> Scene:
    """The scene for so many steps, from a typical state."""
    model = prepared(scene)
    spacing, period = knot_spacing(model), _period(scene)
    step = spacing / steps_per_sample(model)
    periods = PATH_STEPS * step / (MOST_PATHS * period)
    length = min(max(periods, FEWEST_PERIODS), MOST_PERIODS) * period
    paths = min(max(int(PATH_STEPS * step / length), FEWEST_PATHS), MOST_PATHS)
    brief = from_rest(scene, max(round(length / spacing), 1), paths)
    return brief.replace(_typical_start(scene))


def reference_engine(scene: Scene) -> str:
    """Monte Carlo, whose scheme is of higher order; the circuit where only it knows the load."""
    return "monte-carlo" if scene.load.is_resistor else "circuit"


def _period(scene):
    """Period of small oscillations (s)."""
    return 2.0 * np.pi / timescales.angular_frequency(prepared(scene).system)


def _typical_start(scene):
    """A state in which Monte Carlo is after many steps, in no contact, as keys of the scene."""
    if scene.start or reference_engine(scene) != "monte-carlo":
        return {}
    model = prepared(scene)
    settling = from_rest(scene, max(round(SETTLING_STEPS / steps_per_sample(model)), 1), 1)
    stop = settling.run.duration
    window = (stop - _period(scene), 2.0 * stop)
    [settled] = run(settling, MonteCarlo(), [0], window, ignore)
    system, scales = model.system, model.scales
    last: Any = settled.waveform
    low, high = timescales.free_zone(system)
    # A mass that is pressed against a stopper is never free: the last point is taken.
    free = np.flatnonzero((last.displacement > low) & (last.displacement < high))
    last_free = free[-1] if free.size else -1
    start = {
        "start.displacement": float(last.displacement[last_free] * scales.displacement),
        "start.velocity": float(last.velocity[last_free] * scales.displacement),
    }
    # A coil with inductance has a current, which no scene can start with.
    if isinstance(scene.transducer, PiezoTable):
        start["start.voltage"] = float(last.voltage[last_free] * scales.voltage)
    return start


def _paths(scene, engine, step):
    count = scene.run.realizations
    shared = engine == "circuit" and side_by_side.share_steps(prepared(scene), step)
    together = [range(count)] if shared else [[index] for index in range(count)]
    return [path for some in together for path in recorded(scene, engine, some, step)]


def _comparable(scene, engine, fine, sizes):
    """Knots before a small initial difference has grown by `LARGEST_GROWTH`: bool (paths,
    knots)."""
    shift = DISPLACED * sizes[STATES.index("velocity")]
    start = scene.start.velocity if scene.start else 0.0
    moved = scene.replace({"start.velocity": start + shift * prepared(scene).scales.displacement})
    other = states_at_knots(scene, _paths(moved, engine, "fine"))
    return _close((other - fine) / sizes, LARGEST_GROWTH * DISPLACED)


def _close(shares, largest):
    """Knots of each path before X or V differs by more than this share of its size."""
    shares = np.abs(shares[..., SMOOTH]).max(axis=2)
    return np.maximum.accumulate(shares, axis=1) <= largest


def _largest(shares, compared):
    """Root mean square over the compared knots of X or V, whichever is larger."""
    inside = shares[compared][:, SMOOTH]
    return float(np.sqrt(np.mean(np.square(inside), axis=0)).max()) if inside.size else np.nan


def _mean_squares(paths, fine, compared):
    """Largest deviation of the mean squares of X' and V over the compared knots, as a share."""
    if not compared.any():
        return np.nan
    ours, theirs = (np.mean(np.square(states[compared][:, 1:]), axis=0) for states in (paths, fine))
    return float(np.abs(ours / np.where(theirs > 0.0, theirs, 1.0) - 1.0)[theirs > 0.0].max())
