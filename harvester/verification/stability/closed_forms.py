"""Means that are known without simulation, where a case is simple enough for them.

Each returns, for the quantities that it knows, their values and how far off they may be; an empty
dictionary where it does not hold.
"""

import math
from typing import TypeAlias

import numpy as np
from scipy.linalg import expm, solve_discrete_lyapunov

from harvester.device import timescales
from harvester.device.system import System, elastic_force, potential
from harvester.prepared.prepared import prepared
from harvester.prepared.steps import knot_spacing
from harvester.scene.model import Scene

# Largest share by which a mean may be off for a closed form to hold: by the change of the stiffness
# within the motion, or by the noise's colour.
LARGEST_ERROR = {"small motion": 3e-3, "Gibbs": 2e-2}
# Standard deviations of the displacement that have to stay clear of contacts and saddles.
CLEAR = 6.0
# Points of a quadrature over displacements.
POINTS = 20_001

# By the quantity: value and largest error.
Means: TypeAlias = dict[str, tuple[float, float]]


def closed_forms(scene: Scene, realizations: int) -> dict[str, Means]:
    """All that hold for a scene with a resistor as its load.

    Parameters
    ----------
    scene : Scene
    realizations : int
        Of the run that is judged: they start in the wells in turn.

    Returns
    -------
    dict of str to dict of str to (float, float)
        By the form's name and the quantity, scaled: value and largest error.
    """
    ready = prepared(scene)
    system = ready.system
    forms = {
        "small motion": small_motion(system, knot_spacing(ready), realizations),
        "Gibbs": gibbs(system),
    }
    return {name: means for name, means in forms.items() if means}


def small_motion(system: System, spacing: float, realizations: int) -> Means:
    """Means of a motion that stays linear about each well: a discrete Lyapunov equation.

    Exact for the noise as the engines take it, linear between its knots.
    """
    open_piezo = not system.transducer.decay_rate() and system.transducer.state_rate(1.0, 0.0)
    if getattr(system.damper, "quadratic_damping", 0.0) or open_piezo:
        return {}
    wells = timescales.wells(system)
    totals, change = dict.fromkeys(("voltage", "velocity", "power", "loss"), 0.0), 0.0
    for index in range(realizations):
        well = wells[index % len(wells)]
        parts, width = _linear_means(system, well, spacing)
        change = max(change, _change_of_stiffness(system, well, width))
        for name, value in parts.items():
            totals[name] += value / realizations
    if not change <= LARGEST_ERROR["small motion"]:
        return {}
    used = totals["power"] + totals["loss"]
    means = {
        "mean_square_voltage": totals["voltage"],
        "mean_square_velocity": totals["velocity"],
        "power_conversion_efficiency": totals["power"] / used if used else 0.0,
    }
    return {name: (float(value), change * abs(float(value))) for name, value in means.items()}


def _linear_means(system, well, spacing):
    """Means about one well, and the standard deviation of the displacement."""
    covariance = _covariance(system, timescales.stiffness(system, well), spacing)
    part = system.transducer
    inner = covariance[1:3, 1:3]

    def mean(power):
        """Of a quadratic form of X' and the transducer's state."""
        own = power(1.0, 0.0), power(0.0, 1.0)
        cross = power(1.0, 1.0) - sum(own)
        return own[0] * inner[0, 0] + own[1] * inner[1, 1] + cross * inner[0, 1]

    loss = mean(lambda v, z: part.loss(v, z, part.current(v, z)))
    means = {
        "voltage": mean(lambda v, z: part.voltage(v, z) ** 2),
        "velocity": inner[0, 0],
        "power": mean(part.load_power),
        "loss": loss + system.damper.damping * inner[0, 0],
    }
    return means, math.sqrt(covariance[0, 0])


