"""The steady motions (attractors) of a deterministic device, from all initial states of one run.

`attractors` reports all of them, for `simulate`. A study prints one number per point: `followed`
returns the quantities of one orbit, and notes on the others.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from harvester.base.errors import SimulationError
from harvester.engines.following import (
    PARTING_PERIODS,
    calls_of,
    exponent_of,
    follow,
    forced,
    neighbours,
)
from harvester.results.orbit import ESCAPES, NOT_SETTLED, Attractor, orbit_name, share_error
from harvester.scene.paths import distinct_realizations, start_state
from harvester.scene.steps import step_error, susceptance
from harvester.statistics.attractors import (
    NEARLY_CONVERGED,
    QUANTITIES,
    Group,
    groups_of,
    means_of,
    synchronized_clusters,
    transients,
)
from harvester.statistics.estimate import Estimate
from harvester.statistics.run_estimates import run_estimates
from harvester.statistics.stroboscope import STATE, strobe_times
from harvester.statistics.transient import memory_of
from harvester.statistics.units import unit_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from harvester.base.worker_pool import Workers
    from harvester.engines.methods import Engine
    from harvester.engines.realization import Realization
    from harvester.scene.model import Scene
    from harvester.scene.prepared import Prepared
    from harvester.statistics.moments import Moments

# The Lyapunov exponent is computed for at most this many non-periodic motions: before a motion has
# settled, each start that leads to it may count as a separate motion.
MOST_EXPONENTS = 4
# A start contributes to the means of its motion if its first and last cycle differ by at most the
# first share; in a study, if no start does, by at most the second.
SETTLED, NEARLY_SETTLED = 1e-5, 1e-2
# Number of samples at the end of a run that distinguish motions, and the fewest that show a period.
# With fewer samples, two starts have the same motion if their final states coincide.
SAMPLES, FEWEST_SAMPLES = 64, 6
# Orbits whose powers differ by less than this share are reported as one, such as mirror images.
SAME_POWER = 1e-3
TRANSIENTS = (
    "no start follows this orbit from the beginning of the measured time on, so that its means "
    "contain transients: raise run.settle"
)
ORBITS = {"rest": "from rest", "best": "with the most power"}


def attractors(
    prepared_scene: Prepared,
    engine: Engine,
    realizations: dict[int, Realization],
    escaped: int,
    pool: Workers,
    time_limit: float,
) -> tuple[Attractor, ...]:
    """The motions on which a run's starts settled, the most frequent motion first.

    The last entries count starts without a motion: unsettled, escaped.

    Parameters
    ----------
    realizations : dict of int to Realization
        Realizations by their numbers, with stroboscopic samples.
    escaped : int
        Number of further starts, which left the range of the spring.
    pool : Workers
        Integrates nearby states on motions without a period.
    time_limit : float
        Wall-clock limit of one such integration (s).
    """
    moments = [realization.moments for realization in realizations.values()]
    samples = np.array([realization.stroboscope for realization in realizations.values()])
    starts = np.array([start_state(prepared_scene, number) for number in realizations])
    # A Lyapunov exponent costs as much as about fifty starts: only runs with run.starts compute it.
    left = MOST_EXPONENTS if prepared_scene.scene.run.starts else 0

    def exponent(states, members):
        nonlocal left
        left -= 1
        if left < 0:
            return None
        return _exponent(prepared_scene.scene, engine, states, starts, members, pool, time_limit)

    cost, count = step_error(prepared_scene, engine.step, engine.name), len(moments) + escaped
    groups = _motions(prepared_scene, moments, samples, cost, count, exponent)
    motions = [motion for *_, motion in groups]
    unsettled = len(moments) - sum(motion.starts for motion in motions)
    for name, number in ((NOT_SETTLED, unsettled), (ESCAPES, escaped)):
        if number:
            nothing = Group(None, np.zeros(number), np.empty((0, STATE)))
            motions.append(_attractor(prepared_scene, name, nothing, [], cost, count))
    return tuple(motions)


def _motions(prepared_scene, moments, samples, cost, count, exponent=None):
    """Motions of the starts, the most common first: (members, members in the means, Attractor).

    With `exponent`, a function of samples and members, motions that have not settled are left out.
    """
    reached = ~np.isnan(samples).any(axis=(0, 2))
    samples, length = samples[:, reached], strobe_times(prepared_scene)[2] - np.sum(~reached)
    last, states = samples[:, -SAMPLES:], samples[:, -SAMPLES:, :STATE]
    periodic = bool(prepared_scene.scene.excitation.period) and last.shape[1] >= FEWEST_SAMPLES
    if not last.shape[1]:
        groups = [Group(None, np.array([k]), state) for k, state in enumerate(states)]
    else:
        groups = groups_of(states) if periodic else synchronized_clusters(states)
    motions: list[tuple] = []
    for group in groups:
        cycle, members, divergence = {}, group.members, None
        if group.period is not None:
            remains = transients(states[members], memory_of(prepared_scene))[2]
            if remains.min() <= NEARLY_CONVERGED:
                cycle = _on_cycle(prepared_scene, last[members[[np.argmin(remains)]]], cost)
                moved = _moved(samples[members, :, :STATE], group.period, length)
                limit = SETTLED if (moved <= SETTLED).any() or exponent else NEARLY_SETTLED
                members = members[moved <= limit]
            elif exponent:
                continue
        elif exponent and periodic:
            divergence = exponent(states, members)
            if divergence is not None and not divergence.chaotic:
                continue
        averaged = members if exponent or members.size else group.members
        name, means = orbit_name(len(motions)), [moments[k] for k in averaged]
        motion = _attractor(
            prepared_scene, name, group, means, cost, count, periodic, cycle, divergence
        )
        motions.append((group.members, members, motion))
    return motions


class Followed(NamedTuple):
    """Results of the starts of a run, for studies.

    Attributes
    ----------
    prepared_scene
        The scene of the remaining realizations.
    moments
        Moments of the starts on the followed orbit; under noise, moments of all starts.
    orbits
        All orbits that starts reached, the followed one first; empty for a single start.
    notes : tuple of str
    """

    prepared_scene: Prepared
    moments: list[Moments]
    orbits: tuple[Attractor, ...]
    notes: tuple[str, ...]


def with_orbit(scene: Scene) -> Scene:
    """The scene with `run.orbit`, the orbit that a study follows; by default from rest."""
    if scene.excitation.random or scene.run.orbit:
        return scene
    return replace(scene, run=replace(scene.run, orbit="rest"))


def followed(prepared_scene: Prepared, good: Sequence[dict], cost: float) -> Followed:
    """Results on the orbit that `run.orbit` selects from the reached orbits; see `with_orbit`.

    `good` are answers of `harvester.engines.realizations.realizations`; `cost` is the largest
    relative step error of a mean power.
    """
    prepared_scene = replace(prepared_scene, scene=with_orbit(prepared_scene.scene))
    orbit = prepared_scene.scene.run.orbit
    moments = [realization for part in good for realization in part["moments"]]
    complete = prepared_scene.with_run(realizations=len(moments))
    samples = [part["stroboscope"] for part in good]
    if len(moments) == 1 or any(sample is None for sample in samples):
        notes = (*note_on_repeats(prepared_scene), *note_on_one_start(prepared_scene))
        return Followed(complete, moments, (), notes)
    motions = _motions(prepared_scene, moments, np.concatenate(samples), cost, len(moments))
    if orbit == "best":
        motions.sort(key=lambda motion: -_power(motion[-1]))
    elif orbit == "rest":
        motions.sort(key=lambda motion: motion[0][0])
    orbits = tuple(motion for *_, motion in motions)
    notes = (*note_on_repeats(prepared_scene), on_orbits(prepared_scene.scene, orbits))
    if orbit == "weighted":
        return Followed(complete, moments, orbits, notes)
    reaching, members, _ = motions[0]
    if not members.size:
        members, notes = reaching, (*notes, TRANSIENTS)
    alone = _alone(prepared_scene, len(members))
    return Followed(alone, [moments[k] for k in members], orbits, notes)


def note_on_repeats(prepared_scene: Prepared) -> tuple[str, ...]:
    """A note that realizations with identical results are run only once; empty under noise."""
    count, requested = distinct_realizations(prepared_scene), prepared_scene.scene.run.realizations
    if count == requested:
        return ()
    starts = "there is one" if count == 1 else f"there are {count}, one in each well"
    return (
        f"run.realizations = {requested}: the excitation is deterministic, so that realizations "
        f"differ by their starts alone, and {starts}: each is run once; run.starts = 100 draws "
        "random starts",
    )


def note_on_one_start(prepared_scene: Prepared) -> tuple[str, ...]:
    """A note that other starts may reach other motions; empty for noise or a linear device."""
    scene, system = prepared_scene.scene, prepared_scene.system
    linear = system.spring.straight and not system.contacts and scene.load.is_resistor
    if scene.excitation.random or scene.excitation.prescribes_displacement or linear:
        return ()
    return (
        "one start: a driven device that is not linear may have other motions with other "
        "powers: set run.starts = 100, or use harvester basins",
    )


def on_orbits(scene: Scene, orbits: Sequence[Attractor]) -> str:
    """A note: the orbit of the quantities, and power and share of the other orbits."""
    sentences = [orbit.sentence(unit_of(scene, "power")) for orbit in orbits]
    if scene.run.orbit == "weighted":
        return f"means over all starts: {', '.join(sentences)}"
    from_start = scene.start is not None and scene.run.orbit == "rest"
    words = "from [start]" if from_start else ORBITS[str(scene.run.orbit)]
    head, first = f"the orbit {words} is followed", orbits[0]
    starts = (
        "starts" if scene.run.starts else "starts at rest (run.starts = 100 draws random starts)"
    )
    if len(orbits) == 1:
        return f"{head}: all {starts} reach it"
    if all(math.isclose(_power(orbit), _power(first), rel_tol=SAME_POWER) for orbit in orbits):
        return f"{head}: other {starts} reach orbits of the same power"
    share = f"{first.kind}, {first.share:.1%} of the starts"
    return f"{head} ({share}): others reach {', '.join(sentences[1:])}"


def _power(motion):
    quantities = motion.quantities
    return quantities.get("mean_output_power", quantities["mean_power"]).estimate


def _on_cycle(prepared_scene, samples, cost):
    """Estimates over whole cycles of a converged start, from its stroboscopic samples."""
    estimates = {}
    period = prepared_scene.scene.excitation.period
    memory, shunt = memory_of(prepared_scene), susceptance(prepared_scene)
    pairs = means_of(samples, period, cost, memory, shunt).T
    for (name, dimension), pair in zip(QUANTITIES.items(), pairs, strict=True):
        value, error = map(float, pair)
        estimates[name] = Estimate(value, error, None, dimension)
        if name.startswith("rms_"):
            square = Estimate(value**2, 2.0 * value * error, None, f"{dimension}^2")
            estimates[f"mean_square_{dimension}"] = square
    return estimates


def _moved(samples, period, length):
    """Distance of each start's first cycle from its last one, as a share of its largest state.

    `length`: number of samples of the run, of which the ones in the middle may be missing.
    """
    phases = np.arange(period)
    latest = -1 - (length - 1 - phases) % period
    largest = np.maximum(np.abs(samples).max(axis=1, keepdims=True), np.finfo(float).tiny)
    return (np.abs(samples[:, :period] - samples[:, latest]) / largest).max(axis=(1, 2))


def _alone(prepared_scene, count):
    """The scene of a run with this number of starts."""
    return prepared_scene.with_run(realizations=count, starts=None)


def _exponent(scene, engine, samples, starts, members, pool, time_limit):
    """The largest Lyapunov exponent of one motion; None if a neighbour could not be followed."""
    finer = forced(scene, "a Lyapunov exponent")
    begin, scale = neighbours(finer.scene, samples, starts, members)
    calls = calls_of(finer.scene, engine, begin, PARTING_PERIODS + 1, PARTING_PERIODS)
    calls = [{"prepared_scene": finer, **call} for call in calls]
    most = max(len(call["starts"]) for call in calls)
    samples_of_calls = pool.map(follow, calls, most * time_limit, None, True)
    if any(isinstance(sample, SimulationError) for sample in samples_of_calls):
        return None
    return exponent_of(finer.scene, np.concatenate(samples_of_calls), scale)


def _attractor(
    prepared_scene, name, group, moments, cost, count, periodic=False, cycle=None, exponent=None
):
    """One motion with its means, from a run of some of its starts and from its cycle."""
    scaled = {}
    if moments:
        scaled = run_estimates(_alone(prepared_scene, len(moments)), moments, cost).scaled
    scales, starts = prepared_scene.scales, group.members.size
    units = np.array([scales.of("displacement"), scales.of("velocity")])
    return Attractor(
        name=name,
        period=group.period,
        periodic_drive=periodic,
        starts=starts,
        share=starts / count,
        share_error=share_error(starts, count) if prepared_scene.scene.run.starts else None,
        quantities={
            key: estimate.times(
                scales.of(estimate.dimension), unit_of(prepared_scene.scene, estimate.dimension)
            )
            for key, estimate in (scaled | (cycle or {})).items()
        },
        points=group.points[:, :2] * units,
        lyapunov=exponent,
    )
