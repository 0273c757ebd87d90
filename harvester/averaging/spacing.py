"""Faces of cells, close together where the probability is."""

import numpy as np
from scipy.interpolate import PchipInterpolator

# Cells per length where nothing is, in units of the mean, so that none are too wide to be
# neighbours, and of a neighbour's own.
LEAST, BESIDE = 0.1, 0.5


def clustered(cells, scale):
    """Faces from 0 to 1, close together within `scale` of 0."""
    even = np.linspace(0.0, 1.0, cells + 1)
    if scale >= 1.0:
        return even
    stretch = np.arcsinh(1.0 / scale)
    faces = np.sinh(stretch * even) / np.sinh(stretch)
    faces[-1] = 1.0
    return faces


def fitted_to(mass, faces, cells):
    """So many cells between the same ends, as wide as the cube root of the density asks.

    A sum over cells then has the least error of second order. Faces are a smooth function of their
    number, so that the errors of grids twice as fine stay in proportion.

    Parameters
    ----------
    mass : ndarray, shape (given,)
        Probability of the cells between `faces`.
    faces : ndarray, shape (given + 1,)
    cells : int

    Returns
    -------
    ndarray, shape (cells + 1,)
    """
    width = np.diff(faces)
    wanted = np.cbrt(np.maximum(mass, 0.0) / width)
    if not wanted.max() > 0.0:
        wanted = 1.0 / width
    padded = np.pad(wanted, 1)
    wanted = np.maximum(wanted, BESIDE * np.maximum(padded[2:], padded[:-2]))
    number = np.append(0.0, np.cumsum(wanted * width))
    number += LEAST * number[-1] * (faces - faces[0]) / (faces[-1] - faces[0])
    found = PchipInterpolator(number / number[-1], faces)(np.linspace(0.0, 1.0, cells + 1))
    found[[0, -1]] = faces[[0, -1]]
    return found
