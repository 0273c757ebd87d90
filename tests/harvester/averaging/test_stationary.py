"""What a linear map takes off is undone, with and without a coarser map's help."""

import numpy as np
import pytest

from harvester.averaging import stationary
from harvester.averaging.stationary import Inverse
from harvester.errors import AveragingError


@pytest.fixture
def chain():
    """A Markov chain's transitions, columns of sum 1, that forgets slowly."""
    random = np.random.default_rng(3)
    moves = random.random((40, 40)) + 40.0 * np.eye(40)
    return moves / moves.sum(axis=0)


def rests(count):
    """Numbers of sum 0."""
    values = np.random.default_rng(4).normal(size=(count, 8, 5))
    return values - values.mean(axis=(1, 2), keepdims=True)


def test_undone(chain):
    """change(x) is the rest, whatever its shape; a second rest costs less than the first."""
    calls = []

    def change(x):
        calls.append(1)
        return x - (chain @ x.ravel()).reshape(x.shape)

    inverse = Inverse(change)
    first, second = rests(2)
    found = inverse(first, 1e-4)
    assert np.linalg.norm(change(found) - first) < 2e-4
    before = len(calls)
    mixed = second + 3.0 * first
    again = inverse(mixed, 1e-4)
    assert np.linalg.norm(change(again) - mixed) < 2e-4
    assert len(calls) - before <= before
    assert inverse(first, 1e-3) == pytest.approx(found, abs=1e-2)
    assert len(calls) - before <= before + 1


def test_an_inverse_that_is_near_saves_directions(chain):
    """One that is off by a tenth of the way leaves a few; one that is no help is left out."""
    exact = np.linalg.pinv(np.eye(40) - chain)
    random = np.random.default_rng(5).normal(size=(40, 40))
    (rest,) = rests(1)
    counts = {}
    for name, near in (
        ("none", None),
        ("near", exact + 0.02 * np.linalg.norm(exact, 2) * random / 40.0),
        ("useless", random),
    ):
        count = []

        def change(x, count=count):
            count.append(1)
            return x - (chain @ x.ravel()).reshape(x.shape)

        help_ = near if near is None else lambda r, m=near: (m @ r.ravel()).reshape(r.shape)
        found = Inverse(change, help_)(rest, 1e-4)
        counts[name] = len(count)
        assert np.linalg.norm(change(found) - rest) < 2e-4
    assert counts["near"] < 0.5 * counts["none"]
    assert counts["useless"] <= counts["none"] + 2


def test_few_directions_held_at_a_time(chain, monkeypatch):
    """Where memory holds few, it begins again and gets there or says that it did not."""
    monkeypatch.setattr(stationary, "LARGEST_BASIS", 2 * 4 * 40 * 12)
    (rest,) = rests(1)

    def change(x):
        return x - (chain @ x.ravel()).reshape(x.shape)

    try:
        found = Inverse(change)(rest, 1e-3)
    except AveragingError:
        return
    assert np.linalg.norm(change(found) - rest) < 2e-3


def test_a_rest_that_has_not_fallen_is_refused(chain):
    (rest,) = rests(1)
    with pytest.raises(AveragingError, match="not reached"):
        Inverse(lambda x: x)(rest, 1e-3, below=np.linalg.norm(rest))
