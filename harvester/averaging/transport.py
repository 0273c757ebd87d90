"""Stationary density of energy and slow charge: finite volumes and one sparse solve."""

import numpy as np
from scipy.sparse import coo_matrix, diags, identity
from scipy.sparse.linalg import splu

from harvester.averaging.layers import middle
from harvester.averaging.separatrix import fluxes

LARGEST_PECLET = 500.0
SHIFT = 1e-13  # of the matrix of fluxes, in units of a cell's own outflow
ITERATIONS, SETTLED = 8, 1e-11
# Between which g at a face lies, in units of g upstream, when positive values are enforced.
FACE_BOUNDS = (0.5, 2.0)
NEGATIVE = 1e-9  # share of the greatest g below zero that is not rounding


class Network:
    """Fluxes between cells, collected as entries of a sparse matrix."""

    def __init__(self):
        self._rows, self._columns, self._values = [], [], []

    def add(self, source, target, cells, weights):
        """Flux Σ weights g[cells] from source to target; arrays, the terms on the last axis."""
        cells = np.broadcast_to(cells, weights.shape)
        for place, sign in ((source, 1.0), (target, -1.0)):
            self._rows.append(np.broadcast_to(place[..., None], weights.shape).ravel())
            self._columns.append(cells.ravel())
            self._values.append(sign * weights.ravel())

    def stationary(self, volume, start):
        """g whose fluxes balance, with ∑ g volume = 1: inverse iteration with one factorisation.

        It begins with the mass in the cells `start`, and so ends in what that mass can reach where
        other cells keep theirs as well.
        Eliminated without pivoting: where no weight but the diagonal's is positive, g comes out
        positive whatever the rounding.
        """
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
        scale = diags(1.0 / matrix.diagonal())
        factors = splu(
            (scale @ matrix + SHIFT * identity(size)).tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        g = np.zeros(len(volume))
        g[start] = 1.0
        g = g[inside]
        for _ in range(ITERATIONS):
            before, g = g, factors.solve(g)
            g /= np.sum(g * volume[inside])
            if np.sum(np.abs(g - before) * volume[inside]) < SETTLED:
                break
        density = np.zeros(len(volume))
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
    p : harvester.averaging.symmetric.SymmetricDevice
    grid : harvester.averaging.layers.Grid
    tables : dict of str to harvester.averaging.layers.Table
    faces : harvester.averaging.layers.Faces
    rate : float
        At which Z relaxes.
    """

    def __init__(self, p, grid, tables, faces, rate):
        self.p, self.tables, self.faces = p, tables, faces
        self.count = len(grid.charge) - 1
        self.charge, self.rate, self._crossings = grid.charge, rate, []
        self.held = grid.held
        self.moves = bool(np.all(np.diff(grid.charge) > 0.0))
        self.layers = {
            name: (middle(at), np.diff(at) if self.moves else np.ones(len(at) - 1))
            for name, at in (("wells", grid.held), ("outer", grid.charge))
        }
        self.index, start = {}, 0
        for name, table in tables.items():
            shape = table.height.shape
            self.index[name] = start + np.arange(shape[0] * shape[1]).reshape(shape)
            start += shape[0] * shape[1]

    def volume(self, name):
        """∬dX dX' dZ of the cells."""
        return self.tables[name].cells("area") * self.layers[name][1][:, None]

    def solve(self):
        """g of the cells by edge, arrays (layers, cells), none of them negative.

        Quadratic interpolation at the faces between layers can undershoot where g is steep. The
        ratios of g at a face to that upstream are then kept, within bounds, and the equation is
        solved again with them: its weights have the signs that make g positive.
        """
        volume = np.concatenate([self.volume(name).ravel() for name in self.tables])
        density = self._balanced(volume, None)
        if density.min() < -NEGATIVE * density.max():
            density = self._balanced(volume, density)
        return {name: density[index] for name, index in self.index.items()}

    def _balanced(self, volume, previous):
        network = Network()
        self._crossings = []
        for name in self.tables:
            self._along_energy(network, name)
            if self.moves:
                self._along_charge(network, name, previous)
        if "wells" in self.tables:
            self._at_separatrix(network)
        # The bottoms of the wells if there are any: weak noise leaves all the mass there.
        bottoms = [index[self.tables[name].exists, 0] for name, index in self.index.items()]
        return network.stationary(volume, next(cells for cells in bottoms if len(cells)))

    def loss(self, name):
        """B at the faces: what damping, contact and load take in a turn."""
        p, table = self.p, self.tables[name]
        mechanical = (p.damping * table.area + table.contact) / table.mass
        return mechanical + p.coupling * p.decay_rate * table.voltage

    def coefficients(self, name):
        """B with the sweep of the moving faces, and A, at the faces."""
        table = self.tables[name]
        charge, width = self.layers[name]
        loss = self.loss(name)
        if self.moves:
            drift = self.rate * (table.centre - charge[:, None])
            loss = loss + drift * np.diff(self.faces.area[name], axis=0) / width[:, None]
        return loss, self.p.intensity * table.noise

    def _along_energy(self, network, name):
        table, index = self.tables[name], self.index[name]
        loss, noise = (values[table.exists, 1:-1] for values in self.coefficients(name))
        distance = np.diff(table.height[table.exists], axis=1)
        below, above = fitted(loss, noise, distance)
        width = self.layers[name][1][table.exists, None]
        inner, outer = index[table.exists, :-1], index[table.exists, 1:]
        weights = np.stack([below * width, above * width], axis=-1)
        network.add(inner, outer, np.stack([inner, outer], axis=-1), weights)

    def _along_charge(self, network, name, previous):
        """Z' g between layers, g at the face from two layers upstream and one ahead."""
        index, exists = self.index[name], self.tables[name].exists
        charge = self.layers[name][0]
        at = self.charge if name == "outer" else self.held
        flow = self.rate * (
            np.diff(self.faces.displacement[name], axis=1)
            - at[:, None] * np.diff(self.faces.area[name], axis=1)
        )
        for face in range(1, len(charge)):
            if not (exists[face - 1] and exists[face]):
                continue
            for near, far in ((face - 1, face), (face, face - 1)):
                chosen = np.flatnonzero(flow[face] * (far - near) > 0.0)
                if len(chosen) == 0:
                    continue
                layers, weights = self._upwind(name, at[face], near, far)
                cells = np.stack([index[layer, chosen] for layer in layers], axis=-1)
                if previous is not None:
                    upstream = previous[index[near, chosen]]
                    ratio = previous[cells] @ weights / np.where(upstream > 0.0, upstream, 1.0)
                    weights = np.where(upstream > 0.0, np.clip(ratio, *FACE_BOUNDS), 1.0)[:, None]
                    cells = index[near, chosen][:, None]
                network.add(
                    index[face - 1, chosen],
                    index[face, chosen],
                    cells,
                    flow[face, chosen, None] * weights,
                )

    def _upwind(self, name, at, near, far):
        """Layers and weights of the parabola through the next two upstream and one downstream."""
        charge, exists = self.layers[name][0], self.tables[name].exists
        behind = 2 * near - far
        if name == "outer" and behind < 0:  # the mirror image of the first layer
            place, behind = -charge[0], 0
        elif 0 <= behind < len(charge) and exists[behind]:
            place = charge[behind]
        else:
            return (near,), np.ones(1)
        points = np.array([place, charge[near], charge[far]])
        weights = [
            np.prod((at - np.delete(points, k)) / (point - np.delete(points, k)))
            for k, point in enumerate(points)
        ]
        return (behind, near, far), np.array(weights)

    def _at_separatrix(self, network):
        """Fluxes between wells and outer orbits of the same layer."""
        wells, outer = self.tables["wells"], self.tables["outer"]
        edges = {name: self.coefficients(name) for name in self.tables}
        taken = self.loss("wells")
        (held, held_width), (charge, outer_width) = self.layers["wells"], self.layers["outer"]
        for k in range(self.count):
            loss, noise = (values[k, 0] for values in edges["outer"])
            outside = fitted(loss, noise, outer.height[k, 0])
            right, left = self.count + k, self.count - 1 - k
            sides = [layer for layer in (right, left) if wells.exists[layer]]
            if not sides:
                continue
            inside, noises, losses = [], [], []
            for layer in sides:
                loss, noise = (values[layer, -1] for values in edges["wells"])
                distance = wells.face_height[layer, -1] - wells.height[layer, -1]
                share = held_width[layer] / outer_width[k]
                inside.append([share * weight for weight in fitted(loss, noise, distance)])
                noises.append(share * noise)
                losses.append(share * taken[layer, -1])
            weights = fluxes(inside, noises, losses, outside, edges["outer"][1][k, 0])
            weights *= outer_width[k]
            cells = np.append(self.index["wells"][sides, -1], self.index["outer"][k, 0])
            for layer, source, row in zip(sides, cells[:-1], weights, strict=True):
                network.add(np.array([source]), cells[-1:], cells[None, :], row[None, :])
                side = 1.0 if layer == right else -1.0
                ends = held[layer], side * charge[k]
                arms = ends[0] - wells.junction[layer], ends[1] - side * outer.junction[k]
                self._crossings.append((cells, row, (ends[0] - ends[1]) * 0.5 * sum(arms)))

    def crossing(self, density):
        """What the lag adds to E[(⟨X⟩ − Z)²]: Z is left behind while the mass crosses.

        The potential at the junction falls by β' ∫(Z − x) dZ on the way, work of the charge that
        the load takes at the rate β' `rate` (⟨X⟩ − Z)².
        """
        flat = np.concatenate([density[name].ravel() for name in self.tables])
        work = sum((flat[cells] @ row) * fall for cells, row, fall in self._crossings)
        return work / self.rate
