"""Ratios of throughput; how large they are is for `work-precision` to tell."""

import json

import pytest

from harvester.base.serialising import plain
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing
from harvester.validation.throughput import Throughput, measure, ratios


def test_ratios_are_of_the_rates_they_name():
    rows = [
        Throughput("PWL", 1, 1, 100.0),
        Throughput("external", 1, 1, 3000.0),
        Throughput("one", 1, 1, 2000.0),
        Throughput("many", 16, 1, 5000.0),
        Throughput("two", 1, 2, 3800.0),
    ]
    assert ratios(rows) == pytest.approx(
        {"external / PWL": 30.0, "16 × many / one": 2.5, "two / one": 1.9}
    )
    json.dumps(plain(rows), allow_nan=False)


def test_every_way_is_measured_at_its_own_step(pool):
    scene = Scene.read("paper")
    asked = []

    class Watching:
        def map(self, function, calls):
            asked.extend(calls)
            return pool.map(function, calls)

    rows = measure(prepared(scene), Watching(), compiled=False, knots=200, repeats=1)
    assert [row.copies for row in rows] == [1, 1, 1, 16, 1]
    assert all(row.rate > 0.0 for row in rows)
    steps = [call["engine"].step for call in asked]
    assert steps == [knot_spacing(prepared(scene))] * 2 + ["default"] * 4
    assert len({(call["engine"].source, len(call["indices"])) for call in asked}) == 3
