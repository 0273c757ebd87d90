"""Means that are known without simulation, where a case is simple enough for them.

Each function returns the values of some quantities with their largest allowed deviations, or an
empty dictionary where it does not hold.
"""

import math
from typing import TypeAlias

import numpy as np
from scipy.linalg import expm, solve_discrete_lyapunov

from harvester.device import timescales
from harvester.device.piezo import BaseForcedPiezo
from harvester.device.system import System, elastic_force, potential
from harvester.scene.prepared import Prepared
from harvester.scene.steps import knot_spacing
from harvester.validation import EFFICIENCY, VELOCITY, VOLTAGE
from harvester.validation.formulas import gibbs_mean

# A closed form is used if its own error is at most this share of a mean: by the change of the
# stiffness within the motion, or by the colour of the noise.
LARGEST_ERROR = {"small motion": 3e-3, "Gibbs": 2e-2}
# Least distance of contacts and saddles, in standard deviations of the displacement.
CLEAR = 6.0

# For each quantity its value and its largest error.
Means: TypeAlias = dict[str, tuple[float, float]]


def closed_forms(model: Prepared, realizations: int) -> dict[str, Means]:
    """The forms that hold for a scene, by their names; none where the load is a netlist.

    Parameters
    ----------
    realizations : int
        Number in the compared run: they start in successive wells.
    """
    if not model.scene.load.is_resistor:
        return {}
    system = model.system
    if isinstance(system.transducer, BaseForcedPiezo):
        # Neither form has the charge that the base moves.
        return {}
    forms = {
        "small motion": small_motion(system, knot_spacing(model), realizations),
        "Gibbs": gibbs(system),
    }
    return {name: means for name, means in forms.items() if means}


def small_motion(system: System, spacing: float, realizations: int) -> Means:
    """Means of a motion that stays linear about each well: a discrete Lyapunov equation.

    Exact for the noise as the engines take it, linear between its knots.
    """
    part = system.transducer
    open_piezo = not part.decay_rate() and part.state_rate(1.0, 0.0)
    if _drag(system) or open_piezo:
        return {}
    wells = timescales.wells(system)
    totals, change = np.zeros(4), 0.0
    for index in range(realizations):
        well = wells[index % len(wells)]
        means, width = _linear_means(system, well, spacing)
        change = max(change, _change_of_stiffness(system, well, width))
        totals += np.array(means) / realizations
    if not change <= LARGEST_ERROR["small motion"]:
        return {}
    voltage, velocity, power, loss = (float(total) for total in totals)
    efficiency = power / (power + loss) if power + loss else 0.0
    means = {VOLTAGE: voltage, VELOCITY: velocity, EFFICIENCY: efficiency}
    return {name: (value, change * abs(value)) for name, value in means.items()}


def _linear_means(system, well, spacing):
    """E[V²], E[X'²], power and loss about one well; the standard deviation of the displacement."""
    covariance = _covariance(system, timescales.stiffness(system, well), spacing)
    part = system.transducer
    inner = covariance[1:3, 1:3]

    def mean(power):
        """Mean of a quadratic form of X' and the transducer's state."""
        squares = power(1.0, 0.0), power(0.0, 1.0)
        cross = power(1.0, 1.0) - sum(squares)
        return squares[0] * inner[0, 0] + squares[1] * inner[1, 1] + cross * inner[0, 1]

    loss = mean(lambda v, z: part.loss(v, z, part.current(v, z)))
    loss += system.damper.damping * inner[0, 0]
    square_voltage = mean(lambda v, z: part.voltage(v, z) ** 2)
    means = square_voltage, inner[0, 0], mean(part.load_power), loss
    return means, math.sqrt(covariance[0, 0])


def _covariance(system, stiffness, spacing):
    """Covariance of (X, X', transducer's state), averaged over the time between two knots."""
    part, noise = system.transducer, system.noise
    drift = np.zeros((5, 5))
    drift[0, 1] = 1.0
    resistance = system.damper.damping + part.force(1.0, 0.0)
    drift[1, :4] = -stiffness, -resistance, -part.force(0.0, 1.0), 1.0
    drift[2, 1], drift[2, 2] = part.state_rate(1.0, 0.0), part.state_rate(0.0, 1.0) or -1.0
    # States 3 and 4 are the noise and its slope between knots.
    drift[3, 4] = 1.0
    rho = math.exp(-spacing / noise.correlation_time)
    variance = noise.intensity / noise.correlation_time

    def carried(time):
        """Matrix to the three states at a time after a knot, from (states, η at the knot, η
        at the next one)."""
        transition = expm(drift * time)[:3]
        slope = transition[:, 4] / spacing
        return np.column_stack([transition[:, :3], transition[:, 3] - slope, slope])

    # From knot to knot: the three states and η, driven by the innovation of η.
    step, kick = np.zeros((4, 4)), np.zeros(4)
    over = carried(spacing)
    step[:3, :3], step[:3, 3], step[3, 3] = over[:, :3], over[:, 3] + rho * over[:, 4], rho
    kick[:3], kick[3] = over[:, 4], 1.0
    innovation = variance * (1.0 - rho * rho)
    knots = solve_discrete_lyapunov(step, innovation * np.outer(kick, kick))
    total = np.zeros((3, 3))
    for time, weight in ((0.0, 1 / 6), (0.5, 2 / 3), (1.0, 1 / 6)):
        part_ = carried(time * spacing)
        transfer = np.column_stack([part_[:, :3], part_[:, 3] + rho * part_[:, 4]])
        total += weight * transfer @ knots @ transfer.T
        total += weight * innovation * np.outer(part_[:, 4], part_[:, 4])
    return total


def _change_of_stiffness(system, well, width):
    """Share by which a motion of this width about a well departs from a linear one; inf if wide."""
    low, high = timescales.free_zone(system)
    inner = low < well < high
    clear = [abs(x - well) for x in (*timescales.saddles(system), *((low, high) if inner else ()))]
    if not CLEAR * width < min(clear, default=math.inf):
        return math.inf
    force = timescales.stiffness(system, well) * width
    right, left = (float(elastic_force(system, well + side * width)) for side in (1.0, -1.0))
    even, odd = (right + left) / (2.0 * force), (right - left) / (2.0 * force) - 1.0
    return 3.0 * (abs(odd) + even * even)


def gibbs(system: System) -> Means:
    """White noise, no loss but the damper's: p ∝ exp{−(c/D)(½X'² + U)}.

    To first order in τ1 the noise's colour takes cτ1 of the power that comes in.
    """
    damping, noise = system.damper.damping, system.noise
    elastic = all(getattr(contact.law, "damping_factor", 1.0) == 0.0 for contact in system.contacts)
    coupled = system.transducer.force(0.0, 1.0) or system.transducer.damping()
    if coupled or _drag(system) or not elastic or not damping > 0.0:
        return {}
    memory = damping * noise.correlation_time
    temperature = noise.intensity / damping / (1.0 + memory)
    reach = abs(timescales.rest(system)) + 1.0
    square = gibbs_mean(lambda x: potential(system, x), temperature, np.square, reach)
    fastest = timescales.fastest_angular_frequency(system) * noise.correlation_time
    means = {
        VELOCITY: (temperature, memory**2 + fastest**2),
        "mean_square_displacement": (square, 2.0 * memory),
    }
    limit = LARGEST_ERROR["Gibbs"]
    return {n: (value, share * value) for n, (value, share) in means.items() if share <= limit}


def _drag(system):
    return getattr(system.damper, "quadratic_damping", 0.0)
