"""Refusals in their place, and realizations added until the error bar is small enough."""

import json
import math
from dataclasses import replace

import pytest
from scipy.integrate import quad
from truths import flat, interpolated_linear_means

from harvester.base.errors import AveragingError, HarvesterError, LoadError
from harvester.engines.methods import MonteCarlo
from harvester.engines.opening import open_runner
from harvester.engines.realizations import Realizations
from harvester.engines.request import (
    Request,
    in_rounds,
    note_on_steps,
    relative_error,
    sampling_error_budget,
)
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing
from harvester.statistics.estimate import with_roots
from harvester.statistics.paired import paired_difference

LINEAR = Scene.read("linear", ["run.realizations=2", "run.duration=500", "run.settle=50"])
PAPER = Scene.read("paper", ["run.realizations=2", "run.duration=500", "run.settle=50"])


@pytest.fixture
def runner(pool):
    with open_runner(executor=pool) as one:
        yield one


def test_answers_are_in_order_and_a_refusal_stands_in_its_place(runner, pool):
    refused = Request(PAPER.replace({"piezo.coupling": 5.0}), "consistent")
    closure = Request(PAPER, "consistent", density=True)
    engine = Request(PAPER, "monte-carlo", moments=True)
    bridge = Scene.read("device").replace({"load.netlist": "bridge"})
    loaded = Request(bridge, "consistent")
    found = runner.answer([refused, closure, engine, closure, loaded])
    assert isinstance(found[0], AveragingError)
    assert found[1].density.density.max() > 0.5
    assert found[3] == replace(found[1], seconds=found[3].seconds)
    assert isinstance(found[4], LoadError)
    # The scene's own run, as `simulate` has it.
    alone = simulate(PAPER, method="monte-carlo", runner=pool)
    assert found[2].quantities == alone.scaled_quantities
    assert found[2].in_units() == with_roots(alone.quantities)
    assert found[2].energy_balance_residual == alone.energy_balance_residual
    assert found[2].simulated_time == alone.simulated_time
    assert found[2].notes == alone.notes
    assert len(found[2].moments) == 2
    assert json.dumps([each.to_dict() for each in found[1:4]], allow_nan=False)


def test_realizations_are_added_until_the_error_bar_is_the_one_asked_for(runner):
    """Truth within four standard errors: false alarm one in 16 000."""
    (answer,) = runner.answer([Request(LINEAR, "monte-carlo", precision=0.02)])
    voltage = answer.quantities["mean_square_voltage"]
    assert relative_error(voltage) <= 0.02
    assert 8 < answer.realizations == answer.scene.run.realizations < 80
    exact = interpolated_linear_means(flat(LINEAR), knot_spacing(prepared(LINEAR)))
    error = abs(voltage.estimate - exact["mean_square_voltage"])
    assert error < 4.0 * voltage.standard_error
    assert not any("above the requested" in note for note in answer.notes)


def test_a_sharper_request_goes_on_where_the_other_ended(tmp_path, pool):
    def ask(precision, output):
        with open_runner(output, executor=pool) as runner:
            return runner.answer([Request(LINEAR, "monte-carlo", precision=precision)])[0], runner

    rough, first = ask(0.1, tmp_path)
    sharp, second = ask(0.02, tmp_path)
    assert second.reused == first.computed
    assert second.computed == sharp.realizations // 8 - rough.realizations // 8 > 0
    direct, _ = ask(0.02, None)
    assert direct.quantities == sharp.quantities


def test_the_quantity_asked_for_decides(runner):
    """The efficiency of the linear device hardly scatters, its power does."""
    names = ("power_conversion_efficiency", "mean_power")
    found = runner.answer(
        [Request(LINEAR, "monte-carlo", precision=0.02, quantities=(name,)) for name in names]
    )
    reached = [relative_error(a.quantities[n]) for a, n in zip(found, names, strict=True)]
    assert max(reached) <= 0.02
    assert found[0].realizations < found[1].realizations
    with pytest.raises(HarvesterError, match="did you mean mean_power"):
        runner.answer([Request(LINEAR, "monte-carlo", quantities=("mean_powr",))])


def test_what_may_not_be_long_enough_says_so(runner):
    (answer,) = runner.answer([Request(LINEAR, "monte-carlo", precision=0.001, most=16)])
    assert answer.realizations == 16
    assert any("above the requested 0.1%" in note for note in answer.notes)


def test_one_unseen_jump_weighs_what_its_charge_leaves_on_the_piezo(runner):
    """∫V² after a jump over E[V²] T is what the next jump would add."""
    p = flat(PAPER)
    left = quad(lambda t: (2 * p.rest * math.exp(-p.decay_rate * t)) ** 2, 0.0, math.inf)[0]
    few = {"realizations": 8, "most": 8}
    (answer,) = runner.answer([Request(PAPER, "monte-carlo", precision=0.9, **few)])
    voltage = answer.quantities["mean_square_voltage"].estimate
    share = left / (voltage * 8 * PAPER.run.duration)
    sure, blind = runner.answer(
        [Request(PAPER, "monte-carlo", precision=factor * share, **few) for factor in (1.01, 0.99)]
    )
    assert (sure.misses_jumps, blind.misses_jumps) == (False, True)


def test_requests_for_one_scene_share_their_realizations(runner):
    """With histograms for all, where one asks for them."""
    few, many = (Request(LINEAR, "monte-carlo", realizations=n) for n in (8, 16))
    dense = Request(LINEAR, "monte-carlo", realizations=16, density=True, moments=True)
    found = runner.answer([few, many, dense])
    assert runner.computed == 2
    assert found[1].quantities == found[2].quantities
    assert found[0].density is None
    assert found[2].density.standard_error is not None
    assert paired_difference(found[2], found[2])["mean_square_voltage"].estimate == 0.0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"method": "montecarlo"}, "did you mean monte-carlo"),
        ({"step": "finer"}, "did you mean fine"),
        ({"precision": 2.0}, "must be a number in"),
    ],
)
def test_mistakes_are_named(options, said):
    with pytest.raises(HarvesterError, match=said):
        Request(PAPER, **{"method": "monte-carlo", **options})


@pytest.mark.parametrize("precision", [1e-300, 5e-324])
def test_a_precision_that_no_run_reaches_doubles_the_realizations(precision):
    cut = Realizations.of(prepared(LINEAR), MonteCarlo())

    def counts(most):
        plan = in_rounds(cut, 64, most, precision, lambda good, ended: (len(good), 0.1))
        wanted, done = next(plan), 0
        while True:
            done += sum(len(task.arguments["indices"]) for task in wanted.tasks)
            yield done
            try:
                wanted = plan.send([{} for _ in wanted.tasks])
            except StopIteration:
                return

    assert [*counts(256)] == [64, 128, 256]
    assert [*counts(100)] == [64, 100]


@pytest.mark.parametrize(("cost", "aim"), [(0.0, 0.01), (0.006, 0.008), (0.02, 0.01)])
def test_a_precision_counts_what_the_steps_cost(cost, aim):
    assert sampling_error_budget(0.01, cost) == pytest.approx(aim)
    assert bool(note_on_steps(0.01, cost)) is (cost > 0.01)
