"""`[magnets]`: a magnet at the beam's tip and others on the frame, as a table of force.

Dipoles: U = μ0/4π [m1·m2/r³ − 3 (m1·r)(m2·r)/r⁵] (S. C. Stanton, C. C. McGehee and B. P. Mann,
Physica D 239, 640 (2010)), the tip's dipole turned with the tip: by φ'(L)/φ(L) for a displacement.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from harvester.device.keys import SI, Key, names_replace, not_negative, positive
from harvester.errors import SceneError

VACUUM_PERMEABILITY = 1.25663706212e-6
# Points of the table of force. A smooth table has at most 32 pieces, whatever the number of points.
POINTS = 513


@names_replace
@dataclass(frozen=True)
class Magnets:
    """Dipoles along the beam: one at its tip, one or two on the frame ahead of it, in SI.

    "repelling": one on the frame in the beam's line, its dipole against the tip's. "attracting":
    two on the frame, `spacing` apart across the beam's line, their dipoles as the tip's.
    `distance` is between the centres along the beam. A dipole is `moment` (A m²) or
    `remanence` (T) times `volume` (m³) over μ0. `reach` is the displacement up to which the force
    is tabled on both sides.
    """

    distance: float
    reach: float
    arrangement: str = "repelling"
    tip_moment: float | None = None
    frame_moment: float | None = None
    remanence: float | None = None
    tip_volume: float | None = None
    frame_volume: float | None = None
    spacing: float = 0.0

    KEYS: ClassVar[dict] = {
        "distance": positive(units=(SI,), required=True),
        "reach": positive(units=(SI,), required=True),
        "arrangement": Key(kind=str, words=("repelling", "attracting"), units=(SI,)),
        **dict.fromkeys(
            ("tip_moment", "frame_moment", "remanence", "tip_volume", "frame_volume"),
            positive(units=(SI,)),
        ),
        "spacing": not_negative(units=(SI,)),
    }

    def moment(self, place: str, origin: str = "magnets") -> float:
        """The dipole of "tip" or "frame" (A m²).

        Raises
        ------
        SceneError
            It is not given, or twice.
        """
        moment, volume = getattr(self, f"{place}_moment"), getattr(self, f"{place}_volume")
        if (moment is None) == (volume is None):
            raise SceneError(
                f"{origin}: magnets: give either {place}_moment, or {place}_volume with remanence"
            )
        if moment is not None:
            return moment
        if self.remanence is None:
            raise SceneError(f"{origin}: magnets.{place}_volume needs magnets.remanence")
        return self.remanence * volume / VACUUM_PERMEABILITY


def magnetic_force(
    magnets: Magnets, slope: float, displacement: Any, origin: str = "magnets"
) -> np.ndarray:
    """dU/dx (N), positive where it pulls back: the force across and the torque on the tip.

    U = ± strength (cos/r³ − 3 d along/r⁵) is the energy of the dipoles.
    """
    x = np.asarray(displacement, dtype=float)
    strength = magnets.moment("tip", origin) * magnets.moment("frame", origin)
    strength *= VACUUM_PERMEABILITY / (4.0 * math.pi)
    attracting = magnets.arrangement == "attracting"
    half = magnets.spacing / 2.0
    sign, places = (1.0, (-half, half)) if attracting else (-1.0, (0.0,))
    force = np.zeros_like(x)
    cos, sin, d = np.cos(slope * x), np.sin(slope * x), magnets.distance
    for place in places:
        y = place - x
        square = d**2 + y**2
        # `along` and `turned` are the dipoles' components along the vector (d, y): the frame's
        # dipole lies along the beam, the tip's turns with it.
        along = d * cos + y * sin
        turned = slope * (y * cos - d * sin) - sin
        r3, r5 = square**1.5, square**2.5
        force += sign * strength * (
            -slope * sin / r3 + 3.0 * cos * y / r5 - 3.0 * d * turned / r5
            - 15.0 * d * along * y / (r5 * square)
        )  # fmt: skip
    return force


def spring_points(
    magnets: Magnets, stiffness: float, slope: float, origin: str = "magnets"
) -> list[list[float]]:
    """The table (m, N) of the beam's and the magnets' force together.

    Raises
    ------
    SceneError
        A magnet is not given, or the tip would turn by more than the theory holds for.
    """
    if magnets.reach * slope > math.pi / 4.0:
        raise SceneError(
            f"{origin}: magnets.reach = {magnets.reach:g}: the tip would turn by "
            f"{math.degrees(magnets.reach * slope):.3g}°; the beam's theory is linear and holds to "
            "about 10°: lower magnets.reach"
        )
    if magnets.arrangement == "repelling" and magnets.spacing:
        raise SceneError(f"{origin}: magnets.spacing belongs to attracting magnets; take it out")
    x = np.linspace(-magnets.reach, magnets.reach, POINTS)
    force = stiffness * x + magnetic_force(magnets, slope, x, origin)
    return np.stack([x, force], axis=1).tolist()


def polynomial_fit(
    magnets: Magnets, stiffness: float, slope: float, degree: int = 7
) -> tuple[list[float], float]:
    """Coefficients (F0, k1, …) fitted within the reach, and the greatest error (N) there."""
    x, force = np.array(spring_points(magnets, stiffness, slope)).T
    fitted = np.polynomial.Polynomial.fit(x, force, degree)
    return fitted.convert().coef.tolist(), float(np.max(np.abs(fitted(x) - force)))
