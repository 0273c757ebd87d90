"""Orbits at a frozen slow charge, put together from right-hand lobes.

With Z held, the potential U(X) = U0(X) + ½ β' (X − Z)² has its lobes to the right and to the left
of a junction: the saddle between the wells, the weakest point of the pull where one well has
gone, or the minimum where there is but one. The left lobe at Z is the mirror image of the right
one at −Z, so that right lobes at all Z tell everything.
"""

from dataclasses import dataclass

import numpy as np

from harvester.averaging.filters import filtered_power
from harvester.averaging.orbits import (
    PIECES,
    Potential,
    contact_damping_on,
    path_between,
    root_beyond,
    turning_point,
)

NEAREST = 1e-4  # approach to the saddle that stands for the separatrix, as a share of the way
SHALLOW = 1e-9  # a depth that is none, in units of the energy at the bottom
FAINTEST = 1e-6  # share of its energy that a contact takes, not to divide zero by zero
WIDE = 1e3  # scale of a left end without a saddle near it, in lengths of the path


class Lobe:
    """The potential right of the junction at one Z.

    Parameters
    ----------
    parameters : harvester.averaging.symmetric.SymmetricDevice
    stiffness : float
        β' of the piezo.
    charge : float
        Z.

    Attributes
    ----------
    junction, bottom : float
        Where the lobe begins, and its minimum; the same without a well.
    has_well : bool
    depth : float
        Of the well below the junction; 0 without a well.
    """

    def __init__(self, parameters, stiffness, charge):
        p = parameters
        self.potential = u = Potential(p, anchor=charge)
        self.stiffness = np.array([stiffness])
        softening = -(p.linear_stiffness + stiffness)
        self.double = softening > 0.0
        if self.double:
            self.junction, self.has_well = self._junction(p, softening, stiffness * charge)
        else:
            self.junction, self.has_well = self._single_minimum(charge), False
        self.bottom = self.junction
        if self.has_well:
            start = p.gap
            if p.cubic_stiffness > 0.0:
                start = min(np.sqrt(softening / (3.0 * p.cubic_stiffness)), start)
            start = np.array([max(start, self.junction)])
            step = 0.1 * np.abs(start)
            beyond = root_beyond(u.slope, u.curvature, start, step, self.stiffness)
            self.bottom = float(beyond[0])
        way = np.array([self.bottom - self.junction])
        self.depth = float(u.rise(np.array([self.bottom]), -way, self.stiffness)[0])
        scale = abs(u.energy(np.array([self.bottom]), self.stiffness)[0])
        self.has_well = bool(self.has_well and self.depth > SHALLOW * scale)

    @staticmethod
    def _junction(p, softening, pull):
        """Middle root of κx³ − (ω0² − β')x = β'Z, or the weakest point; whether a well is there."""
        if p.cubic_stiffness > 0.0:
            third = np.sqrt(softening / (3.0 * p.cubic_stiffness))
            ratio = 1.5 * pull / (softening * third)
            angle = (np.arccos(np.clip(ratio, -1.0, 1.0)) - 2.0 * np.pi) / 3.0
            saddle = 2.0 * third * np.cos(angle)
            has_well = ratio > -1.0 and saddle < p.gap
        else:
            saddle = -pull / softening
            has_well = saddle < p.gap
        return float(np.clip(saddle, -p.gap, p.gap)), bool(has_well)

    def _single_minimum(self, charge):
        """Root of the slope, by bisection: the bare force pulls to a rest position, β' to Z."""
        rest = self.potential.parameters.rest
        low, high = min(-rest, charge), max(rest, charge)
        for _ in range(200):
            middle = 0.5 * (low + high)
            if self.potential.slope(np.array([middle]), self.stiffness)[0] < 0.0:
                low = middle
            else:
                high = middle
        return 0.5 * (low + high)

    @classmethod
    def stacked(cls, lobes, count):
        """Lobes as one, each for `count` orbits in a row: attributes are arrays over orbits."""
        stack = cls.__new__(cls)
        charge = np.array([lobe.potential.anchor for lobe in lobes])
        stack.potential = Potential(lobes[0].potential.parameters, np.repeat(charge, count))
        stack.stiffness, stack.double = lobes[0].stiffness, lobes[0].double
        for name in ("junction", "bottom"):
            values = np.array([getattr(lobe, name) for lobe in lobes])
            setattr(stack, name, np.repeat(values, count))
        return stack

    def well_heights(self, share):
        """H above the bottom where the left turning point is so far towards the junction."""
        way = (self.bottom - self.junction) * share
        bottom = np.full_like(share, self.bottom)
        return self.potential.rise(bottom, -way, np.full_like(share, self.stiffness[0]))

    def well_path(self, share, nodes):
        """Half orbits inside the well, from the left turning point to the right one."""
        u, n2 = self.potential, np.full_like(share, self.stiffness[0])
        way = self.bottom - self.junction
        rest = np.maximum(1.0 - share, NEAREST)
        left = np.where(share < 0.5, self.bottom - way * share, self.junction + way * rest)
        bottom = np.full_like(share, self.bottom)
        zero = np.zeros_like(share)
        right = turning_point(u, left, zero, bottom, bottom - left, n2)
        return path_between(u, n2, left, zero, way * rest, bottom, right, nodes)

    def outer_path(self, excess, nodes):
        """From the junction to the right turning point at H = U(junction) + excess."""
        u, n2 = self.potential, np.full_like(excess, self.stiffness[0])
        left = np.full_like(excess, self.junction)
        bottom = np.full_like(excess, self.bottom)
        scale = np.sqrt(excess / max(self.potential.curvature(0.0, n2[:1])[0], 1e-3))
        first = np.maximum(bottom - left, 1e-9 * np.maximum(scale, excess))
        right = turning_point(u, left, excess, bottom, first, n2)
        distance = WIDE * (right - left)
        if self.double:
            slope = np.abs(u.slope(left, n2))
            bend = np.maximum(-u.curvature(np.abs(left), n2), 0.0)
            with np.errstate(divide="ignore", invalid="ignore"):
                scales = [0.5 * np.sqrt(2.0 * excess / bend), 0.5 * excess / slope]
            distance = np.minimum(distance, np.minimum(*scales))
        middle = left + 0.5 * (right - left)
        gap = u.parameters.gap
        middle = np.where((left < -gap) & (-gap < right), -gap, middle)
        return path_between(u, n2, left, excess, distance, middle, right, nodes)


