"""The steady motions of a deterministic device, from the several starts of one run."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from harvester.errors import SimulationError
from harvester.estimates.attractors import (
    NEARLY_CONVERGED,
    QUANTITIES,
    Group,
    groups_of,
    groups_that_meet,
    means_of,
    transients,
)
from harvester.estimates.estimate import Estimate
from harvester.estimates.of_run import run_estimates
from harvester.estimates.transient import memory_of
from harvester.prepared.paths import distinct_realizations, start_state
from harvester.prepared.prepared import prepared
from harvester.prepared.steps import step_error
from harvester.record.stroboscope import STATE
from harvester.results.orbit import ESCAPES, NOT_SETTLED, Attractor, orbit_name, share_error
from harvester.simulation.following import (
    PARTING_PERIODS,
    calls_of,
    exponent_of,
    follow,
    forced,
    neighbours,
)

if TYPE_CHECKING:
    from harvester.scene.model import Scene
    from harvester.simulation.methods import Engine
    from harvester.simulation.realization import Realization
    from harvester.workers.pools import Workers

# Motions without a period, those of most starts, whose exponent is looked for: what still settles
# may make one of each start.
MOST_EXPONENTS = 4
# A start is in the means of its motion if its first cycle is off its last by at most this share.
SETTLED = 1e-5
# Samples at the end of a run by which motions are distinguished, and the fewest that suffice.
SAMPLES, FEWEST_SAMPLES = 64, 6


def several_starts(scene: Scene) -> bool:
    """Whether realizations differ by their starts alone."""
    excitation = scene.excitation
    if excitation.random or excitation.prescribes_displacement:
        return False
    return distinct_realizations(prepared(scene)) > 1


def attractors(
    scene: Scene,
    engine: Engine,
    realizations: dict[int, Realization],
    escaped: int,
    pool: Workers,
    time_limit: float,
) -> tuple[Attractor, ...]:
    """The motions on which a run's starts settled, the one with the most starts first.

    Behind them is what the other starts do.

    Parameters
    ----------
    scene : Scene
    engine : Engine
    realizations : dict of int to Realization
        Realizations by their numbers, with stroboscopic samples.
    escaped : int
        Number of further starts: those that left the range of the spring.
    pool : Workers
        Follow neighbours on motions without a period.
    time_limit : float
        Wall-clock limit of one of these (s).
    """
    ready = prepared(scene)
    moments = [each.moments for each in realizations.values()]
    samples = np.array([each.stroboscope for each in realizations.values()])
    samples = samples[:, ~np.isnan(samples).any(axis=(0, 2))]
    last, states = samples[:, -SAMPLES:], samples[:, -SAMPLES:, :STATE]
    if last.shape[1] < FEWEST_SAMPLES:
        return ()
    cost = step_error(ready, engine.step, engine.name)
    count = len(moments) + escaped
    if not scene.excitation.period:
        groups = groups_that_meet(states)
        return tuple(
            _attractor(scene, orbit_name(number), group, moments, cost, count)
            for number, group in enumerate(groups)
        )
    # Neighbours cost as much as some fifty starts: they are for runs that ask for motions.
    found: list[Attractor] = []
    left = MOST_EXPONENTS if scene.run.starts else 0
    starts = np.array([start_state(ready, number) for number in realizations])
    for group in groups_of(states):
        exponent, cycle, own = None, {}, group.members
        if group.period is not None:
            remains = transients(states[own], memory_of(ready))[2]
            if not remains.min() <= NEARLY_CONVERGED:
                continue
            cycle = _on_cycle(scene, last[own[[np.argmin(remains)]]], cost)
            own = own[_settled(samples[own, :, :STATE], group.period)]
        elif left:
            exponent = _exponent(scene, engine, states, starts, own, pool, time_limit)
            left -= 1
            if exponent is not None and not exponent.chaotic:
                continue
        means = [moments[k] for k in own]
        name = orbit_name(len(found))
        found.append(_attractor(scene, name, group, means, cost, count, cycle, exponent))
    unsettled = len(moments) - sum(each.starts for each in found)
    for name, number in ((NOT_SETTLED, unsettled), (ESCAPES, escaped)):
        if number:
            nothing = Group(None, np.zeros(number), np.empty((0, STATE)))
            found.append(_attractor(scene, name, nothing, [], cost, count))
    return tuple(found)


def _on_cycle(scene, samples, cost):
    """Estimates over whole cycles of a start that has converged, by its stroboscopic samples."""
    estimates = {}
    pairs = means_of(samples, scene.excitation.period, cost, memory_of(prepared(scene))).T
    for (name, dimension), pair in zip(QUANTITIES.items(), pairs, strict=True):
        value, error = map(float, pair)
        estimates[name] = Estimate(value, error, None, dimension)
        if name.startswith("rms_"):
            square = Estimate(value**2, 2.0 * value * error, None, f"{dimension}^2")
            estimates[f"mean_square_{dimension}"] = square
    return estimates


def _settled(samples, period):
    """Whether starts are on their cycle from their first sample on."""
    back = (samples.shape[1] - period) // period * period
    moved = np.abs(samples[:, :period] - samples[:, back : back + period])
    return (moved <= SETTLED * np.abs(samples).max(axis=1, keepdims=True)).all(axis=(1, 2))


def _exponent(scene, engine, samples, starts, members, pool, time_limit):
    """The largest Lyapunov exponent of one motion; None where a neighbour could not be followed."""
    finer = forced(scene, "a Lyapunov exponent")
    begin, scale = neighbours(finer, samples, starts, members)
    calls = calls_of(finer, engine, begin, PARTING_PERIODS + 1, PARTING_PERIODS)
    most = max(len(each["starts"]) for each in calls)
    found = pool.map(follow, calls, most * time_limit, None, True)
    if any(isinstance(each, SimulationError) for each in found):
        return None
    return exponent_of(finer, np.concatenate(found), scale)


def _attractor(scene, name, group, moments, cost, count, cycle=None, exponent=None):
    """One motion with its own means: those of a run of some of its starts, and of its cycle."""
    alone = replace(scene, run=replace(scene.run, realizations=len(moments) or 1, starts=None))
    scaled = run_estimates(prepared(alone), moments, cost).scaled if moments else {}
    scales, starts = prepared(scene).scales, group.members.size
    units = np.array([scales.of("displacement"), scales.of("velocity")])
    return Attractor(
        name=name,
        period=group.period,
        periodic_drive=scene.excitation.period is not None,
        starts=starts,
        share=starts / count,
        share_error=share_error(starts, count) if scene.run.starts else None,
        quantities={
            key: each.times(scales.of(each.dimension))
            for key, each in (scaled | (cycle or {})).items()
        },
        points=group.points[:, :2] * units,
        lyapunov=exponent,
    )
