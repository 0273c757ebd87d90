"""Sobol indices of the Ishigami function, whose own are known (Ishigami and Homma, 1990)."""

import numpy as np
import pytest

from harvester.studies.sensitivity.sobol import design, indices, product

PARAMETERS = 3
VARIANCE = 0.5 + 49.0 / 8.0 + 0.1 * np.pi**4 / 5.0 + 0.01 * np.pi**8 / 18.0
ALONE = np.array([0.5 * (1.0 + 0.1 * np.pi**4 / 5.0) ** 2, 49.0 / 8.0, 0.0])
TOGETHER = 0.01 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
FIRST = ALONE / VARIANCE
TOTAL = (ALONE + np.array([TOGETHER, 0.0, TOGETHER])) / VARIANCE


def ishigami(shares):
    x = np.pi * (2.0 * shares - 1.0)
    return np.sin(x[..., 0]) * (1.0 + 0.1 * x[..., 2] ** 4) + 7.0 * np.sin(x[..., 1]) ** 2


def noisy(values, seed, noise):
    """Two replicates: errors that a row has in common, and some that grow with the value."""
    generator = np.random.default_rng(seed)
    rows, devices = values.shape
    common = generator.standard_normal((2, rows, 1))
    own = generator.standard_normal((2, rows, devices)) * (0.5 + 0.1 * np.abs(values))
    return values + noise * (0.6 * common + own)


@pytest.mark.parametrize("noise", [0.0, 2.5])
def test_intervals_cover_the_exact_indices(noise):
    """95 % intervals of 20 designs × 6 indices: with fewer than 104 of 120 inside one false alarm
    in 3000, were the indices of a design independent of each other and the intervals exact; they
    are made wide rather than narrow."""
    inside, estimates = 0, []
    for seed in range(20):
        values = ishigami(design(128, PARAMETERS, seed))
        found = indices(noisy(values, seed, noise) if noise else values[None], seed)
        estimates.append([each.estimate for each in (*found.first, *found.total)])
        for each, truth in zip((*found.first, *found.total), (*FIRST, *TOTAL), strict=True):
            inside += each.low <= truth <= each.high
    assert inside >= 104
    error = np.std(estimates, axis=0, ddof=1) / np.sqrt(20)
    # Without bias: four standard errors of the mean of 20, six times; one false alarm in 1000.
    assert np.all(np.abs(np.mean(estimates, axis=0) - [*FIRST, *TOTAL]) < 4.5 * error + 1e-3)


def test_noise_that_is_not_told_apart_would_spoil_them():
    """Without the pairs of replicates the parameter without effect gets one."""
    values = noisy(ishigami(design(512, PARAMETERS, 3)), 3, 4.0)
    apart, mixed = indices(values, 1), indices(values.mean(axis=0)[None], 1)
    assert apart.first[2].low < 0.0 < apart.first[2].high
    assert mixed.total[1].low > TOTAL[1]
    assert apart.total[1].low < TOTAL[1] < apart.total[1].high
    assert mixed.variance.low > VARIANCE > apart.variance.low


def test_the_estimators_are_those_of_salib():
    pytest.importorskip("SALib", reason="SALib, an independent estimate, is in the extra `test`")
    from SALib.analyze import sobol

    rows = 1024
    values = ishigami(design(rows, PARAMETERS, 5))
    problem = {"num_vars": 3, "names": ["a", "b", "c"], "bounds": [[0.0, 1.0]] * 3}
    # SALib's order in a row: a, a with each of b's, b.
    ordered = np.concatenate([values[:, :1], values[:, 2:], values[:, 1:2]], axis=1).ravel()
    theirs = sobol.analyze(problem, ordered, calc_second_order=False, seed=1)
    ours = indices(values[None], 1)
    np.testing.assert_allclose([e.estimate for e in ours.first], theirs["S1"], atol=5e-3)
    np.testing.assert_allclose([e.estimate for e in ours.total], theirs["ST"], rtol=5e-3)
    widths = [0.5 * (e.high - e.low) for e in ours.total]
    np.testing.assert_allclose(widths, theirs["ST_conf"], rtol=0.25)


def test_a_design_changes_one_parameter_at_a_time():
    shares = design(16, 2, 7)
    a, b, first, second = np.moveaxis(shares, 1, 0)
    np.testing.assert_array_equal(first, np.column_stack([b[:, 0], a[:, 1]]))
    np.testing.assert_array_equal(second, np.column_stack([a[:, 0], b[:, 1]]))
    assert np.all(np.diff(np.sort(a[:, 0])) < 2.0 / 16.0)
    np.testing.assert_array_equal(shares, design(16, 2, 7))


def test_products_take_their_factors_from_different_replicates():
    left, right = np.array([[1.0], [2.0], [4.0]]), np.array([[3.0], [5.0], [7.0]])
    pairs = [left[j] * right[k] for j in range(3) for k in range(3) if j != k]
    assert product(left, right) == pytest.approx(np.mean(pairs))


def test_no_index_where_noise_hides_the_parameters():
    values = noisy(1e-3 * ishigami(design(64, PARAMETERS, 1)), 1, 1.0)
    assert indices(values, 1).first is None
