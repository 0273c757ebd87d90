"""Density of the voltage V = X − Z, from a state at a few nodes of the charge Z.

The nodes give moments of Z. If these and X' determine the density, as for a fast load, Z has a
normal density at each X and X'. Otherwise, as for a slow load that keeps the charge of the previous
well, Z has the maximum-entropy density at each X (Jaynes 1957): the exponential of a polynomial.
"""

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.ndimage import convolve1d, map_coordinates

from harvester.averaging.flow import PhaseGrid

# This filter removes components that change sign from node to node, and keeps moments up to the
# third.
SMOOTHING = np.array([-1.0, 4.0, 10.0, 4.0, -1.0]) / 16.0
# Number of voltages X − Z at which the density is tabulated.
VALUES = 481
# Points with less than this share of the greatest mass are left out of the density of Z.
COUNTED_MASS = 1e-4
# Number of standard deviations over which a normal density is evaluated.
NORMAL_TAIL = 5.0
# Number of normal densities that are summed at a time, to save memory.
NORMALS_AT_A_TIME = 4000
# Normal densities are used if they miss the fourth moment by less than this share.
NORMAL_FOURTH_MOMENT = 0.03
# The maximum-entropy density: its degree, the number of values of Z at which it is tabulated, the
# weight ε₁ of the penalty on the first moment, and the growth of the weight with each higher
# moment, which the nodes give less accurately.
DEGREE, CHARGES, LOOSENESS, LOOSER = 12, 121, 2e-5, 2.0
# Newton's iteration for its weights: most steps, largest final gradient, and most halvings of a
# step.
MOST_ITERATIONS, SETTLED, MOST_HALVINGS = 60, 1e-6, 30
# A step must achieve this share of the decrease that the gradient predicts (Armijo).
SUFFICIENT_DECREASE = 1e-4


def density_of_charge(grid: PhaseGrid, mass: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values of X − Z, evenly spaced, and the density there.

    The density has the mean and variance of the nodes, and is nowhere negative.

    `mass`: mass at the nodes of (X, Z, X'), with sum 1.
    """
    charges = grid.x[:, None] - grid.z
    along = mass.sum(axis=2)
    mean = float(np.sum(along * charges))
    spread, fourth = (float(np.sum(along * (charges - mean) ** power)) for power in (2, 4))
    for find in (_of_normals, _of_greatest_entropy):
        charge, density = find(grid, mass)
        density = density / np.trapezoid(density, charge)
        middle = np.trapezoid(density * charge, charge)
        variance = np.trapezoid(density * (charge - middle) ** 2, charge)
        stretch = np.sqrt(spread / variance)
        charge, density = mean + stretch * (charge - middle), density / stretch
        missed = np.trapezoid(density * (charge - mean) ** 4, charge) - fourth
        if abs(missed) < NORMAL_FOURTH_MOMENT * fourth:
            break
    return charge, density


def _of_normals(grid, mass):
    """p(V) from normal densities of Z at each X and X', wide enough to bridge the nodes of X."""
    moments = np.einsum("nz,xzv->nxv", [grid.z**power for power in range(3)], mass)
    for axis in (1, 2):
        moments = convolve1d(moments, SMOOTHING, axis=axis, mode="constant")
    row, column = np.nonzero(moments[0] > COUNTED_MASS * moments[0].max())
    held, first, second = moments[:, row, column]
    centre, least = grid.x[row] - first / held, 0.5 * (grid.x[1] - grid.x[0])
    spread = np.sqrt(np.maximum(second / held - (first / held) ** 2, least**2))
    tail = NORMAL_TAIL * spread
    charge = np.linspace((centre - tail).min(), (centre + tail).max(), VALUES)
    density = np.zeros(charge.size)
    for part in np.array_split(np.arange(centre.size), 1 + centre.size // NORMALS_AT_A_TIME):
        deviation = (charge - centre[part, None]) / spread[part, None]
        density += (held[part] / spread[part]) @ np.exp(-0.5 * deviation**2)
    return charge, density


def _of_greatest_entropy(grid, mass):
    """p(V) from maximum-entropy densities of Z at each X, with the moments of the nodes."""
    x, z = grid.x, grid.z
    along = convolve1d(mass.sum(axis=2), SMOOTHING, axis=0, mode="constant")
    held = along.sum(axis=1)
    rows = np.flatnonzero(held > COUNTED_MASS * held.max())
    middle, half = 0.5 * (z[-1] + z[0]), 0.5 * (z[-1] - z[0])
    nodes, degree = np.linspace(-1.0, 1.0, CHARGES), min(DEGREE, z.size - 1)
    moments = along[rows] @ _polynomials((z - middle) / half, degree) / held[rows, None]
    shares = np.zeros((x.size, CHARGES))
    shares[rows] = held[rows, None] * _greatest_entropy(_polynomials(nodes, degree), moments)
    charge = np.linspace(x[0] - z[-1], x[-1] - z[0], VALUES)
    # For each value of Z, the density of X at X − Z = V.
    row = (charge[:, None] + middle + half * nodes - x[0]) / (x[1] - x[0])
    column = np.broadcast_to(np.arange(CHARGES), row.shape)
    return charge, np.maximum(map_coordinates(shares, [row, column]), 0.0).sum(axis=1)


def _polynomials(x, degree):
    """Legendre polynomials from degree 1 on, of mean square 1: (points, degree)."""
    return legvander(x, degree)[:, 1:] * np.sqrt(2.0 * np.arange(1, degree + 1) + 1.0)


def _greatest_entropy(polynomials, moments):
    """Shares of mass at points, (rows, points), of densities with these moments of the polynomials.

    The densities are exponentials of sums of the polynomials P. For the moments m, Newton's method
    minimizes ln Σ exp(l P) − l m + ½ Σ looseness l² over the weights l, with one step per row.
    """
    looseness = LOOSENESS * LOOSER ** np.arange(moments.shape[1])
    weights = np.zeros_like(moments)

    def objective(rows, trial):
        exponent = trial @ polynomials.T
        most = exponent.max(axis=1)
        log_sum = most + np.log(np.exp(exponent - most[:, None]).sum(axis=1))
        return log_sum + np.sum(trial * (0.5 * looseness * trial - moments[rows]), axis=1)

    left = np.arange(len(moments))
    for _ in range(MOST_ITERATIONS):
        shares = _shares(polynomials, weights[left])
        mean = shares @ polynomials
        slope = mean - moments[left] + looseness * weights[left]
        moving = np.abs(slope).max(axis=1) > SETTLED
        left, shares, mean, slope = (values[moving] for values in (left, shares, mean, slope))
        if left.size == 0:
            break
        products = np.einsum("rp,pi,pj->rij", shares, polynomials, polynomials, optimize=True)
        bend = products - mean[:, :, None] * mean[:, None, :] + np.diag(looseness)
        step = -np.linalg.solve(bend, slope[:, :, None])[:, :, 0]
        predicted = np.sum(slope * step, axis=1)
        before, length = objective(left, weights[left]), np.ones((left.size, 1))
        for _ in range(MOST_HALVINGS):
            change = objective(left, weights[left] + length * step) - before
            far = change > SUFFICIENT_DECREASE * length[:, 0] * predicted + SETTLED**2
            if not far.any():
                break
            length[far] *= 0.5
        weights[left] += length * step
    return _shares(polynomials, weights)


def _shares(polynomials, weights):
    exponent = weights @ polynomials.T
    shares = np.exp(exponent - exponent.max(axis=1, keepdims=True))
    return shares / shares.sum(axis=1, keepdims=True)
