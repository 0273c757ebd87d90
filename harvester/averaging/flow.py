"""Flow of a grid's nodes in one step at fixed charge Z and noise η, and sharing of their mass.

The paths are integrated by the Dormand–Prince method of order five, each with its own steps, so
that a short contact slows only the paths in contact. The mass that arrives between nodes is shared
among six by six of them, so that its moments up to the fifth are preserved.
"""

from typing import NamedTuple

import numpy as np
from llvmlite import ir
from scipy.integrate import RK45

from harvester.base.compilation import compiled, inlined, intrinsic, summing, types
from harvester.base.errors import AveragingError
from harvester.device import system
from harvester.device.system import System

NEIGHBOURS = 6
# Number of neighbouring nodes of X' that receive their shares in one vector operation.
LANES = 8
# Largest local error of a step along a path, as a share of the greatest displacement and speed.
PATH_TOLERANCE = 1e-6
# Most steps per path, on average over all paths.
MOST_TRIALS = 250
# Largest number of steps of all paths together; they take about seven seconds.
MOST_OF_ALL_PATHS = 4e7
# Every eighth node of X and of X' starts a trial path, from which the work of all is estimated.
SAMPLED = 8
SAFETY, SHRINK, GROWTH = 0.9, 0.2, 5.0
# Dormand and Prince's method: the weights of the stages before each one, and the difference between
# the weights of order five and order four, which estimates the error.
STAGES, OFF = np.vstack([np.pad(RK45.A, ((0, 0), (0, 1))), RK45.B]), RK45.E


