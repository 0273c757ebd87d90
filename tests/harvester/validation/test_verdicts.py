"""Verdicts: what judges, what each judge can see, and that broken integrators are called wrong."""

import dataclasses
import math

import pytest

from harvester.base.errors import (
    AveragingError,
    HarvesterError,
    LoadError,
    SceneError,
    SimulatorTimeout,
)
from harvester.engines.methods import ENGINES, Circuit, MonteCarlo
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing, steps_per_sample
from harvester.statistics.estimate import Estimate
from harvester.validation import MEANS
from harvester.validation.path_deviation import PathDeviation, path_deviation
from harvester.validation.stability_cases import Case, CaseAnswer
from harvester.validation.verdicts import row_of_case

CASE = Case("scene", "as it is", {})
GOOD_PATH = PathDeviation("monte-carlo", 1e-4, math.nan, 3e-3, 5e-3, 20.0, 25.0, 44.0, 8)


def said(value=1.0, error=0.01, residual=1e-4, path=GOOD_PATH, **others):
    estimates = {name: Estimate(value, error, None, "1") for name in MEANS}
    return CaseAnswer(estimates, residual, 1.0, 100, 4, path=path, **others)


def closure(value=1.0, error=1e-5):
    return said(value, error, None, None)


def verdicts(**answers):
    answers = {name.replace("_carlo", "-carlo"): answer for name, answer in answers.items()}
    return row_of_case(CASE, Scene.read("paper"), answers).cells


def with_path(**changes):
    return said(path=dataclasses.replace(GOOD_PATH, **changes))


def test_a_cell_that_its_judges_agree_with_is_right_and_says_how_sharply():
    found = verdicts(monte_carlo=said(1.03), fokker_planck=closure())
    assert {each.word for each in found.values()} == {"right"}
    sharp = {each.reference: each.sharpness for each in found["monte-carlo"].references}
    assert sharp["fine monte-carlo path"] == 3e-3
    assert sharp["fokker_planck"] == pytest.approx(math.hypot(0.01, 0.005))


@pytest.mark.parametrize(
    ("outcome", "reason"),
    [
        (said(residual=0.02), "energy balance"),
        (said(residual=math.nan), "energy balance"),
        (with_path(of_limit=4e-3), "limit for short steps"),
        (with_path(of_limit=math.nan), "limit for short steps"),
        (with_path(of_mechanics=0.01), "the mass under the recorded voltage"),
        (with_path(of_mean_squares=0.04), "mean squares along the path"),
        (with_path(compared_periods=2.0), "length of the path followed"),
        (HarvesterError("RuntimeWarning: overflow"), "overflow"),
    ],
)
def test_a_wrong_one_is_called_wrong(outcome, reason):
    found = verdicts(circuit=outcome)["circuit"]
    assert found.word == "wrong"
    assert reason in found.reason


def test_means_that_differ_from_the_stationary_solution_are_wrong_on_both_sides():
    found = verdicts(monte_carlo=said(1.08), fokker_planck=closure())
    assert {each.word for each in found.values()} == {"wrong"}
    assert "mean square voltage" in found["monte-carlo"].reason
    # Where circuit and Monte Carlo follow one path, it is the solution that is off.
    found = verdicts(circuit=said(), monte_carlo=said(1.08), fokker_planck=closure())
    assert [each.word for each in found.values()] == ["right", "right", "wrong"]
    # Nothing is said of them before the transient has passed.
    found = verdicts(monte_carlo=said(2.0, settled=False), fokker_planck=closure())
    assert {each.word for each in found.values()} == {"right"}


def test_what_is_known_roughly_only_is_not_judged():
    rough = said(1.3, 0.3, path=dataclasses.replace(GOOD_PATH, comparable_periods=0.4))
    found = verdicts(monte_carlo=rough, fokker_planck=closure())["monte-carlo"]
    assert found.word == "not judged"
    assert found.reason == "known to 30% only"
    found = verdicts(circuit=said(path=dataclasses.replace(GOOD_PATH, comparable_periods=0.4)))
    assert found["circuit"].word == "not judged"
    assert "0.4 periods" in found["circuit"].reason


