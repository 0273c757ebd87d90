"""One step of the Fokker–Planck equation of (X, X', Z, η) on a grid, Z = X − V.

A step is the flow of the device at constant Z and η, followed by the changes of Z and η:

- flow: the mass of each node moves along the node's path, and is shared at its end (`flow`);
- Z' = λ(X − Z): likewise along Z, among all Gauss–Legendre nodes of Z. Every moment of Z that the
  nodes represent moves exactly;
- η' = −η/τ1 + noise with X'' = η: exactly, for each wave number of X' by Hermite functions of η.

Half steps of the second and third kind, which commute, come first and last (Strang), so that the
error is of second order in the step. The main error is that noise acts as one impulse per step: the
spectrum of this impulse train differs from the spectrum of η. A factor at each X therefore corrects
it at the frequency √U''(X).
"""

from __future__ import annotations

from copy import copy

import numpy as np
from scipy.fft import irfft, rfft
from scipy.special import factorial

from harvester.averaging.flow import PhaseGrid, lagrange, shared, shared_ends
from harvester.base.compilation import summing
from harvester.device.system import elastic_force, state_rate

# A correlation time τ1 of fewer steps than this gives the same numbers as this number of steps.
LEAST_MEMORY = 1e-6
# The correction of the impulses' spectrum is constant above this ω dt.
FASTEST_PHASE = 1.5


class Propagator:
    """Moves a state, the mass at each node, by one time step."""

    def __init__(self, device, grid):
        self.grid, self._parity = grid, 1.0
        self._ends = shared_ends(device, grid)
        self._whole, self._half = (
            (_drift(device, grid, part * grid.step), _noise(device, grid, part))
            for part in (1.0, 0.5)
        )

    def single(self) -> Propagator:
        """A copy of this propagator in single precision."""
        other = copy(self)
        for name in ("_ends", "_whole", "_half"):
            setattr(other, name, tuple(_single(array) for array in getattr(self, name)))
        return other

    def odd(self) -> Propagator:
        """A copy for states that change sign from one half of a mirrored grid to the other."""
        other = copy(self)
        other._parity = -1.0
        return other

    def step(self, state: np.ndarray) -> np.ndarray:
        """The state one step later: first the flow, then load and noise."""
        return self.pushed(self.flowed(state))

    def flowed(self, state: np.ndarray) -> np.ndarray:
        """The state moved by the flow alone for a step, without load and noise."""
        return shared(state, self._ends)

    def pushed(self, state: np.ndarray) -> np.ndarray:
        """The state moved by load and noise alone for a step, without the flow."""
        return self._slow(state, *self._whole)

    def repeated(self, state: np.ndarray, steps: int) -> np.ndarray:
        """Return the state after `steps` steps; it begins and ends half-way between two flows."""
        state = self.before_flow(state)
        for _ in range(steps - 1):
            state = self.step(state)
        return self._slow(self.flowed(state), *self._half)

    def before_flow(self, state: np.ndarray) -> np.ndarray:
        """The state just before the flow, from one half-way between two flows.

        A step that begins and ends half-way is symmetric in time.
        """
        return self._slow(state, *self._half)

    def _slow(self, state, drift, noise):
        state = state.astype(drift.dtype, copy=False)
        state = whole(state, self.grid, self._parity)
        rows, layers, modes, columns = state.shape
        state = drift @ state.reshape(rows, layers, modes * columns)
        waves = rfft(state.reshape(self.grid.shape))
        mixed = np.zeros_like(waves)
        _mix(noise, waves, mixed)
        return irfft(mixed, n=columns)


def _single(array):
    precisions = {"f": np.float32, "c": np.complex64}
    return array.astype(precisions.get(array.dtype.kind, array.dtype))


def mirrored(state: np.ndarray) -> np.ndarray:
    """Mirror image of a state: its values at −(X, X', Z, η), with layers of Z ascending."""
    signs = (-1.0) ** np.arange(state.shape[2])
    return (state * signs[:, None].astype(state.dtype))[::-1, ::-1, :, ::-1]


