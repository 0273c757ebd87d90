"""Orbits and their integrals on a grid of levels and layers of the slow charge Z.

Right-hand wells at all Z and outer orbits at Z > 0 stand for the whole: (X, Z) → (−X, −Z) gives
the rest. Wells are layers from −Z to Z, so that layer k and its mirror image are k and −1 − k.
They lie at the Z from which the outer orbits of the same layer come.
"""

from dataclasses import dataclass

import numpy as np

from harvester.averaging.lobes import HalfOrbits, Lobe

MOMENTS = ("area", "displacement", "square", "speed_square")
# Excess of the orbit whose ⟨X⟩ and ∮V² stand for the separatrix, in units of the first face's. Both
# go to their limits as slowly as 1/T there, and only of one and the same orbit do they belong
# together: in the loss relative to the moving separatrix what goes like 1/T cancels.
INNERMOST = 1e-4


@dataclass(frozen=True)
class Grid:
    """Faces of the cells.

    Attributes
    ----------
    charge : ndarray
        Z ≥ 0 at the faces of the outer layers; one without extent for a monostable device.
    held : ndarray
        Z at the faces of the wells' layers (`Crossing.held`).
    share : ndarray
        Of the way from a well's bottom to its end, from 0 to 1; empty without wells.
    excess : ndarray
        Energy of outer orbits above the junction, from 0.
    nodes : int
        Quadrature nodes on each piece of an orbit.
    """

    charge: np.ndarray
    held: np.ndarray
    share: np.ndarray
    excess: np.ndarray
    nodes: int


@dataclass(frozen=True)
class Table:
    """One edge over layers and levels, arrays (layers, levels).

    Attributes
    ----------
    exists : ndarray of bool, shape (layers,)
    junction, base : ndarray, shape (layers,)
        X of the saddle or what stands for it, and
        U at the well's bottom, or at the junction for outer orbits.
    height : ndarray
        H of the cells' middles above `base`.
    face_height : ndarray
        H of the cells' faces above `base`.
    area, displacement, square, speed_square : ndarray
        Integrals of 1, X, X² and X'² over the area that a face encloses.
    centre : ndarray
        ⟨X⟩ over the orbits at the faces.
    excursion : ndarray
        ∮(X − ⟨X⟩)² dt.
    contact, voltage : ndarray
        `HalfOrbits.contact_work`, and ∮V² dt of the part of V that goes round with the orbit.
    noise : ndarray
        `HalfOrbits.noise`.
    mass : ndarray
        1 + τ1 (mean damping), see `effective_mass`.
    """

    exists: np.ndarray
    junction: np.ndarray
    base: np.ndarray
    height: np.ndarray
    face_height: np.ndarray
    area: np.ndarray
    displacement: np.ndarray
    square: np.ndarray
    speed_square: np.ndarray
    centre: np.ndarray
    excursion: np.ndarray
    contact: np.ndarray
    voltage: np.ndarray
    noise: np.ndarray
    mass: np.ndarray

    def cells(self, name):
        """Differences of a moment between a cell's faces."""
        return np.diff(getattr(self, name), axis=1)

    def velocity_square(self):
        """Integrals of X'² over the cells, orbits going round with their effective mass."""
        return self.cells("speed_square") / (0.5 * (self.mass[:, 1:] + self.mass[:, :-1]))


def layered(p, stiffness, grid):
    """Tables at the layers' middles.

    Returns
    -------
    dict of str to Table
        "wells" (all Z; absent without wells) and "outer" (Z > 0).
    """
    lobes = both_ways(p, stiffness, middle(grid.charge))
    tables = {}
    if len(grid.share):
        tables["wells"] = _wells(p, lobes, [Lobe(p, stiffness, z) for z in middle(grid.held)], grid)
    tables["outer"] = _outer(p, lobes, grid)
    return tables


def middle(faces):
    """Middles of the cells."""
    return 0.5 * (faces[1:] + faces[:-1])


def both_ways(p, stiffness, charge):
    """Lobes at −Z, in falling order, then at Z."""
    return [Lobe(p, stiffness, z) for z in (*-charge[::-1], *charge)]


def _integrals_names():
    return (*MOMENTS, "excursion", "contact", "voltage", "noise")


def _wells(p, outer, lobes, grid):
    """A layer's well counts where the outer orbits' Z has it as well."""
    exists = np.array([a.has_well and b.has_well for a, b in zip(outer, lobes, strict=True)])
    there = [lobe for lobe, one in zip(lobes, exists, strict=True) if one]
    half = _well_orbits(there, grid.share[1:], grid.nodes)
    rows = {name: _rows(values, there) for name, values in _integrals(p, half).items()}
    rows["centre"][:, 0] = [lobe.bottom for lobe in there]
    for name, share in (("height", middle(grid.share)), ("face_height", grid.share)):
        stack = Lobe.stacked(there, len(share))
        rows[name] = stack.well_heights(np.tile(share, len(there))).reshape(len(there), -1)
    columns = {name: np.zeros((len(lobes), values.shape[1])) for name, values in rows.items()}
    for name, values in rows.items():
        columns[name][exists] = values
    _add_mass(p, lobes[0].stiffness[0], columns)
    base = [lobe.potential.energy(lobe.bottom, lobe.stiffness[0]) for lobe in lobes]
    junction = np.array([lobe.junction for lobe in lobes])
    return Table(exists=exists, junction=junction, base=np.array(base), **columns)


