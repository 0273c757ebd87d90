"""Self-consistent families of orbits, and how far they reach."""

import numpy as np
import pytest
from truths import flat

from harvester.averaging.orbits import Edge, edges, settled_orbits
from harvester.base.errors import AveragingError
from harvester.scene.model import Scene

NODES = 32
PAPER = flat(Scene.read("paper"))


@pytest.mark.parametrize("decay_rate", [1e-3, 0.05, 1.0, 10.0])
def test_fixed_point_of_frequency_and_added_stiffness(decay_rate):
    p = PAPER._replace(decay_rate=decay_rate)
    orbits = settled_orbits(Edge(p.system, inside=True), np.linspace(-6.0, 6.0, 30), NODES)
    # A well's orbit runs from left to right in half a period.
    frequency = np.pi / orbits.time
    expected = p.coupling * frequency**2 / (p.decay_rate**2 + frequency**2)
    assert orbits.added == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("decay_rate", [0.05, 0.5, 5.0])
@pytest.mark.parametrize("closure", ["paper", "consistent"])
def test_orbits_lie_inside_one_another(decay_rate, closure):
    p = PAPER._replace(decay_rate=decay_rate)
    for edge, first, last in edges(p.system, closure):
        orbits = settled_orbits(edge, np.linspace(first, last, 150), NODES)
        inner_part = slice(40, None) if edge.inside else slice(1, None)
        assert np.all(np.diff(orbits.right)[inner_part] > 0.0)
        assert np.all(np.diff(orbits.left)[inner_part] <= 0.0)
        assert np.all(np.diff(orbits.loop(1.0)) > 0.0)


@pytest.mark.parametrize("decay_rate", [0.05, 0.3, 1.0])
def test_printed_wells_stay_inside_the_outer_orbits(decay_rate):
    p = PAPER._replace(decay_rate=decay_rate)
    (wells, _, last), (outer, first, _) = edges(p.system, "paper")
    inside = settled_orbits(wells, np.array([last]), NODES)
    around = settled_orbits(outer, np.array([first]), NODES)
    assert inside.right[0] <= around.right[0] * (1.0 + 1e-4)
    # Both on the right and with X' ≥ 0.
    assert inside.loop(1.0)[0] < around.loop(1.0)[0]


def test_nothing_damps():
    p = PAPER._replace(damping=0.0, coupling=0.0, restitution=1.0)
    with pytest.raises(AveragingError, match="do not bound the energy"):
        edges(p.system, "paper")
