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
        ∮(contact damping) X'² dt and ∮V² dt of the part of V that goes round with the orbit.
    noise : ndarray
        ∮X' w dt, w − τ1² w'' = X'.
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

    def cells(self, name):
        """Differences of a moment between a cell's faces."""
        return np.diff(getattr(self, name), axis=1)


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
    shares = middle(grid.share)
    exists = np.array([a.has_well and b.has_well for a, b in zip(outer, lobes, strict=True)])
    rows = []
    for lobe in lobes:
        if not lobe.has_well:
            rows.append({name: np.zeros(len(grid.share)) for name in _row_names()})
            rows[-1].update(junction=lobe.junction, base=0.0, height=np.zeros(len(shares)))
            continue
        half = HalfOrbits.of(lobe, lobe.well_path(grid.share[1:], grid.nodes))
        row = {name: np.insert(values, 0, 0.0) for name, values in _integrals(p, half).items()}
        row["centre"][0] = lobe.bottom
        row["height"] = lobe.well_heights(shares)
        row["face_height"] = lobe.well_heights(grid.share)
        row["junction"] = lobe.junction
        row["base"] = lobe.potential.energy(lobe.bottom, lobe.stiffness[0])
        rows.append(row)
    return _table(rows, exists)


def _outer(p, lobes, grid):
    inner = [_separatrix(p, lobe, grid) for lobe in lobes]
    count = len(lobes) // 2
    rows = []
    for k in range(count):
        right, left = lobes[count + k], lobes[count - 1 - k]
        excess = np.append(INNERMOST * grid.excess[1], grid.excess[1:])
        half, other = (
            HalfOrbits.of(lobe, lobe.outer_path(excess, grid.nodes)) for lobe in (right, left)
        )
        row = _integrals(p, half.after_mirrored(other))
        for name in (*MOMENTS, "contact", "noise"):
            sign = -1.0 if name == "displacement" else 1.0
            row[name][0] = inner[count + k][name] + sign * inner[count - 1 - k][name]
        row["height"] = 0.5 * (grid.excess[1:] + grid.excess[:-1])
        row["face_height"] = grid.excess
        row["junction"] = right.junction
        row["base"] = right.potential.energy(right.junction, right.stiffness[0])
        rows.append(row)
    return _table(rows, np.ones(count, dtype=bool))


def _separatrix(p, lobe, grid):
    if not lobe.has_well:
        return dict.fromkeys(_integrals_names(), 0.0)
    half = HalfOrbits.of(lobe, lobe.well_path(np.ones(1), grid.nodes))
    return {name: values[0] for name, values in _integrals(p, half).items()}


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
        "contact": half.integral(speed * half.damping),
        "voltage": half.filtered_power(p.decay_rate),
        "noise": half.noise(p.correlation_time),
    }


def _row_names():
    return (*_integrals_names(), "centre", "face_height")


def _table(rows, exists):
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    return Table(exists=exists, **columns)


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
        exists = exists[1:] & exists[:-1]
        area["wells"] = np.zeros((2 * count + 1, len(grid.share)))
        displacement["wells"] = np.zeros_like(area["wells"])
        for k in np.flatnonzero(exists):
            if not lobes[k].has_well:
                continue
            half = HalfOrbits.of(lobes[k], lobes[k].well_path(grid.share[1:], grid.nodes))
            area["wells"][k, 1:] = half.area
            displacement["wells"][k, 1:] = half.integral(half.speed * half.x)
    lobes = both_ways(p, stiffness, grid.charge[1:])
    lobes.insert(count, Lobe(p, stiffness, grid.charge[0]))
    inner = [_separatrix(p, lobe, grid) for lobe in lobes]
    area["outer"] = np.zeros((count + 1, len(grid.excess)))
    displacement["outer"] = np.zeros_like(area["outer"])
    for k in range(count + 1):
        right, left = lobes[count + k], lobes[count - k]
        half, other = (
            HalfOrbits.of(lobe, lobe.outer_path(grid.excess[1:], grid.nodes))
            for lobe in (right, left)
        )
        whole = half.after_mirrored(other)
        mine, theirs = inner[count + k], inner[count - k]
        area["outer"][k, 0] = mine["area"] + theirs["area"]
        area["outer"][k, 1:] = whole.area
        displacement["outer"][k, 0] = mine["displacement"] - theirs["displacement"]
        displacement["outer"][k, 1:] = whole.integral(whole.speed * whole.x)
    return Faces(area, displacement)
