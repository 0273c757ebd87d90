"""Self-consistent families of orbits."""

import numpy as np
import pytest
from truths import flat

from harvester.averaging.edges import follow, outer_range, well_range
from harvester.averaging.orbits import OuterEdge, Potential, WellEdge
from harvester.errors import AveragingError
from harvester.scene.model import Scene

PAPER = flat(Scene.load("paper"))


@pytest.mark.parametrize("decay_rate", [1e-3, 0.05, 1.0, 10.0])
def test_fixed_point_of_frequency_and_added_stiffness(decay_rate):
    p = PAPER._replace(decay_rate=decay_rate)
    stretch = follow(WellEdge(Potential(p)), p, np.linspace(-6.0, 6.0, 30), 24)
    frequency = 2.0 * np.pi / stretch.orbits.period
    expected = p.coupling * frequency**2 / (p.decay_rate**2 + frequency**2)
    assert stretch.orbits.added_stiffness == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("decay_rate", [0.05, 0.5, 5.0])
@pytest.mark.parametrize("anchored", [False, True])
def test_orbits_lie_inside_one_another(decay_rate, anchored):
    p = PAPER._replace(decay_rate=decay_rate)
    wells = WellEdge(Potential(p, anchor=p.rest if anchored else 0.0))
    outer = OuterEdge(Potential(p), 1.0)
    ranges = [(wells, *well_range(wells, p, np.inf)), (outer, *outer_range(outer, p))]
    for edge, first, last in ranges:
        orbits = follow(edge, p, np.linspace(first, last, 150), 24).orbits
        inner_part = slice(40, None) if edge is wells else slice(1, None)
        assert np.all(np.diff(orbits.right)[inner_part] > 0.0)
        assert np.all(np.diff(orbits.left)[inner_part] <= 0.0)
        assert np.all(np.diff(orbits.area) > 0.0)


@pytest.mark.parametrize("decay_rate", [0.05, 0.3, 1.0])
def test_printed_wells_stay_inside_the_outer_orbits(decay_rate):
    p = PAPER._replace(decay_rate=decay_rate)
    wells, outer = WellEdge(Potential(p)), OuterEdge(Potential(p), 1.0)
    around = follow(outer, p, np.array([outer_range(outer, p)[0]]), 24).orbits
    _, last = well_range(wells, p, around.right[0])
    inside = follow(wells, p, np.array([last]), 24).orbits
    assert inside.right[0] <= around.right[0] * (1.0 + 1e-4)
    assert 2.0 * inside.area[0] < around.area[0]


def test_nothing_damps():
    p = PAPER._replace(damping=0.0, coupling=0.0, restitution=1.0)
    with pytest.raises(AveragingError, match="does not bound the energy"):
        outer_range(OuterEdge(Potential(p), 1.0), p)
