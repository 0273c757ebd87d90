"""Stationary density of energy and slow charge: finite volumes and one sparse solve."""

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix, diags
from scipy.sparse.linalg import splu

# −ζ(½)/√(2π): the Milne length of a walk with Gaussian steps, in standard deviations.
MILNE = 0.5825971579390107
LARGEST_PECLET = 500.0


class Network:
    """Fluxes between cells, collected as entries of a sparse matrix."""

    def __init__(self, size):
        self.size = size
        self._rows, self._columns, self._values = [], [], []

    def add(self, source, target, cells, weights):
        """Flux Σ weights g[cells] from source to target; arrays, the terms on the last axis."""
        cells = np.broadcast_to(cells, weights.shape)
        for place, sign in ((source, 1.0), (target, -1.0)):
            self._rows.append(np.broadcast_to(place[..., None], weights.shape).ravel())
            self._columns.append(cells.ravel())
            self._values.append(sign * weights.ravel())

    def stationary(self, volume):
        """g with ∑ volume g = 1 whose fluxes balance, by inverse iteration."""
        inside = volume > 0.0
        place = np.cumsum(inside) - 1
        rows, columns, values = (
            np.concatenate(part) for part in (self._rows, self._columns, self._values)
        )
        keep = inside[rows] & inside[columns] & (values != 0.0)
        size = int(inside.sum())
        matrix = coo_matrix(
            (values[keep], (place[rows[keep]], place[columns[keep]])), shape=(size, size)
        ).tocsc()
        inner = volume[inside]
        # Equations for masses, each in units of its own rate of leaving.
        rate = matrix.diagonal() / inner
        scale = 1.0 / matrix.diagonal()
        matrix = diags(scale) @ matrix
        slowest = 1e-13
        shifted = csc_matrix(matrix + slowest * diags(np.ones(size)))
        factors = splu(shifted)
        g = np.ones(size)
        for _ in range(6):
            before = g
            g = factors.solve(g)
            g /= np.sum(g * inner)
            if np.sum(np.abs(g - before) * inner) < 1e-12:
                break
        density = np.zeros(self.size)
        density[inside] = g
        return density


def bernoulli(peclet):
    """x/(eˣ − 1)."""
    x = np.clip(peclet, -LARGEST_PECLET, LARGEST_PECLET)
    small = np.abs(x) < 1e-8
    safe = np.where(small, 1.0, x)
    value = np.where(small, 1.0 - 0.5 * x, safe / np.expm1(safe))
    return np.where(peclet < -LARGEST_PECLET, -peclet, value)


def fitted(loss, noise, distance):
    """Scharfetter–Gummel weights (below, above) of the outward flux −(B g + A dg/dH)."""
    peclet = loss * distance / noise
    conductance = noise / distance
    return conductance * bernoulli(peclet), -conductance * bernoulli(-peclet)