class PhaseGrid(NamedTuple):
    """The nodes of a grid, and the time step, of a propagator.

    Attributes
    ----------
    x, v
        Evenly spaced displacements and velocities.
    z
        Nodes of Z = X − V, ascending; a single node for a transducer without a state.
    mirrored : bool
        Only the upper half of `z` is stored: the lower half is its mirror image under
        (X, X', Z, η) → −(X, X', Z, η). All nodes are then symmetric about 0.
    modes : Hermite functions of η; one for white noise.
    step
        Time step (s).
    """

    x: np.ndarray
    v: np.ndarray
    z: np.ndarray
    mirrored: bool
    modes: int
    step: float

    @property
    def kept(self) -> np.ndarray:
        """Stored nodes of Z."""
        return self.z[len(self.z) // 2 :] if self.mirrored else self.z

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """The shape of a state: nodes of X and Z, Hermite functions of η, nodes of X'."""
        return len(self.x), len(self.kept), self.modes, len(self.v)

    @property
    def push_bytes(self) -> int:
        """Bytes of the noise's matrices for whole and half steps, including temporary memory."""
        complex_matrices = 4 * len(self.x) * (len(self.v) // 2 + 1) * self.modes**2
        return 16 * complex_matrices


def shared_ends(device: System, grid: PhaseGrid) -> tuple[np.ndarray, ...]:
    """Nodes around the end of each node's path after a step, and the shares of the node's mass that
    they receive; for `shared`.

    Returns
    -------
    tuple of ndarray
        First nodes of X (X, stored Z, X') and shares (X, stored Z, X', nodes); the same of X'.

    Raises
    ------
    AveragingError
        A contact is so short, or a spring so stiff, that the paths need too many steps.
    """
    nodes = len(grid.x) * len(grid.kept) * len(grid.v)
    most = min(MOST_TRIALS, MOST_OF_ALL_PATHS / nodes)
    for part in (grid._replace(x=grid.x[::SAMPLED], v=grid.v[::SAMPLED]), grid):
        ends = [np.empty((len(part.x), len(part.kept), len(part.v))) for _ in range(2)]
        if not _ends(device, part.x, part.kept, part.v, part.step, most, *ends):
            raise AveragingError(
                "contacts or spring are so stiff that fokker_planck would need too many steps: "
                "soften them, or simulate"
            )
    return *_neighbours(ends[0], grid.x, NEIGHBOURS), *_neighbours(ends[1], grid.v, LANES)


def shared(state: np.ndarray, ends: tuple[np.ndarray, ...]) -> np.ndarray:
    """The state one step later: each node's mass is shared among the nodes at its path's end."""
    state = np.ascontiguousarray(state, dtype=ends[1].dtype)
    moved = np.zeros_like(state)
    _share(state, *ends, moved)
    return moved


@inlined
def _acceleration(s, x, v, z):
    return system.push(s, x, v, x - z, 0.0) - system.contact_force(s, x, v, 0.0, x, x)


@compiled
def _ends(s, x, z, v, time, most, end_x, end_v):
    """Fill in X and X' of each node's path after this time; False if a path needs more steps."""
    trials, most = 0.0, most * x.size * z.size * v.size
    least_x, least_v = PATH_TOLERANCE * np.abs(x).max(), PATH_TOLERANCE * np.abs(v).max()
    speeds, pushes = np.empty(OFF.size), np.empty(OFF.size)
    for i in range(x.size):
        for j in range(z.size):
            length = time
            for k in range(v.size):
                path_x, left = x[i], time
                speeds[0], pushes[0] = v[k], _acceleration(s, path_x, v[k], z[j])
                while left > 0.0:
                    h = min(length, left)
                    stage_x, off_x, off_v = path_x, h * OFF[0] * speeds[0], h * OFF[0] * pushes[0]
                    for n in range(1, OFF.size):
                        stage_x, speed = path_x, speeds[0]
                        for m in range(n):
                            stage_x += h * STAGES[n, m] * speeds[m]
                            speed += h * STAGES[n, m] * pushes[m]
                        speeds[n], pushes[n] = speed, _acceleration(s, stage_x, speed, z[j])
                        off_x += h * OFF[n] * speeds[n]
                        off_v += h * OFF[n] * pushes[n]
                    off = max(abs(off_x) / least_x, abs(off_v) / least_v, 1e-10)
                    change = min(max(SAFETY * off**-0.2, SHRINK), GROWTH)
                    if off <= 1.0:
                        # The last stage is at the end.
                        path_x, speeds[0], pushes[0] = stage_x, speeds[-1], pushes[-1]
                        left -= h
                    # A step shortened only by the end of the interval does not limit the next one.
                    if off > 1.0 or h == length or change < 1.0:
                        length = h * change
                    trials += 1.0
                    if trials > most:
                        return False
                end_x[i, j, k], end_v[i, j, k] = path_x, speeds[0]
    return True


def _neighbours(places, nodes, width):
    """Index of the first node around each position, and the shares of mass of all nodes around it.

    Six nodes share the mass by Lagrange's weights, the others receive none. Mass beyond the last
    node stays at that node.
    """
    position = np.clip((places - nodes[0]) / (nodes[1] - nodes[0]), 0.0, nodes.size - 1.0)
    neighbour = np.clip(position.astype(np.int32) - 2, 0, nodes.size - NEIGHBOURS)
    first = np.minimum(neighbour, nodes.size - width).astype(np.int32)
    shares = np.zeros((*places.shape, width))
    lanes = (neighbour - first)[..., None] + np.arange(NEIGHBOURS)
    np.put_along_axis(shares, lanes, lagrange(position - neighbour, np.arange(6.0)), axis=-1)
    return first, shares


@compiled
def lagrange(places: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Lagrange's weights that share a mass at each point among all nodes: (..., nodes)."""
    weights = np.ones((places.size, nodes.size))
    for n, position in enumerate(places.flat):
        for node in range(nodes.size):
            for other in range(nodes.size):
                if other != node:
                    weights[n, node] *= (position - nodes[other]) / (nodes[node] - nodes[other])
    return weights.reshape((*places.shape, nodes.size))


@intrinsic
def _add_multiple(typingctx, target, to_index, factor, source, from_index):
    """target[to_index + n] += factor · source[from_index + n] for all lanes n, at once."""

    def generate(context, builder, signature, arguments):
        to, target_index, factor, of, source_index = arguments
        number = context.get_value_type(target.dtype)
        lanes = ir.VectorType(number, LANES)
        bytes_apart = context.get_abi_sizeof(number)

        def place(array, kind, index):
            first = builder.gep(context.make_array(kind)(context, builder, array).data, [index])
            return builder.bitcast(first, lanes.as_pointer())

        into = place(to, target, target_index)
        added = builder.load(place(of, source, source_index), align=bytes_apart)
        held = builder.load(into, align=bytes_apart)
        one = builder.insert_element(ir.Constant(lanes, ir.Undefined), factor, ir.IntType(32)(0))
        every = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        factors = builder.shuffle_vector(one, one, every)
        product = builder.fmul(factors, added, flags=("contract",))
        total = builder.fadd(held, product, flags=("contract",))
        builder.store(total, into, align=bytes_apart)
        return context.get_dummy_value()

    return types.void(target, to_index, factor, source, from_index), generate


@summing
def _share(state, first_x, by_x, first_v, by_v, moved):
    """Distribute each node's mass to `moved`, layer by layer so that a layer stays in the cache."""
    rows, layers, modes, columns = state.shape
    # Flat arrays and unsigned indices avoid the checks for negative indices.
    source, target = state.reshape(-1), moved.reshape(-1)
    to_x, to_v = first_x.reshape(-1), first_v.reshape(-1)
    share_x, share_v = by_x.reshape(-1), by_v.reshape(-1)
    plane = np.uint64(modes * columns)
    row = np.uint64(layers) * plane
    for layer in range(layers):
        for x in range(rows):
            line = np.uint64(x * layers + layer)
            for v in range(columns):
                node = line * np.uint64(columns) + np.uint64(v)
                start = np.uint64(to_x[node]) * row + np.uint64(layer) * plane
                for mode in range(modes):
                    offset = np.uint64(mode * columns)
                    amount = source[line * plane + offset + np.uint64(v)]
                    target_node = start + offset + np.uint64(to_v[node])
                    for n in range(NEIGHBOURS):
                        share = amount * share_x[np.uint64(NEIGHBOURS) * node + np.uint64(n)]
                        _add_multiple(target, target_node, share, share_v, np.uint64(LANES) * node)
                        target_node += row