@dataclass(frozen=True)
class HalfOrbits:
    """Half orbits between their turning points, arrays (levels, nodes) in the order of time.

    `element` is dX at a node, `damping` that of the contact; `nodes` is how many a piece has.
    """

    x: np.ndarray
    speed: np.ndarray
    element: np.ndarray
    damping: np.ndarray
    nodes: int

    @classmethod
    def of(cls, lobe, path):
        """One lobe's path as it is."""
        n2 = np.broadcast_to(lobe.stiffness, path.left.shape)
        damping = contact_damping_on(lobe.potential, path, n2)
        return cls(path.x, path.speed, path.weight, damping, path.x.shape[1] // PIECES)

    def after_mirrored(self, other):
        """The mirror image of another lobe's path, then this one."""

        def joined(mine, theirs):
            return np.concatenate([theirs[:, ::-1], mine], axis=1)

        return HalfOrbits(
            joined(self.x, -other.x),
            joined(self.speed, other.speed),
            joined(self.element, other.element),
            joined(self.damping, other.damping),
            self.nodes,
        )

    def integral(self, integrand):
        """∮ integrand dX, upper and lower half alike."""
        return 2.0 * np.sum(self.element * integrand, axis=1)

    @property
    def area(self):
        """J = ∮X'² dt."""
        return self.integral(self.speed)

    @property
    def period(self):
        """T = ∮dt."""
        return self.integral(1.0 / self.speed)

    def filtered_power(self, rate, damping=0.0):
        """∮X' y dt with rate (rate + damping) y − y'' = X' and y = 0 at both turning points."""
        return filtered_power(self.element, self.speed, self.nodes, rate, damping)

    def noise(self, p):
        """∮X' w dt, (1 + τ1 c) w − τ1² w'' = X', c the damping with that of the contact."""
        time = p.correlation_time
        return self.filtered_power(1.0 / time, p.damping + self.damping) / time**2

    @property
    def contact_work(self):
        """∮(contact damping) X'² dt of the motion whose energy midway between contacts is H.

        A contact takes a share x of its energy while the free flight adds the noise's evenly.
        Balance of both, E' = −(x/duration) E in contact, gives the orbit's own work but for the
        divisor φ + (1 − φ) (x/2) coth(x/2), φ the contact's share of the turn.
        """
        work = self.integral(self.speed * self.damping)
        touching = self.damping > 0.0
        energy = sum(
            np.max(np.where(touching & side, 0.5 * self.speed**2, 0.0), axis=1)
            for side in (self.x > 0.0, self.x < 0.0)
        )
        half = np.maximum(0.5 * work / np.where(energy > 0.0, energy, np.inf), FAINTEST)
        share = self.integral(touching / self.speed) / self.period
        return work / (share + (1.0 - share) * half / np.tanh(half))
