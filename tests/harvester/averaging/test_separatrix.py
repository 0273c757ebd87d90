"""Joining wells and outer orbits, against the walk of the energy from lobe to lobe."""

import math

import numpy as np
import pytest
from scipy.special import zeta
from scipy.stats import norm

from harvester.averaging.separatrix import _steps, slip_length

WIDTH = 0.02  # of the walks' places
TOP = 8.0


def places(depth):
    return np.arange(-depth + 0.5 * WIDTH, TOP, WIDTH)


def kernel(to, come_from, drift):
    """Steps of unit variance: A = ½ and B = the drift."""
    return norm.pdf(to[:, None] - come_from + drift) * WIDTH


def test_slip_without_loss_is_milnes():
    noises = np.array([0.3, 0.7])
    known = -zeta(0.5) / math.sqrt(math.pi) * (np.sqrt(noises).sum() - 1.0)
    assert slip_length(noises, np.zeros(2)) == pytest.approx(known, rel=1e-4)
    assert slip_length(noises, 1e-9 * noises) == pytest.approx(known, rel=1e-4)


@pytest.mark.parametrize("drift", [0.2, 0.5])
def test_slip_of_a_walk_that_drifts(drift):
    """Odd part of g of alike sides: its zero-flux limit far below, of unit flux at 0.

    ψ(e) = s(e) E[ψ(e')] for g odd over g even, s = 1 below and −1 above, e' by reversal the same
    walk; far below ψ = (exp(2be) − 1)/(2b) − slip.
    """
    depth = 3.5 / drift
    e, far = places(depth), np.arange(-depth - 8.0 + 0.5 * WIDTH, TOP, WIDTH)
    side = np.where(e < 0.0, 1.0, -1.0)

    def known(e):
        return np.where(e < 0.0, np.expm1(2.0 * drift * e) / (2.0 * drift), 0.0)

    given = side * (kernel(far, e, drift).T @ known(far)) - known(e)
    steps = side[:, None] * kernel(e, e, drift).T
    steps[:, 0] += side * norm.cdf(-depth - e + drift)  # as at the last place beyond it
    rest = np.linalg.solve(np.eye(len(e)) - steps, given)
    noises, losses = np.full(2, 0.5), np.full(2, drift)
    assert -rest[0] == pytest.approx(slip_length(noises, losses), rel=0.03)


def test_unequal_shares_make_a_step():
    """Two wells whose walks drift differently, without a flux between them."""
    drifts, depth = (0.3, 0.2), 9.0
    e = places(depth)
    below = (e < 0.0).astype(float)
    # After a pass on one side its mass stays there below 0 and changes sides above.
    moves = []
    for drift in drifts:
        step = kernel(e, e, drift) + kernel(e, -2.0 * depth - e, drift)
        moves.append(step / step.sum(axis=0))
    one, two = moves
    whole = np.block([[below[:, None] * one, (1.0 - below)[:, None] * two],
                      [(1.0 - below)[:, None] * one, below[:, None] * two]])  # fmt: skip
    whole -= np.eye(2 * len(e))
    whole[0] = 1.0
    g = np.linalg.solve(whole, np.eye(2 * len(e))[0]).reshape(2, -1)
    middle = (e > -5.5) & (e < -4.0)
    found = [
        np.mean(row[middle] * np.exp(2.0 * b * e[middle])) for row, b in zip(g, drifts, strict=True)
    ]
    _, uneven = _steps(np.full(2, 0.5), np.array(drifts))
    assert math.log(found[0] / found[1]) == pytest.approx(math.log(uneven[0] / uneven[1]), rel=0.1)
    assert uneven.sum() == pytest.approx(2.0)
