"""Maxima over several parameters whose place is known, with noise and without."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from toy_runner import ToyRunner

from harvester.base.errors import HarvesterError, OptimumError, SimulationError
from harvester.cli.command_line import main
from harvester.engines.opening import open_runner
from harvester.scene.model import Scene
from harvester.studies.optimum.proposals import BATCH, Proposals
from harvester.studies.public import optimum

pytestmark = pytest.mark.usefixtures("shared_workers")

optuna = pytest.importorskip("optuna", reason="Optuna is in the extra `optimum`")

PAPER = Scene.read("paper", ["run.realizations=2"])
# Coordinates of its maximum within `OVER`, and the value there.
TOP, HEIGHT = (0.3, 0.6), 5.0
OVER = {"stoppers.gap": (1.0, 2.0), "oscillator.damping": (0.01, 1.0)}


def hill(scene):
    """A paraboloid over the gap and the logarithm of the damping."""
    x, y = scene.stoppers[0].gap - 1.0, 0.5 * math.log10(scene.oscillator.damping / 0.01)
    return HEIGHT * (1.0 - (x - TOP[0]) ** 2 - 2.0 * (y - TOP[1]) ** 2)


def test_the_top_of_a_hill_without_noise():
    found = optimum(
        PAPER,
        OVER,
        maximise="mean_power",
        method="consistent",
        evaluations=16,
        runner=ToyRunner(hill),
    )
    assert max(value.estimate for _, value in found.searched) < 0.995 * HEIGHT
    gap, damping = found.parameters
    # The climb ends where no step of 1/256 of a ray gains a thousandth.
    assert found.value.estimate > 0.999 * HEIGHT
    # 1 % is lost at a distance of 0.1 in x and 0.07 in y.
    assert gap.flat_low == pytest.approx(1.2, abs=0.035)
    assert gap.flat_high == pytest.approx(1.4, abs=0.06)
    low, high = (damping.axis.coordinate(end) for end in (damping.flat_low, damping.flat_high))
    assert (low, high) == (pytest.approx(0.53, abs=0.035), pytest.approx(0.67, abs=0.035))
    assert (gap.open_low, gap.open_high, gap.is_narrow) == (False, False, False)
    header, rows = found.table()
    assert {len(row) for row in rows} == {len(header)}
    json.dumps(found.to_dict(), allow_nan=False)
    searched = found.data()
    assert [len(row) for row in searched.rows] == [len(searched.header)] * len(found.searched)
    assert [row[0] for row in searched.rows] == [
        place[found.keys[0]] for place, _ in found.searched
    ]


def test_a_maximum_at_the_end_of_a_range_is_told():
    over = {**OVER, "stoppers.gap": (1.5, 2.0)}
    runner = ToyRunner(hill)
    found = optimum(PAPER, over, maximise="mean_power", method="consistent", runner=runner)
    assert found.parameters[0].place == pytest.approx(1.5, abs=0.005)
    assert found.parameters[0].open_low
    assert any("at the end of its range, 1.5" in line for line in found.sentences())


def test_a_cliff_beside_the_maximum_is_told():
    def cliff(scene):
        return hill(scene) if scene.stoppers[0].gap < 1.25 else 0.1

    found = optimum(
        PAPER, OVER, maximise="mean_power", method="consistent", runner=ToyRunner(cliff)
    )
    gap = found.parameters[0]
    assert gap.place <= gap.flat_high < 1.25
    assert found.value.estimate > HEIGHT * (1.0 - 0.07**2 - 0.003)


def test_what_is_proposed_follows_from_the_answers():
    def run(values):
        proposals, places = Proposals(2, seed=3, first=(0.5, 0.5)), []
        for _ in range(4):
            asked = proposals.ask()
            places += asked
            proposals.tell([None if k == 2 else values(place) for k, place in enumerate(asked)])
        return places

    first = run(lambda place: -sum(place))
    assert first[0] == (0.5, 0.5)
    assert first == run(lambda place: -sum(place))
    assert first[: 2 * BATCH] != run(lambda place: sum(place))[: 2 * BATCH] or first != run(sum)
    assert np.mean(first[2 * BATCH :]) < np.mean(first[:BATCH])


@pytest.mark.slow
def test_the_value_is_not_that_of_the_luckiest_run():
    """Runs of 4 % error each. Values at the places found, in their own errors: the mean of 20
    within four of its errors (one false alarm in 16 000), where the highest of a search is
    1.5 errors too high and more."""
    values, lucky, heights = [], [], []
    runner = ToyRunner(hill, 0.04 * HEIGHT)
    for seed in range(20):
        scene = PAPER.replace({"run.seed": seed})
        found = optimum(
            scene,
            OVER,
            maximise="jump_rate",
            evaluations=40,
            runner=runner,
        )
        *before, last = (each.scene.run.seed for each in runner.asked)
        assert last not in before
        there = hill(scene.replace({each.axis.key: each.place for each in found.parameters}))
        heights.append(there)
        values.append((found.value.estimate - there) / found.value.standard_error)
        lucky.append(max(value.estimate for _, value in found.searched) / there - 1.0)
    assert abs(np.mean(values)) < 4.0 / np.sqrt(20)
    assert np.std(values) < 1.7
    assert np.mean(lucky) > 0.04
    assert np.mean(heights) > 0.96 * HEIGHT


def test_runs_without_errors_tell_no_flat_region():
    class Short(ToyRunner):
        def _answer(self, request):
            answer = super()._answer(request)
            bare = {n: replace(e, standard_error=None) for n, e in answer.quantities.items()}
            return replace(answer, quantities=bare)

    found = optimum(PAPER, OVER, maximise="jump_rate", evaluations=16, runner=Short(hill, 0.1))
    assert all(math.isnan(each.flat_low) for each in found.parameters)
    assert any("too short to show how flat" in line for line in found.sentences())
    json.dumps(found.to_dict(), allow_nan=False)


@pytest.mark.parametrize(
    ("level", "said", "unsaid", "longer"),
    [
        (0.0, "is 0 within its error at the optimum", "flat", False),
        (9.0, "flat: in the whole range", "widen", True),
    ],
)
def test_a_flat_quantity_and_one_of_nothing_say_so(level, said, unsaid, longer):
    runner = ToyRunner(lambda scene: level, 1e-3)
    found = optimum(PAPER, OVER, maximise="jump_rate", evaluations=16, runner=runner)
    lines = [line for line in found.sentences() if said in line]
    assert lines
    assert not any(unsaid in line for line in lines)
    assert any("run.duration" in line for line in lines) == longer


def test_places_where_no_run_ends_are_gone_around():
    class Failing(ToyRunner):
        def _answer(self, request):
            broken = request.scene.stoppers[0].gap > 1.6
            return SimulationError("it fell apart") if broken else super()._answer(request)

    found = optimum(PAPER, OVER, maximise="mean_power", method="consistent", runner=Failing(hill))
    assert found.value.estimate > 0.999 * HEIGHT
    assert any("no run completed" in line for line in found.sentences())
    with pytest.raises(SimulationError, match="it fell apart"):
        optimum(
            PAPER.replace({"stoppers.gap": 1.7}), OVER, maximise="mean_power", runner=Failing(hill)
        )
    with pytest.raises(OptimumError, match="all runs failed, at each of 16 points"):
        optimum(
            PAPER,
            {**OVER, "stoppers.gap": (1.7, 2.0)},
            maximise="mean_power",
            evaluations=16,
            runner=Failing(hill),
        )


@pytest.mark.parametrize(
    ("over", "options", "message"),
    [
        ({"stoppers.gapp": None}, {}, r"over stoppers\.gapp.*did you mean stoppers\.gap"),
        ({"oscillator.damping": (2.0, 1.0)}, {}, "the range 2 to 1 is empty"),
        ({}, {"evaluations": 3}, "evaluations 3"),
        ({}, {"maximise": "mean_powr"}, "did you mean mean_power"),
    ],
)
def test_mistakes_are_named(over, options, message):
    with pytest.raises(HarvesterError, match=message):
        optimum(PAPER, {**OVER, **over}, runner=ToyRunner(hill), **options)


def test_the_command_names_mistakes(capsys):
    for arguments, message in (
        (["--over", "load.decay_rate=1-2"], "must be written as TABLE.KEY=LOW:HIGH"),
        (["--over", "load.decay_rate"] * 2, "is given twice"),
        (["--over", "load.decay_rate=1:2", "--from", "1"], "are for a single --over"),
        (["--over", "load.decay_rate", "--evaluations", "9"], "is for several parameters"),
    ):
        assert main(["optimum", "linear", *arguments]) == 2
        assert message in capsys.readouterr().err


@pytest.mark.slow
def test_the_command_goes_on_after_its_time(tmp_path, capsys):
    command = ["optimum", "linear", "--set", "run.realizations=2", "--set", "run.duration=300"]
    command += ["--set", "run.settle=30", "--maximise", "mean_power", "--evaluations", "16"]
    command += ["--over", "load.decay_rate=0.5:10", "--over", "excitation.correlation_time=0.1:1"]
    command += ["--workers", "2", "--output", str(tmp_path)]
    assert main([*command, "--time-budget", "0.001"]) == 1
    assert "try a time budget of 1 s" in capsys.readouterr().err
    assert main(command) == 0
    assert "within 1% of the maximum" in capsys.readouterr().out
    content = json.loads((tmp_path / "linear-optimum.json").read_text())
    assert content["parameters"]["load.decay_rate"]["range"] == [0.5, 10.0]


LINEAR = {
    "units": "SI",
    "oscillator": {"mass": 8e-3, "damping_ratio": 0.02, "linear_stiffness": 505.0},
    "piezo": {"coupling": 1.2e-3, "capacitance": 40e-9},
    "load": {"resistance": 100e3},
    "excitation": {"kind": "sine", "amplitude": 2.0, "frequency": 41.0},
    "run": {"duration": 10.0, "settle": 2.0},
}


def _power_of_a_sine(resistance, frequency):
    """|V|²/2R of the linear device, in closed form."""
    rate = 2j * math.pi * frequency
    damping = 0.04 * math.sqrt(505.0 * 8e-3)
    compliance = 1.0 / (505.0 + rate * damping + rate**2 * 8e-3)
    admittance = 1.0 / resistance + rate * (40e-9 + 1.2e-3**2 * compliance)
    voltage = rate * 1.2e-3 * compliance * 8e-3 * 2.0 / admittance
    return abs(voltage) ** 2 / 2.0 / resistance


@pytest.mark.slow
@pytest.mark.parametrize(
    "keys", [("load.resistance", "excitation.frequency"), ("load.resistance",)]
)
def test_a_method_without_noise_is_optimised_to_its_precision(keys):
    ranges = {"load.resistance": (1e4, 1e6), "excitation.frequency": (35.0, 48.0)}
    found = optimum(
        Scene.from_tables(LINEAR), {key: ranges[key] for key in keys}, maximise="mean_power",
        method="spectral", evaluations=16, workers=1,
    )  # fmt: skip

    def loss(values):
        return -1e4 * _power_of_a_sine(math.exp(values[0]), *[*values[1:], 41.0][:1])

    best = minimize(
        loss,
        [11.0, 41.0][: len(keys)],
        method="Nelder-Mead",
        options={"xatol": 1e-7, "fatol": 1e-12},
    )
    places = [math.exp(best.x[0]), *best.x[1:]]
    assert [each.place for each in found.parameters] == pytest.approx(places, rel=1e-3)
    assert found.value.estimate == pytest.approx(-best.fun * 1e-4, rel=1e-7)
    # The flat region ends where 1 % is lost, the others held.
    first = found.parameters[0]
    for edge in (first.flat_low, first.flat_high):
        assert loss([math.log(edge), *best.x[1:]]) / best.fun == pytest.approx(0.99, abs=2e-4)
    assert "interval" not in " ".join(found.sentences())


@pytest.mark.exhaustive
def test_the_published_bistable_harvester(pool):
    """High orbit of americocunhajr/HarvesterOpt's two-parameter problem: P = 10 × scaled power.

    Their highest of 65 536 is 0.0172; their cross-entropy search took 475 to 2800 evaluations to
    0.0171. The low orbit that most of the range leads to has 0.0003 to 0.009. The high one fills a
    corner of it: of seeds 1 to 4 the third misses it.
    """
    tables = {
        "units": "scaled",
        "oscillator": {"damping": 0.02, "linear_stiffness": -0.5, "cubic_stiffness": 0.5},
        "piezo": {"coupling": 0.025},
        "load": {"decay_rate": 0.05},
        "start": {"displacement": 1.0},
        "excitation": {
            "kind": "sine",
            "amplitude": 0.09,
            "frequency": 0.8 / (2.0 * math.pi),
            "phase": 0.5 * math.pi,
        },
        "run": {"duration": 1250.0, "settle": 1250.0, "seed": 1},
    }
    over = {
        "excitation.amplitude": (0.08, 0.1),
        "excitation.frequency": (0.75 / (2.0 * math.pi), 0.85 / (2.0 * math.pi)),
    }
    with open_runner(executor=pool) as runner:
        found = optimum(
            Scene.from_tables(tables), over, maximise="mean_power", evaluations=96, runner=runner
        )
    assert 0.0165 < 10.0 * found.value.estimate < 0.0175
    assert found.evaluations <= 500
    words = r"of 16 random starts at the optimum: the orbit from \[start\] is followed \("
    assert any(re.match(words + r".*\): others reach", line) for line in found.sentences())
    assert len(found.to_dict()["orbits"]) > 1
