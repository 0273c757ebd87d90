"""Errors of shares of starts and of residence times, from values that are drawn."""

import dataclasses
import math

import numpy as np
import pytest

from harvester.results.orbit import share_error
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.studies.orbits.residence import Residence, ResidenceTime, stays, stays_of


@pytest.mark.parametrize(("part", "count"), [(30, 100), (500, 1000)])
def test_the_error_of_a_share_is_that_of_as_many_starts(part, count):
    share = part / count
    exact = math.sqrt(share * (1.0 - share) / count)
    assert share_error(part, count) == pytest.approx(exact, rel=0.01)


def test_a_share_of_all_starts_is_not_certain():
    assert share_error(100, 100) == pytest.approx(math.sqrt(0.5) / 100.0, rel=0.02)


@pytest.mark.parametrize("precision", [None, 0.05])
def test_a_precision_that_was_given_is_not_asked_for(precision):
    stays = [ResidenceTime(None, 1.0, 5.0, None, 3, 15.0, None, "")]
    residence = Residence(Scene.read("duffing"), None, stays, "", "", 0.0, precision)
    text = " ".join(residence.sentences())
    assert ("give a precision" in text) == (precision is None)
    assert "raise run.duration = " in text


def test_a_time_without_an_error_bar_is_hollow():
    stays = [
        ResidenceTime(d, 1.0, 5.0, error, 30, 15.0, None, "")
        for d, error in ((0.1, None), (0.2, 0.5))
    ]
    residence = Residence(Scene.read("duffing"), "excitation.intensity", stays, "", "", 0.0, None)
    (axes,) = residence.figure().axes
    white = [line for line in axes.lines if line.get_markerfacecolor() == "white"]
    assert [list(line.get_xdata()) for line in white] == [[0.1]]


def test_the_error_of_a_residence_time_is_how_far_it_lies_off():
    """Stays that end at random: 400 runs of some 80 stays.

    The mean square of deviations over errors is 1; it is known to 7 %.
    """
    scene, draws, mean = Scene.read("duffing"), np.random.default_rng(1), 5.0
    off = []
    for _ in range(400):
        times = draws.uniform(4.0, 6.0, (8, 5, 2))
        (stay,) = stays_of(prepared(scene), None, times, draws.poisson(times / mean).astype(float))
        off.append((stay.time - mean) / stay.standard_error)
    assert np.mean(np.square(off)) == pytest.approx(1.0, rel=0.25)


def test_a_row_of_both_wells_is_labelled_so():
    scene, times, exits = Scene.read("duffing"), np.full((4, 4, 2), 9.0), np.full((4, 4, 2), 2.0)
    bottom = prepared(scene).scales.displacement
    pooled = stays_of(prepared(scene), None, times, exits)
    residence = Residence(scene, None, pooled, "monte-carlo", "", 0.0)
    assert residence.table().rows[0][1].startswith("±")
    assert " in the well at ±" in residence.headline()
    assert residence.table().rows[0][1].value == pooled[0].well > 0.5 * bottom
    apart = [pooled[0], dataclasses.replace(pooled[0], well=-pooled[0].well)]
    apart = Residence(scene, None, apart, "monte-carlo", "", 0.0)
    assert [row[1][0] for row in apart.table().rows] == ["1", "-"]


def test_the_time_before_settling_is_no_part_of_the_stays():
    """At rest a device leaves its well later than later on: means would be too long."""
    length = {"run.settle": 30.0, "run.duration": 50.0, "run.realizations": 2}
    scene = Scene.read("duffing").replace(length)
    answer = stays(prepared(scene), "monte-carlo", [0, 1], "default", lambda _: None)
    assert answer["times"].sum() == pytest.approx(2 * 50.0, rel=1e-6)
