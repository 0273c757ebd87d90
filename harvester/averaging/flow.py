"""Where the nodes of a grid go in one step with Z and η held, and how their mass is shared there.

The paths are integrated by the method of Dormand and Prince of order five, each with its own
steps, so that a short contact costs only the paths that touch. The mass that arrives between nodes
is given to six by six of them, such that its moments up to the fifth arrive as they are.
"""

import numpy as np
from llvmlite import ir

from harvester.compilation import compiled, inlined, intrinsic, summing, types
from harvester.device import system
from harvester.errors import AveragingError

NEIGHBOURS = 6
LANES = 8  # nodes of X' in a row that take their shares together, some of them none
PATH_TOLERANCE = 1e-6  # of a step along a path, as a share of the greatest displacement and speed
MOST_TRIALS = 250  # steps along a path, in the mean
SAFETY, SHRINK, GROWTH = 0.9, 0.2, 5.0


class Flow:
    """Moves a state, the mass at each node, along the paths of its nodes.

    Parameters
    ----------
    device : harvester.device.system.System
    grid : harvester.averaging.propagator.Grid
    precision : dtype
        Of the mass and its shares: float32 or float64.

    Raises
    ------
    AveragingError
        A contact so short that its paths take too many steps.
    """

    def __init__(self, device, grid, precision):
        ends = [np.empty((len(grid.x), len(grid.kept), len(grid.v))) for _ in range(2)]
        if not _ends(device, grid.x, grid.kept, grid.v, grid.step, *ends):
            raise AveragingError(
                "contacts or spring are too stiff for the steps that fokker_planck has: soften "
                "them, or simulate"
            )
        self._along_x = _sharing(ends[0], grid.x, NEIGHBOURS, precision)
        self._along_v = _sharing(ends[1], grid.v, LANES, precision)

    def __call__(self, state):
        """The state one step later."""
        moved = np.zeros_like(state)
        _share(np.ascontiguousarray(state), *self._along_x, *self._along_v, moved)
        return moved


@inlined
def _acceleration(s, x, v, z):
    return system.push(s, x, v, x - z, 0.0) - system.contact_force(s, x, v, 0.0, x, x)


@inlined
def _trial(s, x, v, z, a1, h):
    """X, X' and X'' after a step h of order five, and what order four has else."""
    v2 = v + h * a1 / 5.0
    a2 = _acceleration(s, x + h * v / 5.0, v2, z)
    v3 = v + h * (3.0 * a1 + 9.0 * a2) / 40.0
    a3 = _acceleration(s, x + h * (3.0 * v + 9.0 * v2) / 40.0, v3, z)
    v4 = v + h * (44.0 / 45.0 * a1 - 56.0 / 15.0 * a2 + 32.0 / 9.0 * a3)
    a4 = _acceleration(s, x + h * (44.0 / 45.0 * v - 56.0 / 15.0 * v2 + 32.0 / 9.0 * v3), v4, z)
    p1, p2, p3, p4 = 19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0
    v5 = v + h * (p1 * a1 + p2 * a2 + p3 * a3 + p4 * a4)
    a5 = _acceleration(s, x + h * (p1 * v + p2 * v2 + p3 * v3 + p4 * v4), v5, z)
    q1, q2, q3, q4 = 9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0
    q5 = -5103.0 / 18656.0
    v6 = v + h * (q1 * a1 + q2 * a2 + q3 * a3 + q4 * a4 + q5 * a5)
    a6 = _acceleration(s, x + h * (q1 * v + q2 * v2 + q3 * v3 + q4 * v4 + q5 * v5), v6, z)
    r1, r3, r4, r5, r6 = 35.0 / 384.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0
    x7 = x + h * (r1 * v + r3 * v3 + r4 * v4 + r5 * v5 + r6 * v6)
    v7 = v + h * (r1 * a1 + r3 * a3 + r4 * a4 + r5 * a5 + r6 * a6)
    a7 = _acceleration(s, x7, v7, z)
    e1, e3, e4 = 71.0 / 57600.0, -71.0 / 16695.0, 71.0 / 1920.0
    e5, e6, e7 = -17253.0 / 339200.0, 22.0 / 525.0, -1.0 / 40.0
    off_x = h * (e1 * v + e3 * v3 + e4 * v4 + e5 * v5 + e6 * v6 + e7 * v7)
    off_v = h * (e1 * a1 + e3 * a3 + e4 * a4 + e5 * a5 + e6 * a6 + e7 * a7)
    return x7, v7, a7, off_x, off_v


