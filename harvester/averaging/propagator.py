"""One step of the Fokker–Planck equation of (X, X', Z, η) on a grid, Z = X − V.

A step is the flow of the device with Z and η held, and then what moves Z and η:

- flow: the mass of each node goes where the node goes, and is shared there among six nodes in X
  and in X', such that the moments up to the fifth arrive as they are;
- Z' = λ(X − Z): the same along Z, among all its nodes, which are those of Gauss and Legendre.
  Every moment of Z that they tell moves as it should;
- η' = −η/τ1 + noise with X'' = η: exactly, for each wave number of X' by Hermite functions of η.

Halves of the second and third step, which commute, stand at either end (Strang), so that the error
is of second order in the step. Its greatest part is that the noise pushes once a step: at angular
frequency ω that train of pushes has another spectrum than η. It is therefore strengthened, at each
X, by as much as its spectrum lacks at the frequency √U''(X).
"""

from typing import NamedTuple

import numpy as np
from scipy.fft import irfft, rfft
from scipy.sparse import csr_array
from scipy.special import factorial

from harvester.averaging.symmetric import contact_damping, contact_time, restoring_force
from harvester.errors import AveragingError

NEIGHBOURS = 6
SUBSTEPS_PER_PERIOD, SUBSTEPS_PER_CONTACT = 120, 12  # of Runge–Kutta, along the flow
MOST_SUBSTEPS = 2000
LEAST_MEMORY = 1e-3  # τ1, in steps, below which noise is white
FASTEST_PHASE = 1.5  # ω dt beyond which a train of pushes is not corrected further


class Grid(NamedTuple):
    """Nodes of a propagator.

    Attributes
    ----------
    x, v : ndarray
        Evenly spaced displacements and velocities, either symmetric or, of x, within one well.
    z : ndarray
        Nodes of Z, ascending.
    mirrored : bool
        Only the upper half of `z` is kept: (X, X', Z, η) → −(X, X', Z, η) tells the other.
    modes : int
        Hermite functions of η.
    step : float
        Time step (s).
    """

    x: np.ndarray
    v: np.ndarray
    z: np.ndarray
    mirrored: bool
    modes: int
    step: float

    @property
    def kept(self):
        """Nodes of Z that are kept."""
        return self.z[len(self.z) // 2 :] if self.mirrored else self.z

    @property
    def shape(self):
        """Of a state: nodes of Z, X and X', Hermite functions of η."""
        return len(self.kept), len(self.x), len(self.v), self.modes


class Propagator:
    """Moves a state, the mass at each node, by one time step.

    Parameters
    ----------
    parameters : harvester.averaging.symmetric.SymmetricDevice
    grid : Grid
    """

    def __init__(self, parameters, grid):
        self.grid = grid
        self._flow = [_flow(parameters, grid, z) for z in grid.kept]
        self._whole, self._half = (
            (_drift(parameters, grid, share * grid.step), _noise(parameters, grid, share))
            for share in (1.0, 0.5)
        )

    def step(self, state):
        """The state one step later, before the flow."""
        return self._slow(self.flowed(state), *self._whole)

    def centred(self, state):
        """The state half-way between two flows, where a step is symmetric in time."""
        return self._slow(self.flowed(state), *self._half)

    def flowed(self, state):
        """The state after the flow alone."""
        pairs = zip(self._flow, state, strict=True)
        return np.stack(
            [
                (flow @ layer.reshape(-1, layer.shape[-1])).reshape(layer.shape)
                for flow, layer in pairs
            ]
        )

    def _slow(self, state, drift, noise):
        if self.grid.mirrored:
            state = np.concatenate([mirrored(state), state])
        moved = np.einsum("xij,jxvn->ixvn", drift, state, optimize=True)
        waves = rfft(moved, axis=2)
        waves = (noise @ waves[..., None])[..., 0]
        return irfft(waves, n=state.shape[2], axis=2)


def mirrored(state):
    """The state at −(X, X', Z, η), its layers of Z ascending."""
    return (state * (-1.0) ** np.arange(state.shape[-1]))[::-1, ::-1, ::-1]


def shares(places, nodes):
    """Lagrange weights, of shape (nodes, ...), by which a mass at each place is shared."""
    weights = []
    for node in nodes:
        others = nodes[nodes != node]
        apart = (places[..., None] - others) / (node - others)
        weights.append(np.prod(apart, axis=-1))
    return np.stack(weights)


def _flow(p, grid, z):
    """Sparse matrix from the masses at the nodes of X and X' to those one step later."""
    x, v = np.meshgrid(grid.x, grid.v, indexing="ij")
    end = _integrated(p, x, v, z, grid.step)
    (rows, by_x), (columns, by_v) = (
        _neighbours(place.ravel(), nodes)
        for place, nodes in zip(end, (grid.x, grid.v), strict=True)
    )
    target = rows[:, None] * grid.v.size + columns[None, :]
    weight = by_x[:, None] * by_v[None, :]
    source = np.broadcast_to(np.arange(x.size), target.shape)
    entries = weight.ravel(), (target.ravel(), source.ravel())
    return csr_array(entries, shape=(x.size, x.size))


def _neighbours(place, nodes):
    """Indices and weights, (6, places), of the nodes about each place; the last ones beyond."""
    position = (place - nodes[0]) / (nodes[1] - nodes[0])
    position = np.clip(position, 0.0, nodes.size - 1.0)
    first = np.clip(np.floor(position).astype(int) - 2, 0, nodes.size - NEIGHBOURS)
    stencil = np.arange(NEIGHBOURS)
    return first + stencil[:, None], shares(position - first, stencil.astype(float))


def _integrated(p, x, v, z, time):
    """Displacements and velocities after this time, by Runge–Kutta of order four."""
    fastest = 2.0 * np.pi / p.angular_frequency / SUBSTEPS_PER_PERIOD
    if p.has_stoppers:
        fastest = min(fastest, contact_time(p, np.abs(v).max()) / SUBSTEPS_PER_CONTACT)
    steps = int(np.ceil(time / fastest))
    if steps > MOST_SUBSTEPS:
        raise AveragingError(
            f"stoppers.stiffness={p.contact_stiffness:g} is too stiff for fokker_planck: use "
            "slow_load, or simulate"
        )
    h = time / steps
    for _ in range(steps):
        k1, a1 = v, _acceleration(p, x, v, z)
        k2, a2 = v + 0.5 * h * a1, _acceleration(p, x + 0.5 * h * k1, v + 0.5 * h * a1, z)
        k3, a3 = v + 0.5 * h * a2, _acceleration(p, x + 0.5 * h * k2, v + 0.5 * h * a2, z)
        k4, a4 = v + h * a3, _acceleration(p, x + h * k3, v + h * a3, z)
        x, v = x + h / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4), v + h / 6.0 * (a1 + 2 * a2 + 2 * a3 + a4)
    return x, v


