"""The closure `paper` against a quadrature of Eqs. 10–36 on Table 1, written here with scipy alone.

Corrected where the print slips: κ in Eq. 15, the stoppers' spring opposed on either side, two
orbits of one energy below the barrier in Eq. 26, v0 of the state by the bare spring. From one orbit
to the next dH = dJ/T, J = ∮X'² dt. Just above the barrier N2 rises so fast that orbits would cross:
the outer ones begin where they no longer do, the wells end where they would reach further right
than the first of them, and in between its density holds.
"""

import math

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq
from truths import averaged, flat

from harvester.scene.model import Scene

# c, ω0², κ, K, δ, e, β, λ from the SI values of Table 1, lengths in mm.
DAMPING, SQUARE, CUBIC = 0.18 / 9.12, 36.48 / 9.12, 35.57 / 9.12
STIFFNESS, GAP, RESTITUTION = 91.2 / 9.12, 1.1, 0.7
COUPLING, DECAY = 1.21**2 / (9.12 * 0.2), 1.0 / (100e3 * 2e-4)
LEVELS = 60
# Share of a well's depth at which its orbits begin, and energy at which the outer ones end.
BOTTOM, FAR = 5e-4, 60.0


def bare(x):
    """−½ω0² X² + ¼κ X⁴."""
    return (-0.5 * SQUARE + 0.25 * CUBIC * x * x) * x * x


def energy(x, n2):
    """U of Eq. 15, 0 at the barrier."""
    return bare(x) + 0.5 * n2 * x * x + 0.4 * STIFFNESS * max(x - GAP, 0.0) ** 2.5


def rates(x, v):
    """What is integrated over time along an orbit, by the names of `ROWS`."""
    depth = max(x - GAP, 0.0)
    lost = 0.0
    if depth > 0.0:
        v0 = math.sqrt(v * v + 2.0 * (bare(x) - bare(GAP)) + 0.8 * STIFFNESS * depth**2.5)
        lost = 0.75 * (1.0 - RESTITUTION**2) * STIFFNESS * depth**1.5 / v0 * v * v
    x2, v2 = x * x, v * v
    return np.array([1.0, x, x2, x * x2, x2 * x2, v2, x2 * v2, v2 * v2, lost])


ROWS = ("time", "x", "x2", "x3", "x4", "v2", "x2v2", "v4", "lost")


def orbit(height, n2):
    """(integrals over the closed orbit, right turning point); `height` is above the barrier."""
    bottom = math.sqrt((SQUARE - n2) / CUBIC)

    def kinetic(x):
        return height - energy(x, n2)

    right = brentq(kinetic, bottom, 10.0, xtol=1e-15, rtol=1e-15)
    inside = height < 0.0
    left = brentq(kinetic, 0.0, bottom, xtol=1e-15, rtol=1e-15) if inside else -right
    width = right - left

    def along(angle):
        x = left + width * math.sin(angle) ** 2
        v = math.sqrt(max(2.0 * kinetic(x), 1e-30))
        return rates(x, v) * (width * math.sin(2.0 * angle) / v)

    touch = math.asin(math.sqrt((min(GAP, right) - left) / width))
    start, turns = (0.0, 2.0) if inside else (0.25 * math.pi, 4.0)
    ends = (start, touch), (touch, 0.5 * math.pi)
    total = sum(quad_vec(along, *pair, epsabs=1e-8, epsrel=1e-8)[0] for pair in ends)
    return turns * total, right


def settled(height_of):
    """(height, N2, integrals, right turning point) where N2 is that of the orbit's own ω."""
    n2 = COUPLING
    for _ in range(50):
        before, (integrals, right) = n2, orbit(height_of(n2), n2)
        n2 = COUPLING / (1.0 + (DECAY * integrals[0] / (2.0 * math.pi)) ** 2)
        if abs(n2 - before) < 1e-12:
            break
    else:
        raise AssertionError("no fixed point of N2 and ω")
    return height_of(n2), n2, integrals, right


def in_well(level):
    """The orbit at ln(h/(1 − h)), h the share of the well's depth."""
    return settled(lambda n2: -((SQUARE - n2) ** 2) / (4.0 * CUBIC) / (1.0 + math.exp(level)))


def around(level):
    """The orbit around both wells at the logarithm of its height."""
    return settled(lambda n2: math.exp(level))


def crossing(level):
    """Least growth of ½X'² from an outer orbit to the next, as a share: it crosses below 0."""
    (low, before, _, _), (high, after, _, right) = around(level - 1e-3), around(level + 1e-3)
    return 1.0 - 0.5 * (after - before) / (high - low) * right**2


