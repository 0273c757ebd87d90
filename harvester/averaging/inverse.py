"""Solves linear equations of a map of states on a grid, preconditioned by a coarser grid."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import make_interp_spline

from harvester.averaging.flow import PhaseGrid, lagrange
from harvester.averaging.propagator import whole
from harvester.base.errors import AveragingError

Map = Callable[[np.ndarray], np.ndarray]

# Largest memory of the search directions, in bytes: a large state allows fewer of them.
LARGEST_BASIS = 2e8
# Largest number of stored search directions.
MOST_DIRECTIONS = 150
# Largest number of new search directions for one solution.
MOST_SOUGHT = 400
# If a search direction leaves more than this share of the residual, new directions no longer
# contain the coarser grid's solution.
POOR_DIRECTION_REST = 0.9
# Number type of the stored search directions, and its size in bytes. The directions' images under
# the equation have the same precision, so that rounding does no harm.
KEPT, BYTES = np.float32, 4
# If less than this share of a search direction is independent of the others, the iteration ends.
SMALLEST_NEW_PART = 1e-6
# A residual is recomputed once it has fallen to this share. Stored directions have single
# precision, which limits the reduction without recomputing.
REDUCTION_IN_ONE_GO = 3e-3
# The coarser grid's solution is accurate enough when this share of the residual is left.
SUFFICIENT_REDUCTION = 0.1


class Inverse:
    """Solves decayed · x − later(x) = rest by generalised conjugate residuals with stored search
    directions.

    Each direction's image is orthogonal to all earlier ones, so that stored directions also serve
    further right-hand sides (Eisenstat, Elman and Schultz 1983). A new direction is the residual
    plus the coarser grid's solution for it.

    Parameters
    ----------
    later
        Linear map of states on the grid.
    coarser
        `Inverse` on a coarser grid.
    balanced
        Removes the error that arises as a residual moves from a finer grid to this one.
    cleared
        Removes the part whose errors on this grid are too large to pass to a finer one.
    decayed : float
        Factor of x in the equation: the share of the state that remains after one application of
        the map.
    parity
        −1 for states that change sign from one half of a mirrored grid to the other.

    Attributes
    ----------
    allowed
        Largest norm of the final residual.
    """

    def __init__(
        self,
        grid: PhaseGrid,
        later: Map,
        coarser: Inverse | None = None,
        balanced: Map | None = None,
        cleared: Map | None = None,
        decayed: float = 1.0,
        parity: float = 1.0,
    ) -> None:
        self._grid, self._later, self._coarser = grid, later, coarser
        self._balanced, self._cleared = balanced, cleared
        self._decayed, self._parity = decayed, parity
        self._count, self.allowed = 0, 0.0
        self._directions = self._changes = np.empty((0, 0), KEPT)

    def settled(self, state: np.ndarray, left: Map, allowed: float | np.floating) -> np.ndarray:
        """Improve a state until its residual, computed by `left` in full precision, is small
        enough.

        Raises AveragingError if the limit is not reached.
        """
        self.allowed = float(allowed)
        size = enough = np.inf
        while enough > self.allowed:
            residual = left(state)
            before, size = size, float(np.linalg.norm(residual))
            enough = max(self.allowed, REDUCTION_IN_ONE_GO * size)
            # Outer nodes of Z have large weights and magnify rounding errors.
            state = state + self(residual, enough, before)
        return state

    def __call__(self, rest: np.ndarray, allowed: float, below: float = np.inf) -> np.ndarray:
        """Solve for x until the residual for this right-hand side is within the limit.

        Raises AveragingError: the iteration did not converge, or the norm of `rest` is not less
        than `below`.
        """
        left, solution = rest.ravel().astype(float), np.zeros(rest.size)
        if np.linalg.norm(left) < below:
            if self._count:
                self._take(left, solution, slice(0, self._count))
            for _ in range(MOST_SOUGHT):
                size = np.linalg.norm(left)
                if size <= allowed:
                    return solution.reshape(rest.shape)
                residual = left.astype(KEPT).reshape(rest.shape)
                if not np.isfinite(size) or not self.extend(self._near(residual)):
                    break
                self._take(left, solution, slice(self._count - 1, self._count))
                if np.linalg.norm(left) > POOR_DIRECTION_REST * size:
                    self._coarser = None
        raise AveragingError(
            "the iteration for the stationary density did not converge: raise the tolerance, or "
            "simulate"
        )

    def _take(self, left, solution, selected):
        """Project a residual `left` onto some directions; add their part to `solution` in place."""
        along = self._changes[selected] @ left.astype(KEPT)
        left -= along @ self._changes[selected]
        solution += along @ self._directions[selected]

    def _near(self, rest):
        """Preconditioner: an approximate solution for a residual, from the coarser grid."""
        coarser = self._coarser
        if coarser is None:
            return rest
        parity = self._parity
        smooth = coarser._later(moved(rest, self._grid, coarser._grid, parity))
        if coarser._balanced:
            smooth = coarser._balanced(smooth)
        enough = max(SUFFICIENT_REDUCTION * float(np.linalg.norm(smooth)), coarser.allowed)
        correction = coarser(smooth, enough)
        if coarser._cleared:
            correction = coarser._cleared(correction)
        return (rest + moved(correction, coarser._grid, self._grid, parity)) / self._decayed

    def extend(self, new: np.ndarray) -> bool:
        """Add a search direction, orthogonalised; False if it depends on the earlier ones."""
        if self._directions.size == 0:
            held = int(LARGEST_BASIS / (2 * BYTES * new.size))
            shape = max(1, min(MOST_DIRECTIONS, held)), new.size
            # The operating system allocates only pages that are written.
            self._directions, self._changes = (np.empty(shape, KEPT) for _ in range(2))
        if self._count == len(self._changes):
            self._count = 0
        n = self._count
        change = (self._decayed * new - self._later(new)).ravel()
        full_norm = np.linalg.norm(change)
        along = np.zeros(n, KEPT)
        for _ in range(2):  # the second pass removes the rounding error of the first
            part = self._changes[:n] @ change.astype(KEPT)
            change -= part @ self._changes[:n]
            along += part
        new = new.ravel() - along @ self._directions[:n]
        size = np.linalg.norm(change)
        if not size > SMALLEST_NEW_PART * full_norm:
            return False
        self._changes[n], self._directions[n] = change / size, new / size
        self._count = n + 1
        return True


def moved(state: np.ndarray, old: PhaseGrid, new: PhaseGrid, parity: float = 1.0) -> np.ndarray:
    """A state on the nodes of another grid, with the same moments of Z and density in X and X'."""
    across = lagrange(np.clip(old.z, new.z[0], new.z[-1]), new.z)[:, -len(new.kept) :]
    state = np.einsum("ji,xjmv->ximv", across, whole(state, old, parity))
    modes = min(old.modes, new.modes)
    along_v = state[:, :, :modes] @ _interpolation(old.v, new.v).T
    answer = np.zeros(new.shape)
    answer[:, :, :modes] = np.tensordot(_interpolation(old.x, new.x), along_v, 1)
    return answer


def _interpolation(old, new):
    """Matrix from probabilities at nodes `old` to nodes `new`, by cubic splines; 0 outside."""
    cells = (new[1] - new[0]) / (old[1] - old[0])
    inside = (new >= old[0]) & (new <= old[-1])
    return cells * inside[:, None] * make_interp_spline(old, np.eye(old.size))(new)