def test_a_limit_on_time_is_no_fault_and_a_refusal_none_either():
    found = verdicts(
        circuit=SimulatorTimeout("stopped"),
        monte_carlo=LoadError("no resistor"),
        paper=AveragingError("no double well"),
        consistent=SceneError("none"),
        fokker_planck=None,
    )
    words = ["unfinished", "refused", "refused", "refused", "unfinished"]
    assert [each.word for each in found.values()] == words


def test_closures_are_judged_by_their_own_grids():
    found = verdicts(paper=closure(error=0.01), fokker_planck=closure(error=0.01))
    assert [each.word for each in found.values()] == ["wrong", "right"]
    assert verdicts(paper=closure(math.nan, math.nan))["paper"].word == "wrong"


def broken_engine(engine, change, longer=1, scheme=None):
    """An engine that runs another scene than it is told to, or with a longer step."""

    @dataclasses.dataclass(frozen=True)
    class Broken(Circuit):
        def prepare(self, ready):
            engine().prepare(ready)

        def run_realizations(self, ready, paths, starts, observers, outputs=None):
            step = self.step
            if step == "default":
                step = knot_spacing(ready) / steps_per_sample(ready)
            step = step if isinstance(step, str) else longer * step
            other = prepared(ready.scene.replace(change(ready.scene)))
            used = engine(step=step, **({"scheme": scheme} if scheme else {}))
            return used.run_realizations(other, paths, starts, observers, outputs)

    return Broken


BROKEN = {
    "contact stiffness 1 % off": lambda s: {"stoppers.stiffness": 1.01 * s.stoppers[0].stiffness},
    "damping left out": lambda s: {"oscillator.damping": 0.0},
    "coupling 1 % off": lambda s: {"piezo.coupling": 1.01 * s.transducer.coupling},
    "spring 0.5 % off": lambda s: {
        "oscillator.cubic_stiffness": 1.005 * s.oscillator.cubic_stiffness
    },
}
INTACT = {}


def word_of(scene, monkeypatch, change, longer=1):
    """Verdict on an engine that stands in the circuit's place, of second order as it is."""
    monkeypatch.setitem(ENGINES, "circuit", broken_engine(MonteCarlo, change, longer, "heun"))
    path, _ = path_deviation(prepared(scene), "circuit", "default")
    return verdicts(circuit=said(path=path))["circuit"].word


def scene_of(*overrides):
    """Paths of this seed stay comparable for nine periods, of others for two to thirteen."""
    changes = ["excitation.intensity=0.1", "excitation.knot_spacing=0.2", "run.seed=3"]
    return Scene.read("paper", changes).replace(dict(overrides))


@pytest.mark.parametrize("change", BROKEN.values(), ids=BROKEN)
def test_an_integrator_with_a_wrong_equation_is_called_wrong(monkeypatch, change):
    assert word_of(scene_of(), monkeypatch, change) == "wrong"


def test_the_same_integrator_with_the_right_equations_is_right(monkeypatch):
    assert word_of(scene_of(), monkeypatch, lambda scene: INTACT) == "right"


def test_a_step_four_times_too_long_is_called_wrong(monkeypatch):
    assert word_of(scene_of(), monkeypatch, lambda scene: INTACT, longer=4) == "wrong"


@pytest.mark.slow
@pytest.mark.parametrize(("share", "word"), [(1.0, "right"), (0.95, "wrong")])
def test_the_mass_is_judged_whatever_the_load(monkeypatch, share, word):
    scene = Scene.read("device", ["load.netlist=bridge", "excitation.intensity=0.01"])
    damping = share * scene.oscillator.damping
    broken = broken_engine(Circuit, lambda s: {"oscillator.damping": damping})
    monkeypatch.setitem(ENGINES, "circuit", broken)
    path, _ = path_deviation(prepared(scene), "circuit", "default")
    assert verdicts(circuit=said(path=path))["circuit"].word == word
