"""Spacings of knots that a study's changes of a scene must not leave behind."""

import pytest

from harvester.engines.steps import knot_spacing, resolving, steps_per_knot
from harvester.errors import HarvesterError
from harvester.scene.model import Scene


def test_knots_follow_a_shorter_correlation_time_only():
    scene = Scene.load("paper")
    assert knot_spacing(resolving(scene)) == 0.05
    short = scene.replace({"excitation.correlation_time": 0.1})
    assert knot_spacing(resolving(short)) == pytest.approx(0.0125)


def test_a_step_that_no_run_would_end_with_is_refused():
    scene = Scene.load("paper")
    assert steps_per_knot(scene, 1e-8) == 5_000_000
    with pytest.raises(HarvesterError, match=r"step 1e-30: less than 1e-09 of the 0.05 s"):
        steps_per_knot(scene, 1e-30)
