"""Wells that are seldom left: what of a run's means is claimed."""

import numpy as np
import pytest

from harvester import Scene
from harvester.estimates.of_run import run_estimates
from harvester.estimates.settling import _exchange
from harvester.simulation.realization import run

SHARE = "share_of_time_in_well_1"


def estimates_at(intensity, **changes):
    scene = Scene.load("asymmetric").replace({"excitation.intensity": intensity, **changes})
    indices = list(range(scene.run.realizations))
    found = run(scene, "monte-carlo", indices, "default", "external", None, lambda _: None)
    return run_estimates(scene, [each.moments for each in found])


def test_two_wells_exchange_by_the_sum_of_their_rates():
    time, shares = _exchange(np.array([[0.0, 0.3], [0.1, 0.0]]))
    assert time == pytest.approx(1.0 / 0.4)
    assert shares == pytest.approx([0.25, 0.75])


def test_a_share_left_by_the_starts_is_not_claimed():
    # The stationary solver has 0.0103 in the first well; a mean over the run has ten times that.
    found = estimates_at(0.05)
    assert found.scaled[SHARE].standard_error is None
    assert found.scaled["mean_power"].standard_error is None
    assert any("exchange between the wells" in note for note in found.notes)


def test_without_jumps_the_starts_are_named():
    found = estimates_at(0.02)
    assert found.scaled[SHARE].standard_error is None
    assert any("shares of time are those of the starts" in note for note in found.notes)


def test_with_hundreds_of_jumps_the_share_is_the_stationary_one():
    # By the stationary solver 0.348; within three errors, false alarm 0.3 %.
    found = estimates_at(0.36)
    share = found.scaled[SHARE]
    assert abs(share.estimate - 0.348) <= 3.0 * share.standard_error
    assert found.scaled["mean_power"].standard_error is not None
