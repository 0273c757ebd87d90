"""What a linear map takes off, undone: solutions of change(x) = rest, one after the other."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from harvester.errors import AveragingError

Map = Callable[[np.ndarray], np.ndarray]

LARGEST_BASIS = 2e8  # bytes: of larger states fewer directions are held at a time
MOST_DIRECTIONS = 150  # held at a time
MOST_SOUGHT = 400  # for one solution
POOR_DIRECTION_REST = (
    0.9  # share of a rest left by a direction, beyond which the inverse it began as is no help
)
KEPT, BYTES = np.float32, 4  # of what is kept: what it takes off is known as well as it is kept
SMALLEST_NEW_PART = 1e-6  # of a direction's part that is new, below which nothing is left to find


class Inverse:
    """Generalised conjugate residuals (Eisenstat, Elman and Schultz 1983), directions kept.

    Each direction's change is at right angles to those before, so that what they reach of another
    rest costs nothing: the slow states of a map are found once.

    Parameters
    ----------
    change : callable
        Linear map of arrays, with values of sum 0.
    near : callable, optional
        About its inverse. Each direction begins as this of what is left, or as what is left.
    """

    def __init__(self, change: Map, near: Map | None = None) -> None:
        self._change, self._near = change, near or _itself
        self._count = 0
        self._directions = self._changes = np.empty((0, 0), KEPT)

    def __call__(self, rest: np.ndarray, allowed: float, below: float = np.inf) -> np.ndarray:
        """x with |rest − change(x)| ≤ allowed.

        Raises
        ------
        AveragingError
            It was not reached, or the rest's norm is not below what it is to be below.
        """
        left, found = rest.ravel().astype(float), np.zeros(rest.size)
        if np.linalg.norm(left) < below:
            if self._count:
                self._take(left, found, slice(0, self._count))
            for _ in range(MOST_SOUGHT):
                size = np.linalg.norm(left)
                if size <= allowed:
                    return found.reshape(rest.shape)
                kept = left.astype(KEPT).reshape(rest.shape)
                if not np.isfinite(size) or not self.extend(self._near(kept)):
                    break
                self._take(left, found, slice(self._count - 1, self._count))
                if np.linalg.norm(left) > POOR_DIRECTION_REST * size:
                    self._near = _itself
        raise AveragingError(
            "the stationary density was not reached: raise the tolerance, or simulate"
        )

    def _take(self, left, found, which):
        """Take off what some directions reach of what is left."""
        along = self._changes[which] @ left.astype(KEPT)
        left -= along @ self._changes[which]
        found += along @ self._directions[which]

    def extend(self, new: np.ndarray) -> bool:
        """Learn one more direction; False if it tells nothing new."""
        if self._directions.size == 0:
            held = int(LARGEST_BASIS / (2 * BYTES * new.size))
            shape = max(1, min(MOST_DIRECTIONS, held)), new.size
            # Pages of these that are never written are never taken.
            self._directions, self._changes = (np.empty(shape, KEPT) for _ in range(2))
        if self._count == len(self._changes):
            self._count = 0
        n = self._count
        change = self._change(new).ravel()
        whole = np.linalg.norm(change)
        along = np.zeros(n, KEPT)
        for _ in range(2):  # the second time takes off what rounding left
            part = self._changes[:n] @ change.astype(KEPT)
            change -= part @ self._changes[:n]
            along += part
        new = new.ravel() - along @ self._directions[:n]
        size = np.linalg.norm(change)
        if not size > SMALLEST_NEW_PART * whole:
            return False
        self._changes[n], self._directions[n] = change / size, new / size
        self._count = n + 1
        return True


def _itself(rest):
    return rest
