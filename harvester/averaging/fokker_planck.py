"""Closure `fokker_planck`: the stationary density of (X, X', Z, η), without averaging.

The Fokker–Planck equation of Eq. 4 with Z = X − V, Z' = λ(X − Z), is carried on in time by
`propagator`; what P, the propagator over about one period, leaves as it is, is the stationary
density: (1 − P) p = 0, solved by GMRES. It starts from the averaged density of `slow_load`, which
also tells how far the grid must reach, and goes on from grid to grid, each finer in time, X and
X', until the means change by less than the tolerance.

Nothing is assumed of the noise's memory, of the contact's damping or of the load's rate. Where
hardly any motion leaves a well, the grid holds that well alone; the other is its mirror image.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.sparse.linalg import LinearOperator, gmres

from harvester.averaging.averages import Averages
from harvester.averaging.grid_density import GridDensity
from harvester.averaging.propagator import Grid, Propagator, mirrored, shares
from harvester.averaging.slow_load import slow_load
from harvester.averaging.symmetric import potential
from harvester.errors import AveragingError

START = 0.05  # tolerance of the averaged density it starts from
# Steps a period, nodes within the core of the density in X and in X', nodes of Z that are kept
# and Hermite functions of η.
LEVELS = ((8, 3.3, 2.4, 4, 4), (11, 4.2, 3.2, 5, 5), (16, 5.6, 4.4, 6, 6))
# More nodes of Z for each core of the density by which the greatest Z displaces it.
NODES_PER_CORE = 4.0
GREATEST_DISPLACEMENT = 2.0  # in cores: the charge decides there whether there is a well
HOPELESS = 5.0  # tolerances by which a grid may miss for the next one to be tried
FEWEST = 20  # cores that the range of X and of X' has at least
MOST = 3e7  # nodes times steps between two vectors of GMRES: half a minute
DECAY = 0.35  # greatest λ dt of the first grid
FASTEST_DECAY = 40.0  # λ, in units of the period, beyond which that takes too many steps
SLOWEST_DECAY = 2e-3  # λ, in units of the period, below which it takes too many vectors
NEGLIGIBLE = 1e-6  # share of its greatest value below which the density is left out
MARGIN = 1.05
HELD = 4.0  # standard deviations of what the noise holds
ESCAPED = 1e-4  # share of E[V²] that motion out of the well may add before it is followed
PERIODS = 1.5  # between two vectors of GMRES
RESTARTS = 3
RESIDUAL = 1e-5  # of them, as a share of the density and of what the load moves between them
VECTORS = 60
JUDGED = (
    "mean_square_voltage",
    "power_conversion_efficiency",
    "mean_square_velocity",
    "mean_square_displacement",
)


def fokker_planck(parameters, tolerance):
    """Means and densities of the stationary density, on a grid fine enough for the tolerance.

    Parameters
    ----------
    parameters : harvester.averaging.symmetric.SymmetricDevice
    tolerance : float
        Largest numerical error of each mean, as a share of it: the correction by extrapolation
        from two grids, their errors being of second order in the step. Not of the mechanical
        loss, the difference of two powers, which may be small against both.

    Returns
    -------
    Averages

    Raises
    ------
    AveragingError
        An impact velocity held from the moment of contact; a device that `slow_load` refuses;
        the tolerance is not met on the finest grid.
    """
    p = parameters
    if p.held_impact_velocity and p.has_stoppers:
        raise AveragingError(
            'impact_velocity = "event": the speed at the beginning of a contact is no part of the '
            'state that fokker_planck follows; use "energy", or another closure'
        )
    if p.decay_rate * _period(p) > FASTEST_DECAY:
        raise AveragingError(
            f"decay_rate={p.decay_rate:g} is beyond the {FASTEST_DECAY / _period(p):.3g} /s that "
            "fokker_planck has steps for: use slow_load"
        )
    slowest = SLOWEST_DECAY / _period(p)
    if p.decay_rate < slowest:
        return _slow_decay(p, slowest, tolerance)
    return _refined(p, tolerance)


def _slow_decay(p, slowest, tolerance):
    """Means on the straight line through those at two slow rates of decay, towards λ = 0.

    There Z is slow against all else, and the means are linear in λ. Where jumps between the wells
    are slower still, no such line is straight: what it adds counts as numerical error.
    """
    near, far = (
        _refined(p._replace(decay_rate=rate), tolerance) for rate in (slowest, 2.0 * slowest)
    )
    here, there = _totals_of(near), _totals_of(far)
    share = 1.0 - p.decay_rate / slowest
    means = _means(p, {name: (1.0 + share) * here[name] - share * there[name] for name in here})
    level = _means(p, here)
    error = {
        name: near.numerical_error[name] * abs(mean / getattr(near, name)) + abs(mean - level[name])
        for name, mean in means.items()
    }
    worst, excess = _worst(means, error)
    if excess > tolerance:
        raise AveragingError(
            f"decay_rate={p.decay_rate:g}: from {slowest:.3g} /s, the slowest that fokker_planck "
            f"takes by itself, {worst} is continued by {excess:.2g} of itself, more than the "
            f"tolerance of {tolerance:g}: jumps between the wells are as slow; use slow_load"
        )
    return replace(near, **means, numerical_error=error)


def _totals_of(averages):
    """The independent ones of its means."""
    totals = {
        name: getattr(averages, name) for name in JUDGED if name != "power_conversion_efficiency"
    }
    return totals | {"power_in": averages.mean_power + averages.mechanical_loss}


def _worst(means, error):
    """The judged mean with the largest error as a share of it, in words, and that share."""
    excess = {name: error[name] / abs(means[name] or np.inf) for name in JUDGED}
    worst = max(excess, key=excess.get)
    return worst.replace("_", " "), excess[worst]


def _refined(p, tolerance):
    """The answer on the first grid that is fine enough."""
    region = Region.of(p, slow_load(p, START))
    solution = None
    for level in LEVELS:
        coarser, solution = solution, _Solution(p, region, region.grid(p, *level), solution)
        if coarser is None:
            continue
        means, error = _extrapolated(p, coarser, solution)
        worst, excess = _worst(means, error)
        if excess <= tolerance:
            return Averages(
                closure="fokker_planck",
                **means,
                share_in_wells=None,
                numerical_error=error,
                density=solution.density(),
            )
        if excess > HOPELESS * tolerance:
            break
    raise AveragingError(
        f"{worst} is known to {excess:.2g} of itself, not to the "
        f"tolerance of {tolerance:g}, on as fine a grid as is tried: raise it, use slow_load, or "
        "simulate"
    )


def _extrapolated(p, coarse, fine):
    """Means without their error of second order in the step, and what it was on the fine grid."""
    left = 1.0 / ((coarse.grid.step / fine.grid.step) ** 2 - 1.0)
    totals = {
        name: (1.0 + left) * total - left * coarse.totals[name]
        for name, total in fine.totals.items()
    }
    means, raw = _means(p, totals), _means(p, fine.totals)
    return means, {name: abs(mean - raw[name]) for name, mean in means.items()}


def _means(p, totals):
    """The totals, and what the power that comes in turns to."""
    means = dict(totals)
    power_in = means.pop("power_in")
    power = p.coupling * p.decay_rate * means["mean_square_voltage"]
    return means | {
        "mean_power": power,
        "mechanical_loss": power_in - power,
        "power_conversion_efficiency": power / power_in,
    }


class Region(NamedTuple):
    """Where the density is, and how narrow.

    Attributes
    ----------
    left, right : float
        Least and greatest X.
    speed : float
        Greatest |X'|.
    core, core_speed : float
        Half widths of the densities of X and of X' about their peaks.
    centre, reach : float
        Of Z.
    mirrored : bool
        Both wells are in it.
    start : SlowDensity
        Averaged densities.
    """

    left: float
    right: float
    speed: float
    core: float
    core_speed: float
    centre: float
    reach: float
    mirrored: bool
    start: object

    @classmethod
    def of(cls, p, averages):
        """From the averaged densities of a device."""
        density = averages.density
        (left, right, core), (_, speed, core_speed) = (
            _extent(density, name) for name in ("displacement", "velocity")
        )
        speed *= MARGIN
        mirrored = p.rest == 0.0 or _escape(p, averages) > ESCAPED * averages.mean_square_voltage
        if mirrored:
            speed, right = _beyond_saddle(p, speed, right)
            left = -right
        else:
            left, right = right - MARGIN * (right - left), left + MARGIN * (right - left)
        reach = max(MARGIN * p.rest, _following(p, right)) if mirrored else 0.5 * (right - left)
        centre = 0.0 if mirrored else p.rest
        return cls(left, right, speed, core, core_speed, centre, reach, mirrored, density)

    def grid(self, p, steps, fine, fine_speed, nodes, modes):
        """Its nodes, with so many steps a period and nodes to each core."""
        range_x, range_v = self.right - self.left, 2.0 * self.speed
        halves_x = max(range_x / self.core, FEWEST) * fine / 2.0
        halves_v = max(range_v / self.core_speed, FEWEST) * fine_speed / 2.0
        displaced = p.coupling * self.reach / p.angular_frequency**2 / self.core
        if displaced > GREATEST_DISPLACEMENT:
            raise AveragingError(
                f"coupling={p.coupling:g}: the charge displaces the mass by {displaced:.2g} times "
                "the width of its density, too far for fokker_planck: use slow_load"
            )
        nodes += int(np.ceil(NODES_PER_CORE * displaced))
        z = np.polynomial.legendre.leggauss(2 * nodes if self.mirrored else nodes)[0]
        grid = Grid(
            x=np.linspace(self.left, self.right, 2 * int(np.ceil(halves_x))),
            v=np.linspace(-self.speed, self.speed, 2 * int(np.ceil(halves_v))),
            z=self.centre + self.reach * z,
            mirrored=self.mirrored,
            modes=modes,
            step=_longest_step(p) * LEVELS[0][0] / steps,
        )
        if np.prod(grid.shape) * _steps(p, grid) > MOST:
            raise AveragingError(
                f"motion over a range of {range_x:.3g} with a density {2.0 * self.core:.2g} wide "
                f"and decay_rate={p.decay_rate:g} takes more nodes and steps than fokker_planck "
                "has: raise the tolerance, use slow_load, or simulate"
            )
        return grid


def _longest_step(p):
    """Of the first grid (s)."""
    return min(_period(p) / LEVELS[0][0], DECAY / p.decay_rate)


def _steps(p, grid):
    """Between two vectors of GMRES."""
    return int(np.ceil(PERIODS * _period(p) / grid.step))


def _period(p):
    """Of small oscillations (s)."""
    return 2.0 * np.pi / p.angular_frequency


def _extent(density, name):
    """Where, at or above 0, a density begins and ends to matter, and half its peak's width."""
    function, landmarks = getattr(density, name), density.landmarks(name)
    place = np.linspace(0.0, landmarks[-1], 500)
    place = np.unique(np.concatenate([place, landmarks[:: max(1, landmarks.size // 400)]]))
    values = function(place)
    matters = place[values > NEGLIGIBLE * values.max()]
    core = np.trapezoid((values > np.exp(-0.5) * values.max()).astype(float), place)
    # About a peak at 0 that is the right half of it.
    return matters[0], matters[-1], core if values.argmax() == 0 else 0.5 * core


def _escape(p, averages):
    """About what E[V²] gets from motion out of a well: outside, and back with another charge."""
    share = 1.0 - averages.share_in_wells
    return share * p.rest**2 * (1.0 + 2.0 / (p.decay_rate * p.relaxation_time))


def _following(p, right):
    """How far Z follows X: what goes round at the orbits' frequency and what the noise holds."""
    turning = right * p.decay_rate / np.hypot(p.decay_rate, p.angular_frequency)
    held = np.sqrt(p.intensity / max(p.correlation_time, 1e-300)) / p.angular_frequency**2
    memory = p.decay_rate * p.correlation_time
    return min(right, turning + HELD * held * np.sqrt(memory / (1.0 + memory)))


def _beyond_saddle(p, speed, right):
    """Greatest speed and displacement of the orbits that matter, some beyond the saddle."""
    depth = potential(p, 0.0) - potential(p, p.rest)
    energy = max(0.5 * speed**2, 1.44 * depth)
    high = max(right, p.rest, 1e-150)
    while (
        potential(p, high) - potential(p, p.rest) + 0.5 * p.coupling * (high - p.rest) ** 2 < energy
    ):
        high *= 1.02
    return np.sqrt(2.0 * energy), MARGIN * high


class _Solution:
    """Stationary state on one grid, from that on a coarser one or from the averaged density."""

    def __init__(self, p, region, grid, coarser):
        self.grid = grid
        propagator = Propagator(p, grid)
        start = _averaged(p, region, grid) if coarser is None else coarser.on(grid)
        steps = _steps(p, grid)
        # Of what a slow load leaves undone, only so small a share of the density changes at a time.
        tolerance = RESIDUAL * min(1.0, p.decay_rate * steps * grid.step)
        self.before_flow = _stationary(propagator, start, steps, tolerance)
        state = propagator.centred(self.before_flow)
        self.state = state / state[..., 0].sum()
        self.totals = self._totals(_power_in(propagator, self.before_flow))

    def on(self, grid):
        """Its state before the flow on the nodes of another grid."""
        old, state = self.grid, self.before_flow
        moved = np.zeros((*grid.shape[:3], max(grid.modes, state.shape[-1])))
        across = shares(old.z, grid.z)
        if grid.mirrored:
            state = np.concatenate([mirrored(state), state])
            across = across[len(grid.z) // 2 :]
        state = np.tensordot(across, state, axes=1)
        for z in range(state.shape[0]):
            for mode in range(state.shape[-1]):
                spline = RectBivariateSpline(old.x, old.v, state[z, :, :, mode])
                moved[z, :, :, mode] = spline(grid.x, grid.v)
        return moved[..., : grid.modes] / moved[..., 0].sum()

    def _totals(self, power_in):
        mass, grid = self.state[..., 0], self.grid
        both = mass.sum(axis=0)
        totals = {
            "power_in": power_in,
            "mean_square_voltage": np.sum(mass * (grid.x[:, None] - grid.kept[:, None, None]) ** 2),
            "mean_square_velocity": np.sum(both * grid.v**2),
            "mean_square_displacement": np.sum(both * grid.x[:, None] ** 2),
        }
        return {name: float(total) for name, total in totals.items()}

    def density(self):
        """Densities of displacement and velocity, symmetric."""
        grid = self.grid
        area = (grid.x[1] - grid.x[0]) * (grid.v[1] - grid.v[0])
        both = self.state[..., 0].sum(axis=0) / area
        if grid.mirrored:
            both = 0.5 * (both + both[::-1, ::-1])
        return GridDensity(grid.x, grid.v, both, paired=not grid.mirrored)


def _averaged(p, region, grid):
    """The averaged density, with a charge about that of the nearest well."""
    state = np.zeros(grid.shape)
    charge = np.clip(grid.x, -p.rest, p.rest)
    width = 0.5 * region.reach
    charges = np.exp(-(((grid.kept[:, None] - charge) / width) ** 2))
    state[..., 0] = charges[:, :, None] * region.start.joint(grid.x[:, None], grid.v)
    return state / state[..., 0].sum()


def _power_in(propagator, before_flow):
    """What the noise adds to ½X'² in a step, over the step.

    That is known far better than what the stoppers take, in contacts shorter than a step.
    """
    grid, flowed = propagator.grid, propagator.flowed(before_flow)
    gained = np.sum((before_flow - flowed)[..., 0] * grid.v**2)
    return 0.5 * gained / grid.step / before_flow[..., 0].sum()


def _stationary(propagator, start, steps, tolerance):
    """The state, of mass 1, that so many steps change by this share of it at most."""

    def change(flat):
        state = flat.reshape(start.shape)
        for _ in range(steps):
            state = propagator.step(state)
        return flat - state.ravel()

    operator = LinearOperator((start.size, start.size), matvec=change, dtype=float)
    correction, status = gmres(
        operator,
        -change(start.ravel()),
        rtol=0.0,
        atol=tolerance * np.linalg.norm(start),
        restart=VECTORS,
        maxiter=RESTARTS,
    )
    if status:
        raise AveragingError("the stationary density was not reached: use slow_load, or simulate")
    state = start + correction.reshape(start.shape)
    return state / state[..., 0].sum()
