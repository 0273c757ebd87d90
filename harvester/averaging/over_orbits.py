"""Stationary means by averaging over orbits: the methods `paper` and `consistent`."""

import math

import numpy as np
from scipy.interpolate import CubicSpline

from harvester.averaging.averages import Averages
from harvester.averaging.density import Layer, OrbitDensity
from harvester.averaging.orbits import edges, settled_orbits, stiffnesses
from harvester.base.errors import AveragingError
from harvester.device import timescales
from harvester.device.damper import Damper
from harvester.device.hertz import HERTZ_EXPONENT, HertzDamp
from harvester.device.piezo import PiezoLaw
from harvester.device.polynomial import Polynomial
from harvester.device.system import System

# Levels of each edge, and nodes of an orbit on either side of the stopper. The difference from the
# coarse grid is the numerical error.
LEVELS, NODES = 400, 32
COARSE_LEVELS, COARSE_NODES = 200, 24


def over_orbits(closure: str, device: System, tolerance: float, memory: bool) -> Averages:
    """The means on a grid, with their change from a coarser one as error."""
    _check(device)
    spans = edges(device, closure)
    means, _ = _solve(closure, spans, COARSE_LEVELS, COARSE_NODES)
    fine, density = _solve(closure, spans, LEVELS, NODES)
    means.pop("mean_period")
    weakest = _weakest_premise(device, fine, fine.pop("mean_period"))
    error = {name: abs(fine[name] - means[name]) for name in fine}
    for name, mean in fine.items():
        # A share of time in the wells may be so small that its relative error does not matter.
        if name != "share_in_wells" and not error[name] <= tolerance * abs(mean):
            raise AveragingError(
                f"{name.replace('_', ' ')} changes from one grid to a finer one by "
                f"{error[name] / abs(mean):.2g} of its value, more than the tolerance of "
                f"{tolerance:g}: use softer stoppers, or simulate"
            )
    return Averages(**fine, numerical_error=error, density=density, weakest_premise=weakest)


def _weakest_premise(device, means, period):
    """Text on the premise that holds worst: a ratio that averaging assumes to be far below 1.

    Raises AveragingError if the noise is correlated for longer than the energy takes to relax by
    all losses (damper, load, contacts).
    """
    rate = (means["mechanical_loss"] + means["mean_power"]) / means["mean_square_velocity"]
    memory = device.noise.correlation_time
    if rate * memory > 1.0:
        raise AveragingError(
            f"correlation_time={memory:g} is above the relaxation time of {1.0 / rate:.3g} s, by "
            "damper, load and contacts; averaging assumes noise whose correlation time is shorter "
            "than the time in which the energy changes: use the method fokker_planck, or simulate"
        )
    barrier = timescales.barrier(device, timescales.rest(device))
    ratios = {
        "correlation time over the relaxation time of the energy": rate * memory,
        "mean period over the relaxation time of the energy": rate * period,
        "mean energy E[X'²] over the barrier": means["mean_square_velocity"] / barrier,
    }
    name = max(ratios, key=lambda name: ratios[name])
    return f"{name} = {ratios[name]:.2g}"


def _check(s):
    """Raise for a device outside Eqs. 10–37, or if averaging over orbits is not valid."""
    laws = [contact.law for contact in s.contacts]
    piezo = isinstance(s.transducer, PiezoLaw)
    refusals = {
        "the spring is not symmetric": not s.spring.symmetric,
        "the spring has a table or a range": not isinstance(s.spring, Polynomial),
        "the spring has powers above the third": s.spring.odd_cubic is None,
        "the damper has a quadratic part": not isinstance(s.damper, Damper),
        "the stoppers are not one pair of equal ones": len(laws) > 1
        or any(contact.side != 0.0 for contact in s.contacts),
        "the contact law is not Hertz's": any(
            not isinstance(law, HertzDamp) or law.exponent != HERTZ_EXPONENT for law in laws
        ),
        "the transducer is not a piezo": not piezo,
        "the piezo leaks": piezo and s.lossy_transducer,
    }
    for reason, holds in refusals.items():
        if holds:
            raise AveragingError(
                f"{reason}: averaging over orbits holds for the symmetric device of Li, Liu "
                "and Li (2023) only; use the method fokker_planck, or simulate"
            )
    linear, cubic = stiffnesses(s)
    if linear <= 0.0 and cubic <= 0.0 and not any(law.stiffness > 0.0 for law in laws):
        raise AveragingError(
            "oscillator.linear_stiffness without cubic_stiffness or stoppers does not confine the "
            "motion; give one of them"
        )
    if linear < 0.0 and s.transducer.coupling >= -linear:
        raise AveragingError(
            f"the open piezo's stiffness is {-s.transducer.coupling / linear:.3g} times "
            "oscillator.linear_stiffness, which leaves no double well; averaging needs less than 1 "
            "(less coupling): use the method fokker_planck"
        )


