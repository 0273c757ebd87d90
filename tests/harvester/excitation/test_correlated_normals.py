"""Normal sequences against numpy's own numbers."""

import math

import numpy as np

from harvester.excitation.correlated_normals import NormalPath


def written(sequence, *counts):
    """Numbers in parts of these sizes."""
    return np.concatenate([sequence.read(count) for count in counts])


def test_the_numbers_are_those_of_numpy():
    """Two million: 24,000 of them beyond a strip's rectangle, 500 in the tail beyond 3.65."""
    seed = np.random.SeedSequence(7)
    found = written(NormalPath(seed, 1.0), 1, 0, 5, 1000, 2_000_000, 3)
    truth = np.random.default_rng(seed).standard_normal(found.size)
    assert (np.abs(truth) > 3.66).sum() > 400
    np.testing.assert_array_equal(found, truth)


def test_numbers_keep_a_share_of_the_one_before():
    """x_{k+1} = a x_k + √(1 − a²) ξ_k, from the first number on, in parts of any size."""
    seed, deviation, decay = np.random.SeedSequence(3), 0.7, 0.3
    found = written(NormalPath(seed, deviation, decay), 1, 10, 89)
    white = np.random.default_rng(seed).standard_normal(100)
    truth = [white[0]]
    for number in white[1:]:
        truth.append(math.exp(-decay) * truth[-1] + math.sqrt(1 - math.exp(-2 * decay)) * number)
    np.testing.assert_allclose(found, deviation * np.array(truth), rtol=1e-13)
