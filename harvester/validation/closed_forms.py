"""Means of simple cases that are known without simulation.

Each function returns values and largest allowed deviations of some quantities, or an empty
dictionary if it is not valid.
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

# Largest relative error of a closed form that is used, due to the change of stiffness within the
# motion or the noise's colour.
LARGEST_ERROR = {"small motion": 3e-3, "Gibbs": 2e-2}
# Smallest distance of contacts and saddles, in standard deviations of the displacement.
CLEAR = 6.0

# Value and largest error by quantity.
Means: TypeAlias = dict[str, tuple[float, float]]


def closed_forms(model: Prepared, realizations: int) -> dict[str, Means]:
    """The valid closed forms of a scene by name; none if the load is a netlist.

    Parameters
    ----------
    realizations : int
        Number in the compared run, which start in successive wells.
    """
    if not model.scene.load.is_resistor:
        return {}
    system = model.system
    if isinstance(system.transducer, BaseForcedPiezo):
        # Neither form includes the charge moved by the base.
        return {}
    forms = {
        "small motion": small_motion(system, knot_spacing(model), realizations),
        "Gibbs": gibbs(system),
    }
    return {name: means for name, means in forms.items() if means}


def small_motion(system: System, spacing: float, realizations: int) -> Means:
    """Means of a motion that stays linear about each well: a discrete Lyapunov equation.

    Exact for the engines' noise, which is linear between knots.
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
        """Matrix from (states, η at a knot, η at the next) to the states at `time` after it."""
        transition = expm(drift * time)[:3]
        slope = transition[:, 4] / spacing
        return np.column_stack([transition[:, :3], transition[:, 3] - slope, slope])

    # From knot to knot: states and η, driven by the innovation of η.
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
    """Relative nonlinearity of a motion of this width about a well; inf if it is wide."""
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

    To first order in τ1 the noise's colour reduces the input power by the share cτ1.
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
