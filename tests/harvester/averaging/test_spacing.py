"""Faces of cells that follow the probability."""

import numpy as np
import pytest

from harvester.averaging.spacing import clustered, fitted_to


def mass(faces):
    """Of exp(−x) between the faces."""
    return -np.diff(np.exp(-faces))


def error(faces):
    """Of the whole mass, the density's value taken at the cells' middles."""
    middle = 0.5 * (faces[1:] + faces[:-1])
    return abs(np.sum(np.exp(-middle) * np.diff(faces)) - 1.0)


@pytest.mark.parametrize("cells", [24, 48])
def test_fitted_faces_pay(cells):
    """In a range of forty decay lengths, from a first grid of cells more than two long."""
    even = np.linspace(0.0, 40.0, 17)
    fitted = fitted_to(mass(even), even, cells)
    assert np.all(np.diff(fitted) > 0.0)
    assert tuple(fitted[[0, -1]]) == (0.0, 40.0)
    assert error(fitted) < 0.2 * error(np.linspace(0.0, 40.0, cells + 1))


def test_twice_as_many_cells_leave_a_quarter_of_the_error():
    faces = 40.0 * clustered(20, 0.1)
    errors = [error(fitted_to(mass(faces), faces, cells)) for cells in (64, 128, 256)]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.1)


def test_without_probability_faces_stay_about_where_they_are():
    faces = clustered(12, 0.2)
    found = fitted_to(np.zeros(12), faces, 12)
    assert np.diff(found) == pytest.approx(np.diff(faces), rel=0.2)
