"""Moments added to while several realizations are integrated against those of their records."""

from dataclasses import fields

import numpy as np
import pytest

from harvester.engines.monte_carlo.engine import integrate, record_of
from harvester.engines.realization import empty_moments
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path, start_state
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing, stop_time

REALIZATIONS = 11  # a block of eight and a part of one
KNOTS = 6144  # 24 batches of whole knots: a contact's points then lie in one of them


@pytest.mark.parametrize(
    "name",
    [
        "linear",
        "paper",
        pytest.param("tristable", marks=pytest.mark.exhaustive),
        "asymmetric",
    ],
)
@pytest.mark.parametrize("settle", [0, 100])
def test_moments_are_those_of_the_records(name, settle):
    """With one well, two alike, and three and two uneven ones with shares of time of their own."""
    scene = scene_of(name, settle)
    own = [empty_moments(prepared(scene)) for _ in range(REALIZATIONS)]
    of_records = [empty_moments(prepared(scene)) for _ in range(REALIZATIONS)]
    for columns, points in run(scene, own, None):
        for k, each in enumerate(of_records):
            each.add(record_of(columns, points, k))
    for one, other in zip(own, of_records, strict=True):
        assert one.points == other.points >= KNOTS
        # Means across contacts are corrected by a slope that a record does not hold.
        assert_same(one, other, 0.01 if name == "paper" else 1e-12)
        assert (one.jumps is None) == (name == "linear")
        if one.jumps is not None:
            assert_same(one.jumps, other.jumps)


def test_moments_are_the_same_where_no_point_is_kept():
    scene = scene_of("paper", 100)
    kept, others = ([empty_moments(prepared(scene)) for _ in range(REALIZATIONS)] for _ in range(2))
    for columns, _ in run(scene, kept, None):
        assert len(columns) == REALIZATIONS
    for columns, _ in run(scene, others, 0):
        assert len(columns) == 0
    for one, other in zip(kept, others, strict=True):
        assert one.points == other.points
        np.testing.assert_allclose(one.integrals, other.integrals, rtol=1e-12)
        np.testing.assert_array_equal(one.last, other.last)


def scene_of(name, settle):
    """A run of whole batches in knots, with enough noise for contacts and jumps."""
    scene = Scene.read(name)
    spacing = knot_spacing(prepared(scene))
    times = {"run.duration": KNOTS * spacing, "run.settle": settle * spacing}
    noise = {"excitation.intensity": 4.0 * scene.excitation.intensity}
    return scene.replace({"run.realizations": REALIZATIONS, **times, **noise})


def run(scene, moments, keep):
    ready = prepared(scene)
    system = ready.system
    paths = [noise_path(ready, k) for k in range(REALIZATIONS)]
    starts = [start_state(ready, k) for k in range(REALIZATIONS)]
    return integrate(system, paths, starts, stop_time(ready), moments=moments, keep=keep)


def assert_same(one, other, largest=1e-12):
    """Numbers to the rounding of their sums, integrals to this share of their greatest."""
    for each in fields(one):
        found, truth = getattr(other, each.name), getattr(one, each.name)
        if isinstance(found, np.ndarray | float | int):
            scale = np.max(np.abs(truth), axis=0, initial=0.0, where=np.isfinite(truth))
            share = largest if each.name == "integrals" else 1e-12
            rounding = 1e-11 * np.abs(truth) + 1e-12 * np.max(scale)
            unequal = np.abs(found - truth) > np.maximum(rounding, share * scale)
            assert not np.any(unequal & np.isfinite(truth)), each.name
