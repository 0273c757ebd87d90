"""`[magnets]`: a magnet at the beam's tip and others on the frame, as a force table.

The tip's magnet rotates with the tip, by φ'(L)/φ(L) per displacement. Magnets of known size are
uniformly magnetized: their end faces carry the magnetic charge M per area, and the force is the sum
over all pairs of charges. Without sizes they are dipoles, U = μ0/4π [m1·m2/r³ − 3 (m1·r)(m2·r)/r⁵]
(S. C. Stanton, C. C. McGehee and B. P. Mann, Physica D 239, 640 (2010)).
"""

from __future__ import annotations

import functools
import math
from typing import Any, ClassVar

import numpy as np

from harvester.base.compilation import compiled
from harvester.base.errors import SceneError
from harvester.device.beam.lumped import Beam, lumped
from harvester.device.keys import SI, Key, Table, key, not_negative, positive, table, word

VACUUM_PERMEABILITY = 1.25663706212e-6
# Usual sizes of parts, and the unit that is often mistaken for the key's.
LENGTH, VOLUME = (1e-6, 1.0, 1e-3, "mm"), (1e-15, 1e-2, 1e-9, "mm³")
SIZE = Key(low=0.0, low_allowed=False, likely=LENGTH)
# Points of the table of force. A smooth table has at most 32 pieces, whatever the number of points.
POINTS = 513
# Quadrature points along a face's radius, increased until the relative change of the force is below
# CHANGE: two discs a fifth of their diameter apart need the largest number.
ORDERS, CHANGE = (6, 9, 13, 19), 1e-3
# Number of displacements at which magnets are checked for a collision.
PLACES = 65
# Degree of the Chebyshev interpolation between displacements.
DEGREE = 32
# A note is given if dipoles are nearer than this multiple of a magnet's width, the cube root of its
# volume. For discs of 10 × 3 mm (width 6.2 mm) the dipole approximation overestimates the stiffness
# by 8 % at 50 mm, 23 % at 30 mm and 52 % at 20 mm; at 11 mm it is threefold.
NEAR = 8.0
# Remanence (T) of the strongest magnets: the smallest volume of a given moment.
GREATEST_REMANENCE = 1.5


@table
class Magnets(Table):
    """Magnets along the beam: one at its tip, one or two on the frame ahead of it, in SI.

    "repelling": one magnet on the frame on the beam's axis, its dipole opposite to the tip's.
    "attracting": two on the frame, `spacing` apart across the beam's axis, their dipoles parallel
    to the tip's. A size is (diameter, length) of a disc, or (height, width, length) of a block, the
    length along the beam and the height along the motion. A moment is given, or computed as
    `remanence` times the volume over μ0.
    """

    distance: float = positive(
        "distance: of the magnets' centres along the beam", "m", required=True, likely=LENGTH
    )
    reach: float = positive(
        "reach: displacement up to which the force is tabulated", "m", required=True, likely=LENGTH
    )
    arrangement: str = word(
        "arrangement: one repelling magnet, or two attracting ones", ("repelling", "attracting"),
        default="repelling",
    )  # fmt: skip
    tip_moment: float | None = positive("moment of the tip's magnet", "A m²")
    frame_moment: float | None = positive("moment of a magnet on the frame", "A m²")
    remanence: float | None = positive("remanence", "T", likely=(0.05, 2.0, 1e-3, "mT"))
    tip_volume: float | None = positive("volume of the tip's magnet", "m³", likely=VOLUME)
    frame_volume: float | None = positive("volume of a magnet on the frame", "m³", likely=VOLUME)
    tip_size: tuple | None = key(
        "size of the tip's magnet: diameter and length of a disc, or height, width and length", "m",
        element=SIZE, count=(2, 3),
    )  # fmt: skip
    frame_size: tuple | None = key(
        "size of a magnet on the frame: as tip_size", "m", element=SIZE, count=(2, 3)
    )
    offset: float | None = key(
        "offset: of the tip's magnet beyond the beam's end; by default the tip body's", "m",
        likely=LENGTH,
    )  # fmt: skip
    spacing: float = not_negative(
        "spacing: of two attracting magnets, across the beam", "m", likely=LENGTH, default=0.0
    )

    UNITS: ClassVar = (SI,)

    def moment(self, end: str, origin: str = "magnets") -> float:
        """The dipole of "tip" or "frame" (A m²). Raises SceneError if it is not given, or twice."""
        names = [f"{end}_{name}" for name in ("moment", "volume", "size")]
        moment, volume, size = (getattr(self, name) for name in names)
        if (moment, volume, size).count(None) != 2:
            raise SceneError(
                f"{origin}: magnets: give either {names[0]}, or {names[2]} or {names[1]} with "
                "remanence"
            )
        if moment is not None:
            return moment
        if self.remanence is None:
            size_key = names[1] if size is None else names[2]
            raise SceneError(f"{origin}: magnets.{size_key} needs magnets.remanence")
        if size is not None:
            disc = math.pi / 4.0 * size[0] if len(size) == 2 else 1.0
            volume = disc * math.prod(size)
        return self.remanence * volume / VACUUM_PERMEABILITY

    @property
    def frames(self) -> tuple[float, tuple[float, ...]]:
        """Sign of the frame's dipoles relative to the tip's; their positions across the beam."""
        half = self.spacing / 2.0
        return (1.0, (-half, half)) if self.arrangement == "attracting" else (-1.0, (0.0,))

    @property
    def sized(self) -> bool:
        """Whether the magnets' sizes are known."""
        return self.tip_size is not None and self.frame_size is not None