def _covariance(system, stiffness, spacing):
    """Of (X, X', transducer's state), averaged over the time between two knots."""
    part, noise = system.transducer, system.noise
    drift = np.zeros((5, 5))
    drift[0, 1] = 1.0
    drift[1, :4] = (
        -stiffness,
        -system.damper.damping - part.force(1.0, 0.0),
        -part.force(0.0, 1.0),
        1.0,
    )
    drift[2, 1], drift[2, 2] = part.state_rate(1.0, 0.0), part.state_rate(0.0, 1.0) or -1.0
    # The noise and its slope between knots.
    drift[3, 4] = 1.0
    rho = math.exp(-spacing / noise.correlation_time)
    variance = noise.intensity / noise.correlation_time

    def carried(time):
        """The three states at a time after a knot, from them, η there and η at the next."""
        whole = expm(drift * time)[:3]
        slope = whole[:, 4] / spacing
        return np.column_stack([whole[:, :3], whole[:, 3] - slope, slope])

    # What is kept from knot to knot: the three states and η, driven by η's own innovation.
    step, kick = np.zeros((4, 4)), np.zeros(4)
    over = carried(spacing)
    step[:3, :3], step[:3, 3], step[3, 3] = over[:, :3], over[:, 3] + rho * over[:, 4], rho
    kick[:3], kick[3] = over[:, 4], 1.0
    innovation = variance * (1.0 - rho * rho)
    knots = solve_discrete_lyapunov(step, innovation * np.outer(kick, kick))
    total = np.zeros((3, 3))
    for time, weight in ((0.0, 1 / 6), (0.5, 2 / 3), (1.0, 1 / 6)):
        part_ = carried(time * spacing)
        known = np.column_stack([part_[:, :3], part_[:, 3] + rho * part_[:, 4]])
        total += weight * known @ knots @ known.T
        total += weight * innovation * np.outer(part_[:, 4], part_[:, 4])
    return total


def _change_of_stiffness(system, well, width):
    """Share by which a motion of this width about a well departs from a linear one; inf if wide."""
    low, high = timescales.free_zone(system)
    inner = low < well < high
    clear = [abs(x - well) for x in (*timescales.saddles(system), *((low, high) if inner else ()))]
    if not CLEAR * width < min(clear, default=math.inf):
        return math.inf
    stiffness = timescales.stiffness(system, well)
    right, left = (float(elastic_force(system, well + side * width)) for side in (1.0, -1.0))
    scale_ = stiffness * width
    even, odd = (right + left) / (2.0 * scale_), (right - left) / (2.0 * scale_) - 1.0
    return 3.0 * (abs(odd) + even * even)


def gibbs(system: System) -> Means:
    """White noise, no loss but the damper's: p ∝ exp{−(c/D)(½X'² + U)}.

    To first order in τ1 the noise's colour takes cτ1 of the power that comes in.
    """
    damping, noise = system.damper.damping, system.noise
    frequency = timescales.fastest_angular_frequency(system)
    elastic = all(getattr(each.law, "damping_factor", 1.0) == 0.0 for each in system.contacts)
    coupled = system.transducer.force(0.0, 1.0) or system.transducer.damping()
    drag = getattr(system.damper, "quadratic_damping", 0.0)
    if coupled or drag or not elastic or not damping > 0.0:
        return {}
    memory = damping * noise.correlation_time
    temperature = noise.intensity / damping / (1.0 + memory)
    errors = {
        "mean_square_velocity": memory**2 + (frequency * noise.correlation_time) ** 2,
        "mean_square_displacement": 2.0 * memory,
    }
    means = {
        "mean_square_velocity": temperature,
        "mean_square_displacement": _gibbs_displacement(system, temperature),
    }
    return {
        name: (means[name], share * means[name])
        for name, share in errors.items()
        if share <= LARGEST_ERROR["Gibbs"]
    }


def _gibbs_displacement(system, temperature):
    """E[X²] by quadrature."""
    reach = abs(timescales.rest(system)) + 1.0
    lowest = min(float(potential(system, x)) for x in timescales.wells(system))
    while min(float(potential(system, s * reach)) for s in (1, -1)) < lowest + 40.0 * temperature:
        reach *= 1.5
    x = np.linspace(-reach, reach, POINTS)
    weight = np.exp(-(potential(system, x) - lowest) / temperature)
    return float(np.sum(weight * x * x) / np.sum(weight))