def _solve(closure, spans, levels, nodes):
    """Dictionary of means, and the densities."""
    families = [settled_orbits(e, np.linspace(a, b, levels), nodes) for e, a, b in spans]
    logarithms = _logarithms(closure, families)
    weights = [np.exp(logarithm) for logarithm in logarithms]
    # In `consistent` each well has its own potential and overlaps the outer orbits: inside the
    # outer orbits only the wells count. In `paper` the density of the innermost outer orbit
    # continues inside.
    overlap = families[0].edge.anchor > 0.0
    cores = [dict.fromkeys(families[0].enclosed, 0.0)]
    if len(families) == 2:
        filling, orbit_index = (families[1], 0) if overlap else (families[0], -1)
        cores += [{name: values[orbit_index] for name, values in filling.enclosed.items()}]
    parts = [_means(*arguments) for arguments in zip(families, weights, cores, strict=True)]
    masses = [part.pop("mass") for part in parts]
    norm = sum(masses)
    total = {name: sum(part[name] for part in parts) / norm for name in parts[0]}
    transducer = spans[0][0].system.transducer
    power = transducer.coupling * transducer.decay_rate() * total["mean_square_voltage"]
    total["mean_power"] = power
    total["power_conversion_efficiency"] = power / (power + total["mechanical_loss"])
    total["share_in_wells"] = masses[0] / norm if len(masses) == 2 else 0.0
    logarithms = [logarithm - np.log(norm) for logarithm in logarithms]
    layers = [Layer(families[-1], logarithms[-1], filled=not overlap)]
    if len(families) == 2:
        floor = 0.0 if overlap else np.exp(logarithms[-1][0])
        layers += [Layer(families[0], logarithms[0], floor=floor)]
    return {name: float(value) for name, value in total.items()}, OrbitDensity(tuple(layers))


def _logarithms(closure, families):
    """ln g on each edge, greatest value 0.

    `paper` (Eqs. 21, 22 and 25) is g = p/T = C/S(ω) exp(−∫B/(πSJ) dH), with one C for wells and
    outer orbits, which share their potential at the separatrix. `consistent` has no 1/S(ω), and
    its wells join the outer orbit that has the energy of the wells' saddle, ½X'² + U with the
    piezo's ½N2(X − X*)² in it: the mass leaves a well with the charge it had there.
    """
    logarithms = [-orbits.exponent() for orbits in families]
    if len(families) == 2:
        wells, outer = families
        logarithms[0] -= logarithms[0][-1]
        if closure == "consistent":
            logarithms[1] -= np.interp(wells.energy[-1], outer.energy, logarithms[1])
    if closure == "paper":
        spectra = [orbits.spectrum for orbits in families]
        logarithms = [ln - np.log(power) for ln, power in zip(logarithms, spectra, strict=True)]
    greatest = max(logarithm.max() for logarithm in logarithms)
    return [logarithm - greatest for logarithm in logarithms]


def _means(orbits, weight, core):
    """One edge's contributions to the means and its mass, before normalisation.

    The area inside the innermost orbit has that orbit's g and V(X, X'), except the `core` of other
    orbits.
    """
    s, enclosed, ends = orbits.edge.system, orbits.enclosed, orbits.level[[0, -1]]

    def mean(values, name):
        """∬ values g dX dX' times 1, X, X² or X'²."""
        values = weight * values
        change = values * CubicSpline(orbits.level, enclosed[name]).derivative()(orbits.level)
        inside = values[0] * (enclosed[name][0] - core[name])
        # The integrals cover a quarter of the phase plane.
        return 4.0 * (inside + CubicSpline(orbits.level, change).integrate(*ends))

    # Eq. 10 is evaluated about X*: the bottom of the orbit in `paper`, a common point in
    # `consistent`.
    centre = orbits.edge.bottom(orbits.added) if orbits.edge.inside else 0.0
    across = orbits.gain**2
    along = (s.transducer.decay_rate() * orbits.gain / orbits.frequency**2) ** 2
    voltage = mean(across, "X²") + mean(along, "X'²")
    voltage += mean(across * centre**2, "1") - 2.0 * mean(across * centre, "X")
    velocity, contact = mean(1.0, "X'²"), mean(orbits.contact_work / orbits.time, "1")
    return {
        "mass": mean(1.0, "1"),
        "mean_square_voltage": voltage,
        "mechanical_loss": s.damper.damping * velocity + contact,
        "mean_square_velocity": velocity,
        "mean_square_displacement": mean(1.0, "X²"),
        "mean_period": mean(2.0 * math.pi / orbits.frequency, "1"),
    }
