"""Moments of several realizations in one call against those of each by itself."""

from dataclasses import fields

import numpy as np
import pytest

from harvester.engines.monte_carlo import integrate, record_of
from harvester.engines.realization import empty_moments, noise_path, start_state
from harvester.engines.steps import stop_time
from harvester.record.several import SeveralMoments
from harvester.scene.model import Scene
from harvester.scene.units import scale


@pytest.mark.parametrize("name", ["linear", "paper", "tristable"])
def test_several_in_one_call_are_as_each_by_itself(name):
    """With one well, two alike, and three with shares of time and jumps of their own."""
    scene = Scene.load(name, ["run.realizations=3"])
    scene = scene.replace({"run.duration": scene.run.duration / 20, "run.settle": 0.0})
    system, _ = scale(scene)
    alone, several = ([empty_moments(scene) for _ in range(3)] for _ in range(2))
    together = SeveralMoments(several)
    paths = [noise_path(scene, k) for k in range(3)]
    starts = [start_state(scene, k) for k in range(3)]
    for columns, points in integrate(system, paths, starts, stop_time(scene)):
        together.add(columns, points)
        for k, each in enumerate(alone):
            each.add(record_of(columns, points, k))
    for one, other in zip(alone, several, strict=True):
        assert one.points == other.points > 1000
        assert_same(one, other)
        assert (one.jumps is None) == (name == "linear")
        if one.jumps is not None:
            assert_same(one.jumps, other.jumps)


def assert_same(one, other):
    for each in fields(one):
        found = getattr(other, each.name)
        if isinstance(found, np.ndarray | float | int):
            np.testing.assert_array_equal(found, getattr(one, each.name), err_msg=each.name)