@compiled
def _ends(s, x, z, v, time, end_x, end_v):
    """Fill in X and X' of each node's path after this time; False if they take too long."""
    trials, most = 0, MOST_TRIALS * x.size * z.size * v.size
    least_x, least_v = PATH_TOLERANCE * np.abs(x).max(), PATH_TOLERANCE * np.abs(v).max()
    for i in range(x.size):
        for j in range(z.size):
            length = time
            for k in range(v.size):
                here, speed, left = x[i], v[k], time
                acceleration = _acceleration(s, here, speed, z[j])
                while left > 0.0:
                    h = min(length, left)
                    x7, v7, a7, off_x, off_v = _trial(s, here, speed, z[j], acceleration, h)
                    off = max(abs(off_x) / least_x, abs(off_v) / least_v, 1e-10)
                    change = min(max(SAFETY * off**-0.2, SHRINK), GROWTH)
                    if off <= 1.0:
                        here, speed, acceleration = x7, v7, a7
                        left -= h
                        if h == length or change < 1.0:
                            length = h * change
                    else:
                        length = h * change
                    trials += 1
                    if trials > most:
                        return False
                end_x[i, j, k], end_v[i, j, k] = here, speed
    return True


def _sharing(places, nodes, width, precision):
    """Index of the first of so many nodes about each place, and their shares of its mass.

    Those of six of them are Lagrange's weights, and none of the others'. Mass beyond the last node
    stays there.
    """
    position = (places - nodes[0]) / (nodes[1] - nodes[0])
    position = np.clip(position, 0.0, nodes.size - 1.0)
    neighbour = np.clip(position.astype(np.int32) - 2, 0, nodes.size - NEIGHBOURS)
    first = np.minimum(neighbour, nodes.size - width).astype(np.int32)
    shares = np.zeros((*places.shape, width), precision)
    _lagrange(position.ravel(), neighbour.ravel(), first.ravel(), shares.reshape(-1, width))
    return first, shares


@compiled
def _lagrange(position, neighbour, first, shares):
    for n in range(position.size):
        place = position[n] - neighbour[n]
        for node in range(NEIGHBOURS):
            weight = 1.0
            for other in range(NEIGHBOURS):
                if other != node:
                    weight *= (place - other) / (node - other)
            shares[n, neighbour[n] - first[n] + node] = weight


@intrinsic
def _add_multiple(typingctx, target, here, factor, source, there):
    """target[here + n] += factor · source[there + n] for all lanes n, at once."""

    def generate(context, builder, signature, arguments):
        to, here, factor, of, there = arguments
        number = context.get_value_type(target.dtype)
        lanes = ir.VectorType(number, LANES)
        bytes_apart = context.get_abi_sizeof(number)

        def place(array, kind, index):
            first = builder.gep(context.make_array(kind)(context, builder, array).data, [index])
            return builder.bitcast(first, lanes.as_pointer())

        into = place(to, target, here)
        added = builder.load(place(of, source, there), align=bytes_apart)
        held = builder.load(into, align=bytes_apart)
        one = builder.insert_element(ir.Constant(lanes, ir.Undefined), factor, ir.IntType(32)(0))
        every = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        factors = builder.shuffle_vector(one, one, every)
        product = builder.fmul(factors, added, flags=("contract",))
        total = builder.fadd(held, product, flags=("contract",))
        builder.store(total, into, align=bytes_apart)
        return context.get_dummy_value()

    return types.void(target, here, factor, source, there), generate


@summing
def _share(state, first_x, by_x, first_v, by_v, moved):
    """Add to `moved` what each node's mass becomes, one layer after the other: it stays at hand."""
    rows, layers, modes, columns = state.shape
    # Flat arrays and unsigned numbers: no index is then checked for being negative.
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
                    here = start + offset + np.uint64(to_v[node])
                    for n in range(NEIGHBOURS):
                        share = amount * share_x[np.uint64(NEIGHBOURS) * node + np.uint64(n)]
                        _add_multiple(target, here, share, share_v, np.uint64(LANES) * node)
                        here += row
