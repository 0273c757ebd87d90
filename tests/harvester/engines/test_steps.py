"""Spacings of knots that a study's changes of a scene must not leave behind."""

import pytest

from harvester.engines.steps import knot_spacing, resolving
from harvester.scene.model import Scene


def test_knots_follow_a_shorter_correlation_time_only():
    scene = Scene.load("paper")
    assert knot_spacing(resolving(scene)) == 0.05
    short = scene.replace({"excitation.correlation_time": 0.1})
    assert knot_spacing(resolving(short)) == pytest.approx(0.0125)