def _acceleration(p, x, v, z):
    damping = p.damping + (contact_damping(p, x, v, 0.0) if p.has_stoppers else 0.0)
    return -restoring_force(p, x) - p.coupling * (x - z) - damping * v


def _drift(p, grid, time):
    """Matrices (X, kept Z, all Z) of Z' = λ(X − Z) over this time."""
    ends = grid.x[:, None] + (grid.z - grid.x[:, None]) * np.exp(-p.decay_rate * time)
    weights = np.moveaxis(shares(ends, grid.z), 0, 1)
    return weights[:, len(grid.z) - len(grid.kept) :]


def _noise(p, grid, share):
    """Matrices (X, wave numbers k of X', modes, modes) of X'' = η over this share of a step.

    In the ladder operators of the Hermite functions the generator is −a†a/τ1 − ikσ(a + a†),
    σ² = D/τ1, and its exponential, with s the time over τ1 and α = −ikστ1(1 − exp(−s)),

        exp(−k² Dτ1 (s − 1 + exp(−s))) exp(αa†) exp(−s a†a) exp(αa).
    """
    memory = max(p.correlation_time, LEAST_MEMORY * grid.step)
    passed = share * grid.step / memory
    wave = 2.0 * np.pi * np.fft.rfftfreq(grid.v.size, grid.v[1] - grid.v[0])
    push = np.sqrt(p.intensity * memory) * _strength(p, grid, memory)[:, None] * wave
    forgotten = -np.expm1(-passed)
    raising = _raising(-1j * push * forgotten, grid.modes)
    kept = np.exp(-passed * np.arange(grid.modes))
    spread = np.exp(-(push**2) * (passed - forgotten))
    return spread[..., None, None] * (raising * kept) @ np.swapaxes(raising, -1, -2)


def _raising(alpha, modes):
    """Matrices exp(αa†): √(n!/m!) α^(n − m)/(n − m)! in row n, column m ≤ n."""
    row, column = np.tril_indices(modes)
    factor = np.sqrt(factorial(row) / factorial(column)) / factorial(row - column)
    matrix = np.zeros((*alpha.shape, modes, modes), dtype=complex)
    matrix[..., row, column] = factor * alpha[..., None] ** (row - column)
    return matrix


def _strength(p, grid, memory):
    """Factor of the pushes at each X by which their spectrum at √U''(X) is that of η.

    A push is the integral of η over a step dt. Of their train, with a = exp(−dt/τ1), θ = ω dt,
    the spectrum is 2Dτ1 {dt/τ1 − 1 + a + (1 − a)² (cos θ − a)/(1 − 2a cos θ + a²)} a step, and
    that of η 2D dt/(1 + ω²τ1²).
    """
    narrow = 1e-4 * (grid.x[1] - grid.x[0])
    slope = restoring_force(p, grid.x + narrow) - restoring_force(p, grid.x - narrow)
    square = slope / (2.0 * narrow) + p.coupling
    limit = FASTEST_PHASE / grid.step
    square = np.clip(square, -(limit**2), limit**2)
    cosine = np.real(np.cos(grid.step * np.sqrt(square.astype(complex))))
    ratio, kept = grid.step / memory, np.exp(-grid.step / memory)
    remembered = (1.0 - kept) ** 2 * (cosine - kept) / (1.0 - 2.0 * kept * cosine + kept**2)
    train = ratio - 1.0 + kept + remembered
    return np.sqrt(ratio / (1.0 + square * memory**2) / train)
