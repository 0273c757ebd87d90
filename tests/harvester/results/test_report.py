"""`--report` of any study: one page, its headline first."""

import re

import pytest

import harvester
from harvester.results.report import page_of

pytestmark = pytest.mark.usefixtures("shared_workers")

BRIEF = ["run.realizations=2", "run.duration=200", "run.settle=20"]
GRID = {"load.decay_rate": [0.5, 1.0, 2.0]}


@pytest.mark.exhaustive
def test_a_page_begins_with_the_result(pool):
    scene = harvester.Scene.read("linear", BRIEF)
    sine = harvester.Scene.read("cantilever")
    found = {
        "scaled power into a resistor": harvester.simulate(
            scene, method="monte-carlo", runner=pool
        ),
        "largest power: .* at decay rate of the load": harvester.load_study(
            scene, over=GRID, method="consistent", executor=pool
        ),
        "highest mean power": harvester.sweep(scene, GRID, methods=["consistent"], executor=pool),
        "largest power: 12.* mW at 47 Hz": harvester.frequency_response(
            sine, [46.0, 47.0, 48.0], amplitude=9.80665, executor=pool
        ),
        "largest mean power: .* at load.decay_rate": harvester.optimum(
            harvester.Scene.read("linear", ["run.realizations=8", "run.duration=500"]),
            "load.decay_rate",
            executor=pool,
        ),
    }
    for words, content in found.items():
        page = page_of(content, "a study")
        first = re.search(r'<ul class="verdict">\s*<li class="neutral">(.*?)</li>', page)
        assert first, words
        assert re.search(words, first[1]), first[1]
        assert "data:image/svg+xml" in page
        assert "excitation." in page
        assert page.index("<h2>Result") < page.index("<h2>Numbers") < page.index("<h2>Figures")
