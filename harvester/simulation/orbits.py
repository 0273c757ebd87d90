"""The steady motions of a deterministic device, from the several starts of one run."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from harvester.errors import SimulationError
from harvester.estimates.attractors import groups_of, groups_that_meet
from harvester.estimates.of_run import run_estimates
from harvester.prepared.paths import distinct_realizations, start_state
from harvester.prepared.prepared import prepared
from harvester.prepared.steps import step_error
from harvester.record.stroboscope import STATE
from harvester.results.orbit import Attractor, orbit_name, share_error
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
    pool: Workers,
    time_limit: float,
) -> tuple[Attractor, ...]:
    """The motions on which a run's starts settled, the one with the most starts first.

    Parameters
    ----------
    scene : Scene
    engine : Engine
    realizations : dict of int to Realization
        Realizations by their numbers, with stroboscopic samples.
    pool : Workers
        Follow neighbours on motions without a period.
    time_limit : float
        Wall-clock limit of one of these (s).
    """
    ready = prepared(scene)
    moments = [each.moments for each in realizations.values()]
    last = np.array([each.stroboscope for each in realizations.values()])[:, -SAMPLES:, :STATE]
    last = last[:, ~np.isnan(last).any(axis=(0, 2))]
    if last.shape[1] < FEWEST_SAMPLES:
        return ()
    cost = step_error(ready, engine.step, engine.name)
    size, speed = ready.scales.of("displacement"), ready.scales.of("velocity")
    units = np.array([size, speed])
    if not scene.excitation.period:
        groups = groups_that_meet(last)
        return tuple(
            _attractor(scene, number, group, moments, cost, units)
            for number, group in enumerate(groups)
        )
    # Neighbours cost as much as some fifty starts: they are for runs that ask for motions.
    groups, found, left = groups_of(last), [], MOST_EXPONENTS if scene.run.starts else 0
    starts = np.array([start_state(ready, number) for number in realizations])
    for number, group in enumerate(groups):
        each = _attractor(scene, number, group, moments, cost, units)
        if group.period is None and left:
            exponent = _exponent(scene, engine, last, starts, group.members, pool, time_limit)
            each, left = replace(each, lyapunov=exponent), left - 1
        found.append(each)
    return tuple(found)


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


def _attractor(scene, number, group, moments, cost, units):
    """One motion with its own means: those of a run of its starts alone."""
    own = [moments[k] for k in group.members]
    alone = replace(scene, run=replace(scene.run, realizations=len(own), starts=None))
    scaled, scales = run_estimates(prepared(alone), own, cost).scaled, prepared(scene).scales
    return Attractor(
        name=orbit_name(number),
        period=group.period,
        periodic_drive=scene.excitation.period is not None,
        starts=len(own),
        share=len(own) / len(moments),
        share_error=share_error(len(own), len(moments)) if scene.run.starts else None,
        quantities={name: each.times(scales.of(each.dimension)) for name, each in scaled.items()},
        points=group.points[:, :2] * units,
    )
