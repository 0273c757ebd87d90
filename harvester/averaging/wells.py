"""Rate of saddle crossings, shares of time in the wells, and the most occupied well.

If jumps are rare, their rates are far below the errors of the grid, which cannot resolve them.
Symmetric wells then hold half of the time each; among unequal wells the well with the rarest exits
holds all of it.
"""

import numpy as np

from harvester.averaging.flow import PhaseGrid
from harvester.averaging.grid_density import GridDensity
from harvester.device import timescales
from harvester.device.system import System, loss_power, potential

# Barrier, in multiples of E[X'²], above which crossings are negligible.
HELD_BACK = 16.0
# Trusted share of a well's exponent S. If it exceeds the exponent of every other well by 6, the
# share of time in the others is below exp(−6), and the grid covers one well.
SURE_SHARE, LEAST_LEAD = 0.8, 6.0
# Energies, and positions along each orbit, over which the exponent is integrated.
ENERGIES, PLACES = 24, 201


def between_wells(device: System, density: GridDensity) -> dict[str, float]:
    """Rate of crossings of all saddles, and shares of time from the left; empty for one well.

    The rate is the flux Σ ∫ |X'| p(saddle, X') dX', both ways, as Monte Carlo counts it; shares are
    given where they do not follow from symmetry. The density of a single well gives no rate.
    """
    saddles, v, answer = sorted(timescales.saddles(device)), density.v, {}
    if not saddles:
        return {}
    if density.x[0] < saddles[0] and saddles[-1] < density.x[-1]:
        flux = sum(float(density.joint(x, v) @ np.abs(v)) * (v[1] - v[0]) for x in saddles)
        answer["well_crossing_rate"] = flux
    if not alike(device):
        shares = np.diff([0.0, *(density.below(x) for x in saddles), density.below(np.inf)])
        for number, share in enumerate(shares / shares.sum(), start=1):
            answer[f"share_of_time_in_well_{number}"] = float(share)
    return answer


def alike(device: System) -> bool:
    """Whether the device has two wells that are mirror images."""
    return len(timescales.wells(device)) == 2 and device.symmetric


def well_at(device: System, x: np.ndarray) -> np.ndarray:
    """Number of the well between whose saddles each displacement lies."""
    return np.searchsorted(sorted(timescales.saddles(device)), x)


def unlike_wells(device: System, grid: PhaseGrid) -> np.ndarray:
    """(wells, X) of 0 and 1: which displacements lie in each well; symmetric wells count as one."""
    number = well_at(device, grid.x)
    if grid.mirrored:
        number = np.minimum(number, number[::-1])
    return (number == np.unique(number)[:, None]).astype(float)


def lone_well(device: System) -> float | None:
    """The well that contains all motion, or one of two symmetric ones; None if several do."""
    wells = timescales.wells(device)
    if len(wells) < 2:
        return None
    well = max(wells, key=lambda well: barrier(device, well) / driven(device, well))
    alike = (well, -well) if device.symmetric else (well,)
    others = [x for x in wells if not np.isclose(x, alike).any()]
    if not others:
        return well
    if barrier(device, well) < HELD_BACK * driven(device, well):
        return None
    sure = SURE_SHARE * _exponent(device, well)
    return well if all(sure > LEAST_LEAD + _exponent(device, x) for x in others) else None


def driven(device: System, well: float) -> float:
    """E[X'²] of small oscillations about a well."""
    frequency = timescales.well_frequency(device, well)
    return timescales.driven_square_velocity(device, frequency)


def barrier(device: System, well: float) -> float:
    """Energy from a well to its lowest adjacent saddle, with a slow charge held constant."""
    rate, coupling = device.transducer.decay_rate(), getattr(device.transducer, "coupling", 0.0)
    frequency = timescales.well_frequency(device, well)
    held = 0.5 * coupling / (1.0 + (2.0 * rate / frequency) ** 2)
    bottom = float(potential(device, well))
    return min(
        float(potential(device, saddle)) - bottom + held * (saddle - well) ** 2
        for saddle in timescales.beside(device, well)
    )


def _exponent(device, well):
    """∫ dH/T(H) up to the saddle; T: noise power over loss rate on the orbit of energy H.

    The rate of jumps of weakly damped motion falls as exp(−∫ dH/T) (Eqs. 20–25).
    """
    height = timescales.barrier(device, well)
    energies = height * (np.arange(ENERGIES) + 0.5) / ENERGIES
    low, high = _ends(device, well, height)
    x = np.linspace(low, high, PLACES)
    above = energies[:, None] - (potential(device, x) - float(potential(device, well)))
    v = np.sqrt(2.0 * np.maximum(above, 0.0))
    # The energy lost in a cycle is the integral of loss/X' over X, in both directions.
    lost = np.vectorize(lambda x, v: loss_power(device, x, v, 0.0, True))(x, v)
    action = 2.0 * np.trapezoid(v, x)
    loss = 2.0 * np.trapezoid(lost / np.maximum(v, np.finfo(float).tiny), x)
    frequency = 2.0 * np.pi / np.gradient(action, energies)
    rate = loss / action + [device.transducer.loss_rate(omega) for omega in frequency]
    intensity, memory = device.noise
    return float(np.mean(rate * (1.0 + (frequency * memory) ** 2))) * height / intensity


def _ends(device, well, height):
    """Turning points of a well's orbits below its lower saddle."""
    ends = []
    saddles = timescales.beside(device, well)
    for side in (-1.0, 1.0):
        beyond = [x for x in saddles if side * (x - well) > 0.0]
        end = beyond[0] if beyond else well + side * min(abs(x - well) for x in saddles)
        while not beyond and potential(device, end) < potential(device, well) + height:
            end += 0.2 * (end - well)
        ends.append(end)
    return ends
