"""First-order filters along an orbit, by spectral elements in time.

The orbit's quadrature has pieces on which time and displacement are smooth functions of one
coordinate: polynomials of that coordinate solve the filter's equation to the quadrature's own
accuracy, where differences from node to node would be of second order only.
"""

from functools import cache

import numpy as np

from harvester.averaging.orbits import unit_nodes
from harvester.compilation import compiled

SHORTEST = 1e-9  # duration of a piece that counts, in units of the whole


def filtered_power(element, speed, nodes, rate, damping=0.0):
    """∮X' y dt with rate (rate + damping) y − y'' = X' and y = 0 at both turning points.

    Galerkin's solution: symmetric, and with the square of the error of y.

    Parameters
    ----------
    element, speed : ndarray, shape (orbits, pieces · nodes)
        dX and X' at the nodes of half an orbit, in the order of time.
    nodes : int
        Gauss–Legendre nodes of each piece.
    rate : float
        Of the filter; 1/rate its time.
    damping : ndarray, shape (orbits, pieces · nodes), or float
        Of the motion, ≥ 0.

    Returns
    -------
    ndarray, shape (orbits,)
        Over upper and lower half.
    """
    duration = element / speed
    return 2.0 * _power(element, duration, rate * (rate + damping) * duration, *_polynomials(nodes))


@cache
def _polynomials(nodes):
    """Values at the nodes, and derivatives times the node's weight, arrays (functions, nodes).

    The first function is 1 where a piece begins, the last one where it ends; those between are
    integrals of Legendre polynomials, 0 at both ends.
    """
    points, weights = unit_nodes(nodes)
    value, slope = np.empty((nodes, nodes)), np.empty((nodes, nodes))
    value[0], slope[0] = 1.0 - points, -1.0
    value[-1], slope[-1] = points, 1.0
    for degree in range(1, nodes - 1):
        shape = np.polynomial.Legendre.basis(degree, domain=[0.0, 1.0])
        value[degree], slope[degree] = shape.integ(lbnd=0.0)(points), shape(points)
    return value, slope * weights


@compiled
def _power(element, duration, weighted, value, slope):
    orbits, (functions, nodes) = len(element), value.shape
    power = np.zeros(orbits)
    matrix, load = np.empty((functions, functions)), np.empty(functions)
    mass, bend = np.empty(nodes), np.empty(nodes)
    for orbit in range(orbits):
        shortest = SHORTEST * np.sum(duration[orbit])
        pieces = element.shape[1] // nodes
        last = pieces - 1
        while np.sum(duration[orbit, last * nodes : (last + 1) * nodes]) <= shortest:
            last -= 1
        pivot, carried, first = 0.0, 0.0, True
        for piece in range(last + 1):
            start = piece * nodes
            if np.sum(duration[orbit, start : start + nodes]) <= shortest:
                continue
            for q in range(nodes):
                mass[q] = weighted[orbit, start + q]
                bend[q] = 1.0 / duration[orbit, start + q]
            for a in range(functions):
                load[a] = 0.0
                for q in range(nodes):
                    load[a] += value[a, q] * element[orbit, start + q]
                for b in range(a + 1):
                    entry = 0.0
                    for q in range(nodes):
                        entry += value[a, q] * value[b, q] * mass[q]
                        entry += slope[a, q] * slope[b, q] * bend[q]
                    matrix[a, b] = entry
            matrix[0, 0] += pivot
            load[0] += carried
            # Eliminated in order; Σ load²/pivot is the load's product with the solution.
            for k in range(1 if first else 0, functions - 1):
                power[orbit] += load[k] * load[k] / matrix[k, k]
                for a in range(k + 1, functions):
                    share = matrix[a, k] / matrix[k, k]
                    load[a] -= share * load[k]
                    for b in range(k + 1, a + 1):
                        matrix[a, b] -= share * matrix[b, k]
            pivot, carried, first = matrix[functions - 1, functions - 1], load[functions - 1], False
    return power
