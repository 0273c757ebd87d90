"""What several starts of one run come to: the steady motions of a device without chance."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from harvester.estimates.attractors import groups_of, groups_that_meet
from harvester.estimates.of_run import run_estimates
from harvester.prepared.prepared import prepared
from harvester.record.stroboscope import STATE
from harvester.results.orbit import Attractor, orbit_name, share_error

if TYPE_CHECKING:
    from harvester.record.moments import Moments
    from harvester.scene.model import Scene

# Samples at the end of a run that motions are told apart by; fewer than the second tell nothing.
SAMPLES, FEWEST_SAMPLES = 64, 6


def several_starts(scene: Scene) -> bool:
    """Whether realizations differ by their starts alone."""
    return scene.run.realizations > 1 and not scene.excitation.random


def attractors(
    scene: Scene, samples: np.ndarray, moments: list[Moments], cost: float
) -> tuple[Attractor, ...]:
    """The motions that a run's starts came to, that of most starts first.

    Parameters
    ----------
    scene : Scene
    samples : ndarray, shape (starts, samples, columns)
        Of `harvester.record.stroboscope`.
    moments : list of Moments
        Of the same starts.
    cost : float
        Share of a power that the steps may cost.
    """
    ready = prepared(scene)
    last = samples[:, -SAMPLES:, :STATE]
    last = last[:, ~np.isnan(last).any(axis=(0, 2))]
    if last.shape[1] < FEWEST_SAMPLES:
        return ()
    groups = groups_of(last) if scene.excitation.period else groups_that_meet(last)
    size, speed = ready.scales.of("displacement"), ready.scales.of("velocity")
    return tuple(
        _attractor(scene, number, group, moments, cost, np.array([size, speed]))
        for number, group in enumerate(groups)
    )


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