def whole(state: np.ndarray, grid: PhaseGrid, parity: float = 1.0) -> np.ndarray:
    """The state at all nodes of Z, including those that are not stored."""
    if not grid.mirrored:
        return state
    return np.concatenate([parity * mirrored(state), state], axis=1)


def _drift(device, grid, time):
    """Matrices (X, kept Z, all Z) of Z' = λ(X − Z) over this time."""
    # V' = X' − λV, and so Z' = λ(X − Z).
    rate = -state_rate(device.transducer, 0.0, 1.0)
    ends = grid.x[:, None] + (grid.z - grid.x[:, None]) * np.exp(-rate * time)
    shares = lagrange(ends, grid.z)[:, :, -len(grid.kept) :]
    return np.ascontiguousarray(np.swapaxes(shares, 1, 2))


@summing
def _mix(matrices, waves, mixed):
    rows, layers, modes, numbers = waves.shape
    for i in range(rows):
        for j in range(layers):
            for n in range(modes):
                for m in range(modes):
                    for k in range(numbers):
                        mixed[i, j, n, k] += matrices[i, n, m, k] * waves[i, j, m, k]


def _noise(device, grid, share):
    """Matrices (X, modes, modes, wave numbers k of X') of X'' = η over this share of a step.

    In the ladder operators of the Hermite functions the generator is −a†a/τ1 − ikσ(a + a†),
    σ² = D/τ1, and its exponential, with s the time over τ1 and α = −ikστ1(1 − exp(−s)),

        exp(−k² Dτ1 (s − 1 + exp(−s))) exp(αa†) exp(−s a†a) exp(αa).
    """
    intensity, memory = device.noise
    memory = max(memory, LEAST_MEMORY * grid.step)
    passed = share * grid.step / memory
    wave = 2.0 * np.pi * np.fft.rfftfreq(grid.v.size, grid.v[1] - grid.v[0])
    push = np.sqrt(intensity * memory) * _strength(device, grid, memory)[:, None] * wave
    forgotten = -np.expm1(-passed)
    raising = _raising(-1j * push * forgotten, grid.modes)
    memories = np.exp(-passed * np.arange(grid.modes))
    spread = np.exp(-(push**2) * (passed - forgotten))
    mixing = spread[..., None, None] * (raising * memories) @ np.swapaxes(raising, -1, -2)
    return np.ascontiguousarray(np.moveaxis(mixing, 1, -1))


def _raising(alpha, modes):
    """Matrices exp(αa†): √(n!/m!) α^(n − m)/(n − m)! in row n, column m ≤ n."""
    row, column = np.tril_indices(modes)
    factor = np.sqrt(factorial(row) / factorial(column)) / factorial(row - column)
    matrix = np.zeros((*alpha.shape, modes, modes), dtype=complex)
    matrix[..., row, column] = factor * alpha[..., None] ** (row - column)
    return matrix


def _strength(device, grid, memory):
    """Factor that gives the impulses at each X the spectrum of η at the frequency √U''(X).

    An impulse is the integral of η over a step dt. The spectrum of the impulse train, with a =
    exp(−dt/τ1), θ = ω dt, is 2Dτ1 {dt/τ1 − 1 + a + (1 − a)² (cos θ − a)/(1 − 2a cos θ + a²)} a
    step, and the spectrum of η is 2D dt/(1 + ω²τ1²).
    """
    narrow = 1e-4 * (grid.x[1] - grid.x[0])
    slope = elastic_force(device, grid.x + narrow) - elastic_force(device, grid.x - narrow)
    square = slope / (2.0 * narrow) + getattr(device.transducer, "coupling", 0.0)
    limit = FASTEST_PHASE / grid.step
    square = np.clip(square, -(limit**2), limit**2)
    cosine = np.real(np.cos(grid.step * np.sqrt(square.astype(complex))))
    ratio, decay = grid.step / memory, np.exp(-grid.step / memory)
    remembered = (1.0 - decay) ** 2 * (cosine - decay) / (1.0 - 2.0 * decay * cosine + decay**2)
    train = ratio - 1.0 + decay + remembered
    return np.sqrt(ratio / (1.0 + square * memory**2) / train)