class Problem:
    """The stationary equation on a grid.

    Parameters
    ----------
    p : harvester.parameters.ScaledParameters
    grid : harvester.averaging.layers.Grid
    tables : dict of str to harvester.averaging.layers.Table
    faces : harvester.averaging.layers.Faces
    """

    def __init__(self, p, grid, tables, faces):
        self.p, self.tables, self.faces = p, tables, faces
        self.count = len(grid.charge) - 1
        self.half_faces = grid.charge
        half = 0.5 * (grid.charge[1:] + grid.charge[:-1])
        width = np.diff(grid.charge)
        self.moves = bool(np.all(width > 0.0))
        width = width if self.moves else np.ones(1)
        self.layers = {
            "wells": (np.append(-half[::-1], half), np.append(width[::-1], width)),
            "outer": (half, width),
        }
        self.index, start = {}, 0
        for name, table in tables.items():
            shape = table.height.shape
            self.index[name] = start + np.arange(shape[0] * shape[1]).reshape(shape)
            start += shape[0] * shape[1]
        self.network = Network(start)

    def volume(self, name):
        """∬dX dX' dZ of the cells."""
        return self.tables[name].cells("area") * self.layers[name][1][:, None]

    def solve(self):
        """g of the cells by edge, arrays (layers, cells)."""
        for name in self.tables:
            self._along_energy(name)
            if self.moves:
                self._along_charge(name)
        if "wells" in self.tables:
            self._at_separatrix()
        volume = np.concatenate([self.volume(name).ravel() for name in self.tables])
        density = self.network.stationary(volume)
        return {name: density[index] for name, index in self.index.items()}

    def coefficients(self, name):
        """B with the sweep of the moving faces, and A, at the faces."""
        p, table = self.p, self.tables[name]
        charge, width = self.layers[name]
        loss = p.damping * table.area + table.contact + p.coupling * p.decay_rate * table.voltage
        if self.moves:
            drift = p.decay_rate * (table.centre - charge[:, None])
            loss = loss + drift * np.diff(self.faces.area[name], axis=0) / width[:, None]
        return loss, p.intensity * table.noise

    def _along_energy(self, name):
        table, index = self.tables[name], self.index[name]
        loss, noise = (values[table.exists, 1:-1] for values in self.coefficients(name))
        distance = np.diff(table.height[table.exists], axis=1)
        below, above = fitted(loss, noise, distance)
        width = self.layers[name][1][table.exists, None]
        inner, outer = index[table.exists, :-1], index[table.exists, 1:]
        weights = np.stack([below * width, above * width], axis=-1)
        self.network.add(inner, outer, np.stack([inner, outer], axis=-1), weights)

    def _along_charge(self, name):
        charge, _ = self.layers[name]
        index, exists = self.index[name], self.tables[name].exists
        at = self._face_charge(name)
        flow = self.p.decay_rate * (
            np.diff(self.faces.displacement[name], axis=1)
            - at[:, None] * np.diff(self.faces.area[name], axis=1)
        )
        last = len(charge) - 1
        for face in range(1, last + 1):
            if not (exists[face - 1] and exists[face]):
                continue
            for ahead in (True, False):
                near, far = (face - 1, face) if ahead else (face, face - 1)
                behind = near - 1 if ahead else near + 1
                chosen = np.flatnonzero(flow[face] > 0.0 if ahead else flow[face] < 0.0)
                if len(chosen) == 0:
                    continue
                layers, weights = self._upwind(charge, at[face], behind, near, far, exists, name)
                cells = np.stack([index[layer, chosen] for layer in layers], axis=-1)
                self.network.add(
                    index[face - 1, chosen],
                    index[face, chosen],
                    cells,
                    flow[face, chosen, None] * weights,
                )

    def _face_charge(self, name):
        half = self.half_faces
        return np.append(-half[:0:-1], half) if name == "wells" else half

    def _upwind(self, charge, at, behind, near, far, exists, name):
        """Layers and weights of the quadratic through two layers upstream and one downstream."""
        mirrored = name == "outer" and behind < 0
        if mirrored:
            points = np.array([-charge[0], charge[near], charge[far]])
            layers = (0, near, far)
        elif 0 <= behind < len(charge) and exists[behind]:
            points = charge[[behind, near, far]]
            layers = (behind, near, far)
        else:
            return (near,), np.ones(1)
        weights = np.array(
            [
                np.prod([(at - q) / (r - q) for q in np.delete(points, k)])
                for k, r in enumerate(points)
            ]
        )
        return layers, weights

    def _at_separatrix(self):
        """Fluxes between wells and outer orbits, which share g at the junction but for the slip."""
        wells, count = self.tables["wells"], self.count
        edges = {name: self.coefficients(name) for name in self.tables}
        for k in range(count):
            right, left = count + k, count - 1 - k
            sides = [layer for layer in (right, left) if wells.exists[layer]]
            loss, noise = (values[k, 0] for values in edges["outer"])
            distance = self.tables["outer"].height[k, 0]
            outside = fitted(loss, noise, distance)
            inside, noises = [], []
            for layer in sides:
                loss, noise = (values[layer, -1] for values in edges["wells"])
                distance = wells.face_height[layer, -1] - wells.height[layer, -1]
                inside.append(fitted(loss, noise, distance))
                noises.append(noise)
            weights = _junction(inside, noises, outside)
            cells = [self.index["wells"][layer, -1] for layer in sides]
            cells = np.array([*cells, self.index["outer"][k, 0]])
            for source, row in zip(cells[:-1], weights, strict=True):
                self.network.add(
                    np.array([source]),
                    cells[-1:],
                    cells[None, :],
                    (row * self.layers["outer"][1][k])[None, :],
                )


def _junction(inside, noises, outside):
    """Outward fluxes out of the wells as weights of (wells' last cells, outer first cell).

    One kick per pass is not small against the layer at the separatrix: g of the wells there
    differs from the outer one by E0/A of the flux that changes sides (Milne's problem).
    """
    sides = len(inside)
    # Unknowns: fluxes of the sides, then g at the junction.
    matrix, given = np.zeros((sides + 1, sides + 1)), np.zeros((sides + 1, sides + 1))
    slip = np.zeros((sides, sides))
    if sides == 2:
        total = sum(noises)
        length = MILNE * (sum(np.sqrt(2.0 * a) for a in noises) - np.sqrt(2.0 * total))
        change = np.array([noises[1], -noises[0]]) / total
        slip = np.array([change, -change]) * length / np.array(noises)[:, None]
    for k, (below, above) in enumerate(inside):
        matrix[k, :sides] = -above * slip[k]
        matrix[k, k] += 1.0
        matrix[k, sides] = -above
        given[k, k] = below
    matrix[sides, :sides] = 1.0
    matrix[sides, sides] = -outside[0]
    given[sides, sides] = outside[1]
    return np.linalg.solve(matrix, given)[:sides]