def _outer(p, lobes, grid):
    count = len(lobes) // 2
    right, left = lobes[count:], lobes[count - 1 :: -1]
    excess = np.append(INNERMOST * grid.excess[1], grid.excess[1:])
    columns = {
        name: values.reshape(count, -1)
        for name, values in _integrals(p, _outer_orbits(right, left, excess, grid.nodes)).items()
    }
    mine, theirs = _separatrices(p, right, grid.nodes), _separatrices(p, left, grid.nodes)
    for name in (*MOMENTS, "contact", "noise"):
        sign = -1.0 if name == "displacement" else 1.0
        columns[name][:, 0] = mine[name] + sign * theirs[name]
    _add_mass(p, lobes[0].stiffness[0], columns)
    base = [lobe.potential.energy(lobe.junction, lobe.stiffness[0]) for lobe in right]
    return Table(
        exists=np.ones(count, dtype=bool),
        junction=np.array([lobe.junction for lobe in right]),
        base=np.array(base),
        height=np.tile(middle(grid.excess), (count, 1)),
        face_height=np.tile(grid.excess, (count, 1)),
        **columns,
    )


def _rows(values, lobes):
    """Array (lobes, levels) with a first level of zeros."""
    return np.pad(values.reshape(len(lobes), -1), ((0, 0), (1, 0)))


def _well_orbits(lobes, share, nodes):
    stack = Lobe.stacked(lobes, len(share))
    return HalfOrbits.of(stack, stack.well_path(np.tile(share, len(lobes)), nodes))


def _outer_orbits(right, left, excess, nodes):
    mine, theirs = (
        HalfOrbits.of(stack, stack.outer_path(np.tile(excess, len(right)), nodes))
        for stack in (Lobe.stacked(lobes, len(excess)) for lobes in (right, left))
    )
    return mine.after_mirrored(theirs)


def _separatrices(p, lobes, nodes):
    """Integrals over the separatrix of each lobe, 0 where it has no well."""
    there = np.array([lobe.has_well for lobe in lobes])
    values = {name: np.zeros(len(lobes)) for name in _integrals_names()}
    if np.any(there):
        wells = [lobe for lobe in lobes if lobe.has_well]
        found = _integrals(p, _well_orbits(wells, np.ones(1), nodes))
        for name in values:
            values[name][there] = found[name]
    return values


def effective_mass(p, area, contact):
    """What stands for the noise's memory beside the resonance: 1 + τ1 (mean damping).

    Noise that is remembered follows the displacement too, E[Xη] = τ1 E[ηX'] whatever the forces.
    It thereby takes from the spring what a greater mass would: orbits of energy H have
    ½(1 + τ1 c)X'² + U = H, c the damping by its work, which is exact for a linear device.

    Parameters
    ----------
    p : harvester.averaging.symmetric.SymmetricDevice
    area, contact : ndarray, shape (..., levels)
        ∮X'² dt and ∮(contact damping) X'² dt; where no area is enclosed the next level counts.

    Returns
    -------
    ndarray, shape (..., levels)
    """
    damping = contact / np.where(area > 0.0, area, 1.0)
    damping[..., 0] = np.where(area[..., 0] > 0.0, damping[..., 0], damping[..., 1])
    return 1.0 + p.correlation_time * (p.damping + damping)


def _add_mass(p, stiffness, columns):
    """The effective mass, and the share of V that follows X' as that does."""
    mass = columns["mass"] = effective_mass(p, columns["area"], columns["contact"])
    square, rate = p.angular_frequency**2 - p.coupling + stiffness, p.decay_rate**2
    columns["voltage"] = columns["voltage"] * (square + rate / mass) / (square + rate)


def _integrals(p, half):
    speed, x = half.speed, half.x
    period = half.period
    return {
        "area": half.area,
        "displacement": half.integral(speed * x),
        "square": half.integral(speed * x * x),
        "speed_square": half.integral(speed**3) / 3.0,
        "centre": half.integral(x / speed) / period,
        "excursion": half.integral(x * x / speed) - half.integral(x / speed) ** 2 / period,
        "contact": half.contact_work,
        "voltage": half.filtered_power(p.decay_rate),
        "noise": half.noise(p),
    }


@dataclass(frozen=True)
class Faces:
    """Area and ∬X of each edge at the faces between layers, arrays (faces, levels)."""

    area: dict
    displacement: dict


def faced(p, stiffness, grid, tables):
    """`Faces` of wells (from −Z to Z) and outer orbits (Z ≥ 0).

    A well's face counts where both layers beside it have the well.
    """
    count = len(grid.charge) - 1
    area, displacement = {}, {}
    if "wells" in tables:
        lobes = [Lobe(p, stiffness, z) for z in grid.held]
        exists = np.pad(tables["wells"].exists, 1, mode="edge")
        exists = exists[1:] & exists[:-1] & np.array([lobe.has_well for lobe in lobes])
        there = [lobe for lobe, one in zip(lobes, exists, strict=True) if one]
        half = _well_orbits(there, grid.share[1:], grid.nodes)
        area["wells"] = np.zeros((2 * count + 1, len(grid.share)))
        displacement["wells"] = np.zeros_like(area["wells"])
        area["wells"][exists] = _rows(half.area, there)
        displacement["wells"][exists] = _rows(half.integral(half.speed * half.x), there)
    lobes = both_ways(p, stiffness, grid.charge[1:])
    lobes.insert(count, Lobe(p, stiffness, grid.charge[0]))
    right, left = lobes[count:], lobes[count::-1]
    mine, theirs = _separatrices(p, right, grid.nodes), _separatrices(p, left, grid.nodes)
    half = _outer_orbits(right, left, grid.excess[1:], grid.nodes)
    area["outer"] = _rows(half.area, right)
    area["outer"][:, 0] = mine["area"] + theirs["area"]
    displacement["outer"] = _rows(half.integral(half.speed * half.x), right)
    displacement["outer"][:, 0] = mine["displacement"] - theirs["displacement"]
    return Faces(area, displacement)
