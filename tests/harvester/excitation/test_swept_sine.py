"""A sine that sweeps: against scipy's logarithmic chirp, and in blocks."""

import numpy as np
import pytest
from scipy.signal import chirp

from harvester.base.errors import SceneError
from harvester.excitation.swept_sine import SweptSine

SWEEP = SweptSine(amplitude=2.0, frequency=5.0, end_frequency=40.0, octaves_per_minute=18.0)


def test_the_way_up_is_the_logarithmic_chirp_and_the_way_back_its_mirror():
    """Three octaves in 10 s."""
    spacing = 1e-4
    samples = SWEEP.path(spacing, 1.0, None).read(200_001)
    times = np.arange(100_001) * spacing
    wanted = 2.0 * chirp(times, 5.0, 10.0, 40.0, method="logarithmic", phi=-90)
    # Knots are raised by at most 1/sinc²(0.004).
    assert samples[:100_001] == pytest.approx(wanted, abs=2e-4)
    crossings = np.count_nonzero(np.diff(np.sign(samples[100_001:])))
    assert abs(crossings - np.count_nonzero(np.diff(np.sign(wanted)))) <= 2
    assert np.abs(np.diff(samples)).max() < 2.0 * 2.0 * np.pi * 40.0 * spacing * 1.001


def test_straight_lines_between_far_knots_keep_the_amplitude():
    """At eight knots a period lines through a sine's own values would have 0.95 of it."""
    spacing = 1.0 / 320.0
    sweep = SweptSine(amplitude=2.0, frequency=40.0, end_frequency=40.5, octaves_per_minute=0.01)
    knots = sweep.path(spacing, 1.0, None).read(321)
    times = np.arange(0.0, 1.0, spacing / 64.0)
    lines = np.interp(times, np.arange(321) * spacing, knots)
    assert 2.0 * np.mean(lines * np.sin(80.0 * np.pi * times)) == pytest.approx(2.0, rel=1e-3)


def test_blocks_of_any_size_give_the_same_bytes():
    whole = SWEEP.path(1e-3, 2.0, None).read(50_000)
    path = SWEEP.path(1e-3, 2.0, None)
    parts = np.concatenate([path.read(count) for count in (1, 0, 30_000, 19_999)])
    assert whole.tobytes() == parts.tobytes()


def test_a_sweep_that_stands_still_is_refused():
    with pytest.raises(SceneError, match=r"equals excitation\.frequency"):
        SweptSine(1.0, 5.0, 5.0).check("SI", None, "scene")