def magnet_notes(magnets: Magnets | None) -> tuple[str, ...]:
    """A note if the dipole approximation is inaccurate at this distance."""
    if magnets is None or magnets.sized:
        return ()
    moment = max(magnets.moment("tip"), magnets.moment("frame"))
    volume = moment * VACUUM_PERMEABILITY / (magnets.remanence or GREATEST_REMANENCE)
    widths = magnets.distance / volume ** (1.0 / 3.0)
    if widths > NEAR:
        return ()
    return (
        f"magnets: the dipoles are {widths:.2g} magnet widths apart: within {NEAR:g} widths their "
        "force may be wrong by tens of per cents and more: give tip_size and frame_size",
    )


def magnetic_force(
    magnets: Magnets, slope: float, displacement: Any, offset: float = 0.0, origin: str = "magnets"
) -> np.ndarray:
    """Restoring force dU/dx (N) of the magnets, from the transverse force and the torque on the
    tip.

    `slope`: the tip's rotation per displacement (1/m). `displacement`: of the beam's end, within
    `reach` (m). `offset`: distance of the tip's magnet beyond the beam's end (m).
    """
    x = np.asarray(displacement, dtype=float)
    if magnets.sized:
        return _force_of_charges(magnets, slope, offset, origin)(x)
    if magnets.tip_size or magnets.frame_size:
        raise SceneError(f"{origin}: magnets: give both tip_size and frame_size")
    strength = magnets.moment("tip", origin) * magnets.moment("frame", origin)
    strength *= VACUUM_PERMEABILITY / (4.0 * math.pi)
    sign, places = magnets.frames
    # Complex-step derivative: the imaginary part of the energy is its derivative.
    z, energy = x + 1e-30j, np.zeros(x.shape, dtype=complex)
    cos, sin = np.cos(slope * z), np.sin(slope * z)
    # With an offset from the beam's end, the rotation changes the tip magnet's distance.
    d = magnets.distance + offset * (1.0 - cos)
    for centre in places:
        y = centre - z - offset * sin
        square = d**2 + y**2
        energy += cos / square**1.5 - 3.0 * d * (d * cos + y * sin) / square**2.5
    return sign * strength * np.imag(energy) / 1e-30


@functools.lru_cache(maxsize=64)
def _force_of_charges(magnets, slope, offset, origin):
    """The force between the end faces' charges, interpolated within the reach."""
    tip, frame = magnets.tip_size, magnets.frame_size
    aside = abs(magnets.frames[1][0]) >= (tip[0] + frame[0]) / 2.0
    apart = aside or magnets.distance > (tip[-1] + frame[-1]) / 2.0
    domain, before = [-magnets.reach, magnets.reach], None
    if apart and _collide(magnets, slope, offset):
        raise SceneError(
            f"{origin}: magnets.reach = {magnets.reach:g}: within this displacement the tip's "
            "magnet hits a magnet on the frame: lower magnets.reach"
        )
    for order in ORDERS if apart else ():
        arguments = magnets, slope, offset, origin, order
        series = np.polynomial.Chebyshev.interpolate(_pulls, DEGREE, domain, arguments)
        values = series.linspace(4 * DEGREE)[1]
        if before is not None and np.ptp(values - before) <= CHANGE * np.abs(values).max():
            return series
        before = values
    raise SceneError(
        f"{origin}: magnets.distance = {magnets.distance:g} between the centres: the magnets "
        f"overlap, or their faces come too close for a force within {CHANGE:g}: raise it"
    )


def _collide(magnets, slope, offset):
    """Whether a corner of a magnet enters another one within the reach, in the plane of motion."""
    tip, frame = np.array(magnets.tip_size)[[-1, 0]], np.array(magnets.frame_size)[[-1, 0]]
    x, distance = np.linspace(-magnets.reach, magnets.reach, PLACES)[:, None], magnets.distance
    cos, sin = np.cos(slope * x), np.sin(slope * x)
    along, across = np.array([[0.5, 0.5, -0.5, -0.5], [0.5, -0.5, 0.5, -0.5]])

    def inside(a, b, size):
        return bool(((2.0 * np.abs(a) < size[0]) & (2.0 * np.abs(b) < size[1])).any())

    for centre in magnets.frames[1]:
        # The tip magnet's corners in the frame magnet's coordinates, and vice versa.
        a, b = offset + along * tip[0], across * tip[1]
        c, d = distance + offset + along * frame[0], centre + across * frame[1] - x
        if inside(a * cos - b * sin - offset - distance, x + a * sin + b * cos - centre, frame):
            return True
        if inside(c * cos + d * sin - offset, d * cos - c * sin, tip):
            return True
    return False


