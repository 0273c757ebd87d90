"""Beams by scikit-fem's Hermite element, an independent model of the same theory."""

import itertools

import numpy as np
from scipy.linalg import eigh
from skfem import Basis, BilinearForm, ElementLineHermite, LinearForm, MeshLine
from skfem.helpers import dd, ddot


def matrices(ends, rigidity, mass, tip=(0.0, 0.0, 0.0), per_piece=24):
    """Stiffness, mass and load of a unit base acceleration, the clamp's two rows taken out.

    `ends` are the pieces' ends with 0, `tip` mass, offset and inertia about the end.
    """
    points = [np.linspace(a, b, per_piece + 1)[:-1] for a, b in itertools.pairwise(ends)]
    mesh = MeshLine(np.append(np.concatenate(points), ends[-1]))
    basis = Basis(mesh, ElementLineHermite(), intorder=8)

    def of_place(values):
        return lambda x: np.select([x <= end for end in ends[1:]], values, values[-1])

    stiff, heavy = of_place(rigidity), of_place(mass)
    k = BilinearForm(lambda u, v, w: stiff(w.x[0]) * ddot(dd(u), dd(v))).assemble(basis).toarray()
    m = BilinearForm(lambda u, v, w: heavy(w.x[0]) * u * v).assemble(basis).toarray()
    load = LinearForm(lambda v, w: heavy(w.x[0]) * v).assemble(basis)
    at = [int(basis.nodal_dofs[row, -1]) for row in (0, 1)]
    body, offset, inertia = tip
    m[np.ix_(at, at)] += [[body, body * offset], [body * offset, inertia]]
    load[at] += [body, body * offset]
    slopes = {float(x): int(basis.nodal_dofs[1, n]) for n, x in enumerate(mesh.p[0])}
    clamp = [int(basis.nodal_dofs[row, 0]) for row in (0, 1)]
    free = np.setdiff1d(np.arange(m.shape[0]), clamp)
    return k, m, load, free, slopes


def modes_of(k, m, free, count):
    """Angular frequencies and modes of unit modal mass, on all rows."""
    squares, vectors = eigh(k[np.ix_(free, free)], m[np.ix_(free, free)])
    whole = np.zeros((m.shape[0], count))
    whole[free] = vectors[:, :count]
    return np.sqrt(squares[:count]), whole
