"""Spacings of knots that a study's changes of a scene must not leave behind."""

import pytest

from harvester.base.errors import HarvesterError, SceneError
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing, resolving, steps_per_contact, steps_per_sample
from harvester.statistics.moments import Moments
from harvester.statistics.run_estimates import run_estimates


def test_knots_follow_a_shorter_correlation_time_only():
    scene = Scene.read("paper")
    assert knot_spacing(prepared(resolving(scene))) == 0.05
    short = scene.replace({"excitation.correlation_time": 0.1})
    assert knot_spacing(prepared(resolving(short))) == pytest.approx(0.0125)


def test_a_step_that_no_run_would_end_with_is_refused():
    scene = Scene.read("paper")
    ready = prepared(scene)
    assert steps_per_sample(ready, 1e-8) == 5_000_000
    with pytest.raises(HarvesterError, match=r"step 1e-30: is less than 1e-09 of the 0.05 s"):
        steps_per_sample(ready, 1e-30)


@pytest.mark.parametrize("engine", ["circuit", "monte-carlo"])
def test_a_finer_step_is_as_much_finer_in_a_contact(engine):
    scene = Scene.read("paper")
    ready = prepared(scene)
    fewest = steps_per_contact(ready, engine=engine)
    assert 20 < fewest < 40
    for step, finer in (("fine", 4), ("finest", 32)):
        assert steps_per_sample(ready, step, engine) == finer * steps_per_sample(
            ready, engine=engine
        )
        assert steps_per_contact(ready, step, engine) == finer * fewest
    # A longer one leaves the contact resolved.
    assert steps_per_contact(ready, 0.05, engine) == fewest


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        (
            "paper",
            "run.duration = 0.0001: must be at least the time between two samples .*, 0.05 s",
        ),
        ("paper_si", "run.duration = 0.0001: must be at least the time between two samples"),
        ("linear", "run.duration = 0.0001: must be at least one knot_spacing, 0.025 s"),
    ],
)
def test_a_run_shorter_than_its_knots_is_refused(scene, words):
    with pytest.raises(SceneError, match=words):
        knot_spacing(prepared(Scene.read(scene, ["run.duration=1e-4"])))


def test_a_run_without_a_measured_step_is_refused():
    nothing = Moments.empty(0.0, 0.05, (-1.0, 1.0), (), False, 1, 1, 0.1)
    with pytest.raises(
        SceneError, match=r"run.duration = .*it contains no complete step; raise it"
    ):
        run_estimates(prepared(Scene.read("paper")), [nothing])
