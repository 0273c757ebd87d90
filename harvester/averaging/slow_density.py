"""Stationary densities of the closure `slow_load`, summed over the layers of the slow charge."""

import numpy as np
from scipy.interpolate import PchipInterpolator

from harvester.averaging.symmetric import potential
from harvester.compilation import compiled

FINER = 3  # pieces of a cell between which g is taken as linear in the energy
PLACES = 320  # points of a quadrature over displacement or velocity
ENERGIES = 200  # at which p(H) is given
LEAST = 1e-300
UNSEEN = 1e-14  # share of the most probable layer's probability that adds nothing
FALL = 28.0  # ln g falls by this much within the quadratures


class SlowDensity:
    """Stationary probability densities; methods are vectorised.

    Parameters
    ----------
    p : harvester.averaging.symmetric.SymmetricDevice
    span : harvester.averaging.slow_load.Span
    problem : harvester.averaging.transport.Problem
    density : dict of str to ndarray
        g of the cells of each edge.

    Attributes
    ----------
    energy : dict of str to tuple
        "wells" and "outer", or "outer" alone: arrays H, ½X'² + U(X) + ½β'(X − Z)² above its least
        value, and p(H).
    """

    names = ("displacement", "velocity", "voltage")

    def __init__(self, p, span, problem, density):
        self._p, self._span = p, span
        self._inertia = np.sqrt(_mean_mass(problem, density))
        self._least = float(potential(p, p.rest))
        density = {name: np.maximum(g, 0.0) for name, g in density.items()}
        norm = sum(np.sum(g * problem.volume(name)) for name, g in density.items())
        density = {name: g / norm for name, g in density.items()}
        self._sheets = [_sheets(problem, name, g) for name, g in density.items()]
        # Between the cells g is another one than the cells' own: its integral is made to be 1.
        place, weight = self._places(2 * PLACES)
        half = place > 0.0
        mass = 2.0 * (self.displacement(place[half]) @ weight[half])
        self._sheets = [(*sheets[:-1], sheets[-1] / mass) for sheets in self._sheets]
        self.energy = {
            name: self._over_energy(problem, name, density[name]) for name in problem.tables
        }
        # V = slow (X − Z) + fast X' on an orbit of the rest position's frequency.
        square = p.decay_rate**2 + span.frequency**2
        self._slow, self._fast = span.frequency**2 / square, p.decay_rate / square

    def joint(self, x, v):
        """p(X, X').

        Parameters
        ----------
        x, v : array_like
            Scaled displacement and velocity, of shapes that broadcast.
        """
        x, v = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(v, dtype=float))
        flat_x, flat_v = np.ascontiguousarray(x.ravel()), np.ascontiguousarray(v.ravel())
        total = 0.0
        for side in (flat_x, -flat_x):
            bare = potential(self._p, side)
            for sheets in self._sheets:
                total = total + 0.5 * self._probability(side, flat_v, bare, sheets)
        return total.reshape(x.shape)

    def _probability(self, x, v, bare, sheets):
        """p(X, X') of some sheets: orbits of one energy go round at ½ (effective mass) X'²."""
        arrays = x, self._inertia * v, bare
        return self._inertia * _joint(*arrays, self._span.stiffness, *sheets)

    def displacement(self, x):
        """p(X), the integral of `joint` over velocity."""
        x = np.asarray(x, dtype=float)
        flat = np.ascontiguousarray(x.ravel())
        total = 0.0
        for side in (flat, -flat):
            bare = potential(self._p, side)
            for sheets in self._sheets:
                total = total + 0.5 * _over_velocity(side, bare, self._span.stiffness, *sheets)
        return total.reshape(x.shape)

    def velocity(self, v):
        """p(X'), the integral of `joint` over displacement."""
        v = np.asarray(v, dtype=float)
        place, weight = self._places()
        bare, speed = potential(self._p, place), self._inertia * np.abs(v).ravel()
        total = sum(
            _over_displacement(speed, place, weight, bare, self._span.stiffness, *sheets)
            for sheets in self._sheets
        )
        return self._inertia * total.reshape(v.shape)

    def voltage(self, voltage):
        """p(V), with V of each orbit as at the frequency of small oscillations."""
        voltage = np.asarray(voltage, dtype=float)
        flat = np.ascontiguousarray(voltage.ravel())
        by_speed = self._fast * self._top_speed() < self._slow * self._reach()
        place, weight = self._speeds() if by_speed else self._places()
        total = 0.0
        for sheet in self._each_sheet():
            charge = sheet[0][0]
            for side in (flat, -flat):
                if by_speed:
                    x = (side[:, None] - self._fast * place) / self._slow + charge
                    v = np.broadcast_to(place, x.shape)
                    each = weight / self._slow
                else:
                    x = np.broadcast_to(place, (len(flat), len(place)))
                    v = (side[:, None] - self._slow * (x - charge)) / self._fast
                    each = weight / self._fast
                bare = potential(self._p, x.ravel())
                values = self._probability(x.ravel(), v.ravel(), bare, sheet).reshape(x.shape)
                total = total + 0.5 * (values @ each)
        return total.reshape(voltage.shape)

    def landmarks(self, name):
        """Where the density may vary, however narrow it is."""
        place, speed = self._places()[0], self._speeds()[0]
        if name == "displacement":
            return np.unique(np.abs(place))
        if name == "velocity":
            return np.unique(np.abs(speed))
        points = [self._slow * (place - z) for z in (0.0, self._p.rest)]
        return np.unique(np.abs(np.concatenate([*points, self._fast * speed])))

    def _each_sheet(self):
        for sheets in self._sheets:
            for k in range(len(sheets[0])):
                yield tuple(np.ascontiguousarray(part[k : k + 1]) for part in sheets)

    def _top(self):
        """Greatest energy that matters, above the least one."""
        greatest = max(g.max() for *_, g in self._sheets)
        *_, energy, g = self._sheets[-1]
        tops = [energy[g > np.exp(-FALL) * greatest], energy[:, 0]]
        return max(part.max() for part in tops if part.size) - self._least

    def _reach(self):
        """|X| beyond which the potential exceeds the greatest energy."""
        top, high = self._top() + self._least, max(self._p.rest, 1e-150)
        while potential(self._p, high) < top:
            high *= 2.0
        low = self._p.rest
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if potential(self._p, middle) < top else (low, middle)
        return high

    def _top_speed(self):
        return np.sqrt(2.0 * self._top()) / self._inertia

    def _places(self, count=PLACES):
        """Points and weights over X, close together about the rest positions."""
        rest, reach = self._p.rest, self._reach()
        scale = np.sqrt(2.0 * self._span.energy) / self._span.frequency
        outward = _spread(reach - rest, scale, count)
        if rest == 0.0:
            half, weight = outward
        else:
            inward = _spread(rest, scale, count)
            half = np.concatenate([rest - inward[0][::-1], rest + outward[0]])
            weight = np.concatenate([inward[1][::-1], outward[1]])
        return np.append(-half[::-1], half), np.append(weight[::-1], weight)

    def _speeds(self):
        speed, weight = _spread(self._top_speed(), np.sqrt(2.0 * self._span.energy), PLACES)
        return np.append(-speed[::-1], speed), np.append(weight[::-1], weight)

    def _over_energy(self, problem, name, density):
        table = problem.tables[name]
        mass = density * problem.volume(name)
        faces = table.base[:, None] + table.face_height - self._least
        enclosed = np.cumsum(np.insert(mass, 0, 0.0, axis=1), axis=1)
        there = table.exists
        order = np.argsort(faces[there, 1:].ravel())
        weight = np.cumsum(mass[there].ravel()[order])
        probable = np.interp(
            np.linspace(0.0, weight[-1], ENERGIES // 2), weight, faces[there, 1:].ravel()[order]
        )
        even = np.linspace(faces[there].min(), probable[-1], ENERGIES // 2)
        energy = np.unique(np.append(even, probable))
        total = sum(
            np.interp(energy, row, cumulative)
            for row, cumulative in zip(faces[there], enclosed[there], strict=True)
        )
        return 0.5 * (energy[1:] + energy[:-1]), np.diff(total) / np.diff(energy)


def _mean_mass(problem, density):
    """The effective mass, by its share of X'², over all orbits."""
    whole = borne = 0.0
    for name, table in problem.tables.items():
        weight = density[name] * problem.layers[name][1][:, None]
        whole += np.sum(weight * table.cells("speed_square"))
        borne += np.sum(weight * table.velocity_square())
    return whole / borne


def _sheets(problem, name, density):
    """One edge's layers as arrays: Z, width, X from which on, H from which on, and H and g.

    Wells lie right of their junction; outer orbits of a device without wells have none below.
    """
    table, (charge, width) = problem.tables[name], problem.layers[name]
    energies, values = _tabulated(table, density)
    beginning, floor = table.junction, np.full(len(charge), -np.inf)
    if name == "outer":
        beginning = floor
        if "wells" in problem.tables:
            floor = energies[:, 0]
    mass = np.sum(density * problem.volume(name), axis=1)
    there = mass >= UNSEEN * mass.max()
    return tuple(part[there] for part in (charge, width, beginning, floor, energies, values))


def _spread(length, scale, count):
    """Midpoints from 0 to the length and their widths, close together within `scale`."""
    stretch = np.arcsinh(length / scale) if length > scale else 1.0
    faces = length * np.sinh(stretch * np.linspace(0.0, 1.0, count // 4 + 1)) / np.sinh(stretch)
    return 0.5 * (faces[1:] + faces[:-1]), np.diff(faces)


def _tabulated(table, density):
    """Energies and g between which it is linear, of each layer; (layers, points)."""
    energies, values = [], []
    cells = table.height.shape[1]
    for k in range(len(table.base)):
        if not table.exists[k]:
            energies.append(np.zeros(FINER * (cells + 1) + 1))
            values.append(np.zeros(FINER * (cells + 1) + 1))
            continue
        height = table.height[k]
        logarithm = np.log(np.maximum(density[k], LEAST))
        ends = (0.0, table.face_height[k, -1])
        slopes = np.diff(logarithm) / np.diff(height)
        ahead = np.array([ends[0] - height[0], ends[1] - height[-1]])
        # A cell's g changes by no more than a factor e to its end: next to it may be rounding.
        change = np.clip(slopes[[0, -1]] * ahead, -1.0, 1.0)
        knots = np.concatenate([ends[:1], height, ends[1:]])
        values_at = [logarithm[:1] + change[0], logarithm, logarithm[-1:] + change[1]]
        curve = PchipInterpolator(knots, np.concatenate(values_at))
        places = np.arange(FINER * (cells + 1) + 1) / FINER
        fine = np.interp(places, np.arange(cells + 2), knots)
        energies.append(table.base[k] + fine)
        values.append(np.exp(curve(fine)))
    return np.array(energies), np.array(values)


@compiled
def _at(energy, knots, values):
    last = len(knots) - 1
    if energy >= knots[last]:
        return 0.0
    if energy <= knots[0]:
        return values[0]
    low, high = 0, last
    while high - low > 1:
        middle = (low + high) // 2
        if knots[middle] <= energy:
            low = middle
        else:
            high = middle
    share = (energy - knots[low]) / (knots[high] - knots[low])
    return values[low] + share * (values[high] - values[low])


@compiled
def _joint(x, v, bare, stiffness, charge, width, beginning, floor, energies, values):
    total = np.zeros(len(x))
    for i in range(len(x)):
        for k in range(len(charge)):
            if x[i] < beginning[k]:
                continue
            energy = bare[i] + 0.5 * stiffness * (x[i] - charge[k]) ** 2 + 0.5 * v[i] ** 2
            if energy >= floor[k]:
                total[i] += width[k] * _at(energy, energies[k], values[k])
    return total


@compiled
def _over_displacement(
    v, x, weight, bare, stiffness, charge, width, beginning, floor, energies, values
):
    total = np.zeros(len(v))
    for j in range(len(x)):
        for k in range(len(charge)):
            if x[j] < beginning[k]:
                continue
            rest = bare[j] + 0.5 * stiffness * (x[j] - charge[k]) ** 2
            for i in range(len(v)):
                energy = rest + 0.5 * v[i] ** 2
                if energy >= floor[k]:
                    total[i] += weight[j] * width[k] * _at(energy, energies[k], values[k])
    return total


@compiled
def _above(floor, knots, values):
    """2 ∫ g dX' over the speeds of these energies, g linear in the energy between them."""
    total = 0.0
    before = np.sqrt(2.0 * max(knots[0] - floor, 0.0))
    for j in range(len(knots) - 1):
        after = np.sqrt(2.0 * max(knots[j + 1] - floor, 0.0))
        if after > before:
            slope = (values[j + 1] - values[j]) / (knots[j + 1] - knots[j])
            start = values[j] + slope * (floor - knots[j])
            total += start * (after - before) + slope * (after**3 - before**3) / 6.0
        before = after
    return 2.0 * total


@compiled
def _over_velocity(x, bare, stiffness, charge, width, beginning, floor, energies, values):
    total = np.zeros(len(x))
    for i in range(len(x)):
        for k in range(len(charge)):
            if x[i] >= beginning[k]:
                rest = bare[i] + 0.5 * stiffness * (x[i] - charge[k]) ** 2
                total[i] += width[k] * _above(rest, energies[k], values[k])
    return total