class Edge:
    """Orbits of the wells (`lobes` = 2) or around both, at evenly spaced levels."""

    def __init__(self, lobes, make, first, last):
        self.lobes, self.level = lobes, np.linspace(first, last, LEVELS)
        height, n2, integrals, right = zip(*map(make, self.level), strict=True)
        self.n2, self.right = np.array(n2), right
        self.rows = dict(zip(ROWS, np.array(integrals).T, strict=True))
        self.growth, self.fall = (
            CubicSpline(self.level, values).derivative()(self.level) for values in (height, n2)
        )

    def area(self, name, times_square):
        """∮ … (dE − ½X² dN2) dt per level: the plane between neighbouring orbits."""
        return self.growth * self.rows[name] - 0.5 * self.fall * self.rows[times_square]

    def weigh(self, intensity, memory):
        """ln g by Eqs. 21, 22 and 25, and the integrands of Eqs. 26, 28 and 36."""
        rows = self.rows
        frequency = 2.0 * math.pi / rows["time"]
        spectrum = 1.0 / (1.0 + (frequency * memory) ** 2)
        n1 = COUPLING * DECAY / (DECAY**2 + frequency**2)
        taken = (DAMPING + n1) * rows["v2"] + rows["lost"]
        slope = taken / (intensity * spectrum * rows["v2"]) * self.area("time", "x2") / rows["time"]
        exponent = CubicSpline(self.level, slope).antiderivative()(self.level)
        exponent -= exponent[-1] if self.lobes == 2 else exponent[0]
        self.density = np.exp(-exponent) / spectrum
        self.gain = frequency**2 / (DECAY**2 + frequency**2)
        self.along = DECAY / (DECAY**2 + frequency**2)
        rest = np.sqrt((SQUARE - self.n2) / CUBIC) if self.lobes == 2 else 0.0
        offset = self.area("x2", "x4") - 2.0 * rest * self.area("x", "x3")
        offset += rest**2 * self.area("time", "x2")
        mass = self.area("time", "x2")
        # Of the contact the orbit's own mean, as in Eq. 24.
        self.lost = rows["lost"] / rows["time"]
        return {
            "mass": mass,
            "mean_square_voltage": self.gain**2 * offset + self.along**2 * self.area("v2", "x2v2"),
            "mean_square_velocity": self.area("v2", "x2v2"),
            "mean_square_displacement": self.area("x2", "x4"),
            "mechanical_loss": DAMPING * self.area("v2", "x2v2") + self.lost * mass,
        }

    def enclosed(self, place):
        """Mass and moments of the plane within one orbit, whose g and V(X, X') hold there."""
        return np.array([self.rows[name][place] for name in ("v2", "v4", "x2v2")])


@pytest.fixture(scope="module")
def edges():
    fold = brentq(crossing, math.log(1e-4), math.log(1e-2), xtol=1e-6)
    outer = Edge(1, around, fold, math.log(FAR))
    last = brentq(lambda level: in_well(level)[3] - outer.right[0], 5.0, 22.0, xtol=1e-3)
    return Edge(2, in_well, math.log(BOTTOM), last), outer


def printed(edges, intensity, memory):
    """Means by Eqs. 26–36."""
    wells, outer = edges
    totals, masses = {}, []
    for edge in edges:
        integrands = edge.weigh(intensity, memory)
        masses.append(0.0)
        for name, values in integrands.items():
            whole = CubicSpline(edge.level, edge.density * values)
            part = edge.lobes * whole.integrate(edge.level[0], edge.level[-1])
            if edge.lobes == 2:
                # The bottom, where V is nearly that of the innermost orbit.
                inside = edge.rows["v2"][0] * edge.density[0]
                part += 2.0 * inside * values[0] / integrands["mass"][0]
            totals[name] = totals.get(name, 0.0) + part
            masses[-1] += part if name == "mass" else 0.0
    mass, v4, x2 = outer.density[0] * (outer.enclosed(0) - 2.0 * wells.enclosed(-1))
    v2, lost = v4 / 3.0, mass * outer.lost[0]
    totals["mass"] += mass
    totals["mean_square_velocity"] += v2
    totals["mean_square_displacement"] += x2
    totals["mean_square_voltage"] += outer.gain[0] ** 2 * x2 + outer.along[0] ** 2 * v2
    totals["mechanical_loss"] += DAMPING * v2 + lost
    means = {name: value / totals["mass"] for name, value in totals.items() if name != "mass"}
    power = means["mean_power"] = COUPLING * DECAY * means["mean_square_voltage"]
    means["power_conversion_efficiency"] = power / (power + means["mechanical_loss"])
    means["share_in_wells"] = masses[0] / totals["mass"]
    return means


@pytest.mark.slow
@pytest.mark.parametrize(
    ("intensity", "memory"),
    [(0.005, 0.4), (0.02, 0.4), (0.1, 0.4), (0.05, 0.1), (0.02, 1.0), (0.1, 1.0)],
)
def test_the_printed_closure_is_that_of_a_separate_quadrature(edges, intensity, memory):
    parameters = flat(Scene.read("paper"))
    found = averaged(parameters._replace(intensity=intensity, correlation_time=memory), "paper")
    for name, expected in printed(edges, intensity, memory).items():
        assert getattr(found, name) == pytest.approx(expected, rel=5e-4), name