def _pulls(x, magnets, slope, offset, origin, order):
    """The force at several displacements."""
    moments = [magnets.moment(side, origin) for side in ("tip", "frame")]
    tip, charge = _charges(magnets.tip_size, moments[0], order)
    # The plane of motion is a plane of symmetry: half of the tip's charges, counted twice.
    tip, charge = tip[tip[:, 2] > 0.0], 2.0 * charge[tip[:, 2] > 0.0]
    frame, other = _charges(magnets.frame_size, moments[1], order)
    sign, places = magnets.frames
    frames = np.concatenate([frame + np.array([magnets.distance, y, 0.0]) for y in places])
    others = np.tile(sign * VACUUM_PERMEABILITY / (4.0 * math.pi) * other, len(places))
    return np.array([_pull(a, slope, offset, tip, charge, frames, others) for a in x])


def _charges(size, moment, order):
    """Points (m) on a magnet's two end faces relative to its centre, and their charges (A m)."""
    node, weight = np.polynomial.legendre.leggauss(order if len(size) == 2 else 3 * order // 4 * 2)
    if len(size) == 2:
        angle = math.pi / order * (np.arange(2 * order) + 0.5)
        radius = size[0] / 4.0 * (node + 1.0)
        y, z = np.outer(radius, np.cos(angle)).ravel(), np.outer(radius, np.sin(angle)).ravel()
        share = np.repeat(weight * radius, angle.size)
    else:
        y, z = (grid.ravel() for grid in np.meshgrid(node * size[0] / 2.0, node * size[1] / 2.0))
        share = np.outer(weight, weight).ravel()
    share *= moment / size[-1] / share.sum()
    ends = [np.stack([np.full_like(y, side * size[-1] / 2.0), y, z], 1) for side in (1.0, -1.0)]
    return np.concatenate(ends), np.concatenate([share, -share])


@compiled
def _pull(x, slope, offset, tip, charges, frame, others):
    """Force (N) on the tip's charges at a displacement x (m): the derivative of their energy."""
    cos, sin, force = np.cos(slope * x), np.sin(slope * x), 0.0
    for i in range(len(tip)):
        along = tip[i, 0] + offset
        ahead = along * cos - tip[i, 1] * sin - offset
        across = x + along * sin + tip[i, 1] * cos
        rising = 1.0 + slope * (along * cos - tip[i, 1] * sin)
        coming = -slope * (along * sin + tip[i, 1] * cos)
        total = 0.0
        for k in range(len(frame)):
            a, b, c = ahead - frame[k, 0], across - frame[k, 1], tip[i, 2] - frame[k, 2]
            square = a * a + b * b + c * c
            total += others[k] * (a * coming + b * rising) / (square * np.sqrt(square))
        force -= charges[i] * total
    return force


def spring_points(magnets: Magnets, beam: Beam, origin: str = "magnets") -> list[list[float]]:
    """The table (m, N) of the total force of beam and magnets.

    Raises SceneError if a magnet is missing, or the tip's rotation exceeds the theory's validity.
    """
    stiffness, slope = lumped(beam).stiffness, lumped(beam).tip_slope
    if magnets.reach * slope > math.pi / 4.0:
        raise SceneError(
            f"{origin}: magnets.reach = {magnets.reach:g}: the tip would rotate by "
            f"{math.degrees(magnets.reach * slope):.3g}°; the beam's theory is linear and holds to "
            "about 10°: lower magnets.reach"
        )
    if magnets.arrangement == "repelling" and magnets.spacing:
        raise SceneError(f"{origin}: magnets.spacing belongs to attracting magnets; remove it")
    x = np.linspace(-magnets.reach, magnets.reach, POINTS)
    offset = beam.tip_offset if magnets.offset is None else magnets.offset
    force = stiffness * x + magnetic_force(magnets, slope, x, offset, origin)
    return np.stack([x, force], axis=1).tolist()


def polynomial_fit(magnets: Magnets, beam: Beam) -> tuple[list[float], float]:
    """Coefficients (F0, k1, …, k7) fitted within the reach, and the greatest error (N) there."""
    x, force = np.array(spring_points(magnets, beam)).T
    fitted = np.polynomial.Polynomial.fit(x, force, 7)
    return fitted.convert().coef.tolist(), float(np.max(np.abs(fitted(x) - force)))
