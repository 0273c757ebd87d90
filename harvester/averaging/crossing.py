"""What one pass of the separatrix leaves behind of the slow charge Z.

The noise kicks the energy once per lobe; only then does the side change, so that mass which leaves
a well first completes its lobe, on average over `IMPULSE` of one more than the diffusion of the
energy tells, and Z relaxes meanwhile: by tanh(`IMPULSE` λ'T) of its way, T the time of a lobe, as
the outer orbits' own swing of Z about its mean is tanh(½ λ'T). Outer orbits at Z therefore meet the
right well's orbits at Z + lag(Z), and the left well's, by its mirror image, at −Z + lag(−Z).

With A, that of each well's separatrix, A lag is the same on both sides: kicks of zero mean leave
the mean energy alone, so that Σ A g of the wells is A g of the outer orbit. That divides the lag of
Z = 0, where both sides are alike, in the ratio of the other side's A.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from harvester.averaging.lobes import HalfOrbits, Lobe

# Walk with Gaussian steps whose side s is kept below 0 and changes at every step above:
# φ(e) = 1 − E[sgn(e') φ(e')] goes to ½ above, to ½ − e² − 0.3836 below (e in steps).
IMPULSE = 0.3835
PLACES = 41  # of Z between the rest positions
STEEPEST = 0.5  # change of the lag with Z: beyond it the load is no longer slow


@dataclass(frozen=True)
class Crossing:
    """Which layers meet at the separatrix.

    Attributes
    ----------
    charge, lag : ndarray
        Z of outer orbits between the rest positions, and the lag there.
    """

    charge: np.ndarray
    lag: np.ndarray

    @classmethod
    def of(cls, p, stiffness, rate, nodes):
        """For these parameters, with β' and the rate at which Z relaxes."""
        charge = p.rest * np.linspace(-1.0, 1.0, PLACES)
        lobe = Lobe(p, stiffness, 0.0)
        if not lobe.has_well:
            return cls(charge, np.zeros(PLACES))
        noise = np.array([_noise(p, Lobe(p, stiffness, z), nodes) for z in charge])
        kick = np.sqrt(2.0 * p.intensity * noise[PLACES // 2 : PLACES // 2 + 1])
        half = HalfOrbits.of(lobe, lobe.outer_path(kick, nodes))
        duration = half.integral(1.0 / half.speed)[0]
        centre = min(half.integral(half.x / half.speed)[0] / duration, p.rest)
        both = noise + noise[::-1]
        share = 2.0 * noise[::-1] / np.where(both > 0.0, both, 1.0)
        change = np.abs(np.diff(share) / np.diff(charge)).max()
        lag = centre * np.tanh(IMPULSE * rate * duration)
        return cls(charge, lag * share * min(1.0, STEEPEST / max(lag * change, STEEPEST)))

    @property
    def last(self):
        """Z of the outer orbits that meet the well charged at its rest position."""
        return float(np.interp(self.charge[-1], self.charge + self.lag, self.charge))

    def held(self, charge):
        """Z of the right well's orbits that outer orbits at Z meet."""
        if not np.any(self.lag):
            return charge
        return charge + PchipInterpolator(self.charge, self.lag)(charge)


def _noise(p, lobe, nodes):
    if not lobe.has_well:
        return 0.0
    half = HalfOrbits.of(lobe, lobe.well_path(np.ones(1), nodes))
    return half.noise(p)[0]
