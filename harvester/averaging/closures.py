"""Stationary means by three closures: two of quasi-conservative averaging, one without."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline

from harvester.averaging.averages import Averages
from harvester.averaging.density import Branch, Density
from harvester.averaging.edges import follow, outer_range, well_range
from harvester.averaging.fokker_planck import fokker_planck
from harvester.averaging.orbits import OuterEdge, Potential, WellEdge
from harvester.averaging.symmetric import symmetric_device
from harvester.errors import AveragingError
from harvester.files.plain_text import nearest

if TYPE_CHECKING:
    from harvester.device.system import System

CLOSURES = ("paper", "consistent", "fokker_planck")
DEFAULT_CLOSURE = "fokker_planck"  # holds most widely
LEVELS, NODES = 400, 24  # levels of each edge, quadrature nodes on each piece of an orbit
COARSE_LEVELS, COARSE_NODES = 200, 16  # the grid that tells the numerical error
# Largest numerical error that is an answer, as a share of it, unless another is asked for.
TOLERANCES = {"paper": 1e-3, "consistent": 1e-3, "fokker_planck": 1e-2}


def average(
    device: System,
    closure: str = DEFAULT_CLOSURE,
    tolerance: float | None = None,
    memory: bool = False,
) -> Averages:
    """Means and densities of a device by stochastic averaging, or by what it approximates.

    Parameters
    ----------
    device : harvester.device.system.System
    closure : {"paper", "consistent", "fokker_planck"}
    tolerance : float, optional
        Largest numerical error that is an answer, as a share of it; the closure's own of
        `TOLERANCES` by default. `fokker_planck` refines its grid until it is met.
    memory : bool
        Of `fokker_planck`: also find the slowest decay rate between wells.

    Returns
    -------
    Averages

    Raises
    ------
    AveragingError
        Unknown closure; motion that nothing confines or damps; means that the grid does not
        resolve. Of the first two also a device other than the source paper's, noise that outlasts
        the relaxation time, and β ≥ ω0² of a bistable device.

    Notes
    -----
    `paper` is Eqs. 10–37 with κ in Eq. 15, the stoppers' spring opposed on either side and 2T in
    Eq. 26 below the barrier. `consistent` keeps the force −N2 X* of Eq. 11 in the potential, takes
    V about each well's rest position, and lets g = p/T obey d ln g/dH = −B/(πSJ), the flux form,
    where Eqs. 21, 22 and 25 have a further 1/S(ω) in g: the drift πS(ω) lacks dS/dH. Deviation of
    E[V²] from simulation of the scene `paper` in percent, at (D, τ1):

    ==========================  =========  ========  ========  =======
    `consistent`, other choice  .005, .4   .02, .4   .02, 1    .1, .4
    ==========================  =========  ========  ========  =======
    as built                    +1.2       +1.2      −0.5      −36
    with 1/S(ω)                 +1.0       −3.8      −0.7      −49
    wells joined at equal g     +1.2       −2.5      −0.5      −46
    ==========================  =========  ========  ========  =======

    `consistent` is for motion inside a well: it misses the slow part of V after a jump. Noise and
    contact must be weak per period; on a preloaded stopper (gap 0.95, D = 0.01) it is 11 % low.
    The densities of `paper` have a step at the separatrix; those of `consistent`, whose wells
    and outer orbits overlap in the phase plane, have one at the ends of each.
    """
    if closure not in CLOSURES:
        known = ", ".join(CLOSURES)
        raise AveragingError(f"{closure}: no such closure{nearest(closure, CLOSURES)}; use {known}")
    if tolerance is None:
        tolerance = TOLERANCES[closure]
    if closure == "fokker_planck":
        return fokker_planck(device, tolerance, memory)
    parameters = symmetric_device(device)
    _check(parameters)
    edges = _edges(parameters, closure)
    means, _ = _solve(parameters, closure, edges, COARSE_LEVELS, COARSE_NODES)
    fine, density = _solve(parameters, closure, edges, LEVELS, NODES)
    error = {name: abs(fine[name] - means[name]) for name in fine}
    _check_resolved(fine, error, tolerance)
    return Averages(closure=closure, **fine, numerical_error=error, density=density)


def _check(p):
    if p.linear_stiffness <= 0.0 and p.cubic_stiffness <= 0.0 and not p.has_stoppers:
        raise AveragingError(
            f"linear_stiffness={p.linear_stiffness:g} without cubic_stiffness or stoppers does "
            "not confine the motion; give one of them"
        )
    if p.correlation_time > p.relaxation_time:
        raise AveragingError(
            f"correlation_time={p.correlation_time:g} is above the relaxation time of "
            f"{p.relaxation_time:.3g} s; averaging assumes noise that forgets before the energy "
            "changes: use the closure fokker_planck, or simulate"
        )
    if p.linear_stiffness < 0.0 and p.coupling >= -p.linear_stiffness:
        raise AveragingError(
            f"coupling={p.coupling:g} leaves no double well against "
            f"linear_stiffness={p.linear_stiffness:g}; averaging needs coupling below "
            f"{-p.linear_stiffness:g}: use the closure fokker_planck"
        )


def _check_resolved(means, error, tolerance):
    """Refuse what a finer grid changes; the share in wells may be too small to matter."""
    for name, mean in means.items():
        if name != "share_in_wells" and not error[name] <= tolerance * abs(mean):
            raise AveragingError(
                f"{name.replace('_', ' ')} changes from one grid to a finer one by "
                f"{error[name]:.2g} of {mean:.3g}, more than {tolerance:g} of itself: "
                "use softer stoppers, or simulate"
            )


def _edges(p, closure):
    """(edge, first level, last level) of the wells, if there are any, and of the outer orbits."""
    rate = p.damping + p.coupling / p.decay_rate
    outer = OuterEdge(Potential(p), p.intensity / (rate or 1.0 / p.correlation_time))
    first, last = outer_range(outer, p)
    if not outer.bistable:
        return [(outer, first, last)]
    if _overlap(p, closure):
        wells, reach = WellEdge(Potential(p, anchor=p.rest)), np.inf
    else:
        # One potential for all: no well reaches out of the first outer orbit.
        wells = WellEdge(Potential(p))
        reach = follow(outer, p, np.array([first]), NODES).orbits.right[0]
    return [(wells, *well_range(wells, p, reach)), (outer, first, last)]


def _solve(p, closure, edges, levels, nodes):
    """Dictionary of means, and the densities."""
    stretches = [follow(e, p, np.linspace(a, b, levels), nodes) for e, a, b in edges]
    logarithms = _logarithms(p, closure, stretches)
    densities = [np.exp(logarithm) for logarithm in logarithms]
    enclosed = _enclosed(p, closure, stretches)
    parts = [
        _means(p, closure, s, g, held)
        for s, g, held in zip(stretches, densities, enclosed, strict=True)
    ]
    masses = [part.pop("mass") for part in parts]
    norm = sum(masses)
    total = {name: sum(part[name] for part in parts) / norm for name in parts[0]}
    power = p.coupling * p.decay_rate * total["mean_square_voltage"]
    total["mean_power"] = power
    total["power_conversion_efficiency"] = power / (power + total["mechanical_loss"])
    total["share_in_wells"] = masses[0] / norm if len(masses) == 2 else 0.0
    density = Density(
        branches=_branches(stretches, logarithms, enclosed),
        norm=norm,
        energy={
            "wells" if s.edge.lobes == 2 else "outer": _energy_density(s, g / norm)
            for s, g in zip(stretches, densities, strict=True)
        },
    )
    return {name: float(value) for name, value in total.items()}, density


def _overlap(p, closure):
    """Whether wells and outer orbits have different potentials and share places."""
    return closure == "consistent" and p.coupling > 0.0


def _enclosed(p, closure, stretches):
    """Per edge, the moments (J, ∬X², ∬X'²) of other edges' orbits inside its innermost orbit.

    None where the inside is no part of the edge: outer orbits of `consistent` have wells of
    another potential, which overlap them.
    """
    nothing = (0.0, 0.0, 0.0)
    if len(stretches) == 1:
        return [nothing]
    if _overlap(p, closure):
        return [nothing, None]
    o, pivot = stretches[0].orbits.take(-1), stretches[0].pivot
    square = o.second_moment + 2.0 * pivot * o.first_moment + pivot**2 * o.area
    return [nothing, (2.0 * o.area, 2.0 * square, 2.0 * o.speed_moment)]


def _branches(stretches, logarithms, enclosed):
    """Where the outer density goes on inside, the wells stand for the difference to it."""
    filled = enclosed[-1] is not None
    floor = np.exp(logarithms[-1][0]) if filled else 0.0
    outer = Branch(stretches[-1], logarithms[-1], filled)
    wells = [
        Branch(s, logarithm, True, floor)
        for s, logarithm in zip(stretches[:-1], logarithms[:-1], strict=True)
    ]
    return (*wells, outer)


def _logarithms(p, closure, stretches):
    """ln g on each edge, greatest value 0.

    `paper` (Eqs. 21, 22 and 25) is g = p/T = C/S(ω) exp(−∫B/(πSJ) dH), with one C for wells and
    outer orbits, which share their potential at the separatrix. `consistent` has no 1/S(ω), and
    its wells join the outer orbit that has the energy of the wells' saddle, ½X'² + U with the
    piezo's ½N2(X − X*)² in it: the mass leaves a well with the charge it had there.
    """
    exponents = [stretch.exponent(p) for stretch in stretches]
    if len(stretches) == 2:
        wells, outer = stretches
        exponents[0] -= exponents[0][-1]
        if closure == "consistent":
            saddle = wells.orbits.energy[-1]
            exponents[1] -= np.interp(saddle, outer.orbits.energy, exponents[1])
    logarithms = [-exponent for exponent in exponents]
    if closure == "paper":
        logarithms = [ln - np.log(s.spectrum) for ln, s in zip(logarithms, stretches, strict=True)]
    greatest = max(logarithm.max() for logarithm in logarithms)
    return [logarithm - greatest for logarithm in logarithms]


def _means(p, closure, stretch, density, enclosed):
    """One edge's contributions to the means and its mass, before normalisation."""
    o, pivot = stretch.orbits, stretch.pivot

    def mean(weight, moment, inside=0.0):
        return _over_area(stretch, density * weight, moment, inside)

    area, square, speed = enclosed or (None, None, None)
    # Eq. 10 about X*: the orbit's own bottom in `paper`, one point for all in `consistent`.
    in_well = stretch.edge.lobes == 2
    centre = o.bottom - pivot if in_well and closure == "paper" else np.zeros_like(o.bottom)
    across, along = stretch.gain**2, (p.decay_rate * stretch.gain / stretch.frequency**2) ** 2
    voltage = mean(across, o.second_moment, square) + mean(along, o.speed_moment, speed)
    displacement = mean(1.0, o.second_moment, square)
    if in_well:
        voltage += mean(across * centre**2, o.area) - 2.0 * mean(across * centre, o.first_moment)
        displacement += pivot**2 * mean(1.0, o.area) + 2.0 * pivot * mean(1.0, o.first_moment)
    velocity = mean(1.0, o.speed_moment, speed)
    contact = mean(o.contact_work / o.period, o.area, area)
    return {
        "mass": mean(1.0, o.area, area),
        "mean_square_voltage": voltage,
        "mechanical_loss": p.damping * velocity + contact,
        "mean_square_velocity": velocity,
        "mean_square_displacement": displacement,
    }


def _over_area(stretch, weight, moment, enclosed):
    """∫ weight · d(moment) over the edge, with what its innermost orbit alone encloses."""
    change = weight * stretch.derivative(moment)
    total = CubicSpline(stretch.level, change).integrate(stretch.level[0], stretch.level[-1])
    if enclosed is not None:
        total += weight[0] * (moment[0] - enclosed)
    return stretch.edge.lobes * total


def _energy_density(stretch, density):
    """H above the potential's minimum, and p(H) = gT of all lobes (Eq. 26)."""
    o, u = stretch.orbits, stretch.edge.potential
    start = o.energy[0] - u.energy(o.bottom[0], o.added_stiffness[0])
    height = np.maximum.accumulate(start + stretch.integral(1.0))  # steps end near the saddle
    return height, stretch.edge.lobes * density * o.period
