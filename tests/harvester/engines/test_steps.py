"""Spacings of knots that a study's changes of a scene must not leave behind."""

import pytest

from harvester.engines.steps import knot_spacing, resolving, steps_per_contact, steps_per_knot
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


@pytest.mark.parametrize("engine", ["circuit", "monte-carlo"])
def test_a_finer_step_is_as_much_finer_in_a_contact(engine):
    scene = Scene.load("paper")
    fewest = steps_per_contact(scene, engine=engine)
    assert 20 < fewest < 40
    for step, finer in (("fine", 4), ("finest", 32)):
        assert steps_per_knot(scene, step, engine) == finer * steps_per_knot(scene, engine=engine)
        assert steps_per_contact(scene, step, engine) == finer * fewest
    # A longer one leaves the contact resolved.
    assert steps_per_contact(scene, 0.05, engine) == fewest
