"""Orbits and their integrals on a grid of levels and layers of the slow charge Z.

Right-hand wells at all Z and outer orbits at Z > 0 stand for the whole: (X, Z) → (−X, −Z) gives
the rest. Wells are layers from −Z to Z, so that layer k and its mirror image are k and −1 − k.
"""

from dataclasses import dataclass

import numpy as np

from harvester.averaging.lobes import HalfOrbits, Lobe

MOMENTS = ("area", "displacement", "square", "speed_square")


@dataclass(frozen=True)
class Grid:
    """Faces of the cells.

    Attributes
    ----------
    charge : ndarray
        Z ≥ 0 at the faces of the layers; one layer without extent for a monostable device.
    share : ndarray
        Of the way from a well's bottom to its end, from 0 to 1; empty without wells.
    excess : ndarray
        Energy of outer orbits above the junction, from 0.
    nodes : int
        Quadrature nodes on each piece of an orbit.
    """

    charge: np.ndarray
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
    charge = 0.5 * (grid.charge[1:] + grid.charge[:-1])
    lobes = both_ways(p, stiffness, charge)
    count = len(charge)
    tables = {}
    inner = {name: np.zeros(2 * count) for name in _integrals_names()}
    if len(grid.share):
        tables["wells"] = _wells(p, lobes, grid)
        inner = {name: getattr(tables["wells"], name)[:, -1] for name in _integrals_names()}
    tables["outer"] = _outer(p, lobes, grid, inner)
    return tables


def both_ways(p, stiffness, charge):
    """Lobes at −Z, in falling order, then at Z."""
    return [Lobe(p, stiffness, z) for z in (*-charge[::-1], *charge)]


def _integrals_names():
    return (*MOMENTS, "contact", "voltage", "noise")


def _wells(p, lobes, grid):
    middle = 0.5 * (grid.share[1:] + grid.share[:-1])
    rows = []
    for lobe in lobes:
        if not lobe.has_well:
            rows.append({name: np.zeros(len(grid.share)) for name in _row_names()})
            rows[-1].update(junction=lobe.junction, base=0.0, height=np.zeros(len(middle)))
            continue
        half = HalfOrbits.of(lobe, lobe.well_path(grid.share[1:], grid.nodes))
        row = {name: np.insert(values, 0, 0.0) for name, values in _integrals(p, half).items()}
        row["centre"][0] = lobe.bottom
        if lobe.saddle:
            row["centre"][-1] = lobe.junction
        row["height"] = lobe.well_heights(middle)
        row["face_height"] = lobe.well_heights(grid.share)
        row["junction"] = lobe.junction
        row["base"] = lobe.potential.energy(lobe.bottom, lobe.stiffness[0])
        rows.append(row)
    return _table(rows, np.array([lobe.has_well for lobe in lobes]))


def _outer(p, lobes, grid, inner):
    count = len(lobes) // 2
    rows = []
    for k in range(count):
        right, left = lobes[count + k], lobes[count - 1 - k]
        half, other = (
            HalfOrbits.of(lobe, lobe.outer_path(grid.excess[1:], grid.nodes))
            for lobe in (right, left)
        )
        row = _integrals(p, half.after_mirrored(other))
        for name in _integrals_names():
            sign = -1.0 if name == "displacement" else 1.0
            enclosed = inner[name][count + k] + sign * inner[name][count - 1 - k]
            row[name] = np.insert(row[name], 0, enclosed)
        row["centre"] = np.insert(row["centre"], 0, right.junction)
        if not right.saddle and right.has_well:
            row["centre"][0] = row["centre"][1]
        row["height"] = 0.5 * (grid.excess[1:] + grid.excess[:-1])
        row["face_height"] = grid.excess
        row["junction"] = right.junction
        row["base"] = right.potential.energy(right.junction, right.stiffness[0])
        rows.append(row)
    return _table(rows, np.ones(count, dtype=bool))


def _integrals(p, half):
    speed, x = half.speed, half.x
    period = half.period
    return {
        "area": half.area,
        "displacement": half.integral(speed * x),
        "square": half.integral(speed * x * x),
        "speed_square": half.integral(speed**3) / 3.0,
        "centre": half.integral(x / speed) / period,
        "contact": half.integral(speed * half.damping),
        "voltage": half.filtered_power(p.decay_rate),
        "noise": half.filtered_power(1.0 / p.correlation_time) / p.correlation_time**2,
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
    lobes = both_ways(p, stiffness, grid.charge[1:])
    lobes.insert(len(lobes) // 2, Lobe(p, stiffness, grid.charge[0]))
    count = len(grid.charge) - 1
    area, displacement = {}, {}
    first = {"area": np.zeros(2 * count + 1), "displacement": np.zeros(2 * count + 1)}
    if "wells" in tables:
        exists = np.insert(tables["wells"].exists, 2 * count, True)
        exists[1:-1] &= exists[:-2]
        exists[0] &= lobes[0].has_well
        area["wells"] = np.zeros((2 * count + 1, len(grid.share)))
        displacement["wells"] = np.zeros_like(area["wells"])
        for k, lobe in enumerate(lobes):
            if not exists[k]:
                continue
            half = HalfOrbits.of(lobe, lobe.well_path(grid.share[1:], grid.nodes))
            area["wells"][k, 1:] = half.area
            displacement["wells"][k, 1:] = half.integral(half.speed * half.x)
        first = {"area": area["wells"][:, -1], "displacement": displacement["wells"][:, -1]}
    area["outer"] = np.zeros((count + 1, len(grid.excess)))
    displacement["outer"] = np.zeros_like(area["outer"])
    for k in range(count + 1):
        right, left = lobes[count + k], lobes[count - k]
        half, other = (
            HalfOrbits.of(lobe, lobe.outer_path(grid.excess[1:], grid.nodes))
            for lobe in (right, left)
        )
        whole = half.after_mirrored(other)
        area["outer"][k, 0] = first["area"][count + k] + first["area"][count - k]
        area["outer"][k, 1:] = whole.area
        displacement["outer"][k, 0] = (
            first["displacement"][count + k] - first["displacement"][count - k]
        )
        displacement["outer"][k, 1:] = whole.integral(whole.speed * whole.x)
    return Faces(area, displacement)
