"""The energy balance's residual comes with a suspected cause."""

from dataclasses import replace

import pytest

from harvester.engines.residual_cause import suspected_cause
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.statistics.balance import energy_balance_residual
from harvester.statistics.moments import QUANTITIES

SHORT = ["run.realizations=8", "run.duration=400", "run.settle=20"]


def disturbed(result, quantity, factor):
    """The result with one integral off by a factor."""
    for moments in result.moments:
        moments.integrals[:, QUANTITIES.index(quantity)] *= factor
    residual = energy_balance_residual(result.moments, prepared(result.scene).system)
    assert abs(residual) > 0.005
    return replace(result, energy_balance_residual=residual)


def test_a_load_that_is_not_the_one_reckoned_with(pool):
    result = simulate(Scene.read("linear", SHORT), method="monte-carlo", runner=pool)
    cause = suspected_cause(disturbed(result, "load_power", 1.05))
    assert "the load: the missing energy is proportional to its dissipation (ratio -0.04" in cause


def test_a_transducer_whose_loss_is_not_the_one_reckoned_with(pool):
    """A leak's loss goes with a resistor's power, and not with what the damper takes."""
    leaky = [*SHORT, "piezo.leakage_rate=0.3"]
    result = simulate(Scene.read("linear", leaky), method="monte-carlo", runner=pool)
    for moments in result.moments:
        loss = moments.integrals[:, QUANTITIES.index("transducer_loss")]
        moments.integrals[:, QUANTITIES.index("loss_power")] += 0.2 * loss
        loss *= 1.2
    residual = energy_balance_residual(result.moments, prepared(result.scene).system)
    cause = suspected_cause(replace(result, energy_balance_residual=residual))
    assert "the load or the transducer: the missing energy is proportional to" in cause


def test_a_load_that_delivers(pool):
    result = simulate(Scene.read("linear", SHORT), method="monte-carlo", runner=pool)
    assert "active" in suspected_cause(disturbed(result, "load_power", -0.2))


def test_contacts_shorter_than_the_steps_between_them(pool):
    scene = Scene.read("paper", [*SHORT, "stoppers.stiffness=1e5", "excitation.intensity=0.1"])
    result = simulate(scene, method="monte-carlo", runner=pool)
    assert suspected_cause(disturbed(result, "loss_power", 1.05)).startswith("contacts: ")


def test_a_run_whose_ends_count(pool):
    scene = Scene.read("linear", ["run.realizations=8", "run.duration=1", "run.settle=0"])
    result = simulate(scene, method="monte-carlo", runner=pool)
    assert "too short" in suspected_cause(disturbed(result, "input_power", 1.05))


@pytest.mark.parametrize("step", [0.02])
def test_a_step_too_long(pool, step):
    scene = Scene.read("linear", [*SHORT, "oscillator.linear_stiffness=1e3", "run.duration=100"])
    result = simulate(scene, method="monte-carlo", step=step, runner=pool)
    note = next(note for note in result.notes if "residual" in note)
    assert "suspected: the step" in note


def test_a_run_that_diverged(pool):
    result = simulate(Scene.read("linear", SHORT), method="monte-carlo", runner=pool)
    for moments in result.moments:
        moments.integrals[:, QUANTITIES.index("load_power")] = float("nan")
    assert "diverged" in suspected_cause(replace(result, energy_balance_residual=float("nan")))
