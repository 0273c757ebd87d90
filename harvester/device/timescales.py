"""Rest positions and time scales of a device: wells, frequencies, relaxation, contacts.

Functions of a `System`, in its scaled units; results are cached, since a system is immutable.
"""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING

import numpy as np

from harvester.device import contact as contacts
from harvester.device.system import elastic_force, potential

if TYPE_CHECKING:
    from harvester.device.system import System

# The default step resolves motion up to this energy, in units of the mean-square velocity E[X'²].
# The density of the energy H falls as exp(−H/E[X'²]), so the energy exceeds this limit for less
# than 1 % of the time.
RESOLVED_ENERGY = 5.0
# Points of the search for equilibria, and nodes of the describing function, which is exact up to
# the seventh power.
SEARCH_POINTS, HARMONIC_NODES = 4001, 16

cached = functools.lru_cache(maxsize=256)


@cached
def equilibria(system: System) -> tuple[tuple[float, bool], ...]:
    """Displacements without a force, ascending, and whether each is stable.

    Spring and contacts together, without charge or current in the transducer. Stable and unstable
    equilibria alternate if the potential is bounded from below.
    """
    reach = _reach(system)
    # Without contact, the spring's roots are exact to the last digit.
    free = free_zone(system)
    exact = [float(x) for x in system.spring.roots() if free[0] <= x <= free[1]]
    points = np.unique(np.concatenate([np.linspace(-reach, reach, SEARCH_POINTS), _finite(free)]))
    low, high = system.spring.range
    points = points[(points >= low) & (points <= high)]
    values = elastic_force(system, points)
    crossings = []
    for k in np.flatnonzero(values[:-1] * values[1:] <= 0.0):
        left, right = points[k], points[k + 1]
        if values[k] == values[k + 1] or (values[k + 1] == 0.0 and k + 2 < points.size):
            continue
        inside = [x for x in exact if left <= x <= right]
        root = inside[0] if len(inside) == 1 else _balance(system, left, right)
        # Adding 0.0 turns −0.0 into 0.0.
        crossings.append((_polished(system, root) + 0.0, bool(values[k + 1] > values[k])))
    return tuple(crossings)


@cached
def wells(system: System) -> tuple[float, ...]:
    """Stable rest positions, from right to left: tuple of float."""
    well = _double_well(system)
    if well is not None:
        return (well, -well) if well > 0.0 else (0.0,)
    return tuple(x for x, stable in reversed(equilibria(system)) if stable)


@cached
def saddles(system: System) -> tuple[float, ...]:
    """Unstable equilibria between the wells, from right to left: tuple of float."""
    well = _double_well(system)
    if well is not None:
        return (0.0,) if well > 0.0 else ()
    return tuple(x for x, stable in reversed(equilibria(system)) if not stable)


def bistable(system: System) -> bool:
    """Whether there is more than one well."""
    return len(wells(system)) > 1


def rest(system: System) -> float:
    """The rest position on the right, where the first realization starts."""
    return wells(system)[0]


def _double_well(system):
    """The well at X ≥ 0 of a linear-cubic spring between equal stoppers; None for other devices.

    For the force −ω0² X + κ X³ the well lies at √(ω0²/κ), or if the gap is smaller, where the mass
    is pressed against the stopper.
    """
    stiffnesses = system.spring.odd_cubic
    if stiffnesses is None or not system.symmetric:
        return None
    linear, cubic = stiffnesses
    if linear >= 0.0:
        return 0.0
    well = math.sqrt(-linear / cubic) if cubic > 0.0 else math.inf
    gap = free_zone(system)[1]
    return well if gap >= well else _pressed(system, gap)


def _pressed(system, gap):
    """Displacement beyond the gap at which spring and stopper balance."""
    far, step = gap, 0.1 * gap
    while elastic_force(system, far) <= 0.0:
        far += step
        step *= 2.0
    return _balance(system, gap, far)


