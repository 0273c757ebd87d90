import numpy as np
import pytest

from harvester.device.zones import crossing

EDGE, SPEED, ACCELERATION, STEP = 1.0127108949553747, 1.28e-5, 0.3, 0.0125


def end(x, v, acceleration):
    """Displacement and velocity after a step of constant acceleration."""
    return x + v * STEP + 0.5 * acceleration * STEP**2, v + acceleration * STEP


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("beyond", [0, 1, -1])
def test_a_mass_that_leaves_an_edge_passes_it_on_its_way_back(direction, beyond):
    """Not where it begins, be it on the edge or off it by rounding: it would get nowhere."""
    x = np.nextafter(EDGE, EDGE + beyond) if beyond else EDGE
    v, acceleration = -direction * SPEED, direction * ACCELERATION
    time = crossing(EDGE, direction, x, v, *end(x, v, acceleration), STEP)
    assert time == pytest.approx(2.0 * SPEED / ACCELERATION, rel=1e-3)


@pytest.mark.parametrize("direction", [1, -1])
def test_a_mass_on_its_way_to_an_edge_passes_it_once(direction):
    x, v, acceleration = EDGE - direction * 1e-4, direction * 0.1, direction * ACCELERATION
    time = crossing(EDGE, direction, x, v, *end(x, v, acceleration), STEP)
    assert v * time + 0.5 * acceleration * time**2 == pytest.approx(direction * 1e-4, rel=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_a_cubic_passes_an_edge_at_its_root(seed):
    """The cubic through a step's ends, by its coefficients, of a path that always rises."""
    random, h = np.random.default_rng(seed), 0.3
    rise = np.polynomial.Polynomial([random.uniform(0.0, 0.3), *random.normal(size=2)]) ** 2
    path = rise.integ(k=random.normal()) if seed % 2 else rise.integ()
    edge = path(random.uniform(0.05, 0.95) * h)
    ends = (path(0.0), rise(0.0), path(h), rise(h))
    matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [1, h, h**2, h**3], [0, 1, 2 * h, 3 * h**2]]
    cubic = np.polynomial.Polynomial(np.linalg.solve(matrix, ends))
    roots = (cubic - edge).roots()
    (time,) = roots.real[(abs(roots.imag) < 1e-12) & (roots.real > 0.0) & (roots.real < h)]
    assert crossing(edge, 1, *ends, h) == pytest.approx(time, rel=1e-6)
    mirrored = (-each for each in ends)
    assert crossing(-edge, -1, *mirrored, h) == pytest.approx(time, rel=1e-6)
