"""Jumps between wells, on paths whose jumps are known."""

import numpy as np
import pytest

from harvester.device import timescales
from harvester.device.cores import core_energies, cores_within, jump_rates
from harvester.device.record import Record
from harvester.device.system import potential
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.statistics.joint import JointHistogram
from harvester.statistics.jumps import Jumps

# U = −x² + x⁴/4: wells at ±√2 with a barrier of 1, cores below a quarter of it.
WELL = np.sqrt(2.0)
SLOW, FAST = 0.5, 1.2  # velocities at a well's bottom: ½v² = 0.125 and 0.72


def device(force=(0.0, -2.0, 0.0, 1.0)):
    """A device without stoppers in scaled units."""
    return prepared(
        Scene.from_tables(
            {
                "units": "scaled",
                "oscillator": {"damping": 0.1, "restoring_force": list(force)},
                "piezo": {"coupling": 0.1},
                "load": {"decay_rate": 1.0},
                "excitation": {"kind": "white", "intensity": 0.1},
                "run": {"duration": 10.0, "seed": 1},
            }
        )
    ).system


def record(points):
    """A record of (time, X, X'), all else 0."""
    time, x, v = np.array(points, dtype=float).T
    return Record(time, x, v, *[np.zeros(time.size)] * (len(Record._fields) - 3))


def jumps_along(points, start=0.0, batch_length=10.0, batches=1, force=(0.0, -2.0, 0.0, 1.0)):
    """What is counted along points, given in pieces of any length."""
    jumps = Jumps.empty(device(force), start, batch_length, batches)
    cut = len(points) // 3
    for piece in (points[:cut], points[cut : cut + 1], points[cut + 1 :]):
        if piece:
            jumps.add(record(piece))
    return jumps


def test_crossing_back_is_no_jump():
    path = [(0, WELL, SLOW), (1, 0.1, 0.0), (2, -0.2, 0.0), (3, 0.1, 0.0), (4, WELL, 0.0)]
    jumps = jumps_along(path)
    assert jumps.counts.sum() == 0.0
    assert jumps.times.tolist() == [[0.0, 4.0], [0.0, 0.0]]


def test_passing_another_well_fast_is_no_jump():
    path = [(0, WELL, SLOW), (1, 0.0, -1.0), (2, -WELL, -FAST), (3, -WELL, FAST), (4, 0.0, 1.0)]
    jumps = jumps_along([*path, (5, WELL, SLOW)])
    assert jumps.counts.sum() == 0.0


def test_a_jump_counts_once_and_time_belongs_to_the_well_reached_last():
    path = [(0, WELL, 0.0), (1, 0.0, -1.0), (2, -WELL, FAST), (3, -WELL, -SLOW), (4, -WELL, SLOW)]
    jumps = jumps_along([*path, (6, 0.2, 0.0), (7, -WELL, 0.0)])
    assert jumps.counts[0].tolist() == [[0.0, 0.0], [1.0, 0.0]]
    assert not jumps.counts[1].any()
    assert jumps.times[0].tolist() == [4.0, 3.0]


def test_batches_and_what_lies_before_the_start():
    path = [(0, -WELL, 0.0), (1, WELL, 0.0), (2, WELL, 0.0), (3, -WELL, 0.0), (4, WELL, 0.0)]
    jumps = jumps_along(path, start=2.0, batch_length=1.0, batches=2)
    assert jumps.counts.tolist() == [
        [[0.0, 0.0], [1.0, 0.0]],
        [[0.0, 1.0], [0.0, 0.0]],
        [[0.0, 1.0], [0.0, 0.0]],
    ]
    assert jumps.times.tolist() == [[0.0, 1.0], [1.0, 0.0], [1.0, 1.0]]


def test_three_wells_by_hand():
    """Each point's core by the potential itself, on a random walk."""
    force = (0.1, 2.0, 0.0, -4.9, 0.0, 2.23)
    system = device(force)
    generator = np.random.default_rng(4)
    x = np.cumsum(generator.normal(size=4000)) * 0.3
    x = 2.2 * np.sin(x)
    v = 0.4 * generator.normal(size=x.size)
    points = list(zip(np.arange(x.size, dtype=float), x, v, strict=True))
    jumps = jumps_along(points, batch_length=1e5, force=force)
    saddles, limits = sorted(timescales.saddles(system)), core_energies(system)
    counts, times, last = np.zeros((3, 3)), np.zeros(3), -1
    for place, speed in zip(x, v, strict=True):
        here = int(np.searchsorted(saddles, place))
        if last >= 0:
            times[last] += 1.0
        if 0.5 * speed**2 + potential(system, place) <= limits[here]:
            if last not in (-1, here):
                counts[last, here] += 1.0
            last = here
    assert counts.sum() > 50.0
    assert np.array_equal(jumps.counts[0], counts)
    assert jumps.times[0] == pytest.approx(times)


def test_cores_lie_within_their_ends():
    system = device((0.1, 2.0, 0.0, -4.9, 0.0, 2.23))
    low, high = cores_within(system)
    assert min(potential(system, low), potential(system, high)) > core_energies(system).max()


def test_names_of_rates():
    assert jump_rates(2, True) == {"jump_rate": ((0, 1), (1, 0))}
    assert len(jump_rates(3, False)) == 6
    assert jump_rates(2, False)["jump_rate_from_well_2_to_1"] == ((1, 0),)


def test_joint_histogram_is_numpys():
    """Samples at whole multiples of the interval, bins doubled on either axis as needed."""
    generator = np.random.default_rng(2)
    time = np.arange(3000.0)
    x, v = generator.normal(size=time.size), 30.0 * generator.normal(size=time.size)
    joint = JointHistogram.empty(100.0, 1.0)
    points = list(zip(time, x, v, strict=True))
    for piece in (points[:700], points[700:701], points[701:]):
        joint.add(record(piece))
    edges = [(np.arange(257) - 128) * width for width in joint.bin_widths]
    expected = np.histogram2d(x[101:], v[101:], bins=edges)[0]
    assert expected.sum() == time.size - 101
    assert np.array_equal(joint.counts, expected)
