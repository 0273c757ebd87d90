import math

import numpy as np
import pytest

from harvester.estimates.control_variate import controlled_mean

CORRELATION = 0.95
MEAN, KNOWN = 3.0, 7.0


def batches(seed, correlation=CORRELATION, realizations=16):
    """A series of mean 3 and its control of mean 7, both of unit variance."""
    normal = np.random.default_rng(seed).standard_normal((2, realizations, 2))
    series = correlation * normal[0] + math.sqrt(1.0 - correlation**2) * normal[1]
    return MEAN + series, KNOWN + normal[0]


def test_it_is_unbiased_and_its_error_bar_holds():
    found = [controlled_mean(*batches(seed), KNOWN) for seed in range(400)]
    means = np.array([each.mean for each in found])
    errors = np.array([each.standard_error for each in found])
    scatter = means.std(ddof=1)
    # False alarms: 4 standard errors, 1 in 16 000; the scatter of 400 is good to 3.5 %, and the
    # error bars leave out what estimating the coefficient costs, about 1/30 of the variance.
    assert abs(means.mean() - MEAN) < 4.0 * scatter / 20.0
    assert errors.mean() == pytest.approx(scatter, rel=0.15)


def test_the_gain_is_that_of_the_correlation():
    series, control = batches(1, realizations=2000)
    found = controlled_mean(series, control, KNOWN)
    assert found.gain == pytest.approx(1.0 / (1.0 - CORRELATION**2), rel=0.15)
    assert found.coefficient == pytest.approx(CORRELATION, abs=0.03)
    assert found.correlation == pytest.approx(CORRELATION, abs=0.01)


def test_what_the_known_mean_is_worth_counts():
    series, control = batches(1)
    exact = controlled_mean(series, control, KNOWN)
    known = controlled_mean(series, control, KNOWN, known_error=0.05)
    expected = math.hypot(exact.standard_error, 0.05 * exact.coefficient)
    assert known.standard_error == pytest.approx(expected)


def test_it_is_left_out_where_it_is_no_better():
    for seed in range(50):
        series, control = batches(seed, correlation=0.0)
        plain = controlled_mean(series, np.empty((0, 0)))
        found = controlled_mean(series, control, KNOWN)
        assert found.standard_error <= plain.standard_error
        # Chance correlation of more than 3 standard errors that also gains 10 %: 1 in 400.
        if seed < 10:
            assert (found.coefficient, found.gain, found.mean) == (0.0, 1.0, series.mean())
    series, control = batches(1)
    useless = controlled_mean(series, control, KNOWN, known_error=1.0)
    assert (useless.coefficient, useless.mean) == (0.0, series.mean())


def test_a_single_realization_has_no_coefficient():
    series, control = (each.reshape(1, -1) for each in batches(1))
    assert controlled_mean(series, control, KNOWN).coefficient == 0.0
