"""What a linear map leaves as it is, by GMRES."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

VECTORS = 150  # of one Krylov space
RESTARTS = 3
LARGEST_BASIS = 2e8  # bytes: of larger states fewer vectors are held at a time
SMALLEST = 1e-13  # of a vector's part that is new, below which nothing is left to find


def stationary(
    change: Callable[[np.ndarray], np.ndarray], start: np.ndarray, tolerance: float
) -> np.ndarray | None:
    """The state x of sum 1 with change(x) = 0, from a start.

    Parameters
    ----------
    change : callable
        Of an array of the shape of `start`: what one application takes off it, of sum 0.
    start : ndarray
        Of sum 1.
    tolerance : float
        Norm of change(x) that is let stand, as a share of the start's.

    Returns
    -------
    ndarray or None
        x; None if it was not reached.
    """
    allowed = tolerance * np.linalg.norm(start)
    state = start.ravel().copy()
    held = int(LARGEST_BASIS / start.nbytes)
    vectors = max(1, min(VECTORS, held))
    # Pages of the basis that are never written are never taken.
    basis = np.empty((vectors + 1, start.size))
    for _ in range(RESTARTS):
        rest = change(state.reshape(start.shape)).ravel()
        size = np.linalg.norm(rest)
        if not np.isfinite(size):
            return None
        if size <= allowed:
            return state.reshape(start.shape)
        basis[0] = rest / size
        upper = np.zeros((vectors + 1, vectors))
        for count in range(1, vectors + 1):
            _extend(change, basis, upper, count, start.shape)
            aim = np.zeros(count + 1)
            aim[0] = size
            if not np.isfinite(upper[: count + 1, count - 1]).all():
                return None
            share = np.linalg.lstsq(upper[: count + 1, :count], aim, rcond=None)[0]
            left = np.linalg.norm(aim - upper[: count + 1, :count] @ share)
            if left <= allowed or upper[count, count - 1] < SMALLEST:
                break
        state -= share @ basis[:count]
        if left <= allowed:
            return state.reshape(start.shape)
    return None


def _extend(change, basis, upper, count, shape):
    """The next vector of the space, at right angles to those before."""
    new = change(basis[count - 1].reshape(shape)).ravel()
    for _ in range(2):  # the second time takes off what rounding left
        along = basis[:count] @ new
        new -= along @ basis[:count]
        upper[:count, count - 1] += along
    upper[count, count - 1] = np.linalg.norm(new)
    basis[count] = new / max(upper[count, count - 1], 1e-300)