def _balance(system, left, right):
    """The root of the elastic force between two displacements at which it has different signs."""
    from scipy.optimize import brentq

    def force(x):
        return float(elastic_force(system, x))

    return brentq(force, left, right, xtol=1e-15, rtol=1e-15)


def free_zone(system: System) -> tuple[float, float]:
    """(low, high) between which no contact is active."""
    edges = contacts.edges(system.contacts)
    low = max(edge for edge in edges if edge <= 0.0)
    return low, min(edge for edge in edges if edge > 0.0)


def _finite(values):
    return [value for value in values if math.isfinite(value)]


def _reach(system):
    """A distance beyond all equilibria, at which the force points inwards on both sides."""
    places = [abs(x) for x in system.spring.roots()]
    places += [abs(edge) for edge in _finite(contacts.edges(system.contacts))]
    reach = 1.25 * max(places, default=1.0) or 1.0
    for _ in range(60):
        if elastic_force(system, reach) > 0.0 > elastic_force(system, -reach):
            return reach
        reach *= 1.5
    return reach


def _polished(system, x):
    """A root of the spring's force refined by two Newton steps, if no contact is active there."""
    low, high = free_zone(system)
    if low < x < high:
        for _ in range(2):
            slope = float(system.spring.slope(x))
            if slope != 0.0:
                x -= float(system.spring.force(x)) / slope
    return x


@cached
def stiffness(system: System, x: float) -> float:
    """U''(x) of the spring and the compressed contacts (1/s²)."""
    total = float(system.spring.slope(x))
    for contact in system.contacts:
        s = math.copysign(1.0, x) if contact.side == 0.0 else contact.side
        depth = s * x - contact.gap
        if depth > 0.0:
            total += contact.law.elastic_stiffness(depth)
    return total


def well_frequency(system: System, well: float) -> float:
    """The angular frequency (rad/s) of small oscillations about a well, with the transducer open.

    If this frequency is zero, the characteristic rate of the noise is returned.
    """
    mechanical = stiffness(system, well)
    total = mechanical + system.transducer.stiffness(mechanical)
    return math.sqrt(total) if total > 0.0 else 1.0 / system.noise.correlation_time


@cached
def angular_frequency(system: System) -> float:
    """Angular frequency (rad/s) of small oscillations about the stiffest well, transducer open."""
    return max(well_frequency(system, well) for well in wells(system))


def loaded_frequency(system: System) -> float:
    """Angular frequency (rad/s) of small oscillations about the stiffest well, with the load.

    Charge that decays at the rate λ adds ω²/(λ² + ω²) of the open transducer's stiffness. For a
    netlist λ is 0.
    """
    well = max(wells(system), key=lambda well: well_frequency(system, well))
    mechanical, decay = stiffness(system, well), system.transducer.decay_rate()
    if mechanical <= 0.0 or not math.isfinite(decay):
        return angular_frequency(system)
    half = 0.5 * (mechanical + system.transducer.stiffness(mechanical) - decay**2)
    return math.sqrt(half + math.sqrt(half**2 + mechanical * decay**2))


def loss_rate(system: System, frequency: float) -> float:
    """c + N1 of Eq. 12: the rate at which damper and transducer dissipate energy (1/s)."""
    return system.damper.damping + system.transducer.loss_rate(frequency)


def relaxation_time(system: System) -> float:
    """Relaxation time of the energy of small oscillations by damper and load (s).

    1/(c + βλ/(λ² + ω²)), Eq. 12; infinite without damper and load.
    """
    rate = loss_rate(system, angular_frequency(system))
    return 1.0 / rate if rate > 0.0 else math.inf


def driven_square_velocity(system: System, frequency: float) -> float:
    """Mean-square velocity E[X'²] of motion at a frequency ω under noise, D/(1 + ω²τ1²) over the
    rate of loss (Eqs. 12, 20)."""
    loss = loss_rate(system, frequency)
    colour = 1.0 + (frequency * system.noise.correlation_time) ** 2
    square = system.noise.intensity / (loss * colour) if loss > 0.0 else math.inf
    drag = getattr(system.damper, "quadratic_damping", 0.0)
    if drag > 0.0:
        # With quadratic drag alone C2 E|X'|³ = D, and E|X'|³ = √(8/π) σ³ for a normal velocity.
        power = system.noise.intensity / colour
        square = min(square, (power / (drag * math.sqrt(8.0 / math.pi))) ** (2.0 / 3.0))
    return square


