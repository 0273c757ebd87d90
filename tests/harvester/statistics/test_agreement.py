"""The one rule by which two estimates agree."""

import math

import numpy as np
import pytest

from harvester.statistics.agreement import NEGLIGIBLE_SHARE, SHARP_SHARE, differ, is_sharp


@pytest.mark.parametrize(
    ("difference", "error", "options", "expected"),
    [
        (0.031, 0.01, {}, True),
        (-0.031, 0.01, {}, True),
        (0.029, 0.01, {}, False),
        (0.009, 1e-5, {"negligible": NEGLIGIBLE_SHARE}, False),
        (0.011, 1e-5, {"negligible": NEGLIGIBLE_SHARE}, True),
        (0.04, 0.01, {"allowance": 0.02}, False),
        (0.051, 0.01, {"allowance": 0.02}, True),
        (0.0197, 0.01, {"sigmas": 1.96}, True),
        (1.0, None, {}, False),
        (1.0, math.nan, {}, False),
        (math.nan, 0.1, {}, False),
        (math.inf, 0.1, {}, True),
    ],
)
def test_a_difference_counts_beyond_chance_allowance_and_what_is_negligible(
    difference, error, options, expected
):
    assert differ(difference, error, **options) is expected


def test_chance_alone_differs_once_in_370():
    """Of 200,000 normal draws 540 ± 23 lie beyond three standard errors: false alarms of this
    test (5 standard deviations) are below one in a million; the seed is fixed."""
    draws = np.random.default_rng(1).standard_normal(200_000)
    count = sum(differ(draw, 1.0) for draw in draws)
    assert abs(count - 540) < 5 * 23


def test_a_difference_known_to_a_tenth_is_sharp():
    assert is_sharp(SHARP_SHARE)
    assert not is_sharp(0.11)
    assert not is_sharp(None)
    assert not is_sharp(math.nan)
