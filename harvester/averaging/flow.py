"""Where the nodes of a grid go in one step with Z and η held, and how their mass is shared there.

The paths are integrated by the method of Dormand and Prince of order five, each with its own
steps, so that a short contact costs only the paths that touch. The mass that arrives between nodes
is given to six by six of them, such that its moments up to the fifth arrive as they are.
"""

import numpy as np

from harvester.compilation import compiled, inlined, summing
from harvester.device import system
from harvester.errors import AveragingError

NEIGHBOURS = 6
PATH_TOLERANCE = 1e-6  # of a step along a path, as a share of the greatest displacement and speed
MOST_TRIALS = 250  # steps along a path, in the mean
SAFETY, SHRINK, GROWTH = 0.9, 0.2, 5.0


class Flow:
    """Moves a state, the mass at each node, along the paths of its nodes.

    Parameters
    ----------
    device : harvester.device.system.System
    grid : harvester.averaging.propagator.Grid

    Raises
    ------
    AveragingError
        A contact so short that its paths take too many steps.
    """

    def __init__(self, device, grid):
        self._shape = grid.shape
        ends = [np.empty((len(grid.x), len(grid.kept), len(grid.v))) for _ in range(2)]
        if not _ends(device, grid.x, grid.kept, grid.v, grid.step, *ends):
            raise AveragingError(
                "contacts or spring are too stiff for the steps that fokker_planck has: soften "
                "them, or simulate"
            )
        self._first, self._weights = zip(
            *(_sharing(end, nodes) for end, nodes in zip(ends, (grid.x, grid.v), strict=True)),
            strict=True,
        )

    def __call__(self, state):
        """The state one step later."""
        moved = np.zeros(self._shape)
        _share(state, *self._first, *self._weights, moved)
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


def _sharing(places, nodes):
    """Index of the first of six nodes about each place, and Lagrange's weights of all six.

    Mass beyond the last node stays there.
    """
    position = (places - nodes[0]) / (nodes[1] - nodes[0])
    position = np.clip(position, 0.0, nodes.size - 1.0)
    first = np.clip(position.astype(np.int32) - 2, 0, nodes.size - NEIGHBOURS).astype(np.int32)
    weights = np.empty((*places.shape, NEIGHBOURS))
    _lagrange((position - first).ravel(), weights.reshape(-1, NEIGHBOURS))
    return first, weights


@compiled
def _lagrange(place, weights):
    for n in range(place.size):
        for node in range(NEIGHBOURS):
            weight = 1.0
            for other in range(NEIGHBOURS):
                if other != node:
                    weight *= (place[n] - other) / (node - other)
            weights[n, node] = weight


@summing
def _share(state, first_x, first_v, by_x, by_v, moved):
    rows, layers, columns, modes = state.shape
    # Flat arrays, and all modes of a node together: several numbers at a time.
    source, target = state.reshape(-1), moved.reshape(-1)
    to_x, to_v = first_x.reshape(-1), first_v.reshape(-1)
    share_x, share_v = by_x.reshape(-1), by_v.reshape(-1)
    line = np.empty(NEIGHBOURS * modes)
    length, row = np.uint64(line.size), np.uint64(layers * columns * modes)
    for node in range(rows * layers * columns):
        for b in range(NEIGHBOURS):
            for m in range(modes):
                line[b * modes + m] = share_v[NEIGHBOURS * node + b] * source[node * modes + m]
        layer = node // columns % layers
        start = np.uint64(to_x[node]) * row + np.uint64((layer * columns + to_v[node]) * modes)
        for a in range(NEIGHBOURS):
            share = share_x[NEIGHBOURS * node + a]
            first = start + np.uint64(a) * row
            part = target[first : first + length]
            for n in range(line.size):
                part[n] += share * line[n]
