"""The range and width of the stationary density, which a grid must cover and resolve."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from harvester.averaging.flow import PhaseGrid
from harvester.base.errors import AveragingError
from harvester.device import timescales
from harvester.device.system import System, potential

# A density's core is its half width about the narrowest peak, the unit of ranges. A grid has at
# least the nodes of this number of cores.
FEWEST_CORES = 20
# The load's charge displaces the mass; this number of nodes of Z is added per half width of the
# density that the greatest charge displaces it.
NODES_PER_WIDTH = 4.0
# Nodes of Z added if the device is not symmetric: otherwise each node also represents its mirror
# image.
NODES_WITHOUT_MIRROR = 1
# Devices whose charge displaces the mass by more half widths are rejected: the charge may then
# remove a well of the potential.
GREATEST_DISPLACEMENT = 2.0
# Limit of the same displacement while the region is being determined and its width is inaccurate.
HOPELESS_DISPLACEMENT = 4.0
# A normal density falls to 1e-6 of its peak at √(2 ln 1e6) = 5.26 standard deviations.
GIBBS_REACH = 5.3
# A coarse grid resolves a density down to the share SEEN of its peak. A normal density falls to
# 1e-6 at √(ln 1e6 / ln 1e3) = 1.414 times that distance.
SEEN, BEYOND = 1e-3, 1.42
# If the density at an end of the range exceeds this share of its peak, it continues beyond the end.
GATHERED = 1e-4
# Peaks lower than this share of the highest peak do not affect the resolution of the grid.
SECOND_PEAK = 0.2
# The grid's edge lies at least at 1.2² = 1.44 times the energy of the highest saddle: 1.2 times its
# speed.
EDGE_ENERGY_IN_BARRIERS = 1.44
# Correlated noise displaces the mass slowly. The region covers this number of standard deviations
# of that displacement.
HELD_DEVIATIONS = 4.0
# Ratio of the grid's range to the range of the motion.
REGION_MARGIN = 1.05
# From one level to the next the number of nodes, or of steps, grows by this factor.
NODE_REFINEMENT = 4.0 / 3.0
STEP_REFINEMENT = 1.5
# Nodes of Z that the next level adds.
CHARGES_ADDED = 3
# Mass beyond the last node of Z is shared among the nodes by a polynomial, whose weights grow with
# the distance. The nodes extend so far that no weight exceeds this limit.
LARGEST_WEIGHT = 1e2
# Each step redistributes mass among the nodes, with an error of order six in their distance: with
# STEP_REFINEMENT times the steps, this factor on the nodes keeps the error unchanged.
STEADY = STEP_REFINEMENT ** (1.0 / 6.0)
# Strongest shrinking of a region in one attempt: a grid that is much too wide gives no accurate
# width.
STRONGEST_SHRINKING = 0.4
# The search ends if the speeds, cores and ranges of two successive regions have ratios between
# these, and their means differ by less than SAME_MEAN of the range.
SAME_REGION_RATIOS = (0.7, 1.25)
SAME_MEAN = 0.05
# Noise with a correlation time below this share of a step is white.
WHITE_MEMORY = 1e-4


class Level(NamedTuple):
    """Numbers of nodes and steps that define how fine a grid is.

    Attributes
    ----------
    steps
        Steps in a period of small oscillations.
    fine, fine_speed
        Nodes within the core of the density in X and in X'.
    nodes
        Stored nodes of Z, if the charge displaces the mass only slightly.
    modes : Hermite functions of η.
    most
        Largest number of cores that the nodes resolve separately.
    tolerance
        Tolerance of the means; the state is settled to a share of it.
    """

    steps: float
    fine: float
    fine_speed: float
    nodes: int
    modes: int
    most: float = np.inf
    tolerance: float = 0.2

    def more(self, respect: str) -> Level:
        """The next finer level: more "steps", more "nodes" of X and X', or more nodes of Z
        ("charges").

        With more steps it is also slightly finer in space, since each step redistributes mass.
        """
        if respect == "charges":
            return self._replace(nodes=self.nodes + CHARGES_ADDED)
        steps = respect == "steps"
        finer = STEADY if steps else NODE_REFINEMENT
        return self._replace(
            steps=self.steps * (STEP_REFINEMENT if steps else 1.0),
            fine=finer * self.fine,
            fine_speed=finer * self.fine_speed,
            modes=self.modes + steps,
        )


class Region(NamedTuple):
    """Region of the phase plane that a stationary density covers, and the widths of its peaks.

    Attributes
    ----------
    left, right
        Least and greatest X.
    speed
        Greatest |X'|.
    core, core_speed : float
        Half widths of the peaks of the densities of X and X'; of an asymmetric peak, on its steeper
        side.
    width
        Half width of the density of X about its narrowest peak.
    mean
        Mean of X, which is also the mean of the transducer's state Z.
    well
        The only well in the region; None if it covers all wells.
    """

    left: float
    right: float
    speed: float
    core: float
    core_speed: float
    width: float
    mean: float
    well: float | None

    @classmethod
    def guessed(
        cls, device: System, well: float | None = None, speed: float | None = None
    ) -> Region:
        """Region of a Gibbs density; by default with the rms speed of small oscillations."""
        wells = timescales.wells(device) if well is None else (well,)
        frequency = max(timescales.well_frequency(device, x) for x in wells)
        if speed is None:
            speed = np.sqrt(timescales.driven_square_velocity(device, frequency))
        if not 0.0 < speed < np.inf:
            raise AveragingError(
                "nothing damps the motion, so there is no stationary density: add damping"
            )
        cores, mean = (speed / frequency, speed, speed / frequency), 0.5 * (wells[0] + wells[-1])
        return cls.of_speed(device, GIBBS_REACH * speed, cores, mean, well)

    @classmethod
    def fitted(cls, device: System, solution: Any) -> Region:
        """The region of a density that was computed on a coarse grid."""
        density, well, before = solution.density, solution.region.well, solution.region
        x, v = solution.grid.x, solution.grid.v
        along_x, along_v = density.displacement(x), density.velocity(v)
        width, core = _widths(x, along_x)
        cores = np.array([core, _widths(v, along_v)[1], width])
        fastest = BEYOND * np.abs(v)[along_v > SEEN * along_v.max()].max()
        # A grid that is much too wide gives no accurate width.
        speed = max(fastest, STRONGEST_SHRINKING * before.speed)
        least = STRONGEST_SHRINKING * np.array([before.core, before.core_speed, before.width])
        mean = float(x @ along_x / along_x.sum())
        region = cls.of_speed(device, speed, tuple(np.maximum(cores, least)), mean, well)
        if well is None:
            return region
        # The range follows the density of X, since noise with a memory displaces the mass without
        # speed. If the density does not end within the range, the range can only be extended.
        shape = along_x / along_x.max()
        seen = x[shape > SEEN]
        left, right = (
            well + BEYOND * ((x if shape[end] > GATHERED else seen)[end] - well) for end in (0, -1)
        )
        return region._replace(left=min(region.left, left), right=max(region.right, right))

    def leaves_well(self, device: System) -> bool:
        """Whether a range that should hold one well extends beyond the saddle."""
        tops = timescales.beside(device, self.well) if self.well is not None else ()
        return any(self.left < top < self.right for top in tops)

    def alike(self, other: Region) -> bool:
        """Whether another region has about the same width and needs about as many nodes."""
        low, high = SAME_REGION_RATIOS
        ratios = (
            self.speed / other.speed,
            self.core / other.core,
            (self.right - self.left) / (other.right - other.left),
        )
        moved = abs(self.mean - other.mean) / (other.right - other.left)
        return moved < SAME_MEAN and all(low < ratio < high for ratio in ratios)

    @classmethod
    def of_speed(
        cls,
        device: System,
        speed: float,
        cores: tuple[float, float, float],
        mean: float,
        well: float | None,
    ) -> Region:
        """Range in X of a motion with this greatest speed."""
        wells = timescales.wells(device) if well is None else (well,)
        deepest = min(float(potential(device, x)) for x in wells)
        for saddle in timescales.saddles(device) if well is None else ():
            height = float(potential(device, saddle)) - deepest
            speed = max(speed, np.sqrt(2.0 * EDGE_ENERGY_IN_BARRIERS * height))
        left, right = (
            _turning(device, at, side, 0.5 * speed**2 + deepest)
            for at, side in ((wells[-1], -1.0), (wells[0], 1.0))
        )
        spare = (REGION_MARGIN - 1.0) * 0.5 * (right - left)
        return cls(left - spare, right + spare, REGION_MARGIN * speed, *cores, mean, well)

    def grid(self, device: System, level: Level, step: float) -> PhaseGrid:
        """The nodes of a level; for a symmetric device half of them."""
        follows = device.transducer.decay_rate() > 0.0
        mirrored = self.well is None and device.symmetric and follows
        noise = device.noise.correlation_time
        return PhaseGrid(
            x=_nodes(self.left, self.right, self.core, level.fine, level.most),
            v=_nodes(-self.speed, self.speed, self.core_speed, level.fine_speed, level.most),
            z=self._charges(device, level.nodes, mirrored, step) if follows else np.zeros(1),
            mirrored=mirrored,
            modes=level.modes if noise > WHITE_MEMORY * step else 1,
            step=step,
        )

    def displaced(self, device: System) -> float:
        """The displacement of the mass by the greatest Z, in half widths of its density."""
        if device.transducer.decay_rate() == 0.0:
            return 0.0
        _, reach = self._charge(device)
        frequency = timescales.angular_frequency(device)
        return device.transducer.coupling * reach / frequency**2 / self.width

    def check(self, device: System, allowed: float = GREATEST_DISPLACEMENT) -> None:
        """Raise if the charge displaces the mass by more than `allowed` half widths."""
        displaced = self.displaced(device)
        if displaced > allowed:
            raise AveragingError(
                f"the transducer's charge displaces the mass by {displaced:.2g} half widths of its "
                f"density, and the limit of fokker_planck is {GREATEST_DISPLACEMENT:g}: raise the "
                "noise (excitation.intensity), reduce the coupling, or simulate"
            )

    def _charges(self, device, nodes, mirrored, step):
        """Nodes of Z: their range bounds the mass that a step moves beyond them."""
        centre, reach = self._charge(device)
        displaced = min(self.displaced(device), GREATEST_DISPLACEMENT)
        nodes += int(np.ceil(NODES_PER_WIDTH * displaced))
        nodes = 2 * nodes if mirrored else nodes + NODES_WITHOUT_MIRROR
        far = max(self.right - centre, centre - self.left)
        moved = -np.expm1(-device.transducer.decay_rate() * step)
        # Share of the reach beyond the last node within which Chebyshev polynomials stay below the
        # limit.
        beyond = np.cosh(np.arccosh(LARGEST_WEIGHT) / nodes) - 1.0
        reach = max(reach, far * moved / (moved + beyond))
        return centre + reach * np.polynomial.legendre.leggauss(nodes)[0]

    def _charge(self, device):
        """Centre and reach of Z."""
        half = 0.5 * (self.right - self.left)
        if self.well is not None:
            return self.well, half
        wells = timescales.wells(device)
        spare = (REGION_MARGIN - 1.0) * 0.5 * (max(wells) - min(wells))
        low = min(min(wells) - spare, self.mean - _following(device, self.mean - self.left))
        high = max(max(wells) + spare, self.mean + _following(device, self.right - self.mean))
        return 0.5 * (low + high), 0.5 * (high - low)


def _nodes(low, high, core, fine, most):
    """An even number of nodes over a range: `fine` per core, for at most `most` cores."""
    halves = min(max((high - low) / core, FEWEST_CORES), most) * fine / 2.0
    return np.linspace(low, high, 2 * int(np.ceil(halves)))


def _following(device, half):
    """Half range of Z: its oscillation at the orbits' frequency plus the noise's contribution."""
    rate, frequency = device.transducer.decay_rate(), timescales.angular_frequency(device)
    intensity, memory = device.noise
    turning = half * rate / np.hypot(rate, frequency)
    held = np.sqrt(intensity / max(memory, 1e-300)) / frequency**2
    share = rate * memory
    return min(half, turning + HELD_DEVIATIONS * held * np.sqrt(share / (1.0 + share)))


def _turning(device, start, side, energy):
    """Turning point of a motion with this energy on one side of a well, at constant charge."""
    coupling = getattr(device.transducer, "coupling", 0.0)

    def spare(distance):
        level = float(potential(device, start + side * distance)) + 0.5 * coupling * distance**2
        return level - energy

    far = np.sqrt(energy - float(potential(device, start))) / timescales.angular_frequency(device)
    while spare(far) < 0.0:
        far *= 1.3
    return start + side * brentq(spare, 0.0, far)


def _widths(nodes, density):
    """Standard deviations of normal densities as narrow as each peak, and as steep as each side."""
    x = np.linspace(nodes[0], nodes[-1], 2000)
    values = CubicSpline(nodes, density)(x)
    inner = values[1:-1]
    peaks = (inner > values[:-2]) & (inner >= values[2:])
    peaks = 1 + np.flatnonzero(peaks & (inner >= SECOND_PEAK * values.max()))
    peaks = peaks if peaks.size else np.array([values.argmax()])
    sides = []
    for deviations in (1.0, 3.0):
        # Number of standard deviations after which a normal density counts as zero.
        fallen = [values <= np.exp(-0.5 * deviations**2) * values[peak] for peak in peaks]
        left = [_first(low[peak::-1]) for peak, low in zip(peaks, fallen, strict=True)]
        right = [_first(low[peak:]) for peak, low in zip(peaks, fallen, strict=True)]
        sides.append(np.array([left, right]) * (x[1] - x[0]))
    narrow = sides[0].mean(axis=0).min()
    return narrow, min(narrow, sides[1].min() / 3.0)


def _first(flags):
    """Index of the first True; the last index if there is none."""
    return int(flags.argmax()) if flags.any() else flags.size - 1