def base_share(system: System, spacing: float) -> float:
    """Ratio of mean squares of two currents in a piezo: driven by the base, driven by the motion.

    The slope of noise that is linear between samples has the mean square 2 D/(τ1² spacing).

    `spacing`: time between two samples of the excitation (s).
    """
    noise = system.noise
    slope = 2.0 * noise.intensity / (noise.correlation_time**2 * spacing)
    moved = system.transducer.base_rate(1.0) ** 2 * slope
    motion = driven_square_velocity(system, angular_frequency(system))
    return moved / motion if moved > 0.0 else 0.0


@cached
def contact_time(system: System) -> float:
    """Duration of the shortest contact at the rms speed of small oscillations (s); inf if none."""
    speed = math.sqrt(driven_square_velocity(system, angular_frequency(system)))
    if not system.contacts:
        return math.inf
    if not math.isfinite(speed):
        return 0.0
    return min(contact.law.duration(speed) for contact in system.contacts)


@cached
def fastest_angular_frequency(system: System) -> float:
    """The angular frequency (rad/s) of the fastest motion: small or large oscillations.

    Large oscillations of frequency ω have the energy `RESOLVED_ENERGY` E[X'²] at ω; their stiffness
    follows from harmonic balance. Contacts are resolved by a separate, shorter step.
    """
    frequency = slowest = angular_frequency(system)
    # The noise decreases with frequency: the iteration averages successive values to converge.
    for _ in range(60):
        square = _driven_stiffness(system, frequency)
        frequency = math.sqrt(0.5 * (frequency**2 + max(square, slowest**2)))
    return frequency


def _driven_stiffness(system, frequency):
    """Squared frequency of oscillations whose amplitude is that driven by noise at a frequency."""
    energy = RESOLVED_ENERGY * driven_square_velocity(system, frequency)
    if system.spring.straight or energy == math.inf:
        linear = system.spring.linear
        return linear + system.transducer.stiffness(linear)
    low, high = _turning_points(system, energy)
    centre, amplitude = 0.5 * (low + high), 0.5 * (high - low)
    # Harmonic balance, ∮ F(centre + a cos θ) cos θ dθ/(π a).
    angle = (np.arange(HARMONIC_NODES) + 0.5) * np.pi / HARMONIC_NODES
    forces = system.spring.force(centre + amplitude * np.cos(angle))
    balance = 2.0 * float(np.mean(forces * np.cos(angle))) / amplitude
    return balance + system.transducer.stiffness(balance)


def _turning_points(system, energy):
    """The outermost displacements that this energy above the deepest well reaches."""
    low, high = system.spring.turning_points(energy)
    for contact in system.contacts:
        stop = contact.gap + contact.law.greatest_depth(energy)
        if contact.side >= 0.0:
            high = min(high, stop)
        if contact.side <= 0.0:
            low = max(low, -stop)
    return low, high


def barrier(system: System, well: float) -> float:
    """Energy per mass from a well to its lower adjacent saddle; inf without a saddle."""
    bottom = float(potential(system, well))
    above = [float(potential(system, x)) - bottom for x in beside(system, well)]
    return min(above, default=math.inf)


def beside(system: System, well: float) -> tuple[float, ...]:
    """Saddles adjacent to a well: tuple of float."""
    return tuple(x for x in saddles(system) if _neighbours(system, well, x))


def _neighbours(system, well, saddle):
    """Whether a well and a saddle are adjacent: no other well lies between them."""
    low, high = min(well, saddle), max(well, saddle)
    return not any(low < x < high for x in wells(system) if x != well)
