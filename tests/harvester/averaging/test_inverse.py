"""What a linear map takes off is undone, with and without a coarser grid's help."""

import numpy as np
import pytest

from harvester.averaging import inverse as module
from harvester.averaging.flow import PhaseGrid
from harvester.averaging.inverse import Inverse, moved
from harvester.base.errors import AveragingError


def grid_of(nodes):
    """A grid of so many nodes of X and of X', nothing kept along Z, white noise."""
    x = np.linspace(-3.0, 3.0, nodes)
    return PhaseGrid(x, x, np.zeros(1), False, 1, 0.1)


def spreading(grid, narrow=0.4):
    """A map that moves each node's mass a little way, all of it kept, and changes only slowly."""
    apart = (grid.x[:, None] - grid.x) / narrow
    moves = np.exp(-0.5 * apart**2) * np.exp(-0.05 * grid.x[:, None] ** 2)
    moves /= moves.sum(axis=0)

    def later(state):
        later.calls += 1
        return np.einsum("ij,jzmv,wv->izmw", moves, state, moves)

    later.calls = 0
    return later


def rests(grid, count):
    """States of sum 0, smooth."""
    random = np.random.default_rng(4)
    states = []
    for a, b, c in random.normal(size=(count, 3)):
        x, v = grid.x[:, None], grid.v
        state = np.exp(-0.5 * (x - a) ** 2 - 0.5 * (v - b) ** 2) * np.cos(c * x)
        mass = np.exp(-0.5 * (x**2 + v**2))
        state -= state.sum() / mass.sum() * mass
        states.append((state / np.linalg.norm(state))[:, None, None, :])
    return states


def undone(later, found, rest):
    """Norm of what x leaves of a rest."""
    return np.linalg.norm(found - later(found) - rest)


def test_undone():
    """x is found, whatever its shape; what was learnt of one rest serves another."""
    grid = grid_of(24)
    later = spreading(grid)
    inverse = Inverse(grid, later)
    first, second = rests(grid, 2)
    found = inverse(first, 1e-4)
    assert undone(later, found, first) < 2e-4
    before = later.calls
    assert inverse(first, 1e-3) == pytest.approx(found, abs=1e-2)
    assert later.calls == before
    mixed = second + 3.0 * first
    assert undone(later, inverse(mixed, 1e-4), mixed) < 2e-4
    assert later.calls - before <= before


def test_a_coarser_grid_saves_directions():
    """It leaves less than half of them; one that is no help costs a quarter more."""
    grid, coarse = grid_of(48), grid_of(24)
    (rest,) = rests(grid, 1)
    counts = {}
    for name, coarser in (
        ("none", None),
        ("near", Inverse(coarse, spreading(coarse))),
        ("useless", Inverse(coarse, lambda state: 0.9 * state[::-1])),
    ):
        later = spreading(grid)
        found = Inverse(grid, later, coarser)(rest, 1e-4)
        counts[name] = later.calls
        assert undone(later, found, rest) < 2e-4
    assert counts["near"] < 0.5 * counts["none"]
    assert counts["useless"] <= 1.25 * counts["none"]


def test_settled_exactly():
    """Small enough as it is told exactly, though directions are kept in single precision."""
    grid = grid_of(24)
    later = spreading(grid)
    (rest,) = rests(grid, 1)

    def left(state):
        return rest + later(state) - state

    inverse = Inverse(grid, lambda state: later(state).astype(np.float32))
    state = inverse.settled(np.zeros(grid.shape), left, 1e-9)
    assert np.linalg.norm(left(state)) < 1e-9


def test_what_decays_is_undone():
    """decayed · x − later(x) is the rest."""
    grid = grid_of(24)
    later = spreading(grid)
    (rest,) = rests(grid, 1)
    found = Inverse(grid, lambda state: 0.3 * later(state), decayed=0.5)(rest, 1e-4)
    assert np.linalg.norm(0.5 * found - 0.3 * later(found) - rest) < 2e-4


def test_few_directions_held_at_a_time(monkeypatch):
    """Where memory holds few, it begins again and gets there or says that it did not."""
    grid = grid_of(24)
    monkeypatch.setattr(module, "LARGEST_BASIS", 2 * 4 * 24 * 24 * 12)
    later = spreading(grid)
    (rest,) = rests(grid, 1)
    try:
        found = Inverse(grid, later)(rest, 1e-3)
    except AveragingError:
        return
    assert undone(later, found, rest) < 2e-3


def test_a_rest_that_has_not_fallen_is_refused():
    grid = grid_of(24)
    (rest,) = rests(grid, 1)
    with pytest.raises(AveragingError, match="did not converge"):
        Inverse(grid, lambda x: 0.0 * x)(rest, 1e-3, below=np.linalg.norm(rest))


@pytest.mark.parametrize("parity", [1.0, -1.0])
def test_moved_to_another_grid(parity):
    """A smooth state of either parity is the same density on the nodes of another."""

    def state_on(nodes, layers):
        grid = grid_of(nodes)._replace(z=np.linspace(-2.0, 2.0, layers), mirrored=True)
        x, z, v = grid.x[:, None, None], grid.kept[:, None], grid.v
        one = np.exp(-((x - 0.5) ** 2) - (v - 0.3) ** 2) * (1.0 + z)
        other = np.exp(-((-x - 0.5) ** 2) - (-v - 0.3) ** 2) * (1.0 - z)
        return grid, (one + parity * other)[:, :, None, :] * (grid.x[1] - grid.x[0]) ** 2 / layers

    (old, state), (new, expected) = state_on(33, 4), state_on(41, 4)
    assert moved(state, old, new, parity) == pytest.approx(expected, abs=2e-3 * expected.max())
