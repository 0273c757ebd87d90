"""Many scenes through one pool: refusals in place, runs as long as their error asks for."""

import math

import pytest
from scipy.integrate import quad
from truths import flat, interpolated_linear_means

import harvester.studies.sweep as module
from harvester.engines.steps import knot_spacing
from harvester.errors import AveragingError, EngineNotFound, SimulationError
from harvester.scene.model import Scene
from harvester.simulation import simulate
from harvester.studies.sweep import (
    Request,
    answer,
    costly_first,
    failed,
    relative_error,
    resolving,
    sweep,
    unseen_jump,
)

LINEAR = Scene.load("linear", ["run.realizations=2", "run.duration=500", "run.settle=50"])
PAPER = Scene.load("paper", ["run.realizations=2", "run.duration=500", "run.settle=50"])


def test_outcomes_stand_by_their_requests_and_a_refusal_in_its_place(pool):
    refused = Request(PAPER.replace({"piezo.coupling": 5.0}), "consistent")
    closure = Request(PAPER, "consistent", density=True)
    engine = Request(PAPER, "monte-carlo", moments=True)
    shares = []
    outcomes = sweep([refused, closure, engine, closure], pool, shares.append)
    assert set(outcomes) == {refused, closure, engine}
    assert isinstance(outcomes[refused], AveragingError)
    assert failed(outcomes[refused])
    assert outcomes[closure].density.density.max() > 0.5
    assert shares[-1] == pytest.approx(1.0)
    alone = simulate(PAPER, "monte-carlo", pool=pool)
    mine = outcomes[engine].result.scaled_quantities
    assert mine["mean_square_voltage"] == alone.scaled_quantities["mean_square_voltage"]


def test_requests_are_begun_in_their_order_and_told_with_their_outcomes():
    class Backwards:
        """A pool whose last call is done first."""

        def map(self, function, calls, time_limit, on_progress, keep_going, on_result):
            self.begun = [call["request"] for call in calls]
            for index in reversed(range(len(calls))):
                on_result(index, f"by {self.begun[index].method}")
            return [f"by {request.method}" for request in self.begun]

    requests = [Request(PAPER, method) for method in ("consistent", "circuit", "paper")]
    told, pool = {}, Backwards()
    outcomes = sweep([*requests, requests[0]], pool, on_answer=told.__setitem__)
    assert pool.begun == requests
    assert told == outcomes == {request: f"by {request.method}" for request in requests}
    assert list(told) == requests[::-1]
    assert [r.method for r in costly_first(requests)] == ["circuit", "consistent", "paper"]


@pytest.mark.parametrize(
    ("method", "kind"), [("paper", AveragingError), ("circuit", SimulationError)]
)
def test_a_slip_at_one_point_is_an_outcome_with_its_name(method, kind, monkeypatch):
    def slip(request):
        raise ZeroDivisionError("nothing to divide by")

    monkeypatch.setattr(module, "_averaged", slip)
    monkeypatch.setattr(module, "_simulated", slip)
    outcome = answer(Request(PAPER, method), report=lambda share: None)
    assert type(outcome) is kind
    assert str(outcome) == "ZeroDivisionError: nothing to divide by"


def test_what_would_fail_at_every_point_ends_the_sweep(monkeypatch):
    def missing(request):
        raise EngineNotFound("no ngspice")

    monkeypatch.setattr(module, "_simulated", missing)
    with pytest.raises(EngineNotFound, match="no ngspice"):
        answer(Request(PAPER, "circuit"), report=lambda share: None)


def test_a_run_is_lengthened_until_its_error_bar_is_the_one_asked_for(pool):
    """Truth within four standard errors: false alarm one in 16 000."""
    request = Request(LINEAR, "monte-carlo", error=0.01, longest=1e5)
    answer = sweep([request], pool)[request]
    voltage = answer.quantities["mean_square_voltage"]
    assert relative_error(voltage) <= 0.01
    assert answer.scene.run.duration > LINEAR.run.duration
    exact = interpolated_linear_means(flat(LINEAR), knot_spacing(LINEAR))
    error = abs(voltage.estimate - exact["mean_square_voltage"])
    assert error < 4.0 * voltage.standard_error
    assert not any("above" in note for note in answer.notes)


def test_a_run_that_may_not_be_long_enough_says_so(pool):
    request = Request(LINEAR, "monte-carlo", error=0.001, longest=1000.0)
    answer = sweep([request], pool)[request]
    assert answer.scene.run.duration == 1000.0
    assert any("above the 0.1% asked for" in note for note in answer.notes)


def test_one_unseen_jump_weighs_what_its_charge_leaves_on_the_piezo(pool):
    result = simulate(PAPER, "monte-carlo", pool=pool)
    p = flat(PAPER)
    left = quad(lambda t: (2 * p.rest * math.exp(-p.decay_rate * t)) ** 2, 0.0, math.inf)[0]
    measured = PAPER.run.realizations * PAPER.run.duration
    voltage = result.scaled_quantities["mean_square_voltage"].estimate
    assert unseen_jump(result) == pytest.approx(left / (voltage * measured), rel=1e-6)
    sure, blind = (Request(PAPER, "monte-carlo", error=share) for share in (1e3, 0.5))
    outcomes = sweep([sure, blind], pool)
    assert [outcomes[r].misses_jumps for r in (sure, blind)] == [False, True]
    assert any(note.startswith("one jump more would add") for note in outcomes[blind].notes)
    assert unseen_jump(simulate(LINEAR, "monte-carlo", pool=pool)) == 0.0


def test_knots_follow_a_shorter_correlation_time_only():
    assert knot_spacing(resolving(PAPER)) == 0.05
    short = PAPER.replace({"excitation.correlation_time": 0.1})
    assert knot_spacing(resolving(short)) == pytest.approx(0.0125)
